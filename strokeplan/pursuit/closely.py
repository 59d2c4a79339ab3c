"""The picture as antialiasing shows it: painted at twice the size and reduced, so that seams show what lies below."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, paint_chain
from strokeplan.jit import leaf
from strokeplan.pursuit.colours import squared_distance
from strokeplan.pursuit.picture import Picture


def look_closely(picture: Picture) -> None:
    """Measure the error as an antialiased picture has it, in which seams between strokes show what lies below."""
    shown, seen = picture.with_background(), seen_closely(picture)

    def measure(band: int, rows: slice) -> NDArray[np.uint32]:
        numbers = seen(band, rows)
        _compare(picture.photo[rows], picture.weight[rows], numbers, shown, picture.error[rows])
        return numbers

    picture.near, picture.near_strokes = picture.by_bands(measure), picture.strokes


def seen_closely(picture: Picture) -> Callable[[int, slice], NDArray[np.uint32]]:
    """What tells which stroke shows where in a band of the picture, painted at twice the size; their count for
    none. Strokes that `look_closely` has seen are not painted again."""
    points, counts, widths = picture.outlines()
    near, known = picture.near, picture.near_strokes if picture.near else 0
    outlines = points[counts[:known].sum() :], counts[known:], widths[known:]

    def seen(band: int, rows: slice) -> NDArray[np.uint32]:
        if near is None:
            return number_strokes(picture, *outlines, rows, 2)
        near[band][near[band] == known] = len(counts)
        return number_strokes(picture, *outlines, rows, 2, known, near[band])

    return seen


def number_strokes(
    picture: Picture,
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    widths: NDArray[np.float64],
    rows: slice,
    scale: int,
    first: int = 0,
    below: NDArray[np.uint32] | None = None,
) -> NDArray[np.uint32]:
    """Which stroke, numbered from `first` on, shows in some rows of a picture painted at `scale` times the size,
    over what is `below`; without that, their count for none."""
    size = scale * (rows.stop - rows.start), scale * picture.photo.shape[1]
    numbers = np.full(size, len(counts), np.uint32) if below is None else below
    chain = np.empty((int(counts.max(initial=0)), 2))
    _paint_numbers(numbers, points, counts, widths, picture.round_cap, rows.start, rows.stop, scale, first, chain)
    return numbers


@leaf
def _paint_numbers(
    numbers: NDArray[np.uint32],
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    widths: NDArray[np.float64],
    round_cap: bool,
    top: int,
    bottom: int,
    scale: int,
    number: int,
    chain: NDArray[np.float64],
) -> None:
    """Paint the number of every stroke, from `number` on, where it shows in rows top … bottom − 1, at `scale` times
    the size."""
    first = 0
    for stroke in range(len(counts)):
        count, width = counts[stroke], widths[stroke]
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, points[first + k, 1]), max(high, points[first + k, 1])
        if low - width < bottom and high + width > top:
            for k in range(count):
                chain[k, 0], chain[k, 1] = scale * points[first + k, 0], scale * (points[first + k, 1] - top)
            paint_chain(numbers, chain, 0, count // 3, scale * width, round_cap, np.uint32(number + stroke))
        first += count


@leaf
def _mixed(numbers: NDArray[np.uint32], colours: NDArray[np.uint32], i: int, j: int) -> np.uint32:
    """The colour of a pixel of the picture of which `numbers` says what shows at twice the size, as antialiasing has
    it."""
    a, b = numbers[2 * i, 2 * j], numbers[2 * i, 2 * j + 1]
    c, d = numbers[2 * i + 1, 2 * j], numbers[2 * i + 1, 2 * j + 1]
    if a == b and a == c and a == d:
        return np.uint32(colours[a])
    mixed = np.uint32(0)
    for shift in (16, 8, 0):
        total = (
            ((colours[a] >> shift) & 255) + ((colours[b] >> shift) & 255)
            + ((colours[c] >> shift) & 255) + ((colours[d] >> shift) & 255)
        )  # fmt: skip
        mixed |= np.uint32(((total + 2) >> 2) << shift)
    return mixed


@leaf
def reduce(numbers: NDArray[np.uint32], colours: NDArray[np.uint32], picture: Packed) -> None:
    """Paint a picture of which `numbers` says what shows at twice the size."""
    rows, columns = picture.shape
    for i in range(rows):
        for j in range(columns):
            picture[i, j] = _mixed(numbers, colours, i, j)


@leaf
def _compare(
    photo: Packed,
    weight: NDArray[np.float32],
    numbers: NDArray[np.uint32],
    colours: NDArray[np.uint32],
    error: NDArray[np.float32],
) -> None:
    rows, columns = photo.shape
    for i in range(rows):
        for j in range(columns):
            error[i, j] = weight[i, j] * squared_distance(photo[i, j], _mixed(numbers, colours, i, j))
