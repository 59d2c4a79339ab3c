"""At which resolution a photo is planned.

A preset whose lengths are relative is planned where its finest brush is FINEST_PX wide, whatever the photo's own
resolution; one in pixels is planned on the photo's. A JPEG of which so little is needed is decoded at 1/2, 1/4 or
1/8 of its size (libjpeg scales its blocks), in a small part of the time: `load_for`.
"""

from __future__ import annotations

import os
from dataclasses import replace

import msgspec
import numpy as np
from PIL import Image

from strokeplan.image import Photo, load_photo
from strokeplan.presets import Preset

FINEST_PX = 2.0
"""A preset of relative lengths is planned at the resolution at which its finest brush is this wide …"""
SPARED = 1.25
"""… unless the photo's own is within this factor of it: resampling would cost sharpness for nothing."""
LARGEST_ENLARGEMENT = 4.0
"""A photo smaller than this part of that resolution has nothing that a brush so fine could show."""

NARROWEST_PX = 1.0
"""Least relative width at the working resolution."""


def working_size(style: Preset, width: int, height: int) -> tuple[int, int]:
    """Width and height at which a preset plans a photo of width × height pixels."""
    finest = min(layer.width for layer in style.for_photo(width, height).layers)
    scale = min(FINEST_PX / finest, LARGEST_ENLARGEMENT)
    if style.lengths == "pixels" or 1 / SPARED <= scale <= SPARED:
        return width, height
    return max(round(width * scale), 2), max(round(height * scale), 2)


def working_copy(photo: Photo, style: Preset) -> Photo:
    """The photo at the resolution at which a preset plans it."""
    size = working_size(style, photo.width, photo.height)
    if size == photo.decoded:
        return replace(photo, size=None)
    shown = Image.fromarray(photo.rgb).resize(size, Image.Resampling.LANCZOS, reducing_gap=3.0)
    return replace(photo, rgb=np.asarray(shown), size=None)


def working_preset(style: Preset, work: Photo, spare: float) -> Preset:
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


def load_for(path: str | os.PathLike[str], style: Preset) -> Photo:
    """The photo of a file, to be planned with this preset: `load_photo`, but of a JPEG that is planned much smaller
    than it is no more is decoded than that needs. Raises ImageError."""
    return load_photo(path, needed=lambda width, height: working_size(style, width, height))
