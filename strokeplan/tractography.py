"""Streamlines through an orientation field: dr/ds = u(r) by RK2(3) (paper, "Primer on DTI").

Bogacki–Shampine's embedded pair of orders 2 and 3 with an explicit error tolerance per step. An
eigenvector has no sign, so the four neighbours of a point are turned to agree with the heading before
they are interpolated, and the heading changes only when a step is accepted. A tract ends at its maximum
length, at the border of the photo, or where the coherence falls below the threshold; the last two are
located on the step by bisection. No step is longer than `max_step`, so that a tract cannot leap
across a band of incoherence.

Tracts may wander (probabilistic tractography, as Behrens et al. 2007 have it for diffusion): the heading is
drawn from the orientation's uncertainty. The anisotropy (λ1 − λ2) / (λ1 + λ2) is the mean resultant length of
the gradients' doubled angles, weighted by energy; coherence is its square. Taken as wrapped normal, the
angle of the structure has the standard deviation σ_θ = ½ √(−2 ln √coherence). The deviation is wander · σ_θ
at the place reached, times a standard normal process of the arc length s from the seed: normal numbers at
knots `bend` apart, mixed between them with weights cos and sin, so that the variance is 1 everywhere. It
depends on s and a key alone. A tract is therefore still the solution of a differential equation, smooth
through its seed, whatever the steps, the order or the threads; white noise at each step would average out as
the steps grow short.

Positions are photo coordinates: x right, y down, pixel (i, j) covers [j, j + 1] × [i, i + 1].

Known limit: a tract on a closed curve goes round until its length is used up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.field import OrientationField
from strokeplan.jit import inlined, leaf

STEP_TOLERANCE_PX = 0.05
"""Default largest estimated error of one accepted step. With it the tracts of rings of radius 10 px and
more stay circles to 0.1 px; a smaller value costs time and moves nothing that a pen could show."""
MAX_STEP_PX = 2.0
"""Default longest step: narrower bands of incoherence than this may be crossed."""
MIN_STEP_PX = 0.05
"""A rejected step is never shortened below this: at a singular point no step is short enough."""
STEADY = 0.7
"""A step whose error is within this part of the tolerance would grow: 0.9 · 0.7^(−1/3) is above 1."""
BEND_PX = 10.0
"""Default distance over which a wandering tract changes its deviation."""
MAX_DEVIATION = np.pi / 2
"""Beyond a right angle from the orientation a tract would turn back."""
MAX_UNCERTAINTY = np.pi / np.sqrt(12)
"""Standard deviation of an axis of any direction alike: nothing is less certain."""

_GAMMA, _MIX_1, _MIX_2 = (np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


def track(
    field: OrientationField,
    seed: tuple[float, float],
    *,
    max_length: float,
    min_coherence: float = 0.5,
    tolerance: float = STEP_TOLERANCE_PX,
    max_step: float = MAX_STEP_PX,
    both_ways: bool = True,
    aligned: bool = True,
    wander: float = 0.0,
    bend: float = BEND_PX,
    key: int = 0,
) -> NDArray[np.float64]:
    """The tract through `seed` (x, y), as (n, 2) points in photo pixels; n = 1 if it goes nowhere.

    `max_length` bounds the whole tract; followed both ways, each way takes at most half of it.
    `aligned=False` interpolates the signed vectors as they are (only to reproduce published pictures).
    `wander` > 0 draws the heading from that part of the orientation's uncertainty, anew about every `bend`
    pixels; another `key` is another draw.
    """
    points = np.empty((tract_capacity(max_length), 2))
    first, last = trace(
        field.samples, field.scale, field.width, field.height, seed[0], seed[1],
        max_length, min_coherence, tolerance, max_step, both_ways, aligned,
        wander, bend, np.uint64(key % 2**64), points,
    )  # fmt: skip
    return points[first:last].copy()


def tract_capacity(max_length: float) -> int:
    """Points that a tract may have: room for steps of half a pixel on average, and it ends when they are used up."""
    return 2 * (int(2 * max_length) + 32) + 1


class Course(NamedTuple):
    """What a tract follows, and how."""

    samples: NDArray[np.float32]
    scale: float
    width: int
    height: int
    min_coherence: float
    tolerance: float
    max_step: float
    aligned: bool
    wander: float
    bend: float
    key: np.uint64


class Way(NamedTuple):
    """How far a tract is on one of its two ways from the seed."""

    goes: bool
    """It has not come to the border, to incoherence, or to a place without direction."""
    at: int
    """Where its last point stands."""
    x: float
    y: float
    ux: float
    uy: float
    """The orientation there …"""
    kx: float
    ky: float
    """… and where the tract goes: the same, unless it wanders."""
    step: float
    """The next one's length, unless `reach` is nearer."""
    travelled: float
    free: bool
    """No step has been cut short by `reach`."""


