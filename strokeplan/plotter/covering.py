"""What later strokes cover is not drawn: a plotter cannot paint over what lies on the paper.

Every straight segment of a line is what the capsules (capsules.py) of all later strokes leave of it, exactly. Ink
neither hides nor is hidden: lines of ink are meant to cross.

Why this is no overlay of shapely's: those cut a line wherever it crosses itself, as passes of a bundle do in tight
bends, and take seconds for one such line. It is the oracle of the tests.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import flatten_all
from strokeplan.jit import kernel, leaf
from strokeplan.plotter.capsules import Capsules, Grid, capsules_of, grid_of, stretch
from strokeplan.plotter.cutting import rebuilt
from strokeplan.strokes import StrokePlan

LEAST = 1e-9
"""A gap between two capsules that is narrower than this part of a segment is rounding."""


def uncovered(
    lines: StrokePlan,
    source: NDArray[np.int64],
    plan: StrokePlan,
    grown: float,
    tolerance: float,
    shortest: float = 0.0,
) -> tuple[StrokePlan, NDArray[np.int64]]:
    """What is left of `lines` (m strokes) where later strokes of a plan's paint cover them.

    source    (m,) the stroke of the plan that each line draws, rising; those after it cover it.
    grown     by how much a stroke covers more than its own area, to all sides; less if it is below 0.
    shortest  pieces not longer than this are left out.

    Lines that nothing covers keep their curves; the others become polylines no further than `tolerance` from them.
    Returns them, and the stroke of the plan that each draws.
    """
    paint = np.repeat([k.medium == "paint" for k in plan.layers], [k.last - k.first for k in plan.layers])
    capsules = capsules_of(plan, paint, grown, tolerance / 2)
    if not len(lines) or not len(capsules.owner):
        return lines, source
    vertices, begins = flatten_all(lines.points, lines.starts, tolerance / 2)
    own = np.where(paint[source], source, len(plan))
    whole, out, firsts, line = _visible(vertices, begins, own, capsules, grid_of(capsules))
    counts = np.diff(firsts)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(out, axis=0).T))])
    long = way[firsts[1:] - 1] - way[firsts[:-1]] > shortest
    left, of = rebuilt(lines, whole, out[np.repeat(long, counts)], counts[long], line[long])
    return left, source[of]


@kernel
def _visible(
    vertices: NDArray[np.float64],
    begins: NDArray[np.int64],
    own: NDArray[np.int64],
    capsules: Capsules,
    grid: Grid,
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Lines that nothing covers, and of the others the pieces: vertices, where each begins, the line that it is of."""
    whole = np.ones(len(begins) - 1, np.bool_)
    out, firsts, line = np.empty((1024, 2)), np.empty(1024, np.int64), np.empty(1024, np.int64)
    spans = np.empty((64, 2))
    at = pieces = 0
    for i in range(len(begins) - 1):
        before, begun, drawing = at, pieces, False
        for k in range(begins[i], begins[i + 1] - 1):
            spans, count = _hidden(vertices, k, own[i], capsules, grid, spans)
            if count:
                whole[i] = False
            t = 0.0
            for h in range(count + 1):
                to = spans[h, 0] if h < count else 1.0
                if to - t > LEAST or (h == count and t == 0.0):
                    if at + 2 > len(out):
                        out = np.concatenate((out, out))
                    if pieces + 1 >= len(firsts):
                        firsts = np.concatenate((firsts, firsts))
                        line = np.concatenate((line, line))
                    if not (drawing and t == 0.0):
                        firsts[pieces], line[pieces] = at, i
                        pieces += 1
                        out[at] = (1.0 - t) * vertices[k] + t * vertices[k + 1]
                        at += 1
                    out[at] = (1.0 - to) * vertices[k] + to * vertices[k + 1]
                    at += 1
                    drawing = True
                if h < count:
                    drawing = False
                    t = max(t, spans[h, 1])
            if t >= 1.0 - LEAST and count:
                drawing = False
        if whole[i]:
            at, pieces = before, begun
    firsts[pieces] = at
    return whole, out[:at].copy(), firsts[: pieces + 1].copy(), line[:pieces].copy()


@kernel
def _hidden(
    vertices: NDArray[np.float64],
    k: int,
    own: int,
    capsules: Capsules,
    grid: Grid,
    spans: NDArray[np.float64],
) -> tuple[NDArray[np.float64], int]:
    """The stretches of the segment from vertex k that later strokes cover, by where they begin, and how many."""
    px, py = vertices[k, 0], vertices[k, 1]
    dx, dy = vertices[k + 1, 0] - px, vertices[k + 1, 1] - py
    count = 0
    left, right = _cell(min(px, px + dx) - grid.left, grid), _cell(max(px, px + dx) - grid.left, grid)
    top, bottom = _cell(min(py, py + dy) - grid.top, grid), _cell(max(py, py + dy) - grid.top, grid)
    for row in range(max(top, 0), min(bottom, grid.rows - 1) + 1):
        for column in range(max(left, 0), min(right, grid.columns - 1) + 1):
            cell = row * grid.columns + column
            for q in range(grid.first[cell + 1] - 1, grid.first[cell] - 1, -1):
                item = grid.item[q]
                if capsules.owner[item] <= own:
                    break  # in the order of painting: the others lie beneath as well
                low, high = stretch(px, py, dx, dy, capsules, item)
                if low > high:
                    continue
                if low <= 0.0 and high >= 1.0:
                    spans[0, 0], spans[0, 1] = 0.0, 1.0
                    return spans, 1
                if count == len(spans):
                    spans = np.concatenate((spans, spans))
                h = count
                while h > 0 and spans[h - 1, 0] > low:
                    spans[h, 0], spans[h, 1] = spans[h - 1, 0], spans[h - 1, 1]
                    h -= 1
                spans[h, 0], spans[h, 1] = low, high
                count += 1
    return spans, count


@leaf
def _cell(way: float, grid: Grid) -> int:
    return int(np.floor(way / grid.side))
