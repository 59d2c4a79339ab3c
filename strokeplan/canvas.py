"""The planning raster: the picture as painted so far, and the footprint of a stroke on it.

Photo and canvas are (h, w) uint32 images of packed 0xRRGGBB pixels, 4 bytes a pixel each. A footprint is
the set of pixels whose centre lies within half a brush width of the curve: no antialiasing, because the
planner compares means over cells and overpaints most of what it lays. The files that users see are
rendered elsewhere, from the curves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import point, subdivisions
from strokeplan.jit import inlined, leaf

FLATTEN_PX = 0.2
"""Chords of a footprint lie this close to their arc: well below the half pixel that decides a pixel."""
FLATTEN_SHARE = 0.01
"""Or within this part of the brush's width, if that is more: long chords save painting joints twice."""

Packed = NDArray[np.uint32]


def pack(rgb: NDArray[np.uint8]) -> Packed:
    """(h, w, 3) uint8 → (h, w) uint32 pixels 0xRRGGBB."""
    packed = rgb[..., 0].astype(np.uint32)
    for channel in (1, 2):
        packed <<= 8
        packed |= rgb[..., channel]
    return packed


def unpack(packed: Packed) -> NDArray[np.uint8]:
    """(…) uint32 pixels 0xRRGGBB → (…, 3) uint8."""
    return np.stack([packed >> 16, packed >> 8, packed], axis=-1).astype(np.uint8)


@leaf
def mean_distance(
    photo: Packed, canvas: Packed, top: int, bottom: int, left: int, right: int, stride: int, photo_gain: float
) -> float:
    """Mean Euclidean RGB distance (0…441) over the pixels of a window, every `stride`-th of them.

    The photo's values are multiplied by `photo_gain`. NaN for an empty window.
    """
    total, count = 0.0, 0
    for i in range(top, bottom, stride):
        for j in range(left, right, stride):
            a, b = np.int64(photo[i, j]), np.int64(canvas[i, j])
            dr = photo_gain * (a >> 16) - (b >> 16)
            dg = photo_gain * ((a >> 8) & 255) - ((b >> 8) & 255)
            db = photo_gain * (a & 255) - (b & 255)
            total += np.sqrt(dr * dr + dg * dg + db * db)
            count += 1
    return total / count


@leaf
def paint_chain(
    canvas: Packed, chain: NDArray[np.float64], at: int, pieces: int, width: float, round_cap: bool, colour: np.uint32
) -> None:
    """Paint the chain of `pieces` cubics that starts at chain[at] with a round brush of `width` pixels."""
    radius = 0.5 * width
    tolerance = max(FLATTEN_PX, FLATTEN_SHARE * width)
    ax, ay = chain[at, 0], chain[at, 1]
    round_a = round_cap
    for piece in range(pieces):
        c = at + 3 * piece
        n = subdivisions(chain, c, tolerance)
        for k in range(1, n + 1):
            bx, by = point(chain, c, k / n)
            # Inner joints are round whatever the caps; painted once, as the end of the edge before them.
            round_b = round_cap or k < n or piece < pieces - 1
            top, bottom = _edge_rows(canvas.shape[0], ay, by, radius)
            dx, dy, length = _edge_direction(ax, ay, bx, by)
            for i in range(top, bottom):
                first, last = _edge_span(canvas.shape[1], i, ax, ay, bx, by, dx, dy, length, radius, round_a, round_b)
                canvas[i, first:last] = colour
            ax, ay, round_a = bx, by, False


