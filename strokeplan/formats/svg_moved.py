"""Where a brush stroke has gone whose outline was moved in a drawing program.

A stroke of varying width stands in our SVG as its outline, filled, with the stroke itself beside it. Programs move
the outline by rewriting its points and leave what they do not know as it was. So the outline is made again from
the stroke and compared: the transform between the two is found from the boxes around them (moved, stretched,
mirrored) or from areas and moments (turned, scaled), and holds if it lays one on the other.

Known limits: skewed outlines, and those stretched after a turn, are not recognised; nor are moves below what an
outline is off anyway (`slack`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from math import atan2, cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from strokeplan.formats.svg_style import IDENTITY, Matrix
from strokeplan.outlines import outline

FIT, MOST = 0.02, 0.9
"""A transform holds if this many points of the outline are no further off than `slack` and this part of its extent.
(Where a stroke covers itself, its outline has cusps within, and these differ from one tolerance to the next.)"""
FAR = 1e4
"""A stroke of more than this many times `slack` is far larger than the canvas; its outline is rough at cusps."""
SAMPLES = 8
"""Points looked at on each cubic of an outline."""

Points = NDArray[np.float64]
_T = np.arange(SAMPLES) / SAMPLES
_BASIS = np.stack([(1 - _T) ** 3, 3 * (1 - _T) ** 2 * _T, 3 * (1 - _T) * _T**2, _T**3], axis=1)


def moved(
    chain: Sequence[float], radii: Points, shown: Sequence[Sequence[float]], slack: float, *, round_caps: bool
) -> Matrix | None:
    """The transform that was done to the outline of a stroke; None if it is another outline.

    chain: x0, y0, then six numbers a cubic; radii (k + 1,); shown: the subpaths of the outline as it stands now.
    """
    made = outline(np.array(chain, np.float64).reshape(-1, 2), radii, slack / 2, round_caps=round_caps)
    now = np.concatenate([_sampled(part) for part in shown]) if shown else np.empty((0, 2))
    if not len(made) or not len(now):
        return IDENTITY if len(made) == len(now) or not len(made) else None
    old, new = _box(made), _box(now)
    extent = float(np.ptp(made, axis=0).max())
    slack += (1e-4 if extent < FAR * slack else 1e-2) * extent
    if np.abs(old - new).max() <= slack:
        return IDENTITY
    return _best(made, now, slack)


def _best(made: Points, now: Points, slack: float) -> Matrix | None:
    shift = (_box(now) - _box(made)).mean(axis=0)
    candidates = [
        (1.0, 0.0, 0.0, 1.0, float(shift[0]), float(shift[1])),
        *_stretched(_box(made), _box(now)),
        *_turned(made, now),
    ]
    distances = [_distance(made, matrix, now) for matrix in candidates]
    best = int(np.argmin(distances))
    extent = float(np.ptp(now, axis=0).max())
    return candidates[best] if distances[best] <= slack + FIT * extent else None


def _sampled(part: Sequence[float]) -> Points:
    points = np.array(part, np.float64).reshape(-1, 2)
    pieces = np.stack([points[0:-1:3], points[1::3], points[2::3], points[3::3]])
    sampled: Points = np.einsum("sk,knd->nsd", _BASIS, pieces).reshape(-1, 2)
    return sampled


def _box(points: Points) -> Points:
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _stretched(old: Points, new: Points) -> Iterator[Matrix]:
    """From one box to the other, mirrored or not."""
    if not (np.ptp(old, axis=0) > 0).all():
        return
    for x, y in product((1, -1), repeat=2):
        scale = np.ptp(new, axis=0) / np.ptp(old, axis=0) * (x, y)
        shift = new.mean(axis=0) - scale * old.mean(axis=0)
        yield float(scale[0]), 0.0, 0.0, float(scale[1]), float(shift[0]), float(shift[1])


def _turned(made: Points, now: Points) -> Iterator[Matrix]:
    """Scaled alike in all directions, turned, mirrored or not: the principal axes lie on each other."""
    (area, centre, axis), (new_area, new_centre, new_axis) = _moments(made), _moments(now)
    if area <= 0 or new_area <= 0:
        return
    scale = sqrt(new_area / area)
    for mirror, half in product((1, -1), (0.0, pi)):
        c, s = scale * cos(new_axis - mirror * axis + half), scale * sin(new_axis - mirror * axis + half)
        a, b, p, q = c, s, -s * mirror, c * mirror
        x, y = centre
        yield a, b, p, q, new_centre[0] - a * x - p * y, new_centre[1] - b * x - q * y


def _moments(points: Points) -> tuple[float, tuple[float, float], float]:
    """Area, centroid and direction of the longest axis of a polygon (Green's theorem)."""
    origin = points.mean(axis=0)
    x, y = (points - origin).T
    u, v = np.roll(x, -1), np.roll(y, -1)
    cross = x * v - u * y
    area = float(cross.sum()) / 2
    if area == 0:
        return 0.0, (0.0, 0.0), 0.0
    mx, my = float(((x + u) * cross).sum()) / 6 / area, float(((y + v) * cross).sum()) / 6 / area
    xx = float(((x * x + x * u + u * u) * cross).sum()) / 12 / area - mx * mx
    yy = float(((y * y + y * v + v * v) * cross).sum()) / 12 / area - my * my
    xy = float(((x * v + 2 * x * y + 2 * u * v + u * y) * cross).sum()) / 24 / area - mx * my
    return abs(area), (float(origin[0]) + mx, float(origin[1]) + my), atan2(2 * xy, xx - yy) / 2


def _distance(made: Points, matrix: Matrix, now: Points) -> float:
    """How far most of the transformed outline is from the other, and the other way round."""
    from scipy.spatial import cKDTree

    a, b, c, d, e, f = matrix
    x, y = _dense(made).T
    there = np.stack([a * x + c * y + e, b * x + d * y + f], axis=1)
    here = _dense(now)
    gaps = (cKDTree(here).query(there)[0], cKDTree(there).query(here)[0])
    return float(max(np.quantile(gap, MOST) for gap in gaps))


def _dense(polygon: Points) -> Points:
    """Points along a closed polygon, no two further apart than a fiftieth of its extent."""
    ends = np.roll(polygon, -1, axis=0)
    step = max(float(np.ptp(polygon, axis=0).max()), 1e-12) / 50
    counts = np.ceil(np.hypot(*(ends - polygon).T) / step).astype(np.int64).clip(1, 200)
    edge = np.repeat(np.arange(len(polygon)), counts)
    part = (np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[edge]
    dense: Points = polygon[edge] + (ends - polygon)[edge] * part[:, None]
    return dense
