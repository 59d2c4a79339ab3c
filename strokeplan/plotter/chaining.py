"""Strokes in the order in which a pen draws them, joined to lines where their ends meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.grouping import gathered
from strokeplan.plotter.order import Tour, keep_order, merge, order
from strokeplan.strokes import StrokePlan

LIFT_MM = 20.0
"""What lifting and lowering the pen counts as, in mm of travel, when strokes are put in order."""


def in_order(ends: NDArray[np.float64], member: NDArray[np.int64], join: float) -> tuple[Tour, NDArray[np.int64]]:
    """A short tour through all strokes, those of a `member` (n, 2) together, and where its lines begin.

    ends (n, 2, 2) in mm. Gaps up to `join` mm are crossed without a lift.
    """
    group = _groups(member)
    ranked = np.argsort(group, kind="stable")  # order() takes groups as they first appear
    tour = order(ends[ranked], group[ranked], tolerance=join, lift=LIFT_MM)
    tour = Tour(ranked[tour.index], tour.reversed)
    return tour, merge(ends, tour, group, tolerance=join)


def as_they_come(
    ends: NDArray[np.float64], member: NDArray[np.int64], join: float, bridge: float
) -> tuple[Tour, NDArray[np.int64]]:
    """The strokes in their own order, each in the better direction; gaps up to `bridge` mm join strokes of a member."""
    tour = keep_order(ends, tolerance=join, lift=LIFT_MM)
    return tour, merge(ends, tour, _groups(member), tolerance=bridge)


def _groups(member: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.unique(member, axis=0, return_inverse=True)[1].reshape(-1)


def chained(
    chains: NDArray[np.float64], plan: StrokePlan, tour: Tour, lines: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and starts of the lines: strokes as the tour draws them, a gap within a line as a straight cubic."""
    counts = plan.counts[tour.index]
    joined = np.ones(len(counts), np.bool_)
    joined[lines[:-1]] = False
    ends = np.cumsum(counts + 2 * joined)
    points = np.full((int(ends[-1]), 2), np.nan)
    own = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    points[np.repeat(ends - counts, counts) + own] = chains[drawn_rows(plan.starts, tour)]
    gaps = (ends - counts)[joined] - 2
    before, after = points[gaps - 1], points[gaps + 2]
    points[gaps], points[gaps + 1] = (2 * before + after) / 3, (before + 2 * after) / 3
    return points, np.concatenate([[0], ends[lines[1:] - 1]])


def drawn_rows(starts: NDArray[np.int64], tour: Tour) -> NDArray[np.int64]:
    """Rows of what strokes have from starts[i] to starts[i + 1] − 1, in the order and direction of drawing."""
    forth = gathered(starts, tour.index)
    counts = np.diff(starts)[tour.index]
    mirrored = np.repeat(starts[tour.index] + starts[tour.index + 1] - 1, counts) - forth
    return np.where(np.repeat(tour.reversed, counts), mirrored, forth)
