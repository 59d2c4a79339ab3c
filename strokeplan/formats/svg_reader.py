"""SVG as a plan: our own files, edited or not, and everybody else's (docs/reading-svg.md says how it maps).

One walk over the elements in painting order, with what they inherit; every visible subpath becomes a stroke. What a
plan cannot hold (text, pictures, fills, dashes …) is counted, and told in one warning.

Known limits: no filters, patterns or markers; clips and masks do not cut; a stroke that is not scaled uniformly gets
the mean width, √|det|.
"""

from __future__ import annotations

import os
import warnings
from collections import Counter
from math import sqrt
from typing import NamedTuple

import numpy as np

from strokeplan.errors import FormatError, StrokeplanWarning
from strokeplan.formats.json import paused_gc
from strokeplan.formats.json import read as read_bytes
from strokeplan.formats.svg_canvas import DEFAULT_SIZE, read_canvas, view_box, view_matrix
from strokeplan.formats.svg_columns import Columns, Owner, Stroke, is_layer
from strokeplan.formats.svg_moved import TOLERANCE, moved
from strokeplan.formats.svg_path import is_simple, numbers, shape_data, subpaths
from strokeplan.formats.svg_style import (
    INHERITED,
    Matrix,
    Style,
    Stylesheet,
    compose,
    parse_color,
    parse_length,
    parse_opacity,
    parse_transform,
)
from strokeplan.formats.svg_xml import MAX_BYTES, MAX_DEPTH, Node, parse
from strokeplan.strokes import Cap, StrokePlan

HAIRLINE = 1 / 1000
"""Width of the outline of a filled shape, as a part of the canvas's longer side: 0.3 mm on A4."""
MAX_USED, MAX_USED_DATA = 200_000, 1 << 24
"""Elements, and characters of path data, that uses may show beyond those that the file itself has."""
MAX_STOPS = 1000
"""Stops of a gradient that are looked at."""

_CONTAINERS = {"svg", "g", "a", "switch"}
_LENGTHS = {
    "line": ("x1", "y1", "x2", "y2"),
    "rect": ("x", "y", "width", "height", "rx", "ry"),
    "circle": ("cx", "cy", "r"),
    "ellipse": ("cx", "cy", "rx", "ry"),
    "polyline": (),
    "polygon": (),
}
_DOWNWARDS = {"y", "height", "y1", "y2", "cy", "ry"}
_LOST = {"text": "text", "image": "image", "foreignObject": "foreign object", "video": "video"}


class _State(NamedTuple):
    """What an element inherits."""

    style: Style
    matrix: Matrix
    opacity: float
    size: tuple[float, float]
    owner: Owner


def read(path: str | os.PathLike[str]) -> StrokePlan:
    """The plan in an SVG file (.svg, or .svgz: packed). Raises FormatError."""
    return decode(read_bytes(path, MAX_BYTES), str(path))


def decode(data: bytes, where: str = "SVG") -> StrokePlan:
    """The plan in an SVG document; `where` names it in errors. Raises FormatError with the line of a fault.

    What a plan cannot hold is counted in one StrokeplanWarning.
    """
    try:
        with paused_gc():
            walk = _Walk(parse(data), len(data))
            plan = walk.plan()
    except FormatError as error:
        raise FormatError(f"{where}: {error}") from None
    if walk.lost:
        told = ", ".join(f"{what} ({count:,})" for what, count in walk.lost.items())
        warnings.warn(f"{where}: not all of it is strokes: {told}", StrokeplanWarning, stacklevel=2)
    return plan


