"""What a machine draws, in its own coordinates and order: lines between two moves of the pen, and its pens.

A plan is laid on its page, its strokes are put in order within each layer and pen (or stay as they are: wet paint),
strokes that meet become one line, closed by a straight bridge where a small gap is left. A Program holds these lines
as columns; dialects write them, `estimate` says how long they take. Everything is checked here, before a byte
is written: that the page fits, that every line stays within the travel, that there is a place for every pen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from strokeplan.biarcs import ArcChains, biarcs_all
from strokeplan.curves import flatten_all
from strokeplan.errors import PlotError
from strokeplan.grouping import gathered
from strokeplan.plotter.chaining import as_they_come, chained, drawn_rows, in_order
from strokeplan.plotter.layout import lay_out
from strokeplan.plotter.machine import PageTransform, page_transform
from strokeplan.plotter.motion import Limits
from strokeplan.plotter.options import PlotOptions
from strokeplan.plotter.painterly import pen_lines
from strokeplan.plotter.penning import JobPen, job_pens
from strokeplan.plotter.profile import PenSettings, Profile
from strokeplan.plotter.segments import segments
from strokeplan.plotter.tools import Brush, ZPen
from strokeplan.strokes import StrokePlan

__all__ = ["JobPen", "PlotOptions", "Program", "limits", "pen_moves_s", "program"]


@dataclass(frozen=True, eq=False)
class Program:
    """m lines in the order of drawing, in mm of the machine.

    points   (p, 2) chains of cubics, one line after the other; starts (m + 1,).
    radii    (q,) half the width in mm at each on-curve point.
    pen      (m,) index into pens; layer (m,) index into layers, names of the plan's.
    strokes  how many strokes of the plan the lines hold.
    title    what was drawn.
    """

    profile: Profile
    transform: PageTransform
    points: NDArray[np.float64]
    starts: NDArray[np.int64]
    radii: NDArray[np.float64]
    pen: NDArray[np.int64]
    layer: NDArray[np.int64]
    pens: tuple[JobPen, ...]
    layers: tuple[str, ...]
    strokes: int
    title: str

    def __len__(self) -> int:
        return len(self.pen)

    def line(self, j: int) -> NDArray[np.float64]:
        """The (3k + 1, 2) chain of line j."""
        return self.points[self.starts[j] : self.starts[j + 1]]

    @cached_property
    def polylines(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Vertices (v, 2) and starts (m + 1,): the lines within the profile's tolerance, of segments that take time."""
        shortest = self.feeds / 60_000 * self.profile.speeds.segment_ms
        return segments(self.points, self.starts, self.profile.tolerance_mm, shortest)

    @cached_property
    def arcs(self) -> ArcChains:
        """The lines as circular arcs within the profile's tolerance."""
        return biarcs_all(self.points, self.starts, self.profile.tolerance_mm)

    @property
    def feeds(self) -> NDArray[np.float64]:
        """(m,) mm/min of each line."""
        usual = self.profile.speeds.draw_mm_min
        return np.array([pen.settings.draw_mm_min or usual for pen in self.pens])[self.pen]

    @property
    def changes(self) -> list[int]:
        """The lines before which another pen is taken, the first one included."""
        return [0, *(np.flatnonzero(np.diff(self.pen)) + 1).tolist()]

    def only(self, pen: int) -> Program:
        """The lines of one pen."""
        kept = self.part(np.flatnonzero(self.pen == pen))
        title = f"{self.title}, {self.pens[pen].name}"
        return replace(kept, pen=np.zeros(len(kept), np.int64), pens=(self.pens[pen],), title=title)

    def part(self, keep: NDArray[np.int64]) -> Program:
        """The lines of some indices (k,), in that order."""
        knots = (self.starts + 2 * np.arange(len(self) + 1)) // 3
        return replace(
            self,
            points=self.points[gathered(self.starts, keep)],
            starts=np.concatenate([[0], np.cumsum(np.diff(self.starts)[keep])]),
            radii=self.radii[gathered(knots, keep)],
            pen=self.pen[keep],
            layer=self.layer[keep],
        )


