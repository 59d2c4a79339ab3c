"""Pixels from a plan, at any size (Pycairo, the optional extra `raster`)."""

from __future__ import annotations

from strokeplan.rendering.raster import Surface, check_sides, encode_png, paint, render, require_cairo

__all__ = ["Surface", "check_sides", "encode_png", "paint", "render", "require_cairo"]
