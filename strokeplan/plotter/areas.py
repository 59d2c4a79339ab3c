"""The areas that strokes paint, as shapely geometries (extra `plotter`), all at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import flatten_all
from strokeplan.errors import MissingExtraError
from strokeplan.outlines import outline_strokes
from strokeplan.strokes import StrokePlan


def require_shapely() -> Any:
    """The shapely module, or a MissingExtraError that says how to get it."""
    try:
        import shapely
    except ImportError:
        raise MissingExtraError("clipping and bundles need shapely: pip install 'strokeplan[plotter]'") from None
    return shapely


def lines_of(points: NDArray[np.float64], starts: NDArray[np.int64], tolerance: float) -> NDArray[Any]:
    """(n,) LineStrings along chains of cubics, no further than `tolerance` from them."""
    vertices, begins = flatten_all(points, starts, tolerance)
    index = np.repeat(np.arange(len(starts) - 1), np.diff(begins))
    lines: NDArray[Any] = require_shapely().linestrings(vertices, indices=index)
    return lines


def areas_of(plan: StrokePlan, tolerance: float) -> NDArray[Any]:
    """(n,) what the strokes of a plan paint, their borders no further than `tolerance` from the true ones."""
    shapely = require_shapely()
    made: NDArray[Any] = np.empty(len(plan), object)
    plain = plan.round_caps & ~plan.has_pressure
    swept = lines_of(plan.points, plan.starts, tolerance / 2)
    made[plain] = shapely.buffer(swept[plain], plan.widths[plain] / 2, quad_segs=quad_segs(plan.widths, tolerance / 2))
    if not plain.all():
        outlined = outline_strokes(plan.points, plan.starts, plan.half_widths, ~plain, plan.round_caps, tolerance / 2)
        rings = shapely.get_coordinates(lines_of(*outlined, tolerance / 2)[~plain], return_index=True)
        # A polygon that overlaps itself is what the nonzero rule fills: all its loops turn the same way.
        made[~plain] = shapely.buffer(shapely.polygons(shapely.linearrings(rings[0], indices=rings[1])), 0)
    return made


def quad_segs(widths: NDArray[np.float64], tolerance: float) -> int:
    """Into how many a quarter of the widest one's round end is cut so as to stay within the tolerance."""
    radius = max(float(widths.max(initial=0.0)) / 2, tolerance)
    return int(np.clip(np.ceil(np.pi / 4 / np.arccos(1 - min(tolerance / radius, 0.5))), 2, 64))
