"""A plan on the page: scaled, turned and mirrored about its middle, cut where asked; lengths in millimetres."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from strokeplan.curves import flatten_all
from strokeplan.errors import PlotError, StrokeplanWarning
from strokeplan.page import Page, Placement
from strokeplan.plotter.areas import lines_of, require_shapely
from strokeplan.plotter.cutting import rebuilt
from strokeplan.strokes import StrokePlan


@dataclass(frozen=True, slots=True)
class LayoutOptions:
    """Where a picture lies on its page.

    page     the sheet; None: that which the plan itself names (settings["page_mm"]).
    rotate   degrees clockwise, in quarters; the picture is turned before it is fitted.
    mirror   left and right exchanged (a print's plate, a drawing seen from behind).
    scale    of the true size; None: true size without a page of its own, else as large as fits.
    clip     cut at the edge of the canvas and at the page's margin.
    within   cut to this area of the page (a shapely polygon in mm, as `read_area` gives it).
    """

    page: Page | None = None
    rotate: int = 0
    mirror: bool = False
    scale: float | None = None
    clip: bool = False
    within: Any = None

    def __post_init__(self) -> None:
        if self.rotate not in (0, 90, 180, 270):
            raise PlotError(f"rotate {self.rotate} is no quarter; give 0, 90, 180 or 270 degrees")
        if self.scale is not None and not (isfinite(self.scale) and 1e-4 <= self.scale <= 1e4):
            raise PlotError(f"scale {self.scale:g} is outside 0.0001..10000")


FIT = LayoutOptions()


def lay_out(plan: StrokePlan, options: LayoutOptions, tolerance_mm: float) -> tuple[StrokePlan, Page]:
    """The plan in millimetres of its page, whose size its canvas is; and the page. Raises PlotError."""
    if not len(plan):
        raise PlotError("the plan has no stroke: there is nothing to draw")
    own = _true_size(plan)
    if own is None and options.page is None:
        raise PlotError("the plan has no size in millimetres; give a page, e.g. --page A4 --margin 15")
    moved = _turned(plan, options)
    page = options.page or _page_of(moved, own or (0.0, 0.0), options.rotate)
    place = _place(moved, page, own, options)
    laid = replace(
        moved,
        width=page.width_mm,
        height=page.height_mm,
        points=place.points(moved.points),
        widths=np.clip(moved.widths * place.scale, 1e-9, 1e6),
    )
    if options.clip:
        corner = (place.x, place.y, place.x + moved.width * place.scale, place.y + moved.height * place.scale)
        laid = clip(laid, _box(corner, page), tolerance_mm)
    if options.within is not None:
        laid = clip(laid, options.within, tolerance_mm)
    return laid, page


def _true_size(plan: StrokePlan) -> tuple[float, float] | None:
    """What the plan says of its size in mm, if it makes sense of it."""
    given = plan.settings.get("page_mm")
    if not (isinstance(given, list) and len(given) == 2 and all(isinstance(side, int | float) for side in given)):
        return None
    return float(given[0]), float(given[1])


def _turned(plan: StrokePlan, options: LayoutOptions) -> StrokePlan:
    """The plan turned and mirrored, on a canvas that begins at the origin again."""
    x, y = plan.points.T
    width, height = plan.width, plan.height
    if options.mirror:
        x = width - x
    for _ in range(options.rotate // 90):
        x, y = height - y, x
        width, height = height, width
    return replace(plan, width=width, height=height, points=np.column_stack([x, y]), angles=None)


def _page_of(plan: StrokePlan, size: tuple[float, float], rotate: int) -> Page:
    return Page(*(size[::-1] if rotate % 180 else size))


def _place(plan: StrokePlan, page: Page, own: tuple[float, float] | None, options: LayoutOptions) -> Placement:
    if options.scale is None and options.page is not None:
        return page.fit(plan.width, plan.height)
    if own is None:
        raise PlotError("a scale is of the true size, and the plan has none in millimetres; leave out --scale")
    true = (own[::-1] if options.rotate % 180 else own)[0] / plan.width
    scale = true * (1.0 if options.scale is None else options.scale)
    return Placement(scale, (page.width_mm - plan.width * scale) / 2, (page.height_mm - plan.height * scale) / 2)


def _box(canvas: tuple[float, float, float, float], page: Page) -> Any:
    margin = page.margin_mm
    shapely = require_shapely()
    room = shapely.box(margin, margin, page.width_mm - margin, page.height_mm - margin)
    return shapely.intersection(room, shapely.box(*canvas))


def clip(plan: StrokePlan, area: Any, tolerance: float) -> StrokePlan:
    """The plan within a shapely polygon: strokes that lie in it stay as they are, those that cross its border become
    polylines within `tolerance`, in pieces. Raises PlotError if nothing is left."""
    shapely = require_shapely()
    lines = lines_of(plan.points, plan.starts, tolerance)
    shapely.prepare(area)
    inside = shapely.covers(area, lines)
    crossing = np.flatnonzero(~inside & shapely.intersects(area, lines))
    parts, index = shapely.get_parts(shapely.line_merge(shapely.intersection(lines[crossing], area)), return_index=True)
    some = shapely.length(parts) > 0  # a stroke that only touches the border leaves a point
    vertices, piece = shapely.get_coordinates(parts[some], return_index=True)
    cut, _ = rebuilt(plan, inside, vertices, np.bincount(piece, minlength=int(some.sum())), crossing[index[some]])
    if not len(cut):
        raise PlotError("nothing of the drawing lies within the area it is cut to")
    return cut


def read_area(path: str | os.PathLike[str], tolerance_mm: float = 0.05) -> Any:
    """The area within the closed shapes of an SVG in its true size, from the page's upper left corner.

    Raises PlotError for a file without a size in mm, or without a closed shape.
    """
    from strokeplan.formats import load

    shapely = require_shapely()
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", StrokeplanWarning
        )  # that a filled shape is none of strokes: here it is asked for
        plan = load(path)
    own = _true_size(plan)
    if own is None:
        raise PlotError(f"{path}: has no size in millimetres; give its root a width and a height in mm")
    vertices, begins = flatten_all(plan.points * (own[0] / plan.width), plan.starts, tolerance_mm)
    rings = [vertices[a:b] for a, b in zip(begins[:-1].tolist(), begins[1:].tolist(), strict=True)]
    closed = [ring for ring in rings if len(ring) > 3 and np.hypot(*(ring[0] - ring[-1])) <= tolerance_mm]
    if not closed:
        raise PlotError(f"{path}: has no closed shape to cut to")
    return shapely.union_all([shapely.make_valid(shapely.polygons(ring)) for ring in closed])
