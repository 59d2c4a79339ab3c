"""The strokes of all layers, wide to fine on one canvas, in the way that suits a preset and its budget.

In the paper's way wherever a cell differs (painting.py); for what they improve, and wherever else a preset asks for
what the paper has not (pursuit/); or, where they are to be few, each searched for (searching/).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from strokeplan import budget, painting, pursuit, searching
from strokeplan.canvas import Packed, mean_distance, pack
from strokeplan.field import OrientationField
from strokeplan.image import Photo
from strokeplan.importance import importance_map, segments
from strokeplan.layer_fields import submit_fields
from strokeplan.merging import merge
from strokeplan.painting import LayerStrokes, layer_brush, paint_layer, paint_strokes, wander_key
from strokeplan.palette import color_table, plan_palette
from strokeplan.presets import Preset
from strokeplan.pursuit import Pursuit
from strokeplan.pursuit.rules import layer_rules, pursuit_brush
from strokeplan.workers import Workers

UNSEEN = 290.0
"""Squared RGB distance a pixel that is added to the picture's error when a stroke's gain is compared with it: some
10 levels a channel. Without it, a photo without contrast would get as many strokes as any other."""
PRUNE = 0.5
"""Before the last layer strokes are dropped that are missed by less than this part of what a stroke must gain."""
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


class Job:
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

    def waited(self, stage: str, began: float) -> None:
        self.seconds[stage] += perf_counter() - began

    def teller(self, number: int, laid: int, error: Callable[[], float]) -> Callable[[int, int, int], None]:
        """What tells `progress` of one layer, after `laid` strokes of those before."""

        def tell(done: int, total: int, strokes: int) -> None:
            if self.progress is not None:
                self.progress(Progress(number, len(self.preset.layers), done, total, laid + strokes, error()))

        return tell


def paint_layers(job: Job, style: Preset, most: int | None, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """Strokes of all layers in the way that suits the preset and the budget, and the canvas."""
    ways = {painting: _paint_by_threshold, searching: _search, pursuit: _pursue}
    return ways[way(style, most, job.mask is not None)](job, most, workers)


def way(style: Preset, most: int | None, masked: bool) -> ModuleType:
    """What lays the strokes: `painting` where a style asks for nothing but what the paper describes, `searching` for
    few strokes, else `pursuit`."""
    further = style.keep == "gain" or style.seeding != "grid" or style.cover or style.importance or style.regions
    if not (further or style.thin or masked):
        return painting
    return searching if budget.searched(style, most) else pursuit


def _paint_by_threshold(job: Job, _: int | None, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """The paper's way: strokes of all layers, and the canvas."""
    canvas = np.full_like(job.pixels, job.background)
    layers: list[LayerStrokes] = []
    fields = submit_fields(job.photo, job.preset, workers)
    for number, layer in enumerate(job.preset.layers, start=1):
        began = perf_counter()
        field = fields.popleft()()
        job.waited("fields", began)
        began = perf_counter()
        laid = sum(len(strokes.counts) for strokes in layers)
        tell = job.teller(number, laid, lambda: canvas_error(job.pixels, canvas, ERROR_STRIDE))
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


def _search(job: Job, most: int | None, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """At most so many strokes, each searched for, and the canvas."""
    assert most is not None  # noqa: S101 (no budget, no search)
    preset, weight, began = job.preset, _weight(job), perf_counter()
    picture = Pursuit.begin(job.pixels, weight, job.background, preset.cap == "round", workers=workers)
    strokes = searching.search(
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


def _pursue(job: Job, most: int | None, workers: Workers) -> tuple[list[LayerStrokes], Packed]:
    """Strokes of all layers kept by a pursuit, at most so many, and the canvas."""
    waiting = submit_fields(job.photo, job.preset, workers)
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
            brush, rules = pursuit_brush(preset, layer), layer_rules(preset, layer, number, least, job.spare, uneven)
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


def _weight(job: Job) -> NDArray[np.float32]:
    """(h, w) how much the error of a pixel counts."""
    preset = job.preset
    if job.mask is None and not preset.importance:
        return np.ones(job.pixels.shape, np.float32)
    importance = importance_map(job.photo.rgb, mask=job.mask, use=preset.importance)
    weight: NDArray[np.float32] = np.exp2(2 * preset.importance_strength * (2 * importance - 1)).astype(np.float32)
    return weight


def canvas_error(photo: Packed, canvas: Packed, stride: int) -> float:
    """Mean RGB distance of two pictures, measured on every `stride`th pixel both ways."""
    return mean_distance(photo, canvas, 0, photo.shape[0], 0, photo.shape[1], stride, 1.0)
