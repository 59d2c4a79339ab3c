"""What ink covers: the part of every pixel of a sheet that strokes of a pen lie on.

A stroke is a polyline drawn with a round pen; a pixel's coverage is that of an edge at the distance of its centre
(½ + (r − d) / pixel, clipped), the maximum over the stroke's edges, so that a stroke does not darken itself.
Strokes that are given together lie beside each other, as the lines of a layer do: of a pixel on the border of two
they cover the sum. What lies there already they cross at random: together they cover 1 − (1 − a) (1 − b)
(Demichel 1924).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import kernel, leaf
from strokeplan.linework import Lines


def cover(lines: Lines, width_mm: float, pixel_mm: float, coverage: NDArray[np.float32], *, every: int = 1) -> None:
    """Add lines of a pen, none across another, to `coverage` (rows, columns) of pixels of `pixel_mm` from (0, 0) on.

    Of lines whose points lie close every so many-th point will do.
    """
    if len(lines.points):
        together = np.zeros_like(coverage)
        scratch = np.zeros_like(coverage)
        _cover(lines.points / pixel_mm, lines.starts, every, 0.5 * width_mm / pixel_mm, scratch, together)
        coverage += (1 - coverage) * together


@kernel
def _cover(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    every: int,
    radius: float,
    stroke: NDArray[np.float32],
    coverage: NDArray[np.float32],
) -> None:
    for line in range(len(starts) - 1):
        first, last = starts[line], starts[line + 1]
        for k in range(first, last, every):
            _stamp_edge(points, k, min(k + every, last - 1), radius, stroke)
        # Edge by edge again: the box of a long stroke is mostly empty.
        for k in range(first, last, every):
            _commit_edge(points, k, min(k + every, last - 1), radius, stroke, coverage)


@leaf
def _box(
    points: NDArray[np.float64], a: int, b: int, radius: float, rows: int, columns: int
) -> tuple[int, int, int, int]:
    """The pixels (left, right, top, bottom; ends excluded) that the edge a–b may touch."""
    reach = radius + 1.0
    left = max(int(np.floor(min(points[a, 0], points[b, 0]) - reach)), 0)
    right = min(int(np.ceil(max(points[a, 0], points[b, 0]) + reach)), columns)
    top = max(int(np.floor(min(points[a, 1], points[b, 1]) - reach)), 0)
    bottom = min(int(np.ceil(max(points[a, 1], points[b, 1]) + reach)), rows)
    return left, right, top, bottom


@leaf
def _stamp_edge(points: NDArray[np.float64], a: int, b: int, radius: float, stroke: NDArray[np.float32]) -> None:
    left, right, top, bottom = _box(points, a, b, radius, stroke.shape[0], stroke.shape[1])
    ax, ay = points[a, 0], points[a, 1]
    dx, dy = points[b, 0] - ax, points[b, 1] - ay
    length2 = dx * dx + dy * dy
    inner2, outer2 = max(radius - 0.5, 0.0) ** 2, (radius + 0.5) ** 2
    for i in range(top, bottom):
        for j in range(left, right):
            px, py = j + 0.5 - ax, i + 0.5 - ay
            t = 0.0
            if length2 > 0.0:
                t = min(max((px * dx + py * dy) / length2, 0.0), 1.0)
            ex, ey = px - t * dx, py - t * dy
            near2 = ex * ex + ey * ey
            if near2 >= outer2:
                continue
            share = 1.0 if near2 <= inner2 else 0.5 + radius - np.sqrt(near2)
            if share > stroke[i, j]:
                stroke[i, j] = share


@leaf
def _commit_edge(
    points: NDArray[np.float64],
    a: int,
    b: int,
    radius: float,
    stroke: NDArray[np.float32],
    coverage: NDArray[np.float32],
) -> None:
    left, right, top, bottom = _box(points, a, b, radius, stroke.shape[0], stroke.shape[1])
    for i in range(top, bottom):
        for j in range(left, right):
            share = stroke[i, j]
            if share > 0.0:
                coverage[i, j] = min(coverage[i, j] + share, np.float32(1))
                stroke[i, j] = 0.0