@leaf
def trace(
    samples: NDArray[np.float32],
    scale: float,
    width: int,
    height: int,
    x: float,
    y: float,
    max_length: float,
    min_coherence: float,
    tolerance: float,
    max_step: float,
    both_ways: bool,
    aligned: bool,
    wander: float,
    bend: float,
    key: np.uint64,
    points: NDArray[np.float64],
) -> tuple[int, int]:
    """Fill points[first:last] with the tract through (x, y); return (first, last).

    `wander` in 0..1, `bend` in pixels and `key` are the deviation's (see above); with wander 0 they do nothing.
    """
    course = Course(samples, scale, width, height, min_coherence, tolerance, max_step, aligned, wander, bend, key)
    ahead, back = depart(course, x, y, both_ways, points)
    first, last, _, _ = travel(course, ahead, back, 0.5 * max_length if both_ways else max_length, points)
    return first, last


@leaf
def depart(course: Course, x: float, y: float, both_ways: bool, points: NDArray[np.float64]) -> tuple[Way, Way]:
    """The two ways of the tract through (x, y), which becomes the middle one of `points`."""
    samples, scale = course.samples, course.scale
    middle = points.shape[0] // 2
    points[middle, 0], points[middle, 1] = x, y
    x, y = points[middle, 0], points[middle, 1]  # floats, whatever was given
    rows, cols = samples.shape[0], samples.shape[1]
    j = min(max(int(x / scale), 0), cols - 1)
    i = min(max(int(y / scale), 0), rows - 1)
    ux, uy = float(samples[i, j, 0]), float(samples[i, j, 1])
    return _departing(course, middle, x, y, ux, uy, True), _departing(course, middle, x, y, -ux, -uy, both_ways)


@leaf
def _departing(course: Course, at: int, x: float, y: float, hx: float, hy: float, goes: bool) -> Way:
    ux, uy, coherence = sample(course.samples, course.scale, course.aligned, x, y, hx, hy)
    kx, ky = _deviated(ux, uy, coherence, course.wander, course.bend, course.key, 0.0)
    goes = goes and not (coherence < course.min_coherence or (kx == 0.0 and ky == 0.0))
    return Way(goes, at, x, y, ux, uy, kx, ky, float(course.max_step), 0.0, True)


@leaf
def travel(
    course: Course, ahead: Way, back: Way, reach: float, points: NDArray[np.float64]
) -> tuple[int, int, Way, Way]:
    """Follow the two ways to the arc length `reach` from the seed, or to their ends; the tract is points[first:last].

    Returns (first, last, ahead, back), the ways as far as they go whatever the reach: from there they can be followed
    on to a greater one, and the tract is the same as if that had been asked for at once.
    """
    sure_ahead, sure_back = ahead, back
    # The ways know nothing of each other: side by side, the processor works on one while it waits for the other.
    while _goes_on(ahead, reach, points, 1) and _goes_on(back, reach, points, -1):
        if ahead.free:
            sure_ahead = ahead
        if back.free:
            sure_back = back
        ahead, back = _both_onward(course, ahead, back, reach, points)
    while _goes_on(ahead, reach, points, 1):
        if ahead.free:
            sure_ahead = ahead
        ahead = _onward(course, ahead, reach, points, 1)
    while _goes_on(back, reach, points, -1):
        if back.free:
            sure_back = back
        back = _onward(course, back, reach, points, -1)
    return back.at, ahead.at + 1, ahead if ahead.free else sure_ahead, back if back.free else sure_back


