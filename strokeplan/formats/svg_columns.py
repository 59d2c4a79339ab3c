"""The strokes of an SVG as they are met, and the plan that they make.

Points go into one flat array in user units; the transforms are applied to it at the end, each to its run of strokes.
Painting order is kept above all: a layer is a run of strokes of one group, so a group comes twice if something
stands between its strokes.
"""

from __future__ import annotations

from array import array
from itertools import pairwise
from math import log10
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import FormatError
from strokeplan.formats.svg_canvas import DEFAULT_SIZE, Canvas
from strokeplan.formats.svg_path import simple_chains
from strokeplan.formats.svg_style import IDENTITY, Matrix
from strokeplan.formats.svg_xml import Node
from strokeplan.strokes import MAX_COORDINATE, MAX_SIZE, Cap, Layer, Medium, Source, StrokePlan

MAX_POINTS = 1 << 25
"""Points of all strokes together; lines and uses of one element take few bytes for many."""
DIGITS = 9
"""Coordinates are rounded to this many digits for the canvas's longer side, so that sums of relative ones are exact."""

Rgba = tuple[int, int, int, float]


class Owner(NamedTuple):
    """The group that makes a layer; `node` is None for what stands in none."""

    node: Node | None
    name: str | None
    medium: Medium
    cap: Cap


class Stroke(NamedTuple):
    """What a stroke has beside its points; a width of 0 stands for a hairline."""

    node: Node
    color: Rgba
    width: float
    pen: str | None
    round: bool


class _Run:
    """Consecutive strokes of one layer."""

    def __init__(self, owner: Owner) -> None:
        self.owner = owner
        self.count = 0


