"""A picture for a budget: the preset for so many strokes or so much detail, and the search for the best within it."""

from __future__ import annotations

from collections.abc import Callable
from math import log, sqrt
from typing import TypeVar

import msgspec

from strokeplan.errors import InputError
from strokeplan.presets import LAYER_LENGTHS, Preset
from strokeplan.pursuit import Pursuit

MAX_STROKES = 10_000_000
DETAIL_RANGE = 16.0
"""What a stroke must gain is divided by this at detail 1, and multiplied at detail 0; thresholds by its root."""
COVERAGE = 0.8
"""Part of the area of strokes of four times their width that is left to cover the canvas, the rest overlaps."""
SEARCHES = 7
"""Pursuits to find the gain for a budget."""
NEAR_ENOUGH = 0.97
"""A pursuit that keeps this part of the budget is the last."""
SURPLUS = 1.15
"""One that keeps so many times the budget is, once its least strokes are dropped."""


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
    """The preset for at most so many strokes, which are kept by gain: with wider brushes in front if few strokes
    of its first could not cover the canvas. Raises InputError."""
    if strokes is None:
        return preset
    if not 1 <= strokes <= MAX_STROKES:
        raise InputError(f"strokes {strokes} is outside 1..{MAX_STROKES}")
    preset = msgspec.structs.replace(preset, keep="gain")
    if preset.lengths == "pixels":
        return preset
    first, needed = preset.layers[0], 1000 / sqrt(4 * COVERAGE * strokes)
    wider = []
    while needed > 1.5 * first.width:
        scale = needed / first.width
        wider.append(
            msgspec.structs.replace(first, **{name: getattr(first, name) * scale for name in LAYER_LENGTHS})
        )
        needed /= 2
    return msgspec.structs.replace(preset, layers=(*wider, *preset.layers))


def best_within(most: int, gain: float, pursue: Callable[[float], Pursuit]) -> Pursuit:
    """The pursuit that keeps the most strokes that a budget allows.

    The number of strokes falls with what they must gain about as a power of it, whose exponent the
    pursuits themselves tell.
    """
    tried: list[tuple[float, float]] = []
    best = None
    for _ in range(SEARCHES):
        pursuit = pursue(gain)
        found = pursuit.strokes
        pursuit.limit(most)
        if best is None or pursuit.total_error() < best.total_error():
            best = pursuit
        if NEAR_ENOUGH * most <= found <= SURPLUS * most:
            break
        tried.append((log(gain), log(max(found, 1) / most)))
        slope = -0.9
        if len(tried) > 1 and tried[-1][0] != tried[-2][0]:
            slope = (tried[-1][1] - tried[-2][1]) / (tried[-1][0] - tried[-2][0])
        step = -(tried[-1][1] - log(1.03)) / min(max(slope, -2.0), -0.3)
        gain *= 2.718281828459045 ** min(max(step, -4.0), 4.0)
    assert best is not None
    return best
