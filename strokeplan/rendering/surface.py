"""Pycairo image surfaces, and the pixels in them."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError, MissingExtraError

CAIRO_SIDE = 32_767
"""Cairo's image surfaces end here; larger pictures are painted in tiles."""
CHANNELS = [2, 1, 0, 3] if sys.byteorder == "little" else [1, 2, 3, 0]
"""Where R, G, B and alpha lie among the four bytes of a Cairo pixel."""


def require_cairo() -> Any:
    """The cairo module, or a MissingExtraError that says how to get it."""
    try:
        import cairo
    except ImportError:
        raise MissingExtraError(
            "pictures need Pycairo: pip install 'strokeplan[raster]' "
            "(on Debian first: apt-get install libcairo2-dev pkg-config gcc python3-dev)"
        ) from None
    return cairo


class Surface:
    """A Pycairo image surface of `width` × `height` pixels, filled with one sRGB colour, or with nothing (None)."""

    def __init__(self, width: int, height: int, background: tuple[int, int, int] | None = (255, 255, 255)) -> None:
        cairo = require_cairo()
        if max(width, height) > CAIRO_SIDE:
            raise InputError(f"a picture of {width} × {height} pixels is too large; a side may have {CAIRO_SIDE}")
        self.transparent = background is None
        self._surface = cairo.ImageSurface(
            cairo.FORMAT_ARGB32 if background is None else cairo.FORMAT_RGB24, width, height
        )
        self.context = cairo.Context(self._surface)
        if background is not None:
            self.context.set_source_rgb(*(value / 255 for value in background))
            self.context.paint()

    @classmethod
    def over(cls, picture: NDArray[np.uint8], scale: float) -> Surface:
        """A surface that shows a (h, w, 3) picture enlarged by `scale`, in the picture's coordinates."""
        cairo = require_cairo()
        rows, columns = picture.shape[:2]
        surface = cls(round(columns * scale), round(rows * scale))
        pixels = np.zeros((rows, columns, 4), np.uint8)
        pixels[..., CHANNELS[:3]] = picture
        shown = cairo.ImageSurface.create_for_data(pixels, cairo.FORMAT_RGB24, columns, rows)
        surface.context.scale(scale, scale)
        surface.context.set_source_surface(shown)
        surface.context.get_source().set_extend(cairo.EXTEND_PAD)  # or the photo's border fades into the white
        surface.context.paint()
        shown.finish()
        return surface

    def pixels(self) -> NDArray[np.uint8]:
        """The surface's own memory, (h, w, 4), to read or to paint into; colours are premultiplied by alpha.

        What is written there is for `touched` to announce.
        """
        self._surface.flush()
        rows, columns = self._surface.get_height(), self._surface.get_width()
        strides = (self._surface.get_stride(), 4, 1)
        return np.ndarray((rows, columns, 4), np.uint8, self._surface.get_data(), strides=strides)

    def multiply(self, sheet: Surface) -> None:
        """Lay a transparent surface over this one, as a filter: colours multiply."""
        self.context.save()
        self.context.identity_matrix()
        self.context.set_source_surface(sheet._surface)
        self.context.set_operator(require_cairo().OPERATOR_MULTIPLY)
        self.context.paint()
        self.context.restore()

    def touched(self) -> None:
        """Tell Cairo that `pixels` were written to."""
        self._surface.mark_dirty()

    def picture(self, finer: int = 1) -> NDArray[np.uint8]:
        """The pixels so far: (h, w, 3) uint8, or (h, w, 4), not premultiplied, if the surface is transparent.

        Reduced by a whole number if `finer` is one above 1.
        """
        pixels = self.pixels() if finer == 1 else _reduced(self.pixels(), finer)
        if not self.transparent:
            return np.ascontiguousarray(pixels[..., CHANNELS[:3]])
        picture = np.ascontiguousarray(pixels[..., CHANNELS])
        alpha = picture[..., 3:].astype(np.uint32)
        colors = (picture[..., :3] * np.uint32(255) + alpha // 2) // np.maximum(alpha, 1)
        picture[..., :3] = np.minimum(colors, 255)
        return picture


def _reduced(pixels: NDArray[np.uint8], finer: int) -> NDArray[np.uint8]:
    """Means of blocks of `finer` × `finer` pixels."""
    total = np.zeros((pixels.shape[0] // finer, pixels.shape[1] // finer, 4), np.uint16)
    for y in range(finer):
        for x in range(finer):
            total += pixels[y::finer, x::finer]
    return ((total + finer * finer // 2) // (finer * finer)).astype(np.uint8)
