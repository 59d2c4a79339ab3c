"""Path data and basic shapes as chains of cubics.

Curves stay curves: cubics as they are, quadratics raised exactly, straight lines as cubics with their handles at
the thirds, arcs in pieces of at most an eighth of a turn (off by 4e-6 of the radius). A subpath becomes one chain,
a closed one ends exactly where it began. svgelements reads the same and more, but takes 75 µs for a path of three
cubics, ten times as long, and reads in silence what is no number.

Most paths of ours are an M and a c: such are only looked over when they are met (`is_simple`), and read all at once
(`simple_chains`), which takes a fifth of the time.

Source: SVG 1.1, chapter 8 and appendix F.6 (arcs).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import acos, ceil, copysign, cos, hypot, isfinite, pi, radians, sin, sqrt, tan

import numpy as np
from numpy.typing import NDArray

Chain = list[float]
"""x0, y0, then six numbers a cubic."""

MAX_PATH = 1 << 23
"""Longest path data, in characters."""
CLOSED = 1e-9
"""A subpath is closed without a further line if its end is this near its start, as a part of the coordinates."""
_PIECE = pi / 4
"""Largest arc that one cubic stands for."""
_COMMANDS = re.compile(r"([A-DF-Za-df-z_])")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_PLAIN, _GAP = r"-?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)", r"(?:[ ,]++|(?=-))"
_CUBIC = rf"{_PLAIN}(?:{_GAP}{_PLAIN}){{5}}"
_SIMPLE = re.compile(rf"M ?{_PLAIN}{_GAP}{_PLAIN} ?c ?{_CUBIC}(?:{_GAP}{_CUBIC})*+")
MAX_SIMPLE = 4000
"""Characters; pieces of all simple paths are summed in step, so that none may be much longer than the others."""
_FLAGS = re.compile(
    rf"\s*({_NUMBER.pattern})[\s,]*({_NUMBER.pattern})[\s,]*({_NUMBER.pattern})[\s,]*([01])[\s,]*"
    rf"([01])[\s,]*({_NUMBER.pattern})[\s,]*({_NUMBER.pattern})[\s,]*"
)
"""The seven numbers of an arc; its two flags need nothing between them and what follows."""


def subpaths(data: str) -> list[Chain]:
    """The chains of path data, one a subpath that draws something. Raises ValueError, which names the fault."""
    if len(data) > MAX_PATH:
        raise ValueError(f"path data of {len(data):,} characters; at most {MAX_PATH:,} are read")
    if not data.isascii():
        raise ValueError("path data with characters that are no number and no command")
    lead, *parts = _COMMANDS.split(data)
    if lead.strip() or (parts and parts[0] not in "Mm" and data.strip() != "none"):
        raise ValueError(f"path data begin with {data.strip()[:20]!r}, not with M")
    if data.strip() == "none":
        return []
    tracer = _Tracer()
    for command, text in zip(parts[::2], parts[1::2], strict=True):
        tracer.draw(command, text)
    return tracer.chains


def is_simple(data: str) -> bool:
    """Whether path data are one M and one c of numbers without exponents."""
    return len(data) <= MAX_SIMPLE and _SIMPLE.fullmatch(data) is not None


def simple_chains(paths: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (p, 2) of all chains, one after the other, and how many each has: of path data that are simple."""
    text = "".join(paths).encode().replace(b"M", b" nan ").replace(b"c", b" ").replace(b",", b" ").replace(b"-", b" -")
    values = np.fromstring(text, sep=" ")
    marks = np.flatnonzero(np.isnan(values))
    points = np.delete(values, marks).reshape(-1, 2)
    counts = np.diff(marks, append=len(values)) // 2
    # Each piece counts from the end of the one before: the first pieces of all chains, then the second …
    place, left = np.cumsum(counts) - counts, counts // 3
    while len(place):
        points[place[:, None] + (1, 2, 3)] += points[place, None]
        place, left = place[left > 1] + 3, left[left > 1] - 1
    return points, counts


def numbers(text: str) -> list[float]:
    """Numbers with or without commas and spaces between them. Raises ValueError."""
    spaced = text.replace(",", " ")
    if "-" in spaced and "e" not in spaced and "E" not in spaced:
        spaced = spaced.replace("-", " -")  # as "1-2" is written in short
    try:
        return [float(word) for word in spaced.split()]
    except ValueError:
        if rest := _NUMBER.sub(" ", text).strip(" \t\r\n\f,"):
            raise ValueError(f"{rest[:20]!r} is no number") from None
        return [float(word) for word in _NUMBER.findall(text)]


