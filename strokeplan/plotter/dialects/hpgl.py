"""HP-GL for pen plotters (HP 7475A, 7470A; Roland DXY): whole units, polylines, pens that the plotter fetches.

Absolute coordinates (PA), rounded from the exact ones, so that errors do not add up. A list of points is cut into
commands no longer than half of the plotter's buffer. The language of these plotters has no comments: a file has no
header.

Known limits: PA costs more bytes than PR on a slow line; velocity is set with the pen and not within it.

Source: HP 7475A Interfacing and Programming Manual (1984), chapters 3, 4.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import PlotError
from strokeplan.plotter.machine import find_paper
from strokeplan.plotter.profile import Hpgl
from strokeplan.plotter.program import JobPen, Program

MAX_UNIT = 32767
MM_MIN_PER_CM_S = 600


def encode(program: Program) -> bytes:
    """The file of a program. Raises PlotError for coordinates that the language has no room for."""
    dialect = program.profile.dialect
    if not isinstance(dialect, Hpgl):
        raise TypeError("a profile of another dialect")
    points, starts = program.polylines
    units = np.rint(points / dialect.unit_mm).astype(np.int64)
    if np.abs(units).max() > MAX_UNIT:
        raise PlotError(f"a coordinate of {np.abs(units).max()} units is above {MAX_UNIT}, the most HP-GL knows")
    return ("\n".join(_commands(program, dialect, units, starts)) + "\n").encode("ascii")


def _commands(program: Program, dialect: Hpgl, units: NDArray[np.int64], starts: NDArray[np.int64]) -> Iterator[str]:
    yield from start(program)
    changes = set(program.changes)
    for j in range(len(program)):
        if j in changes:
            yield from taken(program.pens[program.pen[j]], float(program.feeds[j]), dialect)
        yield from line_commands(units[starts[j] : starts[j + 1]].tolist(), dialect.buffer_bytes // 2)
    yield "SP0;"


def start(program: Program) -> Iterator[str]:
    """What comes before all lines."""
    yield "IN;"
    if program.profile.papers:
        paper, _ = find_paper(program.transform.page, program.profile)
        if paper.code is not None:
            yield f"PS{paper.code};"
    yield "PA;"


def taken(pen: JobPen, feed: float, dialect: Hpgl) -> Iterator[str]:
    """Another pen, and its speed (mm/min)."""
    yield f"SP{pen.slot};"
    yield f"VS{min(feed / MM_MIN_PER_CM_S, dialect.max_speed_cm_s):.1f};"


def line_commands(line: list[list[int]], room: int) -> Iterator[str]:
    """One line in units: there, along it in commands of at most `room` bytes, pen up."""
    yield f"PU{line[0][0]},{line[0][1]};"
    yield from _drawn(line, room)
    yield "PU;"


def _drawn(line: list[list[int]], room: int) -> Iterator[str]:
    """PD along a line, in commands of at most `room` bytes; a point is drawn by putting the pen down on it."""
    pairs = [f"{b[0]},{b[1]}" for a, b in pairwise(line) if a != b]
    command = "PD"
    for pair in pairs:
        if len(command) + len(pair) + 2 > room:
            yield f"{command};"
            command = "PD"
        command += pair if command == "PD" else f",{pair}"
    yield f"{command};"
