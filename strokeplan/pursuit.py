"""Strokes kept for what they improve: matching pursuit with brush strokes.

A stroke is tried where the picture is wrong. Of the tract through the seed it takes the stretch that
improves the picture most, in the colour that suits its footprint best, and it is kept if that lowers the
squared error by enough: greedy matching pursuit (S. Mallat, Z. Zhang 1993) over strokes, where the paper
lays one in every cell that differs. What a stroke gains is exact for the pixels of its footprint:

    gain = Σ w·(old error) − Σ w·|photo − colour|²,   colour = Σ w·photo / Σ w

with w the importance of a pixel. After every layer each stroke takes the mean colour of the pixels where
it is still seen; at the end strokes that nobody sees, or would miss less than others cost, are dropped.
A stroke may also be kept for no more than that its cell differs, as in the paper (`Rules.by_gain` off).

Where strokes are tried (`Seeding`): in the cells of a grid in random order, in its worst cells first, at
random with a probability proportional to the present error, or evenly spaced (B. Jobard, W. Lefer 1997).

The picture is worked in strips along its longer side, wider than a stroke reaches on both sides: every
second strip at the same time, then the others. What a strip gets does not depend on who works it, or when.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, footprint, mean_distance, paint_chain
from strokeplan.curves import Scratch, fit, rdp, scratch
from strokeplan.field import OrientationField
from strokeplan.jit import kernel, leaf
from strokeplan.merging import merge as merge_strokes
from strokeplan.painting import BEND_WIDTHS, Brush, LayerStrokes, Workers
from strokeplan.tractography import splitmix64, trace, tract_capacity

SECTIONS = 12
"""Stretches of a tract begin and end at this many of its points at most; all pairs are compared."""
ACROSS = 8
"""Pixels sampled across a tract to choose a stretch, at most: wide brushes are sampled coarsely."""
FIRST_LOOK = 0.3
"""Part of a stroke's length that is followed at first: most seeds are given up then, or found to need no more."""
HOPE = 0.3
"""Part of the gain asked for that the first look must promise, to be followed further."""
ESTIMATE = 0.8
"""Stretches whose sampled gain falls below this part of what is asked for are not fitted and measured."""
TRIGGER = 2.0
"""A cell is tried if strokes of this part of the greatest length, all as bad as the cell, would gain enough."""
CELL_WIDTHS = 2.0
"""Side of the cells of strokes kept by gain, in widths of their brush. With cells of one width, three times as
many seeds are tried for 0.1 dB at the same number of strokes."""
BARE = 2.0**40
"""Error of a pixel that must be covered and is bare: above all that a stroke of any width can lose."""
UNCOVERED = 2.0**20
"""Least mean error of a cell that holds a bare pixel, while none without is as bad: a picture is covered by strokes
that are needed for that, before it is bettered."""
TRIES = 8
"""Most strokes tried for each cell of a strip."""
NARROWEST, WIDEST = 0.5, 2.0
"""Bounds of a stroke's width in widths of its brush, where importance varies it."""
LIMIT_STEPS = 20
"""Strokes in excess of a limit go in parts of one in so many of those there are."""
TEST_DISTANCE = 0.5
"""Evenly spaced tracts end this near to another, in separations (Jobard and Lefer's d_test)."""

GRID, WORST_FIRST, BY_ERROR, EVEN = range(4)
SEEDINGS = {"grid": GRID, "worst-first": WORST_FIRST, "error": BY_ERROR, "even": EVEN}
_NEAR, _LANE = np.uint8(1), np.uint8(2)
"""What a pixel is to the evenly spaced strokes of a layer: a tract ends here; none begins here."""

_CELL, _BARE, _TRIED, _DRAWN, _LAID, _FLANKED, _FIRST, _PLACE = range(8)
"""How far the search for seeds is, in _Seeds.state: cells had, or draws made; cells found covered, and the bare
pixel tried last; the cell drawn last, and the strokes kept before it; strokes whose sides have been had, where the
points of the next begin, and the places had beside that one."""

Laid = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.uint32]]
"""Points, their count for each stroke, widths and colours."""


class Rules(NamedTuple):
    """What decides in a layer whether a stroke is tried and kept; lengths in pixels."""

    seeding: int
    cell: float
    """Side of the cells in which seeds are sought."""
    by_gain: bool
    gain: float
    """Least weighted squared error (8-bit RGB, summed over pixels) that a stroke must take away, if by gain."""
    trigger: float
    """Least mean of a cell that is tried: of its squared error, if by gain, or of its RGB distance."""
    cover: bool
    """Cover every pixel, whatever it gains."""
    separation: float
    """Distance of evenly spaced strokes."""
    vary_width: bool
    """Narrower strokes where the weight is high, wider ones where it is low."""


class Scene(NamedTuple):
    """What the kernels look at; `error`, `ids`, `below`, `stamp` and `lanes` change as strokes are laid."""

    photo: Packed
    weight: NDArray[np.float32]
    error: NDArray[np.float32]
    ids: NDArray[np.int32]
    below: NDArray[np.int32]
    stamp: NDArray[np.int32]
    lanes: NDArray[np.uint8]
    regions: NDArray[np.int32]
    choice: NDArray[np.uint32]
    samples: NDArray[np.float32]
    scale: float
    key: np.uint64


