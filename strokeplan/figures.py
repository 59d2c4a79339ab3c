"""Pictures of what the method sees, as the paper's figures show it (needs Pycairo).

All functions return (h, w, 3) uint8 pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.field import OrientationField
from strokeplan.image import Photo
from strokeplan.rendering import Surface, require_cairo

Picture = NDArray[np.uint8]

ARROW = (1.0, 0.85, 0.1)
TRACT = (0.95, 0.15, 0.1)
SEED = (0.1, 0.3, 1.0)
FIGURE_SIDE = 1200
"""Figures are drawn at least this large on their longer side, so that arrows stay legible."""


def orientation_figure(photo: Photo, field: OrientationField, *, spacing: float | None = None) -> Picture:
    """Figure 2a: arrows along the minor eigenvector over the photo, as long as the coherence is high.

    `spacing` between arrows in photo pixels (default: 48 along the longer side).
    """
    step = max(photo.width / 48, photo.height / 48, 1.0) if spacing is None else spacing
    if not 1 <= step < inf:
        raise InputError(f"spacing {step:g} is no distance between arrows; give 1 pixel or more")
    surface = _over_photo(photo, dim=0.45)
    context = surface.context
    context.set_source_rgb(*ARROW)
    context.set_line_width(step * 0.1)
    context.set_line_cap(require_cairo().LINE_CAP_ROUND)
    for y in np.arange(step / 2, photo.height, step):
        for x in np.arange(step / 2, photo.width, step):
            i = min(int(y / field.scale), field.samples.shape[0] - 1)
            j = min(int(x / field.scale), field.samples.shape[1] - 1)
            ux, uy, coherence = (float(value) for value in field.samples[i, j])
            if coherence > 0:
                _arrow(context, x, y, ux, uy, 0.85 * step * coherence)
    return surface.picture()


def coherence_figure(field: OrientationField) -> Picture:
    """Coherence as brightness, 0 black to 1 white, at the photo's size."""
    from PIL import Image

    grey = np.rint(field.samples[..., 2] * 255).astype(np.uint8)
    # The last row and column of samples may reach over the photo's edge.
    box = (0, 0, field.width / field.scale, field.height / field.scale)
    shown = Image.fromarray(grey).resize((field.width, field.height), Image.Resampling.BILINEAR, box)
    return np.repeat(np.asarray(shown)[..., None], 3, axis=2)


def tract_figure(photo: Photo, tract: NDArray[np.float64], seed: tuple[float, float]) -> Picture:
    """Figure 2b: one tract (n, 2) over the photo, its seed as a blue point."""
    surface = _over_photo(photo, dim=0.25)
    unit = max(photo.width, photo.height) / 300
    _line(surface.context, tract, 1.6 * unit, (1.0, 1.0, 1.0, 1.0))
    _line(surface.context, tract, unit, (*TRACT, 1.0))
    _seed(surface.context, seed, unit)
    return surface.picture()


def spread_figure(photo: Photo, tracts: Sequence[NDArray[np.float64]], seed: tuple[float, float]) -> Picture:
    """Many tracts (n, 2) through one seed over the photo, as probabilistic tractography shows them.

    They are see-through, so that their colour is deep where many of them run.
    """
    surface = _over_photo(photo, dim=0.25)
    unit = max(photo.width, photo.height) / 300
    for tract in tracts:
        _line(surface.context, tract, 0.6 * unit, (*TRACT, max(0.1, 1 / sqrt(len(tracts)))))
    _seed(surface.context, seed, unit)
    return surface.picture()


def side_by_side(pictures: Sequence[Picture], *, gap: int = 8) -> Picture:
    """Pictures of one height in a row, on white."""
    return montage(pictures, columns=len(pictures), gap=gap)


