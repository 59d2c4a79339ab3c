"""Pixels from a plan, at any size, with any brush (Pycairo, the optional extra `raster`)."""

from __future__ import annotations

from strokeplan.rendering.brushes import BRUSHES, Brush, as_brush
from strokeplan.rendering.nibs import Flat, Round
from strokeplan.rendering.pictures import encode_picture, encode_png
from strokeplan.rendering.raster import paint, render
from strokeplan.rendering.ribbons import Bristle, Dry, Line, Wet
from strokeplan.rendering.stamps import Stamp
from strokeplan.rendering.surface import Surface, require_cairo
from strokeplan.rendering.tile import Tile
from strokeplan.rendering.view import check_sides

__all__ = [
    "BRUSHES",
    "Bristle",
    "Brush",
    "Dry",
    "Flat",
    "Line",
    "Round",
    "Stamp",
    "Surface",
    "Tile",
    "Wet",
    "as_brush",
    "check_sides",
    "encode_picture",
    "encode_png",
    "paint",
    "render",
    "require_cairo",
]