class Columns:
    """Strokes in painting order, becoming a plan."""

    def __init__(self, canvas: Canvas) -> None:
        self.canvas = canvas
        self.background = (255, 255, 255)
        self.flat = array("d")
        self.simple: list[str] = []
        self.counts: list[int] = []
        """Points of each stroke; 0 for those of simple paths until these are read."""
        self.strokes: list[Stroke] = []
        self.along: dict[str, dict[int, list[float]]] = {"pressure": {}, "angle": {}}
        self.runs: list[_Run] = []
        self.turns: list[tuple[int, Matrix]] = [(0, IDENTITY)]
        """From which stroke on which transform holds."""

    def open(self, owner: Owner) -> None:
        """A layer begins; it is one even if nothing is in it."""
        self.runs.append(_Run(owner))

    def paper(self, color: Rgba) -> None:
        red, green, blue = _over(np.array([color]), self.background)[0].tolist()
        self.background = (red, green, blue)

    def add(
        self,
        chain: list[float],
        matrix: Matrix,
        owner: Owner,
        stroke: Stroke,
        along: dict[str, list[float]] | None = None,
    ) -> None:
        """One more stroke: its chain of cubics in user units, and values at its on-curve points."""
        self.flat.extend(chain)
        if len(self.flat) > 2 * MAX_POINTS:
            raise FormatError(f"{stroke.node}: strokes come to more than {MAX_POINTS:,} points")
        for name, values in (along or {}).items():
            if values:
                if len(values) != len(chain) // 6 + 1:
                    wanted = f"the stroke has {len(chain) // 6 + 1} on-curve points"
                    raise FormatError(f"{stroke.node}: strokeplan:{name} has {len(values)} values; {wanted}")
                self.along[name][len(self.strokes)] = values
        self._append(len(chain) // 2, matrix, owner, stroke)

    def add_simple(self, data: str, matrix: Matrix, owner: Owner, stroke: Stroke) -> None:
        """One more stroke, by path data that are simple."""
        self.simple.append(data)
        self._append(0, matrix, owner, stroke)

    def _append(self, count: int, matrix: Matrix, owner: Owner, stroke: Stroke) -> None:
        if matrix is not self.turns[-1][1]:
            self.turns.append((len(self.strokes), matrix))
        self.counts.append(count)
        self.strokes.append(stroke)
        if not self.runs or self.runs[-1].owner is not owner:
            self.runs.append(_Run(owner))
        self.runs[-1].count += 1

    # The plan

    def plan(self, root: Node, hairline: float) -> StrokePlan:
        """All strokes as a plan; `hairline` is the width of outlines, as a part of the canvas's longer side."""
        points, starts = self._chains()
        for (first, matrix), (last, _) in pairwise([*self.turns, (len(self.strokes), IDENTITY)]):
            _transform(points[starts[first] : starts[last]], matrix)
        self._refuse(np.abs(points).max(axis=1, initial=0.0), starts)
        width, height = self._size(points)
        decimals = DIGITS - int(np.ceil(log10(max(width, height))))
        colors = np.array([stroke.color for stroke in self.strokes], np.float64).reshape(-1, 4)
        pens = tuple(stroke.pen for stroke in self.strokes)
        return StrokePlan(
            width=width,
            height=height,
            points=np.round(points, decimals),
            starts=starts,
            widths=self._widths(hairline * max(width, height)),
            colors=_over(colors, self.background),
            layers=tuple(self._layers(points, starts)),
            background=self.background,
            settings=self._settings(root),
            source=_source(root),
            pressures=self._pressures(starts),
            angles=self._angles(starts),
            pens=pens if any(pen is not None for pen in pens) else None,
        )

    def _chains(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Points and starts, in user units."""
        counts = np.array(self.counts, np.int64)
        points = np.array(self.flat, np.float64).reshape(-1, 2)
        if self.simple:
            simple = counts == 0
            own, counts[simple] = simple_chains(self.simple)
            both = np.empty((len(points) + len(own), 2))
            rows = np.repeat(simple, counts)
            both[rows], both[~rows] = own, points
            points = both
        return points, np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    def _refuse(self, reach: NDArray[np.float64], starts: NDArray[np.int64]) -> None:
        bad = ~(reach <= MAX_COORDINATE)
        if bad.any():
            node = self.strokes[int(np.searchsorted(starts, np.argmax(bad), side="right")) - 1].node
            raise FormatError(f"{node}: a coordinate is not within ±{MAX_COORDINATE:g}")

    def _size(self, points: NDArray[np.float64]) -> tuple[float, float]:
        """The canvas; where the file states none, what reaches from the origin around all strokes."""
        if self.canvas.width is not None and self.canvas.height is not None:
            return self.canvas.width, self.canvas.height
        if not len(points):
            return DEFAULT_SIZE
        margin = max(stroke.width for stroke in self.strokes) / 2
        width, height = np.maximum(points.max(axis=0) + min(margin, MAX_SIZE / 10), 1.0).clip(max=MAX_SIZE).tolist()
        return width, height

    def _widths(self, hairline: float) -> NDArray[np.float64]:
        widths = np.array([stroke.width or hairline for stroke in self.strokes], np.float64)
        bad = ~((widths > 0) & (widths <= MAX_SIZE))
        if bad.any():
            index = int(np.argmax(bad))
            stated = f"a stroke {widths[index]:g} wide; a width is above 0 and at most {MAX_SIZE:g}"
            raise FormatError(f"{self.strokes[index].node}: {stated}")
        return widths

    def _layers(self, points: NDArray[np.float64], starts: NDArray[np.int64]) -> list[Layer]:
        """The runs; an empty one only if it says it is a layer, is nowhere else and holds no others."""
        full = {id(run.owner) for run in self.runs if run.count}
        kept = [run for run in self.runs if run.count or (id(run.owner) not in full and _is_leaf(run.owner))]
        layers, first = [], 0
        round_caps = np.array([stroke.round for stroke in self.strokes], np.bool_)
        # What is closed has no ends to show.
        votes = np.where(round_caps, 1, -1) * (points[starts[:-1]] != points[starts[1:] - 1]).any(axis=1)
        for number, run in enumerate(kept, start=1):
            vote = votes[first : first + run.count].sum()
            cap: Cap = ("round" if vote > 0 else "butt") if vote else run.owner.cap
            name = str(number) if run.owner.name is None else run.owner.name
            layers.append(Layer(name, first, first + run.count, run.owner.medium, cap))
            first += run.count
        return layers

    def _pressures(self, starts: NDArray[np.int64]) -> NDArray[np.float64] | None:
        pressures = self._column("pressure", starts)
        if pressures is not None and not np.all(np.isnan(pressures) | ((pressures >= 0) & (pressures <= 1))):
            raise FormatError("a value of strokeplan:pressure is not in 0..1")
        return pressures

    def _angles(self, starts: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Turned as their strokes are."""
        angles = self._column("angle", starts)
        if angles is None:
            return None
        knots = (starts + 2 * np.arange(len(starts))) // 3
        for (first, (a, b, c, d, _, _)), (last, _) in pairwise([*self.turns, (len(self.strokes), IDENTITY)]):
            own = angles[knots[first] : knots[last]]
            if (a, b, c, d) != (1, 0, 0, 1):
                x, y = np.cos(own), np.sin(own)
                own[:] = np.arctan2(b * x + d * y, a * x + c * y) % np.pi
                own[own >= np.pi] = 0.0
        if not np.all(np.isnan(angles) | ((angles >= 0) & (angles < np.pi))):
            raise FormatError("a value of strokeplan:angle is not in 0..π, π itself excluded")
        return angles

    def _column(self, name: str, starts: NDArray[np.int64]) -> NDArray[np.float64] | None:
        given = self.along[name]
        if not given:
            return None
        knots = (starts + 2 * np.arange(len(starts))) // 3
        column = np.full(knots[-1], np.nan)
        for i, values in given.items():
            column[knots[i] : knots[i + 1]] = values
        return column

    def _settings(self, root: Node) -> dict[str, Any]:
        settings: dict[str, Any] = {}
        for node in root.walk():
            if node.tag == "strokeplan:settings":
                try:
                    settings = msgspec.json.decode(node.text, type=dict[str, Any])
                except (msgspec.DecodeError, RecursionError) as error:
                    raise FormatError(f"{node}: the settings are no JSON object ({error})") from None
                break
        if self.canvas.page_mm is not None:
            settings["page_mm"] = [round(side, 6) for side in self.canvas.page_mm]
        return settings


def _source(root: Node) -> Source | None:
    for node in root.walk():
        if node.tag == "strokeplan:source":
            given = node.attributes
            try:
                sides = int(given.get("width", "")[:9]), int(given.get("height", "")[:9])
                return Source(given.get("name", ""), given.get("sha256", ""), *sides)
            except ValueError:
                size = f"{given.get('width', '')[:20]} × {given.get('height', '')[:20]}"
                raise FormatError(f"{node}: a photo of {size} pixels is none that can be planned") from None
    return None


def _is_leaf(owner: Owner) -> bool:
    """Whether a layer holds no layers of its own."""
    return owner.node is not None and is_layer(owner.node) and not any(map(is_layer, owner.node.children))


def is_layer(node: Node) -> bool:
    """Whether a group says that it is a layer: to Inkscape, or (Inkscape's plain SVG drops that) to us."""
    return node.attributes.get("inkscape:groupmode") == "layer" or "strokeplan:name" in node.attributes


def _transform(points: NDArray[np.float64], matrix: Matrix) -> None:
    """Apply a transform in place."""
    a, b, c, d, e, f = matrix
    if (a, b, c, d) != (1, 0, 0, 1):
        x, y = points[:, 0].copy(), points[:, 1].copy()
        with np.errstate(over="ignore", invalid="ignore"):  # what is too large is refused afterwards
            points[:, 0], points[:, 1] = a * x + c * y, b * x + d * y
    points += (e, f)


def _over(colors: NDArray[np.float64], background: tuple[int, int, int]) -> NDArray[np.uint8]:
    """(n, 4) colours with opacity as they look on the background, (n, 3)."""
    opacity = colors[:, 3:]
    return np.rint(colors[:, :3] * opacity + np.array(background) * (1 - opacity)).astype(np.uint8)
