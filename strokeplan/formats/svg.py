"""SVG: one named layer group per planner layer, every stroke an editable path.

svgwrite builds the document (root, background, title, metadata, the layer groups, which are Inkscape
layers too); the lines of the paths, by far the most of it, are streamed into the empty groups. Path
data are relative cubics of numbers rounded on the absolute grid, so that nothing adds up. SVG has no
strokes of varying width: one with pressure is written as its outline, filled.
"""

from __future__ import annotations

import io
import re
from itertools import islice
from math import ceil, log10
from typing import Any
from xml.etree.ElementTree import Comment, Element

import msgspec
import numpy as np
import svgwrite
from numpy.typing import NDArray

from strokeplan.formats.json import hex_colors, paused_gc
from strokeplan.outlines import outline_curves
from strokeplan.strokes import Layer, StrokePlan, rgb_to_hex

INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
NAMESPACE = "urn:strokeplan"
DECIMALS = 2
"""Coordinates are written to 1/100 of a pixel of the photo, which is what the planner gives …"""
DIGITS = 5
"""… and on a small canvas to more: this many digits for its longer side."""
OUTLINE_STEPS = 10
"""The outline of a stroke with pressure is written to within this many steps of that grid."""
_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def encode(plan: StrokePlan) -> bytes:
    """The SVG document of a plan, UTF-8; the same plan gives the same bytes."""
    width, height = _number(plan.width), _number(plan.height)
    drawing = svgwrite.Drawing(size=(width, height), debug=False, viewBox=f"0 0 {width} {height}")
    drawing.attribs["xmlns:inkscape"] = INKSCAPE
    source = plan.source.name if plan.source else ""
    drawing.set_desc(title=_text(source) or "strokeplan", desc=f"{len(plan)} strokes, planned by strokeplan")
    settings = Element("strokeplan:settings", {"xmlns:strokeplan": NAMESPACE})
    # What XML has no place for is written as JSON escapes it, so that nothing is lost.
    settings.text = _NOT_XML.sub(lambda bad: f"\\u{ord(bad[0]):04x}", msgspec.json.encode(plan.settings).decode())
    drawing.set_metadata(settings)
    drawing.add(drawing.rect((0, 0), ("100%", "100%"), id="background", fill=rgb_to_hex(plan.background)))
    for number, layer in enumerate(plan.layers, start=1):
        drawing.add(_group(drawing, plan, layer, number))
    # Groups are still empty: their paths go where they close.
    text = io.StringIO()
    drawing.write(text)
    head, *tails = text.getvalue().split(_MARK)
    parts = [head.encode()]
    with paused_gc():
        for lines, tail in zip(_path_lines(plan), tails, strict=True):
            parts += [lines, tail.encode()]
    return b"".join(parts)


_MARK = "<!--strokes-->"


class _Mark(svgwrite.base.BaseElement):  # type: ignore[misc]
    """Where the paths of a layer will stand."""

    elementname = "mark"

    def get_xml(self) -> Any:
        return Comment("strokes")


def _group(drawing: svgwrite.Drawing, plan: StrokePlan, layer: Layer, number: int) -> svgwrite.container.Group:
    widths = np.unique(plan.widths[layer.first : layer.last])
    group = drawing.g(id=f"layer{number}", fill="none", stroke_linecap=layer.cap, stroke_linejoin="round")
    if len(widths) == 1:
        group["stroke-width"] = _number(widths[0])
    group.attribs["inkscape:groupmode"] = "layer"
    group.attribs["inkscape:label"] = _text(layer.name)
    group.add(_Mark())
    return group


def _path_lines(plan: StrokePlan) -> list[bytes]:
    """The path elements of each layer."""
    unit = 10 ** max(DECIMALS, DIGITS - ceil(log10(max(plan.width, plan.height))))
    points, starts = _with_outlines(plan, OUTLINE_STEPS / unit)
    grid = np.rint(points * unit).astype(np.int64)
    relative = grid.copy()
    # Every piece counts from its own start: rows 3k of a stroke, repeated for the three rows that follow.
    within = np.arange(len(grid)) - np.repeat(starts[:-1], np.diff(starts))
    origin = np.arange(len(grid)) - np.where(within == 0, 0, (within - 1) % 3 + 1)
    later = within > 0
    relative[later] -= grid[origin[later]]
    # One call turns all numbers into their shortest text; a list of floats is the fastest there is.
    numbers = msgspec.json.encode((relative.ravel() / unit).tolist())[1:-1].replace(b".0,", b",").split(b",")
    if numbers[-1].endswith(b".0"):
        numbers[-1] = numbers[-1][:-2]
    ends = (2 * starts).tolist()
    colors = [color.encode() for color in hex_colors(plan.colors)]
    kinds = [(b'fill="%b" stroke="none"', b"z") if filled else (b'stroke="%b"', b"") for filled in plan.has_pressure]
    lines = [
        b'<path %b d="M%b %bc%b%b"/>' % (kind % color, numbers[a], numbers[a + 1], b" ".join(numbers[a + 2 : b]), close)
        for a, b, color, (kind, close) in zip(ends, islice(ends, 1, None), colors, kinds, strict=False)
    ]
    layers = []
    for layer in plan.layers:
        own = lines[layer.first : layer.last]
        widths = plan.widths[layer.first : layer.last]
        if len(np.unique(widths)) > 1:
            own = [
                line if filled else line.replace(b" d=", b' stroke-width="%b" d=' % _number(width).encode(), 1)
                for line, width, filled in zip(
                    own, widths.tolist(), plan.has_pressure[layer.first : layer.last], strict=True
                )
            ]
        layers.append(b"\n" + b"\n".join(own) + b"\n" if own else b"")
    return layers


def _with_outlines(plan: StrokePlan, tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and starts of a plan, with the outline in the place of every stroke with pressure."""
    if not plan.has_pressure.any():
        return plan.points, plan.starts
    chains = list(plan)
    for layer in plan.layers:
        for i in (layer.first + np.flatnonzero(plan.has_pressure[layer.first : layer.last])).tolist():
            curves = outline_curves(chains[i], plan.radii(i), tolerance, round_caps=layer.cap == "round")
            # A stroke without extent keeps its place among the paths, as a path without area.
            chains[i] = curves if len(curves) else np.repeat(chains[i][:1], 4, axis=0)
    return np.concatenate(chains), np.cumsum([0, *(len(chain) for chain in chains)])


def _number(value: float) -> str:
    """Shortest text of at most nine digits."""
    return f"{value:.9g}"


def _text(text: str) -> str:
    """`text` with U+FFFD for characters that XML has no place for."""
    return _NOT_XML.sub("\ufffd", text)
