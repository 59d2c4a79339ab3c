"""How long a program takes and how far it goes, by the planner of motion.py: before anything is drawn.

Known limits: what a person does at the machine is the profile's assumption (change.wait_s); visits to the wells are
counted at the speed of travel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strokeplan.plotter import motion
from strokeplan.plotter.brush import visit_s, visits
from strokeplan.plotter.program import Program, limits, pen_moves_s


@dataclass(frozen=True, slots=True)
class Estimate:
    """Figures of a program. Lengths in metres, times in seconds; `layers_s` by the name of the layer."""

    strokes: int
    lifts: int
    pen_changes: int
    refills: int
    drawn_m: float
    travelled_m: float
    total_s: float
    layers_s: tuple[tuple[str, float], ...]
    pens_s: tuple[tuple[str, float], ...]

    def rows(self) -> list[tuple[str, str]]:
        """The figures as (name, text), for people."""
        rows = [
            ("lines", f"{self.lifts:,} of {self.strokes:,} strokes, a lift of the pen after each"),
            ("drawn", f"{self.drawn_m:.2f} m, travelled {self.travelled_m:.2f} m"),
            ("time", f"{clock(self.total_s)} (estimated)"),
        ]
        if self.pen_changes:
            rows.append(("changes", f"{self.pen_changes} of the pen"))
        if self.refills:
            rows.append(("refills", f"{self.refills:,}"))
        if len(self.layers_s) > 1:
            rows += [(f"layer {name}"[:40], clock(seconds)) for name, seconds in self.layers_s]
        if len(self.pens_s) > 1:
            rows += [(f"pen {name}"[:40], clock(seconds)) for name, seconds in self.pens_s]
        return rows


def clock(seconds: float) -> str:
    """7384 → "2:03:04"."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def motion_of(program: Program) -> motion.Motion:
    """The motion of a program's lines, without what happens between them."""
    points, starts = program.polylines
    down_s, up_s = pen_moves_s(program.profile)
    return motion.plan(points, starts, limits(program.profile), program.feeds, pen=motion.Pen(down_s, up_s))


def estimate(program: Program) -> Estimate:
    """What the machine of the program's profile needs for it."""
    moved = motion_of(program)
    stops = visits(program)
    length = np.hypot(*(moved.end - moved.begin).T)
    changes = len(program.changes) - 1
    between = changes * program.profile.change.wait_s + sum(visit_s(program, stop) for stop in stops)
    return Estimate(
        strokes=program.strokes,
        lifts=len(program),
        pen_changes=changes,
        refills=sum(stop.kind == "dip" for stop in stops),
        drawn_m=float(length[moved.down].sum()) / 1000,
        travelled_m=float(length[~moved.down].sum()) / 1000,
        total_s=moved.total_s + between,
        layers_s=tuple((program.layers[k], seconds) for k, seconds in moved.by(program.layer).items()),
        pens_s=tuple((program.pens[k].name, seconds) for k, seconds in moved.by(program.pen).items()),
    )
