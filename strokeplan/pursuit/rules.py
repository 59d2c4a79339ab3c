"""What a preset asks of a pursuit: the brush and the rules of each layer."""

from __future__ import annotations

from strokeplan.painting import Brush, layer_brush
from strokeplan.presets import LayerPreset, Preset
from strokeplan.pursuit.scene import SEEDINGS, Rules

SIMPLIFY_SHARE, FIT_SHARE = 0.06, 0.2
"""Tolerances of strokes kept by gain are no less than these parts of the brush's width. What such a stroke gains is
measured on the fitted curve, so a loose fit costs nothing but detail that a brush so wide does not show."""
TRIGGER = 2.0
"""A cell is tried if strokes of this part of the greatest length, all as bad as the cell, would gain enough."""
CELL_WIDTHS = 2.0
"""Side of the cells of strokes kept by gain, in widths of their brush. With cells of one width, three times as
many seeds are tried for 0.1 dB at the same number of strokes."""
UNCOVERED = 2.0**20
"""Least mean error of a cell that holds a bare pixel, while none without is as bad: a picture is covered by strokes
that are needed for that, before it is bettered."""


def pursuit_brush(preset: Preset, layer: LayerPreset) -> Brush:
    """The brush of a layer of a pursuit."""
    brush = layer_brush(preset, layer)
    if preset.keep != "gain":
        return brush
    return brush._replace(
        simplify_tolerance=max(brush.simplify_tolerance, SIMPLIFY_SHARE * brush.width),
        fit_tolerance=max(brush.fit_tolerance, FIT_SHARE * brush.width),
    )


def layer_rules(preset: Preset, layer: LayerPreset, number: int, gain: float, spare: float, vary_width: bool) -> Rules:
    """The rules of layer `number` (from 1), whose strokes must gain so much; `spare` and `vary_width`: see Rules."""
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
        spare=spare,
        separation=preset.separation * layer.width,
        vary_width=vary_width,
    )
