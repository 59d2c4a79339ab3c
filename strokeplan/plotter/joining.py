"""A first tour of strokes: ends are joined in pairs until one path is left.

Ends that the pen may join without a lift come first, so that as many as possible find a partner: an end with only one
left takes it, and where all have several the shortest gap is closed (Karp, Sipser 1981; on the sparse graphs of
drawings nearly a maximum matching). All other ends are matched greedily, nearest pairs first, over a k-d tree
(Bentley 1992: the greedy edge, which starts nearer to the optimum than the nearest neighbour), in rounds: those left
over look for their nearest among themselves.

Node 2s + e is end e of stroke s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import kernel, leaf

NEIGHBOURS = 8
"""Nearest ends that an end may be joined to."""
MATCHES = 5
"""Nearest ends that the greedy edge looks at in one round."""
JITTER = 1e-9
"""Ends are told apart by this part of their extent where they coincide: no point of the tree has many equals."""
FREE, ENTRY, EXIT = 0, 1, 2
"""What a node may be: either, or only where a stroke begins, or only where it ends."""


class _Links(NamedTuple):
    """Paths of strokes in the making."""

    role: NDArray[np.int8]
    mate: NDArray[np.int64]
    """The node that each is joined to, −1 while it is free."""
    tail: NDArray[np.int64]
    """For the ends of paths: the other end."""


def roles(fixed: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Of the nodes of m strokes of which some keep their direction; if that is but the last, no direction matters."""
    role = np.zeros((len(fixed), 2), np.int8)
    if fixed[:-1].any():
        role[fixed] = ENTRY, EXIT
    return role.reshape(-1)


