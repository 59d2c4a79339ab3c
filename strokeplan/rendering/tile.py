"""Where a brush paints: a piece of the enlarged canvas, as a Pycairo context or as its bare pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import leaf
from strokeplan.rendering.surface import CHANNELS, Surface
from strokeplan.strokes import StrokePlan

MAX_PIXEL = 4e6
"""Strokes are cut off this far from a tile, in pixels; Cairo's coordinates wrap at twice as many."""


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """A surface whose first pixel is pixel (left, top) of the canvas enlarged by `scale_x` and `scale_y`."""

    surface: Surface
    left: int
    top: int
    scale_x: float
    scale_y: float

    def context(self) -> Any:
        """The Pycairo context; one unit of it is a pixel."""
        return self.surface.context

    @property
    def scale(self) -> float:
        """Pixels per unit of the plan, for lengths that have no direction."""
        return float(np.sqrt(self.scale_x * self.scale_y))

    def points(self, plan: StrokePlan, strokes: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Chains of some strokes in pixels of this tile, one after the other, and where each starts ((m + 1,))."""
        points = self.whole_points(plan, strokes) - (self.left, self.top)
        return np.clip(points, -MAX_PIXEL, MAX_PIXEL, out=points), np.append(0, np.cumsum(plan.counts[strokes]))

    def whole_points(self, plan: StrokePlan, strokes: NDArray[np.int64]) -> NDArray[np.float64]:
        """Chains of some strokes, one after the other, in pixels of the whole canvas: the same for every tile."""
        places = np.repeat(plan.starts[:-1][strokes], plan.counts[strokes]) + _counted(plan.counts[strokes])
        points: NDArray[np.float64] = plan.points[places] * (self.scale_x, self.scale_y)
        return points

    def pixels(self) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """The pixels, to paint into, and which of their bytes are R, G, B and alpha."""
        return self.surface.pixels(), np.array(CHANNELS)


def _counted(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """0 … count − 1 for every count."""
    ends = np.cumsum(counts)
    return np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - counts, counts)


@leaf
def blend(
    pixel: NDArray[np.uint8],
    channels: NDArray[np.int64],
    color: NDArray[np.float64],
    to: float,
    share: float,
    laid: float,
) -> None:
    """Lay a colour, `share` of the way to the grey `to`, over one pixel; `laid` is how much of it, 0 to 1."""
    for c in range(3):
        at = channels[c]
        wanted = color[c] + (to - color[c]) * share
        pixel[at] = np.uint8(pixel[at] * (1.0 - laid) + wanted * laid + 0.5)
    at = channels[3]
    pixel[at] = np.uint8(pixel[at] * (1.0 - laid) + 255.0 * laid + 0.5)
