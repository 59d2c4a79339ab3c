"""Curves as the line segments of a machine: within a tolerance, and not shorter than the machine can keep up with.

Cubics are flattened to three quarters of the tolerance (Wang's bound), which leaves short segments where cubics are
short or a step of the parameter covers little way. A controller takes a time for each, whatever its length: a serial
line of 115,200 baud brings some 500 lines a second, an EBB wants 2 ms. Vertices that are nearer than `shortest`
to the one before are therefore dropped, where those dropped stay within the last quarter of the tolerance.

Known limits: a segment that the tolerance demands stays, however short; no more than `REACH` vertices are dropped
in a row, so that time stays in proportion to their number.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan.curves import flatten_all
from strokeplan.errors import InputError
from strokeplan.jit import kernel, leaf

FLATTENED = 0.75
"""The part of the tolerance that flattening takes; dropping vertices takes the rest."""
REACH = 64


def segments(
    points: NDArray[np.float64], starts: NDArray[np.int64], tolerance: float, shortest: ArrayLike = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Polylines no further than `tolerance` mm from chains of cubics, of segments no shorter than need be.

    points    (p, 2) mm and starts (n + 1,): the chains, as a StrokePlan has them.
    shortest  mm, one for all or (n,): the feed by the time that a segment is to take at least; 0 drops none.

    Returns the vertices (v, 2) and (n + 1,) where each polyline begins. Raises InputError for a tolerance that is not
    above 0, or takes too many points.
    """
    if not 0 < tolerance < np.inf:
        raise InputError(f"tolerance {tolerance} must be above 0 mm")
    least = np.broadcast_to(np.asarray(shortest, np.float64), (len(starts) - 1,))
    if not np.all((least >= 0) & (least < np.inf)):
        raise InputError(f"shortest segment {shortest!r} must be a length in mm, 0 or more")
    if not least.any():
        return flatten_all(points, starts, tolerance)
    vertices, begins = flatten_all(points, starts, FLATTENED * tolerance)
    kept = _kept(vertices, begins, (1 - FLATTENED) * tolerance, np.ascontiguousarray(least))
    return vertices[kept], np.concatenate([[0], np.cumsum(kept)])[begins]


def with_values(
    points: NDArray[np.float64], starts: NDArray[np.int64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Chains of cubics (p, d) with one coordinate more: `values` (q,) at on-curve points, even between."""
    pieces = np.diff(starts) // 3
    knots = 3 * np.arange(len(values)) - 2 * np.repeat(np.arange(len(pieces)), pieces + 1)
    column = np.empty(len(points))
    column[knots] = values
    inner = np.ones(len(points), np.bool_)
    inner[knots] = False
    handles = np.flatnonzero(inner)[::2]
    before, after = column[handles - 1], column[handles + 2]
    column[handles], column[handles + 1] = (2 * before + after) / 3, (before + 2 * after) / 3
    return np.column_stack([points, column])


@kernel
def _kept(
    vertices: NDArray[np.float64], begins: NDArray[np.int64], tolerance: float, shortest: NDArray[np.float64]
) -> NDArray[np.bool_]:
    kept = np.zeros(len(vertices), np.bool_)
    for i in range(len(begins) - 1):
        k, last = begins[i], begins[i + 1] - 1
        before = k
        kept[k] = kept[last] = True
        while k < last:
            j = _following(vertices, k, last, tolerance, shortest[i])
            if j == last and k > before and _length(vertices, k, j) < shortest[i] and last - before <= REACH:
                kept[k] = not _near(vertices, before, last, tolerance)  # the rest is short: take it along
            before, k = k, j
            kept[k] = True
    return kept


@leaf
def _following(vertices: NDArray[np.float64], k: int, last: int, tolerance: float, shortest: float) -> int:
    """The next vertex to keep: the first that is far enough, or the furthest to which the way is straight enough."""
    best = k + 1
    for j in range(k + 1, min(last, k + REACH) + 1):
        if not _near(vertices, k, j, tolerance):
            break
        best = j
        if _length(vertices, k, j) >= shortest:
            break
    return best


@leaf
def _length(vertices: NDArray[np.float64], a: int, b: int) -> float:
    return float(np.sqrt((vertices[a, 0] - vertices[b, 0]) ** 2 + (vertices[a, 1] - vertices[b, 1]) ** 2))


@leaf
def _near(vertices: NDArray[np.float64], a: int, b: int, tolerance: float) -> bool:
    """Whether all vertices between are within the tolerance of the segment from a to b."""
    dx, dy = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1]
    length2 = dx * dx + dy * dy
    for k in range(a + 1, b):
        x, y = vertices[k, 0] - vertices[a, 0], vertices[k, 1] - vertices[a, 1]
        t = min(max((x * dx + y * dy) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        if (x - t * dx) ** 2 + (y - t * dy) ** 2 > tolerance * tolerance:
            return False
    return True
