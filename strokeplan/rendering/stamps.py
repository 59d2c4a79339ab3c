"""The stamp brush: an image laid along the path, dab after dab, in the stroke's colour.

Dabs stand at equal arc lengths, a part of the brush's width apart; chance by the stroke's number and the dab's
moves, turns and scales each. The image is sampled from a pyramid, at the size at which it appears.

Known limit: dabs are blended one over the other, so a translucent image grows denser the closer they stand.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from strokeplan.errors import ImageError
from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.rendering.nibs import flattened, half_widths, nib_angles
from strokeplan.rendering.noise import chance
from strokeplan.rendering.tile import Tile, blend
from strokeplan.strokes import StrokePlan
from strokeplan.tractography import splitmix64

MAX_MEGAPIXELS = 40.0
"""Largest image that is taken for a stamp."""
MASK_SIDE = 512
"""Longer side that a stamp is reduced to: it then is sharp on strokes up to so many pixels wide."""
FLATNESS_PX = 0.1
"""Distance of the flattened path from the curve, in pixels."""
SHRINK = 0.35
"""Part of its size that the jitter may take from a dab."""
LEAST_STEP_PX = 0.25
"""Dabs are no closer than this; only strokes thinner than a pixel would have them so."""


class Stamp(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An image along the path, in the stroke's colour: dabs, leaves, letters."""

    image: Annotated[
        str | None,
        Meta(description="file whose opaque parts (or, without alpha, dark parts) paint; – for a daub of paint"),
    ] = None
    spacing: Annotated[float, Meta(ge=0.02, le=20, description="between dabs, in widths of the brush")] = 0.3
    jitter: Annotated[float, Meta(ge=0, le=1, description="how far dabs are moved, turned and shrunk by chance")] = 0.2
    opacity: Annotated[float, Meta(ge=0.05, le=1, description="of a dab")] = 1.0
    angle: Annotated[
        Annotated[float, Meta(ge=-360, le=360)] | None,
        Meta(description="of the image, degrees clockwise; – as the plan says, or else along the path"),
    ] = None

    @property
    def reach(self) -> float:
        return float(np.sqrt(2.0)) + self.jitter

    def check(self) -> None:
        """Raise ImageError now if the image cannot be used."""
        _pyramid(self.image)

    @property
    def detail(self) -> float:
        return 1.0

    def compiled(self, plan: StrokePlan) -> bool:
        return is_cached(_stamps)

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        pixels, channels = tile.pixels()
        radii, knots = half_widths(plan, strokes, tile.scale)
        angles = nib_angles(plan, strokes, self.angle, np.nan)
        if self.angle is None:
            angles += 0.5 * np.pi  # a plan tells the long axis of its brush, which lies across what it paints
        levels, sizes = _pyramid(self.image)
        _stamps(
            pixels, channels, tile.left, tile.top, tile.whole_points(plan, strokes), knots, radii, angles,
            0.5 * tile.scale * plan.widths[strokes], plan.colors[strokes], strokes, levels, sizes,
            np.array([self.spacing, self.jitter, self.opacity]),
        )  # fmt: skip
        tile.surface.touched()


@lru_cache(maxsize=4)
def _pyramid(image: str | None) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """A mask (0 … 1) and its halvings, one after the other, and (offset, rows, columns) of each."""
    mask = _daub() if image is None else _mask(Path(image))
    levels, sizes, offset = [], [], 0
    while True:
        levels.append(mask.ravel())
        sizes.append((offset, *mask.shape))
        offset += mask.size
        if max(mask.shape) == 1:
            return np.concatenate(levels), np.array(sizes)
        padded = np.pad(mask, [(0, side % 2) for side in mask.shape], mode="edge" if 1 in mask.shape else "constant")
        mask = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2).mean(axis=(1, 3), dtype=np.float32)


