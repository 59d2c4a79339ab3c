"""Cubic Béziers to circular arcs, for machines that know arcs and no curves (G2, G3).

Each stretch of a cubic becomes one arc if its tangents allow it, else a biarc: two arcs that meet in a tangent, with
equal legs (Bolton 1975). Where the arcs stray further than the tolerance, or turn by more than a third of a circle, the
stretch is halved. Joints keep the curve's tangent, so the arcs are as smooth as the chain.

An arc is its end points and its bulge, the tangent of a quarter of its angle: 0 is a line, 1 half a circle, positive
counterclockwise where y points up.

`biarcs_all` does so for all chains of a plan at once; `chords` cuts arcs as a controller does, for the planner of its
motion.

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


@dataclass(frozen=True, slots=True)
class ArcChains:
    """The arcs of n chains: those of chain i begin and end at points[starts[i]:starts[i + 1]]."""

    points: NDArray[np.float64]
    """(p, 2) where arcs begin and end."""
    bulges: NDArray[np.float64]
    """(p,) tan(angle / 4) of the arc from each point to the next; 0 at the last of a chain."""
    starts: NDArray[np.int64]
    """(n + 1,) where each chain begins."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    def chain(self, i: int) -> Arcs:
        """The arcs of chain i."""
        a, b = self.starts[i], self.starts[i + 1]
        return Arcs(self.points[a:b], self.bulges[a : b - 1])


def biarcs(chain: NDArray[np.float64], tolerance: float) -> Arcs:
    """Arcs no point of which is further than `tolerance` from the chain of cubics (3k + 1, 2), in its unit.

    Raises InputError if the tolerance is not above 0, or the chain is none.
    """
    chain = np.ascontiguousarray(chain, np.float64)
    if chain.ndim != 2 or chain.shape[1] != 2 or len(chain) % 3 != 1:
        raise InputError(f"a chain of cubics is (3k + 1, 2), not {chain.shape}")
    return biarcs_all(chain, np.array([0, len(chain)]), tolerance).chain(0)


def biarcs_all(points: NDArray[np.float64], starts: NDArray[np.int64], tolerance: float) -> ArcChains:
    """`biarcs` of many chains at once, `points` (p, 2) and `starts` (n + 1,) as a StrokePlan has them.

    Raises InputError if the tolerance is not above 0, a point is no number, or a chain is none of cubics.
    """
    points, starts = np.ascontiguousarray(points, np.float64), np.asarray(starts, np.int64)
    if not 0 < tolerance < np.inf:
        raise InputError(f"tolerance {tolerance} must be above 0")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f"point {bad[0]} is no number: {points[bad[0]].tolist()}")
    odd = np.flatnonzero((np.diff(starts) % 3 != 1) | (np.diff(starts) < 1))
    if len(odd) or starts[0] != 0 or starts[-1] != len(points):
        at = f"chain {odd[0]} has {np.diff(starts)[odd[0]]}" if len(odd) else f"they are {len(points)}"
        raise InputError(f"chains of cubics must have 3k + 1 points each, all of them together; {at}")
    return ArcChains(*_biarcs(points, starts, float(tolerance)))


def chords(arcs: ArcChains, tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The lines into which GRBL 1.1 cuts arcs: ends on the arc, `tolerance` from it ($12, by default 0.002 mm).

    Returns their ends (v, 2) and (n + 1,) where each chain begins. Raises InputError for a tolerance not above 0.
    """
    if not 0 < tolerance < np.inf:
        raise InputError(f"arc tolerance {tolerance} must be above 0")
    angle = 4 * np.arctan(arcs.bulges)
    chord = np.diff(arcs.points, axis=0, append=arcs.points[-1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.hypot(*chord.T) / (2 * np.abs(np.sin(angle / 2)))
        count = np.floor(np.abs(0.5 * angle * radius) / np.sqrt(tolerance * (2 * radius - tolerance)))
    count = np.maximum(np.nan_to_num(count, nan=1.0, posinf=1.0), 1).astype(np.int64)
    count[arcs.starts[1:] - 1] = 1  # a chain's last point stands for itself
    firsts = np.concatenate([[0], np.cumsum(count)])
    which = np.repeat(np.arange(len(count)), count)
    u = (np.arange(firsts[-1]) - firsts[which]) / count[which]
    curved = arcs.bulges[which] != 0
    ratio = np.divide(np.sin(u * angle[which] / 2), np.sin(angle[which] / 2), out=u.copy(), where=curved)
    turn = -(1 - u) * angle[which] / 2
    x, y = (chord[which] * ratio[:, None]).T
    turned = np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)], axis=1)
    return arcs.points[which] + turned, firsts[arcs.starts]


@kernel
def _biarcs(
    chains: NDArray[np.float64], starts: NDArray[np.int64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    points, bulges = np.empty((64, 2)), np.empty(64)
    begins = np.zeros(len(starts), np.int64)
    stack, depths = np.empty((MAX_DEPTH + 2, 2)), np.empty(MAX_DEPTH + 2, np.int64)
    m = 0
    for i in range(len(starts) - 1):
        if m + 1 > len(points):
            points, bulges = np.concatenate((points, points)), np.concatenate((bulges, bulges))
        points[m] = chains[starts[i]]
        for c in range(starts[i], starts[i + 1] - 1, 3):
            stack[0, 0], stack[0, 1], depths[0] = 0.0, 1.0, 0
            depth = 1
            while depth > 0:
                depth -= 1
                t0, t1, level = stack[depth, 0], stack[depth, 1], depths[depth]
                if m + 3 > len(points):
                    points, bulges = np.concatenate((points, points)), np.concatenate((bulges, bulges))
                made = _fit(chains, c, t0, t1, tolerance, points, bulges, m)
                if made < 0 and level < MAX_DEPTH:
                    t = 0.5 * (t0 + t1)
                    stack[depth, 0], stack[depth, 1], depths[depth] = t, t1, level + 1
                    stack[depth + 1, 0], stack[depth + 1, 1], depths[depth + 1] = t0, t, level + 1
                    depth += 2
                elif made < 0:
                    points[m + 1, 0], points[m + 1, 1] = point(chains, c, t1)
                    bulges[m] = 0.0
                    m += 1
                else:
                    m += made
        bulges[m] = 0.0
        m += 1
        begins[i + 1] = m
    return points[:m].copy(), bulges[:m].copy(), begins


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
