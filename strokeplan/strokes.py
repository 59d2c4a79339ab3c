"""StrokePlan: the strokes of a picture as columns of numbers, the one type that every exporter takes.

Coordinates are in pixels of the photo (x right, y down, a pixel covers [j, j + 1] × [i, i + 1]) and
mean nothing without the canvas size: scale both and the picture stays the same. Strokes are painted in
order, first layer first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite, pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Cap = Literal["round", "butt"]
Medium = Literal["paint", "ink"]

MIN_SIZE, MAX_SIZE = 1e-3, 1e6
"""Smallest and largest side of a canvas; no stroke is wider either."""
MAX_COORDINATE = 1e7
"""Strokes may leave the canvas; a coordinate further from the origin than this is a mistake or an attack."""


def rgb_to_hex(color: tuple[int, int, int]) -> str:
    """(255, 0, 16) → "#ff0010"."""
    return "#" + bytes(color).hex()


def hex_to_rgb(color: str) -> tuple[int, int, int]:
    """ "#ff0010" → (255, 0, 16)."""
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue


def plain(value: Any) -> Any:
    """A JSON-like value as a file keeps it: lists for tuples, "?" for what is no character in a text.

    (A file name may hold bytes that are no UTF-8.) Raises ValueError for a value that JSON has no place for.
    """
    match value:
        case None | bool() | int():
            return value
        case float() if isfinite(value):
            return value
        case str():
            return value.encode(errors="replace").decode()
        case list() | tuple():
            return [plain(item) for item in value]
        case dict():
            return {plain(str(key)): plain(item) for key, item in value.items()}
    raise ValueError(f"{value!r} is no JSON value")


@dataclass(frozen=True, slots=True)
class Layer:
    """Strokes first … last − 1 of a plan. `medium` says what lays them."""

    name: str
    first: int
    last: int
    medium: Medium = "paint"
    cap: Cap = "round"

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", plain(self.name))


@dataclass(frozen=True, slots=True)
class Source:
    """The photo a plan was made from: file name, SHA-256 of the file's bytes (hex), size in pixels."""

    name: str
    sha256: str
    width: int
    height: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", plain(self.name))
        if not (1 <= self.width <= MAX_SIZE and 1 <= self.height <= MAX_SIZE):
            raise ValueError(f"a photo of {self.width} × {self.height} pixels is none that can be planned")


