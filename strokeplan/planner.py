"""From photo to plan: layer after layer, wide to fine (paper, "Image Stylization Filter").

For every layer the orientation field at its scale is computed and its strokes are painted on one canvas:
in the paper's way wherever a cell differs (painting.py), or for what they improve and wherever else a
preset asks for what the paper has not (pursuit.py). Fields of later layers are computed in threads while
a layer is painted; the plan is the same for any number of threads.

A preset whose lengths are relative is planned at the resolution that its finest brush needs (resolution.py), whatever
the photo's, so that the same photo at any size becomes the same strokes.
"""

from __future__ import annotations

import os
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from math import floor, log10, sqrt
from pathlib import Path
from time import perf_counter
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan import budget, drawing, painting, pursuit, search
from strokeplan.canvas import Packed, mean_distance, pack, unpack
from strokeplan.errors import InputError, StrokeplanWarning
from strokeplan.field import Orientation, OrientationField, submit_field
from strokeplan.image import LUMA, Photo, as_photo, grey, hue, lab, load_photo
from strokeplan.importance import check_mask, importance_map, load_mask, segments
from strokeplan.ink_presets import InkPreset, InkRecipe, find_ink
from strokeplan.merging import merge
from strokeplan.page import Page
from strokeplan.painting import (
    BEND_WIDTHS,
    Brush,
    LayerStrokes,
    Workers,
    layer_brush,
    paint_layer,
    paint_strokes,
    wander_key,
)
from strokeplan.palette import choose_colors, color_table, plan_palette
from strokeplan.pens import PenSet
from strokeplan.presets import LayerPreset, Preset, Recipe, load_preset, load_recipe
from strokeplan.pressure import add_pressure
from strokeplan.pursuit import Pursuit
from strokeplan.pursuit.scene import CELL_WIDTHS, SEEDINGS, TRIGGER, UNCOVERED, Rules
from strokeplan.resolution import load_for, working_copy
from strokeplan.strokes import Layer, Source, StrokePlan, hex_to_rgb
from strokeplan.tractography import splitmix64, track
from strokeplan.version import __version__