class _Walk:
    """Through a document, in painting order."""

    def __init__(self, root: Node, length: int) -> None:
        if root.tag != "svg":
            raise FormatError(f"is no SVG: its root element is <{root.tag[:60]}>")
        self.root = root
        self.canvas = read_canvas(root)
        self.columns = Columns(self.canvas)
        self.ids: dict[str, Node] = {}
        self.elements = 0
        css = []
        for node in root.walk():
            self.elements += 1
            if "id" in node.attributes:
                self.ids.setdefault(node.attributes["id"], node)
            if node.tag == "style":
                css.append(node.text)
        self.sheet = Stylesheet("\n".join(css))
        self.lost: Counter[str] = Counter()
        self.ancestors: list[Node] = []
        self.length = length
        self.visits = self.characters = 0

    def plan(self) -> StrokePlan:
        box = view_box(self.root)
        whole = self.canvas.width or DEFAULT_SIZE[0], self.canvas.height or DEFAULT_SIZE[1]
        size = (box[2], box[3]) if box else whole
        nobody = Owner(None, None, "paint", "round")
        self.children(self.root, _State(dict(INHERITED), self.canvas.matrix, 1.0, size, nobody))
        return self.columns.plan(self.root, HAIRLINE)

    def children(self, node: Node, state: _State) -> None:
        if len(self.ancestors) > MAX_DEPTH:
            raise FormatError(f"{node}: elements are nested more than {MAX_DEPTH} deep")
        entered = self.enter(node, state)
        if entered is None:
            return
        if node.tag == "g":
            entered = self.owned(node, entered)
        self.ancestors.append(node)
        children = node.children
        if node.tag == "switch":
            children = [child for child in children if "requiredExtensions" not in child.attributes][:1]
        for child in children:
            self.visit(child, entered)
        self.ancestors.pop()

    def visit(self, node: Node, state: _State) -> None:
        self.visits += 1
        if self.visits > self.elements + MAX_USED:
            raise FormatError(f"{node}: uses show more than {MAX_USED:,} elements; that is too much for an SVG")
        tag = node.tag
        if tag == "path" or tag in _LENGTHS:
            entered = self.enter(node, state)
            if entered is not None and entered.style["visibility"] == "visible":
                self.shape(node, entered)
        elif tag == "svg":
            self.viewport(node, node, state)
        elif tag in _CONTAINERS:
            self.children(node, state)
        elif tag == "use":
            self.use(node, state)
        elif tag in _LOST and self.enter(node, state) is not None:
            self.lost[f"{_LOST[tag]} left out"] += 1

    def enter(self, node: Node, state: _State) -> _State | None:
        """The state inside an element; None for one that does not show."""
        declared = self.sheet.declared(node, self.ancestors)
        style, matrix, opacity = state.style, state.matrix, state.opacity
        if declared:
            if declared.get("display") == "none":
                return None
            opacity *= parse_opacity(declared["opacity"]) if "opacity" in declared else 1.0
            if opacity == 0:
                return None
            self.count_effects(declared)
            style = {**style, **{name: value for name, value in declared.items() if value != "inherit"}}
        if style.get("vector-effect") and "vector-effect" not in declared:  # not inherited
            style = {**style, "vector-effect": ""}
        if "transform" in node.attributes and node is not self.root:
            try:
                matrix = compose(matrix, parse_transform(node.attributes["transform"]))
            except ValueError as error:
                raise FormatError(f"{node}: {error}") from None
        return _State(style, matrix, opacity, state.size, state.owner)

    def count_effects(self, declared: Style) -> None:
        for name in ("clip-path", "mask", "filter"):
            if declared.get(name, "none") != "none" and not self.clips_nothing(declared[name]):
                self.lost[f"{name} ignored"] += 1

    def clips_nothing(self, reference: str) -> bool:
        """Whether a clip path is a rectangle that holds the whole canvas."""
        clip = self.ids.get(_target(reference) or "")
        if clip is None or clip.tag != "clipPath" or [child.tag for child in clip.children] != ["rect"]:
            return False
        (rect,) = clip.children
        if "transform" in rect.attributes or self.canvas.width is None or self.canvas.height is None:
            return False
        whole = self.canvas.width, self.canvas.height
        x, y, width, height, *_ = self.lengths(rect, whole).values()
        x, y = x + self.canvas.matrix[4], y + self.canvas.matrix[5]
        slack = 1e-6 * max(whole)
        return x <= slack and y <= slack and x + width >= whole[0] - slack and y + height >= whole[1] - slack

    def owned(self, node: Node, state: _State) -> _State:
        """The state in a group that may be a layer: one by its own words, or outermost."""
        if not is_layer(node) and state.owner.node is not None:
            return state
        given = node.attributes
        name = given.get("inkscape:label", given.get("strokeplan:name", given.get("id")))
        medium = node.attributes.get("strokeplan:medium", state.owner.medium)
        cap: Cap = "butt" if state.style["stroke-linecap"] == "butt" else "round"
        owner = Owner(node, name, "ink" if medium == "ink" else "paint", cap)
        if is_layer(node):
            self.columns.open(owner)
        return state._replace(owner=owner)

    # What is drawn elsewhere

    def use(self, node: Node, state: _State) -> None:
        reference = node.attributes.get("href", node.attributes.get("xlink:href", ""))
        target = self.ids.get(reference.removeprefix("#")) if reference.startswith("#") else None
        entered = self.enter(node, state)
        if entered is None:
            return
        if target is None:
            self.lost["use of what is not in the file"] += 1
            return
        if target in self.ancestors or target is node:
            raise FormatError(f"{node}: uses {reference[:60]!r}, in which it stands itself")
        x, y = _place(node, state)
        entered = entered._replace(matrix=compose(entered.matrix, (1.0, 0.0, 0.0, 1.0, x, y)))
        self.ancestors.append(node)
        if target.tag in ("symbol", "svg"):
            self.viewport(target, node, entered)
        else:
            self.visit(target, entered)
        self.ancestors.pop()

    def viewport(self, node: Node, sized: Node, state: _State) -> None:
        """An inner <svg>, or a <symbol> as large as its use says."""
        given = {**node.attributes, **{k: v for k, v in sized.attributes.items() if k in ("width", "height")}}
        width, height = (
            parse_length(given.get(side, "100%"), whole) or 0.0
            for side, whole in zip(("width", "height"), state.size, strict=True)
        )
        x, y = _place(node, state) if node.tag == "svg" else (0.0, 0.0)
        if width <= 0 or height <= 0:
            return
        matrix, size = compose(state.matrix, (1.0, 0.0, 0.0, 1.0, x, y)), (width, height)
        if (box := view_box(node)) is not None:
            aspect = node.attributes.get("preserveAspectRatio", "")
            matrix, size = compose(matrix, view_matrix(box, width, height, aspect)), (box[2], box[3])
        self.children(node, state._replace(matrix=matrix, size=size))

    # Strokes

    def shape(self, node: Node, state: _State) -> None:
        if "strokeplan:d" in node.attributes:
            self.brushed(node, state)
            return
        style = state.style
        line, fill = self.paint(state, "stroke"), self.paint(state, "fill") if node.tag != "line" else None
        width = self.stroke_width(state) if line else 0.0
        if line is None or not width > 0:
            if fill is None or self.is_background(node, state, fill):
                return
            self.lost["filled shape kept as its outline"] += 1
            line, width = fill, 0.0
        else:
            if fill is not None:
                self.lost["fill left out"] += 1
            if style["stroke-dasharray"] not in ("none", "0"):
                self.lost["dashed line drawn through"] += 1
        stroke = Stroke(node, line, width, node.attributes.get("strokeplan:pen"), style["stroke-linecap"] != "butt")
        self.plain(node, state, stroke)

    def plain(self, node: Node, state: _State, stroke: Stroke) -> None:
        data = self.path_data(node, state)
        if "strokeplan:angle" in node.attributes and len(chains := self.chains(node, data)) == 1:
            self.columns.add(chains[0], state.matrix, state.owner, stroke, self.along(node))
            return
        if is_simple(data):
            self.count(node, data)
            self.columns.add_simple(data, state.matrix, state.owner, stroke)
            return
        for chain in self.chains(node, data):
            self.columns.add(chain, state.matrix, state.owner, stroke)

    def brushed(self, node: Node, state: _State) -> None:
        """A stroke of ours that stands as its outline."""
        given = node.attributes
        chains = self.chains(node, given["strokeplan:d"])
        color = self.paint(state, "fill") or self.paint(state, "stroke")
        if color is None:
            return
        along = self.along(node)
        if len(along["width"]) != 1:
            raise FormatError(f"{node}: strokeplan:width is {given.get('strokeplan:width', '')[:60]!r}, not one number")
        if len(chains) != 1:
            raise FormatError(f"{node}: strokeplan:d has {len(chains)} subpaths; a stroke has one")
        matrix = self.moved(node, state)
        if matrix is None:
            self.lost["brush stroke of another shape kept as its outline"] += 1
            for chain in self.chains(node, given.get("d", "")):
                outline = Stroke(node, color, 0.0, given.get("strokeplan:pen"), True)
                self.columns.add(chain, state.matrix, state.owner, outline)
            return
        width = along.pop("width")[0] * _scale(matrix)
        stroke = Stroke(node, color, width, given.get("strokeplan:pen"), state.style["stroke-linecap"] != "butt")
        self.columns.add(chains[0], matrix, state.owner, stroke, along)

    def along(self, node: Node) -> dict[str, list[float]]:
        """What our attributes say in numbers."""
        names = ("width", "pressure", "angle") if "strokeplan:d" in node.attributes else ("angle",)
        try:
            return {name: numbers(node.attributes.get(f"strokeplan:{name}", "")) for name in names}
        except ValueError as error:
            raise FormatError(f"{node}: width, pressure and angle of strokeplan are numbers ({error})") from None

    def moved(self, node: Node, state: _State) -> Matrix | None:
        """The transform of a stroke of ours, with what was done to its outline; None if that is another one now."""
        if "strokeplan:at" not in node.attributes:
            return state.matrix
        try:
            at = numbers(node.attributes["strokeplan:at"])
        except ValueError as error:
            raise FormatError(f"{node}: strokeplan:at ({error})") from None
        longer = max(self.canvas.width or 0.0, self.canvas.height or 0.0)
        tolerance = TOLERANCE * longer / (_scale(state.matrix) or 1.0)
        with np.errstate(over="ignore", invalid="ignore"):  # numbers out of all bounds are refused afterwards
            found = moved(at, self.chains(node, node.attributes.get("d", "")), tolerance)
        return None if found is None else compose(state.matrix, found)

    def count(self, node: Node, data: str) -> None:
        self.characters += len(data)
        if self.characters > self.length + MAX_USED_DATA:
            raise FormatError(
                f"{node}: uses show more than {MAX_USED_DATA >> 20} MB of paths; that is too much for an SVG"
            )

    def chains(self, node: Node, data: str) -> list[list[float]]:
        self.count(node, data)
        try:
            return subpaths(data)
        except ValueError as error:
            raise FormatError(f"{node}: {error}") from None

    def path_data(self, node: Node, state: _State) -> str:
        if node.tag == "path":
            return node.attributes.get("d", "")
        try:
            return shape_data(node.tag, self.lengths(node, state.size), node.attributes.get("points", ""))
        except ValueError as error:
            raise FormatError(f"{node}: {error}") from None

    def lengths(self, node: Node, size: tuple[float, float]) -> dict[str, float]:
        """The lengths of a basic shape in user units; −1 for a radius that is not given."""
        found = {}
        for name in _LENGTHS[node.tag]:
            whole = _diagonal(size) if name == "r" else size[name in _DOWNWARDS]
            missing = -1.0 if name in ("rx", "ry") else 0.0
            value = parse_length(node.attributes.get(name, ""), whole)
            found[name] = missing if value is None else value
        if node.tag == "ellipse":  # one radius alone goes both ways
            rx, ry = found["rx"], found["ry"]
            found["rx"], found["ry"] = ry if rx < 0 else rx, rx if ry < 0 else ry
        return found

    def stroke_width(self, state: _State) -> float:
        """In the plan's unit; 0 for none."""
        width = parse_length(state.style["stroke-width"], _diagonal(state.size))
        fixed = state.style.get("vector-effect") == "non-scaling-stroke"
        return (1.0 if width is None else width) * (self.canvas.pixel if fixed else _scale(state.matrix))

    def is_background(self, node: Node, state: _State, fill: tuple[int, int, int, float]) -> bool:
        """Whether this is the canvas's colour: a rectangle under all strokes, ours by name or as large as it."""
        if node.tag != "rect" or self.columns.strokes:
            return False
        user = self.ancestors[-1]
        named = "background" in (node.attributes.get("id"), user.tag == "use" and user.attributes.get("id"))
        if not named and not self.covers(node, state):
            return False
        self.columns.paper(fill)
        return True

    def covers(self, node: Node, state: _State) -> bool:
        a, b, c, d, e, f = state.matrix
        if b or c or self.canvas.width is None or self.canvas.height is None:
            return False
        x, y, width, height, *_ = self.lengths(node, state.size).values()
        slack = 1e-3 * max(self.canvas.width, self.canvas.height)
        across = (a * x + e, a * (x + width) + e, self.canvas.width)
        down = (d * y + f, d * (y + height) + f, self.canvas.height)
        return all(min(p, q) <= slack and max(p, q) >= whole - slack for p, q, whole in (across, down))

    # Colours

    def paint(self, state: _State, name: str) -> tuple[int, int, int, float] | None:
        """The colour of a stroke or fill with its opacity; None where nothing is seen."""
        text = state.style[name]
        if text == "none":
            return None
        if text.startswith("url"):
            color = self.server(text)
        else:
            color = parse_color(state.style["color"] if text.lower() == "currentcolor" else text)
        if color is None:
            return None
        own = state.style[f"{name}-opacity"]
        if own == "1" and state.opacity == 1:
            return color if color[3] else None
        opacity = color[3] * state.opacity * parse_opacity(own)
        return (*color[:3], opacity) if opacity > 0 else None

    def server(self, text: str) -> tuple[int, int, int, float] | None:
        """The mean colour of a gradient; for a pattern, or what is not there, the colour given in its place."""
        node: Node | None = self.ids.get(_target(text) or "")
        for _ in range(10):  # gradients that take their stops from another
            if node is None or node.tag not in ("linearGradient", "radialGradient"):
                break
            stops = [self.stop(child) for child in node.children[:MAX_STOPS] if child.tag == "stop"]
            if stops:
                self.lost["gradient made one colour"] += 1
                red, green, blue, opacity = (sum(values) / len(stops) for values in zip(*stops, strict=True))
                return round(red), round(green), round(blue), opacity
            node = self.ids.get(node.attributes.get("href", node.attributes.get("xlink:href", "")).removeprefix("#"))
        if node is not None and node.tag == "pattern":
            self.lost["pattern left out"] += 1
        return parse_color(text.rpartition(")")[2])

    def stop(self, node: Node) -> tuple[float, float, float, float]:
        style = self.sheet.declared(node, ())
        red, green, blue, opacity = parse_color(style.get("stop-color", "black")) or (0, 0, 0, 0.0)
        return red, green, blue, opacity * parse_opacity(style.get("stop-opacity", "1"))


def _target(reference: str) -> str | None:
    """ "url(#a) red" → "a"."""
    inside = reference.removeprefix("url(").partition(")")[0].strip(" '\"")
    return inside[1:] if reference.startswith("url(") and inside.startswith("#") else None


def _place(node: Node, state: _State) -> tuple[float, float]:
    x, y = (parse_length(node.attributes.get(name, "0"), whole) for name, whole in zip("xy", state.size, strict=True))
    return x or 0.0, y or 0.0


def _scale(matrix: Matrix) -> float:
    """How much wider a stroke becomes: the mean where it is not the same in every direction."""
    a, b, c, d, _, _ = matrix
    return sqrt(abs(a * d - b * c))


def _diagonal(size: tuple[float, float]) -> float:
    """What percentages of lengths along no axis refer to."""
    return sqrt((size[0] ** 2 + size[1] ** 2) / 2)