@inlined
def _goes_on(way: Way, reach: float, points: NDArray[np.float64], stride: int) -> bool:
    end = points.shape[0] - 1 if stride > 0 else 0
    return way.goes and way.travelled < reach and way.at != end


@inlined
def _both_onward(course: Course, ahead: Way, back: Way, reach: float, points: NDArray[np.float64]) -> tuple[Way, Way]:
    """`_onward` on both ways, stage by stage."""
    step_a, step_b = min(ahead.step, reach - ahead.travelled), min(back.step, reach - back.travelled)
    a2x, a2y = _stage(course, ahead, step_a, 0.5, ahead.kx, ahead.ky, 1)
    b2x, b2y = _stage(course, back, step_b, 0.5, back.kx, back.ky, -1)
    a3x, a3y = _stage(course, ahead, step_a, 0.75, a2x, a2y, 1)
    b3x, b3y = _stage(course, back, step_b, 0.75, b2x, b2y, -1)
    ax, ay = _landing(ahead, step_a, a2x, a2y, a3x, a3y)
    bx, by = _landing(back, step_b, b2x, b2y, b3x, b3y)
    aux, auy, coherence_a = sample(course.samples, course.scale, course.aligned, ax, ay, ahead.ux, ahead.uy)
    bux, buy, coherence_b = sample(course.samples, course.scale, course.aligned, bx, by, back.ux, back.uy)
    return (
        _arrived(course, ahead, step_a, reach, a2x, a2y, a3x, a3y, ax, ay, aux, auy, coherence_a, points, 1),
        _arrived(course, back, step_b, reach, b2x, b2y, b3x, b3y, bx, by, bux, buy, coherence_b, points, -1),
    )


@inlined
def _onward(course: Course, way: Way, reach: float, points: NDArray[np.float64], stride: int) -> Way:
    """A way after one step more is tried; its point goes to points[way.at + stride], with stride ±1."""
    step = min(way.step, reach - way.travelled)
    k2x, k2y = _stage(course, way, step, 0.5, way.kx, way.ky, stride)
    k3x, k3y = _stage(course, way, step, 0.75, k2x, k2y, stride)
    nx, ny = _landing(way, step, k2x, k2y, k3x, k3y)
    ux, uy, coherence = sample(course.samples, course.scale, course.aligned, nx, ny, way.ux, way.uy)
    return _arrived(course, way, step, reach, k2x, k2y, k3x, k3y, nx, ny, ux, uy, coherence, points, stride)


@inlined
def _stage(
    course: Course, way: Way, step: float, part: float, kx: float, ky: float, stride: int
) -> tuple[float, float]:
    """Where the tract goes at that part of a step in direction k. The heading of all stages is that of its start."""
    x, y = way.x + part * step * kx, way.y + part * step * ky
    ux, uy, coherence = sample(course.samples, course.scale, course.aligned, x, y, way.ux, way.uy)
    s = stride * (way.travelled + part * step)
    return _deviated(ux, uy, coherence, course.wander, course.bend, course.key, s)


@inlined
def _landing(way: Way, step: float, k2x: float, k2y: float, k3x: float, k3y: float) -> tuple[float, float]:
    return (
        way.x + step * (2.0 * way.kx + 3.0 * k2x + 4.0 * k3x) / 9.0,
        way.y + step * (2.0 * way.ky + 3.0 * k2y + 4.0 * k3y) / 9.0,
    )


