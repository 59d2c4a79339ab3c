"""Moves that shorten a tour of strokes: 2-opt, which turns a run of them, and Or-opt, which carries up to three away.

A move is looked for where it would join an end to one of its nearest (Bentley 1992); strokes whose neighbours changed
are looked at again, until no move pays. Time grows as n log n: runs longer than the last of `RUNS` are not turned,
which costs little (Johnson, McGeoch 1997).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import kernel, leaf

RUNS = (1_000, 50_000)
"""No move turns a run longer than this: short ones first, which leave little to do for those that cost more."""
SEGMENT = 3
"""Strokes that an Or-opt move takes along at most."""
GAIN = 1e-7
"""A move that saves less (mm) is rounding."""


class Price(NamedTuple):
    """What a pen-up move costs; any move to or from the node `free` costs nothing."""

    nodes: NDArray[np.float64]
    free: int
    tolerance: float
    lift: float


class _Route(NamedTuple):
    """A cyclic tour in the work: strokes by position, positions by stroke, and whether a stroke is flipped."""

    order: NDArray[np.int64]
    pos: NDArray[np.int64]
    flip: NDArray[np.int64]


class _Rules(NamedTuple):
    """Strokes that keep their direction, whether there are any, and the longest run that is turned."""

    fixed: NDArray[np.bool_]
    bound: bool
    reach: int


@kernel
def improved(
    tour: NDArray[np.int64], price: Price, near: NDArray[np.int32], fixed: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """A shorter tour: strokes in order, and whether each is flipped, from the start (the last stroke) on.

    tour   (m,) the node at which each stroke is entered: 2s, or 2s + 1 where stroke s is flipped.
    near   (2m, k) nodes to which each may be joined, nearest first; -1 for none.
    fixed  (m,) strokes that are not flipped, in relation to the last one.
    """
    m = len(tour)
    start = m - 1
    pos, flip = np.empty(m, np.int64), np.empty(m, np.int64)
    route = _Route(tour >> 1, pos, flip)
    for k in range(m):
        pos[tour[k] >> 1] = k
        flip[tour[k] >> 1] = tour[k] & 1
    bound = bool(fixed[:start].any())
    for reach in RUNS:
        _improve(route, price, near, _Rules(fixed, bound, reach))
        if reach > m:
            break
    index, flipped = np.empty(start, np.int64), np.empty(start, np.bool_)
    back, s = flip[start], start
    for k in range(start):
        s = _next(route, s, back)
        index[k] = s
        flipped[k] = flip[s] != back
    return index, flipped


@leaf
def cost(price: Price, u: int, v: int) -> float:
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
    price: Price,
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
    removed = cost(price, u, v)
    best, kind, t5, t6, t3, t4 = GAIN, 0, 0, 0, 0, 0
    for q in range(near.shape[1]):
        w = near[u, q]
        if w < 0:
            break
        g1 = removed - cost(price, u, w)
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
            g2 = g1 + cost(price, w, x)
            gain = g2 - cost(price, v, x)
            if gain > best and not (bound and _barred(route, fixed, u, w)):
                best, kind, t3, t4 = gain, 1, w, x
            d = c
            for _ in range(SEGMENT):
                if d == b or (bound and fixed[d]):
                    break
                p = _next(route, d, 1 - back)
                pe, de = _exit(route, p, back), _entry(route, d, back)
                gain = g2 + cost(price, pe, de) - cost(price, de, v) - cost(price, pe, x)
                if gain > best:
                    best, kind, t3, t4, t5, t6 = gain, 2, w, x, pe, de
                d = p
            a = s
            for _ in range(SEGMENT):
                if a == n or (bound and fixed[a]):
                    break
                p = _next(route, a, 1 - back)
                pe, ae = _exit(route, p, back), _entry(route, a, back)
                gain = g2 + cost(price, pe, ae) - cost(price, ae, x) - cost(price, pe, v)
                if gain > best:
                    best, kind, t3, t4, t5, t6 = gain, 3, w, x, pe, ae
                a = p
        else:
            p0 = _next(route, c, 1 - back)
            pe = _exit(route, p0, back)
            g2 = g1 + cost(price, pe, w)
            d = c
            for _ in range(SEGMENT):
                if d == s:
                    break
                n = _next(route, d, back)
                de, x = _exit(route, d, back), _entry(route, n, back)
                gain = g2 + cost(price, de, x) - cost(price, de, v) - cost(price, pe, x)
                if gain > best:
                    best, kind, t3, t4, t5, t6 = gain, 4, w, pe, de, x
                d = n
            a = s
            for _ in range(SEGMENT):
                if a == c:
                    break
                p = _next(route, a, 1 - back)
                qe, ae = _exit(route, p, back), _entry(route, a, back)
                gain = g2 + cost(price, qe, ae) - cost(price, pe, ae) - cost(price, qe, v)
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
def _improve(route: _Route, price: Price, near: NDArray[np.int32], rules: _Rules) -> None:
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
