"""SVG: one named group per layer, every stroke an editable path (docs/svg.md is the contract).

svgwrite builds the document (root, background, title, metadata, the layer groups, which are Inkscape
layers too); the lines of the paths, by far the most of it, are streamed into the empty groups. Path
data are relative cubics of numbers rounded on the absolute grid, so that nothing adds up. SVG has no
strokes of varying width: one with pressure is written as its outline, filled, and carries its own curve,
width and pressure in attributes of the namespace urn:strokeplan.
"""

from __future__ import annotations

import gzip
import io
import os
import re
import zlib
from collections.abc import Iterator
from itertools import islice
from math import ceil, log10
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Comment, Element
from xml.sax.saxutils import quoteattr

import msgspec
import numpy as np
import svgwrite
from numpy.typing import NDArray

from strokeplan.errors import FormatError
from strokeplan.formats.json import VERSION, hex_colors, paused_gc
from strokeplan.formats.layout import Layout, lay_out
from strokeplan.formats.options import DEFAULTS, ExportOptions
from strokeplan.formats.svg_moved import anchors
from strokeplan.grouping import regroup
from strokeplan.pens import transparent_layers
from strokeplan.strokes import Layer, StrokePlan, rgb_to_hex

INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"
NAMESPACE = "urn:strokeplan"
DECIMALS = {False: 2, True: 3}
"""Coordinates are written to 1/100 of a pixel of the photo, which is what the planner gives, or 1/1000 of a mm …"""
DIGITS = 5
"""… and in a small document to more: this many digits for its longer side."""
OUTLINE_STEPS = 10
"""An outline is written to within this many steps of that grid."""
ALONG_DECIMALS = 4
"""Of pressures and of angles in radians, one per on-curve point."""
LARGEST_STEP = 2.0**53
"""Beyond this many steps of the grid, far outside of any document, coordinates are cut."""
MAX_HEAD_BYTES = 1 << 20
"""The settings stand within this much of the document's beginning; those of 32 layers have 30 kB."""
_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def encode(plan: StrokePlan, options: ExportOptions = DEFAULTS) -> bytes:
    """The SVG document of a plan, UTF-8; the same plan and options give the same bytes. Raises InputError."""
    layout = lay_out(regroup(plan, options.group_by), options)
    drawing = _document(layout, options)
    # Groups are still empty: their paths go where they close.
    text = io.StringIO()
    drawing.write(text)
    head, *tails = text.getvalue().split(_MARK)
    parts = [head.encode()]
    with paused_gc():
        for lines, tail in zip(_path_lines(layout, options), tails, strict=True):
            parts += [lines, tail.encode()]
    return b"".join(parts)


_MARK = "<!--strokes-->"


class _Mark(svgwrite.base.BaseElement):  # type: ignore[misc]
    """Where the paths of a layer will stand."""

    elementname = "mark"

    def get_xml(self) -> Any:
        return Comment("strokes")


