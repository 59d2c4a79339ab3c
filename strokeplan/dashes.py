"""Short strokes of one pen for tones too light for lines, and for what lines leave too light.

Each place is asked whether it is lighter than it should be, and gets a stroke along the field if it is: first
the places that see no ink at all, then those that see a little, and so on (void filling, as blue-noise halftones
are made: Ulichney 1993). How much ink a place sees is a Gaussian mean over an area that holds about one stroke of
its own tone (so far apart in highlights, so near in middle tones), so the strokes keep their distance from each
other. The order is a random permutation of the seed.

Coordinates are millimetres of the picture: x right, y down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.hatching import STEP_MM
from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.linework import NO_LINES, Lines
from strokeplan.tractography import sample

LEVELS = (0.9, 0.75, 0.6, 0.5, 0.4, 0.3)
"""What a place must lack, in parts of its demand, round after round."""
REACH = 0.6
"""Standard deviation of the mean, in sides of the square that holds one stroke."""
LEAST_DEMAND = 0.004
"""A place that lacks less ink than this needs no stroke."""


def dash(
    directions: NDArray[np.float32],
    spacing_mm: float,
    demand: NDArray[np.float32],
    pixel_mm: float,
    size_mm: tuple[float, float],
    width_mm: float,
    *,
    shortest_mm: float,
    longest_mm: float,
    full: float,
    seed: int,
) -> Lines:
    """Strokes that cover the part `demand` (rows, columns) float32 of each pixel of `pixel_mm`.

    They are `shortest_mm` long where the demand is 0, and `longest_mm` where it is `full`. `directions` are as
    `hatch` has them; `size_mm` is that of the picture, which no stroke leaves.
    """
    wanted = np.flatnonzero(demand.ravel() > LEAST_DEMAND)
    if not len(wanted):
        return NO_LINES
    order = np.random.default_rng(seed).permutation(wanted)
    share = np.minimum(demand / np.float32(full), 1)
    lengths = (shortest_mm + (longest_mm - shortest_mm) * share).astype(np.float32)
    sigma = REACH * np.sqrt((lengths + width_mm) * np.float32(width_mm) / np.maximum(demand, LEAST_DEMAND))
    most = len(wanted) * len(LEVELS)
    vertices = int(longest_mm / STEP_MM) + 3
    points = np.empty((min(most * vertices, 20_000_000), 2))
    starts = np.zeros(most + 1, np.int64)
    count = _dash(
        directions, spacing_mm, demand, lengths, sigma.astype(np.float32), float(sigma.max()), pixel_mm, *size_mm,
        width_mm, order, np.array(LEVELS), np.zeros_like(demand), points, starts,
    )  # fmt: skip
    return Lines(points[: starts[count]].copy(), starts[: count + 1].copy())


def compiled() -> bool:
    """Whether the kernel is in Numba's cache."""
    return is_cached(_dash)


@kernel
def _dash(
    directions: NDArray[np.float32],
    spacing: float,
    demand: NDArray[np.float32],
    lengths: NDArray[np.float32],
    sigma: NDArray[np.float32],
    widest: float,
    pixel: float,
    right: float,
    bottom: float,
    width: float,
    order: NDArray[np.int64],
    levels: NDArray[np.float64],
    seen: NDArray[np.float32],
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
) -> int:
    """Fill points and starts; return the number of strokes."""
    columns, count = demand.shape[1], 0
    for level in levels:
        for place in order:
            i, j = place // columns, place % columns
            if demand[i, j] - seen[i, j] <= level * demand[i, j]:
                continue
            at = starts[count]
            half = max(int(0.5 * lengths[i, j] / STEP_MM + 0.5), 1)
            if at + 2 * half + 1 > len(points):
                return count
            x, y = min((j + 0.5) * pixel, right), min((i + 0.5) * pixel, bottom)
            follow(directions, spacing, x, y, half, points, at + half, 1, right, bottom)
            follow(directions, spacing, x, y, half, points, at + half, -1, right, bottom)
            starts[count + 1] = at + 2 * half + 1
            ink = width * (2 * half * STEP_MM + 0.785 * width) / (2 * half + 1)
            reach = 2.5 * min(widest, 3.0 * sigma[i, j])
            for k in range(at, starts[count + 1]):
                _see(sigma, pixel, reach, points[k, 0], points[k, 1], ink, seen)
            count += 1
    return count


@leaf
def follow(
    directions: NDArray[np.float32],
    spacing: float,
    x: float,
    y: float,
    steps: int,
    points: NDArray[np.float64],
    at: int,
    stride: int,
    right: float,
    bottom: float,
) -> None:
    """`steps` points along the field from index `at` on, by `stride` (±1).

    Where they would leave 0 … `right` × 0 … `bottom` they stay: whoever simplifies the line drops what is the same.
    """
    ux, uy, _ = sample(directions, spacing, False, x, y, 1.0, 0.0)
    ux, uy = stride * ux, stride * uy
    points[at, 0], points[at, 1] = x, y
    for _ in range(steps):
        ux, uy, _ = sample(directions, spacing, True, x + 0.5 * STEP_MM * ux, y + 0.5 * STEP_MM * uy, ux, uy)
        if 0.0 <= x + STEP_MM * ux <= right and 0.0 <= y + STEP_MM * uy <= bottom:
            x, y = x + STEP_MM * ux, y + STEP_MM * uy
        at += stride
        points[at, 0], points[at, 1] = x, y


@leaf
def _see(
    sigma: NDArray[np.float32],
    pixel: float,
    reach: float,
    x: float,
    y: float,
    ink: float,
    seen: NDArray[np.float32],
) -> None:
    """Let the places around (x, y) see some ink (mm²), each with its own Gaussian."""
    r = int(reach / pixel) + 1
    j0, i0 = int(np.floor(x / pixel)), int(np.floor(y / pixel))
    for i in range(max(i0 - r, 0), min(i0 + r + 1, seen.shape[0])):
        dy = (i + 0.5) * pixel - y
        for j in range(max(j0 - r, 0), min(j0 + r + 1, seen.shape[1])):
            dx = (j + 0.5) * pixel - x
            inverse = 1.0 / (sigma[i, j] * sigma[i, j])
            q = 0.5 * (dx * dx + dy * dy) * inverse
            if q < 6.0:
                seen[i, j] += ink * inverse / (2.0 * np.pi) * np.exp(-q)
