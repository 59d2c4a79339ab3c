"""Strokes whose width varies, as the outline that holds their paint.

The radius is given at the on-curve points of a chain of cubics and is linear in the parameter along each
piece. With round caps a stroke is what a disc of that radius sweeps; with butt caps its cross-sections
are perpendicular to the curve, and it ends with one.

The curve is flattened; two neighbouring discs and their common tangents make a segment, and the outline
goes along the segments on one side and back on the other. Where the two segments at a point gape, an
arc joins them; where they overlap, their crossing does, or the centre of the disc if they are too short
to cross. So the outline is a sum of closed loops that all turn the same way, and filling it by the
nonzero rule leaves no hole however tight the bend.

A disc within its neighbour adds nothing and is left out; where the stroke comes out of the larger one, a
disc that touches its rim from within takes its place.

Known limit: with butt caps a radius that jumps where the curve stands still becomes a ramp to the next
point of the flattened curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import fit, point, rdp, scratch_inside, subdivisions
from strokeplan.jit import is_cached, kernel

MAX_ARC_STEP = np.pi / 6
"""No two points of an arc are further apart, however small the disc."""
CORNER = 1.0
"""Radians by which an outline turns at a point that is a corner of it; above any step of an arc."""
FINEST = 1e-6
"""No tolerance is finer than this part of the stroke's extent: curves far larger than the canvas stay affordable."""
POLYGON_PART = 0.2
"""Part of the tolerance of fitted cubics that the polygon they are fitted to takes; simplifying takes as much."""


def compiled() -> bool:
    """Whether the kernel of `outline` is in Numba's cache; if not, the first outline compiles it."""
    return is_cached(_outline)


def outline(
    chain: NDArray[np.float64], radii: NDArray[np.float64], tolerance: float, *, round_caps: bool = True
) -> NDArray[np.float64]:
    """Closed polygon (n, 2) around a stroke, to be filled by the nonzero rule.

    chain  (3k + 1, 2) cubics; radii (k + 1,) half widths at the on-curve points, in the same unit as
    `tolerance`, by which the polygon may differ from the outline. Empty if the stroke has no extent.
    """
    return _outline(chain, radii, _affordable(tolerance, chain, radii), round_caps)[0]


def outline_curves(
    chain: NDArray[np.float64], radii: NDArray[np.float64], tolerance: float, *, round_caps: bool = True
) -> NDArray[np.float64]:
    """Like `outline`, as a closed chain of cubics (3m + 1, 2) that smooth parts pass through without a corner."""
    tolerance = _affordable(tolerance, chain, radii)
    polygon, turn = _outline(chain, radii, POLYGON_PART * tolerance, round_caps)
    return _fitted(polygon, turn, tolerance)


