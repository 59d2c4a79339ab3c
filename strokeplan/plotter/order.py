"""The order and direction in which a pen draws strokes: few lifts first, then little travel with the pen up.

A stroke is its two ends. Ends are matched greedily, nearest pairs first, over a k-d tree (Bentley 1992: the greedy
edge, which starts nearer to the optimum than the nearest neighbour), then 2-opt and Or-opt moves over lists of
nearest ends improve the tour until none is left that pays. A 2-opt move reverses a run of strokes and flips each of
them. Where the pen may cross a gap without lifting, a lift counts as so much travel: the same moves then save lifts
before they save millimetres. Groups (a layer and its pen) are drawn one after the other, each from where the last
one ended.

Time grows as n log n: runs longer than the last of `RUNS` are not turned, which costs little (Johnson, McGeoch 1997).

Known limits: a closed stroke counts as the point at which it begins; `seat` turns it afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan.errors import InputError
from strokeplan.jit import kernel, leaf

NEIGHBOURS = 8
"""Nearest ends that a move may join an end to."""
MATCHES = 5
"""Nearest ends that the greedy edge looks at in one round."""
LEAF = 8
"""Points in a leaf of the k-d tree."""
RUNS = (1_000, 50_000)
"""No move turns a run longer than this: short ones first, which leave little to do for those that cost more."""
SEGMENT = 3
"""Strokes that an Or-opt move takes along at most."""
GAIN = 1e-7
"""A move that saves less (mm) is rounding."""
JITTER = 1e-9
"""Ends are told apart by this part of their extent where they coincide: no point of the tree has many equals."""
_FREE, _ENTRY, _EXIT = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Tour:
    """Strokes in the order of drawing (n,), and whether each is drawn from its last point to its first."""

    index: NDArray[np.int64]
    reversed: NDArray[np.bool_]


class _Route(NamedTuple):
    """A cyclic tour in the work: strokes by position, positions by stroke, and whether a stroke is flipped."""

    order: NDArray[np.int64]
    pos: NDArray[np.int64]
    flip: NDArray[np.int64]


class _Price(NamedTuple):
    """What a pen-up move costs; any move to or from the node `free` costs nothing."""

    nodes: NDArray[np.float64]
    free: int
    tolerance: float
    lift: float


class _Rules(NamedTuple):
    """Strokes that keep their direction, whether there are any, and the longest run that is turned."""

    fixed: NDArray[np.bool_]
    bound: bool
    reach: int


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
    index, flipped = _solve(
        ends[by_group], fixed[by_group], bounds, np.array(start, np.float64), float(tolerance), float(lift)
    )
    return Tour(by_group[index], flipped)


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


@kernel
def _directions(
    ends: NDArray[np.float64], fixed: NDArray[np.bool_], start: NDArray[np.float64], tolerance: float, lift: float
) -> NDArray[np.bool_]:
    n = len(ends)
    nodes = np.concatenate((ends.copy().reshape(2 * n, 2), start.reshape(1, 2)))
    price = _Price(nodes, -1, tolerance, lift)
    came = np.zeros((n, 2), np.bool_)
    forward, backward = 0.0, np.inf  # cheapest way to the exit of the stroke before, by its direction
    for k in range(n):
        best0, best1 = np.inf, np.inf
        for flip in range(2):
            exit_before = 2 * n if k == 0 else 2 * k - 1 - flip
            so_far = backward if flip else forward
            to0 = so_far + _cost(price, exit_before, 2 * k)
            to1 = so_far + _cost(price, exit_before, 2 * k + 1)
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


@kernel
def _solve(
    ends: NDArray[np.float64],
    one_way: NDArray[np.bool_],
    bounds: NDArray[np.int64],
    start: NDArray[np.float64],
    tolerance: float,
    lift: float,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """One tour after the other, each from where the last one ended."""
    n = len(ends)
    index, flipped = np.empty(n, np.int64), np.empty(n, np.bool_)
    x, y = start[0], start[1]
    for g in range(len(bounds) - 1):
        first, last = bounds[g], bounds[g + 1]
        m = last - first
        if m == 0:
            continue
        nodes = np.empty((2 * m + 2, 2))
        nodes[: 2 * m] = ends[first:last].copy().reshape(2 * m, 2)
        nodes[2 * m :, 0] = x
        nodes[2 * m :, 1] = y
        fixed = np.ones(m + 1, np.bool_)
        fixed[:m] = one_way[first:last]
        tour, flip = _tour(nodes, fixed, tolerance, lift)
        for k in range(m):
            index[first + k] = first + tour[k]
            flipped[first + k] = flip[k]
        node = 2 * tour[m - 1] + 1 - flip[m - 1]
        x, y = nodes[node, 0], nodes[node, 1]
    return index, flipped


@kernel
def _tour(
    nodes: NDArray[np.float64], fixed: NDArray[np.bool_], tolerance: float, lift: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Strokes of one group. Node 2s + e is end e of stroke s; the last stroke leads from nowhere to the start."""
    m = len(fixed)
    dummy = m - 1
    bound = False
    for k in range(m - 1):
        if fixed[k]:
            bound = True
    role = np.zeros(2 * m, np.int8)
    for s in range(m):
        if fixed[s]:
            role[2 * s], role[2 * s + 1] = _ENTRY, _EXIT
    if not bound:
        role[2 * dummy] = role[2 * dummy + 1] = _FREE
    shaken = _shaken(nodes)
    targets = np.nonzero(role != _EXIT)[0]
    near = _nearest(shaken, targets[targets != 2 * dummy], role, np.arange(2 * m) ^ 1, NEIGHBOURS)
    tour = _greedy(shaken, role, near, dummy)
    pos = np.empty(m, np.int64)
    flip = np.zeros(m, np.int64)
    route = _Route(tour >> 1, pos, flip)
    for k in range(m):
        flip[tour[k] >> 1] = tour[k] & 1
        pos[tour[k] >> 1] = k
    for reach in RUNS:
        _improve(route, _Price(nodes, 2 * dummy, tolerance, lift), near, _Rules(fixed, bound, reach))
        if reach > m:
            break
    index, flipped = np.empty(m - 1, np.int64), np.empty(m - 1, np.bool_)
    back = flip[dummy]
    for k in range(m - 1):
        at = (pos[dummy] - 1 - k) % m if back else (pos[dummy] + 1 + k) % m
        s = route.order[at]
        index[k] = s
        flipped[k] = flip[s] != back
    return index, flipped


