"""Strokes of a layer that meet become one: what the paper leaves to future work on overlap.

Two strokes are candidates if they cross, or an end of one lies within half a width of the other; if they run in
nearly the same direction there; and if their widths and colours are alike. The merged stroke goes the longest way
through both: from an end of one to the meeting, and on to an end of the other, changing over along a straight line
that begins and ends one width off the meeting. What it leaves of the two (the ends beyond a crossing) must be
covered by it but for a small part, or both stay as they are. Merged strokes merge again, nearest colours first.

The merged stroke is laid where the larger of the two lay, because least changes so: only the smaller one comes to
lie above, or below, what was painted between the two.

Strokes are compared at points half a width apart, in buckets of squares as wide as the brush, so that time grows
with the length of all strokes. A curve is fitted once, when all its parts are known: it strays from their polylines
by the tolerances of one fit, however many they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import unpack
from strokeplan.curves import fit_tract, point, subdivisions
from strokeplan.jit import kernel, leaf
from strokeplan.painting import Brush, LayerStrokes

SAME_WIDTH = 1.1
"""Widths of strokes that merge differ by no more than this factor."""
MOST_TURN = cos(radians(25))
"""Cosine of the largest angle between two strokes where they meet, and to the line from one to the other."""
LOST = 0.05
"""A merged stroke may leave this part of its own area uncovered of the strokes that it stands for."""
LONGEST = 2.0
"""No merged stroke is longer than this many times the longest tract of its layer."""
ROUNDS = 16
"""Times that one stroke may merge."""
FLATTEN_SHARE = 0.25
"""Points along a stroke are so near that their chords keep within this part of the fit's tolerance."""


class _Lines(NamedTuple):
    """Polylines of strokes: points (m, 2), where each begins, its length up to each point, and directions there."""

    points: NDArray[np.float64]
    first: NDArray[np.int64]
    arc: NDArray[np.float64]
    direction: NDArray[np.float64]


class _Meetings(NamedTuple):
    """Where strokes meet: for each pair the one that is followed first and last, and the points of the meeting.

    Points are counted along the way: from the end of a stroke if it is followed backwards.
    """

    before: NDArray[np.int64]
    after: NDArray[np.int64]
    leave: NDArray[np.int64]
    enter: NDArray[np.int64]
    flip_before: NDArray[np.bool_]
    flip_after: NDArray[np.bool_]


@dataclass(slots=True)
class _Sheet:
    """The strokes in work; a stroke that has been merged into another has no line."""

    lines: list[NDArray[np.float64] | None]
    widths: NDArray[np.float64]
    colours: NDArray[np.float64]
    areas: NDArray[np.float64]
    merged: NDArray[np.bool_]


def merge(strokes: LayerStrokes, brush: Brush, alike: float) -> LayerStrokes:
    """The strokes of one layer, those that meet in colours nearer than the RGB distance `alike` merged.

    strokes   in the order in which they are painted, which is that of the result; not changed.
    brush     the layer's: its length bounds merged strokes, its tolerances their curves.

    Merged strokes have the mean colour and width of their parts, weighted by area, and end where parts ended.
    """
    if len(strokes.counts) < 2:
        return strokes
    sheet = _spread(strokes, brush)
    fresh = np.ones(len(strokes.counts), np.bool_)
    for _ in range(ROUNDS):
        fresh = _merge_once(sheet, fresh, LONGEST * brush.length, alike)
        if not fresh.any():
            break
    return _gather(sheet, strokes, brush)


def _spread(strokes: LayerStrokes, brush: Brush) -> _Sheet:
    points, first = _flatten(strokes.points, strokes.counts, strokes.widths, FLATTEN_SHARE * brush.fit_tolerance)
    edges = np.hypot(*np.diff(points, axis=0, prepend=points[:1]).T)
    edges[first[:-1]] = 0.0
    lengths = np.add.reduceat(edges, first[:-1])
    n = len(strokes.counts)
    return _Sheet(
        [points[first[k] : first[k + 1]] for k in range(n)],
        strokes.widths.copy(),
        unpack(strokes.colours).astype(np.float64),
        strokes.widths * lengths + 0.25 * pi * strokes.widths**2,
        np.zeros(n, np.bool_),
    )


