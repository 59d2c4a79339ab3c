"""A program as units of progress: lines of the pen, one after the other, in the commands of its dialect.

A unit begins and ends with the pen up. Its commands are those that the exporter writes (dialects/), so that a drawing
that is streamed and a file of it are the same; only what a streamer does itself is left out (comments, M0, M2). Units
are made when they are asked for: a job of 100,000 lines takes the memory of one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strokeplan.errors import PlotError
from strokeplan.plotter.brush import Visit, visits_by_line
from strokeplan.plotter.driving.codec import Phrases
from strokeplan.plotter.profile import Ebb, Gcode, Hpgl
from strokeplan.plotter.program import JobPen, Program
from strokeplan.plotter.tools import Brush


@dataclass(frozen=True, slots=True)
class Unit:
    """One line of the pen, at position `key` of a job (from 0), line `line` of the program, in copy `copy` (from 0).

    before    commands before a person is asked: to the place of a change.
    prompt    what a person must do first; None: nothing.
    commands  all that is sent, made as it is read, once.
    """

    key: int
    line: int
    copy: int
    pen: int
    before: tuple[str, ...]
    prompt: str | None
    commands: Iterator[str]


def choose(program: Program, *, first: int = 1, layers: Sequence[str] = (), pens: Sequence[str] = ()) -> Program:
    """The lines from number `first` (from 1) on, of some layers and pens. Raises PlotError for names that are none."""
    if not 1 <= first <= len(program):
        raise PlotError(f"--from-stroke {first}: the drawing has strokes 1 to {len(program)}")
    keep = np.arange(len(program)) >= first - 1
    for option, given, known, column in (
        ("--layers", layers, list(program.layers), program.layer),
        ("--pens", pens, [pen.name for pen in program.pens], program.pen),
    ):
        for name in given:
            if name not in known:
                raise PlotError(f"{option} {name!r}: there is none of that name; there are {', '.join(known[:20])}")
        if given:
            keep &= np.isin(column, [k for k, name in enumerate(known) if name in given])
    if not keep.any():
        raise PlotError("nothing is left to draw: --from-stroke, --layers and --pens leave no stroke")
    return program if keep.all() else program.part(np.flatnonzero(keep))


class Script:
    """A program in its dialect's commands, unit by unit; dialects fill in the methods."""

    def __init__(self, program: Program, copies: int = 1) -> None:
        self.program, self.copies = program, copies

    def __len__(self) -> int:
        return len(self.program) * self.copies

    @property
    def unit_mm(self) -> float:
        """The unit of the coordinates in its commands."""
        return 1.0

    def phrases(self, pen: int) -> Phrases:
        """What the codec says around the units of a pen."""
        raise NotImplementedError

    def line(self, j: int, pen: JobPen) -> Iterator[str]:
        """The commands of line j."""
        raise NotImplementedError

    def travel(self, start: tuple[float, float], end: tuple[float, float]) -> Iterator[str]:
        """The commands that carry the pen, up, from where it is to another place, mm of the machine."""
        raise NotImplementedError

    def visit(self, stop: Visit) -> Iterator[str]:
        """The commands of a stay at a well."""
        return iter(())

    def taken(self, pen: JobPen) -> tuple[str, ...]:
        """Commands that another pen begins with."""
        return ()

    def parked(self, pen: int) -> tuple[str, ...]:
        """To where the machine waits for a change, pen up."""
        return self.phrases(pen).park

    @property
    def by_itself(self) -> bool:
        """Whether the machine changes pens without help."""
        return isinstance(self.program.profile.tool, Brush)

    def units(self, key: int = 0) -> Iterator[Unit]:
        """All units from position `key` on, sheet and pen of the first being in place; a brush is filled before it."""
        stops = self.stops
        before: tuple[int, int] | None = None  # copy and pen
        for k in range(key, len(self)):
            copy, line = divmod(k, len(self.program))
            pen = int(self.program.pen[line])
            visits_here = stops.get(line, [])
            if before is None and not visits_here:
                visits_here = self._refill(stops, line)
            prompt = None if before is None else self._prompt(pen, copy, before)
            changed = before is None or before[1] != pen
            yield Unit(
                k, line, copy, pen,
                () if before is None or prompt is None else self.parked(before[1]),
                prompt,
                self._commands(line, pen, visits_here, changed),
            )  # fmt: skip
            before = copy, pen

    def describe(self, key: int) -> tuple[int, int, int, float]:
        """Line, pen, copy of a unit, and how far the brush has painted since its last dip when it ends, in mm."""
        copy, line = divmod(key, len(self.program))
        return line, int(self.program.pen[line]), copy, self.painted[line] if self.painted else 0.0

    @cached_property
    def painted(self) -> list[float]:
        """(m,) mm since the last dip at the end of each line; empty without a brush that is dipped."""
        if not self.stops:
            return []
        points, starts = self.program.polylines
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        lengths = way[starts[1:] - 1] - way[starts[:-1]]
        since, result = 0.0, []
        for line, length in enumerate(lengths.tolist()):
            since = length + (0.0 if any(stop.kind == "dip" for stop in self.stops.get(line, [])) else since)
            result.append(since)
        return result

    def last(self) -> tuple[str, ...]:
        """After all units: the brush is washed."""
        return tuple(text for stop in self.stops.get(len(self.program), []) for text in self.visit(stop))

    def _commands(self, line: int, pen: int, stops: list[Visit], changed: bool) -> Iterator[str]:
        job_pen = self.program.pens[pen]
        if changed:
            yield from self.taken(job_pen)
        for stop in stops:
            yield from self.visit(stop)
        yield from self.line(line, job_pen)

    def _prompt(self, pen: int, copy: int, before: tuple[int, int]) -> str | None:
        wanted = self.program.pens[pen]
        asks = []
        if before[0] != copy:
            asks.append(f"copy {copy + 1} of {self.copies}: put in the next sheet")
        if before[1] != pen and not self.by_itself:
            asks.append(f"put in pen {wanted.name!r} (slot {wanted.slot})")
        return "; ".join(asks) or None

    @cached_property
    def stops(self) -> dict[int, list[Visit]]:
        """Stays at wells, by the line that they stand before."""
        return visits_by_line(self.program)

    def _refill(self, stops: dict[int, list[Visit]], line: int) -> list[Visit]:
        """The dip that the brush has been painting from, again: it has dried. How long it lasts stays as planned."""
        earlier = (stop for at in range(line, -1, -1) for stop in stops.get(at, []) if stop.kind == "dip")
        return [stop for stop in [next(earlier, None)] if stop]


def script(program: Program, copies: int = 1) -> Script:
    """The script of a program in the dialect of its profile."""
    from strokeplan.plotter.driving.scripts import EbbScript, GcodeScript, HpglScript

    kinds: dict[type, type[Script]] = {Gcode: GcodeScript, Hpgl: HpglScript, Ebb: EbbScript}
    return kinds[type(program.profile.dialect)](program, copies)
