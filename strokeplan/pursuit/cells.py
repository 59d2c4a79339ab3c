"""The cells of a strip in which seeds are sought: how bad each is, and the tree from which they are drawn."""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import inlined, leaf
from strokeplan.pursuit.scene import Rules, Scene


class Strip(NamedTuple):
    """A window whose cells are worked in one sequence, and where the numbers of its strokes and tries begin."""

    top: int
    bottom: int
    left: int
    right: int
    first_id: int
    first_mark: int


def cell_count(top: int, bottom: int, left: int, right: int, side: float) -> int:
    """How many cells a window has."""
    return ceil((bottom - top) / side) * ceil((right - left) / side)


@inlined
def grid(strip: Strip, side: float) -> tuple[int, int]:
    """Rows and columns of the cells of a strip."""
    return int(np.ceil((strip.bottom - strip.top) / side)), int(np.ceil((strip.right - strip.left) / side))


@inlined
def _window(rules: Rules, strip: Strip, cell: int) -> tuple[int, int, int, int]:
    """Pixels top, bottom, left, right of a cell."""
    row, column = divmod(cell, grid(strip, rules.cell)[1])
    top, bottom = strip.top + int(row * rules.cell), min(strip.top + int((row + 1) * rules.cell), strip.bottom)
    left, right = strip.left + int(column * rules.cell), min(strip.left + int((column + 1) * rules.cell), strip.right)
    return top, bottom, left, right


@leaf
def centre(rules: Rules, strip: Strip, cell: int) -> tuple[int, int]:
    """The pixel in the middle of a cell."""
    top, bottom, left, right = _window(rules, strip, cell)
    return (top + bottom) // 2, (left + right) // 2


@inlined
def survey(scene: Scene, rules: Rules, strip: Strip, cell: int) -> tuple[float, int, int]:
    """Mean of a cell, see Rules.trigger, and its pixel of the largest error."""
    top, bottom, left, right = _window(rules, strip, cell)
    total, largest, worst_i, worst_j = 0.0, -1.0, top, left
    errors, by_gain = scene.error, rules.by_gain
    for i in range(top, bottom):
        for j in range(left, right):
            error = errors[i, j]
            total += error if by_gain else np.sqrt(error)
            if error > largest:
                largest, worst_i, worst_j = error, i, j
    return total / max((bottom - top) * (right - left), 1), worst_i, worst_j


@leaf
def mass_of(scene: Scene, rules: Rules, strip: Strip, cell: int) -> float:
    """What a cell weighs when seeds are drawn: nothing if it need not be tried."""
    mean = survey(scene, rules, strip, cell)[0]
    top, bottom, left, right = _window(rules, strip, cell)
    return mean * (bottom - top) * (right - left) if mean > rules.trigger else 0.0


@leaf
def draw_pixel(scene: Scene, rules: Rules, strip: Strip, cell: int, share: float) -> tuple[int, int]:
    """The pixel of a cell at which the sum of its errors passes `share`."""
    top, bottom, left, right = _window(rules, strip, cell)
    for i in range(top, bottom):
        for j in range(left, right):
            share -= scene.error[i, j] if rules.by_gain else np.sqrt(scene.error[i, j])
            if share < 0.0:
                return i, j
    return bottom - 1, right - 1


@leaf
def set_mass(tree: NDArray[np.float64], mass: NDArray[np.float64], cell: int, value: float) -> None:
    """Give a cell of a Fenwick tree (P. Fenwick 1994) another mass."""
    change = value - mass[cell]
    mass[cell] = value
    k = cell + 1
    while k < len(tree):
        tree[k] += change
        k += k & -k


@leaf
def mass_of_first(tree: NDArray[np.float64], cells: int) -> float:
    """Mass of the first cells."""
    total, k = 0.0, cells
    while k > 0:
        total += tree[k]
        k -= k & -k
    return total


@leaf
def cell_at(tree: NDArray[np.float64], share: float) -> int:
    """The cell in which the running mass passes `share`."""
    k, step = 0, 1
    while 2 * step < len(tree):
        step *= 2
    while step > 0:
        if k + step < len(tree) and tree[k + step] <= share:
            k += step
            share -= tree[k]
        step //= 2
    return min(k, len(tree) - 2)