def shaken(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nodes, each moved by a hair: the tree can split them all, and none is the nearest of many others.

    They count from their lowest corner, so that a hair is no less than what a float tells apart there.
    """
    moved: NDArray[np.float64] = nodes - nodes.min(axis=0)
    moved += JITTER * (float(moved.max()) or 1.0) * np.random.default_rng(0).random(nodes.shape)
    return moved


def nearest(
    points: NDArray[np.float64],
    queries: NDArray[np.int64],
    targets: NDArray[np.int64],
    tail: NDArray[np.int64],
    k: int,
) -> NDArray[np.int32]:
    """(q, k) for each query node the nearest targets but itself and its own tail, nearest first; −1 fills up."""
    from scipy.spatial import cKDTree

    if not len(targets):
        return np.full((len(queries), k), -1, np.int32)
    found = cKDTree(points[targets]).query(points[queries], k + 2)[1]
    return _without(found, queries, targets, tail[queries])


def tour_of(
    points: NDArray[np.float64], role: NDArray[np.int8], near: NDArray[np.int32], nowhere: int, tolerance: float
) -> NDArray[np.int64]:
    """The node at which each stroke is entered, in order, from the node `nowhere` on.

    points     (2m, 2) no two of which coincide: see `shaken`.
    role       (2m,): see `roles`.
    near       (2m, k) nodes to which each may be joined, nearest first; −1 for none.
    tolerance  ends nearer than this are joined first, as many as possible; 0 for none.
    """
    links = _Links(role.copy(), np.full(len(role), -1), np.arange(len(role)) ^ 1)
    links.mate[nowhere] = nowhere  # not to be joined: all others will be, in one path from here
    left = len(role) // 2
    if tolerance > 0:
        left -= _match(links, *_both_ways(*_pairs(points, np.arange(len(role)), near, tolerance), len(role)))
    free = np.flatnonzero(links.mate < 0)
    left -= _join_all(links, *_pairs(points, free, near[free, :MATCHES]))
    while left > 1:
        free = np.flatnonzero(links.mate < 0)
        exits, entries = free[links.role[free] != ENTRY], free[links.role[free] != EXIT]
        left -= _join_all(links, *_pairs(points, exits, nearest(points, exits, entries, links.tail, MATCHES)))
    return _walk(links.mate, nowhere)


def _pairs(
    points: NDArray[np.float64], nodes: NDArray[np.int64], near: NDArray[np.int32], most: float = np.inf
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Nodes and their near ones, by the gap between them, which is `most` at most."""
    us, vs = np.repeat(nodes, near.shape[1]), near.reshape(-1).astype(np.int64)
    gaps = np.hypot(*(points[us] - points[vs]).T)
    fit = np.flatnonzero((vs >= 0) & (gaps <= most))
    by_gap = fit[np.argsort(gaps[fit], kind="stable")]
    return us[by_gap], vs[by_gap]


def _both_ways(
    us: NDArray[np.int64], vs: NDArray[np.int64], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The pairs, and all partners of node u as partners[first[u]:first[u + 1]]."""
    key = np.sort(np.concatenate([us * n + vs, vs * n + us]))
    key = key[np.diff(key, prepend=-1) > 0]
    first = np.searchsorted(key, np.arange(n + 1) * n)
    return us, vs, first, key % n


@kernel
def _without(
    found: NDArray[np.int64], queries: NDArray[np.int64], targets: NDArray[np.int64], tails: NDArray[np.int64]
) -> NDArray[np.int32]:
    """The nodes found, without the queries themselves, their tails, and what the tree did not find."""
    k = found.shape[1] - 2
    near = np.full((len(queries), k), -1, np.int32)
    for q in range(len(queries)):
        count = 0
        for j in range(found.shape[1]):
            if found[q, j] < len(targets) and count < k:
                node = targets[found[q, j]]
                if node != queries[q] and node != tails[q]:
                    near[q, count] = node
                    count += 1
    return near


@leaf
def _may_join(links: _Links, u: int, v: int) -> bool:
    if links.mate[u] >= 0 or links.mate[v] >= 0 or links.tail[u] == v:
        return False
    return bool(links.role[u] == FREE or links.role[u] != links.role[v])


@leaf
def _join(links: _Links, u: int, v: int) -> None:
    """Two paths become one; where one keeps its direction, both do."""
    a, b = links.tail[u], links.tail[v]
    links.mate[u], links.mate[v] = v, u
    links.tail[a], links.tail[b] = b, a
    if links.role[a] != FREE:
        links.role[b] = ENTRY + EXIT - links.role[a]
    elif links.role[b] != FREE:
        links.role[a] = ENTRY + EXIT - links.role[b]


@kernel
def _join_all(links: _Links, us: NDArray[np.int64], vs: NDArray[np.int64]) -> int:
    """Join pairs in the order given where that can be done; how many were."""
    joined = 0
    for e in range(len(us)):
        if _may_join(links, us[e], vs[e]):
            _join(links, us[e], vs[e])
            joined += 1
    return joined


@kernel
def _match(
    links: _Links,
    us: NDArray[np.int64],
    vs: NDArray[np.int64],
    first: NDArray[np.int64],
    partners: NDArray[np.int64],
) -> int:
    """Join many pairs: nodes with a single partner left before all others, then pairs in the order given."""
    n = len(first) - 1
    queue, queued = np.empty(n, np.int64), np.zeros(n, np.bool_)
    count = 0
    for u in range(n):
        if first[u + 1] - first[u] == 1:
            queue[count], queued[u] = u, True
            count += 1
    joined, head, e = 0, 0, 0
    while head < count or e < len(us):
        if head < count:
            u = queue[head]
            v = _only_partner(links, u, first, partners)
            head += 1
        else:
            u, v = us[e], vs[e]
            e += 1
        if v < 0 or not _may_join(links, u, v):
            continue
        _join(links, u, v)
        joined += 1
        for node in (u, v, links.tail[u], links.tail[v]):
            for p in range(first[node], first[node + 1]):
                w = partners[p]
                if not queued[w] and _only_partner(links, w, first, partners) >= 0:
                    queue[count], queued[w] = w, True
                    count += 1
    return joined


@leaf
def _only_partner(links: _Links, u: int, first: NDArray[np.int64], partners: NDArray[np.int64]) -> int:
    """The one node that u may still be joined to; −1 if there are several, or none."""
    only = -1
    for p in range(first[u], first[u + 1]):
        if _may_join(links, u, partners[p]):
            if only >= 0:
                return -1
            only = partners[p]
    return int(only)


@kernel
def _walk(mate: NDArray[np.int64], start: int) -> NDArray[np.int64]:
    tour = np.empty(len(mate) // 2, np.int64)
    node = start
    for k in range(len(tour)):
        tour[k] = node
        node = mate[node ^ 1]
    return tour
