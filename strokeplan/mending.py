"""Strokes are added, shortened, lengthened, moved and taken away where that brings a drawing nearer to its photo.

Drawing and photo are compared as an eye sees them, both blurred in linear light, in lightness L*. A change of a
stroke is tried, and stays if the sum of squared differences around it falls: halftones are searched for dot by dot in
the same way (direct binary search: Analoui and Allebach 1992). What a change does to the light is exact under one
model: a pixel is dark if its centre lies under a stroke, however many lie there, so that a stroke that is taken away
uncovers only what no other covers.

Lines (as hatch draws them) only get shorter or longer at their ends, and stay as long as their style asks for. Strokes
up to SHORT_MM may also move by half a width of the pen, or go. New ones come along the field in gaps, and only
where they gain as much as a stroke should.

Coordinates are millimetres of the picture: x right, y down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.hatching import STEP_MM
from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.linework import Lines
from strokeplan.sheet import COARSE
from strokeplan.sight import Sight, better, forget, lay, lightness_of, look, sight_of
from strokeplan.tractography import sample

LEAST_LIGHTER = 1.5
"""L* by which a place must be lighter than its photo before a stroke is tried."""
MOST_COVERED = 0.6
"""A stroke that lies on more ink than this, on average, is in no gap."""
MARGIN = 0.02
"""Part of the squared difference around it that a new stroke must take away."""
WORTH = 1e-3
"""… and a change of one that is there."""
SHORT_MM = 2.2
"""Strokes up to this length may move, and be taken away."""
LEAST_STEPS = 2
"""A stroke has so many steps at least."""
GROWN = 1.5
"""A short stroke becomes at most so many times as long as it was."""
END_STEPS = 3
"""Ends are moved by so many steps, again and again."""
SPARE = 12
"""Steps by which either end of a stroke may grow in all."""
STRAIGHT = 0.9
"""Cosine of the bend that a stroke may have where it grows."""
ROUNDS = 2
"""How often all strokes are looked at once new ones have come."""


class _Strokes(NamedTuple):
    """Strokes with room to grow: stroke s has the points first[s] … last[s]."""

    points: NDArray[np.float64]
    """In pixels."""
    slots: NDArray[np.int64]
    """Where the room for each begins."""
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    least: NDArray[np.int64]
    """Steps that each has at least …"""
    most: NDArray[np.int64]
    """… and at most."""


class _Ground(NamedTuple):
    """What new strokes and ends follow, in pixels."""

    directions: NDArray[np.float32]
    spacing: float
    right: float
    bottom: float
    step: float


def mend(
    lines: Lines,
    directions: NDArray[np.float32],
    spacing_mm: float,
    target: NDArray[np.float32],
    shape: tuple[int, int],
    pixel_mm: float,
    size_mm: tuple[float, float],
    width_mm: float,
    *,
    sigma_mm: float,
    lengths_mm: tuple[float, ...],
    least_mm: float,
    seed: int,
) -> Lines:
    """The lines of a drawing, and more, nearer to its photo.

    `target` (rows, columns) is the light that each block of COARSE × COARSE pixels should have, not blurred; `shape`
    is that of the pixels. The eye blurs by `sigma_mm`. New strokes are tried in order of `lengths_mm`; lines longer
    than SHORT_MM stay at least `least_mm` long. `directions` are as `hatch` has them, `size_mm` is that of the picture,
    which no stroke leaves.
    """
    rows, columns = (-(-side // COARSE) * COARSE for side in shape)
    sight = sight_of(target, (rows, columns), 0.5 * width_mm / pixel_mm, sigma_mm / (pixel_mm * COARSE))
    tries = np.array([max(round(0.5 * length / STEP_MM), 1) for length in lengths_mm], np.int64)
    room = target.size // 8 + 1000
    strokes, count = _with_room(lines, pixel_mm, least_mm, room, int(2 * tries.max(initial=1)) + 1 + 2 * SPARE)
    ground = _Ground(
        directions, spacing_mm / pixel_mm, size_mm[0] / pixel_mm, size_mm[1] / pixel_mm, STEP_MM / pixel_mm
    )
    _lay_all(sight, strokes, count)
    blurred = look(sight, sigma_mm / (pixel_mm * COARSE))
    sight.light[:] = blurred
    order = np.random.default_rng(seed)
    _retouch(sight, strokes, ground, order.permutation(count))
    total = _add(sight, strokes, ground, order.permutation(target.size), tries, count)
    for _ in range(ROUNDS):
        _retouch(sight, strokes, ground, order.permutation(total))
    return _left(strokes, total, pixel_mm)


def compiled() -> bool:
    """Whether the kernels are in Numba's cache."""
    return is_cached(_retouch) and is_cached(_add)