def outline_strokes(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    radii: NDArray[np.float64],
    wanted: NDArray[np.bool_],
    round_caps: NDArray[np.bool_],
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and starts of chains of cubics, with `outline_curves` in the place of those that are `wanted`.

    points (p, 2) and starts (n + 1,) as in a StrokePlan, radii (q,) at the on-curve points of all, wanted and
    round_caps (n,). A chain without extent keeps its place, as one that stands still.
    """
    if len(wanted) == 0:
        return points, starts
    extents = np.maximum.reduceat(points, starts[:-1]) - np.minimum.reduceat(points, starts[:-1])
    knots = (starts + 2 * np.arange(len(starts))) // 3
    reach = extents.max(axis=1) + np.maximum.reduceat(radii, knots[:-1])
    return _outlines(points, starts, radii, knots, wanted, round_caps, np.maximum(tolerance, FINEST * reach))


def _affordable(tolerance: float, chain: NDArray[np.float64], radii: NDArray[np.float64]) -> float:
    return max(tolerance, FINEST * float(np.ptp(chain, axis=0).max() + radii.max()))


@kernel
def _outlines(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    radii: NDArray[np.float64],
    knots: NDArray[np.int64],
    wanted: NDArray[np.bool_],
    round_caps: NDArray[np.bool_],
    tolerances: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The chains, one after the other, and where each begins."""
    n = len(wanted)
    out, ends = np.empty((4 * len(points), 2)), np.zeros(n + 1, np.int64)
    for i in range(n):
        chain, at = points[starts[i] : starts[i + 1]].copy(), ends[i]
        if wanted[i]:
            inner = POLYGON_PART * tolerances[i]
            polygon, turn = _outline(chain, radii[knots[i] : knots[i + 1]], inner, round_caps[i])
            chain[1:4] = chain[0]
            chain = _fitted(polygon, turn, tolerances[i]) if len(polygon) else chain[:4]
        ends[i + 1] = at + len(chain)
        if ends[i + 1] > len(out):
            room = np.empty((2 * ends[i + 1], 2))
            room[:at] = out[:at]
            out = room
        out[at : ends[i + 1]] = chain
    return out[: ends[n]], ends


@kernel
def _outline(
    chain: NDArray[np.float64], radii: NDArray[np.float64], tolerance: float, round_caps: bool
) -> tuple[NDArray[np.float64], int]:
    """The polygon, and the number of its points on the way to the end of the stroke."""
    discs = _discs(chain, radii, tolerance, round_caps)
    n = len(discs)
    if n == 0 or (n == 1 and (not round_caps or discs[0, 2] == 0.0)):
        return np.empty((0, 2)), 0
    if n == 1:
        out = np.empty((_arc_points(2.0 * np.pi, discs[0, 2], tolerance) + 2, 2))
        middle = _arc(discs, 0, 0.0, np.pi, tolerance, out, 0)
        return out[: _arc(discs, 0, np.pi, np.pi, tolerance, out, middle)], middle
    # Direction of each segment, its length, and by how much its tangents lean to the thinner end.
    along, length, lean = np.empty(n - 1), np.empty(n - 1), np.zeros(n - 1)
    for k in range(n - 1):
        dx, dy = discs[k + 1, 0] - discs[k, 0], discs[k + 1, 1] - discs[k, 1]
        along[k], length[k] = np.arctan2(dy, dx), np.sqrt(dx * dx + dy * dy)
        if round_caps:
            lean[k] = np.arcsin(min(max((discs[k, 2] - discs[k + 1, 2]) / length[k], -1.0), 1.0))
    room = 2 * _arc_points(2.0 * np.pi, max(discs[0, 2], discs[n - 1, 2]), tolerance) + 4
    for k in range(1, n - 1):
        sweep = abs(_half_turn(along[k] - along[k - 1])) + abs(lean[k] - lean[k - 1])
        room += 2 * max(_arc_points(sweep, discs[k, 2], tolerance), 3)
    out = np.empty((room, 2))
    first, last = along[0] + 0.5 * np.pi, along[n - 2] - 0.5 * np.pi
    # Forth …
    at = 0
    if round_caps:
        at = _arc(discs, 0, first + 0.5 * np.pi, 0.5 * np.pi + lean[0], tolerance, out, at)
    else:
        at = _put(discs, 0, first, out, at)
    for k in range(1, n - 1):
        bend = _half_turn(along[k] - along[k - 1])
        start, sweep = along[k - 1] + 0.5 * np.pi - lean[k - 1], bend - lean[k] + lean[k - 1]
        at = _joint(discs, k, start, sweep, length[k - 1], length[k], tolerance, out, at)
    if round_caps:
        at = _arc(discs, n - 1, last + np.pi - lean[n - 2], 0.5 * np.pi - lean[n - 2], tolerance, out, at)
    else:
        at = _put(discs, n - 1, last + np.pi, out, at)
    # … and back.
    turn = at
    if round_caps:
        at = _arc(discs, n - 1, last + 0.5 * np.pi, 0.5 * np.pi - lean[n - 2], tolerance, out, at)
    else:
        at = _put(discs, n - 1, last, out, at)
    for k in range(n - 2, 0, -1):
        bend = _half_turn(along[k] - along[k - 1])
        start, sweep = along[k] - 0.5 * np.pi + lean[k], -bend - lean[k] + lean[k - 1]
        at = _joint(discs, k, start, sweep, length[k], length[k - 1], tolerance, out, at)
    if round_caps:
        at = _arc(discs, 0, first - np.pi + lean[0], 0.5 * np.pi + lean[0], tolerance, out, at)
    else:
        at = _put(discs, 0, first - np.pi, out, at)
    return out[:at], turn


@kernel
def _discs(
    chain: NDArray[np.float64], radii: NDArray[np.float64], tolerance: float, round_caps: bool
) -> NDArray[np.float64]:
    """(n, 3) x, y, radius along the flattened chain; no centre is that of the disc before it.

    With round caps no disc lies within a neighbour.
    """
    pieces = (len(chain) - 1) // 3
    steps = np.empty(pieces, np.int64)
    for k in range(pieces):
        steps[k] = subdivisions(chain, 3 * k, tolerance)
    discs = np.empty((1 + 2 * steps.sum(), 3))
    discs[0, 0], discs[0, 1], discs[0, 2] = chain[0, 0], chain[0, 1], radii[0]
    n = 1
    disc, hidden = np.empty(3), np.empty(3)
    swallowed = False  # `hidden` is what the last of the discs holds
    for k in range(pieces):
        for step in range(1, steps[k] + 1):
            t = step / steps[k]
            disc[0], disc[1] = point(chain, 3 * k, t)
            disc[2] = (1.0 - t) * radii[k] + t * radii[k + 1]
            if not _beyond(disc, discs[n - 1], round_caps) and disc[2] <= discs[n - 1, 2]:
                hidden[:], swallowed = disc, True
                continue
            swallows = False  # `hidden` is what this disc holds
            while n > 0 and not _beyond(disc, discs[n - 1], round_caps):
                hidden[:], swallows = discs[n - 1], True
                n -= 1
            if n > 0 and round_caps and (swallows or swallowed):
                outer, inner = (disc, discs[n - 1]) if swallows else (discs[n - 1], disc)
                _to_rim(hidden, inner, outer)
                if _beyond(hidden, inner, True):
                    discs[n] = hidden
                    n += 1
            discs[n] = disc
            n += 1
            swallowed = False
    return discs[:n]


@kernel
def _beyond(a: NDArray[np.float64], b: NDArray[np.float64], round_caps: bool) -> bool:
    """Whether neither disc lies within the other; with butt caps, whether their centres differ."""
    d = np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)
    return bool(d > (abs(a[2] - b[2]) if round_caps else 0.0))


