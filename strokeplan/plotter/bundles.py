"""Strokes wider than the pen, as bundles of passes that ink their area: rings within rings, like a racetrack.

The outermost ring lies half a pen within the border of the stroke's area, the next ones no further apart than the
pen is wide. Along the stroke they are its parallel curves, at both its ends they close; where it overlaps itself, as
strokes that curl up do, they go round the whole instead of along every turn. A stroke that takes an odd number of lines
beside each other has its middle as the innermost. One hardly wider than the pen is its middle alone.

Rings begin at their tips, where the stroke begins: less than a pen from each other, so that the pen need not be lifted
between them.

Known limits: rings are polylines within the tolerance; between two passes some hairs of paper may stay bare.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.grouping import reordered
from strokeplan.plotter.areas import areas_of, quad_segs, require_shapely
from strokeplan.plotter.cutting import rebuilt, regained
from strokeplan.strokes import StrokePlan

PITCH = 0.9
"""Distance between passes at most, in widths of the pen: a tenth of overlap, so that no paper shows between them."""
SLACK = 0.15
"""Of a pass that is not worth drawing."""
LEAST = 0.1
"""Of the pen's width: a bare place that is not twice as wide stays bare."""
CURLED = 0.9
"""A stroke that paints less than this part of its length times its width overlaps itself."""