def _with_room(lines: Lines, pixel: float, least_mm: float, more: int, slot: int) -> tuple[_Strokes, int]:
    """The lines of a drawing with SPARE places before and after each, and `more` slots for new strokes."""
    counts = np.diff(lines.starts)
    n = len(counts)
    sizes = np.concatenate([counts + 2 * SPARE, np.full(more, slot)])
    slots = np.concatenate([[0], np.cumsum(sizes)])
    points = np.zeros((slots[-1], 2))
    own = np.arange(len(lines.points)) - np.repeat(lines.starts[:-1], counts)
    points[np.repeat(slots[:n] + SPARE, counts) + own] = lines.points / pixel
    first = slots[:-1] + SPARE
    last = first - 1
    last[:n] += counts
    steps = np.concatenate([counts - 1, np.full(more, slot - 2 * SPARE - 1)])
    short = steps * STEP_MM <= SHORT_MM
    least = np.where(short, LEAST_STEPS, np.minimum(max(round(least_mm / STEP_MM), LEAST_STEPS), steps))
    most = np.where(short, (GROWN * steps).astype(np.int64) + 1, steps + 2 * SPARE)
    return _Strokes(points, slots, first, last, least, most), n


def _left(strokes: _Strokes, count: int, pixel: float) -> Lines:
    """The strokes that are still there."""
    first, last = strokes.first[:count], strokes.last[:count]
    counts = last - first + 1
    kept = counts > 1
    first, counts = first[kept], counts[kept]
    starts = np.concatenate([[0], np.cumsum(counts)])
    own = np.arange(starts[-1]) - np.repeat(starts[:-1], counts)
    return Lines(strokes.points[np.repeat(first, counts) + own] * pixel, starts)


@kernel
def _lay_all(sight: Sight, strokes: _Strokes, count: int) -> None:
    for s in range(count):
        for k in range(strokes.first[s], strokes.last[s]):
            lay(sight, strokes.points, k, 1)
    sight.bared[:] = 0
    forget(sight)


@kernel
def _retouch(sight: Sight, strokes: _Strokes, ground: _Ground, order: NDArray[np.int64]) -> None:
    """Try what may be better of each stroke, in order."""
    for s in order:
        steps = strokes.last[s] - strokes.first[s]
        if steps < 1:
            continue
        short = strokes.least[s] == LEAST_STEPS  # no line
        if short and _take_away(sight, strokes, s):
            continue
        for end in (1, -1):
            shorter = False
            while _shorten(sight, strokes, s, end, END_STEPS):
                shorter = True
            while not shorter and _lengthen(sight, strokes, ground, s, end, END_STEPS):
                pass
        if short:
            for dx, dy in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
                _shift(sight, strokes, ground, s, dx * sight.radius, dy * sight.radius)


@kernel
def _add(
    sight: Sight,
    strokes: _Strokes,
    ground: _Ground,
    order: NDArray[np.int64],
    tries: NDArray[np.int64],
    count: int,
) -> int:
    """New strokes in places that are too light; return how many strokes there are then."""
    columns = sight.light.shape[1]
    points = strokes.points
    for half in tries:
        for place in order:
            i, j = place // columns, place % columns
            if lightness_of(sight, sight.light[i, j]) - sight.target[i, j] < LEAST_LIGHTER:
                continue
            if count >= len(strokes.first):
                return count
            x = min((j + 0.5) * COARSE, ground.right)
            y = min((i + 0.5) * COARSE, ground.bottom)
            at = strokes.first[count]
            _both_ways(ground, x, y, half, points, at)
            bare = 0
            for k in range(at, at + 2 * half + 1):
                u = min(int(points[k, 1]), sight.layers.shape[0] - 1)
                v = min(int(points[k, 0]), sight.layers.shape[1] - 1)
                bare += sight.layers[u, v] == 0
            if bare < (1.0 - MOST_COVERED) * (2 * half + 1):
                continue
            for k in range(at, at + 2 * half):
                lay(sight, points, k, 1)
            if better(sight, MARGIN):
                strokes.last[count] = at + 2 * half
                strokes.least[count] = LEAST_STEPS
                strokes.most[count] = int(GROWN * 2 * half) + 1
                count += 1
            else:
                for k in range(at, at + 2 * half):
                    lay(sight, points, k, -1)
                forget(sight)
    return count


