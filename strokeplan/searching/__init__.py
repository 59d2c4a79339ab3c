"""Few strokes, each searched for: laid greedily, bettered all together, the poorest laid anew, in rounds.

With a few thousand strokes every one is worth a search of its own, and none need follow a field. A stroke is one
cubic of one width. The first covers the canvas; the others are laid on top one by one where the picture is wrong
(proposing.py). Then all are moved along the gradient of the error by their outlines (descent.py). In the rounds that
follow, the strokes that are missed least give way to new ones on top, and all are moved again. What a round has not
bettered is undone, so the error of the picture never grows from round to round.

The picture is small, for what the finest brush cannot show cannot matter, and the first rounds see it at half of that
size, for a quarter of the pixels. How much is tried depends on the number of strokes and on nothing else: no clock, so
the result depends on the seed alone.

Known limits: one sequence, so one thread; strokes keep their order, but for those laid anew.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed
from strokeplan.jit import is_cached
from strokeplan.painting import LayerStrokes
from strokeplan.searching.descent import descend, find_gradient
from strokeplan.searching.proposing import Bench, Rules, bench_for, propose
from strokeplan.searching.stack import Photo, Stack, empty_stack, halved, measure, photo_of, show, weigh

ANEW = 0.1
"""Part of the strokes that give way to new ones in a round."""
BROAD, SLIGHT = 2.0, 0.25
"""Widths of new strokes, between these parts of the side of a square that is a stroke's share of the canvas."""
COARSE = 6.5
"""Pixels of that side without which nothing is moved at half the size: strokes of a pixel or two suit their pixels,
and not the picture, and lose by every move."""
BATCH = 25
"""New strokes between which progress is told, and Ctrl-C heard."""

Tell = Callable[[int, int, int, float], None]


class Effort(NamedTuple):
    """How much is tried: the fewer strokes, the more for each."""

    looks: int
    """Random strokes of which the best becomes a new one."""
    moves: int
    """Random steps that better it."""
    steps: int
    """Of all strokes, in a round."""
    coarse_rounds: int
    """At half the size."""
    rounds: int

    @property
    def work(self) -> int:
        """In steps; laying all strokes is as long as a round."""
        return self.steps * (1 + self.coarse_rounds + self.rounds)


def effort_for(most: int) -> Effort:
    """What takes one core two or three seconds for any number of strokes."""
    thousands = most / 1000
    return Effort(
        looks=int(min(max(100 / thousands, 32), 600)),
        moves=int(min(max(100 / sqrt(thousands), 80), 200)),
        steps=int(min(max(30 * thousands**-0.2, 20), 60)),
        coarse_rounds=int(min(max(3 / thousands, 1), 8)),
        rounds=3 if thousands <= 2 else 2,
    )


class _Easel(NamedTuple):
    """The picture in work at one size."""

    photo: Photo
    stack: Stack
    bench: Bench
    rules: Rules
    side: float
    """Of a square that is a stroke's share of the canvas, in pixels."""


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
    tell: Tell,
) -> LayerStrokes:
    """At most so many strokes that together come near to a photo, bottom to top, each one cubic.

    weight  (h, w) above 0: how much a pixel's error counts.
    finest  least width; `least` what a stroke must take from the weighted squared error to be laid.
    cover   begin with one stroke that covers the canvas.
    tell    is called with work done, work in all, strokes so far, and the mean RGB distance of a sample of pixels.
    """
    effort = effort_for(most)
    easels = []
    for target, scale in ((halved(photo_of(photo, weight)), 0.5), (photo_of(photo, weight), 1.0)):
        stack = empty_stack(most, target.pixels.shape, int(cover), background, round_cap)
        side = sqrt(target.pixels.size / most)
        slight, broad = (max(part * side, finest * scale) for part in (SLIGHT, BROAD))
        rules = Rules(finest * scale, slight, broad, least * scale**2, effort.looks, effort.moves, key)
        easels.append(_Easel(target, stack, bench_for(target.pixels.shape), rules, side))
    coarse, fine = easels
    n = _begin(coarse, cover)
    telling = _Telling(tell, effort)
    n = _lay(coarse, n, telling)
    telling.done += effort.steps
    if coarse.side >= COARSE:
        n = _in_rounds(coarse, n, effort.coarse_rounds, telling)
    telling.done = effort.steps * (1 + effort.coarse_rounds)
    fine.stack.points[: 4 * n], fine.stack.widths[:n] = 2 * coarse.stack.points[: 4 * n], 2 * coarse.stack.widths[:n]
    fine.bench.drawn[:] = coarse.bench.drawn
    n = _in_rounds(fine, n, effort.rounds, telling)
    telling(fine, n)
    return _strokes(fine.stack, n)


