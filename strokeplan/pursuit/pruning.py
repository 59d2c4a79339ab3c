"""Strokes that are not worth their place: dropped, or merged with others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan import merging
from strokeplan.canvas import Packed, footprint
from strokeplan.jit import kernel, leaf
from strokeplan.painting import Brush
from strokeplan.pursuit.colours import squared_distance
from strokeplan.pursuit.picture import Picture

LIMIT_STEPS = 20
"""Strokes in excess of a limit go in parts of one in so many of those there are."""


def prune(picture: Picture, least: float, *, spare_first: bool = False) -> None:
    """Drop the strokes that are seen and without which the error would grow by less than `least`.

    `spare_first`: but those of the first layer, which cover the canvas.
    """
    costs, seen = _removal_costs(picture)
    drop = (costs < least) & seen
    drop[: len(picture.layers[0].counts) if spare_first else 0] = False
    _drop(picture, drop, costs)


def limit(picture: Picture, most: int) -> None:
    """Drop the strokes that are missed least until no more than `most` are left, even if canvas shows."""
    if picture.strokes <= most:
        return
    while picture.strokes > most:
        _look_below(picture)
        costs, seen = _removal_costs(picture)
        costs[~seen] = -np.inf
        # Not all at once: what lies below a stroke that goes is missed more afterwards.
        surplus = min(picture.strokes - most, max(picture.strokes // LIMIT_STEPS, 1))
        drop = np.zeros(len(costs), np.bool_)
        drop[np.argsort(costs, kind="stable")[:surplus]] = True
        picture.leave_out(drop)
    _look_below(picture)


def merge(picture: Picture, brush: Brush, alike: float) -> None:
    """Merge strokes of the last layer that meet in colours nearer than an RGB distance of `alike`."""
    merged = merging.merge(picture.layers[-1], brush, alike)
    if len(merged.counts) < len(picture.layers[-1].counts):
        picture.layers[-1] = merged
        picture.near = None
        _look_below(picture)


def thin(picture: Picture, least: float) -> None:
    """Drop strokes that differ from what lies below them by less than a mean RGB distance of `least`."""
    distances = _mean_distances(picture.ids, picture.below, picture.colours)
    _drop(picture, distances < least, distances)


def _removal_costs(picture: Picture) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """By how much the error grows if a stroke is taken away, and whether it is seen.

    Infinite where what lies below is canvas, or not known.
    """
    costs, seen = np.zeros(picture.strokes), np.zeros(picture.strokes, np.bool_)
    _add_removal_costs(picture.photo, picture.weight, picture.ids, picture.below, picture.colours, costs, seen)
    return costs, seen


def _look_below(picture: Picture) -> None:
    """Find anew what each pixel shows, and what lies below that."""
    picture.marks += picture.strokes
    outlines, spans = picture.outlines(), np.full((len(picture.ids), 3), -1, np.int32)
    picture.ids[:], picture.below[:] = -1, -1
    _lay_anew(
        picture.ids, picture.below, picture.stamp, *outlines, picture.round_cap, picture.marks, spans,
        picture.largest_footprint(*outlines),
    )  # fmt: skip
    picture.refit()


def _drop(picture: Picture, drop: NDArray[np.bool_], worth: NDArray[np.float64]) -> None:
    """Take strokes away; where two lie on each other, the one that is worth more stays."""
    _spare(picture.ids, picture.below, worth, drop)
    _uncover(picture.ids, picture.below, drop, np.cumsum(~drop, dtype=np.int32) - np.int32(1))
    picture.leave_out(drop)
    picture.refit()


@leaf
def _add_removal_costs(
    photo: Packed,
    weight: NDArray[np.float32],
    ids: NDArray[np.int32],
    below: NDArray[np.int32],
    colours: NDArray[np.uint32],
    costs: NDArray[np.float64],
    seen: NDArray[np.bool_],
) -> None:
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            top, under = ids[i, j], below[i, j]
            if top < 0:
                continue
            seen[top] = True
            if under < 0:
                costs[top] = np.inf
            else:
                value = photo[i, j]
                costs[top] += weight[i, j] * (
                    squared_distance(value, colours[under]) - squared_distance(value, colours[top])
                )


@leaf
def _spare(
    ids: NDArray[np.int32], below: NDArray[np.int32], costs: NDArray[np.float64], drop: NDArray[np.bool_]
) -> None:
    """Of two strokes to be dropped of which one lies below the other, spare the one worth more."""
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            top, under = ids[i, j], below[i, j]
            if top >= 0 and under >= 0 and drop[top] and drop[under]:
                drop[top if costs[top] > costs[under] else under] = False


@leaf
def _uncover(
    ids: NDArray[np.int32], below: NDArray[np.int32], drop: NDArray[np.bool_], number: NDArray[np.int32]
) -> None:
    """Take dropped strokes off the picture; what was below them shows, and all get their new numbers.

    What lies two below is not known, and takes the place of −1 there.
    """
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            top, under = ids[i, j], below[i, j]
            if top >= 0 and drop[top]:
                top, under = under, -1
            ids[i, j] = number[top] if top >= 0 else -1
            below[i, j] = number[under] if under >= 0 and not drop[under] else -1


@kernel
def _mean_distances(
    ids: NDArray[np.int32], below: NDArray[np.int32], colours: NDArray[np.uint32]
) -> NDArray[np.float64]:
    """Mean RGB distance of each stroke from what lies below it, where it is seen; infinite over canvas."""
    sums, counts = np.zeros(len(colours)), np.zeros(len(colours))
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            top, under = ids[i, j], below[i, j]
            if top >= 0:
                counts[top] += 1.0
                sums[top] += np.inf if under < 0 else np.sqrt(squared_distance(colours[top], colours[under]))
    return sums / np.maximum(counts, 1.0)


@leaf
def _lay_anew(
    ids: NDArray[np.int32],
    below: NDArray[np.int32],
    stamp: NDArray[np.int32],
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    widths: NDArray[np.float64],
    round_cap: bool,
    mark: int,
    spans: NDArray[np.int32],
    pixels: NDArray[np.int32],
) -> None:
    first = 0
    for stroke in range(len(counts)):
        mark -= 1
        n = footprint(stamp, mark, spans, points, first, counts[stroke] // 3, widths[stroke], round_cap, pixels)
        for k in range(n):
            i, j = pixels[k, 0], pixels[k, 1]
            below[i, j], ids[i, j] = ids[i, j], stroke
        first += counts[stroke]
