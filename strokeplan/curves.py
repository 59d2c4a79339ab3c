"""Polylines to cubic Béziers: Ramer–Douglas–Peucker, then Schneider's fit (paper, "Image Stylization Filter").

A chain of k cubics is a (3k + 1, 2) array: end points at every third row, two handles between them.
`fit_tract` keeps its curve within the sum of its two tolerances of the polyline it was given. Schneider
measures a fit only at its data points; after a simplification these are far apart and handles found by
least squares overshoot between them. Here every stretch of the curve is measured against the edge of
the polyline that it replaces, handles never exceed the arc they span, and a piece that cannot be fitted
is split, down to single edges whose handles shrink until the curve hugs the edge. Pieces share the
tangent at their joint (G1).

Known limits: the handles of an edge that had to shrink can be very short, so its curvature is high near
the joint; corners are rounded within the tolerance, not kept.

Sources: D. Douglas, T. Peucker (1973); P. Schneider, "An Algorithm for Automatically Fitting Digitized
Curves", Graphics Gems (1990), with Wang's bound for flattening.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.jit import kernel, leaf

MAX_REFITS = 4
"""Newton reparameterisations of one piece before it is split (Schneider's own figure)."""
REFIT_FACTOR = 4.0
"""A piece whose error is above this many tolerances is split at once: refitting would not save it."""
PROBES = 4
"""Points measured on each stretch of a piece between two of its data points."""
PROBE_MARGIN = 0.77
"""The fit aims at this part of its tolerance. The distance of a cubic across a straight edge is a cubic
polynomial, which can exceed its largest value at 5 equally spaced points by no more than a factor of 1/0.77."""
MAX_VERTICES = 10_000_000
"""Most that many chains become at once: more than a page can show, and what an absurd tolerance would ask for."""
MAX_HANDLE = 2.0 / 3.0
"""Longest handle, as a part of the arc it spans; half a circle needs 0.42."""


def simplify(points: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Ramer–Douglas–Peucker: the (m, 2) vertices of `points` (n, 2) that stay; both ends always do."""
    out = np.empty((len(points), 2))
    return out[
        : rdp(np.ascontiguousarray(points, dtype=np.float64), 0, len(points), tolerance, out, scratch(len(points)))
    ]


def fit_tract(
    points: NDArray[np.float64], simplify_tolerance: float = 0.25, fit_tolerance: float = 0.75
) -> NDArray[np.float64]:
    """Chain of cubics (3k + 1, 2) through both ends of the polyline `points` (n, 2), simplified first.

    No point of the curve is further from the polyline than the two tolerances together. Empty (0, 2)
    if the points are fewer than two, or all the same.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    vertices = np.empty((len(points), 2))
    room = scratch(len(points))
    n = rdp(points, 0, len(points), simplify_tolerance, vertices, room) if len(points) else 0
    if n < 2:
        return np.empty((0, 2))
    chain = np.empty((3 * n - 2, 2))
    return chain[: 3 * fit(vertices, n, fit_tolerance, True, chain, 0, room) + 1]


def flatten(chain: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Polyline (n, 2) on a chain of cubics (3k + 1, 2), no chord further than `tolerance` from its arc."""
    parts = [chain[:1]]
    for piece in range((len(chain) - 1) // 3):
        p = chain[3 * piece : 3 * piece + 4]
        t = np.arange(1, (n := subdivisions(p, 0, tolerance)) + 1)[:, None] / n
        s = 1 - t
        parts.append(s**3 * p[0] + 3 * s**2 * t * p[1] + 3 * s * t**2 * p[2] + t**3 * p[3])
    return np.concatenate(parts)


def flatten_all(
    points: NDArray[np.float64], starts: NDArray[np.int64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """`flatten` of many chains at once, `points` (p, 2) and `starts` (n + 1,) as a StrokePlan has them.

    Points may have further coordinates (a height). Returns the vertices (v, 2) of all polylines, and (n + 1,)
    where each begins. Raises InputError for a tolerance that would take more than MAX_VERTICES.
    """
    pieces = np.diff(starts) // 3
    firsts = np.concatenate([[0], np.cumsum(pieces)])  # the first piece of every chain
    p = points[(3 * np.arange(firsts[-1]) + np.repeat(starts[:-1] - 3 * firsts[:-1], pieces))[:, None] + np.arange(4)]
    bend = np.max(np.sum((p[:, :-2] - 2 * p[:, 1:-1] + p[:, 2:]) ** 2, axis=2), axis=1)
    steps = np.maximum(np.ceil(np.sqrt(0.75 * np.sqrt(bend) / tolerance)), 1)  # Wang's bound, as in `subdivisions`
    if steps.sum() > MAX_VERTICES:
        raise InputError(f"tolerance {tolerance:g} takes {steps.sum():.2g} points, above {MAX_VERTICES:,}; raise it")
    steps = steps.astype(np.int64)
    ends = np.concatenate([[0], np.cumsum(steps)])
    begins = ends[firsts] + np.arange(len(firsts))
    t = ((np.arange(ends[-1]) - np.repeat(ends[:-1], steps) + 1) / np.repeat(steps, steps))[:, None]
    s = 1 - t
    weights = (s**3, 3 * s**2 * t, 3 * s * t**2, t**3)
    vertices = np.empty((begins[-1], points.shape[1]))
    inner = np.ones(len(vertices), np.bool_)
    inner[begins[:-1]] = False
    vertices[begins[:-1]] = points[starts[:-1]]
    vertices[inner] = sum(weight * np.repeat(p[:, k], steps, axis=0) for k, weight in enumerate(weights))
    return vertices, begins


class Scratch(NamedTuple):
    """Room for `rdp` and `fit` to work in."""

    stack: NDArray[np.int64]
    keep: NDArray[np.bool_]
    tangents: NDArray[np.float64]
    u: NDArray[np.float64]


def scratch(n: int) -> Scratch:
    """Room for polylines of up to `n` points."""
    return Scratch(np.empty((n + 1, 2), np.int64), np.empty(n, np.bool_), np.empty((n, 2)), np.empty(n))


scratch_inside = kernel(scratch)
"""The same, to be called from kernels."""


@leaf
def rdp(
    points: NDArray[np.float64], first: int, last: int, tolerance: float, out: NDArray[np.float64], room: Scratch
) -> int:
    """Write the kept vertices of points[first:last] to `out`; return how many. Consecutive ones differ."""
    n = last - first
    stack, keep = room.stack, room.keep
    for k in range(n):
        keep[k] = k == 0 or k == n - 1
    stack[0, 0], stack[0, 1] = 0, n - 1
    depth = 1
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        worst, split = tolerance * tolerance, -1
        for k in range(a + 1, b):
            d = _edge_distance2(
                points[first + k, 0], points[first + k, 1],
                points[first + a, 0], points[first + a, 1], points[first + b, 0], points[first + b, 1],
            )  # fmt: skip
            if d > worst:
                worst, split = d, k
        if split >= 0:
            keep[split] = True
            stack[depth, 0], stack[depth, 1] = a, split
            stack[depth + 1, 0], stack[depth + 1, 1] = split, b
            depth += 2
    count = 0
    for k in range(n):
        if keep[k]:
            x, y = points[first + k, 0], points[first + k, 1]
            if count == 0 or x != out[count - 1, 0] or y != out[count - 1, 1]:
                out[count, 0], out[count, 1] = x, y
                count += 1
    return count


@leaf
def _edge_distance2(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance of p from the edge a–b."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    t = 0.0
    if length2 > 0.0:
        t = min(max(((px - ax) * dx + (py - ay) * dy) / length2, 0.0), 1.0)
    ex, ey = px - ax - t * dx, py - ay - t * dy
    return ex * ex + ey * ey


@leaf
def fit(
    p: NDArray[np.float64],
    n: int,
    tolerance: float,
    bounded: bool,
    chain: NDArray[np.float64],
    at: int,
    room: Scratch,
) -> int:
    """Fit cubics to the vertices p[:n] (consecutive ones distinct); write the chain to chain[at:].

    Returns the number of pieces (at most n − 1). `bounded=False` fits as the published pictures were
    fitted (see Preset.fit).
    """
    limit2 = (PROBE_MARGIN * tolerance) ** 2 if bounded else tolerance * tolerance
    stack, tangents = room.stack, room.tangents
    _set_tangents(p, n, tangents)
    if not bounded:  # the published fit's last handle points onwards
        tangents[n - 1, 0], tangents[n - 1, 1] = -tangents[n - 1, 0], -tangents[n - 1, 1]
    stack[0, 0], stack[0, 1] = 0, n - 1
    depth, pieces = 1, 0
    chain[at, 0], chain[at, 1] = p[0, 0], p[0, 1]
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        c = at + 3 * pieces
        chain[c + 3, 0], chain[c + 3, 1] = p[b, 0], p[b, 1]
        if b - a == 1:
            _fit_edge(tangents, a, limit2, bounded, chain, c)
            pieces += 1
            continue
        split = _fit_run(p, tangents, a, b, limit2, bounded, room.u, chain, c)
        if split < 0:
            pieces += 1
        else:
            # The left part is on top, so pieces are written in order.
            stack[depth, 0], stack[depth, 1] = split, b
            stack[depth + 1, 0], stack[depth + 1, 1] = a, split
            depth += 2
    return pieces


@leaf
def _set_tangents(p: NDArray[np.float64], n: int, t: NDArray[np.float64]) -> None:
    """Unit tangents at the vertices: inside, the directions of both edges weighted by the other's length
    (exact on a circle); at the ends, the neighbour's tangent mirrored in the edge where that turns gently."""
    for k in range(1, n - 1):
        ax, ay = p[k, 0] - p[k - 1, 0], p[k, 1] - p[k - 1, 1]
        bx, by = p[k + 1, 0] - p[k, 0], p[k + 1, 1] - p[k, 1]
        la2, lb2 = ax * ax + ay * ay, bx * bx + by * by
        tx, ty = ax * lb2 + bx * la2, ay * lb2 + by * la2
        norm = np.sqrt(tx * tx + ty * ty)
        if norm <= 1e-9 * np.sqrt(la2) * lb2:  # the polyline turns straight back
            tx, ty, norm = -ay, ax, np.sqrt(la2)
        t[k, 0], t[k, 1] = tx / norm, ty / norm
    for end, inner in ((0, 1), (n - 1, n - 2)):
        dx, dy = p[inner, 0] - p[end, 0], p[inner, 1] - p[end, 1]
        if end > inner:
            dx, dy = -dx, -dy
        norm = np.sqrt(dx * dx + dy * dy)
        dx, dy = dx / norm, dy / norm
        t[end, 0], t[end, 1] = dx, dy
        if n > 2:
            along = t[inner, 0] * dx + t[inner, 1] * dy
            if along > 0.8:
                t[end, 0], t[end, 1] = 2.0 * along * dx - t[inner, 0], 2.0 * along * dy - t[inner, 1]


@leaf
def _fit_edge(t: NDArray[np.float64], a: int, limit2: float, bounded: bool, chain: NDArray[np.float64], c: int) -> None:
    """One cubic over the single edge a – a + 1: handles of a third, shrunk until the curve stays close."""
    x0, y0, x1, y1 = chain[c, 0], chain[c, 1], chain[c + 3, 0], chain[c + 3, 1]
    handle = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2) / 3.0
    for _ in range(60):
        _set_handles(t, a, a + 1, handle, handle, chain, c)
        if not bounded or _edge_deviation2(chain, c, 0.0, 1.0, x0, y0, x1, y1)[0] <= limit2:
            return
        handle *= 0.5


@leaf
def _fit_run(
    p: NDArray[np.float64],
    t: NDArray[np.float64],
    a: int,
    b: int,
    limit2: float,
    bounded: bool,
    u: NDArray[np.float64],
    chain: NDArray[np.float64],
    c: int,
) -> int:
    """Try one cubic over the vertices a…b; −1 if it holds, else the vertex at which to split."""
    u[a] = 0.0
    for k in range(a + 1, b + 1):
        u[k] = u[k - 1] + np.sqrt((p[k, 0] - p[k - 1, 0]) ** 2 + (p[k, 1] - p[k - 1, 1]) ** 2)
    arc = u[b]
    for k in range(a + 1, b + 1):
        u[k] /= arc
    split = a + 1
    for attempt in range(MAX_REFITS + 1):
        _least_squares_handles(p, t, a, b, arc, bounded, u, chain, c)
        error2, split = _worst(p, a, b, bounded, u, chain, c)
        if error2 <= limit2:
            return -1
        if error2 > limit2 * REFIT_FACTOR * REFIT_FACTOR or attempt == MAX_REFITS or not bounded:
            break
        for k in range(a + 1, b):
            u[k] = _newton(chain, c, p[k, 0], p[k, 1], u[k])
    return split


@leaf
def _least_squares_handles(
    p: NDArray[np.float64],
    t: NDArray[np.float64],
    a: int,
    b: int,
    arc: float,
    bounded: bool,
    u: NDArray[np.float64],
    chain: NDArray[np.float64],
    c: int,
) -> None:
    """Handle lengths that bring the curve closest to the vertices at their parameters u (2 × 2 normal equations)."""
    c00, c01, c11, r0, r1 = 0.0, 0.0, 0.0, 0.0, 0.0
    t0x, t0y, t1x, t1y = t[a, 0], t[a, 1], -t[b, 0], -t[b, 1]
    for k in range(a + 1, b):
        s = 1.0 - u[k]
        b0, b1, b2, b3 = s * s * s, 3.0 * s * s * u[k], 3.0 * s * u[k] * u[k], u[k] * u[k] * u[k]
        dx = p[k, 0] - (b0 + b1) * p[a, 0] - (b2 + b3) * p[b, 0]
        dy = p[k, 1] - (b0 + b1) * p[a, 1] - (b2 + b3) * p[b, 1]
        c00 += b1 * b1
        c01 += b1 * b2 * (t0x * t1x + t0y * t1y)
        c11 += b2 * b2
        r0 += b1 * (t0x * dx + t0y * dy)
        r1 += b2 * (t1x * dx + t1y * dy)
    determinant = c00 * c11 - c01 * c01
    chord = np.sqrt((p[b, 0] - p[a, 0]) ** 2 + (p[b, 1] - p[a, 1]) ** 2)
    left, right = 0.0, 0.0
    if determinant > 1e-12 * c00 * c11:
        left = (r0 * c11 - r1 * c01) / determinant
        right = (c00 * r1 - c01 * r0) / determinant
    if left < 1e-3 * chord or right < 1e-3 * chord:  # Wu and Barsky's fallback, as Schneider has it
        left = right = arc / 3.0 if bounded else chord
    if bounded:
        left, right = min(left, MAX_HANDLE * arc), min(right, MAX_HANDLE * arc)
    else:  # the published fit exchanges them
        left, right = right, left
    _set_handles(t, a, b, left, right, chain, c)


@leaf
def _set_handles(
    t: NDArray[np.float64], a: int, b: int, left: float, right: float, chain: NDArray[np.float64], c: int
) -> None:
    chain[c + 1, 0], chain[c + 1, 1] = chain[c, 0] + left * t[a, 0], chain[c, 1] + left * t[a, 1]
    chain[c + 2, 0], chain[c + 2, 1] = chain[c + 3, 0] - right * t[b, 0], chain[c + 3, 1] - right * t[b, 1]


@leaf
def _worst(
    p: NDArray[np.float64], a: int, b: int, bounded: bool, u: NDArray[np.float64], chain: NDArray[np.float64], c: int
) -> tuple[float, int]:
    """Largest squared deviation of the piece, and the inner vertex nearest to it."""
    worst, split = 0.0, (a + b) // 2
    for k in range(a, b):
        if bounded:
            d, early = _edge_deviation2(chain, c, u[k], u[k + 1], p[k, 0], p[k, 1], p[k + 1, 0], p[k + 1, 1])
            if d > worst:
                worst, split = d, k if early else k + 1
        if k + 1 < b:
            x, y = point(chain, c, u[k + 1])
            d = (x - p[k + 1, 0]) ** 2 + (y - p[k + 1, 1]) ** 2
            if d > worst:
                worst, split = d, k + 1
    return worst, min(max(split, a + 1), b - 1)


@leaf
def _edge_deviation2(
    chain: NDArray[np.float64], c: int, t0: float, t1: float, x0: float, y0: float, x1: float, y1: float
) -> tuple[float, bool]:
    """Squared deviation of a stretch of a cubic from an edge: furthest across and furthest beyond its ends.

    Across is measured at the probes (see PROBE_MARGIN), beyond the ends also where the stretch turns back.
    Also whether the largest lies in the first half.
    """
    dx, dy = x1 - x0, y1 - y0
    length = np.sqrt(dx * dx + dy * dy)
    dx, dy = dx / length, dy / length
    across, beyond, at_across, at_beyond = 0.0, 0.0, t0, t0
    for probe in range(PROBES + 1):
        t = t0 + (t1 - t0) * probe / PROBES
        x, y = point(chain, c, t)
        d = abs((x - x0) * dy - (y - y0) * dx)
        if d > across:
            across, at_across = d, t
        along = (x - x0) * dx + (y - y0) * dy
        d = max(-along, along - length)
        if d > beyond:
            beyond, at_beyond = d, t
    # Steps of the control polygon along the edge: the derivative is their quadratic Bernstein polynomial.
    s0 = (chain[c + 1, 0] - chain[c, 0]) * dx + (chain[c + 1, 1] - chain[c, 1]) * dy
    s1 = (chain[c + 2, 0] - chain[c + 1, 0]) * dx + (chain[c + 2, 1] - chain[c + 1, 1]) * dy
    s2 = (chain[c + 3, 0] - chain[c + 2, 0]) * dx + (chain[c + 3, 1] - chain[c + 2, 1]) * dy
    if min(s0, s1, s2) < 0.0 < max(s0, s1, s2):
        q2, q1 = s0 - 2.0 * s1 + s2, s1 - s0
        discriminant = q1 * q1 - q2 * s0
        if discriminant >= 0.0:
            # The stable pair of roots of q2 t² + 2 q1 t + s0.
            q = -(q1 + np.sqrt(discriminant)) if q1 >= 0.0 else np.sqrt(discriminant) - q1
            for top, bottom in ((q, q2), (s0, q)):
                if bottom != 0.0 and t0 < top / bottom < t1:
                    x, y = point(chain, c, top / bottom)
                    along = (x - x0) * dx + (y - y0) * dy
                    d = max(-along, along - length)
                    if d > beyond:
                        beyond, at_beyond = d, top / bottom
    at = at_across if across > beyond else at_beyond
    return across * across + beyond * beyond, at - t0 < 0.5 * (t1 - t0)


@leaf
def _newton(chain: NDArray[np.float64], c: int, px: float, py: float, u: float) -> float:
    """One Newton step of the parameter u towards the foot of the perpendicular from p."""
    s = 1.0 - u
    x, y = point(chain, c, u)
    d1x, d1y, d2x, d2y = 0.0, 0.0, 0.0, 0.0
    for k, w1 in ((0, s * s), (1, 2.0 * s * u), (2, u * u)):
        d1x += 3.0 * w1 * (chain[c + k + 1, 0] - chain[c + k, 0])
        d1y += 3.0 * w1 * (chain[c + k + 1, 1] - chain[c + k, 1])
    for k, w2 in ((0, s), (1, u)):
        d2x += 6.0 * w2 * (chain[c + k + 2, 0] - 2.0 * chain[c + k + 1, 0] + chain[c + k, 0])
        d2y += 6.0 * w2 * (chain[c + k + 2, 1] - 2.0 * chain[c + k + 1, 1] + chain[c + k, 1])
    slope = d1x * d1x + d1y * d1y + (x - px) * d2x + (y - py) * d2y
    if slope <= 0.0:
        return u
    return min(max(u - ((x - px) * d1x + (y - py) * d1y) / slope, 0.0), 1.0)


@leaf
def point(chain: NDArray[np.float64], c: int, t: float) -> tuple[float, float]:
    """Point at parameter t of the cubic chain[c:c + 4]."""
    s = 1.0 - t
    b0, b1, b2, b3 = s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t
    return (
        b0 * chain[c, 0] + b1 * chain[c + 1, 0] + b2 * chain[c + 2, 0] + b3 * chain[c + 3, 0],
        b0 * chain[c, 1] + b1 * chain[c + 1, 1] + b2 * chain[c + 2, 1] + b3 * chain[c + 3, 1],
    )


@leaf
def subdivisions(chain: NDArray[np.float64], c: int, tolerance: float) -> int:
    """Equal parameter steps after which no chord of chain[c:c + 4] is further than `tolerance` (Wang)."""
    worst = 0.0
    for k in range(2):
        dx = chain[c + k, 0] - 2.0 * chain[c + k + 1, 0] + chain[c + k + 2, 0]
        dy = chain[c + k, 1] - 2.0 * chain[c + k + 1, 1] + chain[c + k + 2, 1]
        worst = max(worst, dx * dx + dy * dy)
    return max(int(np.ceil(np.sqrt(0.75 * np.sqrt(worst) / tolerance))), 1)
