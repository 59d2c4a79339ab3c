"""What an SVG says about looks: stylesheets, colours, lengths, transforms.

Stylesheets: type, class, id and universal selectors, compounds of them (`path.pen`) and descendants (`#a .pen`), with
CSS's own order of precedence; at-rules and other selectors are passed over. Values that are no colour, length or
transform read as if they were not there, except a transform, which would move what it stands on: that is refused.

Source: SVG 1.1, chapters 6, 7.6 and 11; CSS Cascading Level 4.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from math import cos, isfinite, radians, sin, tan

from strokeplan.errors import FormatError
from strokeplan.formats.svg_path import numbers
from strokeplan.formats.svg_xml import Node

INHERITED = (
    ("color", "black"),
    ("fill", "black"),
    ("fill-opacity", "1"),
    ("stroke", "none"),
    ("stroke-opacity", "1"),
    ("stroke-width", "1"),
    ("stroke-linecap", "butt"),
    ("stroke-dasharray", "none"),
    ("visibility", "visible"),
)
OWN = ("display", "opacity", "clip-path", "mask", "filter", "vector-effect", "stop-color", "stop-opacity")
PROPERTIES = frozenset(dict(INHERITED)) | frozenset(OWN)
MAX_CSS = 1 << 22
"""Characters of all stylesheets of a file together."""
MAX_COMPOUNDS = 1000
"""Rules with more than one name in their selector: each is tried on every element that it could mean."""

Style = dict[str, str]
_Rank = tuple[bool, int, int, int, int]
"""Important, ids, classes, types, place in the file."""


class Stylesheet:
    """The rules of a file's <style> elements; those of one name are merged as they are read."""

    def __init__(self, css: str) -> None:
        if len(css) > MAX_CSS:
            raise FormatError(f"has stylesheets of {len(css):,} characters; at most {MAX_CSS:,} are read")
        self.single: dict[str, dict[str, tuple[_Rank, str]]] = {}
        self.compounds: list[tuple[list[set[str]], dict[str, tuple[_Rank, str]]]] = []
        for place, (selectors, body) in enumerate(_rules(css)):
            declared = _declarations(body)
            for selector in selectors.split(",") if declared else ():
                self._add(selector, declared, place)

    def _add(self, selector: str, declared: list[tuple[str, str, bool]], place: int) -> None:
        parts = [_names(part) for part in selector.split()]
        if not parts or not all(parts):
            return
        names = [name for part in parts for name in part]
        ids, classes = (sum(name[0] == sign for name in names) for sign in "#.")
        types = len(names) - ids - classes - names.count("*")
        if len(names) == 1:
            into = self.single.setdefault(names[0], {})
        else:
            into = {}
            self.compounds.append(([set(part) for part in parts], into))
            if len(self.compounds) > MAX_COMPOUNDS:
                raise FormatError(f"has more than {MAX_COMPOUNDS:,} compound selectors; that is too much for an SVG")
        for name, value, important in declared:
            _offer(into, name, ((important, ids, classes, types, place), value))

    def declared(self, node: Node, ancestors: Sequence[Node]) -> Style:
        """The properties that an element itself has: by attribute, by rule, by its own style."""
        attributes = node.attributes
        style = {name: value for name, value in attributes.items() if name in PROPERTIES}
        if not (self.single or self.compounds or "style" in attributes):
            return style
        best: dict[str, tuple[_Rank, str]] = {}
        names = _known_as(node)
        for key in names:
            for name, offered in self.single.get(key, {}).items():
                _offer(best, name, offered)
        for parts, rules in self.compounds:
            if parts[-1] <= names and _within(parts[:-1], ancestors):
                for name, offered in rules.items():
                    _offer(best, name, offered)
        for name, value, important in inline(attributes.get("style", "")):
            _offer(best, name, ((important, 1 << 30, 0, 0, 0), value))
        style.update((name, value) for name, (_, value) in best.items())
        return style


def _offer(best: dict[str, tuple[_Rank, str]], name: str, offered: tuple[_Rank, str]) -> None:
    if name not in best or offered[0] >= best[name][0]:
        best[name] = offered


def _known_as(node: Node) -> set[str]:
    """The selectors of one name that mean an element."""
    names = {"*", node.tag} | {f".{name}" for name in node.attributes.get("class", "").split()}
    if "id" in node.attributes:
        names.add("#" + node.attributes["id"])
    return names


def _within(parts: Sequence[set[str]], ancestors: Sequence[Node]) -> bool:
    wanted = list(parts)
    for node in reversed(ancestors) if wanted else ():
        if wanted and wanted[-1] <= _known_as(node):
            wanted.pop()
    return not wanted


def _rules(css: str) -> Iterator[tuple[str, str]]:
    """(selectors, body) of the rules that stand in no at-rule."""
    css = re.sub(r"/\*.*?(?:\*/|\Z)|<!--|-->", " ", css, flags=re.DOTALL)
    depth, start, prelude = 0, 0, ""
    for mark in re.finditer(r"[{};]", css):
        if mark[0] == "{":
            if depth == 0:
                prelude, start = css[start : mark.start()].strip(), mark.end()
            depth += 1
        elif mark[0] == "}" and depth:
            depth -= 1
            if depth == 0:
                if not prelude.startswith("@"):
                    yield prelude, css[start : mark.start()]
                start = mark.end()
        elif depth == 0:  # the end of an @import
            start = mark.end()


def _names(part: str) -> list[str]:
    """ "path.pen" → ["path", ".pen"]; [] for what is no such compound."""
    found = re.findall(r"[.#]?[\w-]+|\*", part)
    return found if "".join(found) == part else []


