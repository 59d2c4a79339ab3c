"""New strokes on top of the others, one by one where the picture is wrong: greedy matching pursuit.

Each is the best of many random ones at bad pixels, then bettered by random steps for as long as they take more from
the squared error (hill climbing). Descent does the rest, so the climb is short.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import kernel, leaf
from strokeplan.searching.stack import Photo, Room, Stack, cover, distance2, room_for
from strokeplan.tractography import uniform

DRAWS = 6
"""Pixels drawn for each random stroke, of which the worst is its middle."""
TRIES = 8
"""So many in a row that gain too little are the end."""
LONG = 4.0
"""A new stroke is this many times as long as wide at most, or this part of its width at least."""
FINEST_STEP = 5.0
"""Steps are from one width of the stroke down to this power of a half."""


class Rules(NamedTuple):
    """How strokes are proposed; lengths in pixels."""

    finest: float
    slight: float
    broad: float
    """New strokes are as wide as something between `slight` and `broad`, and no finer than `finest` later."""
    least: float
    """What a stroke must take from the error."""
    looks: int
    """Random strokes of which the best becomes a new one."""
    moves: int
    """Steps tried to better it."""
    key: np.uint64


class Bench(NamedTuple):
    """Room to look for a stroke."""

    room: Room
    error: NDArray[np.float32]
    """The weighted squared error of every pixel."""
    trial: NDArray[np.float64]
    fresh: NDArray[np.float64]
    drawn: NDArray[np.int64]
    """(1,): random numbers drawn."""


def bench_for(shape: tuple[int, ...]) -> Bench:
    return Bench(
        room_for(shape), np.empty(shape, np.float32), np.empty((4, 2)), np.empty((4, 2)), np.zeros(1, np.int64)
    )


@kernel
def propose(photo: Photo, stack: Stack, bench: Bench, rules: Rules, n: int, most: int) -> int:
    """Lay new strokes on top of n, until there are `most` or none gains enough; return how many there are.

    `bench.error` is that of the picture, before and after.
    """
    failed = 0
    while n < most and failed < TRIES:
        width, gain = _find(photo, stack, bench, rules)
        if gain < rules.least:
            failed += 1
            continue
        failed = 0
        for p in range(4):
            stack.points[4 * n + p, 0], stack.points[4 * n + p, 1] = bench.fresh[p, 0], bench.fresh[p, 1]
        stack.widths[n] = width
        covered = cover(bench.room, bench.fresh, 0, width, stack.round_cap)
        _suit(photo, stack, bench, covered, n)
        n += 1
    return n


@leaf
def _find(photo: Photo, stack: Stack, bench: Bench, rules: Rules) -> tuple[float, float]:
    """A new stroke in bench.fresh: its width and gain."""
    trial, fresh = bench.trial, bench.fresh
    best, best_width = -np.inf, rules.finest
    for _ in range(rules.looks):
        i, j = _draw_pixel(bench, rules)
        width = rules.slight * (rules.broad / rules.slight) ** _random(bench, rules)
        half = 0.5 * width * LONG ** (2.0 * _random(bench, rules) - 1.0)
        angle = pi * _random(bench, rules)
        for p in range(4):
            along = half * (2.0 * p / 3.0 - 1.0)
            trial[p, 0], trial[p, 1] = j + 0.5 + along * np.cos(angle), i + 0.5 + along * np.sin(angle)
        gain = _gain(photo, bench, trial, width, stack.round_cap)
        if gain > best:
            best, best_width = gain, width
            for p in range(4):
                fresh[p, 0], fresh[p, 1] = trial[p, 0], trial[p, 1]
    return _climb(photo, stack, bench, rules, best_width, best)


@leaf
def _draw_pixel(bench: Bench, rules: Rules) -> tuple[int, int]:
    """The worst of a few pixels."""
    rows, columns = bench.error.shape
    worst, worst_i, worst_j = -1.0, 0, 0
    for _ in range(DRAWS):
        i, j = int(_random(bench, rules) * rows), int(_random(bench, rules) * columns)
        if bench.error[i, j] > worst:
            worst, worst_i, worst_j = float(bench.error[i, j]), i, j
    return worst_i, worst_j


@leaf
def _climb(photo: Photo, stack: Stack, bench: Bench, rules: Rules, width: float, gain: float) -> tuple[float, float]:
    """Better bench.fresh by random steps: of its width, of all of it, of an end and its handle, or of one handle."""
    trial, fresh = bench.trial, bench.fresh
    for _ in range(rules.moves):
        kind = int(6.0 * _random(bench, rules))
        step = 0.5 ** (FINEST_STEP * _random(bench, rules))
        angle = 2.0 * pi * _random(bench, rules)
        first, last = _moved(kind)
        dx, dy, w = width * step * np.cos(angle), width * step * np.sin(angle), width
        if kind == 0:
            w = max(width * 2.0 ** (step * np.cos(angle)), rules.finest)
        for p in range(4):
            moved = first <= p < last
            trial[p, 0], trial[p, 1] = fresh[p, 0] + (dx if moved else 0.0), fresh[p, 1] + (dy if moved else 0.0)
        tried = _gain(photo, bench, trial, w, stack.round_cap)
        if tried > gain:
            gain, width = tried, w
            for p in range(4):
                fresh[p, 0], fresh[p, 1] = trial[p, 0], trial[p, 1]
    return width, gain


@leaf
def _moved(kind: int) -> tuple[int, int]:
    """Which points of a cubic a kind of step moves, first to last − 1."""
    if kind == 0:
        return 0, 0
    if kind == 1:
        return 0, 4
    if kind < 4:
        return (0, 2) if kind == 2 else (2, 4)
    return (1, 2) if kind == 4 else (2, 3)


@leaf
def _random(bench: Bench, rules: Rules) -> float:
    """The next random number in [0, 1)."""
    bench.drawn[0] += 1
    return uniform(rules.key, np.uint64(bench.drawn[0]))


@leaf
def _gain(photo: Photo, bench: Bench, chain: NDArray[np.float64], width: float, round_cap: bool) -> float:
    """What a stroke on top of all, in its best colour, takes from the error."""
    covered = cover(bench.room, chain, 0, width, round_cap)
    old, weight, red, green, blue, squares = _add_up(photo, bench, covered)
    if weight == 0.0:
        return 0.0
    return old - squares + (red * red + green * green + blue * blue) / weight


@leaf
def _add_up(photo: Photo, bench: Bench, covered: int) -> tuple[float, float, float, float, float, float]:
    """Sums over the pixels in the room: error, weight, weighted red, green and blue, and |colour|²."""
    old = weight = red = green = blue = squares = 0.0
    for q in range(covered):
        i, j = bench.room.pixels[q, 0], bench.room.pixels[q, 1]
        w, value = float(photo.weight[i, j]), np.int64(photo.pixels[i, j])
        r, g, b = float(value >> 16), float((value >> 8) & 255), float(value & 255)
        old += bench.error[i, j]
        weight += w
        red += w * r
        green += w * g
        blue += w * b
        squares += w * (r * r + g * g + b * b)
    return old, weight, red, green, blue, squares


@leaf
def _suit(photo: Photo, stack: Stack, bench: Bench, covered: int, k: int) -> None:
    """Give stroke k, whose pixels are in the room, its colour; the error follows."""
    _, weight, red, green, blue, _ = _add_up(photo, bench, covered)
    stack.colours[k, 0], stack.colours[k, 1], stack.colours[k, 2] = red / weight, green / weight, blue / weight
    for q in range(covered):
        i, j = bench.room.pixels[q, 0], bench.room.pixels[q, 1]
        value = np.int64(photo.pixels[i, j])
        bench.error[i, j] = photo.weight[i, j] * distance2(stack.colours, k, value)
