"""Pixels of a plan, tile by tile: any size in bounded memory, on all processors.

The enlarged canvas is cut into tiles on a fixed grid, each painted on a surface of its own by whichever
thread is free, with the strokes whose boxes touch it. What a tile holds depends on the plan and the scale
alone, so that any region is, to the byte, a crop of the whole (within one surface Cairo's clipping moves
an edge by up to 1/256 pixel), and so is the picture of any number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.pens import transparent_layers
from strokeplan.rendering.brushes import Brush, as_brush
from strokeplan.rendering.ground import Background, Ground, as_ground
from strokeplan.rendering.nibs import Round
from strokeplan.rendering.surface import Surface, require_cairo
from strokeplan.rendering.tile import Tile
from strokeplan.rendering.view import Region, View, check_sides, chosen_strokes, view
from strokeplan.strokes import StrokePlan

TILE_COLUMNS, TILE_ROWS = 2048, 256
"""Flat, because a band of tiles is what a file takes next, and as many bands as processors are in the making."""
LEAST_DETAIL_PX = 1.2
"""Lines of a brush that are thinner are painted larger and reduced: where translucent pixels of several strokes
lie over each other, coverage alone no longer tells what is seen."""
THIN_PART = 0.25
"""Strokes that are thinner than the stroke whose lines decide, as a part of all."""
MAX_FINER = 4
MEMORY_PART = 0.8
"""Part of the machine's memory that a picture held as a whole may take."""
Progress = Callable[[int, int], None]
"""Called with the rows painted so far and the rows of the picture."""


