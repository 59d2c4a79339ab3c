"""From the strokes of all layers to a plan in pixels of its photo, with coordinates that a file keeps."""

from __future__ import annotations

from dataclasses import replace
from math import floor, log10, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.image import Photo
from strokeplan.painting import LayerStrokes
from strokeplan.presets import Preset
from strokeplan.strokes import Layer, Source, StrokePlan, hex_to_rgb

DECIMALS = 2
"""Coordinates of a plan are multiples of 0.01 px, so that a plan equals its file, or of a coarser power of ten …"""
GRID_SHARE = 1 / 40
"""… if that is no more than this part of its finest stroke's width: nobody sees the rest, and files carry it. Only of
presets of relative lengths; one in pixels has fixed tolerances and fixed coordinates."""


def assemble(
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


def on_canvas(plan: StrokePlan, photo: Photo, settings: dict[str, Any]) -> StrokePlan:
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
