"""From photo to plan: layer after layer, wide to fine (paper, "Image Stylization Filter").

For every layer the orientation field at its scale is computed and its strokes are painted on one canvas.
Fields of later layers are computed in threads while a layer is painted; the plan is the same for any
number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan.canvas import Packed, mean_distance, pack, unpack
from strokeplan.errors import InputError
from strokeplan.field import Orientation, OrientationField, submit_field
from strokeplan.image import LUMA, Photo, as_photo, grey, hue, lab, load_photo
from strokeplan.painting import BEND_WIDTHS, LayerStrokes, Workers, layer_brush, paint_layer, wander_key
from strokeplan.presets import LayerPreset, Preset, load_preset
from strokeplan.strokes import Layer, Source, StrokePlan, hex_to_rgb
from strokeplan.tractography import splitmix64, track
from strokeplan.version import __version__

DECIMALS = 2
"""Coordinates of a plan are multiples of 0.01 px, so that a plan equals its file."""
ERROR_STRIDE = 8
"""The error shown while planning is measured on every 8th pixel both ways."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a plan is: cells `done` of `total` in layer `layer` (from 1) of `layers`."""

    layer: int
    layers: int
    done: int
    total: int
    strokes: int
    error: float
    """Mean RGB distance of photo and canvas so far, sampled."""


@dataclass(frozen=True, slots=True)
class Report:
    """What a finished plan cost, for whoever asks by `report=`."""

    seconds: dict[str, float]
    """Wall time by stage: "fields" (time waited for them) and "strokes"."""
    error: float
    """Mean RGB distance of photo and planning canvas."""
    canvas: NDArray[np.uint8]
    """The planning canvas, (h, w, 3)."""


def plan(
    image: str | os.PathLike[str] | ArrayLike | Photo,
    preset: str | os.PathLike[str] | Preset = "paper",
    seed: int = 0,
    *,
    orientation: Orientation | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    report: Callable[[Report], None] | None = None,
) -> StrokePlan:
    """Plan the strokes of a photo (a path, an array, or a Photo) in the style of a preset.

    The same image, preset, seed and version give the same plan, whatever `threads` (default: one for
    each processor this process may use). `progress` is called now and then, `report` once at the end.
    Raises ImageError, PresetError, InputError.
    """
    if seed < 0:
        raise InputError(f"seed {seed} is negative; give 0 or more")
    if threads is not None and threads < 1:
        raise InputError(f"threads {threads} is below 1")
    style = load_preset(preset)
    if orientation is not None:
        style = style.override({"orientation": orientation})
    photo = _photo(image)
    seconds = {"fields": 0.0, "strokes": 0.0}

    resolved = style.for_photo(photo.width, photo.height)
    pixels = pack(photo.rgb)
    canvas = np.full_like(pixels, int(resolved.background.removeprefix("#"), 16))
    strokes: list[LayerStrokes] = []
    with _workers(threads) as workers:
        fields = _fields(photo, resolved, workers)
        for number, layer in enumerate(resolved.layers, start=1):
            began = perf_counter()
            field = fields.popleft()()
            seconds["fields"] += perf_counter() - began
            began = perf_counter()
            tell = _teller(progress, pixels, canvas, number, resolved, sum(len(s.counts) for s in strokes))
            strokes.append(paint_layer(pixels, canvas, field, resolved, layer, (seed, number), workers, tell))
            seconds["strokes"] += perf_counter() - began
            del field  # the largest thing there is, and the next layer's waits
    if report is not None:
        report(Report(seconds, _canvas_error(pixels, canvas, 1), unpack(canvas)))
    settings = {
        "strokeplan": __version__,
        "seed": seed,
        "preset": msgspec.to_builtins(style),
        "resolved": msgspec.to_builtins(resolved),
    }
    return _assemble(photo, resolved, strokes, settings)


def _photo(image: str | os.PathLike[str] | ArrayLike | Photo) -> Photo:
    if isinstance(image, Photo):
        return image
    return load_photo(image) if isinstance(image, str | os.PathLike) else as_photo(image)


def _teller(
    progress: Callable[[Progress], None] | None,
    photo: Packed,
    canvas: Packed,
    number: int,
    preset: Preset,
    laid: int,
) -> Callable[[int, int, int], None]:
    """What tells `progress` of the cells of one layer, after `laid` strokes of those before."""

    def tell(done: int, total: int, strokes: int) -> None:
        if progress is not None:
            error = _canvas_error(photo, canvas, ERROR_STRIDE)
            progress(Progress(number, len(preset.layers), done, total, laid + strokes, error))

    return tell


def warm_up() -> None:
    """Compile every kernel, or load it if it is cached, by plans of a few pixels."""
    picture = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    for widest in (0, 2):  # the adaptive field has kernels of its own
        plan(picture, load_preset("paper").override({"max_integration_sigma": widest}), threads=2)


def layer_field(photo: Photo, preset: Preset, number: int) -> OrientationField:
    """The orientation field that layer `number` (from 1) of a preset follows on a photo."""
    resolved = preset.for_photo(photo.width, photo.height)
    return _field(_channels(photo, resolved), resolved, _layer(resolved, number), Workers())()


