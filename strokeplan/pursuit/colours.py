"""Which packed colour stands for pixels: the mean of theirs by weight, or what may be used and is nearest to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed
from strokeplan.jit import inlined, leaf


def mean_colours(
    sums: NDArray[np.float64], colours: NDArray[np.uint32], choice: NDArray[np.uint32]
) -> NDArray[np.uint32]:
    """The colour that stands for each stroke's sums; its own where these are empty."""
    weights = sums[:, :1]
    means = packed_colours(np.divide(sums[:, 1:], weights, out=np.zeros((len(sums), 3)), where=weights > 0), choice)
    return np.where(weights[:, 0] > 0, means, colours)


def packed_colours(colours: NDArray[np.float64], choice: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The packed colours that stand for (n, 3) means."""
    packed = np.empty(len(colours), np.uint32)
    _pack_suited(colours, choice, packed)
    return packed


@inlined
def pixel(photo: Packed, weight: NDArray[np.float32], i: int, j: int) -> tuple[float, float, float, float]:
    """Weight, red, green and blue of the photo."""
    value = np.int64(photo[i, j])
    return float(weight[i, j]), float(value >> 16), float((value >> 8) & 255), float(value & 255)


@inlined
def suited(choice: NDArray[np.uint32], red: float, green: float, blue: float) -> np.uint32:
    """The packed colour that stands for a mean of colours."""
    r, g, b = int(red + 0.5), int(green + 0.5), int(blue + 0.5)
    if len(choice) > 0:
        return np.uint32(choice[((r >> 3) << 10) | ((g >> 3) << 5) | (b >> 3)])
    return np.uint32((r << 16) | (g << 8) | b)


@inlined
def squared_distance(a: np.uint32, b: np.uint32) -> float:
    """Between two packed colours."""
    x, y = np.int64(a), np.int64(b)
    dr, dg, db = (x >> 16) - (y >> 16), ((x >> 8) & 255) - ((y >> 8) & 255), (x & 255) - (y & 255)
    return float(dr * dr + dg * dg + db * db)


@leaf
def add_flat(photo: Packed, weight: NDArray[np.float32], sums: NDArray[np.float64]) -> None:
    """Add weights, weighted colours and weighted squares of all pixels to sums."""
    rows, columns = photo.shape
    for i in range(rows):
        for j in range(columns):
            w, r, g, b = pixel(photo, weight, i, j)
            sums[0] += w
            sums[1] += w * r
            sums[2] += w * g
            sums[3] += w * b
            sums[4] += w * (r * r + g * g + b * b)


@leaf
def add_shown(photo: Packed, weight: NDArray[np.float32], ids: NDArray[np.int32], sums: NDArray[np.float64]) -> None:
    """Add weights and weighted colours of the pixels that each stroke shows to its sums."""
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            if ids[i, j] >= 0:
                _add(sums, ids[i, j], photo[i, j], weight[i, j])


@leaf
def _add(sums: NDArray[np.float64], stroke: int, colour: np.uint32, weight: float) -> None:
    value = np.int64(colour)
    sums[stroke, 0] += weight
    sums[stroke, 1] += weight * (value >> 16)
    sums[stroke, 2] += weight * ((value >> 8) & 255)
    sums[stroke, 3] += weight * (value & 255)


@leaf
def _pack_suited(colours: NDArray[np.float64], choice: NDArray[np.uint32], packed: NDArray[np.uint32]) -> None:
    for stroke in range(len(colours)):
        packed[stroke] = suited(choice, colours[stroke, 0], colours[stroke, 1], colours[stroke, 2])