def montage(pictures: Sequence[Picture], *, columns: int, gap: int = 8) -> Picture:
    """Pictures in rows of `columns`, each centred in a tile as large as the largest, on white."""
    if not pictures:
        raise InputError("a montage needs at least one picture")
    check_montage(columns)
    columns = min(columns, len(pictures))
    height, width = (max(picture.shape[axis] for picture in pictures) for axis in (0, 1))
    rows = ceil(len(pictures) / columns)
    sheet = np.full((rows * (height + gap) - gap, columns * (width + gap) - gap, 3), 255, np.uint8)
    for index, picture in enumerate(pictures):
        top = index // columns * (height + gap) + (height - picture.shape[0]) // 2
        left = index % columns * (width + gap) + (width - picture.shape[1]) // 2
        sheet[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return sheet


def check_montage(columns: int, tile: int = 1) -> None:
    """Raise InputError for a sheet that cannot be made."""
    if columns < 1:
        raise InputError(f"columns {columns} is below 1")
    if not 1 <= tile <= 4096:
        raise InputError(f"tile {tile} is outside 1..4096 pixels")


def shrink(picture: Picture, scale: float) -> Picture:
    """The picture reduced by `scale` ≤ 1 with Lanczos' filter; as it is for a larger one."""
    from PIL import Image

    if scale >= 1:
        return picture
    size = (max(round(picture.shape[1] * scale), 1), max(round(picture.shape[0] * scale), 1))
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS))


def clearest_point(field: OrientationField) -> tuple[float, float]:
    """Where a tract shows best: the middle of the block (1/12 of the photo) of highest mean coherence."""
    coherence = field.samples[..., 2]
    block = max(max(coherence.shape) // 12, 1)
    rows, cols = max(coherence.shape[0] // block, 1), max(coherence.shape[1] // block, 1)
    trimmed = coherence[: rows * block, : cols * block]
    high, wide = trimmed.shape[0] // rows, trimmed.shape[1] // cols
    means = trimmed.reshape(rows, high, cols, wide).mean(axis=(1, 3))
    i, j = np.unravel_index(int(means.argmax()), means.shape)
    x, y = (float(j) + 0.5) * wide * field.scale, (float(i) + 0.5) * high * field.scale
    return min(x, field.width), min(y, field.height)


def _over_photo(photo: Photo, dim: float) -> Surface:
    """A surface in photo coordinates that shows the photo, mixed with white by `dim`."""
    shown = np.rint(photo.rgb * (1 - dim) + 255 * dim).astype(np.uint8)
    return Surface.over(shown, scale=max(1.0, FIGURE_SIDE / max(photo.width, photo.height)))


def _line(context: Any, points: NDArray[np.float64], width: float, color: tuple[float, float, float, float]) -> None:
    cairo = require_cairo()
    context.set_line_join(cairo.LINE_JOIN_ROUND)
    context.set_line_cap(cairo.LINE_CAP_ROUND)
    context.set_line_width(width)
    context.set_source_rgba(*color)
    for x, y in points.tolist():
        context.line_to(x, y)
    context.stroke()


def _seed(context: Any, seed: tuple[float, float], unit: float) -> None:
    for radius, color in ((1.8 * unit, (1.0, 1.0, 1.0)), (1.4 * unit, SEED)):
        context.set_source_rgb(*color)
        context.arc(*seed, radius, 0, 2 * np.pi)
        context.fill()


def _arrow(context: Any, x: float, y: float, ux: float, uy: float, length: float) -> None:
    """An arrow of `length` centred on (x, y) along the unit vector (ux, uy)."""
    tip_x, tip_y = x + 0.5 * length * ux, y + 0.5 * length * uy
    context.move_to(x - 0.5 * length * ux, y - 0.5 * length * uy)
    context.line_to(tip_x, tip_y)
    for side in (-1, 1):
        context.move_to(tip_x, tip_y)
        context.line_to(tip_x - 0.3 * length * (ux - side * uy * 0.6), tip_y - 0.3 * length * (uy + side * ux * 0.6))
    context.stroke()
