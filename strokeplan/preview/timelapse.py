"""A plan being painted, as a moving picture: animated GIF or WebP.

The strokes are laid on one surface, frame after frame, so that a time lapse costs little more than one picture.
Time is eased: a stroke takes as long as the square root of its painted area says, so that wide strokes linger
and thin ones hurry. A GIF has one palette for all frames and no dithering: what no stroke touches never flickers.

Known limit: a GIF counts time in hundredths of a second; frames are rounded to them, their sum is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import FormatError, InputError
from strokeplan.files import atomic_write
from strokeplan.rendering import Round, Surface, Tile
from strokeplan.strokes import StrokePlan

if TYPE_CHECKING:
    from PIL import Image

SUFFIXES = (".gif", ".webp")
DEFAULT_WIDTH = 800
MAX_FPS = 50
"""Browsers slow down a GIF that is faster."""
MAX_SIDE = 8192
MAX_PIXELS = 500_000_000
"""Of all frames together: half a gigabyte, which a GIF takes while it is written."""
HOLD_S = 2.0
"""How long the finished picture stays."""
PALETTE_TIMES = (0.1, 0.4, 1.0)
"""The moments whose colours the palette of a GIF is chosen from."""
WEBP_QUALITY = 80


def check_time_lapse(path: str | Path) -> None:
    """Raise FormatError for a suffix that no time lapse has."""
    if Path(path).suffix.lower() not in SUFFIXES:
        known = " and ".join(SUFFIXES)
        raise FormatError(f"{path}: unknown suffix {Path(path).suffix!r} for a time lapse; known are {known}")


def save_time_lapse(
    plan: StrokePlan,
    path: str | Path,
    *,
    seconds: float = 10.0,
    fps: float = 20.0,
    width: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write the time lapse of a plan to `path`, .gif or .webp, whole or not at all.

    seconds   of painting; the finished picture stays for two more.
    fps       frames a second, at most 50.
    width     in pixels, the height follows; by default the canvas's, at most 800.
    progress  called with the part that is done, 0 … 1.

    The same plan and options give the same bytes. Raises InputError for a size or time that cannot be,
    FormatError for another suffix, OutputError, MissingExtraError without Pycairo.
    """
    check_time_lapse(path)
    size, ends = _frame_size(plan, width), _frame_times(seconds, fps)
    if size[0] * size[1] * len(ends) > MAX_PIXELS:
        raise InputError(
            f"{len(ends)} frames of {size[0]} × {size[1]} pixels are too much; "
            f"give a smaller width, fewer seconds or fewer fps (up to {MAX_PIXELS // 1_000_000} million pixels in all)"
        )
    durations = [after - before for before, after in pairwise((0, *ends))]
    durations[-1] += round(1000 * HOLD_S)
    gif = Path(path).suffix.lower() == ".gif"
    pictures = _told(_pictures(plan, size, np.arange(1, len(ends) + 1) / len(ends)), len(ends), progress)
    frames = _indexed(pictures, _palette(plan, size), plan.background) if gif else pictures
    options: dict[str, Any] = {"optimize": False} if gif else {"quality": WEBP_QUALITY, "method": 4}
    with atomic_write(path) as stream:
        next(frames).save(
            stream,
            "GIF" if gif else "WEBP",
            save_all=True,
            append_images=frames,
            duration=durations,
            loop=0,
            **options,
        )


def pace(plan: StrokePlan) -> NDArray[np.float64]:
    """(n,) the part of the time, up to 1, at which each stroke has been laid."""
    steps = np.linalg.norm(np.diff(plan.points, axis=0), axis=1)
    lengths = np.add.reduceat(np.append(steps, 0.0), plan.starts[:-1]) if len(plan) else np.empty(0)
    lengths[:-1] -= steps[plan.starts[1:-1] - 1]  # the leaps from one stroke to the next
    times: NDArray[np.float64] = np.cumsum(np.sqrt(plan.widths * (plan.widths + lengths)))
    return np.divide(times, times[-1:])


def _frame_size(plan: StrokePlan, width: int | None) -> tuple[int, int]:
    columns = min(round(plan.width), DEFAULT_WIDTH) if width is None else width
    if columns < 1 and width is not None:
        raise InputError(f"width {width} is no size; give more than 0")
    columns = max(columns, 1)
    rows = max(round(columns * plan.height / plan.width), 1)
    if max(columns, rows) > MAX_SIDE:
        raise InputError(f"a time lapse of {columns} × {rows} pixels is too large; a side may have {MAX_SIDE}")
    return columns, rows


def _frame_times(seconds: float, fps: float) -> list[int]:
    """Milliseconds at which each frame ends, in whole hundredths of a second."""
    if not (isfinite(fps) and 0 < fps <= MAX_FPS):
        raise InputError(f"fps {fps:g} is no frame rate; give more than 0 and at most {MAX_FPS}")
    if not (isfinite(seconds) and 0 < seconds <= 3600):
        raise InputError(f"seconds {seconds:g} is no time for a time lapse; give more than 0 and at most 3600")
    frames = max(round(seconds * fps), 1)
    return [10 * round(100 * frame / fps) for frame in range(1, frames + 1)]


def _pictures(plan: StrokePlan, size: tuple[int, int], times: NDArray[np.float64]) -> Iterator[Image.Image]:
    """The picture at each moment, painted on from the one before."""
    from PIL import Image

    surface = Surface(*size, plan.background)
    tile, brush = Tile(surface, 0, 0, size[0] / plan.width, size[1] / plan.height), Round()
    ends = np.searchsorted(pace(plan), times, side="right")
    ends[times >= 1.0] = len(plan)
    for first, last in pairwise((0, *ends.tolist())):
        brush.paint(tile, plan, np.arange(first, last))
        yield Image.fromarray(surface.picture())


def _told(
    pictures: Iterator[Image.Image], count: int, progress: Callable[[float], None] | None
) -> Iterator[Image.Image]:
    for done, picture in enumerate(pictures, start=1):
        yield picture
        if progress:
            progress(done / count)


def _palette(plan: StrokePlan, size: tuple[int, int]) -> Image.Image:
    """An image with the colours of a GIF: the paper's own and 254, so that one is left to say "as before"."""
    from PIL import Image

    moments = [np.asarray(picture) for picture in _pictures(plan, size, np.array(PALETTE_TIMES))]
    chosen = Image.fromarray(np.concatenate(moments)).quantize(254, Image.Quantize.MEDIANCUT, kmeans=1)
    palette = Image.new("P", (1, 1))
    palette.putpalette([*plan.background, *(chosen.getpalette() or ())])
    return palette


def _indexed(
    pictures: Iterator[Image.Image], palette: Image.Image, paper: tuple[int, int, int]
) -> Iterator[Image.Image]:
    from PIL import Image

    for picture in pictures:
        indexed = np.array(picture.quantize(palette=palette, dither=Image.Dither.NONE))
        indexed[np.all(np.asarray(picture) == paper, axis=2)] = 0  # Pillow is content with a colour nearby
        frame = Image.fromarray(indexed)
        frame.putpalette(palette.getpalette() or ())
        yield frame