def _declarations(body: str) -> list[tuple[str, str, bool]]:
    found = []
    for declaration in body.split(";"):
        name, _, value = declaration.partition(":")
        name, value = name.strip().lower(), value.strip()
        if name in PROPERTIES and value:
            bare = value.partition("!")[0].strip()
            found.append((name, bare, bare != value))
    return found


@lru_cache(maxsize=1 << 10)
def inline(text: str) -> tuple[tuple[str, str, bool], ...]:
    """(property, value, whether important) of a style attribute."""
    return tuple(_declarations(text))


# Values


_HEX = re.compile("#[0-9a-fA-F]{6}")


@lru_cache(maxsize=1 << 14)
def parse_color(text: str) -> tuple[int, int, int, float] | None:
    """sRGB of 8 bits and opacity 0..1; None for "none" and for what is no colour."""
    if _HEX.fullmatch(text):  # nearly all of them, and a file can have a hundred thousand
        return int(text[1:3], 16), int(text[3:5], 16), int(text[5:], 16), 1.0
    from PIL import ImageColor

    text = text.strip().lower()
    if found := re.fullmatch(r"(rgb|hsl)a?\(([^()]*)\)", text):
        parts = re.split(r"[\s,/]+", found[2].strip())
        opacity = parse_opacity(parts.pop()) if len(parts) == 4 else 1.0
        text = f"{found[1]}({','.join(parts)})"
        if found[1] == "rgb" and len(parts) == 3 and not all(re.fullmatch(r"[0-9]{1,3}|[0-9]{1,3}%", p) for p in parts):
            rgb = [parse_length(part, 255.0) for part in parts]  # fractions, and what is out of range
            if None not in rgb:
                text = f"rgb({','.join(str(round(min(max(value or 0.0, 0.0), 255.0))) for value in rgb)})"
    else:
        text, opacity = text.partition(" ")[0], 1.0  # "#aabbcc icc-color(…)"
    if text in ("transparent", ""):
        return None
    try:
        red, green, blue, *alpha = ImageColor.getrgb(text)
    except ValueError:
        return None
    return min(red, 255), min(green, 255), min(blue, 255), alpha[0] / 255 if alpha else opacity


def parse_opacity(text: str) -> float:
    """0..1, from a number or a percentage; 1 for what is neither."""
    value = parse_length(text, 1.0)
    return 1.0 if value is None else min(max(value, 0.0), 1.0)


UNITS = {
    "": 1.0, "px": 1.0, "pt": 96 / 72, "pc": 16.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6,
    "em": 16.0, "rem": 16.0, "ex": 8.0,
}  # fmt: skip
"""User units in a unit of length, at CSS's 96 to the inch."""
_LENGTH = re.compile(r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[-+]?[0-9]+)?)\s*(%|[a-z]*)\s*", re.IGNORECASE)


@lru_cache(maxsize=1 << 14)
def parse_length(text: str, whole: float) -> float | None:
    """A length in user units, where "100%" is `whole`; None for what is no length."""
    found = _LENGTH.fullmatch(text)
    if found is None:
        return None
    value, unit = float(found[1]), found[2].lower()
    scale = whole / 100 if unit == "%" else UNITS.get(unit)
    return None if scale is None or not isfinite(value) else value * scale


def unit_mm(text: str) -> float | None:
    """A length in millimetres if its unit is one of paper, else None."""
    found = _LENGTH.fullmatch(text)
    if found is None or found[2].lower() not in ("mm", "cm", "in", "pt", "pc", "q"):
        return None
    return float(found[1]) * UNITS[found[2].lower()] * 25.4 / 96


# Transforms

Matrix = tuple[float, float, float, float, float, float]
"""a, b, c, d, e, f: x′ = ax + cy + e, y′ = bx + dy + f."""
IDENTITY: Matrix = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_FUNCTION = re.compile(r"[\s,]*([A-Za-z]+)\s*\(([^()]*)\)[\s,]*")


def compose(outer: Matrix, inner: Matrix) -> Matrix:
    """The transform that does `inner` first."""
    a, b, c, d, e, f = outer
    p, q, r, s, t, u = inner
    return a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s, a * t + c * u + e, b * t + d * u + f


def parse_transform(text: str) -> Matrix:
    """A transform attribute. Raises ValueError for what is none."""
    matrix, end = IDENTITY, 0
    while end < len(text) and (found := _FUNCTION.match(text, end)):
        given, kind = numbers(found[2]), found[1]
        if kind not in _TRANSFORMS or len(given) not in _TRANSFORMS[kind][0]:
            break
        matrix, end = compose(matrix, _TRANSFORMS[kind][1](*given)), found.end()
    if text[end:].strip() not in ("", "none"):
        raise ValueError(f"the transform {text.strip()[:60]!r} is none that SVG knows")
    return matrix


def _rotate(degrees: float, x: float = 0.0, y: float = 0.0) -> Matrix:
    c, s = cos(radians(degrees % 360)), sin(radians(degrees % 360))
    return c, s, -s, c, x - c * x + s * y, y - s * x - c * y


_TRANSFORMS: dict[str, tuple[tuple[int, ...], Callable[..., Matrix]]] = {
    "matrix": ((6,), lambda *six: six),
    "translate": ((1, 2), lambda x, y=0.0: (1.0, 0.0, 0.0, 1.0, x, y)),
    "scale": ((1, 2), lambda x, y=None: (x, 0.0, 0.0, x if y is None else y, 0.0, 0.0)),
    "rotate": ((1, 3), _rotate),
    "skewX": ((1,), lambda angle: (1.0, 0.0, tan(radians(angle)), 1.0, 0.0, 0.0)),
    "skewY": ((1,), lambda angle: (1.0, tan(radians(angle)), 0.0, 1.0, 0.0, 0.0)),
}
