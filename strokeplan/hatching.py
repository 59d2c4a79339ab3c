"""Lines of one pen that follow an orientation field, as far apart as the tone asks for.

Jobard and Lefer's evenly spaced streamlines ("Creating Evenly-Spaced Streamlines of Arbitrary Density", 1997)
with a separation that varies over the picture: a line of width w every w / c covers the part c of the paper.
Lines grow from the sides of lines that are there, first come first served, so that neighbours run parallel; where
the picture has places that no line leads to, the darkest begin. A line ends where it comes too near to another,
where the tone asks for none, where the field bends more sharply than a hand would, or after one full turn, so
that nothing curls.

How near lines are is kept as a raster: for each pixel the squared distance of the nearest line in parts of the
separation that this pixel asks for. A line may begin where that is at least START², and goes on while it is at least
END².

Coordinates are millimetres of the picture: x right, y down.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.linework import NO_LINES, Lines
from strokeplan.tractography import sample

START, END = 0.88, 0.66
"""Least distance from other lines, in parts of the separation. With both the mean distance comes out at about the
separation: a line fits into a gap of twice the one and leaves it at twice the other."""
STEP_MM = 0.15
"""Length of one step along the field (midpoint rule)."""
SEED_STEPS = 3
"""Lines are tried beside every so many steps of a line."""
MAX_TURN = np.pi
"""How far a line turns on either side of its seed: once round in all."""
WIDE = 4
"""Pixels a side of the patches for which the widest separation is known."""
CELL_MM = 0.6
"""Side of the cells in which lines begin that no other line leads to."""


def hatch(
    directions: NDArray[np.float32],
    spacing_mm: float,
    separation: NDArray[np.float32],
    pixel_mm: float,
    *,
    min_length_mm: float,
    max_length_mm: float,
    min_radius_mm: float,
) -> Lines:
    """Evenly spaced lines along `directions` (h, w, 3: unit vector, coherence; one sample every `spacing_mm`).

    `separation` (rows, columns) float32 is the distance of lines in mm at each pixel of `pixel_mm`; 0: no line.
    """
    rows, columns = separation.shape
    drawn = separation > 0
    if not drawn.any():
        return NO_LINES
    # Each line takes END × separation on either side to itself, so that their length has a bound.
    bound = pixel_mm * pixel_mm * float((1.0 / separation[drawn]).sum()) / (END * STEP_MM)
    points = np.empty((int(4.0 * bound) + 10_000, 2))
    starts = np.empty(len(points) // 4 + 2, np.int64)
    with np.errstate(divide="ignore"):
        inverse = separation ** np.float32(-2)  # infinite where no line is asked for: nobody asks there
    count = _hatch(
        directions, spacing_mm, separation, inverse, pixel_mm, _widest(separation, pixel_mm),
        _origins(separation, pixel_mm), min_length_mm, max_length_mm, STEP_MM / min_radius_mm,
        np.full((rows, columns), 1e9, np.float32), points, starts,
    )  # fmt: skip
    return Lines(points[: starts[count]].copy(), starts[: count + 1].copy())


def _widest(separation: NDArray[np.float32], pixel_mm: float) -> NDArray[np.float32]:
    """For each patch of WIDE × WIDE pixels the largest separation that a line through it must tell of."""
    from scipy.ndimage import maximum_filter

    rows, columns = separation.shape
    padded = np.pad(separation, ((0, -rows % WIDE), (0, -columns % WIDE)))
    across = reduce(np.maximum, (padded[k::WIDE] for k in range(WIDE)))
    patches = reduce(np.maximum, (across[:, k::WIDE] for k in range(WIDE)))
    reach = int(START * separation.max() / pixel_mm / WIDE) + 1
    widest: NDArray[np.float32] = maximum_filter(patches, size=2 * reach + 1, mode="nearest")
    return widest


def _origins(separation: NDArray[np.float32], pixel_mm: float) -> NDArray[np.float64]:
    """(n, 2) places in mm at which a line may begin by itself: one a cell, the densest first."""
    cell = max(round(CELL_MM / pixel_mm), 1)
    middles = separation[cell // 2 :: cell, cell // 2 :: cell]
    order = np.argsort(middles, axis=None, kind="stable")
    order = order[middles.ravel()[order] > 0]
    i, j = np.divmod(order, middles.shape[1])
    return np.stack([(j * cell + cell // 2 + 0.5) * pixel_mm, (i * cell + cell // 2 + 0.5) * pixel_mm], axis=1)


def compiled() -> bool:
    """Whether the kernel is in Numba's cache."""
    return is_cached(_hatch)