def _merge_once(sheet: _Sheet, fresh: NDArray[np.bool_], longest: float, alike: float) -> NDArray[np.bool_]:
    """Merge every stroke with at most one other; return which strokes are merged ones.

    Only pairs with a stroke that is `fresh` are looked at: the others were found not to merge before.
    """
    alive = np.array([k for k, line in enumerate(sheet.lines) if line is not None])
    parts = [line for line in sheet.lines if line is not None]
    lines = _measure(parts)
    widths, colours = sheet.widths[alive], sheet.colours[alive]
    pairs = _pairs(lines, *_find(lines, widths, colours, fresh[alive], alike), longest, colours)
    busy = np.zeros(len(alive), np.bool_)
    new = np.zeros(len(fresh), np.bool_)
    for before, after, leave, enter, flip_before, flip_after in zip(*pairs, strict=True):
        if busy[before] or busy[after]:
            continue
        i, j = alive[before], alive[after]
        width = np.average(sheet.widths[[i, j]], weights=sheet.areas[[i, j]])
        way = _follow(parts[before], parts[after], leave, enter, flip_before, flip_after, width, longest)
        if len(way) == 0:
            continue
        busy[before] = busy[after] = True
        gone, stays = sorted((i, j), key=lambda k: (sheet.areas[k], k))
        sheet.colours[stays] = np.average(sheet.colours[[i, j]], axis=0, weights=sheet.areas[[i, j]])
        sheet.widths[stays] = width
        sheet.areas[stays] += sheet.areas[gone]
        sheet.lines[stays], sheet.lines[gone] = way, None
        sheet.merged[stays] = new[stays] = True
    return new


def _measure(parts: list[NDArray[np.float64]]) -> _Lines:
    points = np.concatenate(parts)
    first = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    arc, direction = _along(points, first)
    return _Lines(points, first, arc, direction)


