"""What ink covers: the part of every pixel of a sheet that strokes of a pen lie on.

A stroke is a polyline drawn with a round pen; a pixel's coverage is that of an edge at the distance of its centre
(½ + (r − d) / pixel, clipped), the maximum over the stroke's edges, so that a stroke does not darken itself.
Strokes do not know of each other: together they cover 1 − Π(1 − c), which is how transparency is composited
and, of strokes that cross, what they cover (Demichel 1924).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import kernel, leaf
from strokeplan.linework import Lines


def cover(lines: Lines, width_mm: float, pixel_mm: float, coverage: NDArray[np.float32]) -> None:
    """Add lines of a pen to `coverage` (rows, columns) of pixels of `pixel_mm`; the picture begins at (0, 0)."""
    if len(lines.points):
        _cover(lines.points / pixel_mm, lines.starts, 0.5 * width_mm / pixel_mm, np.zeros_like(coverage), coverage)


@kernel
def _cover(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    radius: float,
    stroke: NDArray[np.float32],
    coverage: NDArray[np.float32],
) -> None:
    for line in range(len(starts) - 1):
        first, last = starts[line], starts[line + 1]
        for k in range(first, last):
            _stamp_edge(points, k, min(k + 1, last - 1), radius, stroke)
        # Edge by edge again: the box of a long stroke is mostly empty.
        for k in range(first, last):
            _commit_edge(points, k, min(k + 1, last - 1), radius, stroke, coverage)


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
    for i in range(top, bottom):
        for j in range(left, right):
            px, py = j + 0.5 - ax, i + 0.5 - ay
            t = 0.0
            if length2 > 0.0:
                t = min(max((px * dx + py * dy) / length2, 0.0), 1.0)
            ex, ey = px - t * dx, py - t * dy
            share = min(max(0.5 + radius - np.sqrt(ex * ex + ey * ey), 0.0), 1.0)
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
                coverage[i, j] = 1.0 - (1.0 - coverage[i, j]) * (1.0 - share)
                stroke[i, j] = 0.0