@leaf
def _both_ways(ground: _Ground, x: float, y: float, half: int, points: NDArray[np.float64], at: int) -> None:
    """2 · half + 1 points along the field through (x, y), from index `at` on."""
    for side in (1, -1):
        ux, uy, _ = sample(ground.directions, ground.spacing, False, x, y, 1.0, 0.0)
        points[at + half, 0], points[at + half, 1] = x, y
        _grow(ground, points, at + half, side, half, side * ux, side * uy)


@leaf
def _grow(ground: _Ground, points: NDArray[np.float64], at: int, side: int, n: int, ux: float, uy: float) -> None:
    """n points along the field after index `at`, by `side` (±1), beginning in the direction (ux, uy).

    Where they would leave the picture they stay.
    """
    x, y = points[at, 0], points[at, 1]
    step = ground.step
    for _ in range(n):
        ax, ay, _ = sample(ground.directions, ground.spacing, True, x, y, ux, uy)
        ux, uy, _ = sample(ground.directions, ground.spacing, True, x + 0.5 * step * ax, y + 0.5 * step * ay, ax, ay)
        if 0.0 <= x + step * ux <= ground.right and 0.0 <= y + step * uy <= ground.bottom:
            x, y = x + step * ux, y + step * uy
        at += side
        points[at, 0], points[at, 1] = x, y


@leaf
def _take_away(sight: Sight, strokes: _Strokes, s: int) -> bool:
    first, last = strokes.first[s], strokes.last[s]
    for k in range(first, last):
        lay(sight, strokes.points, k, -1)
    if better(sight, WORTH):
        strokes.last[s] = first - 1
        return True
    for k in range(first, last):
        lay(sight, strokes.points, k, 1)
    forget(sight)
    return False


@leaf
def _shorten(sight: Sight, strokes: _Strokes, s: int, end: int, n: int) -> bool:
    """Take n steps from the end (1) or the beginning (−1)."""
    first, last = strokes.first[s], strokes.last[s]
    if last - first - n < strokes.least[s]:
        return False
    a, b = (last - n, last) if end > 0 else (first, first + n)
    for k in range(a, b):
        lay(sight, strokes.points, k, -1)
    if better(sight, WORTH):
        if end > 0:
            strokes.last[s] = last - n
        else:
            strokes.first[s] = first + n
        return True
    for k in range(a, b):
        lay(sight, strokes.points, k, 1)
    forget(sight)
    return False


@leaf
def _lengthen(sight: Sight, strokes: _Strokes, ground: _Ground, s: int, end: int, n: int) -> bool:
    """Add n steps along the field to the end (1) or the beginning (−1)."""
    first, last, points = strokes.first[s], strokes.last[s], strokes.points
    at = last if end > 0 else first
    room = strokes.slots[s + 1] - 1 - last if end > 0 else first - strokes.slots[s]
    if room < n or last - first + n > strokes.most[s]:
        return False
    ux, uy = points[at, 0] - points[at - end, 0], points[at, 1] - points[at - end, 1]
    norm = np.sqrt(ux * ux + uy * uy)
    if norm == 0.0:
        return False
    ux, uy = ux / norm, uy / norm
    ax, ay, _ = sample(ground.directions, ground.spacing, True, points[at, 0], points[at, 1], ux, uy)
    if ux * ax + uy * ay < STRAIGHT:
        return False
    _grow(ground, points, at, end, n, ux, uy)
    far = at + end * n
    if points[far, 0] == points[far - end, 0] and points[far, 1] == points[far - end, 1]:
        return False
    a, b = (at, far) if end > 0 else (far, at)
    for k in range(a, b):
        lay(sight, points, k, 1)
    if better(sight, WORTH):
        if end > 0:
            strokes.last[s] = far
        else:
            strokes.first[s] = far
        return True
    for k in range(a, b):
        lay(sight, points, k, -1)
    forget(sight)
    return False


@leaf
def _shift(sight: Sight, strokes: _Strokes, ground: _Ground, s: int, dx: float, dy: float) -> bool:
    """Move a stroke."""
    first, last = strokes.first[s], strokes.last[s]
    points = strokes.points
    for k in range(first, last + 1):
        if not (0.0 <= points[k, 0] + dx <= ground.right and 0.0 <= points[k, 1] + dy <= ground.bottom):
            return False
    for k in range(first, last):
        lay(sight, points, k, -1)
    for k in range(first, last + 1):
        points[k, 0] += dx
        points[k, 1] += dy
    for k in range(first, last):
        lay(sight, points, k, 1)
    if better(sight, WORTH):
        return True
    for k in range(first, last):
        lay(sight, points, k, -1)
    for k in range(first, last + 1):
        points[k, 0] -= dx
        points[k, 1] -= dy
    for k in range(first, last):
        lay(sight, points, k, 1)
    forget(sight)
    return False
