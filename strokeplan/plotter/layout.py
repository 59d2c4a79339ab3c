"""A plan on the page: scaled, turned and mirrored about its middle, cut where asked; lengths in millimetres."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import flatten_all
from strokeplan.errors import MissingExtraError, PlotError
from strokeplan.page import Page, Placement
from strokeplan.strokes import Layer, StrokePlan


@dataclass(frozen=True, slots=True)
class LayoutOptions:
    """Where a picture lies on its page.

    page     the sheet; None: that which the plan itself names (settings["page_mm"]).
    rotate   degrees clockwise, in quarters; the picture is turned before it is fitted.
    mirror   left and right exchanged (a print's plate, a drawing seen from behind).
    scale    of the true size; None: true size without a page of its own, else as large as fits.
    clip     cut at the edge of the canvas and at the page's margin.
    """

    page: Page | None = None
    rotate: int = 0
    mirror: bool = False
    scale: float | None = None
    clip: bool = False

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


def require_shapely() -> Any:
    """The shapely module, or a MissingExtraError that says how to get it."""
    try:
        import shapely
    except ImportError:
        raise MissingExtraError("clipping needs shapely: pip install 'strokeplan[plotter]'") from None
    return shapely


def clip(plan: StrokePlan, area: Any, tolerance: float) -> StrokePlan:
    """The plan within a shapely polygon: strokes that lie in it stay as they are, those that cross its border become
    polylines within `tolerance`, in pieces. Raises PlotError if nothing is left."""
    shapely = require_shapely()
    vertices, begins = flatten_all(plan.points, plan.starts, tolerance)
    lines = shapely.linestrings(vertices, indices=np.repeat(np.arange(len(plan)), np.diff(begins)))
    shapely.prepare(area)
    inside = shapely.covers(area, lines)
    crossing = np.flatnonzero(~inside & shapely.intersects(area, lines))
    cut = dict(zip(crossing.tolist(), shapely.intersection(lines[crossing], area), strict=True))
    pieces = [[plan.stroke(i)] if inside[i] else _chains(cut.get(i), shapely) for i in range(len(plan))]
    kept = np.array([len(chains) for chains in pieces], np.int64)
    if not kept.sum():
        raise PlotError("nothing of the drawing lies within the area it is cut to")
    return _rebuilt(plan, [chain for chains in pieces for chain in chains], kept)


def _chains(geometry: Any, shapely: Any) -> list[NDArray[np.float64]]:
    """The lines of a geometry as chains of straight cubics."""
    if geometry is None:
        return []
    parts = shapely.get_parts(shapely.line_merge(geometry) if geometry.geom_type == "MultiLineString" else geometry)
    lines = [shapely.get_coordinates(part) for part in parts if part.geom_type == "LineString"]
    return [straight(line) for line in lines if len(line) > 1]


def straight(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """A polyline (n, d) as a chain of cubics (3n − 2, d)."""
    chain = np.empty((3 * len(line) - 2, line.shape[1]))
    chain[::3] = line
    chain[1::3], chain[2::3] = (2 * line[:-1] + line[1:]) / 3, (line[:-1] + 2 * line[1:]) / 3
    return chain


def _rebuilt(plan: StrokePlan, chains: list[NDArray[np.float64]], kept: NDArray[np.int64]) -> StrokePlan:
    """The plan with kept[i] of the chains in the place of stroke i; what varied along a stroke does so no more."""
    source = np.repeat(np.arange(len(plan)), kept)
    ends = np.concatenate([[0], np.cumsum(kept)])
    layers = tuple(replace(layer, first=int(ends[layer.first]), last=int(ends[layer.last])) for layer in plan.layers)
    return replace(
        plan,
        points=np.concatenate(chains),
        starts=np.cumsum([0, *(len(chain) for chain in chains)], dtype=np.int64),
        widths=plan.widths[source],
        colors=plan.colors[source],
        layers=tuple(Layer(k.name, k.first, k.last, k.medium, k.cap) for k in layers),
        pressures=None,
        angles=None,
        pens=None if plan.pens is None else tuple(plan.pens[i] for i in source.tolist()),
    )
