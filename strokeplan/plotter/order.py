"""The order and direction in which a pen draws strokes: few lifts first, then little travel with the pen up.

A stroke is its two ends. Ends are joined to a first tour (`joining`), which 2-opt and Or-opt moves over lists of
nearest ends improve until none is left that pays (`moves`). Where the pen may cross a gap without lifting, a lift
counts as so much travel: the same moves then save lifts before they save millimetres. Groups (a layer and its pen)
are drawn one after the other, each from where the last one ended.

Known limits: a closed stroke counts as the point at which it begins; `seat` turns it afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan.errors import InputError
from strokeplan.jit import kernel
from strokeplan.plotter.joining import ENTRY, EXIT, NEIGHBOURS, nearest, roles, shaken, tour_of
from strokeplan.plotter.moves import Price, cost, improved

SAME_MM = 1e-9
"""Points that are all nearer than this to each other are one."""


@dataclass(frozen=True, slots=True)
class Tour:
    """Strokes in the order of drawing (n,), and whether each is drawn from its last point to its first."""

    index: NDArray[np.int64]
    reversed: NDArray[np.bool_]


def order(
    ends: NDArray[np.float64],
    groups: ArrayLike | None = None,
    *,
    start: tuple[float, float] = (0.0, 0.0),
    one_way: ArrayLike | None = None,
    tolerance: float = 0.0,
    lift: float = 0.0,
) -> Tour:
    """A short tour through all strokes.

    ends       (n, 2, 2) mm: first and last point of each stroke.
    groups     (n,) integers: strokes of a group are drawn together, groups in the order in which they first appear.
    start      where the pen is before the first stroke.
    one_way    (n,) strokes that may not be drawn backwards; none by default.
    tolerance  mm: gaps no longer than this are crossed without a lift.
    lift       mm of travel that take as long as lifting and lowering the pen.

    Raises InputError if an end is not finite, or a column does not fit.
    """
    ends, fixed = _check(ends, one_way, tolerance, lift)
    by_group, bounds = _sort(groups, len(ends))
    index, flipped = np.empty(len(ends), np.int64), np.empty(len(ends), np.bool_)
    at = np.array(start, np.float64)
    for a, b in pairwise(bounds):
        members = by_group[a:b][_along_a_curve(ends[by_group[a:b], 0])]
        found, flipped[a:b] = _tour(ends[members], fixed[members], at, float(tolerance), float(lift))
        index[a:b] = members[found]
        if b > a:
            at = ends[index[b - 1], 0 if flipped[b - 1] else 1]
    return Tour(index, flipped)


def keep_order(
    ends: NDArray[np.float64],
    *,
    start: tuple[float, float] = (0.0, 0.0),
    one_way: ArrayLike | None = None,
    tolerance: float = 0.0,
    lift: float = 0.0,
) -> Tour:
    """The strokes as they come (wet paint), each in the direction that makes the whole way cheapest.

    Exact, by dynamic programming over the two directions of each stroke. Arguments as for `order`.
    """
    ends, fixed = _check(ends, one_way, tolerance, lift)
    flipped = _directions(ends, fixed, np.array(start, np.float64), float(tolerance), float(lift))
    return Tour(np.arange(len(ends)), flipped)


def merge(
    ends: NDArray[np.float64], tour: Tour, groups: ArrayLike | None = None, *, tolerance: float = 0.0
) -> NDArray[np.int64]:
    """Where the pen lifts: the strokes tour.index[starts[j]:starts[j + 1]] are one chain, drawn without a lift.

    Returns starts (m + 1,). Strokes follow without a lift if the gap between them is at most `tolerance` mm
    and both are of one group.
    """
    way = directed(ends, tour)
    apart = np.hypot(*(way[1:, 0] - way[:-1, 1]).T) > tolerance
    if groups is not None:
        member = np.asarray(groups)[tour.index]
        apart |= member[1:] != member[:-1]
    n = len(way)
    return np.concatenate([[0], np.flatnonzero(apart) + 1, [n]]) if n else np.zeros(1, np.int64)


def directed(ends: NDArray[np.float64], tour: Tour) -> NDArray[np.float64]:
    """The ends (n, 2, 2) in the order and direction of drawing."""
    way = ends[tour.index]
    return np.where(tour.reversed[:, None, None], way[:, ::-1], way)


def travel(ends: NDArray[np.float64], tour: Tour, start: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.float64]:
    """(n,) mm from where the pen is to each stroke of the tour."""
    way = directed(ends, tour)
    before = np.concatenate([np.array([start], np.float64), way[:-1, 1]])
    gaps: NDArray[np.float64] = np.hypot(*(way[:, 0] - before).T)
    return gaps


def seat(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    tour: Tour,
    start: tuple[float, float] = (0.0, 0.0),
) -> NDArray[np.int64]:
    """Where each closed stroke best begins, given the strokes before and after it.

    points (p, 2), starts (n + 1,): the polylines. A stroke is closed if it ends where it began. Returns (n,)
    the vertex at which each stroke of the tour begins, counted from its first; 0 for open ones.
    """
    return _seat(points, starts, tour.index, tour.reversed, np.array(start, np.float64))


def _check(
    ends: NDArray[np.float64], one_way: ArrayLike | None, tolerance: float, lift: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    ends = np.ascontiguousarray(ends, dtype=np.float64)
    if ends.ndim != 3 or ends.shape[1:] != (2, 2):
        raise InputError(f"ends are {ends.shape}, must be (n, 2, 2): two points for each stroke")
    bad = np.flatnonzero(~np.isfinite(ends).all(axis=(1, 2)))
    if len(bad):
        raise InputError(f"stroke {bad[0]} has an end that is no number: {ends[bad[0]].tolist()}")
    if not (0 <= tolerance < np.inf and 0 <= lift < np.inf):
        raise InputError(f"tolerance {tolerance} and lift {lift} must be lengths in mm, 0 or more")
    fixed = np.zeros(len(ends), np.bool_) if one_way is None else np.asarray(one_way, np.bool_)
    if fixed.shape != (len(ends),):
        raise InputError(f"one_way is {fixed.shape}, must have one value for each of {len(ends)} strokes")
    return ends, fixed


def _sort(groups: ArrayLike | None, n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Strokes by group, as the groups first appear, and where each group begins."""
    if groups is None:
        return np.arange(n), np.array([0, n])
    members = np.asarray(groups)
    if members.shape != (n,):
        raise InputError(f"groups are {members.shape}, must have one value for each of {n} strokes")
    _, first, inverse = np.unique(members, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))[inverse]
    by_group = np.argsort(rank, kind="stable")
    return by_group, np.concatenate([[0], np.cumsum(np.bincount(rank, minlength=len(first)))])


