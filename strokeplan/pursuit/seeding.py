"""Where the next stroke of a strip is tried.

In the cells of a grid in random order, in its worst cells first, at random with a probability proportional to the
present error, or beside the strokes so far (B. Jobard, W. Lefer 1997); and, where all must be covered, through what
is still bare after that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import leaf
from strokeplan.pursuit.cells import (
    Strip,
    cell_at,
    cell_count,
    centre,
    draw_pixel,
    grid,
    mass_of,
    mass_of_first,
    set_mass,
    survey,
)
from strokeplan.pursuit.scene import BARE, BY_ERROR, EVEN, GRID, LANE, WORST_FIRST, Kept, Rules, Scene, Tally
from strokeplan.tractography import splitmix64, uniform

TRIES = 8
"""Most strokes tried for each cell of a strip."""

_CELL, _BARE, _TRIED, _DRAWN, _LAID, _FLANKED, _FIRST, _PLACE = range(8)
"""How far the search for seeds is, in Seeds.state: cells had, or draws made; cells found covered, and the bare
pixel tried last; the cell drawn last, and the strokes kept before it; strokes whose sides have been had, where the
points of the next begin, and the places had beside that one."""


class Seeds(NamedTuple):
    """The cells of a strip in the order in which they are tried, their errors, and how far that is."""

    order: NDArray[np.int64]
    mass: NDArray[np.float64]
    tree: NDArray[np.float64]
    state: NDArray[np.int64]


def sow(scene: Scene, rules: Rules, strip: Strip) -> Seeds:
    """The seeds of a strip, before the first is tried."""
    cells = cell_count(strip.top, strip.bottom, strip.left, strip.right, rules.cell)
    ranks, mass, tree = np.empty(cells), np.zeros(cells), np.zeros(cells + 1)
    _rank(scene, rules, strip, ranks, mass, tree)
    state = np.zeros(8, np.int64)
    state[_DRAWN] = -1
    return Seeds(np.argsort(ranks, kind="stable"), mass, tree, state)


@leaf
def _rank(
    scene: Scene,
    rules: Rules,
    strip: Strip,
    ranks: NDArray[np.float64],
    mass: NDArray[np.float64],
    tree: NDArray[np.float64],
) -> None:
    """Where the cells of a strip stand in their order, or the tree to draw them from."""
    for cell in range(len(ranks)):
        if rules.seeding == WORST_FIRST:
            ranks[cell] = -survey(scene, rules, strip, cell)[0]
        else:
            ranks[cell] = uniform(scene.key, np.uint64(cell))
        if rules.seeding == BY_ERROR:
            set_mass(tree, mass, cell, mass_of(scene, rules, strip, cell))


@leaf
def next_seed(
    scene: Scene, rules: Rules, strip: Strip, seeds: Seeds, kept: Kept, tally: Tally
) -> tuple[int, int, bool]:
    """The pixel through which the next stroke is tried, and whether it is to be a dab; row −1 after the last."""
    i, j = -1, -1
    if rules.seeding == BY_ERROR:
        i, j = _draw_seed(scene, rules, strip, seeds, tally)
    elif rules.seeding == EVEN:
        i, j = _seed_beside(scene, rules, strip, seeds, kept, tally)
    else:
        while i < 0 and seeds.state[_CELL] < len(seeds.order):
            cell = seeds.order[seeds.state[_CELL]]
            seeds.state[_CELL] += 1
            mean, worst_i, worst_j = survey(scene, rules, strip, cell)
            if mean > rules.trigger:
                i, j = centre(rules, strip, cell) if rules.seeding == GRID else (worst_i, worst_j)
    if i >= 0 or not rules.cover:
        return i, j, False
    # What is still bare after all; where no stroke will do, the shortest that there is.
    while seeds.state[_BARE] < len(seeds.order):
        _, i, j = survey(scene, rules, strip, seeds.state[_BARE])
        if scene.error[i, j] >= BARE:
            pixel = i * scene.photo.shape[1] + j + 1
            again = seeds.state[_TRIED] == pixel
            seeds.state[_TRIED] = pixel
            return i, j, again
        seeds.state[_BARE] += 1
    return -1, -1, False


@leaf
def _draw_seed(scene: Scene, rules: Rules, strip: Strip, seeds: Seeds, tally: Tally) -> tuple[int, int]:
    """A pixel drawn with a probability proportional to its present error, until the mean is no more than asked for.

    Cells are drawn from a Fenwick tree of their errors. What other strokes have changed since is found when
    a cell is drawn: it is then taken with the probability that is left of it. A cell that no stroke suits is
    not drawn again.
    """
    cells = len(seeds.order)
    area = float((strip.bottom - strip.top) * (strip.right - strip.left))
    state = seeds.state
    if state[_DRAWN] >= 0:
        left = mass_of(scene, rules, strip, state[_DRAWN]) if tally.strokes[0] > state[_LAID] else 0.0
        set_mass(seeds.tree, seeds.mass, state[_DRAWN], left)
    while state[_CELL] < TRIES * cells:
        state[_CELL] += 1
        total = mass_of_first(seeds.tree, cells)
        if total <= rules.trigger * area:
            break
        key = splitmix64(scene.key, np.uint64(cells + state[_CELL]))
        cell = cell_at(seeds.tree, uniform(key, np.uint64(0)) * total)
        before, now = seeds.mass[cell], mass_of(scene, rules, strip, cell)
        set_mass(seeds.tree, seeds.mass, cell, now)
        if now > 0.0 and uniform(key, np.uint64(1)) * before <= now:
            state[_DRAWN], state[_LAID] = cell, tally.strokes[0]
            return draw_pixel(scene, rules, strip, cell, uniform(key, np.uint64(2)) * now)
    return -1, -1


@leaf
def _seed_beside(scene: Scene, rules: Rules, strip: Strip, seeds: Seeds, kept: Kept, tally: Tally) -> tuple[int, int]:
    """Seeds of evenly spaced tracts: one separation beside the strokes kept so far, oldest first; where these have
    no room left beside them, in the next cell, in random order, that is free."""
    state = seeds.state
    while True:
        if state[_FLANKED] < tally.strokes[0]:
            # Four places along the straight line below each piece, on both sides: near enough for a seed.
            count = kept.counts[state[_FLANKED]]
            k = state[_FIRST] + 3 * (state[_PLACE] // 8)
            if k >= state[_FIRST] + count - 1:
                state[_FLANKED] += 1
                state[_FIRST] += count
                state[_PLACE] = 0
                continue
            t, side = (state[_PLACE] // 2 % 4) / 4, 1.0 - 2.0 * (state[_PLACE] % 2)
            state[_PLACE] += 1
            ax, ay = kept.points[k, 0], kept.points[k, 1]
            dx, dy = kept.points[k + 3, 0] - ax, kept.points[k + 3, 1] - ay
            across = side * rules.separation / max(np.hypot(dx, dy), 1e-9)
            i, j = int(np.floor(ay + t * dy + across * dx)), int(np.floor(ax + t * dx - across * dy))
        elif state[_CELL] < len(seeds.order):
            i, j = centre(rules, strip, seeds.order[state[_CELL]])
            state[_CELL] += 1
        else:
            return -1, -1
        inside = strip.top <= i < strip.bottom and strip.left <= j < strip.right
        if inside and not scene.lanes[i, j] & LANE:
            columns = grid(strip, rules.cell)[1]
            cell = int((i - strip.top) / rules.cell) * columns + int((j - strip.left) / rules.cell)
            if survey(scene, rules, strip, cell)[0] > rules.trigger:
                return i, j
