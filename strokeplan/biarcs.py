"""Cubic Béziers to circular arcs, for machines that know arcs and no curves (G2, G3).

Each stretch of a cubic becomes one arc if its tangents allow it, else a biarc: two arcs that meet in a tangent, with
equal legs (Bolton 1975). Where the arcs stray further than the tolerance, or turn by more than a third of a circle, the
stretch is halved. Joints keep the curve's tangent, so the arcs are as smooth as the chain.

An arc is its end points and its bulge, the tangent of a quarter of its angle: 0 is a line, 1 half a circle, positive
counterclockwise where y points up.

Known limits: halves are halves of the parameter, so a few arcs more are made than an optimum would need; the distance
is measured at `PROBES` points of each stretch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import point
from strokeplan.errors import InputError
from strokeplan.jit import kernel, leaf

PROBES = 16
"""Points at which a stretch is measured against its arcs."""
MARGIN = 0.95
"""The part of the tolerance that is aimed at: the largest distance may lie between two probes."""
MAX_DEPTH = 20
"""Halvings of one cubic, after which a stretch (of no more than a millionth) is a line."""
MAX_BULGE = np.tan(np.pi / 6)
"""No arc turns by more than 120°: what lies beyond its ends is then told from what lies beside it."""
FLAT = 0.01
"""An arc that rises above its chord by less than this part of the tolerance is a line."""


@dataclass(frozen=True, slots=True)
class Arcs:
    """m arcs, one after the other."""

    points: NDArray[np.float64]
    """(m + 1, 2) where arcs begin and end."""
    bulges: NDArray[np.float64]
    """(m,) tan(angle / 4), signed."""

    @property
    def centres(self) -> NDArray[np.float64]:
        """(m, 2) centres; not a number for lines."""
        chord = np.diff(self.points, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = np.where(self.bulges == 0, np.nan, (1 - self.bulges**2) / (4 * self.bulges))
        left = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
        centres: NDArray[np.float64] = (self.points[1:] + self.points[:-1]) / 2 + left * rise[:, None]
        return centres


def biarcs(chain: NDArray[np.float64], tolerance: float) -> Arcs:
    """Arcs no point of which is further than `tolerance` from the chain of cubics (3k + 1, 2), in its unit.

    Raises InputError if the tolerance is not above 0, or the chain is none.
    """
    chain = np.ascontiguousarray(chain, np.float64)
    if chain.ndim != 2 or chain.shape[1] != 2 or len(chain) % 3 != 1:
        raise InputError(f"a chain of cubics is (3k + 1, 2), not {chain.shape}")
    if not 0 < tolerance < np.inf:
        raise InputError(f"tolerance {tolerance} must be above 0")
    if not np.isfinite(chain).all():
        raise InputError("the chain has a coordinate that is no number")
    return Arcs(*_biarcs(chain, float(tolerance)))


@kernel
def _biarcs(chain: NDArray[np.float64], tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points, bulges = np.empty((64, 2)), np.empty(64)
    points[0] = chain[0]
    m = 0
    stack, depths = np.empty((MAX_DEPTH + 2, 2)), np.empty(MAX_DEPTH + 2, np.int64)
    for c in range(0, len(chain) - 1, 3):
        stack[0, 0], stack[0, 1], depths[0] = 0.0, 1.0, 0
        depth = 1
        while depth > 0:
            depth -= 1
            t0, t1, level = stack[depth, 0], stack[depth, 1], depths[depth]
            if m + 3 > len(points):
                points, bulges = np.concatenate((points, points)), np.concatenate((bulges, bulges))
            made = _fit(chain, c, t0, t1, tolerance, points, bulges, m)
            if made < 0 and level < MAX_DEPTH:
                t = 0.5 * (t0 + t1)
                stack[depth, 0], stack[depth, 1], depths[depth] = t, t1, level + 1
                stack[depth + 1, 0], stack[depth + 1, 1], depths[depth + 1] = t0, t, level + 1
                depth += 2
            elif made < 0:
                points[m + 1, 0], points[m + 1, 1] = point(chain, c, t1)
                bulges[m] = 0.0
                m += 1
            else:
                m += made
    return points[: m + 1].copy(), bulges[:m].copy()


@leaf
def _fit(
    chain: NDArray[np.float64],
    c: int,
    t0: float,
    t1: float,
    tolerance: float,
    points: NDArray[np.float64],
    bulges: NDArray[np.float64],
    m: int,
) -> int:
    """Write one arc or two behind points[m]; how many, 0 if the stretch is a point, or −1 if it must be halved."""
    ax, ay = points[m, 0], points[m, 1]
    bx, by = point(chain, c, t1)
    ux, uy = _tangent(chain, c, t0, 1.0)
    vx, vy = _tangent(chain, c, t1, -1.0)
    x, y = bx - ax, by - ay
    length2 = x * x + y * y
    if length2 == 0.0:
        middle = point(chain, c, 0.5 * (t0 + t1))
        return 0 if middle[0] == ax and middle[1] == ay and ux == 0.0 and uy == 0.0 else -1
    b0, b1 = _bulge(ux, uy, x, y), _bulge(x, y, vx, vy)
    if abs(b0 - b1) < 1e-4:  # the tangents of one arc
        points[m + 1, 0], points[m + 1, 1] = bx, by
        bulges[m] = _level(0.5 * (b0 + b1), length2, tolerance)
        if abs(bulges[m]) <= MAX_BULGE and _strays(chain, c, t0, t1, points, bulges, m, 1) <= MARGIN * tolerance:
            return 1
    along, leg = x * (ux + vx) + y * (uy + vy), 0.0
    spread = 2.0 * (1.0 - ux * vx - uy * vy)
    if spread > 1e-12:
        leg = (np.sqrt(along * along + spread * length2) - along) / spread
    elif along > 0.0:
        leg = length2 / (2.0 * along)
    if leg <= 0.0:
        return -1
    mx, my = 0.5 * (ax + bx + leg * (ux - vx)), 0.5 * (ay + by + leg * (uy - vy))
    points[m + 1, 0], points[m + 1, 1] = mx, my
    points[m + 2, 0], points[m + 2, 1] = bx, by
    bulges[m] = _level(_bulge(ux, uy, mx - ax, my - ay), (mx - ax) ** 2 + (my - ay) ** 2, tolerance)
    bulges[m + 1] = _level(_bulge(bx - mx, by - my, vx, vy), (bx - mx) ** 2 + (by - my) ** 2, tolerance)
    if max(abs(bulges[m]), abs(bulges[m + 1])) > MAX_BULGE:
        return -1
    return 2 if _strays(chain, c, t0, t1, points, bulges, m, 2) <= MARGIN * tolerance else -1


@leaf
def _tangent(chain: NDArray[np.float64], c: int, t: float, side: float) -> tuple[float, float]:
    """Unit tangent at t; where the cubic stands still, that on the given side. (0, 0) for a point."""
    for nudge in (0.0, 1e-6, 1e-3, 0.5):
        r = t + side * nudge
        s = 1.0 - r
        w0, w1, w2 = s * s, 2.0 * s * r, r * r
        x = w0 * (chain[c + 1, 0] - chain[c, 0]) + w1 * (chain[c + 2, 0] - chain[c + 1, 0])
        y = w0 * (chain[c + 1, 1] - chain[c, 1]) + w1 * (chain[c + 2, 1] - chain[c + 1, 1])
        x += w2 * (chain[c + 3, 0] - chain[c + 2, 0])
        y += w2 * (chain[c + 3, 1] - chain[c + 2, 1])
        norm = np.sqrt(x * x + y * y)
        if norm > 1e-12:
            return x / norm, y / norm
    return 0.0, 0.0


@leaf
def _bulge(ax: float, ay: float, bx: float, by: float) -> float:
    """tan of half the angle from a to b: the bulge of an arc with tangent a and chord b, or the other way round."""
    cross, dot = ax * by - ay * bx, ax * bx + ay * by
    norm = np.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
    return float(cross / (norm + dot)) if norm + dot > 1e-12 * norm else 1e9


@leaf
def _level(bulge: float, length2: float, tolerance: float) -> float:
    return 0.0 if 0.5 * abs(bulge) * np.sqrt(length2) < FLAT * tolerance else bulge


@leaf
def _strays(
    chain: NDArray[np.float64],
    c: int,
    t0: float,
    t1: float,
    points: NDArray[np.float64],
    bulges: NDArray[np.float64],
    m: int,
    arcs: int,
) -> float:
    """The largest distance of the stretch from its arcs."""
    worst = 0.0
    for probe in range(1, PROBES):
        x, y = point(chain, c, t0 + (t1 - t0) * probe / PROBES)
        nearest = np.inf
        for k in range(m, m + arcs):
            nearest = min(nearest, _distance(x, y, points, bulges[k], k))
        worst = max(worst, nearest)
    return worst


@leaf
def _distance(x: float, y: float, points: NDArray[np.float64], bulge: float, k: int) -> float:
    """Of (x, y) from the arc between points k and k + 1."""
    ax, ay, bx, by = points[k, 0], points[k, 1], points[k + 1, 0], points[k + 1, 1]
    dx, dy = bx - ax, by - ay
    ends = np.sqrt(min((x - ax) ** 2 + (y - ay) ** 2, (x - bx) ** 2 + (y - by) ** 2))
    length2 = dx * dx + dy * dy
    if bulge == 0.0:
        t = ((x - ax) * dx + (y - ay) * dy) / length2 if length2 > 0.0 else -1.0
        return float(abs((x - ax) * dy - (y - ay) * dx) / np.sqrt(length2)) if 0.0 <= t <= 1.0 else float(ends)
    rise = (1.0 - bulge * bulge) / (4.0 * bulge)
    cx, cy = 0.5 * (ax + bx) - dy * rise, 0.5 * (ay + by) + dx * rise
    before = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
    after = (x - cx) * (by - cy) - (y - cy) * (bx - cx)
    if before * bulge >= 0.0 and after * bulge >= 0.0:
        radius = np.sqrt(length2) * (1.0 + bulge * bulge) / (4.0 * abs(bulge))
        return float(abs(np.sqrt((x - cx) ** 2 + (y - cy) ** 2) - radius))
    return float(ends)