def bundled(plan: StrokePlan, pen: NDArray[np.float64], tolerance: float) -> tuple[StrokePlan, NDArray[np.int64]]:
    """The passes that ink every stroke with a pen of width `pen` (n,), in the unit of the plan, in order of strokes.

    Returns them as strokes as wide as their pen and without pressure, and (m,) the stroke that each is of.
    """
    shapely = require_shapely()
    across = 1 + np.ceil(np.maximum((plan.widths - pen) / (PITCH * pen) - SLACK, 0.0)).astype(np.int64)
    wide = np.flatnonzero(across > 1)
    wider = replace(reordered(plan, wide), layers=regained(plan.layers, wide))
    areas = areas_of(wider, tolerance / 2) if len(wide) else np.empty(0, object)
    even = _curled(plan, wide, shapely.area(areas)) | plan.has_pressure[wide]
    across[wide] += even & (across[wide] % 2 == 1)
    pitch = (plan.widths - pen)[wide] / (across[wide] - 1)
    rounds = np.where(even, np.iinfo(np.int64).max, across[wide] // 2)
    rings, of = _rings(areas, pen[wide] / 2, pitch, rounds, tolerance)
    rings, of = _with_gaps(areas, rings, of, pen[wide], even, tolerance)
    middle = across % 2 == 1
    middle[wide] |= plan.has_pressure[wide] | (np.bincount(of, minlength=len(wide)) == 0)
    vertices, counts = _seated(rings, _tips(plan)[wide][of])
    passes = replace(plan, pressures=None, angles=None, widths=pen)
    return rebuilt(passes, middle, vertices, counts, wide[of])


def _curled(plan: StrokePlan, wide: NDArray[np.int64], area: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the strokes `wide` overlap themselves, given what they paint."""
    step = np.concatenate([np.hypot(*np.diff(plan.points, axis=0).T), [0.0]])
    step[plan.starts[1:] - 1] = 0.0
    length = np.add.reduceat(step, plan.starts[:-1])[wide]  # of the control polygon: a little more than the curve's
    return area < CURLED * plan.widths[wide] * length


def _rings(
    areas: NDArray[Any],
    inset: NDArray[np.float64],
    pitch: NDArray[np.float64],
    rounds: NDArray[np.int64],
    tolerance: float,
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """LinearRings within areas (a,): the first `inset` from the border, at most `rounds` further ones every `pitch`;
    and the area that each is in, rising. What is left in the middle gets a ring at half the pitch."""
    shapely = require_shapely()
    segs = quad_segs(2 * pitch, tolerance)
    found, owners, level = [], [], 1
    parts, of = _parts(shapely.buffer(areas, -inset, quad_segs=segs), np.arange(len(areas)))
    while len(parts):
        parts = shapely.simplify(
            parts, tolerance / 4, preserve_topology=False
        )  # else every round doubles the vertices of hollow arcs
        found.append(parts)
        owners.append(of)
        going = level < rounds[of]
        parts, of, level = parts[going], of[going], level + 1
        inner = shapely.buffer(parts, -pitch[of], quad_segs=segs)
        last = shapely.is_empty(inner)
        half, half_of = _parts(shapely.buffer(parts[last], -pitch[of[last]] / 2, quad_segs=segs), of[last])
        found.append(half)
        owners.append(half_of)
        parts, of = _parts(inner, of)
    if not found:
        return np.empty(0, object), np.empty(0, np.int64)
    polygons, owner = _parts(
        shapely.simplify(np.concatenate(found), tolerance / 2, preserve_topology=False), np.concatenate(owners)
    )
    rings, index = shapely.get_rings(polygons, return_index=True)
    order = np.argsort(owner[index], kind="stable")
    return rings[order], owner[index[order]]


def _with_gaps(
    areas: NDArray[Any],
    rings: NDArray[Any],
    of: NDArray[np.int64],
    pen: NDArray[np.float64],
    gaping: NDArray[np.bool_],
    tolerance: float,
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """The rings, and more around what they leave bare of the areas that are `gaping` (a,): where one ring's inside is
    narrow, as between turns that overlap, none lies within it."""
    shapely = require_shapely()
    own = np.flatnonzero(gaping[of])
    some = np.unique(of[own])
    if not len(some):
        return rings, of
    drawn = shapely.multilinestrings(rings[own], indices=np.searchsorted(some, of[own]))
    ink = shapely.buffer(drawn, pen[some] / 2, quad_segs=quad_segs(pen, tolerance))
    bare = shapely.buffer(shapely.difference(areas[some], ink), -LEAST * pen[some], quad_segs=2)
    gaps, index = _parts(shapely.simplify(bare, tolerance, preserve_topology=False), some)
    both = np.concatenate([rings, shapely.get_exterior_ring(gaps)])
    owner = np.concatenate([of, index])
    order = np.argsort(owner, kind="stable")
    return both[order], owner[order]


def _parts(areas: NDArray[Any], of: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Single polygons that are not empty, and what each is `of`."""
    shapely = require_shapely()
    parts, index = shapely.get_parts(areas, return_index=True)
    some = ~shapely.is_empty(parts)
    return parts[some], of[index[some]]


def _tips(plan: StrokePlan) -> NDArray[np.float64]:
    """(n, 2) a point beyond the beginning of each stroke, in line with it: rings are nearest to it at their tips."""
    first = plan.starts[:-1]
    ahead = plan.points[first + 3] - plan.points[first]
    for handle in (2, 1):
        way = plan.points[first + handle] - plan.points[first]
        ahead = np.where(np.any(way != 0, axis=1, keepdims=True), way, ahead)
    length = np.hypot(*ahead.T)[:, None]
    unit = np.divide(ahead, length, out=np.zeros_like(ahead), where=length > 0)
    return np.asarray(plan.points[first] - unit * plan.widths[:, None])


def _seated(rings: NDArray[Any], near: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and counts of rings, each beginning and ending at its vertex nearest to its point of `near` (r, 2)."""
    if not len(rings):
        return np.empty((0, 2)), np.empty(0, np.int64)
    vertices, ring = require_shapely().get_coordinates(rings, return_index=True)
    counts = np.bincount(ring, minlength=len(rings))
    firsts = np.cumsum(counts) - counts
    away = np.hypot(*(vertices - near[ring]).T)
    nearest = np.lexsort((away, ring))[firsts] - firsts
    own = np.arange(len(vertices)) - firsts[ring]
    turned = (own + nearest[ring]) % (counts[ring] - 1)  # the last vertex of a ring is its first
    return vertices[firsts[ring] + turned], counts