@kernel
def _hatch(
    directions: NDArray[np.float32],
    spacing: float,
    separation: NDArray[np.float32],
    inverse: NDArray[np.float32],
    pixel: float,
    widest: NDArray[np.float32],
    origins: NDArray[np.float64],
    min_length: float,
    max_length: float,
    max_bend: float,
    clear: NDArray[np.float32],
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
) -> int:
    """Fill points and starts; return the number of lines."""
    half = int(0.5 * max_length / STEP_MM) + 1
    path = np.empty((2 * half + 1, 2))
    count, served, origin = 0, 0, 0
    starts[0] = 0
    while True:
        if served < count:
            # Both sides of the next line in turn.
            first, last = starts[served], starts[served + 1]
            served += 1
            for k in range(first, last, SEED_STEPS):
                a, b = max(k - 1, first), min(k + 1, last - 1)
                tx, ty = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
                norm = np.sqrt(tx * tx + ty * ty)
                if norm == 0.0:
                    continue
                for side in (1.0, -1.0):
                    own = _at(separation, pixel, points[k, 0], points[k, 1])
                    x, y = points[k, 0] - side * own * ty / norm, points[k, 1] + side * own * tx / norm
                    there = _at(separation, pixel, x, y)
                    if there > 1.3 * own or there < 0.8 * own:  # the tone changes: as far as both ask for
                        own = 0.5 * (own + there)
                        x, y = points[k, 0] - side * own * ty / norm, points[k, 1] + side * own * tx / norm
                    count = _try_line(
                        directions, spacing, separation, inverse, pixel, widest, x, y, min_length, half, max_bend,
                        clear, path, points, starts, count,
                    )  # fmt: skip
        elif origin < len(origins):
            count = _try_line(
                directions, spacing, separation, inverse, pixel, widest, origins[origin, 0], origins[origin, 1],
                min_length, half, max_bend, clear, path, points, starts, count,
            )  # fmt: skip
            origin += 1
        else:
            return count


@leaf
def _at(image: NDArray[np.float32], pixel: float, x: float, y: float) -> float:
    """The value of the pixel at (x, y) in mm; 0 outside."""
    i, j = int(np.floor(y / pixel)), int(np.floor(x / pixel))
    if i < 0 or j < 0 or i >= image.shape[0] or j >= image.shape[1]:
        return 0.0
    return float(image[i, j])


@leaf
def _try_line(
    directions: NDArray[np.float32],
    spacing: float,
    separation: NDArray[np.float32],
    inverse: NDArray[np.float32],
    pixel: float,
    widest: NDArray[np.float32],
    x: float,
    y: float,
    min_length: float,
    half: int,
    max_bend: float,
    clear: NDArray[np.float32],
    path: NDArray[np.float64],
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    count: int,
) -> int:
    """Add the line through (x, y) if there is room for one that is long enough; return the number of lines."""
    if _at(separation, pixel, x, y) <= 0.0 or _at(clear, pixel, x, y) < START * START:
        return count
    first, last = half, half
    path[half, 0], path[half, 1] = x, y
    last = _follow(directions, spacing, separation, pixel, max_bend, clear, path, half, 1)
    first = _follow(directions, spacing, separation, pixel, max_bend, clear, path, half, -1)
    n, at = last - first + 1, starts[count]
    if (n - 1) * STEP_MM < min_length or at + n > len(points) or count + 2 > len(starts) - 1:
        return count
    for k in range(n):
        points[at + k, 0], points[at + k, 1] = path[first + k, 0], path[first + k, 1]
        if k % 2 == 0 or k == n - 1:  # twice a step is still far below the separation
            _stamp(inverse, pixel, widest, path[first + k, 0], path[first + k, 1], clear)
    starts[count + 1] = at + n
    return count + 1


@leaf
def _follow(
    directions: NDArray[np.float32],
    spacing: float,
    separation: NDArray[np.float32],
    pixel: float,
    max_bend: float,
    clear: NDArray[np.float32],
    path: NDArray[np.float64],
    at: int,
    stride: int,
) -> int:
    """Append points to path from index `at` on, by `stride` (±1); return the index of the last one."""
    x, y = path[at, 0], path[at, 1]
    ux, uy, _ = sample(directions, spacing, False, x, y, 1.0, 0.0)
    ux, uy, turned = stride * ux, stride * uy, 0.0
    end = path.shape[0] - 1 if stride > 0 else 0
    while at != end:
        ax, ay, _ = sample(directions, spacing, True, x, y, ux, uy)
        mx, my, _ = sample(directions, spacing, True, x + 0.5 * STEP_MM * ax, y + 0.5 * STEP_MM * ay, ax, ay)
        if mx == 0.0 and my == 0.0:
            return at
        if at != path.shape[0] // 2:
            bend = np.arctan2(ux * my - uy * mx, ux * mx + uy * my)
            turned += bend
            if abs(bend) > max_bend or abs(turned) > MAX_TURN:
                return at
        x, y, ux, uy = x + STEP_MM * mx, y + STEP_MM * my, mx, my
        if _at(separation, pixel, x, y) <= 0.0 or _at(clear, pixel, x, y) < END * END:
            return at
        at += stride
        path[at, 0], path[at, 1] = x, y
    return at


@leaf
def _stamp(
    inverse: NDArray[np.float32],
    pixel: float,
    widest: NDArray[np.float32],
    x: float,
    y: float,
    clear: NDArray[np.float32],
) -> None:
    """Tell the pixels around (x, y) that a line passes there, as far as one of them may ask."""
    j0, i0 = int(x / pixel), int(y / pixel)
    reach = int(START * widest[i0 // WIDE, j0 // WIDE] / pixel) + 1
    left, right = max(j0 - reach, 0), min(j0 + reach + 1, clear.shape[1])
    scale, begin = np.float32(pixel), np.float32((left + 0.5) * pixel - x)
    for i in range(max(i0 - reach, 0), min(i0 + reach + 1, clear.shape[0])):
        dy = np.float32((i + 0.5) * pixel - y)
        across = dy * dy
        asked, told = inverse[i, left:right], clear[i, left:right]
        for j in range(right - left):
            dx = begin + np.float32(j) * scale
            told[j] = min(told[j], (dx * dx + across) * asked[j])
