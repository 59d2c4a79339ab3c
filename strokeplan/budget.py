"""A picture for a budget: the preset for so many strokes or so much detail, and the search for the best within it."""

from __future__ import annotations

from collections.abc import Callable
from math import log, sqrt
from typing import TYPE_CHECKING

import msgspec

from strokeplan.errors import InputError
from strokeplan.presets import LAYER_LENGTHS, MAX_LAYERS, Preset, Recipe

if TYPE_CHECKING:
    from strokeplan.pursuit import Pursuit

MAX_STROKES = 10_000_000
DETAIL_RANGE = 16.0
"""What a stroke must gain is divided by this at detail 1, and multiplied at detail 0; thresholds by its root."""
SEARCHED = 4_000
"""No more strokes than this are searched for, each on its own and all together: of more, that takes longer than a
pursuit does."""
FINEST, FINEST_EXPONENT, LEAST_FINEST = 20.0, -0.25, 2.9
"""The finest brush of a search: for a single stroke, in thousandths of √(width · height), and the power of their number
with which it falls, down to the last. The picture's resolution follows from it; the search rarely goes as fine."""
FEW = 4.0
"""The widest brush for a budget is as wide as squares so many times as large as the strokes' share of the canvas."""
LONGEST, BROADEST_SIGMA = 1000.0, 30.0
"""Bounds of what widening a brush makes of its length and scale, in thousandths of √(width · height)."""
ROUNDS = (8.0, 4.0, 2.0, 1.0)
"""What strokes of the wider brushes must gain, one round after the other: the best come first."""
GROUND = 4000.0
"""Width of a stroke that covers any canvas of up to 1:7, whichever of its points it lies on."""
SEARCHES = 7
"""Pursuits to find the gain for a budget."""
NEAR_ENOUGH = 0.97
"""A pursuit that keeps this part of the budget is the last."""
SURPLUS = 1.15
"""So is one that keeps so many times the budget, once the strokes that are missed least are dropped."""
AIM = 1.04
"""Pursuits aim at so many times the budget."""
EXPONENT = -0.9
"""The strokes of the default preset fall with this power of the gain."""
LONGEST_STEP = 60.0
"""Largest factor of the gain from one pursuit to the next."""


def within(recipe: Recipe, strokes: int | None, detail: float | None) -> tuple[Preset, int | None]:
    """The preset of a recipe for a budget, by default the recipe's own, and its strokes. Raises InputError."""
    if strokes is None and detail is None:
        strokes = recipe.strokes
    style = for_detail(for_strokes(recipe.preset, strokes), detail)
    if strokes is not None and detail is not None:
        raise InputError(f"strokes {strokes} and detail {detail:g} are two budgets; give one of them")
    return style, strokes


def for_detail(preset: Preset, detail: float | None) -> Preset:
    """The preset with more or less detail; 0.5 is as it stands. Raises InputError."""
    if detail is None:
        return preset
    if not 0 <= detail <= 1:
        raise InputError(f"detail {detail:g} is outside 0..1")
    factor = DETAIL_RANGE ** (1 - 2 * detail)
    layers = tuple(
        msgspec.structs.replace(layer, color_threshold=min(layer.color_threshold * sqrt(factor), 442))
        for layer in preset.layers
    )
    return msgspec.structs.replace(preset, gain=preset.gain * factor, layers=layers)


def for_strokes(preset: Preset, strokes: int | None) -> Preset:
    """The preset for at most so many strokes, which are kept by gain: for few strokes, with wider brushes in front and
    the canvas covered by a single stroke, as by a ground; where each is searched for, with a single layer for all
    widths, whose own is the finest. Raises InputError."""
    if strokes is None:
        return preset
    if not 1 <= strokes <= MAX_STROKES:
        raise InputError(f"strokes {strokes} is outside 1..{MAX_STROKES}")
    preset = msgspec.structs.replace(preset, keep="gain")
    if preset.lengths == "pixels":
        return preset
    if searched(preset, strokes):
        finest = msgspec.structs.replace(preset.layers[0], width=max(FINEST * strokes**FINEST_EXPONENT, LEAST_FINEST))
        return msgspec.structs.replace(preset, layers=(finest,))
    first, needed = preset.layers[0], 1000 * sqrt(FEW / strokes)
    layers = list(preset.layers)
    while needed > 1.5 * first.width and len(layers) + len(ROUNDS) < MAX_LAYERS:
        scale = needed / first.width
        lengths = {name: getattr(first, name) * scale for name in LAYER_LENGTHS}
        lengths["length"] = min(lengths["length"], LONGEST)
        lengths["sigma"] = min(lengths["sigma"], BROADEST_SIGMA)
        for gain in ROUNDS:
            layers.insert(len(layers) - len(preset.layers), msgspec.structs.replace(first, gain=gain, **lengths))
        needed /= 2
    if len(layers) > len(preset.layers) and preset.cover:
        layers.insert(0, msgspec.structs.replace(first, width=GROUND, length=1.0, min_length=0.0))
    return msgspec.structs.replace(preset, layers=tuple(layers))


def searched(preset: Preset, strokes: int | None) -> bool:
    """Whether each stroke is searched for: they are few, and a preset asks for nothing but nearness to the photo."""
    if strokes is None or strokes > SEARCHED or preset.lengths == "pixels" or preset.seeding != "worst-first":
        return False
    further = (preset.palette, preset.palette_size, preset.regions, preset.thin, preset.merge, preset.wander)
    return not any(further)


def best_within(most: int, gain: float, pursue: Callable[[float], Pursuit]) -> Pursuit:
    """The best of a few pursuits, each cut down to `most` strokes.

    The strokes that a pursuit keeps are about a power of the gain it asks for; the exponent is learnt on the way.
    """
    exponent, before = EXPONENT, None
    best: Pursuit | None = None
    for attempt in range(1, SEARCHES + 1):
        pursuit = pursue(gain)
        share = max(pursuit.strokes, 1) / most
        if share <= SURPLUS or (attempt == SEARCHES and best is None):
            pursuit.limit(most)
            if best is None or pursuit.total_error() < best.total_error():
                best = pursuit
            if share >= NEAR_ENOUGH:
                break
        if before is not None and before[0] != gain and before[1] != share:
            exponent = min(max(log(share / before[1]) / log(gain / before[0]), 3 * EXPONENT), EXPONENT / 3)
        before = gain, share
        gain *= min(max((AIM / share) ** (1 / exponent), 1 / LONGEST_STEP), LONGEST_STEP)
    return best or pursuit