def _along_a_curve(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Points (n, 2) in the order of a Z curve (Morton): what is near is then near in memory as well."""
    if not len(points):
        return np.empty(0, np.int64)
    low = points.min(axis=0)
    span = float((points - low).max())
    cell = ((points - low) * (65535 / span) if span > SAME_MM else np.zeros_like(points)).astype(np.uint64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cell = (cell | (cell << np.uint64(shift))) & np.uint64(mask)
    return np.argsort(cell[:, 0] | (cell[:, 1] << np.uint64(1)), kind="stable")


def _tour(
    ends: NDArray[np.float64], one_way: NDArray[np.bool_], start: NDArray[np.float64], tolerance: float, lift: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Strokes of one group. Node 2s + e is end e of stroke s; one stroke more leads from nowhere to the start."""
    nodes = np.concatenate([ends.reshape(-1, 2), [start, start]])
    fixed = np.append(one_way, True)
    nowhere = len(nodes) - 2
    role = roles(fixed)
    points = shaken(nodes)
    exits, entries = np.flatnonzero(role != ENTRY), np.flatnonzero(role[:nowhere] != EXIT)
    near = np.full((len(nodes), NEIGHBOURS), -1, np.int32)
    near[exits] = nearest(points, exits, entries, np.arange(len(nodes)) ^ 1, NEIGHBOURS)
    tour = tour_of(points, role, near, nowhere, tolerance if lift > 0 else 0.0)
    return improved(tour, Price(nodes, nowhere, tolerance, lift), near, fixed)


@kernel
def _directions(
    ends: NDArray[np.float64], fixed: NDArray[np.bool_], start: NDArray[np.float64], tolerance: float, lift: float
) -> NDArray[np.bool_]:
    n = len(ends)
    nodes = np.concatenate((ends.copy().reshape(2 * n, 2), start.reshape(1, 2)))
    price = Price(nodes, -1, tolerance, lift)
    came = np.zeros((n, 2), np.bool_)
    forward, backward = 0.0, np.inf  # cheapest way to the exit of the stroke before, by its direction
    for k in range(n):
        best0, best1 = np.inf, np.inf
        for flip in range(2):
            exit_before = 2 * n if k == 0 else 2 * k - 1 - flip
            so_far = backward if flip else forward
            to0 = so_far + cost(price, exit_before, 2 * k)
            to1 = so_far + cost(price, exit_before, 2 * k + 1)
            if to0 < best0:
                best0, came[k, 0] = to0, flip == 1
            if to1 < best1 and not fixed[k]:
                best1, came[k, 1] = to1, flip == 1
        forward, backward = best0, best1
    flipped = np.empty(n, np.bool_)
    flip = 1 if backward < forward else 0
    for k in range(n - 1, -1, -1):
        flipped[k] = flip == 1
        flip = 1 if came[k, flip] else 0
    return flipped


@kernel
def _seat(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    index: NDArray[np.int64],
    flipped: NDArray[np.bool_],
    start: NDArray[np.float64],
) -> NDArray[np.int64]:
    begins = np.zeros(len(index), np.int64)
    x, y = start[0], start[1]
    for k in range(len(index)):
        a, b = starts[index[k]], starts[index[k] + 1] - 1
        last = a if flipped[k] else b
        if b - a > 1 and points[a, 0] == points[b, 0] and points[a, 1] == points[b, 1]:
            best = np.inf
            after = index[k + 1] if k + 1 < len(index) else -1
            behind = (starts[after + 1] - 1 if flipped[k + 1] else starts[after]) if after >= 0 else -1
            for p in range(a, b):
                way = np.sqrt((points[p, 0] - x) ** 2 + (points[p, 1] - y) ** 2)
                if behind >= 0:
                    way += np.sqrt((points[p, 0] - points[behind, 0]) ** 2 + (points[p, 1] - points[behind, 1]) ** 2)
                if way < best:
                    best, last = way, p
            begins[k] = last - a
        x, y = points[last, 0], points[last, 1]
    return begins