@inlined
def _arrived(
    course: Course,
    way: Way,
    step: float,
    reach: float,
    k2x: float,
    k2y: float,
    k3x: float,
    k3y: float,
    nx: float,
    ny: float,
    ux: float,
    uy: float,
    coherence: float,
    points: NDArray[np.float64],
    stride: int,
) -> Way:
    """A way after a step to (nx, ny), where the orientation is u: taken, or to be tried again shorter, or its last."""
    at, travelled, tolerance = way.at, way.travelled + step, course.tolerance
    free = way.free and step == way.step and travelled < reach
    k4x, k4y = _deviated(ux, uy, coherence, course.wander, course.bend, course.key, stride * travelled)
    ex = step * (-5.0 * way.kx + 6.0 * k2x + 8.0 * k3x - 9.0 * k4x) / 72.0
    ey = step * (-5.0 * way.ky + 6.0 * k2y + 8.0 * k3y - 9.0 * k4y) / 72.0
    error = np.sqrt(ex * ex + ey * ey)
    if error > tolerance and step > MIN_STEP_PX:
        shorter = max(step * _growth(tolerance, error), MIN_STEP_PX)
        return Way(True, at, way.x, way.y, way.ux, way.uy, way.kx, way.ky, shorter, way.travelled, free)
    inside = 0.0 <= nx <= course.width and 0.0 <= ny <= course.height
    ends = not inside or coherence < course.min_coherence
    if ends:
        nx, ny = _last_valid(course, way.x, way.y, way.kx * step, way.ky * step, nx, ny, k4x * step, k4y * step)
        if not (nx - way.x) ** 2 + (ny - way.y) ** 2 > 1e-4:
            return Way(False, at, way.x, way.y, way.ux, way.uy, way.kx, way.ky, step, way.travelled, free)
    at += stride
    points[at, 0], points[at, 1] = nx, ny
    if ends or (k4x == 0.0 and k4y == 0.0):
        return Way(False, at, nx, ny, ux, uy, k4x, k4y, step, travelled, free)
    # No root is needed to know that the longest step stays so if it could grow.
    if travelled < reach and (step < course.max_step or error > STEADY * tolerance):
        step = min(step * _growth(tolerance, error), course.max_step)
    return Way(True, at, nx, ny, ux, uy, k4x, k4y, step, travelled, free)


@leaf
def _growth(tolerance: float, error: float) -> float:
    """How many times as long as a step of this error the next one is."""
    return 5.0 if error == 0.0 else min(max(0.9 * (tolerance / error) ** (1.0 / 3.0), 0.2), 5.0)


@leaf
def _last_valid(
    course: Course,
    x0: float,
    y0: float,
    dx0: float,
    dy0: float,
    x1: float,
    y1: float,
    dx1: float,
    dy1: float,
) -> tuple[float, float]:
    """Where on the step's Hermite cubic the tract leaves the photo or its coherence, to 1/256 of the step."""
    low, high = 0.0, 1.0
    bx, by = x0, y0
    for _ in range(8):
        s = 0.5 * (low + high)
        h00, h01 = (1 + 2 * s) * (1 - s) * (1 - s), s * s * (3 - 2 * s)
        h10, h11 = s * (1 - s) * (1 - s), s * s * (s - 1)
        x = h00 * x0 + h10 * dx0 + h01 * x1 + h11 * dx1
        y = h00 * y0 + h10 * dy0 + h01 * y1 + h11 * dy1
        inside = 0.0 <= x <= course.width and 0.0 <= y <= course.height
        if inside and sample(course.samples, course.scale, course.aligned, x, y, dx0, dy0)[2] >= course.min_coherence:
            low, bx, by = s, x, y
        else:
            high = s
    return bx, by


