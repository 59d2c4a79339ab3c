"""How far a job is, for people: stroke, layer, pen, metres, and the time that is left by the motion planner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.plotter.estimate import clock
from strokeplan.plotter.program import Program
from strokeplan.plotter.route import route_of


@dataclass(frozen=True, eq=False)
class Timetable:
    """Of the lines of one copy: when each is done (m + 1,) s, and how far the pen has drawn by then (m + 1,) m."""

    program: Program
    copies: int
    done_s: NDArray[np.float64]
    drawn_m: NDArray[np.float64]

    @property
    def total_s(self) -> float:
        return float(self.done_s[-1]) * self.copies

    def left_s(self, done: int) -> float:
        """Seconds for what follows `done` units, by the planner."""
        copy, line = divmod(done, len(self.program))
        return self.total_s - copy * float(self.done_s[-1]) - float(self.done_s[line])

    def metres(self, done: int) -> float:
        """What the pen has drawn in `done` units."""
        copy, line = divmod(done, len(self.program))
        return copy * float(self.drawn_m[-1]) + float(self.drawn_m[line])

    def shown(self, done: int, *, paused: bool = False) -> dict[str, Any]:
        """What a progress bar shows."""
        units = len(self.program) * self.copies
        line = min(done, units - 1) % len(self.program)
        pen = self.program.pens[self.program.pen[line]].name
        layer = self.program.layers[self.program.layer[line]]
        left = "paused" if paused else f"{clock(self.left_s(done))} left"
        return {
            "description": f"stroke {done:,} of {units:,}",
            "completed": 1.0 if not self.total_s else 1 - self.left_s(done) / self.total_s,
            "figures": f"layer {layer}, {pen}, {self.metres(done):.1f} m, {left}",
        }


def timetable(program: Program, copies: int = 1) -> Timetable:
    """The timetable of a program: its motion is planned once, and only sums are kept."""
    route = route_of(program)
    lines, moved = route.line >= 0, route.motion
    length = np.hypot(*(moved.end - moved.begin).T) * moved.down
    drawn = np.bincount(moved.stroke, length, len(route.line))[lines] / 1000
    done = np.cumsum(route.took_s)[lines]  # what comes before a line (wells, a change of pen) is part of it
    return Timetable(program, copies, np.concatenate([[0.0], done]), np.concatenate([[0.0], np.cumsum(drawn)]))
