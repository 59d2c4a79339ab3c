"""Commands of the EiBotBoard (AxiDraw and its kin): the host plans the motion, the board turns two motors.

The planned motion is cut into slices of time (ebb_slices.py), each a command. A pen goes up and down by SP, or by S2 on
a pin of its own. A brush has heights: S2 between two slices, for whole steps of `STEP_PERCENT` only, as each takes a
place of the board's FIFO. Before and after a line the motors stand while it sweeps.

Lines that begin with # are for people (the header): whoever sends the file leaves them out. The file begins and ends
at the home corner, where motors were switched on.

Source: EiBotBoard command set (evil-mad.github.io/EggBot/ebb.html), commands EM, S2, SC, SM, SP, XM.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import PlotError
from strokeplan.plotter.brush import Visit, heights, visits_by_line
from strokeplan.plotter.dialects.ebb_slices import Slices, all_slices, slices, written
from strokeplan.plotter.profile import Ebb
from strokeplan.plotter.program import JobPen, Program
from strokeplan.plotter.tools import EbbBrush, EbbServo

SIXTEENTH = 1
"""EM's number for 16 microsteps."""
STEP_PERCENT = 1.0
"""A change of a brush's height along a line that can be seen."""


def encode(program: Program, header: list[str]) -> bytes:
    """The file of a program. Raises PlotError for more than one pen: the board cannot wait for a change of it."""
    dialect, tool = program.profile.dialect, program.profile.tool
    if not (isinstance(dialect, Ebb) and isinstance(tool, EbbServo | EbbBrush)):
        raise TypeError("a profile of another dialect")
    if len(program.pens) > 1 and isinstance(tool, EbbServo):
        names = ", ".join(pen.name for pen in program.pens[:10])
        raise PlotError(f"an .ebb file cannot wait for a change of pen ({names}); write one a pen: --file-per-pen")
    lines = [f"# {_plain(text)}" for text in header]
    body = _drawn(program, dialect, tool) if isinstance(tool, EbbServo) else Writer(program, dialect).body()
    up, _ = pen_commands(tool, program.pens[0])
    return ("\r".join([*lines, *start(tool, program.pens[0]), up, *body, "EM,0,0"]) + "\r").encode("ascii")


def _plain(text: str) -> str:
    return "".join(c if " " <= c <= "~" else "x" if c == "×" else "?" for c in text)[:200]


def _drawn(program: Program, dialect: Ebb, tool: EbbServo) -> Iterator[str]:
    """All lines of a pen, planned at once; what Writer writes one by one."""
    up, lower = pen_commands(tool, program.pens[0])
    lines = range(len(program) + 1)
    stroke, drawn, moves, _ = all_slices(program, dialect)
    commands = written(moves, program.profile)
    begins = np.searchsorted(stroke, lines).tolist()
    downs = (begins + np.bincount(stroke[~drawn], minlength=len(lines))).tolist()
    for j in lines[:-1]:
        yield from commands[begins[j] : downs[j]]
        yield lower
        yield from commands[downs[j] : begins[j + 1]]  # none for a dot
        yield up
    yield from commands[begins[-1] :]