NARROWEST_PX = 1.0
"""Least relative width at the working resolution."""
UNSEEN = 290.0
"""Squared RGB distance a pixel that is added to the picture's error when a stroke's gain is compared with it: some
10 levels a channel. Without it, a photo without contrast would get as many strokes as any other."""
SIMPLIFY_SHARE, FIT_SHARE = 0.06, 0.2
"""Tolerances of strokes kept by gain are no less than these parts of the brush's width. What such a stroke gains is
measured on the fitted curve, so a loose fit costs nothing but detail that a brush so wide does not show."""
PRUNE = 0.5
"""Before the last layer strokes are dropped that are missed by less than this part of what a stroke must gain."""
DECIMALS = 2
"""Coordinates of a plan are multiples of 0.01 px, so that a plan equals its file, or of a coarser power of ten …"""
GRID_SHARE = 1 / 40
"""… if that is no more than this part of its finest stroke's width: nobody sees the rest, and files carry it. Only of
presets of relative lengths; one in pixels has fixed tolerances and fixed coordinates."""
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
    preset: str | os.PathLike[str] | Preset | Recipe | InkPreset | InkRecipe = "fine",
    seed: int | None = None,
    *,
    orientation: Orientation | None = None,
    strokes: int | None = None,
    detail: float | None = None,
    mask: str | os.PathLike[str] | ArrayLike | None = None,
    page: Page | None = None,
    pens: str | os.PathLike[str] | PenSet | None = None,
    max_length_mm: float | None = None,
    max_time_s: float | None = None,
    profile: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    report: Callable[[Report], None] | None = None,
) -> StrokePlan:
    """Plan the strokes of a photo (a path, an array, or a Photo) in the style of a preset.

    preset   a name, a .toml file, a Preset; or a plan's file, which gives its seed and budget of strokes too.
    seed     of all chance; by default that of the plan that the preset came from, else 0.
    strokes  at most so many: the best picture for that budget; strokes are then kept by what they gain.
    detail   0 (bold) to 1 (minute); 0.5 is the preset as it stands.
    mask     where detail matters: a picture file or an (h, w) array in 0..1 of the photo's proportions;
             1 matters most, 0.5 is neutral. It takes the place of the preset's own importance.

    A preset of ink makes a pen drawing in millimetres (see ink.py), for which there are
    page           the sheet and its margin; by default A4 with 15 mm, turned as the photo;
    pens           a set of pens (a name, a .toml file, a PenSet); by default the preset's;
    max_length_mm  how far the pens may draw: the best drawing for that much ink;
    max_time_s     how long the machine of `profile` may draw;
    profile        a machine (a name, a .toml file), whose page and pens are taken where none are given;
    and neither orientation, detail, mask, progress nor report.

    The same image, preset, options, seed and version give the same plan, whatever `threads` (default: one
    for each processor this process may use). `progress` is called now and then, `report` once at the end.
    Raises ImageError, PresetError, InputError.
    """
    if (inked := find_ink(preset)) is not None:
        _refuse("a preset of ink", orientation=orientation, detail=detail, mask=mask)
        inked = inked.changed(
            seed=seed,
            strokes=strokes,
            page=page,
            pens=pens,
            max_length_mm=max_length_mm,
            max_time_s=max_time_s,
            profile=profile,
        )
        return drawing.draw(_photo(image), inked, threads=threads)
    given = {"max_length_mm": max_length_mm, "max_time_s": max_time_s, "profile": profile}
    _refuse("a preset of paint", page=page, pens=pens, **given)
    assert not isinstance(preset, InkPreset | InkRecipe)  # noqa: S101 (for the type checker: find_ink takes them)
    recipe = load_recipe(preset)
    seed = recipe.seed if seed is None else seed
    if seed < 0:
        raise InputError(f"seed {seed} is negative; give 0 or more")
    if threads is not None and threads < 1:
        raise InputError(f"threads {threads} is below 1")
    if recipe.mask is not None and mask is None:
        warnings.warn(
            f"the plan that the preset came from had a mask, {recipe.mask}; without it this one is another",
            StrokeplanWarning,
            stacklevel=2,
        )
    style, strokes = budget.within(recipe, strokes, detail)
    if orientation is not None:
        style = style.override({"orientation": orientation})
    photo = _photo(image, style)
    work = working_copy(photo, style)
    spare = max(work.width / photo.width, 1.0)
    job = _Job(work, _working_preset(style, work, spare), spare, seed, _mask(mask, photo), progress)
    with _workers(threads) as workers:
        layers, canvas = _painted(job, style, strokes, workers)
        if report is not None:
            report(Report(job.seconds, _canvas_error(job.pixels, canvas, 1), unpack(canvas)))
        colours = [
            choose_colors(unpack(layer.colours), settings, job.palette, np.random.default_rng((seed, number, _COLOR)))
            for number, (layer, settings) in enumerate(zip(layers, job.preset.layers, strict=True), start=1)
        ]
        painted = _assemble(work, job.preset, layers, colours)
        if style.pressure > 0:
            painted = add_pressure(painted, (field() for field in _fields(job, workers)), style.pressure)
    settings = {
        "strokeplan": __version__,
        "seed": seed,
        "preset": msgspec.to_builtins(style),
        "resolved": msgspec.to_builtins(style.for_photo(photo.width, photo.height)),
    }
    if strokes is not None:
        settings["strokes"] = strokes
    if mask is not None:
        settings["mask"] = Path(mask).name if isinstance(mask, str | os.PathLike) else "an array"
    return _on_canvas(painted, photo, settings)


def _refuse(what: str, **options: object) -> None:
    """Raise InputError if an option is given that `what` has no use for."""
    for name, value in options.items():
        if value is not None:
            raise InputError(
                f"{name.removesuffix('_mm').removesuffix('_s')} is not for {what}; leave it out, or give another preset"
            )


