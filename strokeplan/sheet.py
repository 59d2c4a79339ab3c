"""The picture on its page, as pixels: how fine they are, and how they are blurred, turned and put together."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from strokeplan.errors import InputError
from strokeplan.page import Page, Placement

PAGE = Page(210.0, 297.0, 15.0)
"""Without a page: A4, turned as the photo is."""
PIXELS_A_PEN = 3.0
"""Coverage is measured on pixels so many times finer than the finest pen …"""
MAX_PIXELS = 16e6
"""… or of such a number of pixels."""
COARSE = 3
"""Blurred things are worked on with blocks of so many pixels."""

Raster = NDArray[np.float32]


class Sheet(NamedTuple):
    """The picture on its page: everything in millimetres from its upper left corner."""

    placement: Placement
    width_mm: float
    height_mm: float
    pixel_mm: float

    @property
    def size_mm(self) -> tuple[float, float]:
        return self.width_mm, self.height_mm

    @property
    def pixels(self) -> tuple[int, int]:
        """Columns and rows."""
        return round(self.width_mm / self.pixel_mm), round(self.height_mm / self.pixel_mm)


def turned(page: Page, width: int, height: int) -> Page:
    """A page with its longer side along that of a picture."""
    short, long = sorted((page.width_mm, page.height_mm))
    return Page(*((long, short) if width > height else (short, long)), page.margin_mm)


def sheet_of(width: int, height: int, page: Page, finest_mm: float) -> Sheet:
    """Where a picture of width × height lies on a page, for pens of which the finest is `finest_mm`.

    Raises InputError for one that would be too small.
    """
    place = page.fit(width, height)
    width_mm, height_mm = width * place.scale, height * place.scale
    pixel = max(finest_mm / PIXELS_A_PEN, sqrt(width_mm * height_mm / MAX_PIXELS))
    if min(width_mm, height_mm) < 2 * COARSE * pixel:
        raise InputError(f"a picture of {width_mm:.3g} × {height_mm:.3g} mm is too small for a pen of {finest_mm:g} mm")
    return Sheet(place, width_mm, height_mm, pixel)


def blurred(image: Raster, sigma: float) -> Raster:
    """A Gaussian blur of `sigma` pixels; what is beyond the edge is as at the edge."""
    from scipy.ndimage import gaussian_filter

    found: Raster = gaussian_filter(image, sigma, mode="nearest")
    return found


def blocks(image: Raster) -> Raster:
    """Means of COARSE × COARSE pixels; what is left over at the right and bottom is repeated."""
    rows, columns = image.shape
    padded = np.pad(image, ((0, -rows % COARSE), (0, -columns % COARSE)), mode="edge")
    # Row by row, then column by column: one sum over both axes takes three times as long.
    across = sum(padded[k::COARSE] for k in range(1, COARSE)) + padded[::COARSE]
    total: Raster = sum(across[:, k::COARSE] for k in range(1, COARSE)) + across[:, ::COARSE]
    return total * np.float32(1 / COARSE**2)


def seen(image: Raster, sigma: float) -> Raster:
    """A blur of `sigma` pixels, worked out on blocks, at full size."""
    rows, columns = image.shape
    small = Image.fromarray(blurred(blocks(image), sigma / COARSE))
    box = (0.0, 0.0, columns / COARSE, rows / COARSE)
    return np.array(small.resize((columns, rows), Image.Resampling.BILINEAR, box))


def rotated(samples: Raster, angle: float | Raster) -> Raster:
    """The unit vectors of a field (h, w, 3), turned by an angle or by (h, w) angles in radians."""
    cos, sin = np.float32(1) * np.cos(angle), np.float32(1) * np.sin(angle)
    turned = samples.copy()
    turned[..., 0] = cos * samples[..., 0] - sin * samples[..., 1]
    turned[..., 1] = sin * samples[..., 0] + cos * samples[..., 1]
    return turned
