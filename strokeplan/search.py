"""Few strokes, each searched for: greedy matching pursuit with hill climbing, then rounds of second thoughts.

With a few hundred strokes every one is worth a search of its own, and none need follow a field. A stroke is one
cubic of one width. The first covers the canvas; each of the others is the best of many random ones where the picture
is wrong, bettered by random steps for as long as they take more from the squared error. When all are laid, rounds
follow: each stroke is bettered once more in its place in the stack, only where it is seen, and the strokes that are
missed least are laid anew on top of all others if that takes more. Nothing is kept that does not lower the error.

The picture is small, for what the finest brush cannot show cannot matter. The search ends when its work is done, which
is counted in pixels and not in seconds, or when a round betters nothing: the result depends on the seed alone.

Known limits: one sequence, so one thread; strokes follow edges only as far as that pays.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, footprint, paint_chain
from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.painting import LayerStrokes
from strokeplan.tractography import uniform

WORK = 150_000_000
"""Pixels looked at in all: about two seconds of one core."""
LOOKS, DRAWS = 32, 6
"""Random strokes of which the best becomes a new one; pixels drawn for each, of which the worst is its middle."""
FIRST_MOVES, MOVES = 80, 50
"""Steps tried to better a new stroke, and a stroke in its place in each round."""
ANEW = 0.1
"""Part of the strokes that may be laid anew in a round."""
BROAD, SLIGHT = 2.0, 0.25
"""Widths of new strokes, between these parts of the side of a square that is a stroke's share of the canvas."""
LONG = 4.0
"""A new stroke is this many times as long as wide at most, or this part of its width at least."""
REACH = 0.75
"""A stroke may move this many of its widths in a round."""
FINEST_STEP = 5.0
"""Steps are from one width of the stroke down to this power of a half."""
BATCH = 100
"""New strokes between which progress is told."""
BETTERED = 1e-3
"""A round that takes less than this part of the error is the last."""
_EXPOSED, _FIXED = 8, 100
"""What a pixel that is exposed, and a stroke that is tried, cost beside the pixels of its footprint."""

_MARK, _DRAWN, _WORK = range(3)
"""Bench.state: the last mark on the stamp, random numbers drawn, and work done."""

Window = tuple[int, int, int, int]
"""Pixels top, bottom, left, right."""


class _Strokes(NamedTuple):
    """Columns with room for as many as there may be; `worth` is what the error would grow by without a stroke."""

    chains: NDArray[np.float64]
    widths: NDArray[np.float64]
    colours: NDArray[np.uint32]
    worth: NDArray[np.float64]


class _Bench(NamedTuple):
    """The picture in work, and room to look below a stroke."""

    photo: Packed
    weight: NDArray[np.float32]
    error: NDArray[np.float32]
    under: Packed
    """What would show without the stroke."""
    over: Packed
    """Not 0 where other strokes lie above it."""
    bare: NDArray[np.float32]
    """The error without the stroke …"""
    seen: NDArray[np.float32]
    """… and the weight, both 0 where it is not seen."""
    stamp: NDArray[np.int32]
    spans: NDArray[np.int32]
    pixels: NDArray[np.int32]
    trial: NDArray[np.float64]
    fresh: NDArray[np.float64]
    state: NDArray[np.int64]


class _Rules(NamedTuple):
    """What strokes may be; lengths in pixels."""

    finest: float
    slight: float
    broad: float
    least: float
    ground: int
    """Strokes at the bottom that stay as they are."""
    background: np.uint32
    round_cap: bool
    key: np.uint64