@leaf
def footprint(
    stamp: NDArray[np.int32],
    mark: int,
    spans: NDArray[np.int32],
    chain: NDArray[np.float64],
    at: int,
    pieces: int,
    width: float,
    round_cap: bool,
    pixels: NDArray[np.int32],
) -> int:
    """Write the pixels (row, column) that `paint_chain` would paint to `pixels`, each once; return how many.

    `stamp` is an image of numbers of which none is `mark`; the footprint's pixels get it. What does not fit into
    `pixels` is left out. `spans` (rows, 3) is room to remember the spans that a wide brush,
    whose edges cover the same pixels many times over, has had already; no row of it ends in `mark`.
    """
    radius = 0.5 * width
    tolerance = max(FLATTEN_PX, FLATTEN_SHARE * width)
    ax, ay = chain[at, 0], chain[at, 1]
    round_a = round_cap
    count = 0
    for piece in range(pieces):
        c = at + 3 * piece
        n = subdivisions(chain, c, tolerance)
        for k in range(1, n + 1):
            bx, by = point(chain, c, k / n)
            round_b = round_cap or k < n or piece < pieces - 1
            top, bottom = _edge_rows(stamp.shape[0], ay, by, radius)
            dx, dy, length = _edge_direction(ax, ay, bx, by)
            for i in range(top, bottom):
                first, last = _edge_span(stamp.shape[1], i, ax, ay, bx, by, dx, dy, length, radius, round_a, round_b)
                if first >= last:
                    continue
                left, right = _unseen(spans, mark, i, first, last)
                for begin, end in ((first, left), (right, last)):
                    for j in range(begin, end):
                        if stamp[i, j] != mark and count < len(pixels):
                            stamp[i, j] = mark
                            pixels[count, 0], pixels[count, 1] = i, j
                            count += 1
            ax, ay, round_a = bx, by, False
    return count


@inlined
def _unseen(spans: NDArray[np.int32], mark: int, i: int, first: int, last: int) -> tuple[int, int]:
    """Of the span first … last − 1 of row i, the ends (left, right) of what a stroke has not had: first … left − 1
    and right … last − 1. The row remembers the span, together with the one before if the two touch."""
    low, high = spans[i, 0], spans[i, 1]
    if spans[i, 2] != mark or last < low or first > high:
        spans[i, 0], spans[i, 1], spans[i, 2] = first, last, mark
        return last, last
    spans[i, 0], spans[i, 1] = min(low, first), max(high, last)
    return max(min(low, last), first), min(max(high, first), last)


@inlined
def _edge_rows(rows: int, ay: float, by: float, radius: float) -> tuple[int, int]:
    """The rows (first, last + 1) of pixels whose centres lie within `radius` of the height of an edge."""
    top = max(int(np.ceil(min(ay, by) - radius - 0.5)), 0)
    return top, min(int(np.floor(max(ay, by) + radius - 0.5)) + 1, rows)


@inlined
def _edge_direction(ax: float, ay: float, bx: float, by: float) -> tuple[float, float, float]:
    """Unit vector and length of an edge; (0, 0) if it has none."""
    dx, dy = bx - ax, by - ay
    length = np.sqrt(dx * dx + dy * dy)
    if length > 0.0:
        dx, dy = dx / length, dy / length
    return dx, dy, length


@inlined
def _edge_span(
    cols: int,
    i: int,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    dx: float,
    dy: float,
    length: float,
    radius: float,
    round_a: bool,
    round_b: bool,
) -> tuple[int, int]:
    """The pixels (first, last + 1) of row i in the rectangle of half width `radius` around a–b, and in the
    discs at its ends that are asked for. `dx`, `dy`, `length` are the edge's direction."""
    y = i + 0.5
    left, right = 1e30, -1e30
    if round_a and abs(y - ay) <= radius:
        half = np.sqrt(radius * radius - (y - ay) ** 2)
        left, right = min(left, ax - half), max(right, ax + half)
    if round_b and abs(y - by) <= radius:
        half = np.sqrt(radius * radius - (y - by) ** 2)
        left, right = min(left, bx - half), max(right, bx + half)
    if length > 0.0:
        # In this row: 0 ≤ along ≤ length and |across| ≤ radius, each a range of x.
        low, high = -1e30, 1e30
        along, across = (y - ay) * dy, (y - ay) * dx
        if dx != 0.0:
            s, e = ax - along / dx, ax + (length - along) / dx
            low, high = max(low, min(s, e)), min(high, max(s, e))
        elif along < 0.0 or along > length:
            low, high = 1.0, 0.0
        if dy != 0.0:
            s, e = ax + (across - radius) / dy, ax + (across + radius) / dy
            low, high = max(low, min(s, e)), min(high, max(s, e))
        elif abs(across) > radius:
            low, high = 1.0, 0.0
        if low <= high:
            left, right = min(left, low), max(right, high)
    if left > right or right < 0.0 or left > cols:
        return 0, 0
    return max(int(np.ceil(left - 0.5)), 0), min(int(np.floor(right - 0.5)) + 1, cols)
