"""The last stage: strokes that nobody sees go, and the colours of the others are solved together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, footprint
from strokeplan.jit import leaf
from strokeplan.pursuit.closely import number_strokes, reduce, seen_closely
from strokeplan.pursuit.colours import packed_colours, pixel
from strokeplan.pursuit.picture import Picture

SOLVES, DAMPING = 4, 0.8
"""Steps towards the colours that suit best together, and the part of each that is taken: whole ones overshoot."""


def finish(picture: Picture, spare: float | None = None) -> Packed:
    """Drop strokes that nobody sees, give the others the colours that suit best together; return the picture.

    All as an antialiased picture has it. With `spare` (see Rules) what alone covers a part of the canvas stays, in
    the colour that is wanted there.
    """
    seen, n = seen_closely(picture), picture.strokes
    numbers = picture.by_bands(seen)
    colours = np.stack([picture.with_background() >> shift & 255 for shift in (16, 8, 0)], axis=-1).astype(np.float64)
    for _ in range(SOLVES):
        parts = np.zeros((len(numbers), n + 1, 4))
        picture.by_bands(
            lambda k, rows: _add_residuals(picture.photo[rows], picture.weight[rows], numbers[k], colours, parts[k])  # noqa: B023
        )
        sums = parts.sum(axis=0)
        colours[:n] += DAMPING * sums[:n, 1:] / np.maximum(sums[:n, :1], 1e-9)
        np.clip(colours, 0, 255, out=colours)
    drop = sums[:n, 0] == 0
    if spare is not None:
        _keep_covered(picture, spare, drop, colours)
    picture.recolour(packed_colours(colours[:n], picture.choice))
    shown, finished = picture.with_background(), np.empty_like(picture.photo)
    picture.by_bands(lambda k, rows: reduce(numbers[k], shown, finished[rows]))
    picture.leave_out(drop)
    return finished


def _keep_covered(picture: Picture, spare: float, drop: NDArray[np.bool_], colours: NDArray[np.float64]) -> None:
    """Take back what is to be dropped and covers a pixel that no other stroke, thinner by `spare`, covers.

    Its colour becomes the mean of the photo there.
    """
    points, counts, widths = picture.outlines()
    thin = np.maximum(widths - spare, 0.5 * widths)
    stay = points[np.repeat(~drop, counts)], counts[~drop], thin[~drop]
    solid = np.empty(picture.photo.shape, np.bool_)

    def cover(_: int, rows: slice) -> None:
        np.less(number_strokes(picture, *stay, rows, 1), len(stay[1]), out=solid[rows])

    picture.by_bands(cover)
    gone = np.flatnonzero(drop)
    firsts = (np.cumsum(counts) - counts)[gone]
    room = picture.largest_footprint(points, counts, thin)
    picture.marks += len(gone)
    _keep_covering(
        picture.photo, picture.stamp, solid, points, firsts, counts[gone], thin[gone], picture.round_cap, gone, drop,
        picture.marks, colours, np.full((len(solid), 3), -1, np.int32), room,
    )  # fmt: skip


@leaf
def _add_residuals(
    photo: Packed,
    weight: NDArray[np.float32],
    numbers: NDArray[np.uint32],
    colours: NDArray[np.float64],
    sums: NDArray[np.float64],
) -> None:
    """Add to each stroke's sums Σ w·c² and Σ w·c·(photo − picture), with c the part of a pixel that it shows.

    Their ratio is the step towards the colours of least squared error (Jacobi's method).
    """
    rows, columns = photo.shape
    for i in range(rows):
        for j in range(columns):
            w, red, green, blue = pixel(photo, weight, i, j)
            a, b = int(numbers[2 * i, 2 * j]), int(numbers[2 * i, 2 * j + 1])
            c, d = int(numbers[2 * i + 1, 2 * j]), int(numbers[2 * i + 1, 2 * j + 1])
            if a == b and a == c and a == d:
                _add_part(sums, a, w, 1.0, red - colours[a, 0], green - colours[a, 1], blue - colours[a, 2])
                continue
            red -= 0.25 * (colours[a, 0] + colours[b, 0] + colours[c, 0] + colours[d, 0])
            green -= 0.25 * (colours[a, 1] + colours[b, 1] + colours[c, 1] + colours[d, 1])
            blue -= 0.25 * (colours[a, 2] + colours[b, 2] + colours[c, 2] + colours[d, 2])
            for number in (a, b, c, d):
                part = 0.25 * ((a == number) + (b == number) + (c == number) + (d == number))
                _add_part(sums, number, 0.25 * w, part, red, green, blue)


@leaf
def _add_part(
    sums: NDArray[np.float64], number: int, weight: float, part: float, red: float, green: float, blue: float
) -> None:
    sums[number, 0] += weight * part
    sums[number, 1] += weight * red
    sums[number, 2] += weight * green
    sums[number, 3] += weight * blue


@leaf
def _keep_covering(
    photo: Packed,
    stamp: NDArray[np.int32],
    solid: NDArray[np.bool_],
    points: NDArray[np.float64],
    firsts: NDArray[np.int64],
    counts: NDArray[np.int64],
    widths: NDArray[np.float64],
    round_cap: bool,
    gone: NDArray[np.int64],
    drop: NDArray[np.bool_],
    mark: int,
    colours: NDArray[np.float64],
    spans: NDArray[np.int32],
    pixels: NDArray[np.int32],
) -> None:
    for k in range(len(gone)):
        mark -= 1
        n = footprint(stamp, mark, spans, points, firsts[k], counts[k] // 3, widths[k], round_cap, pixels)
        red = green = blue = needed = 0.0
        for p in range(n):
            i, j = pixels[p, 0], pixels[p, 1]
            if not solid[i, j]:
                solid[i, j] = True
                value = np.int64(photo[i, j])
                red += value >> 16
                green += (value >> 8) & 255
                blue += value & 255
                needed += 1.0
        if needed > 0.0:
            drop[gone[k]] = False
            colours[gone[k], 0], colours[gone[k], 1], colours[gone[k], 2] = red / needed, green / needed, blue / needed
