"""Many polylines as one value, and as chains of cubics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import fit, rdp, scratch_inside
from strokeplan.jit import kernel


class Lines(NamedTuple):
    """Polylines one after the other: points (p, 2), line i at starts[i] … starts[i + 1] − 1."""

    points: NDArray[np.float64]
    starts: NDArray[np.int64]


NO_LINES = Lines(np.empty((0, 2)), np.zeros(1, np.int64))


def joined(parts: Sequence[Lines]) -> Lines:
    """All lines of some, in order."""
    if not parts:
        return NO_LINES
    counts = np.concatenate([np.diff(part.starts) for part in parts])
    return Lines(np.concatenate([part.points for part in parts]), np.concatenate([[0], np.cumsum(counts)]))


def chains(lines: Lines, tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Chains of cubics within about `tolerance` of lines of two points and more: points and starts of a StrokePlan.

    A line whose points are all the same is a dot: one cubic of no length.
    """
    points = np.empty((3 * len(lines.points) + 1, 2))
    starts = np.zeros(len(lines.starts), np.int64)
    longest = int(np.diff(lines.starts).max(initial=0))
    _chains(lines.points, lines.starts, tolerance, longest, points, starts)
    return points[: starts[-1]].copy(), starts


@kernel
def _chains(
    lines: NDArray[np.float64],
    begins: NDArray[np.int64],
    tolerance: float,
    longest: int,
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
) -> None:
    room, vertices = scratch_inside(longest), np.empty((longest, 2))
    for line in range(len(begins) - 1):
        n = rdp(lines, begins[line], begins[line + 1], 0.25 * tolerance, vertices, room)
        if n == 1:
            points[starts[line] : starts[line] + 4] = vertices[0]
            starts[line + 1] = starts[line] + 4
            continue
        pieces = fit(vertices, n, 0.75 * tolerance, True, points, starts[line], room)
        starts[line + 1] = starts[line] + 3 * pieces + 1
