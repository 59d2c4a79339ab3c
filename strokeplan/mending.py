"""Short strokes where lines have left a drawing too light, each accepted for what it improves.

The drawing and its photo are compared as an eye sees them, both blurred in linear light, in lightness L*. A stroke
is tried along the field in the gap between lines, and is kept if the sum of squared differences around it falls.
Its blurred ink is the sum of Gaussians along it, of what is still bare paper there.

Coordinates are millimetres of the picture: x right, y down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.dashes import follow
from strokeplan.hatching import STEP_MM
from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.linework import Lines

LEAST_LIGHTER = 1.5
"""L* by which a place must be lighter than its photo before a stroke is tried."""
MOST_COVERED = 0.4
"""A stroke that lies on more ink than this, on average, is in no gap."""
MARGIN = 0.02
"""Part of the squared difference around it that a stroke must take away."""


def mend(
    directions: NDArray[np.float32],
    spacing_mm: float,
    light: NDArray[np.float32],
    target: NDArray[np.float32],
    coverage: NDArray[np.float32],
    pixel_mm: float,
    size_mm: tuple[float, float],
    width_mm: float,
    *,
    sigma_mm: float,
    lengths_mm: tuple[float, ...],
    seed: int,
) -> Lines:
    """Strokes that bring a drawing nearer to its photo.

    `light` and `target` (rows, columns) are the linear light of drawing and photo, blurred by `sigma_mm`, and
    `coverage` the ink at each pixel of `pixel_mm` as it is; strokes are tried in order of `lengths_mm`.
    `directions` are as `hatch` has them; `size_mm` is that of the picture, which no stroke leaves.
    """
    order = np.random.default_rng(seed).permutation(light.size)
    steps = np.array([max(round(0.5 * length / STEP_MM), 1) for length in lengths_mm])
    points = np.empty((light.size * 2 + 100, 2))
    starts = np.zeros(light.size + 1, np.int64)
    count = _mend(
        directions, spacing_mm, light.copy(), target, coverage, pixel_mm, *size_mm, width_mm, sigma_mm, order, steps,
        np.zeros_like(light), points, starts,
    )  # fmt: skip
    return Lines(points[: starts[count]].copy(), starts[: count + 1].copy())


def compiled() -> bool:
    """Whether the kernel is in Numba's cache."""
    return is_cached(_mend)


@kernel
def _mend(
    directions: NDArray[np.float32],
    spacing: float,
    light: NDArray[np.float32],
    target: NDArray[np.float32],
    coverage: NDArray[np.float32],
    pixel: float,
    edge: float,
    floor: float,
    width: float,
    sigma: float,
    order: NDArray[np.int64],
    steps: NDArray[np.int64],
    ink: NDArray[np.float32],
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
) -> int:
    """Fill points and starts; return the number of strokes."""
    rows, columns = light.shape
    reach = int(2.5 * sigma / pixel) + 1
    count = 0
    for half in steps:
        for place in order:
            i, j = place // columns, place % columns
            if _lightness(light[i, j]) - _lightness(target[i, j]) < LEAST_LIGHTER:
                continue
            at, n = starts[count], 2 * half + 1
            if at + n > len(points) or count + 1 >= len(starts):
                return count
            x, y = min((j + 0.5) * pixel, edge), min((i + 0.5) * pixel, floor)
            follow(directions, spacing, x, y, half, points, at + half, 1, edge, floor)
            follow(directions, spacing, x, y, half, points, at + half, -1, edge, floor)
            bare = 0.0
            left, right, top, bottom = columns, 0, rows, 0
            for k in range(at, at + n):
                u = min(max(int(points[k, 1] / pixel), 0), rows - 1)
                v = min(max(int(points[k, 0] / pixel), 0), columns - 1)
                bare += 1.0 - coverage[u, v]
                left, right = min(left, max(v - reach, 0)), max(right, min(v + reach + 1, columns))
                top, bottom = min(top, max(u - reach, 0)), max(bottom, min(u + reach + 1, rows))
            bare /= n
            if bare < 1.0 - MOST_COVERED:
                continue
            mass = bare * width * (2 * half * STEP_MM + 0.785 * width) / n / (2.0 * np.pi * sigma * sigma)
            before, after = 0.0, 0.0
            for u in range(top, bottom):
                for v in range(left, right):
                    total = 0.0
                    for k in range(at, at + n, 2):
                        dx, dy = (v + 0.5) * pixel - points[k, 0], (u + 0.5) * pixel - points[k, 1]
                        q = 0.5 * (dx * dx + dy * dy) / (sigma * sigma)
                        if q < 5.0:
                            total += np.exp(-q)
                    ink[u, v] = total * mass * n / (half + 1)
                    wanted = _lightness(target[u, v])
                    before += (_lightness(light[u, v]) - wanted) ** 2
                    after += (_lightness(light[u, v] - ink[u, v]) - wanted) ** 2
            if after < (1.0 - MARGIN) * before:
                starts[count + 1] = at + n
                count += 1
                for u in range(top, bottom):
                    for v in range(left, right):
                        light[u, v] -= ink[u, v]
                for k in range(at, at + n):
                    u = min(max(int(points[k, 1] / pixel), 0), rows - 1)
                    v = min(max(int(points[k, 0] / pixel), 0), columns - 1)
                    coverage[u, v] = 1.0
    return count


@leaf
def _lightness(y: float) -> float:
    """CIE L* of the linear light y in 0..1."""
    if y <= 216.0 / 24389.0:
        return max(y, 0.0) * 24389.0 / 27.0
    return float(116.0 * np.cbrt(y) - 16.0)