def read_settings(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The settings in the head of an SVG that `encode` wrote; nothing after them is read. Raises FormatError."""
    opener = gzip.open if Path(path).name.lower().endswith("z") else open
    try:
        with opener(path, "rb") as stream:
            head = stream.read(MAX_HEAD_BYTES)
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    parser: Any = ElementTree.XMLPullParser(["end"])
    try:
        parser.feed(head)  # what is cut off, or stands after the metadata, does not matter
        for _, element in parser.read_events():
            if element.tag == f"{{{NAMESPACE}}}settings":
                settings: dict[str, Any] = msgspec.json.decode(element.text or "", type=dict[str, Any])
                return settings
    except ElementTree.ParseError as error:
        raise FormatError(f"{path}: is not XML ({error})") from None
    except (msgspec.DecodeError, RecursionError) as error:
        raise FormatError(f"{path}: its settings cannot be read ({error})") from None
    raise FormatError(f"{path}: holds no settings of strokeplan")


# The document around the paths


def _document(layout: Layout, options: ExportOptions) -> svgwrite.Drawing:
    """Everything but the paths."""
    plan, unit = layout.plan, "mm" if layout.mm else ""
    width, height = _number(layout.width), _number(layout.height)
    drawing = svgwrite.Drawing(size=(width + unit, height + unit), debug=False, viewBox=f"0 0 {width} {height}")
    drawing.attribs.update({"xmlns:inkscape": INKSCAPE, "xmlns:strokeplan": NAMESPACE})
    drawing.attribs["strokeplan:version"] = str(VERSION)
    title = plan.source.name if plan.source else ""
    drawing.set_desc(title=_text(title) or "strokeplan", desc=f"{len(plan)} strokes, planned by strokeplan")
    for element in _metadata(plan):
        drawing.set_metadata(element)
    x, y, *size = ("0", "0", "100%", "100%") if options.page is None else map(_number, layout.canvas)
    # Used rather than drawn: plotting programs (vpype read, for one) would take a rectangle for a line to draw.
    drawing.defs.add(drawing.rect((x, y), size, id="sheet"))
    drawing.add(drawing.use("#sheet", id="background", fill=rgb_to_hex(plan.background)))
    if options.clip:
        drawing.defs.add(drawing.clipPath(id="canvas")).add(drawing.rect((x, y), size))
    if options.classes:
        drawing.defs.add(drawing.style(_rules(plan, options)))
    kinds = zip(plan.layers, transparent_layers(plan), strict=True)
    for number, (layer, filters) in enumerate(kinds, start=1):
        drawing.add(_group(layout, layer, number, options, filters))
    return drawing


def _metadata(plan: StrokePlan) -> Iterator[Element]:
    """What reproduces the plan, and the photo that it was made from."""
    settings = Element("strokeplan:settings", {"xmlns:strokeplan": NAMESPACE})
    # What XML has no place for is written as JSON escapes it, so that nothing is lost.
    settings.text = _NOT_XML.sub(lambda bad: f"\\u{ord(bad[0]):04x}", msgspec.json.encode(plan.settings).decode())
    yield settings
    if plan.source is not None:
        name, sha256 = _text(plan.source.name), _text(plan.source.sha256)
        size = {"width": str(plan.source.width), "height": str(plan.source.height)}
        yield Element("strokeplan:source", {"name": name, "sha256": sha256, **size})


class _LayerGroup(svgwrite.container.Group):  # type: ignore[misc]
    """A layer of Inkscape's; svgwrite would leave out a name without letters."""

    name = ""

    def get_xml(self) -> Any:
        xml = super().get_xml()
        xml.set("inkscape:groupmode", "layer")
        xml.set("inkscape:label", self.name)
        xml.set("strokeplan:name", self.name)  # kept where the label is not, in Inkscape's plain SVG
        return xml


def _group(layout: Layout, layer: Layer, number: int, options: ExportOptions, filters: bool) -> _LayerGroup:
    widths = np.unique(layout.widths[layer.first : layer.last])
    ends = {"stroke_linecap": layer.cap, "stroke_linejoin": "round"}
    group = _LayerGroup(id=f"layer{number}", fill="none", debug=False, **ends)
    group.name = _text(layer.name)
    if len(widths) == 1:
        group["stroke-width"] = _number(widths[0])
    if options.clip:
        group["clip-path"] = "url(#canvas)"
    group.attribs["inkscape:groupmode"] = "layer"
    group.attribs["inkscape:label"] = _text(layer.name)
    group.attribs["strokeplan:medium"] = layer.medium
    if filters:
        group.attribs["style"] = "mix-blend-mode:multiply"
    group.add(_Mark())
    return group


def _classes(plan: StrokePlan) -> tuple[list[str], NDArray[np.int64]]:
    """The colours of a plan, in the order in which they first appear, and the place of each stroke's among them."""
    packed = plan.colors.astype(np.int64) @ (1 << 16, 1 << 8, 1)
    _, first, inverse = np.unique(packed, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return hex_colors(plan.colors[first[order]]), np.argsort(order)[inverse]


def _rules(plan: StrokePlan, options: ExportOptions) -> str:
    """A class c… for the strokes of each colour, and a class f… for its outlines, if there may be any."""
    stroked = "" if options.outline else ".c{0}{{stroke:{1}}}"
    filled = ".f{0}{{fill:{1};stroke:none}}" if options.outline or plan.has_pressure.any() else ""
    return "".join(f"\n{stroked}{filled}".format(*rule) for rule in enumerate(_classes(plan)[0]))


# The paths


def _path_lines(layout: Layout, options: ExportOptions) -> Iterator[bytes]:
    """The path elements of each layer."""
    plan = layout.plan
    finest = 10 ** max(DECIMALS[layout.mm], DIGITS - ceil(log10(max(layout.width, layout.height))))
    unit = finest if options.precision is None else 10**options.precision
    points, starts, filled = layout.outlined(OUTLINE_STEPS / max(finest, unit), every=options.outline)
    lines = [
        b'<path %b d="%b%b"/>' % (paint, data, b"z" if closed else b"")
        for paint, data, closed in zip(
            _paints(plan, filled, options), _path_data(points, starts, unit), filled.tolist(), strict=True
        )
    ]
    places = _places(points, starts, unit) if filled.any() else []
    for i, attributes in _own_attributes(layout, filled, unit, places):
        lines[i] = lines[i][:-2] + attributes + b"/>"
    for layer in plan.layers:
        own, widths = lines[layer.first : layer.last], layout.widths[layer.first : layer.last]
        if len(np.unique(widths)) > 1:
            own = [
                line if closed else line.replace(b" d=", b' stroke-width="%b" d=' % _number(width).encode(), 1)
                for line, width, closed in zip(own, widths.tolist(), filled[layer.first : layer.last], strict=True)
            ]
        yield b"\n" + b"\n".join(own) + b"\n" if own else b""


def _paints(plan: StrokePlan, filled: NDArray[np.bool_], options: ExportOptions) -> list[bytes]:
    """The attributes that give each stroke its colour."""
    if options.classes:
        kinds = [b"f" if closed else b"c" for closed in filled.tolist()]
        return [b'class="%b%d"' % pair for pair in zip(kinds, _classes(plan)[1].tolist(), strict=True)]
    kinds = [b'fill="%b" stroke="none"' if closed else b'stroke="%b"' for closed in filled.tolist()]
    return [kind % color.encode() for kind, color in zip(kinds, hex_colors(plan.colors), strict=True)]


def _path_data(points: NDArray[np.float64], starts: NDArray[np.int64], unit: int) -> list[bytes]:
    """Each chain as one M and one relative c, of multiples of 1 / unit in their shortest text."""
    grid = np.rint(np.clip(points * unit, -LARGEST_STEP, LARGEST_STEP)).astype(np.int64)
    relative = grid.copy()
    # Every piece counts from its own start: rows 3k of a stroke, repeated for the three rows that follow.
    within = np.arange(len(grid)) - np.repeat(starts[:-1], np.diff(starts))
    origin = np.arange(len(grid)) - np.where(within == 0, 0, (within - 1) % 3 + 1)
    later = within > 0
    relative[later] -= grid[origin[later]]
    # One call turns all numbers into text; a list of floats is the fastest there is.
    text = b"," + msgspec.json.encode((relative.ravel() / unit).tolist())[1:-1] + b","
    numbers = text.replace(b".0,", b",").replace(b",0.", b",.").replace(b"-0.", b"-.").split(b",")[1:-1]
    ends = (2 * starts).tolist()
    paths = [
        b"M%b %bc%b" % (numbers[a], numbers[a + 1], b" ".join(numbers[a + 2 : b]))
        for a, b in zip(ends, islice(ends, 1, None), strict=False)
    ]
    return b"\n".join(paths).replace(b" -", b"-").split(b"\n") if paths else []


def _own_attributes(
    layout: Layout, filled: NDArray[np.bool_], unit: int, places: list[bytes]
) -> Iterator[tuple[int, bytes]]:
    """What SVG cannot say of a stroke, for those that have it: of an outline the curve, its width and where it was;
    pressure, angle, pen."""
    plan = layout.plan
    angled = np.zeros(len(plan), np.bool_)
    if plan.angles is not None:
        angled = ~np.isnan(plan.angles[plan.first_knots[:-1]])
    named = np.array([pen is not None for pen in plan.pens], np.bool_) if plan.pens is not None else angled
    curves = iter(_path_data(*_chosen(layout, filled), unit))
    knots = plan.first_knots.tolist()
    for i in np.flatnonzero(filled | angled | named).tolist():
        text = b""
        if filled[i]:
            width = _number(layout.widths[i]).encode()
            text += b' strokeplan:d="%b" strokeplan:width="%b" strokeplan:at="%b"' % (next(curves), width, places[i])
        if plan.pressures is not None and plan.has_pressure[i]:
            text += b' strokeplan:pressure="%b"' % _along(plan.pressures[knots[i] : knots[i + 1]])
        if plan.angles is not None and angled[i]:
            text += b' strokeplan:angle="%b"' % _along(plan.angles[knots[i] : knots[i + 1]])
        if plan.pens is not None and (pen := plan.pens[i]) is not None:
            text += f" strokeplan:pen={quoteattr(_text(pen))}".encode()
        yield i, text


def _places(points: NDArray[np.float64], starts: NDArray[np.int64], unit: int) -> list[bytes]:
    """By what the reader finds out where an outline was moved."""
    marks, pieces = anchors(np.rint(np.clip(points * unit, -LARGEST_STEP, LARGEST_STEP)) / unit, starts)
    return [
        f"{count} {' '.join(map(_number, row))}".encode()
        for count, row in zip(pieces.tolist(), marks.reshape(-1, 8).tolist(), strict=True)
    ]


def _chosen(layout: Layout, chosen: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and starts of some of the strokes."""
    counts = layout.plan.counts
    return layout.points[np.repeat(chosen, counts)], np.concatenate([[0], np.cumsum(counts[chosen])])


def _along(values: NDArray[np.float64]) -> bytes:
    """Values along a stroke, none of them rounded up: an angle stays below π."""
    scale = 10**ALONG_DECIMALS
    return " ".join(f"{value:g}" for value in (np.floor(values * scale + 1e-9) / scale).tolist()).encode()


def _number(value: float) -> str:
    """Shortest text of at most nine digits."""
    return f"{value:.9g}"


def _text(text: str) -> str:
    """`text` with U+FFFD for characters that XML has no place for."""
    return _NOT_XML.sub("\ufffd", text)
