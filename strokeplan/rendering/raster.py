"""The round brush on a Pycairo image surface: a stroke is one stroked path, or with pressure one filled outline."""

from __future__ import annotations

import io
import sys
from itertools import islice
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError, MissingExtraError
from strokeplan.outlines import outline
from strokeplan.pens import transparent_layers
from strokeplan.strokes import StrokePlan, unit_mm

MAX_SIDE = 32_767
"""Cairo's image surfaces end here."""
TOLERANCE_PX = 0.05
"""By this much, in pixels of the picture, a painted outline may differ from its stroke; Cairo flattens to 0.1."""
DOTS_A_MM = 300 / 25.4
"""Of pictures of pen drawings, unless another size is asked for."""
_CHANNELS = [2, 1, 0] if sys.byteorder == "little" else [1, 2, 3]
"""Where R, G, B lie among the four bytes of a Cairo pixel."""


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


def render(
    plan: StrokePlan,
    *,
    width: int | None = None,
    height: int | None = None,
    scale: float | None = None,
) -> NDArray[np.uint8]:
    """Paint the plan as a (h, w, 3) uint8 picture.

    Give one of `width` or `height` (pixels; the other follows) or `scale` (1 = the canvas's own size,
    the default; of a pen drawing on paper it is 300 dots an inch).
    Raises InputError for a size that is no size, MissingExtraError without Pycairo.
    """
    return paint(plan, *picture_size(plan, width=width, height=height, scale=scale))


def paint(plan: StrokePlan, columns: int, rows: int, *, antialias: bool = True) -> NDArray[np.uint8]:
    """Paint the plan as a (rows, columns, 3) uint8 picture, stretched to fit if the shapes differ.

    Without `antialias` a stroke covers the pixels whose centres it covers, and those wholly.
    """
    surface = Surface(columns, rows, plan.background)
    if not antialias:
        surface.context.set_antialias(require_cairo().ANTIALIAS_NONE)
    scales = columns / plan.width, rows / plan.height
    surface.context.scale(*scales)
    _paint(surface.context, plan, TOLERANCE_PX / max(scales))
    return surface.picture()


class Surface:
    """A Pycairo image surface of `width` × `height` pixels, filled with one sRGB colour."""

    def __init__(self, width: int, height: int, background: tuple[int, int, int] = (255, 255, 255)) -> None:
        cairo = require_cairo()
        check_sides(width, height)
        self._surface = cairo.ImageSurface(cairo.FORMAT_RGB24, width, height)
        self.context = cairo.Context(self._surface)
        self.context.set_source_rgb(*(value / 255 for value in background))
        self.context.paint()

    @classmethod
    def over(cls, picture: NDArray[np.uint8], scale: float) -> Surface:
        """A surface that shows a (h, w, 3) picture enlarged by `scale`, in the picture's coordinates."""
        cairo = require_cairo()
        rows, columns = picture.shape[:2]
        surface = cls(round(columns * scale), round(rows * scale))
        pixels = np.zeros((rows, columns, 4), np.uint8)
        pixels[..., _CHANNELS] = picture
        shown = cairo.ImageSurface.create_for_data(pixels, cairo.FORMAT_RGB24, columns, rows)
        surface.context.scale(scale, scale)
        surface.context.set_source_surface(shown)
        surface.context.get_source().set_extend(cairo.EXTEND_PAD)  # or the photo's border fades into the white
        surface.context.paint()
        shown.finish()
        return surface

    def picture(self) -> NDArray[np.uint8]:
        """The pixels so far, (h, w, 3) uint8."""
        self._surface.flush()
        rows, columns = self._surface.get_height(), self._surface.get_width()
        strides = (self._surface.get_stride(), 4, 1)
        pixels = np.ndarray((rows, columns, 4), np.uint8, self._surface.get_data(), strides=strides)
        return np.ascontiguousarray(pixels[..., _CHANNELS])


def picture_size(
    plan: StrokePlan, *, width: int | None = None, height: int | None = None, scale: float | None = None
) -> tuple[int, int]:
    """Width and height in pixels of a picture of the plan; the smaller side has at least one pixel."""
    given = {
        name: value for name, value in (("width", width), ("height", height), ("scale", scale)) if value is not None
    }
    if len(given) > 1:
        raise InputError(f"give one of width, height and scale, not {' and '.join(given)}")
    for name, value in given.items():
        if not (isfinite(value) and value > 0):
            raise InputError(f"{name} {value:g} is no size; give more than 0")
    unit = unit_mm(plan)
    factor = scale or (1.0 if unit is None else unit * DOTS_A_MM)
    if width is not None:
        factor = width / plan.width
    if height is not None:
        factor = height / plan.height
    columns, rows = plan.width * factor, plan.height * factor
    check_sides(columns, rows)
    return max(round(columns), 1), max(round(rows), 1)


def check_sides(columns: float, rows: float) -> None:
    """Raise InputError for a picture that Cairo cannot hold."""
    if max(columns, rows) >= MAX_SIDE + 0.5:
        raise InputError(f"a picture of {columns:.0f} × {rows:.0f} pixels is too large; a side may have {MAX_SIDE}")


def encode_png(picture: NDArray[np.uint8]) -> bytes:
    """A (h, w, 3) uint8 picture as a PNG file."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG", compress_level=6)
    return stream.getvalue()


def _paint(context: Any, plan: StrokePlan, tolerance: float) -> None:
    cairo = require_cairo()
    context.set_line_join(cairo.LINE_JOIN_ROUND)
    points = plan.points.tolist()
    starts = plan.starts.tolist()
    widths = plan.widths.tolist()
    colors = (plan.colors / 255).tolist()
    move_to, curve_to = context.move_to, context.curve_to
    pressed = set(np.flatnonzero(plan.has_pressure).tolist())
    for layer, filters in zip(plan.layers, transparent_layers(plan), strict=True):
        if filters:
            context.push_group()
        context.set_line_cap(cairo.LINE_CAP_BUTT if layer.cap == "butt" else cairo.LINE_CAP_ROUND)
        spans = zip(
            range(layer.first, layer.last),
            islice(starts, layer.first, None), starts[layer.first + 1 : layer.last + 1],
            widths[layer.first : layer.last], colors[layer.first : layer.last], strict=False,
        )  # fmt: skip
        for i, first, last, width, color in spans:
            context.set_source_rgb(*color)
            if i in pressed:
                for x, y in outline(plan.stroke(i), plan.radii(i), tolerance, round_caps=layer.cap == "round").tolist():
                    context.line_to(x, y)
                context.fill()
                continue
            context.set_line_width(width)
            move_to(*points[first])
            for k in range(first + 1, last, 3):
                curve_to(*points[k], *points[k + 1], *points[k + 2])
            context.stroke()
        if filters:  # ink on the same ink is no darker, on another it is
            context.pop_group_to_source()
            context.set_operator(cairo.OPERATOR_MULTIPLY)
            context.paint()
            context.set_operator(cairo.OPERATOR_OVER)
