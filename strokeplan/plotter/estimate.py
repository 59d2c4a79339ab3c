"""How long a program takes and how far it goes, by the planner of motion.py: before anything is drawn.

Known limits: what a person does at the machine is the profile's assumption (change.wait_s); a slow line to the machine
is not modelled.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from strokeplan.plotter.program import Program
from strokeplan.plotter.route import route_of

Item = TypeVar("Item")


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


def estimate(program: Program) -> Estimate:
    """What the machine of the program's profile needs for it, from its start to where it ends."""
    route = route_of(program)
    lines = route.line >= 0
    took = route.took_s[lines]
    moved = route.motion
    length = np.hypot(*(moved.end - moved.begin).T)
    return Estimate(
        strokes=program.strokes,
        lifts=len(program),
        pen_changes=len(program.changes) - 1,
        refills=sum(stop.kind == "dip" for stop in route.stops),
        drawn_m=float(length[moved.down].sum()) / 1000,
        travelled_m=float(length[~moved.down].sum()) / 1000,
        total_s=float(route.took_s.sum()),
        layers_s=tuple((name, float(s)) for name, s in _sums(program.layers, program.layer, took)),
        pens_s=tuple((pen.name, float(s)) for pen, s in _sums(program.pens, program.pen, took)),
    )


def _sums(
    items: tuple[Item, ...], member: NDArray[np.int64], took: NDArray[np.float64]
) -> Iterator[tuple[Item, float]]:
    """What the lines of each item take, of those that have any."""
    sums, counts = np.bincount(member, took, len(items)), np.bincount(member, minlength=len(items))
    return ((item, s) for item, s, count in zip(items, sums.tolist(), counts.tolist(), strict=True) if count)
