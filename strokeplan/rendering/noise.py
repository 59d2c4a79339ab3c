"""Chance by place: numbers that depend on a stroke and a place in it and on nothing else."""

from __future__ import annotations

import numpy as np

from strokeplan.jit import leaf
from strokeplan.tractography import splitmix64


@leaf
def chance(key: np.uint64, i: int, j: int) -> float:
    """A number in [0, 1) for a place of a lattice."""
    row = splitmix64(key, np.uint64(i & 0xFFFFFFFF))
    return float(splitmix64(row, np.uint64(j & 0xFFFFFFFF)) >> np.uint64(11)) * 2.0**-53


@leaf
def smooth(x: float, low: float, high: float) -> float:
    """0 below `low`, 1 above `high`, between them a cubic without a corner."""
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@leaf
def noise(key: np.uint64, x: float, y: float) -> float:
    """Value noise: chance at whole numbers, smooth between them; mean 0.5."""
    i, j = int(np.floor(x)), int(np.floor(y))
    fx, fy = smooth(x - i, 0.0, 1.0), smooth(y - j, 0.0, 1.0)
    upper = chance(key, i, j) * (1.0 - fx) + chance(key, i + 1, j) * fx
    lower = chance(key, i, j + 1) * (1.0 - fx) + chance(key, i + 1, j + 1) * fx
    return upper * (1.0 - fy) + lower * fy
