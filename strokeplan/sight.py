"""What an eye sees of a drawing, and whether a change of it would bring it nearer to its photo.

Both are blurred in linear light and compared in lightness L*. A pixel is dark if its centre lies under a stroke; how
many steps of strokes lie there is counted, so that a step that is taken away uncovers only what no other covers.
A change is laid step by step and then judged: it stays, or its steps are taken back.

Coordinates are pixels; blocks are COARSE × COARSE of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import leaf
from strokeplan.sheet import COARSE

TRUNCATE = 2.8
"""The blur ends after so many standard deviations."""
LEVELS = 4096


class Sight(NamedTuple):
    """What the eye sees of the drawing, and what a change of it would change; blocks are COARSE × COARSE pixels."""

    layers: NDArray[np.uint16]
    """How many steps of strokes lie on each pixel."""
    light: NDArray[np.float32]
    """Blurred light of each block."""
    target: NDArray[np.float32]
    """L* that it should have."""
    blur: NDArray[np.float32]
    """What the light around a block gains if one of its pixels becomes bare."""
    lightness: NDArray[np.float32]
    """L* of LEVELS + 2 values of light in 0 … 1."""
    bared: NDArray[np.int32]
    """Pixels of each block that the change in question makes bare."""
    gained: NDArray[np.float32]
    """Scratch: the light that it adds to each block."""
    box: NDArray[np.int64]
    """Blocks that it touches: first and last row, first and last column."""
    radius: float
    """Half the width of the pen, in pixels."""


def sight_of(target: NDArray[np.float32], shape: tuple[int, int], radius: float, sigma: float) -> Sight:
    """The sight of bare paper: `target` (rows, columns) is the light that each block should have, not blurred; `shape`
    that of the pixels, a multiple of COARSE; the eye blurs by `sigma` blocks."""
    reach = int(TRUNCATE * sigma) + 1
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    bell /= bell.sum()
    levels = np.arange(LEVELS + 2) / LEVELS
    table = np.where(levels > 216 / 24389, 116 * np.cbrt(levels) - 16, levels * 24389 / 27).astype(np.float32)
    blank = np.zeros_like(target)
    wanted = _bare_outside(target, sigma)
    return Sight(
        layers=np.zeros(shape, np.uint16),
        light=np.zeros_like(target),
        target=np.interp(wanted, levels, table).astype(np.float32),
        blur=(np.outer(bell, bell) / COARSE**2).astype(np.float32),
        lightness=table,
        bared=np.zeros(target.shape, np.int32),
        gained=blank,
        box=np.array([0, -1, 0, -1]),
        radius=radius,
    )


def _bare_outside(light: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Blurred light of blocks; beyond the picture is bare paper."""
    from scipy.ndimage import gaussian_filter

    reach = int(TRUNCATE * sigma) + 1
    blurred: NDArray[np.float32] = gaussian_filter(light, sigma, mode="constant", cval=1.0, radius=reach)
    return blurred


def look(sight: Sight, sigma: float) -> NDArray[np.float32]:
    """The blurred light of each block, by the strokes that lie there now."""
    rows, columns = sight.light.shape
    bare = (sight.layers == 0).reshape(rows, COARSE, columns, COARSE).mean(axis=(1, 3), dtype=np.float32)
    return _bare_outside(bare, sigma)


@leaf
def lay(sight: Sight, points: NDArray[np.float64], k: int, sign: int) -> None:
    """Lay the step from point k to the next (1), or take it away (−1)."""
    ax, ay = points[k, 0], points[k, 1]
    dx, dy = points[k + 1, 0] - ax, points[k + 1, 1] - ay
    length2, radius2 = dx * dx + dy * dy, sight.radius * sight.radius
    left = max(int(np.ceil(min(ax, ax + dx) - sight.radius - 0.5)), 0)
    right = min(int(np.floor(max(ax, ax + dx) + sight.radius - 0.5)), sight.layers.shape[1] - 1)
    top = max(int(np.ceil(min(ay, ay + dy) - sight.radius - 0.5)), 0)
    bottom = min(int(np.floor(max(ay, ay + dy) + sight.radius - 0.5)), sight.layers.shape[0] - 1)
    box = sight.box
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            px, py = j + 0.5 - ax, i + 0.5 - ay
            t = 0.0
            if length2 > 0.0:
                t = min(max((px * dx + py * dy) / length2, 0.0), 1.0)
            ex, ey = px - t * dx, py - t * dy
            if ex * ex + ey * ey > radius2:
                continue
            was = sight.layers[i, j]
            sight.layers[i, j] = was + 1 if sign > 0 else was - 1
            if was == (0 if sign > 0 else 1):
                u, v = i // COARSE, j // COARSE
                sight.bared[u, v] -= sign
                box[0], box[1] = min(box[0], u), max(box[1], u)
                box[2], box[3] = min(box[2], v), max(box[3], v)


@leaf
def forget(sight: Sight) -> None:
    """No change is in question."""
    sight.box[0], sight.box[1] = sight.bared.shape[0], -1
    sight.box[2], sight.box[3] = sight.bared.shape[1], -1


@leaf
def better(sight: Sight, share: float) -> bool:
    """Whether the change in question takes that share of the squared difference around it; then it is made."""
    rows, columns = sight.light.shape
    box, reach, bared = sight.box, sight.blur.shape[0] // 2, sight.bared
    if box[1] < 0:
        return False
    top, bottom = max(box[0] - reach, 0), min(box[1] + reach + 1, rows)
    left, right = max(box[2] - reach, 0), min(box[3] + reach + 1, columns)
    gained = sight.gained
    for u in range(top, bottom):
        for v in range(left, right):
            gained[u, v] = 0.0
    for u in range(box[0], box[1] + 1):
        for v in range(box[2], box[3] + 1):
            if bared[u, v] == 0:
                continue
            part = np.float32(bared[u, v])
            low, high = max(v - reach, 0), min(v + reach + 1, columns)
            for i in range(max(u - reach, 0), min(u + reach + 1, rows)):
                for j in range(low, high):
                    gained[i, j] += part * sight.blur[i - u + reach, j - v + reach]
    before, after = 0.0, 0.0
    for u in range(top, bottom):
        for v in range(left, right):
            wanted = sight.target[u, v]
            before += (lightness_of(sight, sight.light[u, v]) - wanted) ** 2
            after += (lightness_of(sight, sight.light[u, v] + gained[u, v]) - wanted) ** 2
    if after >= (1.0 - share) * before:
        return False
    for u in range(top, bottom):
        for v in range(left, right):
            sight.light[u, v] += gained[u, v]
    for u in range(box[0], box[1] + 1):
        for v in range(box[2], box[3] + 1):
            bared[u, v] = 0
    forget(sight)
    return True


@leaf
def lightness_of(sight: Sight, light: float) -> float:
    """L* of light, between two entries of the table."""
    at = min(max(light, 0.0), 1.0) * LEVELS
    k = int(at)
    low = sight.lightness[k]
    return float(low + (at - k) * (sight.lightness[k + 1] - low))
