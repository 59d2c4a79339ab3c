"""What a vector file draws: a plan in the unit of its document, strokes as curves or as filled outlines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strokeplan.formats.options import ExportOptions
from strokeplan.outlines import outline_strokes
from strokeplan.page import MM_PER_INCH, PX_PER_INCH, Placement
from strokeplan.strokes import StrokePlan, unit_mm


@dataclass(frozen=True, eq=False)
class Layout:
    """A plan on its document; lengths in the document's unit.

    width, height  of the document.
    canvas         x, y, width and height of the plan's canvas on it.
    points         (p, 2), widths (n,): the plan's, moved and scaled.
    mm             whether the unit is the millimetre; else the pixel of 1/96 inch.
    """

    plan: StrokePlan
    width: float
    height: float
    canvas: tuple[float, float, float, float]
    scale: float
    points: NDArray[np.float64]
    widths: NDArray[np.float64]
    mm: bool

    def outlined(
        self, tolerance: float, *, every: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
        """Points and starts with a closed outline in the place of strokes with pressure, or of `every` stroke; and
        which strokes these are."""
        plan = self.plan
        filled = np.ones(len(plan), np.bool_) if every else plan.has_pressure
        if not filled.any():
            return self.points, plan.starts, filled
        half = plan.half_widths * self.scale
        points, starts = outline_strokes(self.points, plan.starts, half, filled, plan.round_caps, tolerance)
        return points, starts, filled


def lay_out(plan: StrokePlan, options: ExportOptions) -> Layout:
    """A plan where the options put it: on a page, or as large as its canvas. Raises InputError."""
    physical = unit_mm(plan) if options.page is None and options.units != "px" else None
    mm = options.page is not None or options.units == "mm" or physical is not None
    scale = physical or (MM_PER_INCH / PX_PER_INCH if mm else 1.0)
    place, width, height = Placement(scale), plan.width * scale, plan.height * scale
    if options.page is not None:
        place = options.page.fit(plan.width, plan.height)
        width, height = options.page.width_mm, options.page.height_mm
    return Layout(
        plan=plan,
        width=width,
        height=height,
        canvas=(place.x, place.y, plan.width * place.scale, plan.height * place.scale),
        scale=place.scale,
        points=place.points(plan.points),
        widths=plan.widths * place.scale,
        mm=mm,
    )
