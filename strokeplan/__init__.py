"""strokeplan turns a photograph into brush or pen strokes and keeps them as vectors.

import strokeplan
plan = strokeplan.plan("photo.jpg", preset="paper", seed=0)
plan.save("photo.svg")
picture = strokeplan.render(plan, width=4000)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from strokeplan.errors import (
    FormatError,
    ImageError,
    InputError,
    MissingExtraError,
    OutputError,
    PresetError,
    StrokeplanError,
    StrokeplanWarning,
)
from strokeplan.version import __version__

if TYPE_CHECKING:
    from strokeplan.formats import load, save
    from strokeplan.formats.options import ExportOptions
    from strokeplan.image import Photo, load_photo
    from strokeplan.page import Page
    from strokeplan.planner import plan
    from strokeplan.presets import Preset, load_preset
    from strokeplan.rendering import render
    from strokeplan.strokes import Layer, Source, StrokePlan

# Loaded when first used, so that `strokeplan --help` needs neither numpy nor numba.
_HOMES = {
    "ExportOptions": "formats.options",
    "Layer": "strokes",
    "Page": "page",
    "Photo": "image",
    "Preset": "presets",
    "Source": "strokes",
    "StrokePlan": "strokes",
    "load": "formats",
    "load_photo": "image",
    "load_preset": "presets",
    "plan": "planner",
    "render": "rendering",
    "save": "formats",
}

__all__ = [
    "ExportOptions",
    "FormatError",
    "ImageError",
    "InputError",
    "Layer",
    "MissingExtraError",
    "OutputError",
    "Page",
    "Photo",
    "Preset",
    "PresetError",
    "Source",
    "StrokePlan",
    "StrokeplanError",
    "StrokeplanWarning",
    "__version__",
    "load",
    "load_photo",
    "load_preset",
    "plan",
    "render",
    "save",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'strokeplan' has no attribute {name!r}")
    value = getattr(import_module(f"strokeplan.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
