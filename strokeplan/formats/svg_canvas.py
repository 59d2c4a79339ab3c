"""The canvas of an SVG: which part of its coordinates is shown, and how large that is on paper.

A plan keeps the user units of the root's viewBox (without one, pixels at 96 to the inch), moved so that the canvas
begins at (0, 0). A size in mm, cm, in, pt, pc or Q is kept beside them, as millimetres.

Source: SVG 1.1, sections 7.7 and 7.8.
"""

from __future__ import annotations

from dataclasses import dataclass

from strokeplan.errors import FormatError
from strokeplan.formats.svg_path import numbers
from strokeplan.formats.svg_style import IDENTITY, Matrix, compose, parse_length, unit_mm
from strokeplan.formats.svg_xml import Node
from strokeplan.strokes import MAX_SIZE, MIN_SIZE

SAME_SHAPE = 1e-3
"""A page whose sides are in proportion to the viewBox within this is the viewBox: its size was rounded."""
DEFAULT_SIZE = 300.0, 150.0
"""What percentages refer to where nothing has a size (that of CSS)."""


@dataclass(frozen=True, slots=True)
class Canvas:
    """width, height in the plan's unit (None: not stated); `matrix` from user units to them; `pixel`, the CSS
    pixel in the plan's unit; the page in millimetres, if the file states one."""

    width: float | None
    height: float | None
    matrix: Matrix = IDENTITY
    pixel: float = 1.0
    page_mm: tuple[float, float] | None = None


def read_canvas(root: Node) -> Canvas:
    """The canvas of a root element. Raises FormatError for one that no plan can have."""
    given = [root.attributes.get(side, "") for side in ("width", "height")]
    width, height = (None if "%" in text else parse_length(text, 1.0) for text in given)
    page = [unit_mm(text) for text in given]
    box = view_box(root)
    if box is not None:
        found = _within(box, width, height, root.attributes.get("preserveAspectRatio", ""))
    elif width is None or height is None:
        return Canvas(None, None)
    else:
        found = Canvas(width, height)
    for side in (found.width, found.height):
        if side is None or not MIN_SIZE <= side <= MAX_SIZE:
            size = f"{found.width:g} × {found.height:g}"
            raise FormatError(f"{root}: the canvas, {size}, has a side not in {MIN_SIZE:g}..{MAX_SIZE:g}")
    if page[0] and page[1]:
        return Canvas(found.width, found.height, found.matrix, found.pixel, (page[0], page[1]))
    return found


def _within(box: tuple[float, float, float, float], width: float | None, height: float | None, aspect: str) -> Canvas:
    x, y, w, h = box
    if not width or not height or width < 0 or height < 0 or abs(width * h / (height * w) - 1) < SAME_SHAPE:
        scale = (width / w if width and width > 0 else height / h if height and height > 0 else 1.0) or 1.0
        return Canvas(w, h, (1.0, 0.0, 0.0, 1.0, -x, -y), 1 / scale)
    matrix = view_matrix(box, width, height, aspect)
    pixel = 1 / matrix[0]
    return Canvas(width * pixel, height * pixel, compose((pixel, 0.0, 0.0, pixel, 0.0, 0.0), matrix), pixel)


def view_box(node: Node) -> tuple[float, float, float, float] | None:
    """The viewBox of an element, None without one. Raises FormatError for one without extent."""
    text = node.attributes.get("viewBox")
    if text is None:
        return None
    try:
        x, y, width, height = numbers(text)
    except ValueError:
        raise FormatError(f"{node}: the viewBox {text[:60]!r} is not four numbers") from None
    if not (MIN_SIZE <= width <= MAX_SIZE and MIN_SIZE <= height <= MAX_SIZE):
        size = f"{width:g} × {height:g}"
        raise FormatError(f"{node}: the canvas, {size}, has a side not in {MIN_SIZE:g}..{MAX_SIZE:g}")
    return x, y, width, height


def view_matrix(box: tuple[float, float, float, float], width: float, height: float, aspect: str) -> Matrix:
    """From a viewBox to the rectangle (0, 0, width, height) that shows it, by preserveAspectRatio."""
    x, y, w, h = box
    sx, sy = width / w, height / h
    words = aspect.split() or ["xMidYMid"]
    if words[0] != "none":
        sx = sy = max(sx, sy) if "slice" in words else min(sx, sy)
    places = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
    right, down = places.get(words[0][1:4], 0.5), places.get(words[0][5:8], 0.5)
    return sx, 0.0, 0.0, sy, (width - sx * w) * right - sx * x, (height - sy * h) * down - sy * y