def search(
    photo: Packed,
    weight: NDArray[np.float32],
    most: int,
    *,
    finest: float,
    least: float,
    cover: bool,
    background: int,
    round_cap: bool,
    key: np.uint64,
    tell: Callable[[int, int, int, float], None],
) -> LayerStrokes:
    """At most so many strokes that together come near to a photo, bottom to top, each one cubic.

    weight  (h, w) above 0: how much a pixel's error counts.
    finest  least width; `least` what a stroke must take from the weighted squared error.
    cover   begin with one stroke that covers the canvas.
    tell    is called with work done, work in all, strokes so far, and the mean RGB distance of a sample of pixels.
    """
    side = sqrt(photo.size / most)
    rules = _Rules(
        finest, max(SLIGHT * side, finest), max(BROAD * side, finest), least, int(cover), np.uint32(background),
        round_cap, key,
    )  # fmt: skip
    strokes = _Strokes(np.empty((most, 4, 2)), np.empty(most), np.empty(most, np.uint32), np.full(most, np.inf))
    bench = _bench(photo, weight)
    n = _lay_all(bench, strokes, rules, most, tell)
    error, before = _total(bench), np.inf
    while bench.state[_WORK] < WORK and error < (1 - BETTERED) * before:
        _tell(bench, n, tell)
        _better(bench, strokes, rules, n)
        _lay_anew(bench, strokes, rules, n)
        error, before = _total(bench), error
    bench.state[_WORK] = WORK
    _tell(bench, n, tell)
    points, counts = strokes.chains[:n].reshape(-1, 2), np.full(n, 4, np.int64)
    return LayerStrokes(points, counts, strokes.widths[:n].copy(), strokes.colours[:n].copy())


def _lay_all(
    bench: _Bench, strokes: _Strokes, rules: _Rules, most: int, tell: Callable[[int, int, int, float], None]
) -> int:
    """Lay new strokes until there are as many as there may be, or none gains enough; return how many."""
    height, width = bench.photo.shape
    if rules.ground:
        strokes.chains[0] = np.array([width / 2, height / 2]) + np.array([[-1, 0], [-1 / 3, 0], [1 / 3, 0], [1, 0]])
        strokes.widths[0] = hypot(width, height) + 2
    _lay_ground(bench, strokes, rules)
    n, before = rules.ground, -1
    while before < n < most:
        _tell(bench, n, tell)
        before, n = n, _add(bench, strokes, rules, n, min(n + BATCH, most))
    return n


def _total(bench: _Bench) -> float:
    return float(bench.error.sum(dtype=np.float64))


def _tell(bench: _Bench, n: int, tell: Callable[[int, int, int, float], None]) -> None:
    tell(min(int(bench.state[_WORK]), WORK), WORK, n, float(np.sqrt(bench.error[::8, ::8]).mean()))


