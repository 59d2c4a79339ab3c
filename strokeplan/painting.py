"""One layer on the canvas: the grid of cells, which of them get a stroke, and the strokes themselves.

The cells are tried in random order. A cell whose mean RGB distance between photo and canvas exceeds the
layer's threshold is traced from its seed, the tract simplified, fitted, coloured and painted on the
canvas, which the next cells see (paper, "Image Stylization Filter").

Whether a cell gets a stroke depends on all strokes before it, so the cells are tried in one sequence. Its
stroke does not: worker threads trace strokes of the next batches for cells that look unpainted to them.
A cell they guessed wrong costs time and changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, mean_distance, paint_chain
from strokeplan.curves import Scratch, fit, rdp, scratch_inside
from strokeplan.field import OrientationField
from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.presets import LayerPreset, Preset
from strokeplan.tractography import splitmix64, trace, tract_capacity
from strokeplan.workers import Workers

BATCHES = 100
"""Parts of a layer between which progress is told, and Ctrl-C heard."""
AHEAD_POINTS_PER_CELL = 8
"""Room for strokes traced ahead, for each cell of a batch; most cells get none."""
BEND_WIDTHS = 4.0
"""Widths of the brush over which a wandering stroke changes its deviation: what turns faster looks shaky."""


class Axis(NamedTuple):
    """The cells of a grid along one axis: pixels start … stop − 1 and the seed's coordinate of each."""

    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    seed: NDArray[np.float64]


