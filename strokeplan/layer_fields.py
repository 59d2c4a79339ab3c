"""What the layers of a preset follow on a photo: the orientation field at the scale of each, and its tracts."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.field import OrientationField, submit_field
from strokeplan.image import LUMA, Photo, grey, hue, lab
from strokeplan.painting import BEND_WIDTHS, layer_brush, wander_key
from strokeplan.presets import LayerPreset, Preset
from strokeplan.tractography import splitmix64, track
from strokeplan.workers import Workers


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


def submit_fields(photo: Photo, preset: Preset, workers: Workers) -> deque[Callable[[], OrientationField]]:
    """The fields of all layers, in work in the workers; each is waited for when called."""
    image = _channels(photo, preset)
    known: dict[float, Callable[[], OrientationField]] = {}
    for layer in preset.layers:
        if layer.sigma not in known:
            known[layer.sigma] = cache(_field(image, preset, layer, workers))
    return deque(known[layer.sigma] for layer in preset.layers)


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


def _channels(photo: Photo, preset: Preset) -> NDArray[np.float32]:
    """What the orientation of a preset is measured on: (h, w), or (h, w, c)."""
    if preset.channels != "grey":
        return lab(photo.rgb) if preset.channels == "lab" else hue(photo.rgb)
    return grey(photo.rgb, LUMA if preset.grey == "luma" else (1 / 3, 1 / 3, 1 / 3))


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