@kernel
def _shaken(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nodes, each moved by a hair: how often one is the nearest of others is then bounded."""
    span = 0.0
    for d in range(2):
        span = max(span, nodes[:, d].max() - nodes[:, d].min())
    out = np.empty_like(nodes)
    for k in range(len(nodes)):
        h = np.uint64(k) * np.uint64(0x9E3779B97F4A7C15)
        for d in range(2):
            h ^= h >> np.uint64(29)
            h *= np.uint64(0xBF58476D1CE4E5B9)
            h ^= h >> np.uint64(32)
            out[k, d] = nodes[k, d] + JITTER * span * (np.float64(h >> np.uint64(11)) / 9007199254740992.0)
    return out


@kernel
def _build(points: NDArray[np.float64], items: NDArray[np.int64]) -> NDArray[np.int8]:
    """Sort items into an implicit k-d tree: a range is halved at its median; the axis stands where it is halved."""
    n = len(items)
    axis = np.zeros(n, np.int8)
    stack = np.empty((64, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, n
    depth = 1
    while depth > 0:
        depth -= 1
        lo, hi = stack[depth, 0], stack[depth, 1]
        if hi - lo <= LEAF:
            continue
        x0 = x1 = points[items[lo], 0]
        y0 = y1 = points[items[lo], 1]
        for k in range(lo + 1, hi):
            x, y = points[items[k], 0], points[items[k], 1]
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
        d = 0 if x1 - x0 >= y1 - y0 else 1
        mid = (lo + hi) // 2
        _select(points, items, lo, hi - 1, mid, d)
        axis[mid] = d
        stack[depth, 0], stack[depth, 1] = lo, mid
        stack[depth + 1, 0], stack[depth + 1, 1] = mid, hi
        depth += 2
    return axis


@leaf
def _select(points: NDArray[np.float64], items: NDArray[np.int64], left: int, right: int, k: int, d: int) -> None:
    """Hoare: the k-th smallest along axis d to its place, smaller ones before it."""
    while left < right:
        pivot = points[items[(left + right) // 2], d]
        i, j = left, right
        while i <= j:
            while points[items[i], d] < pivot:
                i += 1
            while points[items[j], d] > pivot:
                j -= 1
            if i <= j:
                items[i], items[j] = items[j], items[i]
                i += 1
                j -= 1
        if k <= j:
            right = j
        elif k >= i:
            left = i
        else:
            return


@kernel
def _nearest(
    points: NDArray[np.float64], targets: NDArray[np.int64], role: NDArray[np.int8], tail: NDArray[np.int64], k: int
) -> NDArray[np.int32]:
    """For every node that may be an exit the k nearest targets but its own tail, nearest first; −1 fills up."""
    items = targets.copy()
    axis = _build(points, items)
    near = np.full((len(points), k), -1, np.int32)
    stack = np.empty((64, 2), np.int64)
    bounds = np.empty(64)
    d2 = np.empty(k)
    for q in range(len(points)):
        if role[q] == _ENTRY:
            continue
        x, y = points[q, 0], points[q, 1]
        found = 0
        stack[0, 0], stack[0, 1], bounds[0] = 0, len(items), 0.0
        depth = 1
        while depth > 0:
            depth -= 1
            if found == k and bounds[depth] >= d2[k - 1]:
                continue
            lo, hi = stack[depth, 0], stack[depth, 1]
            while hi - lo > LEAF:
                mid = (lo + hi) // 2
                gap = points[q, axis[mid]] - points[items[mid], axis[mid]]
                if gap < 0.0:
                    stack[depth, 0], stack[depth, 1] = mid, hi
                    hi = mid
                else:
                    stack[depth, 0], stack[depth, 1] = lo, mid
                    lo = mid
                bounds[depth] = gap * gap
                depth += 1
            for at in range(lo, hi):
                v = items[at]
                if v == q or v == tail[q]:
                    continue
                dd = (points[v, 0] - x) ** 2 + (points[v, 1] - y) ** 2
                if found < k or dd < d2[k - 1]:
                    j = found if found < k else k - 1
                    while j > 0 and d2[j - 1] > dd:
                        d2[j] = d2[j - 1]
                        near[q, j] = near[q, j - 1]
                        j -= 1
                    d2[j] = dd
                    near[q, j] = v
                    found = min(found + 1, k)
    return near


@kernel
def _greedy(
    shaken: NDArray[np.float64], role: NDArray[np.int8], near: NDArray[np.int32], dummy: int
) -> NDArray[np.int64]:
    """Join the nearest ends, then the nearest of those left over, until one path is left: its entry nodes in order."""
    m = len(role) // 2
    role = role.copy()
    mate = np.full(2 * m, -1, np.int64)
    tail = np.arange(2 * m) ^ 1
    free_end = 2 * dummy
    fragments = m
    taken = np.zeros(2 * m, np.bool_)
    taken[free_end] = True
    first = True
    while fragments > 1:
        if not first:
            live = np.nonzero(~taken & (role != _EXIT))[0]
            masked = role.copy()
            for u in range(2 * m):
                if taken[u]:
                    masked[u] = _ENTRY
            near = _nearest(shaken, live, masked, tail, MATCHES)
        count = 0
        for u in range(2 * m):
            for j in range(min(MATCHES, near.shape[1])):
                if near[u, j] >= 0:
                    count += 1
        us, vs, key = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count)
        count = 0
        for u in range(2 * m):
            for j in range(min(MATCHES, near.shape[1])):
                v = near[u, j]
                if v >= 0 and v != free_end:
                    us[count], vs[count] = u, v
                    key[count] = (shaken[u, 0] - shaken[v, 0]) ** 2 + (shaken[u, 1] - shaken[v, 1]) ** 2
                    count += 1
        for e in np.argsort(key[:count]):
            u, v = us[e], vs[e]
            if taken[u] or taken[v] or tail[u] == v:
                continue
            if role[u] != _FREE and role[u] == role[v]:
                continue
            a, b = tail[u], tail[v]
            taken[u] = taken[v] = True
            mate[u], mate[v] = v, u
            tail[a], tail[b] = b, a
            ra, rb = role[a], role[b]
            if ra != _FREE:
                role[b] = _ENTRY + _EXIT - ra
            elif rb != _FREE:
                role[a] = _ENTRY + _EXIT - rb
            fragments -= 1
        first = False
    tour = np.empty(m, np.int64)
    node = free_end
    for k in range(m):
        tour[k] = node
        node = mate[node ^ 1]
    return tour


@leaf
def _cost(price: _Price, u: int, v: int) -> float:
    nodes = price.nodes
    if u == price.free or v == price.free:
        return 0.0
    d = np.sqrt((nodes[u, 0] - nodes[v, 0]) ** 2 + (nodes[u, 1] - nodes[v, 1]) ** 2)
    return float(d + price.lift if d > price.tolerance else d)


@leaf
def _reverse(route: _Route, i: int, j: int) -> None:
    """Reverse the run of positions i … j (cyclic), or what amounts to the same, all others."""
    order, pos, flip = route.order, route.pos, route.flip
    m = len(order)
    inside = (j - i) % m + 1
    if 2 * inside > m:
        i, j = (j + 1) % m, (i - 1) % m
        inside = m - inside
    for _ in range(inside // 2):
        a, b = order[i], order[j]
        order[i], order[j] = b, a
        pos[a], pos[b] = j, i
        flip[a] ^= 1
        flip[b] ^= 1
        i = i + 1 if i + 1 < m else 0
        j = j - 1 if j > 0 else m - 1
    if inside % 2:
        flip[order[i]] ^= 1


@leaf
def _turn(route: _Route, u: int, w: int) -> None:
    """Turn the run that begins behind node u (as its stroke's exit) and ends with node w."""
    m = len(route.order)
    s, c = u >> 1, w >> 1
    if (1 - (u & 1)) ^ route.flip[s]:
        i, j = route.pos[c], (route.pos[s] - 1) % m
    else:
        i, j = (route.pos[s] + 1) % m, route.pos[c]
    _reverse(route, i, j)


@leaf
def _exit(route: _Route, s: int, back: int) -> int:
    """The node at which stroke s is left, the tour read backwards or not."""
    return int(2 * s + (1 - (route.flip[s] ^ back)))


@leaf
def _entry(route: _Route, s: int, back: int) -> int:
    """The node at which stroke s is entered."""
    return int(2 * s + (route.flip[s] ^ back))


@leaf
def _next(route: _Route, s: int, back: int) -> int:
    """The stroke behind s."""
    at = route.pos[s] + 1 - 2 * back
    m = len(route.order)
    return int(route.order[at - m if at >= m else at + m if at < 0 else at])


@leaf
def _barred(route: _Route, fixed: NDArray[np.bool_], u: int, w: int) -> bool:
    """Whether `_turn` would turn a stroke that keeps its direction (relative to the last stroke, the start)."""
    m = len(route.order)
    s, c = u >> 1, w >> 1
    if (1 - (u & 1)) ^ route.flip[s]:
        i, j = route.pos[c], (route.pos[s] - 1) % m
    else:
        i, j = (route.pos[s] + 1) % m, route.pos[c]
    inside = (j - i) % m + 1
    if (route.pos[m - 1] - i) % m < inside:
        i, inside = (j + 1) % m, m - inside
    for k in range(inside):  # noqa: SIM110
        if fixed[route.order[(i + k) % m]]:
            return True
    return False


@leaf
def _step(
    route: _Route,
    price: _Price,
    near: NDArray[np.int32],
    rules: _Rules,
    s: int,
    back: int,
    touched: NDArray[np.int64],
) -> bool:
    """Make the best move that joins the exit of stroke s to a near end; False if none pays. `touched`: its strokes."""
    bound, fixed = rules.bound, rules.fixed
    u = _exit(route, s, back)
    if u == price.free:
        return False
    b = _next(route, s, back)
    v = _entry(route, b, back)
    removed = _cost(price, u, v)
    best, kind, t5, t6, t3, t4 = GAIN, 0, 0, 0, 0, 0
    for q in range(near.shape[1]):
        w = near[u, q]
        if w < 0:
            break
        g1 = removed - _cost(price, u, w)
        if g1 <= GAIN:
            break
        c = w >> 1
        if c == s or w == v:
            continue
        apart = abs(route.pos[c] - route.pos[s])
        if min(apart, len(route.order) - apart) > rules.reach:
            continue
        if w == _exit(route, c, back):
            n = _next(route, c, back)
            x = _entry(route, n, back)
            g2 = g1 + _cost(price, w, x)
            gain = g2 - _cost(price, v, x)
            if gain > best and not (bound and _barred(route, fixed, u, w)):
                best, kind, t3, t4 = gain, 1, w, x
            d = c
            for _ in range(SEGMENT):
                if d == b or (bound and fixed[d]):
                    break
                p = _next(route, d, 1 - back)
                pe, de = _exit(route, p, back), _entry(route, d, back)
                gain = g2 + _cost(price, pe, de) - _cost(price, de, v) - _cost(price, pe, x)
                if gain > best:
                    best, kind, t3, t4, t5, t6 = gain, 2, w, x, pe, de
                d = p
            a = s
            for _ in range(SEGMENT):
                if a == n or (bound and fixed[a]):
                    break
                p = _next(route, a, 1 - back)
                pe, ae = _exit(route, p, back), _entry(route, a, back)
                gain = g2 + _cost(price, pe, ae) - _cost(price, ae, x) - _cost(price, pe, v)
                if gain > best:
                    best, kind, t3, t4, t5, t6 = gain, 3, w, x, pe, ae
                a = p
        else:
            p0 = _next(route, c, 1 - back)
            pe = _exit(route, p0, back)
            g2 = g1 + _cost(price, pe, w)
            d = c
            for _ in range(SEGMENT):
                if d == s:
                    break
                n = _next(route, d, back)
                de, x = _exit(route, d, back), _entry(route, n, back)
                gain = g2 + _cost(price, de, x) - _cost(price, de, v) - _cost(price, pe, x)
                if gain > best:
                    best, kind, t3, t4, t5, t6 = gain, 4, w, pe, de, x
                d = n
            a = s
            for _ in range(SEGMENT):
                if a == c:
                    break
                p = _next(route, a, 1 - back)
                qe, ae = _exit(route, p, back), _entry(route, a, back)
                gain = g2 + _cost(price, qe, ae) - _cost(price, pe, ae) - _cost(price, qe, v)
                if gain > best:
                    best, kind, t3, t4, t5, t6 = gain, 5, w, pe, qe, ae
                a = p
    if kind == 0:
        return False
    touched[0], touched[1], touched[2], touched[3] = s, b, t3 >> 1, t4 >> 1
    touched[4], touched[5] = s, s
    if kind > 1:
        touched[4], touched[5] = t5 >> 1, t6 >> 1
    if kind == 1:
        _turn(route, u, t3)
    elif kind == 2:  # u|v…pe|de…w|x  →  u|w…de|v…pe|x
        _turn(route, u, t3)
        _turn(route, t6, v)
    elif kind == 3:  # pe|ae…u|v…w|x  →  pe|v…w|u…ae|x
        _turn(route, t5, t3)
        _turn(route, t5, v)
    elif kind == 4:  # u|v…pe|w…de|x  →  u|w…de|v…pe|x
        _turn(route, u, t5)
        _turn(route, u, t3)
        _turn(route, t5, v)
    else:  # qe|ae…u|v…pe|w  →  qe|v…pe|ae…u|w
        _turn(route, t5, t4)
        _turn(route, t5, v)
        _turn(route, t4, t6)
    return True


@kernel
def _improve(route: _Route, price: _Price, near: NDArray[np.int32], rules: _Rules) -> None:
    """Make moves until none pays: strokes whose neighbours changed are looked at again."""
    m = len(route.order)
    if m < 3:
        return
    queue, queued = route.order.copy(), np.ones(m, np.bool_)
    touched = np.empty(6, np.int64)
    head, count = 0, m
    while count > 0:
        s = queue[head]
        head = (head + 1) % m
        count -= 1
        queued[s] = False
        for back in range(2):
            while _step(route, price, near, rules, s, back, touched):
                for t in touched:
                    if not queued[t]:
                        queued[t] = True
                        queue[(head + count) % m] = t
                        count += 1
