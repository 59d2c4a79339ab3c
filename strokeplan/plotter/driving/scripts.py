"""Scripts: a program's units in G-code, HP-GL and the EiBotBoard's commands, as the exporters write them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strokeplan.errors import PlotError
from strokeplan.plotter.brush import Visit
from strokeplan.plotter.dialects import ebb, hpgl
from strokeplan.plotter.dialects.gcode import FLAVOURS, Writer, number
from strokeplan.plotter.driving.codec import Phrases
from strokeplan.plotter.driving.codecs.hpgl import RESERVE
from strokeplan.plotter.driving.units import Script
from strokeplan.plotter.profile import Ebb, Gcode, Hpgl
from strokeplan.plotter.program import JobPen, Program
from strokeplan.plotter.tools import EbbBrush, EbbServo, ZBrush, ZPen


class GcodeScript(Script):
    """Units in G-code."""

    def __init__(self, program: Program, copies: int = 1) -> None:
        super().__init__(program, copies)
        if not isinstance(program.profile.dialect, Gcode):
            raise TypeError("a profile of another dialect")
        self.dialect = program.profile.dialect
        self.writer = Writer(program, self.dialect)

    def phrases(self, pen: int) -> Phrases:
        used = self.program.pens[pen]
        tool = self.program.profile.tool
        up = tuple(self.writer.up(used))
        return Phrases(
            start=(*FLAVOURS[self.dialect.flavour].start, *self.dialect.prologue),
            up=up,
            down=tuple(self.writer.down(used)),
            lift=self._lift() if isinstance(tool, ZPen | ZBrush) else up,
            park=tuple(self.writer.park()),
            end=self.dialect.epilogue,
        )

    def line(self, j: int, pen: JobPen) -> Iterator[str]:
        return self.writer.line(j, pen)

    def travel(self, start: tuple[float, float], end: tuple[float, float]) -> Iterator[str]:
        yield self.writer.rapid(f"X{number(end[0])} Y{number(end[1])}")

    def visit(self, stop: Visit) -> Iterator[str]:
        return (text for text in self.writer.visit(stop) if not text.startswith(";"))

    def _lift(self) -> tuple[str, ...]:
        """Up by as much as lies between the pen's two heights, from wherever it is."""
        tool = self.program.profile.tool
        if isinstance(tool, ZPen):
            way = tool.up_mm - tool.down_mm
        elif isinstance(tool, ZBrush):
            way = tool.safe_mm - tool.press_mm
        else:
            return ()
        return ("G91", f"G1 Z{number(way)} F{number(tool.rate_mm_min)}", "G90")


class HpglScript(Script):
    """Units in HP-GL; the plotter fetches its pens itself."""

    def __init__(self, program: Program, copies: int = 1) -> None:
        super().__init__(program, copies)
        if not isinstance(program.profile.dialect, Hpgl):
            raise TypeError("a profile of another dialect")
        self.dialect = program.profile.dialect
        points, self.starts = program.polylines
        self.units_of = np.rint(points / self.dialect.unit_mm).astype(np.int64)
        if np.abs(self.units_of).max() > hpgl.MAX_UNIT:
            raise PlotError(f"a coordinate is above {hpgl.MAX_UNIT} units, the most HP-GL knows")
        room = min(self.dialect.buffer_bytes // 2, self.dialect.buffer_bytes - RESERVE - 2)
        self.room = max(room, 24)

    @property
    def by_itself(self) -> bool:
        return True

    def phrases(self, pen: int) -> Phrases:
        return Phrases(tuple(hpgl.start(self.program)), ("PU;",), ("PD;",), ("PU;",), end=("SP0;",))

    def taken(self, pen: JobPen) -> tuple[str, ...]:
        feed = pen.settings.draw_mm_min or self.program.profile.speeds.draw_mm_min
        return tuple(hpgl.taken(pen, feed, self.dialect))

    @property
    def unit_mm(self) -> float:
        return self.dialect.unit_mm

    def travel(self, start: tuple[float, float], end: tuple[float, float]) -> Iterator[str]:
        x, y = (round(at / self.dialect.unit_mm) for at in end)
        yield f"PU{x},{y};"

    def line(self, j: int, pen: JobPen) -> Iterator[str]:
        return hpgl.line_commands(self.units_of[self.starts[j] : self.starts[j + 1]].tolist(), self.room)


class EbbScript(Script):
    """Units in the EiBotBoard's slices; each line is planned when it is asked for, from where the one before ended."""

    def __init__(self, program: Program, copies: int = 1) -> None:
        super().__init__(program, copies)
        dialect, tool = program.profile.dialect, program.profile.tool
        if not (isinstance(dialect, Ebb) and isinstance(tool, EbbServo | EbbBrush)):
            raise TypeError("a profile of another dialect")
        self.tool = tool
        self.writer = ebb.Writer(program, dialect)

    def phrases(self, pen: int) -> Phrases:
        used = self.program.pens[pen]
        up, down = ebb.pen_commands(self.tool, used)
        return Phrases(tuple(ebb.start(self.tool, used)), (up,), (down,), (up,), end=("EM,0,0",))

    def taken(self, pen: JobPen) -> tuple[str, ...]:
        if isinstance(self.tool, EbbBrush):  # another paint
            return ()
        return tuple(text for text in ebb.start(self.tool, pen) if not text.startswith("EM"))

    def line(self, j: int, pen: JobPen) -> Iterator[str]:
        return self.writer.line(j, pen)

    def visit(self, stop: Visit) -> Iterator[str]:
        return self.writer.visit(stop)

    def travel(self, start: tuple[float, float], end: tuple[float, float]) -> Iterator[str]:
        self.writer.at = start
        return iter(self.writer.travel(end))

    def parked(self, pen: int) -> tuple[str, ...]:
        return tuple(self.writer.home())

    def last(self) -> tuple[str, ...]:
        """The brush is washed; then the way home."""
        return (*super().last(), *self.writer.home())