class _Telling:
    """Says how far the work is."""

    def __init__(self, tell: Tell, effort: Effort) -> None:
        self.tell, self.effort, self.done = tell, effort, 0

    def __call__(self, easel: _Easel, n: int, steps: int = 0) -> None:
        """`steps` of a round are done, or as good as done."""
        error = float(np.sqrt(easel.bench.error[::8, ::8]).mean())
        self.tell(self.done + steps, self.effort.work, n, error)


def _begin(easel: _Easel, cover: bool) -> int:
    """A bare canvas, or a stroke that covers it; the number of strokes."""
    if cover:
        height, width = easel.photo.pixels.shape
        diagonal = hypot(width, height) + 2
        half = 1.0 if easel.stack.round_cap else 0.5 * diagonal  # round ends are as long
        along = np.array([[-half, 0.0], [-half / 3, 0.0], [half / 3, 0.0], [half, 0.0]])
        easel.stack.points[:4] = np.array([width / 2, height / 2]) + along
        easel.stack.widths[0] = diagonal
    return int(cover)


def _look(easel: _Easel, n: int) -> float:
    """The error of the picture as it is, in all; that of every pixel on the bench."""
    error = show(easel.photo, easel.stack, n)
    measure(easel.photo, easel.stack, easel.bench.error)
    return error


def _lay(easel: _Easel, n: int, telling: _Telling) -> int:
    """Lay new strokes until there are as many as there may be, or none gains enough; return how many."""
    most, before = len(easel.stack.widths), -1
    _look(easel, n)
    while before < n < most:
        telling(easel, n, telling.effort.steps * n // most if telling.done == 0 else 0)
        before = n
        n = propose(easel.photo, easel.stack, easel.bench, easel.rules, n, min(n + BATCH, most))
    return n


def _in_rounds(easel: _Easel, n: int, rounds: int, telling: _Telling) -> int:
    """Lay the poorest strokes anew, better all, again and again; return how many there are."""
    stack, steps = easel.stack, telling.effort.steps
    error = _look(easel, n)
    for _ in range(rounds):
        before = n, stack.points[: 4 * n].copy(), stack.widths[:n].copy()
        n = _lay(easel, _leave_out_poorest(easel, n), telling)
        bettered = descend(
            easel.photo, stack, n, steps, easel.side, easel.rules.finest,
            lambda step: telling(easel, n, step),  # noqa: B023 (called within the round)
        )  # fmt: skip
        telling.done += steps
        if bettered < error:
            error = bettered
        else:
            n, stack.points[: 4 * before[0]], stack.widths[: before[0]] = before
        _look(easel, n)
    return n


def _leave_out_poorest(easel: _Easel, n: int) -> int:
    """Take away the strokes that are missed least; return how many stay."""
    stack = easel.stack
    weigh(easel.photo, stack, n, easel.bench.room)
    count = int(np.ceil(ANEW * (n - stack.ground)))
    stay = np.delete(np.arange(n), np.argsort(stack.worth[:n], kind="stable")[:count])
    stack.points.reshape(-1, 4, 2)[: len(stay)] = stack.points.reshape(-1, 4, 2)[stay]
    stack.widths[: len(stay)] = stack.widths[stay]
    return len(stay)


def _strokes(stack: Stack, n: int) -> LayerStrokes:
    red, green, blue = np.floor(stack.colours[:n] + 0.5).astype(np.uint32).T
    counts = np.full(n, 4, np.int64)
    return LayerStrokes(stack.points[: 4 * n].copy(), counts, stack.widths[:n].copy(), red << 16 | green << 8 | blue)


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first search compiles them."""
    return is_cached(find_gradient) and is_cached(propose)
