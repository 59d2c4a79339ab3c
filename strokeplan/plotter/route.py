"""Everywhere that a machine goes with a program, in order: its lines, the wells, where pens are changed, and home.

A stop is a line of one point: the motion planner travels there, and draws nothing. What the machine stands for, the
pen's way down and up included, is beside it in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.biarcs import chords
from strokeplan.plotter import motion
from strokeplan.plotter.brush import visit_s, visits
from strokeplan.plotter.profile import Ebb, Gcode
from strokeplan.plotter.program import Program, limits, pen_moves_s
from strokeplan.plotter.tools import Brush

ARC_TOLERANCE_MM = 0.002
"""GRBL's default of $12: how it cuts arcs into lines."""
DWELL_STEP_S = 0.05
"""GRBL 1.1 waits in steps of this, rounded up (config.h, DWELL_TIME_STEP)."""
Kind = Literal["change", "dip", "wash", "wipe", "home"]


class Stop(NamedTuple):
    """A place that the machine goes to before a line, and how long it stays there."""

    line: int
    kind: Kind
    at: tuple[float, float]
    stay_s: float


@dataclass(frozen=True, eq=False)
class Route:
    """k lines and stops, in the order of time.

    line    (k,) the line of the program, −1 for a stop.
    stay_s  (k,) seconds that the machine stands: the pen's moves, or the stop itself; a line's pen goes down after
            `lower_s` (k,) of them.
    motion  how it moves, without any of that.
    """

    line: NDArray[np.int64]
    stay_s: NDArray[np.float64]
    lower_s: NDArray[np.float64]
    stops: tuple[Stop, ...]
    motion: motion.Motion

    @property
    def took_s(self) -> NDArray[np.float64]:
        """(k,) seconds for each, the way there included."""
        return self.motion.travel_s + self.motion.draw_s + self.stay_s


def route_of(program: Program) -> Route:
    """The way of a program's machine, planned."""
    points, starts = _lines(program)
    stops = tuple(_stops(program))
    before = np.array([stop.line for stop in stops], np.int64)
    places = np.array([stop.at for stop in stops], np.float64).reshape(-1, 2)
    line = np.insert(np.arange(len(program)), before, -1)
    counts = np.insert(np.diff(starts), before, 1)
    feeds = np.insert(program.feeds, before, program.profile.speeds.travel_mm_min)
    moved = motion.plan(
        np.insert(points, starts[before], places, axis=0),
        np.concatenate([[0], np.cumsum(counts)]),
        limits(program.profile),
        feeds,
    )
    moves = np.array([_pen_s(program, k) for k in range(len(program.pens))])[program.pen]
    stay_s = np.insert(moves.sum(axis=1), before, [stop.stay_s for stop in stops])
    return Route(line, stay_s, np.insert(moves[:, 0], before, 0.0), stops, moved)


def _lines(program: Program) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The segments that the machine moves along: arcs are cut as its controller does."""
    dialect = program.profile.dialect
    if isinstance(dialect, Gcode) and dialect.curves == "arcs" and not isinstance(program.profile.tool, Brush):
        return chords(program.arcs, ARC_TOLERANCE_MM)
    return program.polylines


def _stops(program: Program) -> list[Stop]:
    profile = program.profile
    park = profile.change.park_mm
    stops: list[Stop] = []
    if not isinstance(profile.tool, Brush):
        ends = program.points[program.starts[1:] - 1]
        for j in program.changes[1:]:
            at = park or (float(ends[j - 1, 0]), float(ends[j - 1, 1]))
            stops.append(Stop(j, "change", at, profile.change.wait_s))
    stops += [Stop(stop.line, stop.kind, stop.well.at_mm, visit_s(program, stop)) for stop in visits(program)]
    if isinstance(profile.dialect, Ebb):
        stops.append(Stop(len(program), "home", (0.0, 0.0), 0.0))
    elif isinstance(profile.dialect, Gcode) and park is not None:
        stops.append(Stop(len(program), "home", park, 0.0))
    return stops


def _pen_s(program: Program, pen: int) -> tuple[float, float]:
    """Seconds for which the machine stands while a pen goes down, and up."""
    down, up = pen_moves_s(program.profile, program.pens[pen].settings)
    dialect = program.profile.dialect
    if isinstance(dialect, Gcode) and dialect.flavour == "grbl":
        down, up = (np.ceil(round(wait / DWELL_STEP_S, 6)) * DWELL_STEP_S for wait in (down, up))
    return float(down), float(up)
