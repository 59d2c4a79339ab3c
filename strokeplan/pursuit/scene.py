"""What the kernels of a layer look at: the photo, the error so far, and the rules by which strokes are kept.

What a footprint gains, and what changes where it is laid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed
from strokeplan.jit import inlined
from strokeplan.pursuit.colours import pixel, squared_distance, suited

BARE = 2.0**40
"""Error of a pixel that must be covered and is bare: above all that a stroke of any width can lose."""

GRID, WORST_FIRST, BY_ERROR, EVEN = range(4)
SEEDINGS = {"grid": GRID, "worst-first": WORST_FIRST, "error": BY_ERROR, "even": EVEN}
NEAR, LANE = np.uint8(1), np.uint8(2)
"""What a pixel is to the evenly spaced strokes of a layer: a tract ends here; none begins here."""


class Rules(NamedTuple):
    """What decides in a layer whether a stroke is tried and kept; lengths in pixels."""

    seeding: int
    cell: float
    """Side of the cells in which seeds are sought."""
    by_gain: bool
    gain: float
    """Least weighted squared error (8-bit RGB, summed over pixels) that a stroke must take away, if by gain."""
    trigger: float
    """Least mean of a cell that is tried: of its squared error, if by gain, or of its RGB distance."""
    cover: bool
    """Cover every pixel, whatever it gains."""
    spare: float
    """By how much strokes that cover are planned thinner than they are painted: a pixel of the photo, so that no
    antialiased border lets the canvas through."""
    separation: float
    """Distance of evenly spaced strokes."""
    vary_width: bool
    """Narrower strokes where the weight is high, wider ones where it is low."""


class Scene(NamedTuple):
    """What the kernels look at; `error`, `ids`, `below`, `stamp` and `lanes` change as strokes are laid."""

    photo: Packed
    weight: NDArray[np.float32]
    error: NDArray[np.float32]
    ids: NDArray[np.int32]
    below: NDArray[np.int32]
    stamp: NDArray[np.int32]
    lanes: NDArray[np.uint8]
    regions: NDArray[np.int32]
    choice: NDArray[np.uint32]
    samples: NDArray[np.float32]
    scale: float
    key: np.uint64


class Kept(NamedTuple):
    """Strokes kept so far: columns with room for more."""

    points: NDArray[np.float64]
    counts: NDArray[np.int64]
    widths: NDArray[np.float64]
    colours: NDArray[np.uint32]


class Tally(NamedTuple):
    """Counters of a strip, each an array of one number."""

    strokes: NDArray[np.int64]
    points: NDArray[np.int64]
    tries: NDArray[np.int64]


@inlined
def gain_of(scene: Scene, pixels: NDArray[np.int32], n: int) -> tuple[float, np.uint32]:
    """What a footprint in its best colour takes from the error, and that colour."""
    photo, weight, error = scene.photo, scene.weight, scene.error
    old = weights = red = green = blue = squares = 0.0
    for k in range(n):
        i, j = pixels[k, 0], pixels[k, 1]
        w, r, g, b = pixel(photo, weight, i, j)
        old += error[i, j]
        weights += w
        red += w * r
        green += w * g
        blue += w * b
        squares += w * (r * r + g * g + b * b)
    if weights == 0.0:
        return -np.inf, np.uint32(0)
    colour = suited(scene.choice, red / weights, green / weights, blue / weights)
    value = np.int64(colour)
    r, g, b = float(value >> 16), float((value >> 8) & 255), float(value & 255)
    left = squares - 2.0 * (r * red + g * green + b * blue) + (r * r + g * g + b * b) * weights
    return old - left, colour


@inlined
def lay(scene: Scene, pixels: NDArray[np.int32], n: int, stroke: int, colour: np.uint32) -> None:
    """Lay a stroke over its footprint."""
    photo, weight, error, ids, below = scene.photo, scene.weight, scene.error, scene.ids, scene.below
    for k in range(n):
        i, j = pixels[k, 0], pixels[k, 1]
        error[i, j] = weight[i, j] * squared_distance(photo[i, j], colour)
        below[i, j], ids[i, j] = ids[i, j], stroke
