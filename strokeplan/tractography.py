"""Streamlines through an orientation field: dr/ds = u(r) by RK2(3) (paper, "Primer on DTI").

Bogacki–Shampine's embedded pair of orders 2 and 3 with an explicit error tolerance per step. An
eigenvector has no sign, so the four neighbours of a point are turned to agree with the heading before
they are interpolated, and the heading changes only when a step is accepted. A tract ends at its maximum
length, at the border of the photo, or where the coherence falls below the threshold; the last two are
located on the step by bisection. No step is longer than `max_step`, so that a tract cannot leap
across a band of incoherence.

Positions are photo coordinates: x right, y down, pixel (i, j) covers [j, j + 1] × [i, i + 1].

Known limit: a tract on a closed curve goes round until its length is used up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.field import OrientationField
from strokeplan.jit import kernel

STEP_TOLERANCE_PX = 0.05
"""Default largest estimated error of one accepted step. With it the tracts of rings of radius 10 px and
more stay circles to 0.1 px; a smaller value costs time and moves nothing that a pen could show."""
MAX_STEP_PX = 2.0
"""Default longest step: narrower bands of incoherence than this may be crossed."""
MIN_STEP_PX = 0.05
"""A rejected step is never shortened below this: at a singular point no step is short enough."""


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
) -> NDArray[np.float64]:
    """The tract through `seed` (x, y), as (n, 2) points in photo pixels; n = 1 if it goes nowhere.

    `max_length` bounds the whole tract; followed both ways, each way takes at most half of it.
    `aligned=False` interpolates the signed vectors as they are (only to reproduce published pictures).
    """
    points = np.empty((tract_capacity(max_length), 2))
    first, last = trace(
        field.samples, field.scale, field.width, field.height, seed[0], seed[1],
        max_length, min_coherence, tolerance, max_step, both_ways, aligned, points,
    )  # fmt: skip
    return points[first:last].copy()


def tract_capacity(max_length: float) -> int:
    """Points that a tract may have: room for steps of half a pixel on average, and it ends when they are used up."""
    return 2 * (int(2 * max_length) + 32) + 1


@kernel
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
    points: NDArray[np.float64],
) -> tuple[int, int]:
    """Fill points[first:last] with the tract through (x, y); return (first, last)."""
    middle = points.shape[0] // 2
    points[middle, 0], points[middle, 1] = x, y
    rows, cols = samples.shape[0], samples.shape[1]
    j = min(max(int(x / scale), 0), cols - 1)
    i = min(max(int(y / scale), 0), rows - 1)
    ux, uy = float(samples[i, j, 0]), float(samples[i, j, 1])
    reach = 0.5 * max_length if both_ways else max_length
    last = _follow(
        samples, scale, width, height, ux, uy, reach, min_coherence, tolerance, max_step, aligned,
        points, middle, 1,
    )  # fmt: skip
    first = middle
    if both_ways:
        first = _follow(
            samples, scale, width, height, -ux, -uy, reach, min_coherence, tolerance, max_step, aligned,
            points, middle, -1,
        )  # fmt: skip
    return first, last + 1


@kernel
def _follow(
    samples: NDArray[np.float32],
    scale: float,
    width: int,
    height: int,
    heading_x: float,
    heading_y: float,
    reach: float,
    min_coherence: float,
    tolerance: float,
    max_step: float,
    aligned: bool,
    points: NDArray[np.float64],
    at: int,
    stride: int,
) -> int:
    """Append points from index `at` on, by `stride` (±1); return the index of the last one."""
    x, y = points[at, 0], points[at, 1]
    k1x, k1y, coherence = sample(samples, scale, aligned, x, y, heading_x, heading_y)
    if coherence < min_coherence or (k1x == 0.0 and k1y == 0.0):
        return at
    step, travelled = max_step, 0.0
    end = points.shape[0] - 1 if stride > 0 else 0
    while travelled < reach and at != end:
        step = min(step, reach - travelled)
        # The heading of all three stages is that of the step's start.
        k2x, k2y, _ = sample(samples, scale, aligned, x + 0.5 * step * k1x, y + 0.5 * step * k1y, k1x, k1y)
        k3x, k3y, _ = sample(samples, scale, aligned, x + 0.75 * step * k2x, y + 0.75 * step * k2y, k1x, k1y)
        nx = x + step * (2.0 * k1x + 3.0 * k2x + 4.0 * k3x) / 9.0
        ny = y + step * (2.0 * k1y + 3.0 * k2y + 4.0 * k3y) / 9.0
        k4x, k4y, coherence = sample(samples, scale, aligned, nx, ny, k1x, k1y)
        ex = step * (-5.0 * k1x + 6.0 * k2x + 8.0 * k3x - 9.0 * k4x) / 72.0
        ey = step * (-5.0 * k1y + 6.0 * k2y + 8.0 * k3y - 9.0 * k4y) / 72.0
        error = np.sqrt(ex * ex + ey * ey)
        growth = 5.0 if error == 0.0 else min(max(0.9 * (tolerance / error) ** (1.0 / 3.0), 0.2), 5.0)
        if error > tolerance and step > MIN_STEP_PX:
            step = max(step * growth, MIN_STEP_PX)
            continue
        inside = 0.0 <= nx <= width and 0.0 <= ny <= height
        if not inside or coherence < min_coherence:
            nx, ny = _last_valid(
                samples, scale, width, height, aligned, min_coherence, x, y, k1x * step, k1y * step,
                nx, ny, k4x * step, k4y * step,
            )  # fmt: skip
            if (nx - x) ** 2 + (ny - y) ** 2 > 1e-4:
                at += stride
                points[at, 0], points[at, 1] = nx, ny
            return at
        at += stride
        points[at, 0], points[at, 1] = nx, ny
        if k4x == 0.0 and k4y == 0.0:
            return at
        x, y, k1x, k1y = nx, ny, k4x, k4y
        travelled += step
        step = min(step * growth, max_step)
    return at


@kernel
def _last_valid(
    samples: NDArray[np.float32],
    scale: float,
    width: int,
    height: int,
    aligned: bool,
    min_coherence: float,
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
        inside = 0.0 <= x <= width and 0.0 <= y <= height
        if inside and sample(samples, scale, aligned, x, y, dx0, dy0)[2] >= min_coherence:
            low, bx, by = s, x, y
        else:
            high = s
    return bx, by


@kernel
def sample(
    samples: NDArray[np.float32], scale: float, aligned: bool, x: float, y: float, hx: float, hy: float
) -> tuple[float, float, float]:
    """Bilinear (ux, uy, coherence) at photo position (x, y), of unit length and turned towards (hx, hy).

    (0, 0) where the four neighbours cancel. Outside the outermost samples the field is constant.
    """
    rows, cols = samples.shape[0], samples.shape[1]
    fx = min(max(x / scale - 0.5, 0.0), cols - 1.0)
    fy = min(max(y / scale - 0.5, 0.0), rows - 1.0)
    j0, i0 = int(fx), int(fy)
    j1, i1 = min(j0 + 1, cols - 1), min(i0 + 1, rows - 1)
    tx, ty = fx - j0, fy - i0
    ux, uy, coherence = 0.0, 0.0, 0.0
    for i, wy in ((i0, 1.0 - ty), (i1, ty)):
        for j, wx in ((j0, 1.0 - tx), (j1, tx)):
            vx, vy = float(samples[i, j, 0]), float(samples[i, j, 1])
            weight = wx * wy
            coherence += weight * samples[i, j, 2]
            if aligned and vx * hx + vy * hy < 0.0:
                weight = -weight
            ux += weight * vx
            uy += weight * vy
    norm = np.sqrt(ux * ux + uy * uy)
    if norm < 1e-9:
        return 0.0, 0.0, coherence
    if ux * hx + uy * hy < 0.0:
        norm = -norm
    return ux / norm, uy / norm, coherence
