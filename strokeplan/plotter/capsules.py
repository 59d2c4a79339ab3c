"""The areas of strokes as capsules, and how much of straight segments lies within them.

A stroke is what a disc sweeps whose radius grows evenly along each edge of the flattened curve: the hull of the two
discs at its ends, a capsule. With butt caps the first and the last one are cut off across the stroke. A capsule is
convex, so that it holds one stretch of a segment, whose ends are roots of quadratics and crossings of lines: nothing is
approximated. A grid finds the capsules that can matter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import flatten_all
from strokeplan.jit import kernel, leaf
from strokeplan.plotter.segments import with_values
from strokeplan.strokes import StrokePlan

CELLS = 256
"""Cells of the grid along the longer side of what the strokes cover."""


class Capsules(NamedTuple):
    """c capsules in the order of painting, as columns.

    ends      (c, 2, 2) centres of the two discs, radii (c, 2).
    flat      (c, 2) whether a capsule is cut off across at its first and second end.
    owner     (c,) the stroke that each is of.
    """

    ends: NDArray[np.float64]
    radii: NDArray[np.float64]
    flat: NDArray[np.bool_]
    owner: NDArray[np.int64]


class Grid(NamedTuple):
    """Which capsules reach into each square cell: item[first[cell]:first[cell + 1]], in the order of painting."""

    left: float
    top: float
    side: float
    columns: int
    rows: int
    first: NDArray[np.int64]
    item: NDArray[np.int64]


def capsules_of(plan: StrokePlan, of: NDArray[np.bool_], grown: float, tolerance: float) -> Capsules:
    """The capsules of the strokes `of` (n,) of a plan, radii larger by `grown`; curves within `tolerance`."""
    radii = np.maximum(plan.half_widths + grown, 0.0)
    vertices, begins = flatten_all(with_values(plan.points, plan.starts, radii), plan.starts, tolerance)
    first = np.ones(len(vertices), np.bool_)
    first[begins[1:] - 1] = False  # the last vertex of a stroke begins no edge
    a = np.flatnonzero(first)
    owner = np.repeat(np.arange(len(plan)), np.diff(begins))[a]
    butt = ~plan.round_caps[owner]
    edges = np.stack([vertices[a], vertices[a + 1]], axis=1)
    flat = np.stack([butt & np.isin(a, begins[:-1]), butt & np.isin(a + 1, begins[1:] - 1)], axis=1)
    keep = of[owner]
    return Capsules(np.ascontiguousarray(edges[keep, :, :2]), edges[keep, :, 2].copy(), flat[keep], owner[keep])


def grid_of(capsules: Capsules) -> Grid:
    """The grid of capsules, at least one."""
    low = (capsules.ends - capsules.radii[:, :, None]).min(axis=1)
    high = (capsules.ends + capsules.radii[:, :, None]).max(axis=1)
    left, top = low.min(axis=0).tolist()
    right, bottom = high.max(axis=0).tolist()
    side = max(right - left, bottom - top, 1e-9) / CELLS
    columns, rows = int((right - left) / side) + 1, int((bottom - top) / side) + 1
    spans = np.empty((len(low), 4), np.int64)
    spans[:, :2] = np.clip((low - (left, top)) / side, 0, (columns - 1, rows - 1))
    spans[:, 2:] = np.clip((high - (left, top)) / side, 0, (columns - 1, rows - 1))
    return Grid(left, top, side, columns, rows, *_registered(spans, columns, rows))


@kernel
def _registered(spans: NDArray[np.int64], columns: int, rows: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where the list of each cell begins, and the lists: a span is the first and last column and row of a capsule."""
    first = np.zeros(columns * rows + 1, np.int64)
    for k in range(len(spans)):
        for row in range(spans[k, 1], spans[k, 3] + 1):
            for column in range(spans[k, 0], spans[k, 2] + 1):
                first[row * columns + column + 1] += 1
    first = np.cumsum(first)
    room = first.copy()
    item = np.empty(first[-1], np.int64)
    for k in range(len(spans)):
        for row in range(spans[k, 1], spans[k, 3] + 1):
            for column in range(spans[k, 0], spans[k, 2] + 1):
                cell = row * columns + column
                item[room[cell]] = k
                room[cell] += 1
    return first, item


@leaf
def stretch(px: float, py: float, dx: float, dy: float, capsules: Capsules, k: int) -> tuple[float, float]:
    """From where to where of p + t · d, t in 0..1, lies within capsule k; (1, 0) if nothing does."""
    ax, ay, bx, by = capsules.ends[k, 0, 0], capsules.ends[k, 0, 1], capsules.ends[k, 1, 0], capsules.ends[k, 1, 1]
    ra, rb = capsules.radii[k, 0], capsules.radii[k, 1]
    ux, uy = bx - ax, by - ay
    length = np.sqrt(ux * ux + uy * uy)
    flat_a, flat_b = capsules.flat[k, 0], capsules.flat[k, 1]
    if length == 0.0 and (flat_a or flat_b):
        return 1.0, 0.0
    low, high = _in_disc(px - ax, py - ay, dx, dy, ra)
    low_b, high_b = _in_disc(px - bx, py - by, dx, dy, rb)
    low, high = min(low, low_b), max(high, high_b)
    if length > abs(ra - rb):
        ux, uy, lean = ux / length, uy / length, (ra - rb) / length
        rise = np.sqrt(1.0 - lean * lean)
        s, t = 0.0, 1.0
        for side in (-1.0, 1.0):  # beneath both tangents
            nx, ny = lean * ux - side * rise * uy, lean * uy + side * rise * ux
            s, t = _below(s, t, (px - ax) * nx + (py - ay) * ny - ra, dx * nx + dy * ny)
        along = dx * ux + dy * uy  # and between the points where these touch the discs
        s, t = _below(s, t, ra * lean - (px - ax) * ux - (py - ay) * uy, -along)
        s, t = _below(s, t, (px - bx) * ux + (py - by) * uy - rb * lean, along)
        if s <= t:
            low, high = min(low, s), max(high, t)
        if flat_a:
            low, high = _below(low, high, -(px - ax) * ux - (py - ay) * uy, -along)
        if flat_b:
            low, high = _below(low, high, (px - bx) * ux + (py - by) * uy, along)
    return low, high


@leaf
def _in_disc(px: float, py: float, dx: float, dy: float, radius: float) -> tuple[float, float]:
    """From where to where of p + t · d, t in 0..1, is no further than `radius` from the origin; (1, 0) if nothing."""
    a, b, c = dx * dx + dy * dy, px * dx + py * dy, px * px + py * py - radius * radius
    if a == 0.0:
        return (0.0, 1.0) if c <= 0.0 else (1.0, 0.0)
    inside = b * b - a * c
    if inside < 0.0:
        return 1.0, 0.0
    root = np.sqrt(inside)
    low, high = max((-b - root) / a, 0.0), min((-b + root) / a, 1.0)
    return (low, high) if low <= high else (1.0, 0.0)


@leaf
def _below(low: float, high: float, at: float, slope: float) -> tuple[float, float]:
    """The part of low..high in which at + slope · t is not above 0; (1, 0) if none is."""
    if slope == 0.0:
        return (low, high) if at <= 0.0 else (1.0, 0.0)
    t = -at / slope
    if slope > 0.0:
        high = min(high, t)
    else:
        low = max(low, t)
    return (low, high) if low <= high else (1.0, 0.0)
