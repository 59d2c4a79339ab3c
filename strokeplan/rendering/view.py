"""What a picture shows of a plan, and how large: sizes on screen and on paper, regions, layers.

The whole canvas, enlarged, is a grid of whole pixels, and a picture is a box on that grid. A region is
therefore always a crop of the picture of everything at the same scale, to the byte.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.strokes import StrokePlan, unit_mm

MAX_SIDE = 300_000
"""Pixels that a side of a picture may have: 25 metres at 300 dpi."""
MAX_CANVAS = 2_000_000
"""Pixels that the whole canvas may have a side where a region of it is shown; Cairo counts up to 8 million."""
MM = {"mm": 1.0, "cm": 10.0, "in": 25.4}
"""Lengths on paper, in millimetres."""
DOTS_A_MM = 300 / MM["in"]
"""Of pictures of pen drawings, unless another size is asked for."""
Region = tuple[float, float, float, float]
"""x, y, width, height in units of the canvas."""


@dataclass(frozen=True, slots=True)
class View:
    """A box of pixels (left, top, width, height) on a canvas that is `columns` × `rows` pixels as a whole."""

    columns: int
    rows: int
    left: int
    top: int
    width: int
    height: int

    def scales(self, plan: StrokePlan) -> tuple[float, float]:
        """Pixels per unit of the plan, across and down; they differ by the rounding to whole pixels."""
        return self.columns / plan.width, self.rows / plan.height


def view(
    plan: StrokePlan,
    *,
    width: int | None = None,
    height: int | None = None,
    scale: float | None = None,
    region: Region | None = None,
) -> View:
    """The pixels of a picture of the plan, or of a region of it, given one of its sides or its scale."""
    x, y, wide, tall = (0.0, 0.0, plan.width, plan.height) if region is None else _inside(plan, region)
    factor = _factor(plan, wide, tall, width=width, height=height, scale=scale)
    check_sides(wide * factor, tall * factor)
    whole = plan.width * factor, plan.height * factor
    if max(whole) > MAX_CANVAS:
        raise InputError(
            f"at this size the whole canvas would have {whole[0]:.0f} × {whole[1]:.0f} pixels; "
            f"a region can be enlarged until a side of all has {MAX_CANVAS}"
        )
    columns, rows = (max(round(side), 1) for side in whole)
    left, across = _pixels(x, wide, columns, plan.width, factor)
    top, down = _pixels(y, tall, rows, plan.height, factor)
    return View(columns, rows, left, top, across, down)


def _pixels(start: float, length: float, count: int, side: float, factor: float) -> tuple[int, int]:
    """First pixel, and number of pixels, of a stretch of a side that has `count` pixels in all."""
    wanted = min(max(round(length * factor), 1), count)
    return min(max(round(start * count / side), 0), count - wanted), wanted


def _factor(plan: StrokePlan, wide: float, tall: float, **sizes: float | None) -> float:
    """Pixels per unit, from the one size that is given; else 1, or 300 dots an inch of a pen drawing."""
    given = {name: value for name, value in sizes.items() if value is not None}
    if len(given) > 1:
        raise InputError(f"give one of width, height and scale, not {' and '.join(given)}")
    for name, value in given.items():
        if not (isfinite(value) and value > 0):
            raise InputError(f"{name} {value:g} is no size; give more than 0")
        return value / {"width": wide, "height": tall, "scale": 1.0}[name]
    unit = unit_mm(plan)
    return 1.0 if unit is None else unit * DOTS_A_MM


def check_sides(columns: float, rows: float) -> None:
    """Raise InputError for a picture of more pixels than any format or printer takes."""
    if max(columns, rows) >= MAX_SIDE + 0.5:
        raise InputError(f"a picture of {columns:.0f} × {rows:.0f} pixels is too large; a side may have {MAX_SIDE}")


def _inside(plan: StrokePlan, region: Region) -> Region:
    """The part of a region that lies on the canvas."""
    if len(region) != 4 or not all(isfinite(value) for value in region) or min(region[2:]) <= 0:
        raise InputError(f"region {_listed(region)} is none; give x, y and a width and height above 0")
    x, y, wide, tall = region
    left, top, right, bottom = max(x, 0.0), max(y, 0.0), min(x + wide, plan.width), min(y + tall, plan.height)
    if left >= right or top >= bottom:
        raise InputError(f"region {_listed(region)} lies outside the canvas, which is {plan.width:g} × {plan.height:g}")
    return left, top, right - left, bottom - top


def _listed(values: Sequence[float]) -> str:
    return ",".join(f"{value:g}" for value in values)


def parse_region(text: str, plan: StrokePlan) -> Region:
    """ "10,20,300,200" in units of the canvas, or with % in parts of its sides: "25%,25%,50%,50%"."""
    parts = text.split(",")
    sides = plan.width, plan.height, plan.width, plan.height
    try:
        x, y, wide, tall = (
            float(part.strip().removesuffix("%")) * (side / 100 if part.strip().endswith("%") else 1.0)
            for part, side in zip(parts, sides, strict=True)
        )
    except ValueError:
        raise InputError(f"region {text!r} is not X,Y,WIDTH,HEIGHT; try 25%,25%,50%,50%") from None
    return x, y, wide, tall


def parse_side(text: str, dpi: float | None, name: str = "width") -> int:
    """Pixels of a side given as "4000", or as a length on paper, "297mm", "29.7cm", "11.7in", printed at `dpi`."""
    match = re.fullmatch(r"\s*([-+]?[0-9]*\.?[0-9]+(?:e[0-9]+)?)\s*(px|mm|cm|in)?\s*", text, re.IGNORECASE)
    if match is None:
        raise InputError(f"{name} {text!r} is no size; try 4000, or 297mm with a dpi")
    number, unit = float(match[1]), (match[2] or "px").lower()
    if not (isfinite(number) and number > 0):
        raise InputError(f"{name} {text} is no size; give more than 0")
    if unit == "px":
        if number != round(number):
            raise InputError(f"{name} {text} is no whole number of pixels; try {max(round(number), 1)}")
        return round(number)
    if dpi is None:
        raise InputError(f"{name} {text} is a length on paper; say how fine it is printed, e.g. with a dpi of 300")
    return max(round(number * MM[unit] / 25.4 * dpi), 1)


def check_dpi(dpi: float) -> None:
    """Raise InputError for a resolution that no printer has."""
    if not 1 <= dpi <= 100_000:
        raise InputError(f"dpi {dpi:g} is no resolution; give 1 to 100000, usually 300")


def parse_layers(text: str) -> list[str]:
    """ "1,3-5,detail" → its parts."""
    return [part.strip() for part in text.split(",")]


def chosen_strokes(plan: StrokePlan, layers: Sequence[str | int] | None) -> NDArray[np.int64]:
    """Indices, in painting order, of the strokes in some layers: names, numbers from 1, or ranges like "2-4"."""
    if layers is None:
        return np.arange(len(plan))
    wanted = {number for layer in layers for number in _numbers(plan, layer)}
    spans = [np.arange(layer.first, layer.last) for k, layer in enumerate(plan.layers, 1) if k in wanted]
    return np.concatenate(spans) if spans else np.arange(0)


def _numbers(plan: StrokePlan, layer: str | int) -> list[int]:
    """The layers, counted from 1, that a name, a number or a range means; a name goes first."""
    count = len(plan.layers)
    named = [k for k, one in enumerate(plan.layers, 1) if one.name == str(layer)]
    if named and isinstance(layer, str):
        return named
    match = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", str(layer))
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
    if not 1 <= first <= last <= count:
        known = ", ".join(dict.fromkeys(one.name for one in plan.layers))
        raise InputError(f"no layer {str(layer)!r} in the plan; it has {count}: {known}; give names, or 1-{count}")
    return list(range(first, last + 1))