class _Tracer:
    """Follows path data: where it stands, and the chains so far."""

    __slots__ = ("chain", "chains", "handle", "last", "start", "x", "y")

    def __init__(self) -> None:
        self.chains: list[Chain] = []
        self.chain: Chain | None = None
        self.x = self.y = 0.0
        self.start = self.handle = (0.0, 0.0)
        self.last = ""

    def draw(self, command: str, text: str) -> None:
        kind = command.lower()
        if kind not in _COUNTS:
            raise ValueError(f"{command!r} in path data is no command")
        count, method = _COUNTS[kind]
        given = _arc_numbers(text) if kind == "a" else numbers(text)
        if (count and (not given or len(given) % count)) or (given and not count):
            raise ValueError(f"{command!r} in path data has {len(given)} numbers; it takes {count or 'none'} each time")
        if kind not in "mz" and self.chain is None:
            self.begin()
        method(self, given, command.islower())
        self.last = kind

    def move(self, given: list[float], relative: bool) -> None:
        self.x, self.y = (self.x + given[0], self.y + given[1]) if relative else (given[0], given[1])
        self.start, self.chain = (self.x, self.y), None
        if len(given) > 2:
            self.begin()
            self.lines(given[2:], relative)

    def begin(self) -> None:
        self.chain = [self.x, self.y]
        self.chains.append(self.chain)

    def close(self, _: list[float], __: bool) -> None:
        x, y = self.start
        if self.chain is None:  # a dot
            self.chains.append([x, y] * 4)
        elif hypot(self.x - x, self.y - y) <= CLOSED * (abs(x) + abs(y) + 1) and len(self.chain) > 8:
            self.chain[-2:] = self.start
        else:
            self.line(x, y)
        self.x, self.y = self.start
        self.chain = None

    def line(self, x: float, y: float) -> None:
        dx, dy = (x - self.x) / 3, (y - self.y) / 3
        self.cubic(self.x + dx, self.y + dy, x - dx, y - dy, x, y)

    def cubic(self, ax: float, ay: float, bx: float, by: float, x: float, y: float) -> None:
        assert self.chain is not None  # noqa: S101 - draw began it
        self.chain += (ax, ay, bx, by, x, y)
        self.handle, self.x, self.y = (bx, by), x, y

    def quadratic(self, qx: float, qy: float, x: float, y: float) -> None:
        ax, ay = self.x + (qx - self.x) * 2 / 3, self.y + (qy - self.y) * 2 / 3
        self.cubic(ax, ay, x + (qx - x) * 2 / 3, y + (qy - y) * 2 / 3, x, y)
        self.handle = (qx, qy)

    def lines(self, given: list[float], relative: bool) -> None:
        for dx, dy in zip(given[::2], given[1::2], strict=True):
            self.line(*self.at(dx, dy, relative))

    def horizontals(self, given: list[float], relative: bool) -> None:
        for x in given:
            self.line(self.x + x if relative else x, self.y)

    def verticals(self, given: list[float], relative: bool) -> None:
        for y in given:
            self.line(self.x, self.y + y if relative else y)

    def cubics(self, given: list[float], relative: bool) -> None:
        if not relative:
            assert self.chain is not None  # noqa: S101 - draw began it
            self.chain += given
            self.handle, self.x, self.y = (given[-4], given[-3]), given[-2], given[-1]
            return
        x, y, chain = self.x, self.y, self.chain
        assert chain is not None  # noqa: S101 - draw began it
        numbers = iter(given)
        for a, b, c, d, e, f in zip(numbers, numbers, numbers, numbers, numbers, numbers, strict=True):
            chain += (x + a, y + b, x + c, y + d, x + e, y + f)
            x += e
            y += f
        self.handle, self.x, self.y = (chain[-4], chain[-3]), x, y

    def smooth_cubics(self, given: list[float], relative: bool) -> None:
        for i in range(0, len(given), 4):
            ax, ay = self.mirrored("cs")
            bx, by, x, y = given[i : i + 4]
            self.cubic(ax, ay, *self.at(bx, by, relative), *self.at(x, y, relative))
            self.last = "s"

    def quadratics(self, given: list[float], relative: bool) -> None:
        for i in range(0, len(given), 4):
            qx, qy, x, y = given[i : i + 4]
            self.quadratic(*self.at(qx, qy, relative), *self.at(x, y, relative))

    def smooth_quadratics(self, given: list[float], relative: bool) -> None:
        for dx, dy in zip(given[::2], given[1::2], strict=True):
            self.quadratic(*self.mirrored("qt"), *self.at(dx, dy, relative))
            self.last = "t"

    def arcs(self, given: list[float], relative: bool) -> None:
        for i in range(0, len(given), 7):
            rx, ry, turn, large, sweep, x, y = given[i : i + 7]
            x, y = self.at(x, y, relative)
            if not all(map(isfinite, (rx, ry, turn, x, y, self.x, self.y))):
                raise ValueError("an arc in path data has a number that is too large")
            if rx == 0 or ry == 0:
                self.line(x, y)
                continue
            for piece in _arc(self.x, self.y, abs(rx), abs(ry), radians(turn % 360), bool(large), bool(sweep), x, y):
                self.cubic(*piece)

    def at(self, x: float, y: float, relative: bool) -> tuple[float, float]:
        return (self.x + x, self.y + y) if relative else (x, y)

    def mirrored(self, kinds: str) -> tuple[float, float]:
        """The first handle of a smooth curve: the last one's mirror image, if a curve of its kind came before."""
        if self.last and self.last in kinds:
            return 2 * self.x - self.handle[0], 2 * self.y - self.handle[1]
        return self.x, self.y