def render(
    plan: StrokePlan,
    *,
    width: int | None = None,
    height: int | None = None,
    scale: float | None = None,
    brush: str | Brush = "round",
    region: Region | None = None,
    background: Background | None = None,
    layers: Sequence[str | int] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> NDArray[np.uint8]:
    """Paint the plan as a (h, w, 3) uint8 sRGB picture, or (h, w, 4) with a transparent background.

    Give one of `width` or `height` (pixels; the other follows) or `scale` (1 = the canvas's own size, the default; of
    a pen drawing on paper that is 300 dots an inch). `region` is x, y, width, height in units of the canvas: only
    that is shown, and sizes are its own. `brush` is a brush or its text, "bristle:hairs=40"; `background` a colour
    ("#faf0e6", "teal", (250, 240, 230)), "transparent", a picture file or array laid over the canvas, or None for the
    plan's own; `layers` names or numbers from 1, "2-4" for a range. The pixels do not depend on `threads`.

    Raises InputError for a size that is no size or beyond memory, MissingExtraError without Pycairo.
    """
    shown = view(plan, width=width, height=height, scale=scale, region=region)
    work = job(plan, shown, brush=brush, background=background, layers=layers)
    check_memory(shown, work.channels)
    return work.picture(threads, progress)


def paint(plan: StrokePlan, columns: int, rows: int, *, antialias: bool = True) -> NDArray[np.uint8]:
    """Paint the plan as a (rows, columns, 3) uint8 picture, stretched to fit if the shapes differ.

    Without `antialias` a stroke covers the pixels whose centres it covers, and those wholly.
    """
    check_sides(columns, rows)
    shown = View(columns, rows, 0, 0, columns, rows)
    return Job(plan, shown, Round(), np.arange(len(plan)), as_ground(None, plan, shown), antialias).picture()


def job(
    plan: StrokePlan,
    shown: View,
    *,
    brush: str | Brush = "round",
    background: Background | None = None,
    layers: Sequence[str | int] | None = None,
) -> Job:
    """What `render` paints, checked and ready to be painted in bands."""
    require_cairo()
    return Job(plan, shown, as_brush(brush), chosen_strokes(plan, layers), as_ground(background, plan, shown))


def check_memory(shown: View, channels: int) -> None:
    """Raise InputError for a picture that cannot be held in memory as a whole."""
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows does not say; there MemoryError has to
        return
    wanted = shown.width * shown.height * channels
    if wanted > MEMORY_PART * memory:
        raise InputError(
            f"a picture of {shown.width} × {shown.height} pixels takes {wanted / 1e9:.1f} GB of memory and there are "
            f"{memory / 1e9:.1f}; write it as .tif with `strokeplan render`, which keeps no more than a few rows"
        )


@dataclass(frozen=True, eq=False)
class Job:
    """A picture to be painted: what of the plan, with which brush, on what ground."""

    plan: StrokePlan
    view: View
    brush: Brush
    strokes: NDArray[np.int64]
    ground: Ground
    antialias: bool = True

    @property
    def channels(self) -> int:
        return 4 if self.ground.transparent else 3

    @property
    def compiled(self) -> bool:
        """Whether the brush can paint at once; if not, its first stroke compiles its kernels."""
        asked = getattr(self.brush, "compiled", None)
        return asked is None or len(self.strokes) == 0 or bool(asked(self.plan))

    @cached_property
    def _boxes(self) -> NDArray[np.float64]:
        """(4, m): left, top, right, bottom of the paint of every stroke, in pixels of the whole canvas."""
        plan = self.plan
        scales = np.array(self.view.scales(plan))
        if len(plan) == 0:
            return np.empty((4, 0))
        low = np.minimum.reduceat(plan.points, plan.starts[:-1])[self.strokes]
        high = np.maximum.reduceat(plan.points, plan.starts[:-1])[self.strokes]
        reach = (0.5 * self.brush.reach * plan.widths[self.strokes])[:, None]
        return np.concatenate([((low - reach) * scales - 1).T, ((high + reach) * scales + 1).T])

    @cached_property
    def _finer(self) -> int:
        """How much larger tiles are painted, then reduced, so that the brush's detail has a pixel of its own."""
        if len(self.strokes) == 0 or not self.antialias:
            return 1
        detail = (
            self.brush.detail
            * 0.5
            * float(np.quantile(self.plan.widths[self.strokes], THIN_PART))
            * min(self.view.scales(self.plan))
        )
        return min(max(int(np.ceil(LEAST_DETAIL_PX / detail)), 1), MAX_FINER)

    def picture(self, threads: int | None = None, progress: Progress | None = None) -> NDArray[np.uint8]:
        """The whole picture in memory."""
        picture = np.empty((self.view.height, self.view.width, self.channels), np.uint8)
        done = 0
        for band in self.bands(threads):
            picture[done : done + len(band)] = band
            done += len(band)
            if progress is not None:
                progress(done, self.view.height)
        return picture

    def bands(self, threads: int | None = None) -> Iterator[NDArray[np.uint8]]:
        """The picture from the top in bands (rows, w, channels); no more exist at a time than threads, and one."""
        count = threads or processors()
        if count < 1:
            raise InputError(f"{threads} threads can paint nothing; give at least 1")
        _ = self._boxes, self._finer  # once, before threads ask for them together
        pending: deque[Future[NDArray[np.uint8]]] = deque()
        pool = ThreadPoolExecutor(count)
        try:
            for top, bottom in self._spans():
                pending.append(pool.submit(self._band, top, bottom))
                if len(pending) > count:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            # Without waiting: after Ctrl-C a band may be painted, or its brush compiled, for many seconds more.
            pool.shutdown(wait=False, cancel_futures=True)

    def _spans(self) -> Iterator[tuple[int, int]]:
        """First row and the row after the last, of every band."""
        top, bottom = self.view.top, self.view.top + self.view.height
        while top < bottom:
            end = min((top // TILE_ROWS + 1) * TILE_ROWS, bottom)
            yield top, end
            top = end

    def _band(self, top: int, bottom: int) -> NDArray[np.uint8]:
        left, right = self.view.left, self.view.left + self.view.width
        out = np.empty((bottom - top, right - left, self.channels), np.uint8)
        row = top // TILE_ROWS * TILE_ROWS
        for column in range(left // TILE_COLUMNS * TILE_COLUMNS, right, TILE_COLUMNS):
            first, last = max(column, left), min(column + TILE_COLUMNS, right)
            tile = self._tile(column, row)
            out[:, first - left : last - left] = tile[top - row : bottom - row, first - column : last - column]
        return out

    def _tile(self, left: int, top: int) -> NDArray[np.uint8]:
        """The tile whose corner is there, as far as the canvas goes."""
        right, bottom = min(left + TILE_COLUMNS, self.view.columns), min(top + TILE_ROWS, self.view.rows)
        finer = self._finer
        size = finer * (right - left), finer * (bottom - top)
        surface = self._surface(*size, self.ground.color)
        self.ground.lay(surface, finer * left, finer * top, self.view, finer)
        boxes = self._boxes
        touching = (boxes[2] > left) & (boxes[3] > top) & (boxes[0] < right) & (boxes[1] < bottom)
        if np.any(touching):
            scale_x, scale_y = self.view.scales(self.plan)
            place = finer * left, finer * top, finer * scale_x, finer * scale_y
            for filters, strokes in self._sheets(self.strokes[touching]):
                sheet = self._surface(*size, None) if filters else surface
                self.brush.paint(Tile(sheet, *place), self.plan, strokes)
                if filters:  # ink on the same ink is no darker, on another it is
                    surface.multiply(sheet)
        return surface.picture(finer)

    def _surface(self, width: int, height: int, background: tuple[int, int, int] | None) -> Surface:
        surface = Surface(width, height, background)
        if not self.antialias:
            surface.context.set_antialias(require_cairo().ANTIALIAS_NONE)
        return surface

    def _sheets(self, strokes: NDArray[np.int64]) -> Iterator[tuple[bool, NDArray[np.int64]]]:
        """The strokes by what they are painted on: the picture, or for a layer of transparent ink a sheet over it."""
        kinds = transparent_layers(self.plan)
        if not any(kinds):
            yield False, strokes
            return
        for filters, layer in zip(kinds, self.plan.layers, strict=True):
            first, last = np.searchsorted(strokes, (layer.first, layer.last))
            if first < last:
                yield filters, strokes[first:last]


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