def _mask(path: Path) -> NDArray[np.float32]:
    """Where an image paints: its alpha, or without any how dark it is; a square that holds it in the middle."""
    from PIL import Image

    from strokeplan.image import decode_file, grey

    try:
        image, _ = decode_file(path, MAX_MEGAPIXELS)
    except ImageError as error:
        raise ImageError(f"stamp {error}") from None
    image.thumbnail((MASK_SIDE, MASK_SIDE), Image.Resampling.BOX)
    pixels = np.asarray(image)
    opaque = pixels.shape[2] < 4 or bool(np.all(pixels[..., 3] == 255))
    mask = 1.0 - grey(pixels[..., :3]) if opaque else pixels[..., 3] / 255.0
    if not np.any(mask > 0.5 / 255.0):
        raise ImageError(f"stamp {path}: paints nothing; its dark or its opaque parts would")
    side = max(mask.shape)
    margins = [((side - length) // 2, side - length - (side - length) // 2) for length in mask.shape]
    return np.ascontiguousarray(np.pad(mask, margins), np.float32)


def _daub() -> NDArray[np.float32]:
    """A short touch of a loaded brush: round corners, ends a little ragged, marks of hairs along it.

    Marks are wide and faint, and ends nearly even: side by side and turned, dabs would else make a saw of the edge.
    """
    from scipy.ndimage import gaussian_filter, gaussian_filter1d

    side = 256
    rng = np.random.default_rng(5)
    y, x = (np.mgrid[:side, :side] + 0.5) / (0.5 * side) - 1.0
    ends = gaussian_filter1d(rng.normal(size=side), 7.0)
    marks = gaussian_filter(rng.normal(size=(side, side)), (2.2, 40.0))
    body = 1.0 - (np.abs(x / (0.88 + 0.03 * (ends / ends.std())[:, None])) ** 2.6 + np.abs(y / 0.88) ** 2.6)
    paint = np.clip(body * 7.0 + 0.5, 0.0, 1.0) * np.clip(1.0 + 0.25 * marks / marks.std(), 0.35, 1.0)
    return np.ascontiguousarray(paint, np.float32)


@kernel
def _stamps(
    pixels: NDArray[np.uint8],
    channels: NDArray[np.int64],
    left: int,
    top: int,
    points: NDArray[np.float64],
    knots: NDArray[np.int64],
    radii: NDArray[np.float64],
    angles: NDArray[np.float64],
    sizes: NDArray[np.float64],
    colors: NDArray[np.uint8],
    numbers: NDArray[np.int64],
    levels: NDArray[np.float32],
    shapes: NDArray[np.int64],
    values: NDArray[np.float64],
) -> None:
    """Lay the dabs of strokes one after the other into a tile."""
    spacing, jitter, opacity = values
    color = np.empty(3)
    for i in range(len(sizes)):
        span = slice(knots[i], knots[i + 1])
        first = 3 * knots[i] - 2 * i
        path = flattened(points[first : first + 3 * (knots[i + 1] - knots[i]) - 2], radii[span], angles[span],
                         FLATNESS_PX)  # fmt: skip
        length = 0.0
        for k in range(len(path) - 1):
            length += np.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        # Equal steps with a dab at either end, so that no stroke is cut short by part of a step.
        count = max(int(np.round(length / max(2.0 * sizes[i] * spacing, LEAST_STEP_PX))), 1)
        for c in range(3):
            color[c] = colors[i, c]
        key = splitmix64(np.uint64(0xDAB), np.uint64(numbers[i]))
        k, before = 0, 0.0
        piece = np.hypot(path[1, 0] - path[0, 0], path[1, 1] - path[0, 1])
        for dab in range(count + 1):
            s = length * dab / count
            while s > before + piece and k < len(path) - 2:
                before += piece
                k += 1
                piece = np.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
            t = min(max((s - before) / max(piece, 1e-12), 0.0), 1.0)
            turned = (1.0 - t) * path[k, 3] + t * path[k + 1, 3]
            if np.isnan(turned):
                turned = np.arctan2(path[k + 1, 1] - path[k, 1], path[k + 1, 0] - path[k, 0])
            turned += jitter * (chance(key, dab, 0) - 0.5) * np.pi
            half = ((1.0 - t) * path[k, 2] + t * path[k + 1, 2]) * (1.0 - SHRINK * jitter * chance(key, dab, 1))
            x = (1.0 - t) * path[k, 0] + t * path[k + 1, 0] + jitter * sizes[i] * (chance(key, dab, 2) - 0.5)
            y = (1.0 - t) * path[k, 1] + t * path[k + 1, 1] + jitter * sizes[i] * (chance(key, dab, 3) - 0.5)
            _dab(pixels, channels, x - left, y - top, half, turned, color, opacity, levels, shapes)


@leaf
def _dab(
    pixels: NDArray[np.uint8],
    channels: NDArray[np.int64],
    x: float,
    y: float,
    half: float,
    turned: float,
    color: NDArray[np.float64],
    opacity: float,
    levels: NDArray[np.float32],
    shapes: NDArray[np.int64],
) -> None:
    """One dab around a place of the tile, from 2 × 2 samples a pixel."""
    cos, sin = np.cos(turned), np.sin(turned)
    reach = half * (abs(cos) + abs(sin)) + 1.0
    first_x, last_x = max(np.floor(x - reach), 0.0), min(np.ceil(x + reach), float(pixels.shape[1]))
    first_y, last_y = max(np.floor(y - reach), 0.0), min(np.ceil(y + reach), float(pixels.shape[0]))
    if first_x >= last_x or first_y >= last_y or half <= 0.0:
        return
    # The level on which a sample (half a pixel) is as large as a texel, and the next coarser one.
    texels = 0.25 * max(shapes[0, 1], shapes[0, 2]) / half
    depth = min(max(np.log2(texels), 0.0), len(shapes) - 1.0)
    level = min(int(depth), len(shapes) - 2)
    mix = depth - level
    for row in range(int(first_y), int(last_y)):
        for column in range(int(first_x), int(last_x)):
            laid = 0.0
            for k in range(4):
                dx, dy = column + 0.25 + 0.5 * (k % 2) - x, row + 0.25 + 0.5 * (k // 2) - y
                u, v = (dx * cos + dy * sin) / half, (dy * cos - dx * sin) / half
                laid += (1.0 - mix) * _texel(levels, shapes, level, u, v)
                if mix > 0.0:
                    laid += mix * _texel(levels, shapes, level + 1, u, v)
            if laid > 0.0:
                blend(pixels[row, column], channels, color, 0.0, 0.0, min(0.25 * opacity * laid, 1.0))


@leaf
def _texel(levels: NDArray[np.float32], shapes: NDArray[np.int64], level: int, u: float, v: float) -> float:
    """The mask at a place (−1 … 1 across either side), linear between texels, nothing outside."""
    offset, rows, columns = shapes[level, 0], shapes[level, 1], shapes[level, 2]
    x, y = 0.5 * (u + 1.0) * columns - 0.5, 0.5 * (v + 1.0) * rows - 0.5
    if x <= -1.0 or y <= -1.0 or x >= columns or y >= rows:
        return 0.0
    i, j = int(np.floor(x)), int(np.floor(y))
    fx, fy = x - i, y - j
    found = 0.0
    for dj in range(2):
        for di in range(2):
            if 0 <= i + di < columns and 0 <= j + dj < rows:
                weight = (fx if di else 1.0 - fx) * (fy if dj else 1.0 - fy)
                found += weight * levels[offset + (j + dj) * columns + i + di]
    return found