_COLOR = 2
"""What tells the chance in the colours of a layer from that in its cells."""


def _working_preset(style: Preset, work: Photo, spare: float) -> Preset:
    """A preset in pixels of its working copy. Of relative widths none is below a pixel, as they would be on the
    smallest photos: such strokes pass between the centres of pixels and cover nothing. Where the first layer is to
    cover the canvas, it has twice what it must spare."""
    preset = style.for_photo(work.width, work.height)
    if style.lengths == "pixels":
        return preset
    layers = tuple(
        msgspec.structs.replace(layer, width=max(layer.width, 2 * spare if k == 0 and preset.cover else NARROWEST_PX))
        for k, layer in enumerate(preset.layers)
    )
    return msgspec.structs.replace(preset, layers=layers)


class _Job:
    """A photo at its working resolution, the preset in its pixels, and what several stages need of both."""

    def __init__(
        self,
        photo: Photo,
        preset: Preset,
        spare: float,
        seed: int,
        mask: NDArray[np.float32] | None,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self.photo, self.preset, self.seed, self.mask, self.progress = photo, preset, seed, mask, progress
        self.spare = spare
        """A pixel of the photo at the working resolution, or one of that."""
        self.pixels = pack(photo.rgb)
        self.background = int(preset.background.removeprefix("#"), 16)
        self.palette = plan_palette(preset, photo.rgb, seed)
        self.seconds = {"fields": 0.0, "strokes": 0.0}

    @property
    def as_in_the_paper(self) -> bool:
        """Whether the preset asks for nothing but what the paper describes."""
        p = self.preset
        further = p.keep == "gain" or p.seeding != "grid" or p.cover or p.importance or p.regions or p.thin
        return not further and self.mask is None

    def waited(self, stage: str, began: float) -> None:
        self.seconds[stage] += perf_counter() - began

    def teller(self, number: int, laid: int, error: Callable[[], float]) -> Callable[[int, int, int], None]:
        """What tells `progress` of one layer, after `laid` strokes of those before."""

        def tell(done: int, total: int, strokes: int) -> None:
            if self.progress is not None:
                self.progress(Progress(number, len(self.preset.layers), done, total, laid + strokes, error()))

        return tell


def _photo(image: str | os.PathLike[str] | ArrayLike | Photo, style: Preset | None = None) -> Photo:
    """The photo, decoded as far as a style needs it, or whole."""
    if isinstance(image, Photo):
        return image
    if not isinstance(image, str | os.PathLike):
        return as_photo(image)
    return load_photo(image) if style is None else load_for(image, style)


def _mask(mask: str | os.PathLike[str] | ArrayLike | None, photo: Photo) -> NDArray[np.float32] | None:
    """The mask as an array that fits the photo."""
    if mask is None:
        return None
    values = load_mask(mask) if isinstance(mask, str | os.PathLike) else np.asarray(mask)
    check_mask(values, photo.width, photo.height)
    return values


def _painted(job: _Job, style: Preset, most: int | None, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """Strokes of all layers in the way that suits the preset and the budget, and the canvas."""
    if job.as_in_the_paper:
        return _paint_by_threshold(job, workers)
    if most is not None and budget.searched(style, most):
        return _search(job, most, workers)
    return _pursue(job, most, workers)


def _paint_by_threshold(job: _Job, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """The paper's way: strokes of all layers, and the canvas."""
    canvas = np.full_like(job.pixels, job.background)
    layers: list[LayerStrokes] = []
    fields = _fields(job, workers)
    for number, layer in enumerate(job.preset.layers, start=1):
        began = perf_counter()
        field = fields.popleft()()
        job.waited("fields", began)
        began = perf_counter()
        laid = sum(len(strokes.counts) for strokes in layers)
        tell = job.teller(number, laid, lambda: _canvas_error(job.pixels, canvas, ERROR_STRIDE))
        before = canvas.copy() if job.preset.merge > 0 else None
        layers.append(paint_layer(job.pixels, canvas, field, job.preset, layer, (job.seed, number), workers, tell))
        if before is not None:
            # Painted anew: a merged stroke has another colour than its parts, and another place among the others.
            layers[-1] = merge(layers[-1], layer_brush(job.preset, layer), job.preset.merge)
            canvas[:] = before
            paint_strokes(canvas, layers[-1], job.preset.cap == "round")
        job.waited("strokes", began)
        del field  # the largest thing there is, and the next layer's waits
    return layers, canvas


def _weight(job: _Job) -> NDArray[np.float32]:
    """(h, w) how much the error of a pixel counts."""
    preset = job.preset
    if job.mask is None and not preset.importance:
        return np.ones(job.pixels.shape, np.float32)
    importance = importance_map(job.photo.rgb, mask=job.mask, use=preset.importance)
    weight: NDArray[np.float32] = np.exp2(2 * preset.importance_strength * (2 * importance - 1)).astype(np.float32)
    return weight


def _search(job: _Job, most: int, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """At most so many strokes, each searched for, and the canvas."""
    preset, weight, began = job.preset, _weight(job), perf_counter()
    picture = Pursuit.begin(job.pixels, weight, job.background, preset.cap == "round", workers=workers)
    strokes = search.search(
        job.pixels,
        weight,
        most,
        finest=preset.layers[0].width,
        least=preset.gain * 1e-6 * UNSEEN * weight.size,
        cover=preset.cover,
        background=job.background,
        round_cap=preset.cap == "round",
        key=wander_key((job.seed, 1)),
        tell=lambda done, total, laid, error: job.teller(1, 0, lambda: error)(done, total, laid),
    )
    picture.layers.append(strokes)
    canvas = picture.finish()
    job.waited("strokes", began)
    return picture.layers, canvas


def _pursue(job: _Job, most: int | None, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """Strokes of all layers kept by a pursuit, at most so many, and the canvas."""
    waiting = _fields(job, workers)
    preset, photo = job.preset, job.photo
    weight = _weight(job)
    uneven = float(weight.min()) < float(weight.max())
    regions = segments(photo.rgb, preset.regions) if preset.regions else None
    choice = None if job.palette is None else pack(color_table(job.palette)[None])[0]
    fields: list[OrientationField] = []

    def pursue(gain: float) -> Pursuit:
        picture = Pursuit.begin(job.pixels, weight, job.background, preset.cap == "round", regions, choice, workers)
        for number, layer in enumerate(preset.layers, start=1):
            if number > len(fields):
                began = perf_counter()
                fields.append(waiting.popleft()())
                job.waited("fields", began)
            began = perf_counter()
            least = gain * layer.gain * 1e-6 * (picture.error_to_beat() + UNSEEN * weight.size)
            if preset.keep == "gain" and number == len(preset.layers) > 1:
                picture.prune(PRUNE * least, spare_first=preset.cover)
                picture.look_closely()
            tell = job.teller(number, picture.strokes, picture.mean_distance)
            brush, rules = _brush(preset, layer), _rules(job, layer, number, least, uneven)
            picture.paint_layer(fields[number - 1], brush, rules, wander_key((job.seed, number)), workers, tell)
            if preset.merge > 0 and not rules.cover:  # merged strokes might let the canvas through
                picture.merge(brush, preset.merge)
            if preset.thin > 0:
                picture.thin(preset.thin)
            job.waited("strokes", began)
        return picture

    best = pursue(preset.gain) if most is None else budget.best_within(most, preset.gain, pursue)
    canvas = best.finish(job.spare if preset.cover and most is None else None)
    return best.layers, canvas


def _brush(preset: Preset, layer: LayerPreset) -> Brush:
    """The brush of a layer of a pursuit."""
    brush = layer_brush(preset, layer)
    if preset.keep != "gain":
        return brush
    return brush._replace(
        simplify_tolerance=max(brush.simplify_tolerance, SIMPLIFY_SHARE * brush.width),
        fit_tolerance=max(brush.fit_tolerance, FIT_SHARE * brush.width),
    )


def _rules(job: _Job, layer: LayerPreset, number: int, gain: float, uneven: bool) -> Rules:
    preset = job.preset
    by_gain, cover = preset.keep == "gain", preset.cover and number == 1
    trigger = TRIGGER * gain / (layer.width * layer.length) if by_gain else layer.color_threshold
    if by_gain and cover:
        trigger = UNCOVERED
    return Rules(
        seeding=SEEDINGS[preset.seeding],
        cell=max(layer.width * (CELL_WIDTHS if by_gain and not cover else 1), 1.0),
        by_gain=by_gain,
        gain=gain,
        trigger=trigger,
        cover=cover,
        spare=job.spare,
        separation=preset.separation * layer.width,
        vary_width=uneven,
    )


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first plan compiles them."""
    return painting.compiled() and pursuit.compiled() and search.compiled()


def warm_up() -> None:
    """Compile every kernel, or load it if it is cached, by plans of a few pixels."""
    picture = np.zeros((32, 32, 3), np.uint8)
    picture[:, 12:20] = 255
    plan(picture, "fine", threads=2)
    plan(picture, "fine", strokes=2, threads=1)
    for widest in (0, 2):  # the adaptive field has kernels of its own
        plan(picture, load_preset("paper").override({"max_integration_sigma": widest}), threads=2)


def load_kernels() -> None:
    """Load what planning by gain needs, by a plan of four pixels; quick if it is loaded already."""
    plan(np.zeros((2, 2, 3), np.uint8), "fine", threads=1)


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


def _fields(job: _Job, workers: Workers) -> deque[Callable[[], OrientationField]]:
    """The fields of all layers, in work in the workers; each is waited for when called."""
    image = _channels(job.photo, job.preset)
    known: dict[float, Callable[[], OrientationField]] = {}
    for layer in job.preset.layers:
        if layer.sigma not in known:
            known[layer.sigma] = cache(_field(image, job.preset, layer, workers))
    return deque(known[layer.sigma] for layer in job.preset.layers)


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


def _assemble(
    photo: Photo, preset: Preset, collected: list[LayerStrokes], colors: list[NDArray[np.uint8]]
) -> StrokePlan:
    """The plan at the resolution at which it was made."""
    counts = np.concatenate([strokes.counts for strokes in collected])
    ends = np.cumsum([len(strokes.counts) for strokes in collected])
    layers = tuple(
        Layer(str(number), int(end) - len(strokes.counts), int(end), cap=preset.cap)
        for number, (strokes, end) in enumerate(zip(collected, ends, strict=True), start=1)
    )
    return StrokePlan(
        width=photo.width,
        height=photo.height,
        points=np.concatenate([strokes.points for strokes in collected]),
        starts=np.concatenate([[0], np.cumsum(counts)]),
        widths=np.concatenate([strokes.widths for strokes in collected]),
        colors=np.concatenate(colors),
        layers=layers,
        background=hex_to_rgb(preset.background),
    )


def _on_canvas(plan: StrokePlan, photo: Photo, settings: dict[str, Any]) -> StrokePlan:
    """A plan in pixels of its photo, its coordinates rounded."""
    scale = np.array([photo.width / plan.width, photo.height / plan.height])
    widths = plan.widths * sqrt(scale[0] * scale[1])
    decimals = DECIMALS
    if len(widths) and settings["preset"]["lengths"] == "relative":
        decimals = min(-floor(log10(GRID_SHARE * widths.min())), DECIMALS)
        widths = np.round(widths, decimals + 1)
    return replace(
        plan,
        width=photo.width,
        height=photo.height,
        points=np.round(plan.points * scale, decimals) + 0.0,
        widths=widths,
        settings=settings,
        source=Source(photo.name, photo.sha256, photo.width, photo.height),
    )