def _bench(photo: Packed, weight: NDArray[np.float32]) -> _Bench:
    error, bare, seen = (np.empty(photo.shape, np.float32) for _ in range(3))
    return _Bench(
        photo, weight, error, np.empty_like(photo), np.empty_like(photo), bare, seen,
        np.zeros(photo.shape, np.int32), np.zeros((len(photo), 3), np.int32), np.empty((photo.size, 2), np.int32),
        np.empty((4, 2)), np.empty((4, 2)), np.zeros(3, np.int64),
    )  # fmt: skip


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first search compiles them."""
    return is_cached(_better)


@kernel
def _lay_ground(bench: _Bench, strokes: _Strokes, rules: _Rules) -> None:
    rows, columns = bench.photo.shape
    everywhere = (0, rows, 0, columns)
    _expose(bench, strokes, rules, 0, 0, everywhere)
    if rules.ground > 0:
        chain, width = strokes.chains[0], strokes.widths[0]
        _, strokes.colours[0] = _gain(bench, bench.seen, bench.bare, rules, everywhere, chain, width)
        _show(bench, rules, everywhere, chain, width, strokes.colours[0])
    else:
        bench.error[:] = bench.bare


@kernel
def _add(bench: _Bench, strokes: _Strokes, rules: _Rules, n: int, most: int) -> int:
    """Lay new strokes on top, until there are `most` or none gains enough; return how many there are."""
    while n < most:
        width, gain, colour = _propose(bench, rules)
        if gain < rules.least:
            break
        _lay(bench, strokes, rules, n, width, colour)
        n += 1
    return n


@kernel
def _better(bench: _Bench, strokes: _Strokes, rules: _Rules, n: int) -> None:
    """Better each stroke in its place; of those that stay as they are, the colour."""
    for k in range(n):
        chain, width = strokes.chains[k], strokes.widths[k]
        window = _window(bench, chain, width, REACH * width)
        _expose(bench, strokes, rules, n, k, window)
        width, gain, colour = _climb(
            bench, bench.seen, bench.bare, rules, window, chain, width, MOVES if k >= rules.ground else 0
        )
        strokes.widths[k], strokes.worth[k] = width, gain if k >= rules.ground else np.inf
        if gain > 0.0:
            strokes.colours[k] = colour
        _hide(bench, window)
        _show(bench, rules, window, chain, width, strokes.colours[k])


@kernel
def _lay_anew(bench: _Bench, strokes: _Strokes, rules: _Rules, n: int) -> None:
    """Take the strokes that are missed least away, one by one, for new ones on top that take more."""
    for _ in range(int(np.ceil(ANEW * (n - rules.ground)))):
        k = int(np.argmin(strokes.worth[:n]))
        chain, width = strokes.chains[k], strokes.widths[k]
        window = _window(bench, chain, width, 1.0)
        _expose(bench, strokes, rules, n, k, window)
        old, _ = _gain(bench, bench.seen, bench.bare, rules, window, chain, width)
        _hide(bench, window)
        new_width, gain, colour = _propose(bench, rules)
        if gain > old and gain >= rules.least:
            for s in range(k, n - 1):
                _move(strokes, s + 1, s)
            _lay(bench, strokes, rules, n - 1, new_width, colour)
        else:
            _show(bench, rules, window, chain, width, strokes.colours[k])
            strokes.worth[k] = np.inf


@leaf
def _move(strokes: _Strokes, source: int, target: int) -> None:
    chains = strokes.chains
    for p in range(4):
        chains[target, p, 0], chains[target, p, 1] = chains[source, p, 0], chains[source, p, 1]
    strokes.widths[target], strokes.colours[target] = strokes.widths[source], strokes.colours[source]
    strokes.worth[target] = strokes.worth[source]


@leaf
def _lay(bench: _Bench, strokes: _Strokes, rules: _Rules, k: int, width: float, colour: np.uint32) -> None:
    """The fresh stroke becomes the topmost, number k; its worth is not known before it is looked at in its place."""
    for p in range(4):
        strokes.chains[k, p, 0], strokes.chains[k, p, 1] = bench.fresh[p, 0], bench.fresh[p, 1]
    strokes.widths[k], strokes.colours[k], strokes.worth[k] = width, colour, np.inf
    bench.state[_MARK] += 1
    n = footprint(bench.stamp, bench.state[_MARK], bench.spans, bench.fresh, 0, 1, width, rules.round_cap, bench.pixels)
    for q in range(n):
        i, j = bench.pixels[q, 0], bench.pixels[q, 1]
        bench.error[i, j] = bench.weight[i, j] * _squared_distance(bench.photo[i, j], colour)


@leaf
def _propose(bench: _Bench, rules: _Rules) -> tuple[float, float, np.uint32]:
    """A new stroke on top of all, in bench.fresh: its width, gain and colour."""
    rows, columns = bench.photo.shape
    everywhere = (0, rows, 0, columns)
    trial, fresh = bench.trial, bench.fresh
    best, best_width = -np.inf, rules.finest
    for _ in range(LOOKS):
        i, j = _draw_pixel(bench, rules)
        width = rules.slight * (rules.broad / rules.slight) ** _random(bench, rules)
        half = 0.5 * width * LONG ** (2.0 * _random(bench, rules) - 1.0)
        angle = pi * _random(bench, rules)
        for p in range(4):
            along = half * (2.0 * p / 3.0 - 1.0)
            trial[p, 0], trial[p, 1] = j + 0.5 + along * np.cos(angle), i + 0.5 + along * np.sin(angle)
        gain, _ = _gain(bench, bench.weight, bench.error, rules, everywhere, trial, width)
        if gain > best:
            best, best_width = gain, width
            for p in range(4):
                fresh[p, 0], fresh[p, 1] = trial[p, 0], trial[p, 1]
    return _climb(bench, bench.weight, bench.error, rules, everywhere, fresh, best_width, FIRST_MOVES)


@leaf
def _draw_pixel(bench: _Bench, rules: _Rules) -> tuple[int, int]:
    """The worst of a few pixels."""
    rows, columns = bench.photo.shape
    worst, worst_i, worst_j = -1.0, 0, 0
    for _ in range(DRAWS):
        i, j = int(_random(bench, rules) * rows), int(_random(bench, rules) * columns)
        if bench.error[i, j] > worst:
            worst, worst_i, worst_j = float(bench.error[i, j]), i, j
    return worst_i, worst_j


@leaf
def _climb(
    bench: _Bench,
    seen: NDArray[np.float32],
    bare: NDArray[np.float32],
    rules: _Rules,
    window: Window,
    chain: NDArray[np.float64],
    width: float,
    moves: int,
) -> tuple[float, float, np.uint32]:
    """Better a stroke by random steps: of its width, of all of it, of an end and its handle, or of one handle."""
    trial = bench.trial
    gain, colour = _gain(bench, seen, bare, rules, window, chain, width)
    for _ in range(moves):
        kind = int(6.0 * _random(bench, rules))
        step = 0.5 ** (FINEST_STEP * _random(bench, rules))
        angle = 2.0 * pi * _random(bench, rules)
        first, last = _moved(kind)
        dx, dy, w = width * step * np.cos(angle), width * step * np.sin(angle), width
        if kind == 0:
            w = max(width * 2.0 ** (step * np.cos(angle)), rules.finest)
        for p in range(4):
            moved = first <= p < last
            trial[p, 0], trial[p, 1] = chain[p, 0] + (dx if moved else 0.0), chain[p, 1] + (dy if moved else 0.0)
        tried, suited = _gain(bench, seen, bare, rules, window, trial, w)
        if tried > gain:
            gain, colour, width = tried, suited, w
            for p in range(4):
                chain[p, 0], chain[p, 1] = trial[p, 0], trial[p, 1]
    return width, gain, colour


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
def _random(bench: _Bench, rules: _Rules) -> float:
    """The next random number in [0, 1)."""
    bench.state[_DRAWN] += 1
    return uniform(rules.key, np.uint64(bench.state[_DRAWN]))


@leaf
def _expose(bench: _Bench, strokes: _Strokes, rules: _Rules, n: int, k: int, window: Window) -> None:
    """Find what a window would show without stroke k of n, and where that would be seen."""
    top, bottom, left, right = window
    under, over = bench.under[top:bottom, left:right], bench.over[top:bottom, left:right]
    for i in range(bottom - top):
        for j in range(right - left):
            under[i, j], over[i, j] = rules.background, 0
    for s in range(n):
        low, high, near, far = _box(strokes.chains[s], strokes.widths[s])
        if s != k and low < bottom and high > top and near < right and far > left:
            for p in range(4):
                bench.trial[p, 0], bench.trial[p, 1] = strokes.chains[s, p, 0] - left, strokes.chains[s, p, 1] - top
            canvas, colour = (under, strokes.colours[s]) if s < k else (over, np.uint32(1))
            paint_chain(canvas, bench.trial, 0, 1, strokes.widths[s], rules.round_cap, colour)
    for i in range(top, bottom):
        for j in range(left, right):
            w = bench.weight[i, j] if bench.over[i, j] == 0 else np.float32(0.0)
            bench.seen[i, j] = w
            bench.bare[i, j] = w * _squared_distance(bench.photo[i, j], bench.under[i, j])
    bench.state[_WORK] += _EXPOSED * (bottom - top) * (right - left)


@leaf
def _box(chain: NDArray[np.float64], width: float) -> tuple[float, float, float, float]:
    """What a stroke cannot reach beyond: top, bottom, left, right."""
    top, bottom, left, right = np.inf, -np.inf, np.inf, -np.inf
    for p in range(4):
        left, right = min(left, chain[p, 0]), max(right, chain[p, 0])
        top, bottom = min(top, chain[p, 1]), max(bottom, chain[p, 1])
    return top - 0.5 * width, bottom + 0.5 * width, left - 0.5 * width, right + 0.5 * width


@leaf
def _window(bench: _Bench, chain: NDArray[np.float64], width: float, margin: float) -> Window:
    """The pixels around a stroke; none if it lies beside the picture."""
    rows, columns = bench.photo.shape
    low, high, near, far = _box(chain, width)
    top, left = min(max(int(low - margin), 0), rows), min(max(int(near - margin), 0), columns)
    return top, max(min(int(high + margin) + 1, rows), top), left, max(min(int(far + margin) + 1, columns), left)


@leaf
def _gain(
    bench: _Bench,
    seen: NDArray[np.float32],
    bare: NDArray[np.float32],
    rules: _Rules,
    window: Window,
    chain: NDArray[np.float64],
    width: float,
) -> tuple[float, np.uint32]:
    """What a stroke in its best colour takes from the error `bare`, and that colour; nothing if it leaves the window.

    `seen` is the weight of the pixels that count, and 0 elsewhere.
    """
    top, bottom, left, right = window
    rows, columns = bench.photo.shape
    low, high, near, far = _box(chain, width)
    if (top > 0 and low < top) or (bottom < rows and high > bottom):
        return 0.0, np.uint32(0)
    if (left > 0 and near < left) or (right < columns and far > right):
        return 0.0, np.uint32(0)
    bench.state[_MARK] += 1
    n = footprint(bench.stamp, bench.state[_MARK], bench.spans, chain, 0, 1, width, rules.round_cap, bench.pixels)
    bench.state[_WORK] += n + _FIXED
    old = weights = red = green = blue = squares = 0.0
    for q in range(n):
        i, j = bench.pixels[q, 0], bench.pixels[q, 1]
        w, value = float(seen[i, j]), np.int64(bench.photo[i, j])
        if w > 0.0:
            r, g, b = float(value >> 16), float((value >> 8) & 255), float(value & 255)
            old += bare[i, j]
            weights += w
            red += w * r
            green += w * g
            blue += w * b
            squares += w * (r * r + g * g + b * b)
    if weights == 0.0:
        return 0.0, np.uint32(0)
    r, g, b = int(red / weights + 0.5), int(green / weights + 0.5), int(blue / weights + 0.5)
    left_over = squares - 2.0 * (r * red + g * green + b * blue) + (r * r + g * g + b * b) * weights
    return old - left_over, np.uint32((r << 16) | (g << 8) | b)


@leaf
def _hide(bench: _Bench, window: Window) -> None:
    """The error of the picture without the stroke that was exposed."""
    top, bottom, left, right = window
    for i in range(top, bottom):
        for j in range(left, right):
            if bench.seen[i, j] > 0.0:
                bench.error[i, j] = bench.bare[i, j]


@leaf
def _show(
    bench: _Bench, rules: _Rules, window: Window, chain: NDArray[np.float64], width: float, colour: np.uint32
) -> None:
    """The error of the picture with it."""
    bench.state[_MARK] += 1
    n = footprint(bench.stamp, bench.state[_MARK], bench.spans, chain, 0, 1, width, rules.round_cap, bench.pixels)
    for q in range(n):
        i, j = bench.pixels[q, 0], bench.pixels[q, 1]
        if bench.seen[i, j] > 0.0:
            bench.error[i, j] = bench.weight[i, j] * _squared_distance(bench.photo[i, j], colour)


@leaf
def _squared_distance(a: np.uint32, b: np.uint32) -> float:
    """Between two packed colours."""
    x, y = np.int64(a), np.int64(b)
    dr, dg, db = (x >> 16) - (y >> 16), ((x >> 8) & 255) - ((y >> 8) & 255), (x & 255) - (y & 255)
    return float(dr * dr + dg * dg + db * db)