_COUNTS: dict[str, tuple[int, Callable[[_Tracer, list[float], bool], None]]] = {
    "m": (2, _Tracer.move),
    "z": (0, _Tracer.close),
    "l": (2, _Tracer.lines),
    "h": (1, _Tracer.horizontals),
    "v": (1, _Tracer.verticals),
    "c": (6, _Tracer.cubics),
    "s": (4, _Tracer.smooth_cubics),
    "q": (4, _Tracer.quadratics),
    "t": (2, _Tracer.smooth_quadratics),
    "a": (7, _Tracer.arcs),
}


def _arc_numbers(text: str) -> list[float]:
    given: list[float] = []
    end = 0
    while end < len(text) and (found := _FLAGS.match(text, end)):
        given += map(float, found.groups())
        end = found.end()
    if text[end:].strip():
        raise ValueError(f"{text[end:].strip()[:20]!r} in path data is no arc")
    return given


def _arc(
    x0: float, y0: float, rx: float, ry: float, turn: float, large: bool, sweep: bool, x: float, y: float
) -> Iterator[tuple[float, float, float, float, float, float]]:
    """Cubics along an elliptic arc from (x0, y0) to (x, y)."""
    if (x0, y0) == (x, y):
        return
    c, s = cos(turn), sin(turn)
    # The middle of the chord in the ellipse's own axes, as if it were a unit circle.
    u, v = (c * (x0 - x) + s * (y0 - y)) / 2 / rx, (c * (y0 - y) - s * (x0 - x)) / 2 / ry
    half = hypot(u, v)
    if not 0 < half < 1e9:  # far beyond any canvas, or radii of almost nothing: the chord is all that is seen
        yield x0 + (x - x0) / 3, y0 + (y - y0) / 3, x - (x - x0) / 3, y - (y - y0) / 3, x, y
        return
    if half > 1:
        rx, ry, u, v, half = rx * half, ry * half, u / half, v / half, 1.0
    away = copysign(sqrt(max(1 - half * half, 0.0)) / half, 1 if large != sweep else -1)
    mx, my = away * v, -away * u  # centre, counted from the middle of the chord
    first = _angle(u - mx, v - my)
    span = _angle(-u - mx, -v - my) - first
    span += 2 * pi * (sweep and span < 0) - 2 * pi * (not sweep and span > 0)
    count = max(ceil(abs(span) / _PIECE - 1e-9), 1)
    reach = 4 / 3 * tan(span / count / 4)
    cx, cy = (x0 + x) / 2 + c * rx * mx - s * ry * my, (y0 + y) / 2 + s * rx * mx + c * ry * my

    def place(p: float, q: float) -> tuple[float, float]:
        return cx + c * rx * p - s * ry * q, cy + s * rx * p + c * ry * q

    for k in range(count):
        a, b = first + span * k / count, first + span * (k + 1) / count
        end = (x, y) if k == count - 1 else place(cos(b), sin(b))
        leave = place(cos(a) - reach * sin(a), sin(a) + reach * cos(a))
        yield *leave, *place(cos(b) + reach * sin(b), sin(b) - reach * cos(b)), *end


def _angle(x: float, y: float) -> float:
    angle = acos(min(max(x / hypot(x, y), -1.0), 1.0))
    return -angle if y < 0 else angle


def shape_data(tag: str, given: Mapping[str, float], points: str) -> str:
    """Path data of a basic shape: `given` are its lengths in user units; "" for one that draws nothing."""
    match tag:
        case "line":
            return "M{x1} {y1}L{x2} {y2}".format_map(given)
        case "polyline" | "polygon":
            closing = "z" if tag == "polygon" else ""
            return f"M{points}{closing}" if points.strip() else ""
        case "circle":
            return _ellipse(given["cx"], given["cy"], given["r"], given["r"])
        case "ellipse":
            return _ellipse(given["cx"], given["cy"], given["rx"], given["ry"])
    return _rectangle(**given)


def _ellipse(cx: float, cy: float, rx: float, ry: float) -> str:
    if rx <= 0 or ry <= 0:
        return ""
    return f"M{cx + rx} {cy}A{rx} {ry} 0 0 1 {cx - rx} {cy}A{rx} {ry} 0 0 1 {cx + rx} {cy}z"


def _rectangle(x: float, y: float, width: float, height: float, rx: float, ry: float) -> str:
    if width <= 0 or height <= 0:
        return ""
    rx, ry = (ry if rx < 0 else rx), (rx if ry < 0 else ry)  # below 0: not given, as the other
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    if rx <= 0 or ry <= 0:
        return f"M{x} {y}h{width}v{height}h{-width}z"
    w, h, arc = width - 2 * rx, height - 2 * ry, f"a{rx} {ry} 0 0 1"
    return f"M{x + rx} {y}h{w}{arc} {rx} {ry}v{h}{arc} {-rx} {ry}h{-w}{arc} {-rx} {-ry}v{-h}{arc} {rx} {-ry}z"
