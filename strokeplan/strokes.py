"""StrokePlan: the strokes of a picture as columns of numbers, the one type that every exporter takes.

Coordinates are in pixels of the photo (x right, y down, a pixel covers [j, j + 1] × [i, i + 1]) and
mean nothing without the canvas size: scale both and the picture stays the same. Strokes are painted in
order, first layer first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Cap = Literal["round", "butt"]


def rgb_to_hex(color: tuple[int, int, int]) -> str:
    """(255, 0, 16) → "#ff0010"."""
    return "#" + bytes(color).hex()


def hex_to_rgb(color: str) -> tuple[int, int, int]:
    """ "#ff0010" → (255, 0, 16)."""
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue


@dataclass(frozen=True, slots=True)
class Layer:
    """Strokes first … last − 1 of a plan. `medium` says what lays them: "paint" or "ink"."""

    name: str
    first: int
    last: int
    medium: str = "paint"
    cap: Cap = "round"


@dataclass(frozen=True, slots=True)
class Source:
    """The photo a plan was made from: file name, SHA-256 of the file's bytes (hex), size in pixels."""

    name: str
    sha256: str
    width: int
    height: int


@dataclass(frozen=True, eq=False)
class StrokePlan:
    """n strokes, each a chain of cubic Béziers with one width and one colour.

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
    pens: tuple[str | None, ...] | None = None

    def __post_init__(self) -> None:
        n = len(self.widths)
        if self.starts.shape != (n + 1,) or self.colors.shape != (n, 3) or self.points.shape != (self.starts[-1], 2):
            raise ValueError(f"columns of a plan disagree: {n} widths, {self.starts.shape} starts, {self.points.shape}")
        if np.any(self.counts < 4) or np.any((self.counts - 1) % 3):
            raise ValueError("a stroke has 3k + 1 points, k at least 1")
        ends = [0, *(layer.last for layer in self.layers)]
        if [layer.first for layer in self.layers] != ends[:-1] or ends[-1] != n:
            raise ValueError(f"layers must cover strokes 0 … {n} in order")

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
    def cubics(self) -> int:
        """Number of cubic pieces in all strokes."""
        return int(((self.counts - 1) // 3).sum())

    def stroke(self, i: int) -> NDArray[np.float64]:
        """The (3k + 1, 2) chain of stroke i."""
        return self.points[self.starts[i] : self.starts[i + 1]]

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        return (self.stroke(i) for i in range(len(self)))

    def save(self, path: str | Path) -> None:
        """Write the plan; the suffix picks the format (.json, .json.gz, .svg, .svgz, .png)."""
        from strokeplan.formats import save

        save(self, path)

    def _repr_svg_(self) -> str:
        """What a notebook shows."""
        from strokeplan.formats.svg import encode

        return encode(self).decode()


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
