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
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, footprint, mean_distance, paint_chain
from strokeplan.curves import Scratch, fit, rdp, scratch
from strokeplan.field import OrientationField
from strokeplan.jit import inlined, is_cached, kernel, leaf
from strokeplan.merging import merge as merge_strokes
from strokeplan.painting import BEND_WIDTHS, Brush, LayerStrokes, Workers
from strokeplan.tractography import Course, depart, splitmix64, tract_capacity, travel, uniform

Result = TypeVar("Result")

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
SOLVES, DAMPING = 4, 0.8
"""Steps towards the colours that suit best together, and the part of each that is taken: whole ones overshoot."""
BANDS = 8
"""Parts of a picture that several threads measure, one each at a time."""
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
    spare: float
    """By how much strokes that cover are planned thinner than they are painted: a pixel of the photo, so that no
    antialiased border lets the canvas through."""
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
    spans: NDArray[np.int32]
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
    round_cap: bool
    error: NDArray[np.float32]
    ids: NDArray[np.int32]
    below: NDArray[np.int32]
    stamp: NDArray[np.int32]
    layers: list[LayerStrokes]
    workers: Workers
    marks: int = 0
    near: list[NDArray[np.uint32]] | None = None
    """What `look_closely` saw in every band, while the strokes that were there then still are what they were."""
    near_strokes: int = 0

    @classmethod
    def begin(
        cls,
        photo: Packed,
        weight: NDArray[np.float32],
        background: int,
        round_cap: bool = True,
        regions: NDArray[np.int32] | None = None,
        choice: NDArray[np.uint32] | None = None,
        workers: Workers | None = None,
    ) -> Pursuit:
        """A bare canvas of one colour 0xRRGGBB."""
        nobody = np.full(photo.shape, -1, np.int32)
        pursuit = cls(
            photo,
            weight,
            np.zeros((1, 1), np.int32) if regions is None else regions,
            np.empty(0, np.uint32) if choice is None else choice,
            background,
            round_cap,
            error=np.empty(photo.shape, np.float32),
            ids=nobody,
            below=nobody.copy(),
            stamp=nobody.copy(),
            layers=[],
            workers=workers or Workers(),
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
        sums = np.zeros((len(self._bands()), 5))
        self._by_bands(lambda k, rows: _add_flat(self.photo[rows], self.weight[rows], sums[k]))
        total, squares = sums.sum(axis=0)[:4], float(sums[:, 4].sum())
        colour = _means(total[None], np.zeros(1, np.uint32), np.empty(0, np.uint32))[0]
        r, g, b = int(colour >> 16), int(colour >> 8 & 255), int(colour & 255)
        return squares - 2 * float(total[1:] @ (r, g, b)) + (r * r + g * g + b * b) * float(total[0])

    def mean_distance(self) -> float:
        """Mean RGB distance of photo and picture, of a sample of the pixels."""
        return mean_distance(self.photo, self.canvas(), 0, self.photo.shape[0], 0, self.photo.shape[1], 8, 1.0)

    def canvas(self) -> Packed:
        """The picture as it is."""
        return self._with_background()[self.ids]  # a bare pixel's −1 is the last

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
        before, layer = self.strokes, len(self.layers)
        known = before
        kept: list[Laid] = []
        tell(0, len(strips), 0)
        for phase in (strips[::2], strips[1::2]):
            laid = workers.run(lambda strip: _paint_strip(scene, brush, rules, strip), phase)
            if laid:
                final = known + np.cumsum([0, *(len(counts) for _, counts, _, _ in laid)])
                first = np.array([strip.first_id for strip in phase])
                self._by_bands(lambda _, rows: _renumber(self.ids[rows], self.below[rows], first, final))  # noqa: B023
                known = int(final[-1])
            kept += laid
            self.layers[layer:] = [LayerStrokes(*(np.concatenate(column) for column in zip(*kept, strict=True)))]
            tell(len(kept), len(strips), known - before)
        self.refit()

    def _strips(self, brush: Brush, rules: Rules) -> Iterator[Strip]:
        """Strips across the longer side, each wider than what strokes of both its neighbours reach into it."""
        height, width = self.photo.shape
        widest = brush.width * (WIDEST if rules.vary_width else 1)
        reach = brush.length * (0.5 if brush.both_ways else 1) + brush.simplify_tolerance + brush.fit_tolerance
        reach += max(widest, rules.separation) + 2
        count = max(int(max(height, width) // (2 * reach)), 1)
        edges = [round(max(height, width) * k / count) for k in range(count + 1)]
        windows: list[tuple[int, int, int, int]] = [
            (0, height, low, high) if width >= height else (low, high, 0, width) for low, high in pairwise(edges)
        ]
        tries = [TRIES * _cells(*window, rules.cell) for window in windows]
        first_id = self.strokes + sum(tries)  # above what any stroke of the layer will be numbered
        for (top, bottom, left, right), most in zip(windows, tries, strict=True):
            yield Strip(top, bottom, left, right, first_id, self.marks)
            first_id += most
            self.marks += 3 * most

    def refit(self) -> None:
        """Every stroke takes the mean colour of what it shows; the error follows."""
        sums = np.zeros((len(self._bands()), self.strokes, 4))
        self._by_bands(lambda k, rows: _add_all(self.photo[rows], self.weight[rows], self.ids[rows], sums[k]))
        self._recolour(_means(sums.sum(axis=0), self.colours, self.choice))
        self._measure()

    def prune(self, least: float, *, spare_first: bool = False) -> None:
        """Drop the strokes that are seen and without which the error would grow by less than `least`.

        `spare_first`: but those of the first layer, which cover the canvas.
        """
        costs, seen = self._removal_costs()
        drop = (costs < least) & seen
        drop[: len(self.layers[0].counts) if spare_first else 0] = False
        self._drop(drop, costs)

    def look_closely(self) -> None:
        """Measure the error as an antialiased picture has it, in which seams between strokes show what lies below."""
        shown, seen = self._with_background(), self._closely()

        def measure(band: int, rows: slice) -> NDArray[np.uint32]:
            numbers = seen(band, rows)
            _compare(self.photo[rows], self.weight[rows], numbers, shown, self.error[rows])
            return numbers

        self.near, self.near_strokes = self._by_bands(measure), self.strokes

    def finish(self, spare: float | None = None) -> Packed:
        """Drop strokes that nobody sees, give the others the colours that suit best together; return the picture.

        All as an antialiased picture has it. With `spare` (see Rules) what alone covers a part of the canvas stays, in
        the colour that is wanted there.
        """
        seen, n = self._closely(), self.strokes
        numbers = self._by_bands(seen)
        colours = np.stack([self._with_background() >> shift & 255 for shift in (16, 8, 0)], axis=-1).astype(np.float64)
        for _ in range(SOLVES):
            parts = np.zeros((len(numbers), n + 1, 4))
            self._by_bands(
                lambda k, rows: _add_residuals(self.photo[rows], self.weight[rows], numbers[k], colours, parts[k])  # noqa: B023
            )
            sums = parts.sum(axis=0)
            colours[:n] += DAMPING * sums[:n, 1:] / np.maximum(sums[:n, :1], 1e-9)
            np.clip(colours, 0, 255, out=colours)
        drop = sums[:n, 0] == 0
        if spare is not None:
            self._keep_covered(spare, drop, colours)
        self._recolour(_packed(colours[:n], self.choice))
        shown, picture = self._with_background(), np.empty_like(self.photo)
        self._by_bands(lambda k, rows: _reduce(numbers[k], shown, picture[rows]))
        self._leave_out(drop)
        return picture

    def _keep_covered(self, spare: float, drop: NDArray[np.bool_], colours: NDArray[np.float64]) -> None:
        """Take back what is to be dropped and covers a pixel that no other stroke, thinner by `spare`, covers.

        Its colour becomes the mean of the photo there.
        """
        points, counts, widths = self._outlines()
        thin = np.maximum(widths - spare, 0.5 * widths)
        stay = points[np.repeat(~drop, counts)], counts[~drop], thin[~drop]
        solid = np.empty(self.photo.shape, np.bool_)

        def cover(_: int, rows: slice) -> None:
            np.less(self._number(*stay, rows, 1), len(stay[1]), out=solid[rows])

        self._by_bands(cover)
        gone = np.flatnonzero(drop)
        firsts = (np.cumsum(counts) - counts)[gone]
        room = self._largest_footprint(points, counts, thin)
        self.marks += len(gone)
        _keep_covering(
            self.photo, self.stamp, solid, points, firsts, counts[gone], thin[gone], self.round_cap, gone, drop,
            self.marks, colours, np.full((len(solid), 3), -1, np.int32), room,
        )  # fmt: skip

    def _largest_footprint(
        self, points: NDArray[np.float64], counts: NDArray[np.int64], widths: NDArray[np.float64]
    ) -> NDArray[np.int32]:
        """Room for the pixels of any one of these strokes."""
        if len(counts) == 0:
            return np.empty((0, 2), np.int32)
        # No curve is longer than its control polygon.
        steps = np.append(np.hypot(*np.diff(points, axis=0).T), 0.0)
        steps[np.cumsum(counts) - 1] = 0.0
        lengths = np.add.reduceat(steps, np.cumsum(counts) - counts)
        largest = float(np.max((lengths + widths + 4) * (widths + 4)))
        return np.empty((min(ceil(largest), self.stamp.size), 2), np.int32)

    def _removal_costs(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """By how much the error grows if a stroke is taken away, and whether it is seen.

        Infinite where what lies below is canvas, or not known.
        """
        costs, seen = np.zeros(self.strokes), np.zeros(self.strokes, np.bool_)
        _add_removal_costs(self.photo, self.weight, self.ids, self.below, self.colours, costs, seen)
        return costs, seen

    def _bands(self) -> list[slice]:
        height = len(self.photo)
        return [slice(height * k // BANDS, height * (k + 1) // BANDS) for k in range(BANDS)]

    def _by_bands(self, work: Callable[[int, slice], Result]) -> list[Result]:
        """`work` of the number and the rows of every band, several at a time; what each does depends on no other."""
        return self.workers.run(lambda band: work(*band), list(enumerate(self._bands())))

    def _with_background(self) -> NDArray[np.uint32]:
        """(n + 1,) packed colours of all strokes, and of the canvas."""
        return np.append(self.colours, np.uint32(self.background))

    def _closely(self) -> Callable[[int, slice], NDArray[np.uint32]]:
        """What tells which stroke shows where in a band of the picture, painted at twice the size; their count for
        none. Strokes that `look_closely` has seen are not painted again."""
        points, counts, widths = self._outlines()
        near, known = self.near, self.near_strokes if self.near else 0
        outlines = points[counts[:known].sum() :], counts[known:], widths[known:]

        def seen(band: int, rows: slice) -> NDArray[np.uint32]:
            if near is None:
                return self._number(*outlines, rows, 2)
            near[band][near[band] == known] = len(counts)
            return self._number(*outlines, rows, 2, known, near[band])

        return seen

    def _number(
        self,
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
        size = scale * (rows.stop - rows.start), scale * self.photo.shape[1]
        numbers = np.full(size, len(counts), np.uint32) if below is None else below
        chain = np.empty((int(counts.max(initial=0)), 2))
        _paint_numbers(numbers, points, counts, widths, self.round_cap, rows.start, rows.stop, scale, first, chain)
        return numbers

    def limit(self, most: int) -> None:
        """Drop the strokes that are missed least until no more than `most` are left, even if canvas shows."""
        if self.strokes <= most:
            return
        while self.strokes > most:
            self._look_below()
            costs, seen = self._removal_costs()
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
        outlines, spans = self._outlines(), np.full((len(self.ids), 3), -1, np.int32)
        self.ids[:], self.below[:] = -1, -1
        _look_below(
            self.ids, self.below, self.stamp, *outlines, self.round_cap, self.marks, spans,
            self._largest_footprint(*outlines),
        )  # fmt: skip
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
            self.near = None
            self._look_below()

    def thin(self, least: float) -> None:
        """Drop strokes that differ from what lies below them by less than a mean RGB distance of `least`."""
        distances = _mean_distances(self.ids, self.below, self.colours)
        self._drop(distances < least, distances)

    def _drop(self, drop: NDArray[np.bool_], worth: NDArray[np.float64]) -> None:
        """Take strokes away; where two lie on each other, the one that is worth more stays."""
        _spare(self.ids, self.below, worth, drop)
        _uncover(self.ids, self.below, drop, np.cumsum(~drop, dtype=np.int32) - np.int32(1))
        self._leave_out(drop)
        self.refit()

    def _leave_out(self, drop: NDArray[np.bool_]) -> None:
        self.near = None
        for layer, dropped in zip(self.layers, self._by_layer(drop), strict=True):
            layer.points = layer.points[np.repeat(~dropped, layer.counts)]
            layer.counts, layer.widths, layer.colours = (
                column[~dropped] for column in (layer.counts, layer.widths, layer.colours)
            )

    def _recolour(self, colours: NDArray[np.uint32]) -> None:
        for layer, own in zip(self.layers, self._by_layer(colours), strict=True):
            layer.colours = own

    def _by_layer(self, column: NDArray[Any]) -> list[NDArray[Any]]:
        return np.split(column, np.cumsum([len(layer.counts) for layer in self.layers])[:-1])

    def _measure(self) -> None:
        colours, background = self.colours, np.uint32(self.background)

        def measure(_: int, rows: slice) -> None:
            _measure_error(self.photo[rows], self.weight[rows], self.ids[rows], colours, background, self.error[rows])

        self._by_bands(measure)


def _cells(top: int, bottom: int, left: int, right: int, side: float) -> int:
    """How many cells a window has."""
    return ceil((bottom - top) / side) * ceil((right - left) / side)


def _paint_strip(scene: Scene, brush: Brush, rules: Rules, strip: Strip) -> Laid:
    """Try strokes all over a strip; return those that are kept."""
    capacity = tract_capacity(brush.length)
    widest = brush.width * (WIDEST if rules.vary_width else 1.0)
    room = int((2 * brush.length + 2 * widest + 64) * (max(widest, 2 * rules.separation) + 4))
    easel = _Easel(
        np.empty((capacity, 2)), np.empty((capacity, 2)), np.empty((3 * capacity + 1, 2)), np.zeros((capacity + 1, 6)),
        np.empty((room, 2), np.int32), np.full((len(scene.photo), 3), -1, np.int32), scratch(capacity),
    )  # fmt: skip
    cells = _cells(strip.top, strip.bottom, strip.left, strip.right, rules.cell)
    ranks, mass, tree = np.empty(cells), np.zeros(cells), np.zeros(cells + 1)
    _sow(scene, rules, strip, ranks, mass, tree)
    state = np.zeros(8, np.int64)
    state[_DRAWN] = -1
    seeds = _Seeds(np.argsort(ranks, kind="stable"), mass, tree, state)
    kept = _Kept(np.empty((4096, 2)), np.empty(1024, np.int64), np.empty(1024), np.empty(1024, np.uint32))
    tally = _Tally(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(1, np.int64))
    while not _try_seeds(scene, brush, rules, strip, easel, kept, tally, seeds):
        kept = _Kept(*(np.concatenate([column, np.empty_like(column)]) for column in kept))
        if len(kept.points) < tally.points[0] + len(easel.chain):
            kept = kept._replace(points=np.concatenate([kept.points, np.empty_like(easel.chain)]))
    n = int(tally.strokes[0])
    return kept.points[: tally.points[0]], kept.counts[:n], kept.widths[:n], kept.colours[:n]


def _means(sums: NDArray[np.float64], colours: NDArray[np.uint32], choice: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The colour that stands for each stroke's sums; its own where these are empty."""
    weights = sums[:, :1]
    means = _packed(np.divide(sums[:, 1:], weights, out=np.zeros((len(sums), 3)), where=weights > 0), choice)
    return np.where(weights[:, 0] > 0, means, colours)


def _packed(colours: NDArray[np.float64], choice: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The packed colours that stand for (n, 3) means."""
    packed = np.empty(len(colours), np.uint32)
    _pack_suited(colours, choice, packed)
    return packed


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first pursuit compiles them."""
    return is_cached(_try_seeds)


@leaf
def _sow(
    scene: Scene,
    rules: Rules,
    strip: Strip,
    ranks: NDArray[np.float64],
    mass: NDArray[np.float64],
    tree: NDArray[np.float64],
) -> None:
    """Where the cells of a strip stand in their order, or the tree to draw them from."""
    for cell in range(len(ranks)):
        if rules.seeding == WORST_FIRST:
            ranks[cell] = -_survey(scene, rules, strip, cell)[0]
        else:
            ranks[cell] = uniform(scene.key, np.uint64(cell))
        if rules.seeding == BY_ERROR:
            _change(tree, mass, cell, _mass(scene, rules, strip, cell))


@leaf
def _try_seeds(
    scene: Scene,
    brush: Brush,
    rules: Rules,
    strip: Strip,
    easel: _Easel,
    kept: _Kept,
    tally: _Tally,
    seeds: _Seeds,
) -> bool:
    """Try seed after seed; False if a stroke might not find room in the columns, for the caller to enlarge them."""
    limit = TRIES * len(seeds.order) - 1
    # One loop for all ways to find seeds: the compiler makes a copy of `_try` wherever it is called.
    while tally.tries[0] < limit:
        if tally.strokes[0] == len(kept.counts) or tally.points[0] + len(easel.chain) > len(kept.points):
            return False
        i, j, dab = _next_seed(scene, rules, strip, seeds, kept, tally)
        if i < 0:
            return True
        _try(scene, brush, rules, strip, easel, kept, tally, i, j, dab)
    return True


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
        cell = _find(seeds.tree, uniform(key, np.uint64(0)) * total)
        before, now = seeds.mass[cell], _mass(scene, rules, strip, cell)
        _change(seeds.tree, seeds.mass, cell, now)
        if now > 0.0 and uniform(key, np.uint64(1)) * before <= now:
            state[_DRAWN], state[_LAID] = cell, tally.strokes[0]
            return _draw_pixel(scene, rules, strip, cell, uniform(key, np.uint64(2)) * now)
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
    thick = _thinner(width, rules.spare) if rules.cover else width
    if dab:
        tract[0, 0], tract[0, 1] = j + 0.5 - 0.1 * width, i + 0.5
        tract[1, 0], tract[1, 1] = j + 0.5 + 0.1 * width, i + 0.5
        first, last = 0, 2
    else:
        first, last = 0, 0
        course = Course(
            scene.samples, scene.scale, columns, rows, brush.coherence, brush.step_tolerance, brush.max_step,
            brush.aligned, brush.wander, BEND_WIDTHS * brush.width,
            splitmix64(scene.key, np.uint64(i * columns + j)),
        )  # fmt: skip
        reach = brush.length * (0.5 if brush.both_ways else 1.0)
        ahead, back = depart(course, j + 0.5, i + 0.5, brush.both_ways, tract)
        for look in range(2) if rules.by_gain else range(1, 2):
            part = FIRST_LOOK if look == 0 else 1.0
            first, last, ahead, back = travel(course, ahead, back, part * reach, tract)
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
    covered = footprint(scene.stamp, mark, easel.spans, chain, 0, pieces, thick, brush.round_cap, easel.pixels)
    gain, colour = _gain(scene, easel.pixels, covered)
    if covered == 0 or (rules.by_gain and not dab and gain < rules.gain):
        return
    _lay(scene, easel.pixels, covered, strip.first_id + tally.strokes[0], colour)
    if rules.seeding == EVEN:
        for k, lane, distance in ((1, _NEAR, TEST_DISTANCE * rules.separation), (2, _LANE, rules.separation)):
            marked = footprint(scene.stamp, mark + k, easel.spans, chain, 0, pieces, 2.0 * distance, True, easel.pixels)
            for p in range(marked):
                scene.lanes[easel.pixels[p, 0], easel.pixels[p, 1]] |= lane
    n, used = tally.strokes[0], tally.points[0]
    for k in range(3 * pieces + 1):
        kept.points[used + k, 0], kept.points[used + k, 1] = chain[k, 0], chain[k, 1]
    kept.counts[n], kept.widths[n], kept.colours[n] = 3 * pieces + 1, width, colour
    tally.strokes[0] += 1
    tally.points[0] += 3 * pieces + 1


@leaf
def _thinner(width: float, spare: float) -> float:
    """The width at which a stroke counts as covering, see Rules.spare."""
    return max(width - spare, 0.5 * width)


@inlined
def _shape(strip: Strip, side: float) -> tuple[int, int]:
    """Rows and columns of the cells of a strip."""
    return int(np.ceil((strip.bottom - strip.top) / side)), int(np.ceil((strip.right - strip.left) / side))


@inlined
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


@inlined
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


@inlined
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
    rounding = 1e-9 * sums[n, 5]
    best, best_a, best_b = -np.inf, 0, n - 1
    for a in range(0, n - 1, stride):
        b = a
        while b < n - 1:
            b = min(b + stride, n - 1)
            weights, old = sums[b + 1, 1] - sums[a, 1], sums[b + 1, 0] - sums[a, 0]
            if weights > 0.0 and old > best - rounding:  # it gains no more than all there is
                red, green, blue = sums[b + 1, 2] - sums[a, 2], sums[b + 1, 3] - sums[a, 3], sums[b + 1, 4] - sums[a, 4]
                left = sums[b + 1, 5] - sums[a, 5] - (red * red + green * green + blue * blue) / weights
                gain = old - left
                if gain > best:
                    best, best_a, best_b = gain, a, b
    return first + best_a, first + best_b + 1, best


@inlined
def _pixel(photo: Packed, weight: NDArray[np.float32], i: int, j: int) -> tuple[float, float, float, float]:
    """Weight, red, green and blue of the photo."""
    value = np.int64(photo[i, j])
    return float(weight[i, j]), float(value >> 16), float((value >> 8) & 255), float(value & 255)


@inlined
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


@inlined
def _suited(choice: NDArray[np.uint32], red: float, green: float, blue: float) -> np.uint32:
    """The packed colour that stands for a mean of colours."""
    r, g, b = int(red + 0.5), int(green + 0.5), int(blue + 0.5)
    if len(choice) > 0:
        return np.uint32(choice[((r >> 3) << 10) | ((g >> 3) << 5) | (b >> 3)])
    return np.uint32((r << 16) | (g << 8) | b)


@inlined
def _squared_distance(a: np.uint32, b: np.uint32) -> float:
    """Between two packed colours."""
    x, y = np.int64(a), np.int64(b)
    dr, dg, db = (x >> 16) - (y >> 16), ((x >> 8) & 255) - ((y >> 8) & 255), (x & 255) - (y & 255)
    return float(dr * dr + dg * dg + db * db)


@inlined
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
                    k = len(provisional) - 1
                    while provisional[k] > number:
                        k -= 1
                    numbers[i, j] = number - provisional[k] + final[k]


@leaf
def _add_flat(photo: Packed, weight: NDArray[np.float32], sums: NDArray[np.float64]) -> None:
    """Add weights, weighted colours and weighted squares of all pixels to sums."""
    rows, columns = photo.shape
    for i in range(rows):
        for j in range(columns):
            w, r, g, b = _pixel(photo, weight, i, j)
            sums[0] += w
            sums[1] += w * r
            sums[2] += w * g
            sums[3] += w * b
            sums[4] += w * (r * r + g * g + b * b)


@leaf
def _add_all(photo: Packed, weight: NDArray[np.float32], ids: NDArray[np.int32], sums: NDArray[np.float64]) -> None:
    """Add weights and weighted colours of the pixels that each stroke shows to its sums."""
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            if ids[i, j] >= 0:
                _add(sums, ids[i, j], photo[i, j], weight[i, j])


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
def _reduce(numbers: NDArray[np.uint32], colours: NDArray[np.uint32], picture: Packed) -> None:
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
            error[i, j] = weight[i, j] * _squared_distance(photo[i, j], _mixed(numbers, colours, i, j))


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
            w, red, green, blue = _pixel(photo, weight, i, j)
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
def _pack_suited(colours: NDArray[np.float64], choice: NDArray[np.uint32], packed: NDArray[np.uint32]) -> None:
    for stroke in range(len(colours)):
        packed[stroke] = _suited(choice, colours[stroke, 0], colours[stroke, 1], colours[stroke, 2])


@leaf
def _add(sums: NDArray[np.float64], stroke: int, colour: np.uint32, weight: float) -> None:
    value = np.int64(colour)
    sums[stroke, 0] += weight
    sums[stroke, 1] += weight * (value >> 16)
    sums[stroke, 2] += weight * ((value >> 8) & 255)
    sums[stroke, 3] += weight * (value & 255)


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
                    _squared_distance(value, colours[under]) - _squared_distance(value, colours[top])
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
                sums[top] += np.inf if under < 0 else np.sqrt(_squared_distance(colours[top], colours[under]))
    return sums / np.maximum(counts, 1.0)


@leaf
def _look_below(
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
