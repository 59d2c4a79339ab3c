"""What lies under the strokes: a colour, nothing, or a picture that covers the canvas."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan.errors import ImageError, InputError
from strokeplan.rendering.surface import CHANNELS, Surface
from strokeplan.rendering.view import View
from strokeplan.strokes import StrokePlan

Background = str | os.PathLike[str] | tuple[int, int, int] | ArrayLike
TRANSPARENT = "transparent"


@dataclass(frozen=True, eq=False)
class Ground:
    """A colour (None: transparent), and a (h, w, 3) picture over it if there is one."""

    color: tuple[int, int, int] | None
    picture: NDArray[np.uint8] | None = None

    @property
    def transparent(self) -> bool:
        return self.color is None

    def lay(self, surface: Surface, left: int, top: int, shown: View, finer: int = 1) -> None:
        """Lay the picture on a tile whose first pixel is (left, top) of a canvas `finer` times as large as shown."""
        if self.picture is None:
            return
        pixels = surface.pixels()
        rows, columns = pixels.shape[:2]
        pixels[..., CHANNELS[:3]] = covering(
            self.picture, finer * shown.columns, finer * shown.rows, left, top, columns, rows
        )
        surface.touched()


def as_ground(background: Background | None, plan: StrokePlan, shown: View) -> Ground:
    """The ground that a user means. Raises InputError for what is neither colour nor picture."""
    if background is None:
        return Ground(plan.background)
    if isinstance(background, str | os.PathLike):
        return _named(background, plan, shown)
    if isinstance(background, tuple):
        if len(background) != 3 or not all(isinstance(value, int) and 0 <= value <= 255 for value in background):
            raise InputError(f"background {background} is no colour; give three numbers of 0 to 255")
        return Ground(background)
    from strokeplan.image import as_photo

    return Ground(plan.background, _reduced(as_photo(background).rgb, shown))


def _named(background: str | os.PathLike[str], plan: StrokePlan, shown: View) -> Ground:
    from PIL import ImageColor

    from strokeplan.image import load_photo

    text = os.fspath(background)
    if text.strip().lower() == TRANSPARENT:
        return Ground(None)
    try:
        color = ImageColor.getrgb(text)
    except ValueError:
        if not Path(text).suffix:
            raise InputError(
                f"background {text!r} is no colour; try #faf0e6, white, transparent or photo.jpg"
            ) from None
        try:
            return Ground(plan.background, _reduced(load_photo(text).rgb, shown))
        except ImageError as error:
            raise ImageError(f"background {error}") from None
    if len(color) > 3:
        raise InputError(f"background {text} has an alpha of its own; give #rrggbb, or {TRANSPARENT}")
    return Ground(color[:3])


def covering(
    picture: NDArray[np.uint8], wide: int, tall: int, left: int, top: int, columns: int, rows: int
) -> NDArray[np.uint8]:
    """A piece of the picture as it covers a canvas of `wide` × `tall` pixels, in its own proportions.

    Every pixel depends on its place on the canvas alone: linear between the picture's pixels.
    """
    factor = max(wide / picture.shape[1], tall / picture.shape[0])
    y0, y1, wy = _between(top, rows, picture.shape[0], tall, factor)
    x0, x1, wx = _between(left, columns, picture.shape[1], wide, factor)
    wx, wy = wx[:, None], wy[:, None, None]
    upper = picture[y0][:, x0] * (1 - wx) + picture[y0][:, x1] * wx
    lower = picture[y1][:, x0] * (1 - wx) + picture[y1][:, x1] * wx
    return np.rint(upper * (1 - wy) + lower * wy).astype(np.uint8)


def _between(
    first: int, count: int, have: int, want: int, factor: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """For pixels first … first + count − 1 of `want`: the picture's pixels on either side, and the second's weight."""
    place = (np.arange(first, first + count) + 0.5 - 0.5 * want) / factor + 0.5 * have - 0.5
    low = np.floor(place)
    clipped = [np.clip(low + k, 0, have - 1).astype(np.int64) for k in (0, 1)]
    return clipped[0], clipped[1], (place - low).astype(np.float32)


def _reduced(picture: NDArray[np.uint8], shown: View) -> NDArray[np.uint8]:
    """A picture made as small as it may be to cover the canvas; one that is smaller stays as it is."""
    from PIL import Image

    factor = max(shown.columns / picture.shape[1], shown.rows / picture.shape[0])
    if factor >= 1.0:
        return picture
    size = max(round(picture.shape[1] * factor), shown.columns), max(round(picture.shape[0] * factor), shown.rows)
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BOX))