class Writer:
    """Writes lines one by one, each planned when it is asked for, from where the one before ended."""

    def __init__(self, program: Program, dialect: Ebb) -> None:
        self.program, self.dialect = program, dialect
        self.tool = program.profile.tool
        self.at = (0.0, 0.0)

    def body(self) -> Iterator[str]:
        """Everything of a brush between the start and the end."""
        stops = visits_by_line(self.program)
        for j in range(len(self.program) + 1):
            for stop in stops.get(j, ()):
                yield f"# {stop.kind} {_plain(stop.well.name or '')}".rstrip()
                yield from self.visit(stop)
            if j < len(self.program):
                yield from self.line(j, self.program.pens[self.program.pen[j]])
        yield from self.home()

    def line(self, j: int, pen: JobPen) -> Iterator[str]:
        """One line: there, down, along, up."""
        points, starts = self.program.polylines
        made = self._planned(points[starts[j] : starts[j + 1]], self.feeds[j])
        commands = written(made.moves, self.program.profile)
        first = int(np.count_nonzero(~made.drawn))
        yield from commands[:first]
        if isinstance(self.tool, EbbBrush):
            places = np.vstack([points[starts[j]], made.ends[first:]])
            yield from self._painted(self.tool, j, commands[first:], places)
        elif isinstance(self.tool, EbbServo):
            up, down = pen_commands(self.tool, pen)
            yield down
            yield from commands[first:]
            yield up

    def _painted(self, tool: EbbBrush, j: int, commands: list[str], places: NDArray[np.float64]) -> Iterator[str]:
        """Slices with the heights of the brush between them; `places` (s + 1, 2) are where they begin and end."""
        points, starts = self.brush
        profile = points[starts[j] : starts[j + 1]]
        safe, touch, most = tool.heights
        z = np.interp(_parts(places), _parts(profile[:, :2]), profile[:, 2])
        steps = np.rint(((z[1:] + z[:-1]) / 2 - touch) / STEP_PERCENT)
        level = np.clip(touch + steps * STEP_PERCENT, min(touch, most), max(touch, most)).tolist()
        dot = profile[np.abs(profile[:, 2] - safe).argmax(), 2]
        now = float(z[0] if commands else dot)
        yield sweep(tool, safe, now)
        for command, wanted in zip(commands, level, strict=True):
            if wanted != now:
                yield sweep(tool, now, wanted, stand=False)
                now = wanted
            yield command
        yield sweep(tool, now, safe)

    def visit(self, stop: Visit) -> Iterator[str]:
        """Down into a well, to and fro, and up again."""
        tool, well = self.tool, stop.well
        if not isinstance(tool, EbbBrush):
            return
        yield from self.travel(well.at_mm)
        yield sweep(tool, tool.safe_percent, well.bottom)
        if well.stirs:
            stirred = self._planned(np.array([well.at_mm, *well.stirs]), self.program.profile.speeds.draw_mm_min)
            yield from written(stirred.moves, self.program.profile)
        yield sweep(tool, well.bottom, tool.safe_percent)

    def travel(self, there: tuple[float, float]) -> list[str]:
        """To a place, pen up."""
        profile = self.program.profile
        return written(self._planned(np.array([there]), profile.speeds.travel_mm_min).moves, profile)

    def home(self) -> list[str]:
        """To where the motors were switched on."""
        return self.travel((0.0, 0.0))

    @cached_property
    def feeds(self) -> list[float]:
        return self.program.feeds.tolist()  # type: ignore[no-any-return]

    @cached_property
    def brush(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """The lines with the height of the brush."""
        if not isinstance(self.tool, EbbBrush):
            raise TypeError("no brush")
        return heights(self.program, self.tool)

    def _planned(self, line: NDArray[np.float64], feed: float) -> Slices:
        starts, profile = np.array([0, len(line)]), self.program.profile
        made = slices(line, starts, np.array([feed]), profile, self.dialect, self.at)
        x, y = line[-1].tolist()
        self.at = x, y
        return made


def _parts(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """(v,) the part of a line's way that is made at each vertex."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    return way / way[-1] if way[-1] > 0 else way


def start(tool: EbbServo | EbbBrush, pen: JobPen) -> Iterator[str]:
    """Motors on, and where the servo has the pen."""
    up, down = _ends(tool, pen)
    yield f"EM,{SIXTEENTH},{SIXTEENTH}"
    yield f"SC,4,{tool.pulse(up)}"
    yield f"SC,5,{tool.pulse(down)}"
    yield f"SC,11,{tool.raise_rate}"
    yield f"SC,12,{tool.lower_rate}"


def _ends(tool: EbbServo | EbbBrush, pen: JobPen) -> tuple[float, float]:
    """Per cent that are up, and down."""
    if isinstance(tool, EbbBrush):
        return tool.safe_percent, tool.touch_percent
    own = pen.settings.down_percent
    return tool.up_percent, tool.down_percent if own is None else own


def sweep(tool: EbbBrush, start: float, end: float, *, stand: bool = True) -> str:
    """From one height to another, in per cent; the motors wait for it, or go on."""
    rate, settle = (tool.lower_rate, tool.lower_s) if tool.lowers(start, end) else (tool.raise_rate, tool.raise_s)
    wait_s = tool.way_s(start, end) + settle if stand else 0.0
    return f"S2,{tool.pulse(end)},{tool.servo_pin},{rate},{round(wait_s * 1000)}"


def pen_commands(tool: EbbServo | EbbBrush, pen: JobPen) -> tuple[str, str]:
    """Up, from wherever it is, and down."""
    up, down = _ends(tool, pen)
    if isinstance(tool, EbbBrush):
        return sweep(tool, tool.deepest, up), sweep(tool, up, down)
    own = pen.settings
    lower_s = tool.lower_s if own.lower_s is None else own.lower_s
    raise_s = tool.raise_s if own.raise_s is None else own.raise_s
    if tool.pin is None:
        return f"SP,1,{round(raise_s * 1000)}", f"SP,0,{round(lower_s * 1000)}"
    return (
        f"S2,{tool.pulse(up)},{tool.pin},{tool.raise_rate},{round(raise_s * 1000)}",
        f"S2,{tool.pulse(down)},{tool.pin},{tool.lower_rate},{round(lower_s * 1000)}",
    )