@kernel
def _to_rim(within: NDArray[np.float64], without: NDArray[np.float64], outer: NDArray[np.float64]) -> None:
    """Move the disc `within` towards `without` until it reaches out of the disc `outer`."""
    start, low, high = within.copy(), 0.0, 1.0
    for _ in range(40):
        t = 0.5 * (low + high)
        within[:] = (1.0 - t) * start + t * without
        if within[2] <= outer[2] and not _beyond(within, outer, True):
            low = t
        else:
            high = t
    within[:] = (1.0 - high) * start + high * without


@kernel
def _arc_step(radius: float, tolerance: float) -> float:
    """Angle between points of an arc whose chords stay within the tolerance."""
    if radius <= tolerance:
        return MAX_ARC_STEP
    step: float = min(2.0 * np.arccos(1.0 - tolerance / radius), MAX_ARC_STEP)
    return step


@kernel
def _arc_points(sweep: float, radius: float, tolerance: float) -> int:
    """Points of an arc, both ends included."""
    return int(np.ceil(sweep / _arc_step(radius, tolerance))) + 1


@kernel
def _half_turn(angle: float) -> float:
    """An angle between −2π and 2π as the same direction in (−π, π]."""
    if angle > np.pi:
        return angle - 2.0 * np.pi
    return angle + 2.0 * np.pi if angle <= -np.pi else angle


@kernel
def _put(discs: NDArray[np.float64], k: int, angle: float, out: NDArray[np.float64], at: int) -> int:
    """Append the point of disc k at an angle; return the next free place."""
    out[at, 0] = discs[k, 0] + discs[k, 2] * np.cos(angle)
    out[at, 1] = discs[k, 1] + discs[k, 2] * np.sin(angle)
    return at + 1


@kernel
def _arc(
    discs: NDArray[np.float64],
    k: int,
    start: float,
    sweep: float,
    tolerance: float,
    out: NDArray[np.float64],
    at: int,
) -> int:
    """Append the rim of disc k from angle `start` backwards by `sweep`, both ends included."""
    steps = max(_arc_points(sweep, discs[k, 2], tolerance) - 1, 1)
    for step in range(steps + 1):
        at = _put(discs, k, start - sweep * step / steps, out, at)
    return at


@kernel
def _joint(
    discs: NDArray[np.float64],
    k: int,
    start: float,
    sweep: float,
    length0: float,
    length1: float,
    tolerance: float,
    out: NDArray[np.float64],
    at: int,
) -> int:
    """Append what joins the sides of two segments at disc k, where the normal turns by `sweep` from `start`."""
    radius = discs[k, 2]
    half = 0.5 * abs(sweep)
    if half < 1.0:
        # Where the tangents of both segments cross: beyond the rim by `over`, and `reach` along either.
        reach, over = radius * np.tan(half), radius / np.cos(half) - radius
        if over <= tolerance if sweep < 0.0 else 2.0 * reach <= min(length0, length1):
            angle = start + 0.5 * sweep
            out[at, 0] = discs[k, 0] + (radius + over) * np.cos(angle)
            out[at, 1] = discs[k, 1] + (radius + over) * np.sin(angle)
            return at + 1
    if sweep < 0.0:
        return _arc(discs, k, start, -sweep, tolerance, out, at)
    at = _put(discs, k, start, out, at)
    out[at, 0], out[at, 1] = discs[k, 0], discs[k, 1]
    return _put(discs, k, start + sweep, out, at + 1)


@kernel
def _fitted(polygon: NDArray[np.float64], turn: int, tolerance: float) -> NDArray[np.float64]:
    """Cubics around a polygon, its corners kept: from its first point to point `turn`, and back."""
    n = len(polygon)
    if n == 0:
        return np.empty((0, 2))
    closed = np.empty((n + 1, 2))
    closed[:n], closed[n] = polygon, polygon[0]
    vertices, room = np.empty((n + 1, 2)), scratch_inside(n + 1)
    chain = np.empty((3 * n + 4, 2))
    chain[0] = polygon[0]
    at = 0
    for first, last in ((0, turn), (turn, n)):
        count = rdp(closed, first, last + 1, POLYGON_PART * tolerance, vertices, room)
        begin = 0
        for k in range(1, count):
            if k < count - 1:
                ax, ay = vertices[k, 0] - vertices[k - 1, 0], vertices[k, 1] - vertices[k - 1, 1]
                bx, by = vertices[k + 1, 0] - vertices[k, 0], vertices[k + 1, 1] - vertices[k, 1]
                if abs(np.arctan2(ax * by - ay * bx, ax * bx + ay * by)) < CORNER:
                    continue
            at += 3 * fit(
                vertices[begin : k + 1], k + 1 - begin, (1.0 - 2.0 * POLYGON_PART) * tolerance, True, chain, at, room
            )
            begin = k
    return chain[: at + 1]