@inlined
def sample(
    samples: NDArray[np.float32], scale: float, aligned: bool, x: float, y: float, hx: float, hy: float
) -> tuple[float, float, float]:
    """Bilinear (ux, uy, coherence) at photo position (x, y), of unit length and turned towards (hx, hy).

    (0, 0) where the four neighbours cancel. Outside the outermost samples the field is constant.
    """
    rows, cols = samples.shape[0], samples.shape[1]
    per_px = 1.0 / scale
    fx = min(max(x * per_px - 0.5, 0.0), cols - 1.0)
    fy = min(max(y * per_px - 0.5, 0.0), rows - 1.0)
    j0, i0 = max(int(fx), 0), max(int(fy), 0)
    j1, i1 = j0 + (1 if j0 + 1 < cols else 0), i0 + (1 if i0 + 1 < rows else 0)
    tx, ty = fx - j0, fy - i0
    ux, uy, coherence = _added(samples, i0, j0, (1.0 - tx) * (1.0 - ty), aligned, hx, hy, 0.0, 0.0, 0.0)
    ux, uy, coherence = _added(samples, i0, j1, tx * (1.0 - ty), aligned, hx, hy, ux, uy, coherence)
    ux, uy, coherence = _added(samples, i1, j0, (1.0 - tx) * ty, aligned, hx, hy, ux, uy, coherence)
    ux, uy, coherence = _added(samples, i1, j1, tx * ty, aligned, hx, hy, ux, uy, coherence)
    norm = np.sqrt(ux * ux + uy * uy)
    if norm < 1e-9:
        return 0.0, 0.0, coherence
    if ux * hx + uy * hy < 0.0:
        norm = -norm
    return ux / norm, uy / norm, coherence


@inlined
def _added(
    samples: NDArray[np.float32],
    i: int,
    j: int,
    weight: float,
    aligned: bool,
    hx: float,
    hy: float,
    ux: float,
    uy: float,
    coherence: float,
) -> tuple[float, float, float]:
    """A bilinear sum with what sample (i, j) adds to it."""
    vx, vy = float(samples[i, j, 0]), float(samples[i, j, 1])
    coherence += weight * samples[i, j, 2]
    if aligned and vx * hx + vy * hy < 0.0:
        weight = -weight
    return ux + weight * vx, uy + weight * vy, coherence


@inlined
def _deviated(
    ux: float, uy: float, coherence: float, wander: float, bend: float, key: np.uint64, s: float
) -> tuple[float, float]:
    """The direction of a tract that wanders, at arc length `s` from its seed (below 0 on the way back)."""
    if wander == 0.0:
        return ux, uy
    uncertainty = MAX_UNCERTAINTY
    if coherence > 0.0:
        uncertainty = min(0.5 * np.sqrt(max(-np.log(coherence), 0.0)), MAX_UNCERTAINTY)
    angle = min(max(wander * uncertainty * _process(key, s / bend), -MAX_DEVIATION), MAX_DEVIATION)
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * ux - sin * uy, sin * ux + cos * uy


@leaf
def _process(key: np.uint64, s: float) -> float:
    """A smooth random function of s, standard normal at every s; independent at distances of 2 and more."""
    knot = int(np.floor(s))
    t = s - knot
    angle = 0.5 * np.pi * t * t * (3.0 - 2.0 * t)
    return float(np.cos(angle) * _normal(key, knot) + np.sin(angle) * _normal(key, knot + 1))


@leaf
def _normal(key: np.uint64, n: int) -> float:
    """Number n (of any sign) of a key's standard normal numbers: Box and Muller's method on two uniform ones."""
    first = np.uint64(2 * n)
    one = uniform(key, first) + 2.0**-53  # in (0, 1]: it has a logarithm
    two = uniform(key, first + np.uint64(1))
    return float(np.sqrt(-2.0 * np.log(one)) * np.cos(2.0 * np.pi * two))


@leaf
def uniform(key: np.uint64, n: np.uint64) -> float:
    """Number n of a key's random numbers, in [0, 1)."""
    return float(splitmix64(key, n) >> np.uint64(11)) * 2.0**-53


@leaf
def splitmix64(key: np.uint64, n: np.uint64) -> np.uint64:
    """Number n of the generator SplitMix64 seeded with `key` (Steele, Lea and Flood 2014), without those before it."""
    z = key + (n + np.uint64(1)) * _GAMMA
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    return z ^ (z >> np.uint64(31))