def limits(profile: Profile) -> Limits:
    """What motion.plan needs of a profile: travels are as fast as the axes allow and the profile asks."""
    speeds = profile.speeds
    first, second = (min(rate, speeds.travel_mm_min) for rate in speeds.rate_mm_min)
    return Limits(
        rate=(first, second),
        acceleration=speeds.acceleration_mm_s2,
        junction_deviation=speeds.junction_deviation_mm,
        lookahead=speeds.lookahead_blocks,
        steps_mm=speeds.steps_mm,
        kinematics=profile.machine.kinematics,
    )


def program(plan: StrokePlan, profile: Profile, options: PlotOptions | None = None) -> Program:
    """The program that draws a plan with the machine of a profile. Raises PlotError, which names what does not fit."""
    options = options or PlotOptions()
    laid, page = lay_out(plan, options.layout, profile.tolerance_mm / 2)
    transform = page_transform(page, profile)
    lines, join = pen_lines(laid, profile, options)
    chains = transform.points(lines.points)
    _check_travel(chains, lines, transform, profile)
    pens, pen = job_pens(lines, profile, options)
    layer = np.repeat(np.arange(len(lines.layers)), [item.last - item.first for item in lines.layers])
    ends = np.stack([chains[lines.starts[:-1]], chains[lines.starts[1:] - 1]], axis=1)
    if isinstance(profile.tool, Brush):  # wet paint: as it comes, and no gap is painted over
        tour, begins = as_they_come(ends, np.stack([layer, pen], axis=1), join, 0.0)
    elif options.keep_order:
        tour, begins = as_they_come(ends, np.stack([layer, pen], axis=1), join, join)
    else:  # a pen draws all of its layers before the next one
        tour, begins = in_order(ends, np.stack([pen, layer], axis=1), join)
    points, starts = chained(chains, lines, tour, begins)
    firsts = tour.index[begins[:-1]]
    return Program(
        profile=profile,
        transform=transform,
        points=points,
        starts=starts,
        radii=lines.half_widths[drawn_rows(lines.first_knots, tour)],
        pen=pen[firsts],
        layer=layer[firsts],
        pens=pens,
        layers=tuple(item.name for item in lines.layers),
        strokes=len(laid),
        title=plan.source.name if plan.source else "drawing",
    )


def _check_travel(chains: NDArray[np.float64], plan: StrokePlan, transform: PageTransform, profile: Profile) -> None:
    """Raise PlotError for the stroke that goes furthest beyond the machine's travel."""
    if not np.any(transform.outside(chains)):  # a curve lies within its control points
        return
    vertices, begins = flatten_all(chains, plan.starts, profile.tolerance_mm / 2)
    beyond = transform.outside(vertices)
    worst = int(beyond.argmax())
    if beyond[worst] > 0:
        stroke = int(np.searchsorted(begins, worst, "right")) - 1
        layer = next(item.name for item in plan.layers if item.first <= stroke < item.last)
        x, y = vertices[worst]
        count = len(np.unique(np.searchsorted(begins, np.flatnonzero(beyond), "right")))
        raise PlotError(
            f"stroke {stroke + 1} (layer {layer!r}) goes to X{x:.2f} Y{y:.2f}, {beyond[worst]:.2f} mm beyond the "
            f"travel of {profile.name}, {transform.travel}; {count:,} of {len(plan):,} strokes leave it; "
            "take a wider --margin, a smaller --page, or --clip"
        )


def pen_moves_s(profile: Profile, pen: PenSettings | None = None) -> tuple[float, float]:
    """Seconds for which the machine stands while the pen goes down, and up; `pen` may have its own."""
    tool = profile.tool
    lower = tool.lower_s if pen is None or pen.lower_s is None else pen.lower_s
    rise = tool.raise_s if pen is None or pen.raise_s is None else pen.raise_s
    way = 0.0
    if isinstance(tool, ZPen):
        down = tool.down_mm if pen is None or pen.down_mm is None else pen.down_mm
        way = abs(tool.up_mm - down) / tool.rate_mm_min * 60
    if isinstance(tool, Brush):
        safe, touch, _ = tool.heights
        return lower + tool.way_s(safe, touch), rise + tool.way_s(touch, safe)
    return lower + way, rise + way