def _find(
    lines: _Lines,
    widths: NDArray[np.float64],
    colours: NDArray[np.float64],
    fresh: NDArray[np.bool_],
    alike: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The points (m, 2) at which two strokes that may merge meet, and the strokes (m, 2)."""
    # The starts of two crossing edges, each no longer than half a width, are at most a width apart.
    squares = np.floor(lines.points / widths.max()).astype(np.int64)
    buckets = 1 << len(squares).bit_length()
    bucket = _bucket(squares[:, 0], squares[:, 1], buckets)
    order = np.argsort(bucket, kind="stable")
    starts = np.searchsorted(bucket[order], np.arange(buckets + 1))
    stroke = np.repeat(np.arange(len(widths)), np.diff(lines.first))
    return _meet(lines, stroke, widths, colours, fresh, squares, order, starts, alike * alike)


def _pairs(
    lines: _Lines,
    meetings: NDArray[np.int64],
    strokes: NDArray[np.int64],
    longest: float,
    colours: NDArray[np.float64],
) -> _Meetings:
    """One meeting for each pair, the one with the longest way; pairs of the nearest colours first."""
    a, b = strokes.T
    lengths = lines.arc[lines.first[1:] - 1]
    against = np.sum(lines.direction[meetings[:, 0]] * lines.direction[meetings[:, 1]], axis=1) < 0
    at_a, at_b = lines.arc[meetings].T
    at_b = np.where(against, lengths[b] - at_b, at_b)
    ways = np.stack([at_a + lengths[b] - at_b, at_b + lengths[a] - at_a])
    way, a_first = ways.max(axis=0), ways[0] >= ways[1]
    best = np.lexsort((meetings[:, 1], meetings[:, 0], -way, b, a))
    once = np.ones(len(best), np.bool_)
    once[1:] = (a[best][1:] != a[best][:-1]) | (b[best][1:] != b[best][:-1])
    best = best[once]
    best = best[way[best] <= longest]
    distance = np.sum((colours[a[best]] - colours[b[best]]) ** 2, axis=1)
    best = best[np.argsort(distance, kind="stable")]

    a, b, against, a_first = a[best], b[best], against[best], a_first[best]
    counts = np.diff(lines.first)
    k_a, k_b = meetings[best, 0] - lines.first[a], meetings[best, 1] - lines.first[b]
    k_b = np.where(against, counts[b] - 1 - k_b, k_b)
    none = np.zeros(len(a), np.bool_)
    return _Meetings(
        np.where(a_first, a, b),
        np.where(a_first, b, a),
        np.where(a_first, k_a, k_b),
        np.where(a_first, k_b, k_a),
        np.where(a_first, none, against),
        np.where(a_first, against, none),
    )


def _gather(sheet: _Sheet, strokes: LayerStrokes, brush: Brush) -> LayerStrokes:
    """The strokes that are left; those that merged with none keep their curves."""
    left = np.array([k for k, line in enumerate(sheet.lines) if line is not None])
    old = np.split(strokes.points, np.cumsum(strokes.counts)[:-1])
    chains = [
        fit_tract(line, brush.simplify_tolerance, brush.fit_tolerance) if sheet.merged[k] else old[k]
        for k, line in enumerate(sheet.lines)
        if line is not None
    ]
    red, green, blue = np.rint(sheet.colours[left]).astype(np.uint32).T
    return LayerStrokes(
        np.concatenate(chains),
        np.array([len(chain) for chain in chains]),
        sheet.widths[left],
        red << 16 | green << 8 | blue,
    )


@kernel
def _flatten(
    points: NDArray[np.float64], counts: NDArray[np.int64], widths: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points on all strokes, no further apart than half a width and as near as `tolerance` asks, and where each
    stroke's begin."""
    first = np.zeros(len(counts) + 1, np.int64)
    out = np.empty((0, 2))
    for write in (False, True):
        if write:
            out = np.empty((first[-1], 2))
        at = used = 0
        for stroke in range(len(counts)):
            if write:
                out[used, 0], out[used, 1] = points[at, 0], points[at, 1]
            used += 1
            for c in range(at, at + counts[stroke] - 1, 3):
                longest = 0.0
                for k in range(3):
                    longest = max(longest, _distance(points, c + k, points, c + k + 1))
                # A cubic moves at most three times as fast as the longest edge of its control polygon.
                n = max(int(np.ceil(6.0 * longest / widths[stroke])), subdivisions(points, c, tolerance))
                if write:
                    for k in range(n):
                        out[used + k, 0], out[used + k, 1] = point(points, c, (k + 1) / n)
                used += n
            at += counts[stroke]
            first[stroke + 1] = used
    return out, first


@leaf
def _distance(a: NDArray[np.float64], i: int, b: NDArray[np.float64], j: int) -> float:
    """Between the points a[i] and b[j]."""
    return float(np.sqrt((a[i, 0] - b[j, 0]) ** 2 + (a[i, 1] - b[j, 1]) ** 2))


@kernel
def _along(points: NDArray[np.float64], first: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Length of each polyline up to its points, and unit directions there; 0 where it stands still."""
    arc, direction = np.zeros(len(points)), np.zeros((len(points), 2))
    for line in range(len(first) - 1):
        for k in range(first[line], first[line + 1]):
            a, b = max(k - 1, first[line]), min(k + 1, first[line + 1] - 1)
            if k > first[line]:
                arc[k] = arc[k - 1] + _distance(points, k - 1, points, k)
            length = _distance(points, a, points, b)
            if length > 0.0:
                direction[k, 0] = (points[b, 0] - points[a, 0]) / length
                direction[k, 1] = (points[b, 1] - points[a, 1]) / length
    return arc, direction


@kernel
def _bucket(i: NDArray[np.int64], j: NDArray[np.int64], buckets: int) -> NDArray[np.int64]:
    """The bucket of each square (i, j); other squares may share it. `buckets` is a power of two."""
    return (i * 73856093 ^ j * 19349663) & (buckets - 1)


@kernel
def _meet(
    lines: _Lines,
    stroke: NDArray[np.int64],
    widths: NDArray[np.float64],
    colours: NDArray[np.float64],
    fresh: NDArray[np.bool_],
    squares: NDArray[np.int64],
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    alike2: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Meetings of strokes that may merge as pairs of points, and their strokes; the same may be found twice."""
    points, first = lines.points, lines.first
    meetings, met = np.empty((1024, 2), np.int64), np.empty((1024, 2), np.int64)
    found = 0
    mask = len(starts) - 2
    for p in range(len(points)):
        a = stroke[p]
        if not fresh[a]:
            continue
        p_ends = p == first[a] or p == first[a + 1] - 1
        for di in range(-1, 2):
            for dj in range(-1, 2):
                bucket = ((squares[p, 0] + di) * 73856093 ^ (squares[p, 1] + dj) * 19349663) & mask
                for k in range(starts[bucket], starts[bucket + 1]):
                    q = order[k]
                    b = stroke[q]
                    if b == a or (fresh[b] and b < a):
                        continue
                    wide, narrow = max(widths[a], widths[b]), min(widths[a], widths[b])
                    if wide > SAME_WIDTH * narrow:
                        continue
                    dr, dg, db = (
                        colours[a, 0] - colours[b, 0],
                        colours[a, 1] - colours[b, 1],
                        colours[a, 2] - colours[b, 2],
                    )
                    if dr * dr + dg * dg + db * db >= alike2:
                        continue
                    direction = lines.direction
                    if abs(direction[p, 0] * direction[q, 0] + direction[p, 1] * direction[q, 1]) < MOST_TURN:
                        continue
                    q_ends = q == first[b] or q == first[b + 1] - 1
                    near = (p_ends or q_ends) and _distance(points, p, points, q) <= 0.5 * narrow
                    inside = p + 1 < first[a + 1] and q + 1 < first[b + 1]
                    if near or (inside and _cross(points, p, q)):
                        if found == len(meetings):
                            meetings, met = np.concatenate((meetings, meetings)), np.concatenate((met, met))
                        meetings[found, 0], meetings[found, 1] = p, q
                        met[found, 0], met[found, 1] = a, b
                        found += 1
    return meetings[:found].copy(), met[:found].copy()


@leaf
def _cross(points: NDArray[np.float64], p: int, q: int) -> bool:
    """Whether the edges p – p + 1 and q – q + 1 cross; those that only touch do not."""
    return _side(points, p, q) * _side(points, p, q + 1) < 0.0 and _side(points, q, p) * _side(points, q, p + 1) < 0.0


@leaf
def _side(points: NDArray[np.float64], edge: int, k: int) -> float:
    """On which side of the line through an edge a point lies, by its sign."""
    dx, dy = points[edge + 1, 0] - points[edge, 0], points[edge + 1, 1] - points[edge, 1]
    return float(dx * (points[k, 1] - points[edge, 1]) - dy * (points[k, 0] - points[edge, 0]))


@kernel
def _follow(
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    leave: int,
    enter: int,
    flip_before: bool,
    flip_after: bool,
    width: float,
    longest: float,
) -> NDArray[np.float64]:
    """Along `before` to its point `leave` and from the point `enter` on along `after`; empty if that will not do."""
    a = before[::-1].copy() if flip_before else before.copy()
    b = after[::-1].copy() if flip_after else after.copy()
    i, j = leave, enter
    while i > 0 and _distance(a, i, a, leave) < width:
        i -= 1
    while j < len(b) - 1 and _distance(b, j, b, enter) < width:
        j += 1
    bridge = _distance(a, i, b, j)
    none = np.empty((0, 2))
    if bridge == 0.0 or not (_turns_little(a, i, a, i, b, j) and _turns_little(b, j, a, i, b, j)):
        return none
    steps = int(np.ceil(bridge / (0.5 * width)))
    way = np.empty((i + steps + len(b) - j, 2))
    way[: i + 1] = a[: i + 1]
    for k in range(1, steps):
        t = k / steps
        for axis in range(2):
            way[i + k, axis] = (1.0 - t) * a[i, axis] + t * b[j, axis]
    way[i + steps :] = b[j:]
    length = 0.0
    for k in range(1, len(way)):
        length += _distance(way, k - 1, way, k)
    if length > longest:
        return none
    may = LOST * length * width
    return way if _lost(a, i, len(a), way, width) + _lost(b, 0, j, way, width) <= may else none


@leaf
def _turns_little(
    line: NDArray[np.float64], k: int, a: NDArray[np.float64], i: int, b: NDArray[np.float64], j: int
) -> bool:
    """Whether the line from a[i] to b[j] runs nearly as a polyline does at its point k."""
    m, n = max(k - 1, 0), min(k + 1, len(line) - 1)
    dx, dy, ex, ey = line[n, 0] - line[m, 0], line[n, 1] - line[m, 1], b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]
    return bool(dx * ex + dy * ey >= MOST_TURN * np.sqrt((dx * dx + dy * dy) * (ex * ex + ey * ey)))


@leaf
def _lost(line: NDArray[np.float64], first: int, last: int, way: NDArray[np.float64], width: float) -> float:
    """Area of the stretch line[first:last] of a stroke that the stroke along `way` leaves uncovered.

    Of a section across the one, the other leaves as much as they are apart.
    """
    lost = 0.0
    for k in range(first, last):
        nearest2 = width * width
        for m in range(len(way) - 1):
            dx, dy = way[m + 1, 0] - way[m, 0], way[m + 1, 1] - way[m, 1]
            px, py = line[k, 0] - way[m, 0], line[k, 1] - way[m, 1]
            length2 = dx * dx + dy * dy
            t = min(max((px * dx + py * dy) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
            nearest2 = min(nearest2, (px - t * dx) ** 2 + (py - t * dy) ** 2)
        section = 0.0
        if k > 0:
            section += 0.5 * _distance(line, k - 1, line, k)
        if k + 1 < len(line):
            section += 0.5 * _distance(line, k, line, k + 1)
        lost += np.sqrt(nearest2) * section
    return lost