@dataclass(frozen=True, eq=False)
class StrokePlan:
    """n strokes, each a chain of cubic Béziers with one width and one colour.

    Any plan can be saved and is the same when loaded again; columns that do not fit raise ValueError.

    width, height  of the canvas, in the unit of the coordinates.
    points         (p, 2) float64: the chains of all strokes, one after the other, 3k + 1 rows each.
    starts         (n + 1,) int64: stroke i has the points starts[i] … starts[i + 1] − 1.
    widths         (n,) float64: width of each stroke, in the unit of the coordinates.
    colors         (n, 3) uint8 sRGB.
    layers         consecutive ranges of strokes that together cover 0 … n.
    background     sRGB of the canvas under the strokes.
    settings       what reproduces the plan (JSON-like values), kept by every format.
    source         the photo, if there was one.
    pressures      (q,) float64 or None: a value in 0…1 for every on-curve point, stroke after stroke;
                   NaN throughout a stroke that has none.
    angles         likewise: radians in [0, π), the direction of the brush's long axis (0 along x, π/2
                   along y, downwards). A brush has no head, so half a turn is all there is.
    pens           (n,) of str or None each, or None if no stroke names a pen.
    """

    width: float
    height: float
    points: NDArray[np.float64]
    starts: NDArray[np.int64]
    widths: NDArray[np.float64]
    colors: NDArray[np.uint8]
    layers: tuple[Layer, ...]
    background: tuple[int, int, int] = (255, 255, 255)
    settings: dict[str, Any] = field(default_factory=dict)
    source: Source | None = None
    pressures: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None
    pens: tuple[str | None, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "settings", plain(self.settings))
        object.__setattr__(self, "pens", self.pens and tuple(plain(self.pens)))
        n = len(self.widths)
        _check_column("points", self.points, (len(self.points), 2), np.float64)
        _check_column("starts", self.starts, (n + 1,), np.int64)
        _check_column("widths", self.widths, (n,), np.float64)
        _check_column("colors", self.colors, (n, 3), np.uint8)
        if self.starts[0] != 0 or self.starts[-1] != len(self.points):
            raise ValueError(f"starts must begin with 0 and end with the number of points, {len(self.points)}")
        if np.any(self.counts < 4) or np.any(self.counts % 3 != 1):
            raise ValueError("a stroke has 3k + 1 points, k at least 1")
        if not np.all(np.abs(self.points) <= MAX_COORDINATE):
            raise ValueError(f"a coordinate is not within ±{MAX_COORDINATE:g}")
        if not np.all((self.widths > 0) & (self.widths <= MAX_SIZE)):
            raise ValueError(f"the width of a stroke is not above 0 and at most {MAX_SIZE:g}")
        if not (MIN_SIZE <= self.width <= MAX_SIZE and MIN_SIZE <= self.height <= MAX_SIZE):
            raise ValueError(f"the canvas, {self.width} × {self.height}, has a side not in {MIN_SIZE:g}..{MAX_SIZE:g}")
        if len(self.background) != 3 or not all(0 <= value <= 255 for value in self.background):
            raise ValueError(f"the background {self.background} is no colour of 8 bits a channel")
        ends = [0, *(layer.last for layer in self.layers)]
        if [layer.first for layer in self.layers] != ends[:-1] or ends != sorted(ends) or ends[-1] != n:
            raise ValueError(f"layers must cover strokes 0 … {n} in order")
        if self.pens is not None and len(self.pens) != n:
            raise ValueError(f"{len(self.pens)} pens for {n} strokes")
        if self.pressures is not None:
            self._check_along("pressures", self.pressures, self.pressures <= 1, "0..1")
        if self.angles is not None:
            self._check_along("angles", self.angles, self.angles < pi, "0..π, π itself excluded")

    def _check_along(self, name: str, values: NDArray[np.float64], below: NDArray[np.bool_], span: str) -> None:
        _check_column(name, values, (int(self.knots.sum()),), np.float64)
        none = np.isnan(values)
        mixed = none != np.repeat(none[self.first_knots[:-1]], self.knots)
        if np.any(mixed) or not np.all(none | ((values >= 0) & below)):
            raise ValueError(f"the {name} of a stroke lie in {span}, or are all NaN")

    def __len__(self) -> int:
        return len(self.widths)

    def __repr__(self) -> str:
        size = f"{self.width:g} × {self.height:g}"
        return f"<StrokePlan {size}, {len(self.layers)} layers, {len(self)} strokes, {self.cubics} cubics>"

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """(n,) points in each stroke."""
        return np.diff(self.starts)

    @property
    def knots(self) -> NDArray[np.int64]:
        """(n,) on-curve points in each stroke: where its cubics begin and end."""
        return self.counts // 3 + 1

    @property
    def cubics(self) -> int:
        """Number of cubic pieces in all strokes."""
        return int((self.counts // 3).sum())

    def stroke(self, i: int) -> NDArray[np.float64]:
        """The (3k + 1, 2) chain of stroke i; counted from the end if i is negative."""
        i = range(len(self))[i]
        return self.points[self.starts[i] : self.starts[i + 1]]

    @cached_property
    def first_knots(self) -> NDArray[np.int64]:
        """(n + 1,): the values of stroke i stand at first_knots[i] … first_knots[i + 1] − 1 of pressures and angles."""
        return (self.starts + 2 * np.arange(len(self) + 1)) // 3

    @cached_property
    def has_pressure(self) -> NDArray[np.bool_]:
        """(n,) whether a stroke has pressure."""
        if self.pressures is None:
            return np.zeros(len(self), np.bool_)
        return ~np.isnan(self.pressures[self.first_knots[:-1]])

    def radii(self, i: int) -> NDArray[np.float64]:
        """(k + 1,) half the width that stroke i is painted with at its on-curve points."""
        i = range(len(self))[i]
        first, last = self.first_knots[i : i + 2]
        pressure = self.pressures[first:last] if self.pressures is not None and self.has_pressure[i] else 1.0
        return np.full(last - first, 0.5 * self.widths[i]) * pressure

    @cached_property
    def half_widths(self) -> NDArray[np.float64]:
        """(q,) `radii` of all strokes, one after the other."""
        half = np.repeat(0.5 * self.widths, self.knots)
        return half if self.pressures is None else half * np.where(np.isnan(self.pressures), 1.0, self.pressures)

    @property
    def round_caps(self) -> NDArray[np.bool_]:
        """(n,) whether a stroke has round caps."""
        return np.repeat([layer.cap == "round" for layer in self.layers], [k.last - k.first for k in self.layers])

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        return (self.stroke(i) for i in range(len(self)))

    def save(self, path: str | Path) -> None:
        """Write the plan; the suffix picks the format (.json, .json.gz, .svg, .svgz, .pdf, .eps, .ps, .dxf, .png)."""
        from strokeplan.formats import save

        save(self, path)

    def _repr_svg_(self) -> str:
        """What a notebook shows."""
        from strokeplan.formats.svg import encode

        return encode(self).decode()


def _check_column(name: str, column: NDArray[Any], shape: tuple[int, ...], dtype: type) -> None:
    if column.shape != shape or column.dtype != dtype:
        raise ValueError(f"{name} must be {shape} {dtype.__name__}, not {column.shape} {column.dtype}")


def unit_mm(plan: StrokePlan) -> float | None:
    """The true size of a pen drawing's unit; None of a plan that is not drawn for paper."""
    page = plan.settings.get("page_mm")
    if not any(layer.medium == "ink" for layer in plan.layers) or not isinstance(page, list) or not page:
        return None
    return page[0] / plan.width if isinstance(page[0], int | float) and page[0] > 0 else None


def describe(plan: StrokePlan) -> list[tuple[str, str]]:
    """What a plan holds, as (name, text) rows for people."""
    rows = [("canvas", f"{plan.width:g} × {plan.height:g}, background {rgb_to_hex(plan.background)}")]
    if plan.source is not None:
        rows.append(("source", f"{plan.source.name}, {plan.source.width} × {plan.source.height} pixels"))
    rows.append(
        ("strokes", f"{len(plan):,} of {plan.cubics:,} cubics, {len(np.unique(plan.colors, axis=0)):,} colours")
    )
    for layer in plan.layers:
        widths = np.unique(plan.widths[layer.first : layer.last])
        span = f"{widths[0]:g}" + (f" to {widths[-1]:g}" if len(widths) > 1 else "") if len(widths) else "–"
        rows.append(
            (
                f"layer {layer.name}",
                f"{layer.last - layer.first:,} strokes of width {span}, {layer.medium}, {layer.cap} caps",
            )
        )
    preset = plan.settings.get("preset")
    if isinstance(preset, dict):
        made = f"preset {preset.get('name') or '?'}, seed {plan.settings.get('seed')}"
        rows.append(("made with", f"{made}, strokeplan {plan.settings.get('strokeplan')}"))
    return rows