class Strip(NamedTuple):
    """A window whose cells are worked in one sequence, and where the numbers of its strokes and tries begin."""

    top: int
    bottom: int
    left: int
    right: int
    first_id: int
    first_mark: int


class _Easel(NamedTuple):
    """Room to work on one stroke."""

    tract: NDArray[np.float64]
    vertices: NDArray[np.float64]
    chain: NDArray[np.float64]
    sums: NDArray[np.float64]
    pixels: NDArray[np.int32]
    room: Scratch


class _Kept(NamedTuple):
    """Strokes kept so far: columns with room for more."""

    points: NDArray[np.float64]
    counts: NDArray[np.int64]
    widths: NDArray[np.float64]
    colours: NDArray[np.uint32]


class _Seeds(NamedTuple):
    """The cells of a strip in the order in which they are tried, their errors, and how far that is."""

    order: NDArray[np.int64]
    mass: NDArray[np.float64]
    tree: NDArray[np.float64]
    state: NDArray[np.int64]


class _Tally(NamedTuple):
    """Counters of a strip, each an array of one number."""

    strokes: NDArray[np.int64]
    points: NDArray[np.int64]
    tries: NDArray[np.int64]


@dataclass(slots=True)
class Pursuit:
    """A picture in work: its error and which stroke each pixel shows.

    weight   (h, w) float32 above 0: how much a pixel's error counts.
    regions  (h, w) int32 labels that tracts do not cross, or (1, 1) for none.
    choice   colours that may be used, by `choices`; empty for all.
    """

    photo: Packed
    weight: NDArray[np.float32]
    regions: NDArray[np.int32]
    choice: NDArray[np.uint32]
    background: int
    error: NDArray[np.float32]
    ids: NDArray[np.int32]
    below: NDArray[np.int32]
    stamp: NDArray[np.int32]
    layers: list[LayerStrokes]
    marks: int = 0

    @classmethod
    def begin(
        cls,
        photo: Packed,
        weight: NDArray[np.float32],
        background: int,
        regions: NDArray[np.int32] | None = None,
        choice: NDArray[np.uint32] | None = None,
    ) -> Pursuit:
        """A bare canvas of one colour 0xRRGGBB."""
        nobody = np.full(photo.shape, -1, np.int32)
        pursuit = cls(
            photo,
            weight,
            np.zeros((1, 1), np.int32) if regions is None else regions,
            np.empty(0, np.uint32) if choice is None else choice,
            background,
            error=np.empty(photo.shape, np.float32),
            ids=nobody,
            below=nobody.copy(),
            stamp=nobody.copy(),
            layers=[],
        )
        pursuit._measure()
        return pursuit

    @property
    def strokes(self) -> int:
        return sum(len(layer.counts) for layer in self.layers)

    @property
    def colours(self) -> NDArray[np.uint32]:
        """(n,) packed colours of all strokes."""
        return np.concatenate([np.empty(0, np.uint32), *(layer.colours for layer in self.layers)])

    def total_error(self) -> float:
        """Weighted squared error of the picture as it is."""
        return float(self.error.sum(dtype=np.float64))

    def error_to_beat(self) -> float:
        """`total_error`, but of a bare canvas that of one in the photo's mean colour: nothing is owed to paper."""
        if self.layers:
            return self.total_error()
        mean = self.photo, self.weight, np.zeros(self.photo.shape, np.int32), np.zeros(1, np.uint32)
        colour = _mean_colours(*mean, np.empty(0, np.uint32))
        error = np.empty(self.photo.shape, np.float32)
        _measure_error(self.photo, self.weight, mean[2], colour, np.uint32(0), error)
        return float(error.sum(dtype=np.float64))

    def mean_distance(self) -> float:
        """Mean RGB distance of photo and picture, of a sample of the pixels."""
        return mean_distance(self.photo, self.canvas(), 0, self.photo.shape[0], 0, self.photo.shape[1], 8, 1.0)

    def canvas(self) -> Packed:
        """The picture as it is."""
        shown = np.concatenate([self.colours, np.array([self.background], np.uint32)])
        return shown[self.ids]  # a bare pixel's −1 is the last

    def paint_layer(
        self,
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
        lanes = np.zeros(self.photo.shape if rules.seeding == EVEN else (1, 1), np.uint8)
        scene = Scene(
            self.photo, self.weight, self.error, self.ids, self.below, self.stamp, lanes, self.regions, self.choice,
            field.samples, field.scale, key,
        )  # fmt: skip
        if rules.cover:
            self.error[self.ids < 0] = BARE
        strips = list(self._strips(brush, rules))
        capacity = tract_capacity(brush.length)
        known = self.strokes
        kept: list[Laid] = []
        tell(0, len(strips), 0)
        for phase in (strips[::2], strips[1::2]):
            laid = workers.run(lambda strip: _paint_strip(scene, brush, rules, strip, capacity), phase)
            if laid:
                final = known + np.cumsum([0, *(len(counts) for _, counts, _, _ in laid)])
                _renumber(self.ids, self.below, np.array([strip.first_id for strip in phase]), final)
                known = int(final[-1])
            kept += laid
            tell(len(kept), len(strips), known - self.strokes)
        self.layers.append(LayerStrokes(*(np.concatenate(column) for column in zip(*kept, strict=True))))
        self.refit()

    def _strips(self, brush: Brush, rules: Rules) -> Iterator[Strip]:
        """Strips across the longer side, each wider than what strokes of both its neighbours reach into it."""
        height, width = self.photo.shape
        widest = brush.width * (WIDEST if rules.vary_width else 1)
        reach = brush.length * (0.5 if brush.both_ways else 1) + brush.simplify_tolerance + brush.fit_tolerance
        reach += max(widest, rules.separation) + 2
        count = max(int(max(height, width) // (2 * reach)), 1)
        edges = [round(max(height, width) * k / count) for k in range(count + 1)]
        windows = [
            (0, height, low, high) if width >= height else (low, high, 0, width) for low, high in pairwise(edges)
        ]
        tries = [TRIES * len(_cells(window, rules.cell)) for window in windows]
        first_id = self.strokes + sum(tries)  # above what any stroke of the layer will be numbered
        for (top, bottom, left, right), most in zip(windows, tries, strict=True):
            yield Strip(top, bottom, left, right, first_id, self.marks)
            first_id += most
            self.marks += 3 * most

    def refit(self) -> None:
        """Every stroke takes the mean colour of what it shows; the error follows."""
        colours = _mean_colours(self.photo, self.weight, self.ids, self.colours, self.choice)
        for layer, own in zip(self.layers, self._by_layer(colours), strict=True):
            layer.colours = own
        self._measure()

    def prune(self, least: float, keep_covered: bool = False) -> None:
        """Drop strokes that nobody sees, and those without which the error would grow by less than `least`.

        `keep_covered` spares what alone keeps the canvas from showing through between antialiased strokes.
        """
        costs, seen = _removal_costs(self.photo, self.weight, self.ids, self.below, self.colours)
        self._drop((costs < least) | ~seen, costs, keep_covered)

    def limit(self, most: int) -> None:
        """Drop the strokes that are missed least until no more than `most` are left, even if canvas shows."""
        while self.strokes > most:
            self._look_below()
            costs, seen = _removal_costs(self.photo, self.weight, self.ids, self.below, self.colours)
            costs[~seen] = -np.inf
            # Not all at once: what lies below a stroke that goes is missed more afterwards.
            surplus = min(self.strokes - most, max(self.strokes // LIMIT_STEPS, 1))
            drop = np.zeros(len(costs), np.bool_)
            drop[np.argsort(costs, kind="stable")[:surplus]] = True
            self._leave_out(drop)
        self._look_below()

    def _look_below(self) -> None:
        """Find anew what each pixel shows, and what lies below that."""
        self.marks += self.strokes
        _look_below(self.ids, self.below, self.stamp, *self._outlines(), self.marks)
        self.refit()

    def _outlines(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """Points, counts and widths of all strokes."""
        return (
            np.concatenate([layer.points for layer in self.layers]),
            np.concatenate([layer.counts for layer in self.layers]),
            np.concatenate([layer.widths for layer in self.layers]),
        )

    def merge(self, brush: Brush, alike: float) -> None:
        """Merge strokes of the last layer that meet in colours nearer than an RGB distance of `alike`."""
        merged = merge_strokes(self.layers[-1], brush, alike)
        if len(merged.counts) < len(self.layers[-1].counts):
            self.layers[-1] = merged
            self._look_below()

    def thin(self, least: float) -> None:
        """Drop strokes that differ from what lies below them by less than a mean RGB distance of `least`."""
        distances = _mean_distances(self.ids, self.below, self.colours)
        self._drop(distances < least, distances, keep_covered=False)

    def _drop(self, drop: NDArray[np.bool_], worth: NDArray[np.float64], keep_covered: bool) -> None:
        """Take strokes away; where two lie on each other, the one that is worth more stays."""
        _spare(self.ids, self.below, worth, drop)
        if keep_covered:
            self.marks += len(drop)
            _keep_covered(self.stamp, *self._outlines(), drop, self.marks)
        _uncover(self.ids, self.below, drop, np.cumsum(~drop, dtype=np.int32) - np.int32(1))
        self._leave_out(drop)
        self.refit()

    def _leave_out(self, drop: NDArray[np.bool_]) -> None:
        for layer, dropped in zip(self.layers, self._by_layer(drop), strict=True):
            layer.points = layer.points[np.repeat(~dropped, layer.counts)]
            layer.counts, layer.widths, layer.colours = (
                column[~dropped] for column in (layer.counts, layer.widths, layer.colours)
            )

    def _by_layer(self, column: NDArray[Any]) -> list[NDArray[Any]]:
        return np.split(column, np.cumsum([len(layer.counts) for layer in self.layers])[:-1])

    def _measure(self) -> None:
        _measure_error(self.photo, self.weight, self.ids, self.colours, np.uint32(self.background), self.error)


def _cells(window: tuple[int, int, int, int], side: float) -> range:
    """The cells of a window (top, bottom, left, right)."""
    top, bottom, left, right = window
    return range(ceil((bottom - top) / side) * ceil((right - left) / side))


@kernel
def _paint_strip(scene: Scene, brush: Brush, rules: Rules, strip: Strip, capacity: int) -> Laid:
    """Try strokes all over a strip; return those that are kept."""
    widest = brush.width * (WIDEST if rules.vary_width else 1.0)
    room = int((2 * brush.length + 2 * widest + 64) * (max(widest, 2 * rules.separation) + 4))
    easel = _Easel(
        np.empty((capacity, 2)), np.empty((capacity, 2)), np.empty((3 * capacity + 1, 2)), np.zeros((capacity + 1, 6)),
        np.empty((room, 2), np.int32), scratch(capacity),
    )  # fmt: skip
    kept = _Kept(np.empty((4096, 2)), np.empty(1024, np.int64), np.empty(1024), np.empty(1024, np.uint32))
    tally = _Tally(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(1, np.int64))
    seeds = _sow(scene, rules, strip)
    limit = TRIES * len(seeds.order) - 1
    # One loop for all ways to find seeds: the compiler makes a copy of `_try` wherever it is called.
    while tally.tries[0] < limit:
        i, j, dab = _next_seed(scene, rules, strip, seeds, kept, tally)
        if i < 0:
            break
        n, used = tally.strokes[0], tally.points[0]
        if n == len(kept.counts) or used + len(easel.chain) > len(kept.points):
            kept = _with_room(kept, n, used, len(easel.chain))
        _try(scene, brush, rules, strip, easel, kept, tally, i, j, dab)
    n = tally.strokes[0]
    return (
        kept.points[: tally.points[0]].copy(),
        kept.counts[:n].copy(),
        kept.widths[:n].copy(),
        kept.colours[:n].copy(),
    )


@kernel
def _sow(scene: Scene, rules: Rules, strip: Strip) -> _Seeds:
    """What `_next_seed` needs to know: the cells in their order, or the tree to draw them from."""
    rows, columns = _shape(strip, rules.cell)
    cells = rows * columns
    ranks = np.empty(cells)
    mass, tree = np.zeros(cells), np.zeros(cells + 1)
    for cell in range(cells):
        if rules.seeding == WORST_FIRST:
            ranks[cell] = -_survey(scene, rules, strip, cell)[0]
        else:
            ranks[cell] = _random(scene.key, cell)
        if rules.seeding == BY_ERROR:
            _change(tree, mass, cell, _mass(scene, rules, strip, cell))
    order = np.argsort(ranks, kind="mergesort")
    state = np.zeros(8, np.int64)
    state[_DRAWN] = -1
    return _Seeds(order, mass, tree, state)


@leaf
def _next_seed(
    scene: Scene, rules: Rules, strip: Strip, seeds: _Seeds, kept: _Kept, tally: _Tally
) -> tuple[int, int, bool]:
    """The pixel through which the next stroke is tried, and whether it is to be a dab; row −1 after the last."""
    i, j = -1, -1
    if rules.seeding == BY_ERROR:
        i, j = _draw_seed(scene, rules, strip, seeds, tally)
    elif rules.seeding == EVEN:
        i, j = _seed_beside(scene, rules, strip, seeds, kept, tally)
    else:
        while i < 0 and seeds.state[_CELL] < len(seeds.order):
            cell = seeds.order[seeds.state[_CELL]]
            seeds.state[_CELL] += 1
            mean, worst_i, worst_j = _survey(scene, rules, strip, cell)
            if mean > rules.trigger:
                i, j = _centre(rules, strip, cell) if rules.seeding == GRID else (worst_i, worst_j)
    if i >= 0 or not rules.cover:
        return i, j, False
    # What is still bare after all; where no stroke will do, the shortest that there is.
    while seeds.state[_BARE] < len(seeds.order):
        _, i, j = _survey(scene, rules, strip, seeds.state[_BARE])
        if scene.error[i, j] >= BARE:
            pixel = i * scene.photo.shape[1] + j + 1
            again = seeds.state[_TRIED] == pixel
            seeds.state[_TRIED] = pixel
            return i, j, again
        seeds.state[_BARE] += 1
    return -1, -1, False


@leaf
def _draw_seed(scene: Scene, rules: Rules, strip: Strip, seeds: _Seeds, tally: _Tally) -> tuple[int, int]:
    """A pixel drawn with a probability proportional to its present error, until the mean is no more than asked for.

    Cells are drawn from a Fenwick tree of their errors. What other strokes have changed since is found when
    a cell is drawn: it is then taken with the probability that is left of it. A cell that no stroke suits is
    not drawn again.
    """
    cells = len(seeds.order)
    area = float((strip.bottom - strip.top) * (strip.right - strip.left))
    state = seeds.state
    if state[_DRAWN] >= 0:
        left = _mass(scene, rules, strip, state[_DRAWN]) if tally.strokes[0] > state[_LAID] else 0.0
        _change(seeds.tree, seeds.mass, state[_DRAWN], left)
    while state[_CELL] < TRIES * cells:
        state[_CELL] += 1
        total = _prefix(seeds.tree, cells)
        if total <= rules.trigger * area:
            break
        key = splitmix64(scene.key, np.uint64(cells + state[_CELL]))
        cell = _find(seeds.tree, _random(key, 0) * total)
        before, now = seeds.mass[cell], _mass(scene, rules, strip, cell)
        _change(seeds.tree, seeds.mass, cell, now)
        if now > 0.0 and _random(key, 1) * before <= now:
            state[_DRAWN], state[_LAID] = cell, tally.strokes[0]
            return _draw_pixel(scene, rules, strip, cell, _random(key, 2) * now)
    return -1, -1


@leaf
def _seed_beside(
    scene: Scene, rules: Rules, strip: Strip, seeds: _Seeds, kept: _Kept, tally: _Tally
) -> tuple[int, int]:
    """Seeds of evenly spaced tracts: one separation beside the strokes kept so far, oldest first; where these have
    no room left beside them, in the next cell, in random order, that is free."""
    state = seeds.state
    while True:
        if state[_FLANKED] < tally.strokes[0]:
            # Four places along the straight line below each piece, on both sides: near enough for a seed.
            count = kept.counts[state[_FLANKED]]
            k = state[_FIRST] + 3 * (state[_PLACE] // 8)
            if k >= state[_FIRST] + count - 1:
                state[_FLANKED] += 1
                state[_FIRST] += count
                state[_PLACE] = 0
                continue
            t, side = (state[_PLACE] // 2 % 4) / 4, 1.0 - 2.0 * (state[_PLACE] % 2)
            state[_PLACE] += 1
            ax, ay = kept.points[k, 0], kept.points[k, 1]
            dx, dy = kept.points[k + 3, 0] - ax, kept.points[k + 3, 1] - ay
            across = side * rules.separation / max(np.hypot(dx, dy), 1e-9)
            i, j = int(np.floor(ay + t * dy + across * dx)), int(np.floor(ax + t * dx - across * dy))
        elif state[_CELL] < len(seeds.order):
            i, j = _centre(rules, strip, seeds.order[state[_CELL]])
            state[_CELL] += 1
        else:
            return -1, -1
        inside = strip.top <= i < strip.bottom and strip.left <= j < strip.right
        if inside and not scene.lanes[i, j] & _LANE:
            columns = _shape(strip, rules.cell)[1]
            cell = int((i - strip.top) / rules.cell) * columns + int((j - strip.left) / rules.cell)
            if _survey(scene, rules, strip, cell)[0] > rules.trigger:
                return i, j


@leaf
def _try(
    scene: Scene,
    brush: Brush,
    rules: Rules,
    strip: Strip,
    easel: _Easel,
    kept: _Kept,
    tally: _Tally,
    i: int,
    j: int,
    dab: bool,
) -> None:
    """Keep the stroke through pixel (i, j) if it is worth it; `dab`: the shortest there is, whatever it is worth."""
    rows, columns = scene.photo.shape
    tract, chain = easel.tract, easel.chain
    mark = strip.first_mark + 3 * tally.tries[0]
    tally.tries[0] += 1
    width = brush.width
    if rules.vary_width:
        width *= min(max(1.0 / np.sqrt(scene.weight[i, j]), NARROWEST), WIDEST)
    # Footprints that decide about covering are half a pixel thinner all round than the stroke, so
    # that no antialiased border lets the canvas through.
    thick = max(width - 1.0, 0.5 * width) if rules.cover else width
    if dab:
        tract[0, 0], tract[0, 1] = j + 0.5 - 0.1 * width, i + 0.5
        tract[1, 0], tract[1, 1] = j + 0.5 + 0.1 * width, i + 0.5
        first, last = 0, 2
    else:
        first, last = 0, 0
        for look in range(2) if rules.by_gain else range(1, 2):
            first, last = trace(
                scene.samples, scene.scale, columns, rows, j + 0.5, i + 0.5,
                brush.length * (FIRST_LOOK if look == 0 else 1.0), brush.coherence,
                brush.step_tolerance, brush.max_step, brush.both_ways, brush.aligned, brush.wander,
                BEND_WIDTHS * brush.width, splitmix64(scene.key, np.uint64(i * columns + j)), tract,
            )  # fmt: skip
            first, last = _within_bounds(scene, rules, tract, first, last)
            if rules.by_gain and last - first > 1:
                begin, end = first, last
                first, last, estimate = _best_stretch(scene, tract, first, last, thick, easel.sums)
                ends_inside = begin < first and last < end
                if estimate < rules.gain * (ESTIMATE if look == 1 or ends_inside else HOPE):
                    return
                if ends_inside:
                    break
        if _length(tract, first, last) < brush.min_length:
            return
    n = rdp(tract, first, last, brush.simplify_tolerance, easel.vertices, easel.room) if last - first > 1 else 0
    if n < (2 if dab else brush.min_vertices):
        return
    pieces = fit(easel.vertices, n, brush.fit_tolerance, brush.bounded, chain, 0, easel.room)
    covered = footprint(scene.stamp, mark, chain, 0, pieces, thick, brush.round_cap, easel.pixels)
    gain, colour = _gain(scene, easel.pixels, covered)
    if covered == 0 or (rules.by_gain and not dab and gain < rules.gain):
        return
    _lay(scene, easel.pixels, covered, strip.first_id + tally.strokes[0], colour)
    if rules.seeding == EVEN:
        for k, lane, distance in ((1, _NEAR, TEST_DISTANCE * rules.separation), (2, _LANE, rules.separation)):
            marked = footprint(scene.stamp, mark + k, chain, 0, pieces, 2.0 * distance, True, easel.pixels)
            for p in range(marked):
                scene.lanes[easel.pixels[p, 0], easel.pixels[p, 1]] |= lane
    n, used = tally.strokes[0], tally.points[0]
    for k in range(3 * pieces + 1):
        kept.points[used + k, 0], kept.points[used + k, 1] = chain[k, 0], chain[k, 1]
    kept.counts[n], kept.widths[n], kept.colours[n] = 3 * pieces + 1, width, colour
    tally.strokes[0] += 1
    tally.points[0] += 3 * pieces + 1


@kernel
def _with_room(kept: _Kept, strokes: int, used: int, more: int) -> _Kept:
    """Longer columns with the same strokes in front."""
    points, counts = np.empty((2 * len(kept.points) + more, 2)), np.empty(2 * strokes + 64, np.int64)
    widths, colours = np.empty(2 * strokes + 64), np.empty(2 * strokes + 64, np.uint32)
    points[:used], counts[:strokes], widths[:strokes], colours[:strokes] = (
        kept.points[:used], kept.counts[:strokes], kept.widths[:strokes], kept.colours[:strokes],
    )  # fmt: skip
    return _Kept(points, counts, widths, colours)


@leaf
def _shape(strip: Strip, side: float) -> tuple[int, int]:
    """Rows and columns of the cells of a strip."""
    return int(np.ceil((strip.bottom - strip.top) / side)), int(np.ceil((strip.right - strip.left) / side))


@leaf
def _window(rules: Rules, strip: Strip, cell: int) -> tuple[int, int, int, int]:
    """Pixels top, bottom, left, right of a cell."""
    row, column = divmod(cell, _shape(strip, rules.cell)[1])
    top, bottom = strip.top + int(row * rules.cell), min(strip.top + int((row + 1) * rules.cell), strip.bottom)
    left, right = strip.left + int(column * rules.cell), min(strip.left + int((column + 1) * rules.cell), strip.right)
    return top, bottom, left, right


@leaf
def _centre(rules: Rules, strip: Strip, cell: int) -> tuple[int, int]:
    top, bottom, left, right = _window(rules, strip, cell)
    return (top + bottom) // 2, (left + right) // 2


@leaf
def _survey(scene: Scene, rules: Rules, strip: Strip, cell: int) -> tuple[float, int, int]:
    """Mean of a cell, see Rules.trigger, and its pixel of the largest error."""
    top, bottom, left, right = _window(rules, strip, cell)
    total, largest, worst_i, worst_j = 0.0, -1.0, top, left
    errors, by_gain = scene.error, rules.by_gain
    for i in range(top, bottom):
        for j in range(left, right):
            error = errors[i, j]
            total += error if by_gain else np.sqrt(error)
            if error > largest:
                largest, worst_i, worst_j = error, i, j
    return total / max((bottom - top) * (right - left), 1), worst_i, worst_j


@leaf
def _mass(scene: Scene, rules: Rules, strip: Strip, cell: int) -> float:
    """What a cell weighs when seeds are drawn: nothing if it need not be tried."""
    mean = _survey(scene, rules, strip, cell)[0]
    top, bottom, left, right = _window(rules, strip, cell)
    return mean * (bottom - top) * (right - left) if mean > rules.trigger else 0.0


@leaf
def _draw_pixel(scene: Scene, rules: Rules, strip: Strip, cell: int, share: float) -> tuple[int, int]:
    """The pixel of a cell at which the sum of its errors passes `share`."""
    top, bottom, left, right = _window(rules, strip, cell)
    for i in range(top, bottom):
        for j in range(left, right):
            share -= scene.error[i, j] if rules.by_gain else np.sqrt(scene.error[i, j])
            if share < 0.0:
                return i, j
    return bottom - 1, right - 1


@leaf
def _random(key: np.uint64, counter: int) -> float:
    """A number in [0, 1) for each key and counter."""
    return float(splitmix64(key, np.uint64(counter)) >> np.uint64(11)) * 2.0**-53


@leaf
def _change(tree: NDArray[np.float64], mass: NDArray[np.float64], cell: int, value: float) -> None:
    """Give a cell of a Fenwick tree (P. Fenwick 1994) another mass."""
    change = value - mass[cell]
    mass[cell] = value
    k = cell + 1
    while k < len(tree):
        tree[k] += change
        k += k & -k


@leaf
def _prefix(tree: NDArray[np.float64], cells: int) -> float:
    """Mass of the first cells."""
    total, k = 0.0, cells
    while k > 0:
        total += tree[k]
        k -= k & -k
    return total


@leaf
def _find(tree: NDArray[np.float64], share: float) -> int:
    """The cell in which the running mass passes `share`."""
    k, step = 0, 1
    while 2 * step < len(tree):
        step *= 2
    while step > 0:
        if k + step < len(tree) and tree[k + step] <= share:
            k += step
            share -= tree[k]
        step //= 2
    return min(k, len(tree) - 2)


@leaf
def _within_bounds(scene: Scene, rules: Rules, tract: NDArray[np.float64], first: int, last: int) -> tuple[int, int]:
    """The stretch of tract[first:last] around its seed that stays in one region and clear of evenly spaced strokes."""
    if scene.regions.size == 1 and rules.seeding != EVEN:
        return first, last
    seed = len(tract) // 2
    region = _label(scene, tract, seed)
    begin = end = seed
    while begin > first and _label(scene, tract, begin - 1) == region:
        begin -= 1
    while end + 1 < last and _label(scene, tract, end + 1) == region:
        end += 1
    return begin, end + 1


@leaf
def _label(scene: Scene, tract: NDArray[np.float64], k: int) -> int:
    """The region of a point of a tract; −1 if it is too near to a stroke that it must not approach."""
    rows, columns = scene.photo.shape
    i = min(max(int(tract[k, 1]), 0), rows - 1)
    j = min(max(int(tract[k, 0]), 0), columns - 1)
    if scene.lanes.size > 1 and scene.lanes[i, j] & _NEAR:
        return -1
    return int(scene.regions[i, j]) if scene.regions.size > 1 else 0


@leaf
def _length(points: NDArray[np.float64], first: int, last: int) -> float:
    """Of the polyline points[first:last]."""
    length = 0.0
    for k in range(first + 1, last):
        length += np.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
    return length


@leaf
def _best_stretch(
    scene: Scene, tract: NDArray[np.float64], first: int, last: int, width: float, sums: NDArray[np.float64]
) -> tuple[int, int, float]:
    """The stretch of tract[first:last] whose stroke would gain most, as (first, last), and what it would gain.

    Sections across the tract are sampled once; their running sums give the gain of any stretch at once
    (round ends, and limits to the choice of colour, left out).
    """
    photo, weight, error = scene.photo, scene.weight, scene.error
    rows, columns = photo.shape
    n = last - first
    spacing = max(1.0, width / ACROSS)
    samples = max(round(width / spacing), 1)
    for k in range(n):
        before, after = first + max(k - 1, 0), first + min(k + 1, n - 1)
        dx, dy = tract[after, 0] - tract[before, 0], tract[after, 1] - tract[before, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        nx, ny = (-dy / distance, dx / distance) if distance > 0.0 else (0.0, 0.0)
        area = 0.5 * distance * spacing
        old = weights = red = green = blue = squares = 0.0
        for s in range(samples):
            across = (s + 0.5 - 0.5 * samples) * spacing
            j = int(np.floor(tract[first + k, 0] + across * nx))
            i = int(np.floor(tract[first + k, 1] + across * ny))
            if 0 <= i < rows and 0 <= j < columns:
                w, r, g, b = _pixel(photo, weight, i, j)
                old += error[i, j]
                weights += w
                red += w * r
                green += w * g
                blue += w * b
                squares += w * (r * r + g * g + b * b)
        sums[k + 1, 0] = sums[k, 0] + area * old
        sums[k + 1, 1] = sums[k, 1] + area * weights
        sums[k + 1, 2] = sums[k, 2] + area * red
        sums[k + 1, 3] = sums[k, 3] + area * green
        sums[k + 1, 4] = sums[k, 4] + area * blue
        sums[k + 1, 5] = sums[k, 5] + area * squares
    stride = max((n - 1) // SECTIONS, 1)
    best, best_a, best_b = -np.inf, 0, n - 1
    for a in range(0, n - 1, stride):
        b = a
        while b < n - 1:
            b = min(b + stride, n - 1)
            weights = sums[b + 1, 1] - sums[a, 1]
            if weights > 0.0:
                red, green, blue = sums[b + 1, 2] - sums[a, 2], sums[b + 1, 3] - sums[a, 3], sums[b + 1, 4] - sums[a, 4]
                left = sums[b + 1, 5] - sums[a, 5] - (red * red + green * green + blue * blue) / weights
                gain = sums[b + 1, 0] - sums[a, 0] - left
                if gain > best:
                    best, best_a, best_b = gain, a, b
    return first + best_a, first + best_b + 1, best


@leaf
def _pixel(photo: Packed, weight: NDArray[np.float32], i: int, j: int) -> tuple[float, float, float, float]:
    """Weight, red, green and blue of the photo."""
    value = np.int64(photo[i, j])
    return float(weight[i, j]), float(value >> 16), float((value >> 8) & 255), float(value & 255)


@leaf
def _gain(scene: Scene, pixels: NDArray[np.int32], n: int) -> tuple[float, np.uint32]:
    """What a footprint in its best colour takes from the error, and that colour."""
    photo, weight, error = scene.photo, scene.weight, scene.error
    old = weights = red = green = blue = squares = 0.0
    for k in range(n):
        i, j = pixels[k, 0], pixels[k, 1]
        w, r, g, b = _pixel(photo, weight, i, j)
        old += error[i, j]
        weights += w
        red += w * r
        green += w * g
        blue += w * b
        squares += w * (r * r + g * g + b * b)
    if weights == 0.0:
        return -np.inf, np.uint32(0)
    colour = _suited(scene.choice, red / weights, green / weights, blue / weights)
    value = np.int64(colour)
    r, g, b = float(value >> 16), float((value >> 8) & 255), float(value & 255)
    left = squares - 2.0 * (r * red + g * green + b * blue) + (r * r + g * g + b * b) * weights
    return old - left, colour


@leaf
def _suited(choice: NDArray[np.uint32], red: float, green: float, blue: float) -> np.uint32:
    """The packed colour that stands for a mean of colours."""
    r, g, b = int(red + 0.5), int(green + 0.5), int(blue + 0.5)
    if len(choice) > 0:
        return np.uint32(choice[((r >> 3) << 10) | ((g >> 3) << 5) | (b >> 3)])
    return np.uint32((r << 16) | (g << 8) | b)


@leaf
def _squared_distance(a: np.uint32, b: np.uint32) -> float:
    """Between two packed colours."""
    x, y = np.int64(a), np.int64(b)
    dr, dg, db = (x >> 16) - (y >> 16), ((x >> 8) & 255) - ((y >> 8) & 255), (x & 255) - (y & 255)
    return float(dr * dr + dg * dg + db * db)


@leaf
def _lay(scene: Scene, pixels: NDArray[np.int32], n: int, stroke: int, colour: np.uint32) -> None:
    photo, weight, error, ids, below = scene.photo, scene.weight, scene.error, scene.ids, scene.below
    for k in range(n):
        i, j = pixels[k, 0], pixels[k, 1]
        error[i, j] = weight[i, j] * _squared_distance(photo[i, j], colour)
        below[i, j], ids[i, j] = ids[i, j], stroke


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
                    k = np.searchsorted(provisional, number, side="right") - 1
                    numbers[i, j] = number - provisional[k] + final[k]


@kernel
def _mean_colours(
    photo: Packed,
    weight: NDArray[np.float32],
    ids: NDArray[np.int32],
    colours: NDArray[np.uint32],
    choice: NDArray[np.uint32],
) -> NDArray[np.uint32]:
    """The weighted mean colour of the pixels that each stroke shows; its own where it shows none."""
    sums = np.zeros((len(colours), 4))
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            stroke = ids[i, j]
            if stroke >= 0:
                value, w = np.int64(photo[i, j]), weight[i, j]
                sums[stroke, 0] += w
                sums[stroke, 1] += w * (value >> 16)
                sums[stroke, 2] += w * ((value >> 8) & 255)
                sums[stroke, 3] += w * (value & 255)
    means = colours.copy()
    for stroke in range(len(colours)):
        w = sums[stroke, 0]
        if w > 0.0:
            means[stroke] = _suited(choice, sums[stroke, 1] / w, sums[stroke, 2] / w, sums[stroke, 3] / w)
    return means


@leaf
def _measure_error(
    photo: Packed,
    weight: NDArray[np.float32],
    ids: NDArray[np.int32],
    colours: NDArray[np.uint32],
    background: np.uint32,
    error: NDArray[np.float32],
) -> None:
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            colour = colours[ids[i, j]] if ids[i, j] >= 0 else background
            error[i, j] = weight[i, j] * _squared_distance(photo[i, j], colour)


@kernel
def _removal_costs(
    photo: Packed,
    weight: NDArray[np.float32],
    ids: NDArray[np.int32],
    below: NDArray[np.int32],
    colours: NDArray[np.uint32],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """By how much the error grows if a stroke is taken away, and whether it is seen.

    Infinite where what lies below is canvas, or not known.
    """
    costs, seen = np.zeros(len(colours)), np.zeros(len(colours), np.bool_)
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
                    _squared_distance(value, colours[under]) - _squared_distance(value, colours[top])
                )
    return costs, seen


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
                sums[top] += np.inf if under < 0 else np.sqrt(_squared_distance(colours[top], colours[under]))
    return sums / np.maximum(counts, 1.0)


@kernel
def _look_below(
    ids: NDArray[np.int32],
    below: NDArray[np.int32],
    stamp: NDArray[np.int32],
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    widths: NDArray[np.float64],
    mark: int,
) -> None:
    ids[:], below[:] = -1, -1
    pixels = np.empty((stamp.size, 2), np.int32)
    first = 0
    for stroke in range(len(counts)):
        mark -= 1
        for k in range(footprint(stamp, mark, points, first, counts[stroke] // 3, widths[stroke], True, pixels)):
            i, j = pixels[k, 0], pixels[k, 1]
            below[i, j], ids[i, j] = ids[i, j], stroke
        first += counts[stroke]


@kernel
def _keep_covered(
    stamp: NDArray[np.int32],
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    widths: NDArray[np.float64],
    drop: NDArray[np.bool_],
    mark: int,
) -> None:
    """Take back what is to be dropped and covers a pixel that no other stroke covers with half a pixel to spare."""
    solid = np.zeros(stamp.shape, np.uint32)
    first = 0
    for stroke in range(len(counts)):
        if not drop[stroke]:
            thin = max(widths[stroke] - 1.0, 0.5 * widths[stroke])
            paint_chain(solid, points, first, counts[stroke] // 3, thin, True, np.uint32(1))
        first += counts[stroke]
    pixels = np.empty((stamp.size, 2), np.int32)
    first = 0
    for stroke in range(len(counts)):
        if drop[stroke]:
            mark -= 1
            thin = max(widths[stroke] - 1.0, 0.5 * widths[stroke])
            n = footprint(stamp, mark, points, first, counts[stroke] // 3, thin, True, pixels)
            needed = False
            for k in range(n):
                needed = needed or solid[pixels[k, 0], pixels[k, 1]] == 0
            if needed:
                drop[stroke] = False
                for k in range(n):
                    solid[pixels[k, 0], pixels[k, 1]] = 1
        first += counts[stroke]
