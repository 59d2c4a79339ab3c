"""Where a brush stroke has gone whose outline was moved in a drawing program.

A stroke of varying width stands in our SVG as its outline, filled, with the stroke itself beside it. Programs move
the outline by rewriting its points and leave what they do not know as it was. So the writer notes a few points of the
outline (`strokeplan:at`): the mean of its on-curve points, and three of them. The reader finds the same points of the
outline as it stands now; the simplest transform that takes the old ones to the new ones (none, a shift, a similarity,
any affine one) was done to the stroke. The mean tells whether single points were dragged.

Known limits: a handle that was dragged alone is not noticed; nor is a point, if by less than TOLERANCE times their
number. An outline without any width that was mirrored or stretched is taken for another one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strokeplan.formats.svg_style import IDENTITY, Matrix

TOLERANCE = 5e-5
"""A point stands where it is expected if it is this near, as a part of the canvas's longer side."""
DIGITS = 1e-6
"""Part of a coordinate that drawing programs round off."""

Points = NDArray[np.float64]


def anchors(points: Points, starts: NDArray[np.int64]) -> tuple[Points, NDArray[np.int64]]:
    """(n, 4, 2) points that stand for each of n closed chains of cubics, and how many pieces each has."""
    pieces, first = np.diff(starts) // 3, starts[:-1]
    ends = np.cumsum(pieces) - pieces
    rows = np.repeat(first - 3 * ends, pieces) + 3 * np.arange(int(pieces.sum()))
    mean = np.add.reduceat(points[rows], ends) / pieces[:, None] if len(pieces) else np.empty((0, 2))
    some = [points[first + 3 * (k * pieces // 3)] for k in range(3)]
    return np.stack([mean, *some], axis=1), pieces


def moved(at: Sequence[float], shown: Sequence[Sequence[float]], tolerance: float) -> Matrix | None:
    """The transform that was done to the outline of a stroke; None if it is another outline.

    at: the number of pieces and the coordinates of the `anchors` as they were; shown: the subpaths as they are now.
    """
    old = np.array(at[1:], np.float64).reshape(-1, 2)
    if len(shown) != 1 or len(old) != 4:
        return None
    now = np.array(shown[0], np.float64).reshape(-1, 2)
    if not (np.isfinite(old).all() and np.isfinite(now).all()):
        return None
    tolerance += DIGITS * float(np.abs(now).max())
    if len(now) // 3 == at[0] + 1 and np.abs(now[-4] - now[0]).max() <= tolerance:
        now = now[:-3]  # the line that closes what rounding has left open
    if len(now) // 3 != at[0]:
        return None
    new = anchors(now, np.array([0, len(now)]))[0][0]
    if np.abs(new - old).max() <= tolerance:
        return IDENTITY
    for fit in (_shift, _similarity, _affine):
        a, b, c, d, e, f = fit(old, new)
        if np.abs(old @ [[a, b], [c, d]] + (e, f) - new).max() <= tolerance and a * d - b * c != 0:
            return a, b, c, d, e, f
    return None


def _shift(old: Points, new: Points) -> Matrix:
    e, f = (new - old).mean(axis=0).tolist()
    return 1.0, 0.0, 0.0, 1.0, e, f


def _similarity(old: Points, new: Points) -> Matrix:
    """Turned and scaled alike in all directions, by least squares of complex numbers."""
    z, w = (points @ np.array([1, 1j]) for points in (old, new))
    away = z - z.mean()
    spread = float(np.vdot(away, away).real)
    factor = complex(np.vdot(away, w)) / spread if spread > 0 else 1.0 + 0j
    shift = complex(w.mean() - factor * z.mean())
    return factor.real, factor.imag, -factor.imag, factor.real, shift.real, shift.imag


def _affine(old: Points, new: Points) -> Matrix:
    """By least squares; one that flattens all if the points stand in a line."""
    found = np.linalg.lstsq(np.column_stack([old, np.ones(len(old))]), new, rcond=None)
    (a, b), (c, d), (e, f) = found[0].tolist()
    return (a, b, c, d, e, f) if found[2] == 3 else (0.0, 0.0, 0.0, 0.0, e, f)