def layer_tract(field: OrientationField, preset: Preset, number: int, seed: tuple[float, float]) -> NDArray[np.float64]:
    """The tract (n, 2) that layer `number` (from 1) of a preset follows through `seed` (x, y) without its wander."""
    return _layer_track(field, preset, number, seed)(0.0, 0)


def layer_spread(
    field: OrientationField, preset: Preset, number: int, seed: tuple[float, float], count: int, chance: int = 0
) -> list[NDArray[np.float64]]:
    """`count` tracts through one seed (x, y), each a draw of the layer's wander; `chance` is the seed of all draws."""
    if count < 1:
        raise InputError(f"count {count} of tracts is below 1")
    if preset.wander == 0:
        raise InputError("a preset of wander 0 has one tract through a point; set a wander of up to 1")
    follow = _layer_track(field, preset, number, seed)
    key = wander_key((chance, number))
    return [follow(preset.wander, int(splitmix64(key, np.uint64(draw)))) for draw in range(count)]


def _layer_track(
    field: OrientationField, preset: Preset, number: int, seed: tuple[float, float]
) -> Callable[[float, int], NDArray[np.float64]]:
    """The tract of a layer through a point, for a wander and the key of its draw."""
    if not (0 <= seed[0] <= field.width and 0 <= seed[1] <= field.height):
        raise InputError(f"the point {seed[0]:g},{seed[1]:g} is outside the photo of {field.width} × {field.height}")
    resolved = preset.for_photo(field.width, field.height)
    brush = layer_brush(resolved, _layer(resolved, number))

    def follow(wander: float, key: int) -> NDArray[np.float64]:
        return track(
            field,
            seed,
            max_length=brush.length,
            min_coherence=brush.coherence,
            tolerance=brush.step_tolerance,
            max_step=brush.max_step,
            both_ways=brush.both_ways,
            aligned=brush.aligned,
            wander=wander,
            bend=BEND_WIDTHS * brush.width,
            key=key,
        )

    return follow


def _layer(preset: Preset, number: int) -> LayerPreset:
    if not 1 <= number <= len(preset.layers):
        raise InputError(f"there is no layer {number}; layers are numbered 1 to {len(preset.layers)}")
    return preset.layers[number - 1]


def _channels(photo: Photo, preset: Preset) -> NDArray[np.float32]:
    """What the orientation of a preset is measured on: (h, w), or (h, w, c)."""
    if preset.channels != "grey":
        return lab(photo.rgb) if preset.channels == "lab" else hue(photo.rgb)
    return grey(photo.rgb, LUMA if preset.grey == "luma" else (1 / 3, 1 / 3, 1 / 3))


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _workers(threads: int | None) -> Iterator[Workers]:
    """Threads beside this one; what they have not begun when the block ends is dropped."""
    count = (threads or _processors()) - 1
    if count == 0:
        yield Workers()
        return
    executor = ThreadPoolExecutor(count)
    try:
        yield Workers(executor, count)
    finally:
        # All is done if all went well; if not, nobody waits for a thread that is still at it.
        executor.shutdown(wait=False, cancel_futures=True)


def _fields(photo: Photo, preset: Preset, workers: Workers) -> deque[Callable[[], OrientationField]]:
    """The fields of all layers, in work in the workers; each is waited for when called."""
    image = _channels(photo, preset)
    return deque(_field(image, preset, layer, workers) for layer in preset.layers)


def _field(
    image: NDArray[np.float32], preset: Preset, layer: LayerPreset, workers: Workers
) -> Callable[[], OrientationField]:
    return submit_field(
        image,
        sigma=layer.sigma,
        derivative_sigma=preset.derivative_sigma,
        integration_sigma=preset.integration_sigma,
        max_integration_sigma=preset.max_integration_sigma,
        orientation=preset.orientation,
        executor=workers.executor,
    )


def _canvas_error(photo: Packed, canvas: Packed, stride: int) -> float:
    return mean_distance(photo, canvas, 0, photo.shape[0], 0, photo.shape[1], stride, 1.0)


def _assemble(photo: Photo, preset: Preset, collected: list[LayerStrokes], settings: dict[str, Any]) -> StrokePlan:
    counts = np.concatenate([strokes.counts for strokes in collected])
    ends = np.cumsum([len(strokes.counts) for strokes in collected])
    layers = tuple(
        Layer(str(number), int(end) - len(strokes.counts), int(end), cap=preset.cap)
        for number, (strokes, end) in enumerate(zip(collected, ends, strict=True), start=1)
    )
    return StrokePlan(
        width=photo.width,
        height=photo.height,
        points=np.round(np.concatenate([strokes.points for strokes in collected]), DECIMALS) + 0.0,
        starts=np.concatenate([[0], np.cumsum(counts)]),
        widths=np.concatenate([np.full(len(strokes.counts), strokes.width) for strokes in collected]),
        colors=unpack(np.concatenate([strokes.colours for strokes in collected])),
        layers=layers,
        background=hex_to_rgb(preset.background),
        settings=settings,
        source=Source(photo.name, photo.sha256, photo.width, photo.height),
    )
