"""One layer: the strips of the picture, every second one at the same time, and the strokes kept in each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from strokeplan.field import OrientationField
from strokeplan.jit import is_cached, leaf
from strokeplan.painting import Brush, LayerStrokes
from strokeplan.pursuit.cells import Strip, cell_count
from strokeplan.pursuit.picture import Picture
from strokeplan.pursuit.scene import BARE, EVEN, Kept, Rules, Scene, Tally
from strokeplan.pursuit.seeding import TRIES, Seeds, next_seed, sow
from strokeplan.pursuit.trying import Easel, set_up, try_stroke, widest
from strokeplan.workers import Workers

Laid = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.uint32]]
"""Points, their count for each stroke, widths and colours."""


def paint_layer(
    picture: Picture,
    field: OrientationField,
    brush: Brush,
    rules: Rules,
    key: np.uint64,
    workers: Workers,
    tell: Callable[[int, int, int], None],
) -> None:
    """Work all strips with one brush, then let every stroke so far take the colour of what it shows.

    `tell` is called with strips done, strips in all, and strokes kept so far.
    """
    lanes = np.zeros(picture.photo.shape if rules.seeding == EVEN else (1, 1), np.uint8)
    scene = Scene(
        picture.photo, picture.weight, picture.error, picture.ids, picture.below, picture.stamp, lanes,
        picture.regions, picture.choice, field.samples, field.scale, key,
    )  # fmt: skip
    if rules.cover:
        picture.error[picture.ids < 0] = BARE
    strips = list(_strips(picture, brush, rules))
    before, layer = picture.strokes, len(picture.layers)
    known = before
    kept: list[Laid] = []
    tell(0, len(strips), 0)
    for phase in (strips[::2], strips[1::2]):
        laid = workers.run(lambda strip: _paint_strip(scene, brush, rules, strip), phase)
        if laid:
            final = known + np.cumsum([0, *(len(counts) for _, counts, _, _ in laid)])
            first = np.array([strip.first_id for strip in phase])
            picture.by_bands(lambda _, rows: _renumber(picture.ids[rows], picture.below[rows], first, final))  # noqa: B023
            known = int(final[-1])
        kept += laid
        picture.layers[layer:] = [LayerStrokes(*(np.concatenate(column) for column in zip(*kept, strict=True)))]
        tell(len(kept), len(strips), known - before)
    picture.refit()


def _strips(picture: Picture, brush: Brush, rules: Rules) -> Iterator[Strip]:
    """Strips across the longer side, each wider than what strokes of both its neighbours reach into it."""
    height, width = picture.photo.shape
    reach = brush.length * (0.5 if brush.both_ways else 1) + brush.simplify_tolerance + brush.fit_tolerance
    reach += max(widest(brush, rules), rules.separation) + 2
    count = max(int(max(height, width) // (2 * reach)), 1)
    edges = [round(max(height, width) * k / count) for k in range(count + 1)]
    windows: list[tuple[int, int, int, int]] = [
        (0, height, low, high) if width >= height else (low, high, 0, width) for low, high in pairwise(edges)
    ]
    tries = [TRIES * cell_count(*window, rules.cell) for window in windows]
    first_id = picture.strokes + sum(tries)  # above what any stroke of the layer will be numbered
    for (top, bottom, left, right), most in zip(windows, tries, strict=True):
        yield Strip(top, bottom, left, right, first_id, picture.marks)
        first_id += most
        picture.marks += 3 * most


def _paint_strip(scene: Scene, brush: Brush, rules: Rules, strip: Strip) -> Laid:
    """Try strokes all over a strip; return those that are kept."""
    easel, seeds = set_up(scene, brush, rules), sow(scene, rules, strip)
    kept = Kept(np.empty((4096, 2)), np.empty(1024, np.int64), np.empty(1024), np.empty(1024, np.uint32))
    tally = Tally(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(1, np.int64))
    while not _try_seeds(scene, brush, rules, strip, easel, kept, tally, seeds):
        kept = Kept(*(np.concatenate([column, np.empty_like(column)]) for column in kept))
        if len(kept.points) < tally.points[0] + len(easel.chain):
            kept = kept._replace(points=np.concatenate([kept.points, np.empty_like(easel.chain)]))
    n = int(tally.strokes[0])
    return kept.points[: tally.points[0]], kept.counts[:n], kept.widths[:n], kept.colours[:n]


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first pursuit compiles them."""
    return is_cached(_try_seeds)


@leaf
def _try_seeds(
    scene: Scene,
    brush: Brush,
    rules: Rules,
    strip: Strip,
    easel: Easel,
    kept: Kept,
    tally: Tally,
    seeds: Seeds,
) -> bool:
    """Try seed after seed; False if a stroke might not find room in the columns, for the caller to enlarge them."""
    limit = TRIES * len(seeds.order) - 1
    # One loop for all ways to find seeds: the compiler makes a copy of `try_stroke` wherever it is called.
    while tally.tries[0] < limit:
        if tally.strokes[0] == len(kept.counts) or tally.points[0] + len(easel.chain) > len(kept.points):
            return False
        i, j, dab = next_seed(scene, rules, strip, seeds, kept, tally)
        if i < 0:
            return True
        try_stroke(scene, brush, rules, strip, easel, kept, tally, i, j, dab)
    return True


@leaf
def _renumber(
    ids: NDArray[np.int32], below: NDArray[np.int32], provisional: NDArray[np.int64], final: NDArray[np.int64]
) -> None:
    """Numbers that the strips of a phase gave, from provisional[k] on, become those from final[k] on."""
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            for numbers in (ids, below):
                number = numbers[i, j]
                if number >= provisional[0]:
                    k = len(provisional) - 1
                    while provisional[k] > number:
                        k -= 1
                    numbers[i, j] = number - provisional[k] + final[k]