def cell_axis(size: int, width: float, grid: str = "cells") -> Axis:
    """Cells of a side of `size` pixels: see Preset.grid. Every pixel centre lies in one cell of "cells"."""
    if grid == "nodes":
        step = max(int(width), 1)
        nodes = np.arange(0, size, step)
        start, stop = nodes - step // 2, np.minimum(nodes + step // 2, size)
        # A window that begins before the picture is empty in the published code, and never painted.
        return Axis(np.maximum(start, 0), np.where(start < 0, 0, stop), (nodes + step // 2).astype(np.float64))
    edges: NDArray[np.float64] = np.minimum(np.arange(-(-size // width) + 1) * width, size)
    pixels = np.ceil(edges - 0.5).astype(np.int64)
    some = pixels[:-1] < pixels[1:]  # the last cell, or one narrower than a pixel, may hold no pixel's centre
    return Axis(pixels[:-1][some], pixels[1:][some], 0.5 * (edges[:-1] + edges[1:])[some])


@dataclass(slots=True)
class LayerStrokes:
    """The strokes of one layer: points (p, 2), and for each stroke their count, its width and packed colour."""

    points: NDArray[np.float64]
    counts: NDArray[np.int64]
    widths: NDArray[np.float64]
    colours: NDArray[np.uint32]


@dataclass(slots=True)
class _Columns:
    """Strokes as they come, with room to grow."""

    points: NDArray[np.float64]
    counts: NDArray[np.int64]
    colours: NDArray[np.uint32]

    def grow(self, room: int) -> None:
        self.points = _grown(self.points, room)
        self.counts = _grown(self.counts, room)
        self.colours = _grown(self.colours, room)


def _grown(column: NDArray[Any], room: int) -> NDArray[Any]:
    """A copy of at least twice the length, with at least `room` more rows."""
    grown = np.empty((max(2 * len(column), len(column) + room), *column.shape[1:]), column.dtype)
    grown[: len(column)] = column
    return grown


class Brush(NamedTuple):
    """What the kernels need to know of a layer; lengths in pixels."""

    width: float
    length: float
    min_length: float
    min_vertices: int
    simplify_tolerance: float
    fit_tolerance: float
    threshold: float
    coherence: float
    step_tolerance: float
    max_step: float
    wander: float
    photo_gain: float
    both_ways: bool
    aligned: bool
    bounded: bool
    round_cap: bool
    per_piece: bool


class _Scene(NamedTuple):
    """What the kernels look at while a layer is painted; only the canvas changes."""

    photo: Packed
    canvas: Packed
    samples: NDArray[np.float32]
    scale: float
    columns: Axis
    rows: Axis
    order: NDArray[np.int64]
    key: np.uint64


class _Ahead(NamedTuple):
    """Strokes traced before it is known whether they are laid: for each cell of a batch, where its chain
    begins and how many pieces it has (0: the tract is no stroke; −1: not traced) and its colour."""

    points: NDArray[np.float64]
    first: NDArray[np.int64]
    pieces: NDArray[np.int64]
    colours: NDArray[np.uint32]


def paint_layer(
    photo: Packed,
    canvas: Packed,
    field: OrientationField,
    preset: Preset,
    layer: LayerPreset,
    seeds: tuple[int, int],
    workers: Workers,
    tell: Callable[[int, int, int], None],
) -> LayerStrokes:
    """Try all cells of a layer in random order; paint what is laid on `canvas` and return it.

    `tell` is called with cells done, cells in all, and strokes laid so far.
    """
    brush = layer_brush(preset, layer)
    columns = cell_axis(field.width, layer.width, preset.grid)
    rows = cell_axis(field.height, layer.width, preset.grid)
    order = _cell_order(seeds, len(columns.start) * len(rows.start))
    scene = _Scene(photo, canvas, field.samples, field.scale, columns, rows, order, wander_key(seeds))
    capacity = tract_capacity(layer.length)
    room = 4 * capacity  # the most points that one tract may add
    strokes = _Columns(np.empty((room + 4096, 2)), np.empty(room + 1024, np.int64), np.empty(room + 1024, np.uint32))

    batch = -(-len(order) // BATCHES)
    traced = _TraceAhead(workers, lambda begin: _trace_batch(scene, brush, begin, batch, capacity))
    laid = used = 0
    tell(0, len(order), 0)
    for begin in range(0, len(order), batch):
        ahead = traced.take(begin, range(begin + batch, len(order), batch)) or _nothing_ahead(batch, 1)
        at, end = begin, min(begin + batch, len(order))
        while at < end:
            at, laid, used = _paint_cells(
                scene, brush, capacity, at, end, ahead, begin, strokes.points, strokes.counts, strokes.colours,
                laid, used,
            )  # fmt: skip
            if at < end:
                strokes.grow(room)
        tell(end, len(order), laid)
    return LayerStrokes(
        strokes.points[:used].copy(),
        strokes.counts[:laid].copy(),
        np.full(laid, layer.width),
        strokes.colours[:laid].copy(),
    )


def paint_strokes(canvas: Packed, strokes: LayerStrokes, round_cap: bool) -> None:
    """Paint strokes on a canvas, in their order."""
    _paint_chains(canvas, strokes.points, strokes.counts, strokes.widths, strokes.colours, round_cap)


class _TraceAhead:
    """Batches in work in the threads of an executor, two ahead for each."""

    def __init__(self, workers: Workers, trace_batch: Callable[[int], _Ahead]) -> None:
        self._executor, self._window, self._trace = workers.executor, 2 * workers.count, trace_batch
        self._futures: dict[int, Future[_Ahead]] = {}

    def take(self, begin: int, later: range) -> _Ahead | None:
        """The batch at `begin`, or None if no worker has begun it; `later` are the batches to come.

        While a worker is at it, this thread traces batches that no worker has begun.
        """
        if self._executor is None:
            return None
        for ahead in later[: self._window]:
            if ahead not in self._futures:
                self._futures[ahead] = self._executor.submit(self._trace, ahead)
        future = self._futures.pop(begin, None)
        if future is None or future.cancel():
            return None
        for ahead, waiting in self._futures.items():
            if future.done():
                break
            if waiting.cancel():
                self._futures[ahead] = Future()
                self._futures[ahead].set_result(self._trace(ahead))
        return future.result()


def layer_brush(preset: Preset, layer: LayerPreset) -> Brush:
    """The brush of a layer of a preset whose lengths are in pixels."""
    return Brush(
        width=layer.width,
        length=layer.length,
        min_length=layer.min_length,
        min_vertices=preset.min_vertices,
        simplify_tolerance=layer.simplify_tolerance,
        fit_tolerance=layer.fit_tolerance,
        threshold=layer.color_threshold,
        coherence=preset.coherence,
        step_tolerance=preset.step_tolerance,
        max_step=preset.max_step,
        wander=preset.wander,
        photo_gain=1 / 255 if preset.color_test == "unscaled" else 1.0,
        both_ways=preset.directions == "both",
        aligned=preset.interpolation == "aligned",
        bounded=preset.fit == "bounded",
        round_cap=preset.cap == "round",
        per_piece=preset.color == "handle",
    )


def _cell_order(seeds: tuple[int, int], cells: int) -> NDArray[np.int64]:
    """The cells of a layer, numbered by rows, in random order."""
    return np.random.default_rng(seeds).permutation(cells)


def wander_key(seeds: tuple[int, int]) -> np.uint64:
    """The key from which the cells of a layer have theirs, for (plan's seed, layer)."""
    # A child of the seeds: their own sequence orders the cells.
    return np.uint64(np.random.SeedSequence(seeds, spawn_key=(1,)).generate_state(1, np.uint64)[0])


def _trace_batch(scene: _Scene, brush: Brush, begin: int, batch: int, capacity: int) -> _Ahead:
    """Trace a batch of cells ahead of their turn, as far as its room goes."""
    ahead = _nothing_ahead(batch, 12 * capacity + AHEAD_POINTS_PER_CELL * batch)
    _trace_cells(scene, brush, capacity, begin, min(begin + batch, len(scene.order)), ahead)
    return ahead


def _nothing_ahead(batch: int, points: int) -> _Ahead:
    return _Ahead(
        np.empty((points, 2)), np.empty(batch, np.int64), np.full(batch, -1, np.int64), np.empty(batch, np.uint32)
    )


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first plan compiles them."""
    return is_cached(_paint_cells)


@leaf
def _cell_distance(scene: _Scene, cell: int, photo_gain: float) -> tuple[float, float, float]:
    """Mean distance of photo and canvas in a cell, and its seed x, y."""
    row, column = divmod(cell, len(scene.columns.start))
    distance = mean_distance(
        scene.photo, scene.canvas, scene.rows.start[row], scene.rows.stop[row],
        scene.columns.start[column], scene.columns.stop[column], 1, photo_gain,
    )  # fmt: skip
    return distance, scene.columns.seed[column], scene.rows.seed[row]


@leaf
def _trace_stroke(
    scene: _Scene,
    brush: Brush,
    cell: int,
    x: float,
    y: float,
    tract: NDArray[np.float64],
    vertices: NDArray[np.float64],
    room: Scratch,
    chain: NDArray[np.float64],
    at: int,
) -> tuple[int, np.uint32]:
    """The stroke through a cell's seed: its chain at chain[at:], its number of pieces (0: none) and its colour."""
    height, width = scene.photo.shape
    first, last = trace(
        scene.samples, scene.scale, width, height, x, y, brush.length, brush.coherence, brush.step_tolerance,
        brush.max_step, brush.both_ways, brush.aligned,
        brush.wander, BEND_WIDTHS * brush.width, splitmix64(scene.key, np.uint64(cell)), tract,
    )  # fmt: skip
    length, middle_x, middle_y = _middle(tract, first, last)
    colour = _colour(scene.photo, middle_x, middle_y)
    if last - first < 2 or length < brush.min_length:
        return 0, colour
    n = rdp(tract, first, last, brush.simplify_tolerance, vertices, room)
    if n < brush.min_vertices:
        return 0, colour
    return fit(vertices, n, brush.fit_tolerance, brush.bounded, chain, at, room), colour


@kernel
def _trace_cells(scene: _Scene, brush: Brush, capacity: int, begin: int, end: int, ahead: _Ahead) -> None:
    """Trace the cells order[begin:end] that would be tried if it were their turn now."""
    tract, vertices, room = np.empty((capacity, 2)), np.empty((capacity, 2)), scratch_inside(capacity)
    used = 0
    for k in range(begin, end):
        if used + 3 * capacity + 1 > len(ahead.points):
            return
        distance, x, y = _cell_distance(scene, scene.order[k], brush.photo_gain)
        if distance > brush.threshold:
            pieces, colour = _trace_stroke(
                scene, brush, scene.order[k], x, y, tract, vertices, room, ahead.points, used
            )
            ahead.first[k - begin], ahead.pieces[k - begin], ahead.colours[k - begin] = used, pieces, colour
            used += 3 * pieces + 1


@kernel
def _paint_cells(
    scene: _Scene,
    brush: Brush,
    capacity: int,
    at: int,
    end: int,
    ahead: _Ahead,
    begin: int,
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    colours: NDArray[np.uint32],
    laid: int,
    used: int,
) -> tuple[int, int, int]:
    """Try the cells order[at:end]; return (next cell, strokes laid, points used).

    ahead.…[0] is the cell order[begin]. Stops before a cell whose stroke might not fit into the
    columns, for the caller to enlarge them.
    """
    tract, vertices, own = np.empty((capacity, 2)), np.empty((capacity, 2)), np.empty((3 * capacity + 1, 2))
    room = scratch_inside(capacity)
    while at < end:
        if used + 4 * capacity > len(points) or laid + capacity > len(counts):
            return at, laid, used
        distance, x, y = _cell_distance(scene, scene.order[at], brush.photo_gain)
        cell, traced = scene.order[at], at - begin
        at += 1
        if not distance > brush.threshold:  # NaN, of an empty cell, is not
            continue
        chain, first = ahead.points, ahead.first[traced]
        pieces, colour = ahead.pieces[traced], ahead.colours[traced]
        if pieces < 0:
            chain, first = own, 0
            pieces, colour = _trace_stroke(scene, brush, cell, x, y, tract, vertices, room, own, 0)
        # One stroke of all pieces, or one of each.
        part = 1 if brush.per_piece else max(pieces, 1)
        for piece in range(0, pieces, part):
            c = first + 3 * piece
            if brush.per_piece:
                colour = _colour(scene.photo, chain[c + 2, 0], chain[c + 2, 1])
            paint_chain(scene.canvas, chain, c, part, brush.width, brush.round_cap, colour)
            for k in range(3 * part + 1):
                points[used, 0], points[used, 1] = chain[c + k, 0], chain[c + k, 1]
                used += 1
            counts[laid] = 3 * part + 1
            colours[laid] = colour
            laid += 1
    return at, laid, used


@leaf
def _paint_chains(
    canvas: Packed,
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    widths: NDArray[np.float64],
    colours: NDArray[np.uint32],
    round_cap: bool,
) -> None:
    first = 0
    for stroke in range(len(counts)):
        paint_chain(canvas, points, first, counts[stroke] // 3, widths[stroke], round_cap, colours[stroke])
        first += counts[stroke]


@leaf
def _middle(points: NDArray[np.float64], first: int, last: int) -> tuple[float, float, float]:
    """Length of the polyline points[first:last], and the point half way along it."""
    length = 0.0
    for k in range(first + 1, last):
        length += np.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
    left = 0.5 * length
    for k in range(first + 1, last):
        dx, dy = points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]
        edge = np.hypot(dx, dy)
        if left <= edge and edge > 0.0:
            return length, points[k - 1, 0] + left / edge * dx, points[k - 1, 1] + left / edge * dy
        left -= edge
    return length, points[last - 1, 0], points[last - 1, 1]


@leaf
def _colour(photo: Packed, x: float, y: float) -> np.uint32:
    """The photo's colour at a point, bilinear between pixel centres; points outside take the nearest edge."""
    height, width = photo.shape
    fx, fy = min(max(x - 0.5, 0.0), width - 1.0), min(max(y - 0.5, 0.0), height - 1.0)
    j0, i0 = int(fx), int(fy)
    j1, i1 = min(j0 + 1, width - 1), min(i0 + 1, height - 1)
    tx, ty = fx - j0, fy - i0
    colour = np.uint32(0)
    for shift in (16, 8, 0):
        upper = (1.0 - tx) * ((photo[i0, j0] >> shift) & 255) + tx * ((photo[i0, j1] >> shift) & 255)
        lower = (1.0 - tx) * ((photo[i1, j0] >> shift) & 255) + tx * ((photo[i1, j1] >> shift) & 255)
        colour |= np.uint32(np.uint32((1.0 - ty) * upper + ty * lower + 0.5) << shift)
    return colour
