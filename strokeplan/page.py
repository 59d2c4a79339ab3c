"""A sheet of paper in millimetres, and where a picture lies on it: as large as the margin allows, centred.

Paper space is x right, y down, the origin at the sheet's upper left corner.
"""

from __future__ import annotations

import re
import reprlib
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError

MM_PER_INCH = 25.4
PX_PER_INCH = 96.0
"""The CSS pixel, in which a drawing without a page is measured."""
SIZES_MM = {
    "a0": (841.0, 1189.0),
    "a1": (594.0, 841.0),
    "a2": (420.0, 594.0),
    "a3": (297.0, 420.0),
    "a4": (210.0, 297.0),
    "a5": (148.0, 210.0),
    "a6": (105.0, 148.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
"""ISO 216 and ANSI/ASME Y14.1, upright."""
UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": MM_PER_INCH, "m": 1000.0}
MIN_SIDE_MM, MAX_SIDE_MM = 1.0, 10_000.0
MIN_PICTURE_MM = 1e-3
"""A picture with a side thinner than this on its page is a mistake, and more than a file's digits can hold."""
_NUMBER = r"(\d+\.?\d*|\.\d+)"
_UNIT = r"\s*(mm|cm|in|m)"


class Placement(NamedTuple):
    """From the unit of a plan to that of a page: p ↦ scale · p + (x, y)."""

    scale: float = 1.0
    x: float = 0.0
    y: float = 0.0

    def points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) points of the plan, as (n, 2) points of the page."""
        return points if self == Placement() else points * self.scale + (self.x, self.y)


@dataclass(frozen=True, slots=True)
class Page:
    """A sheet of `width_mm` × `height_mm`, of which a border of `margin_mm` stays bare. Raises InputError."""

    width_mm: float
    height_mm: float
    margin_mm: float = 0.0

    def __post_init__(self) -> None:
        size = f"{self.width_mm:g} × {self.height_mm:g} mm"
        if not all(MIN_SIDE_MM <= side <= MAX_SIDE_MM for side in (self.width_mm, self.height_mm)):
            raise InputError(f"a page of {size} is none; a side has {MIN_SIDE_MM:g} to {MAX_SIDE_MM:g} mm")
        if not (isfinite(self.margin_mm) and self.margin_mm >= 0):
            raise InputError(f"margin {self.margin_mm:g} mm is none; give 0 or more")
        if 2 * self.margin_mm > min(self.width_mm, self.height_mm) - MIN_SIDE_MM:
            raise InputError(f"margin {self.margin_mm:g} mm leaves nothing of a page of {size}")

    def fit(self, width: float, height: float) -> Placement:
        """Where a picture of that size lies: as large as fits within the margin, in the middle. Raises InputError."""
        room = self.width_mm - 2 * self.margin_mm, self.height_mm - 2 * self.margin_mm
        scale = min(room[0] / width, room[1] / height)
        if min(width, height) * scale < MIN_PICTURE_MM:
            raise InputError(
                f"a picture of {width:g} × {height:g} would be {width * scale:.3g} × {height * scale:.3g} mm on a page "
                f"of {self.width_mm:g} × {self.height_mm:g} mm: too thin"
            )
        return Placement(scale, (self.width_mm - width * scale) / 2, (self.height_mm - height * scale) / 2)


def parse_page(text: str | None, margin: str | None = None, *, landscape: bool = False) -> Page | None:
    """A page as the command line gives it: a name (A4, letter) or "200x300mm", and a margin ("10", "1cm").

    Its longer side is across if asked. None without a page. Raises InputError.
    """
    if text is None:
        if margin is not None or landscape:
            raise InputError(f"{'landscape' if margin is None else 'margin'} needs a page; give one, e.g. --page A4")
        return None
    width, height = _size(text)
    if landscape:
        width, height = max(width, height), min(width, height)
    return Page(width, height, 0.0 if margin is None else parse_length(margin, "margin"))


def parse_length(text: str, what: str) -> float:
    """ "10", "10mm", "1cm" or "0.5in" in millimetres; `what` names it in the InputError."""
    found = re.fullmatch(rf"{_NUMBER}(?:{_UNIT})?", text.strip().lower())
    if not found:
        raise InputError(f"{what} {reprlib.repr(text)} is no length; give millimetres, or a number with mm, cm or in")
    return float(found[1]) * UNITS_MM[found[2] or "mm"]


def _size(text: str) -> tuple[float, float]:
    """Width and height in millimetres of a page by its name or size."""
    name = text.strip().lower()
    if name in SIZES_MM:
        return SIZES_MM[name]
    found = re.fullmatch(rf"{_NUMBER}\s*[x×]\s*{_NUMBER}{_UNIT}", name)
    if not found:
        known = ", ".join(known.upper() if len(known) == 2 else known for known in SIZES_MM)
        raise InputError(f"page {reprlib.repr(text)} is unknown; known are {known}, or give a size like 200x300mm")
    unit = UNITS_MM[found[3]]
    return float(found[1]) * unit, float(found[2]) * unit
