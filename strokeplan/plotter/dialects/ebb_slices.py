"""Slices of time for the EiBotBoard: the planned motion (motion.py) as whole steps of two motors.

Every block is cut into slices; a slice is one XM (SM where each motor drives an axis of its own), whole steps between
where the pen is at its two ends: rounding never adds up. A slice shorter than the board keeps up with is stretched,
which slows the pen down and moves it nowhere else; so is one that would exceed 25 kHz on a motor.

Source: EiBotBoard command set (evil-mad.github.io/EggBot/ebb.html), commands SM, XM.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.plotter import motion
from strokeplan.plotter.profile import Ebb, Profile
from strokeplan.plotter.program import Program, limits

MAX_STEPS_MS = 24.9
"""Steps of one motor in a millisecond; the board's end is 25."""


class Slices(NamedTuple):
    """s slices: the line of each, whether it is drawn, ms and steps of x and y (s, 3), and where it ends (s, 2) mm."""

    line: NDArray[np.int64]
    drawn: NDArray[np.bool_]
    moves: NDArray[np.int64]
    ends: NDArray[np.float64]


def written(moves: NDArray[np.int64], profile: Profile) -> list[str]:
    """Slices (s, 3) as commands; XM where the motors drive x and y together."""
    word = "XM" if profile.machine.kinematics == "corexy" else "SM"
    return [f"{word},{ms},{x},{y}" for ms, x, y in moves.tolist()]


def all_slices(program: Program, dialect: Ebb) -> Slices:
    """Of a whole program, from home and back to it."""
    points, starts = program.polylines
    points = np.concatenate([points, [[0.0, 0.0]]])
    starts = np.concatenate([starts, [len(points)]])
    feeds = np.concatenate([program.feeds, [program.profile.speeds.travel_mm_min]])
    return slices(points, starts, feeds, program.profile, dialect)


def slices(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    feeds: NDArray[np.float64],
    profile: Profile,
    dialect: Ebb,
    begin: tuple[float, float] = (0.0, 0.0),
) -> Slices:
    """Of polylines that are drawn from `begin` on."""
    moved = motion.plan(points, starts, limits(profile), feeds, start=begin)
    if not len(moved.duration):  # a dot where the pen is
        return Slices(moved.stroke, moved.down, np.empty((0, 3), np.int64), np.empty((0, 2)))
    cuts = np.maximum(np.ceil(moved.duration * 1000 / dialect.slice_ms), 1).astype(np.int64)
    block = np.repeat(np.arange(len(cuts)), cuts)
    part = (np.arange(len(block)) - np.repeat(np.cumsum(cuts) - cuts, cuts) + 1) / cuts[block]
    at = moved.at(moved.began[block] + part * moved.duration[block]).points
    last = part == 1
    at[last] = moved.end[block[last]]
    first = np.rint(np.array([begin]) * dialect.steps_mm).astype(np.int64)
    steps = np.diff(np.rint(at * dialect.steps_mm).astype(np.int64), axis=0, prepend=first)
    corexy = profile.machine.kinematics == "corexy"  # a motor turns by x + y, the other by x − y
    fastest = np.abs(steps).sum(axis=1) if corexy else np.abs(steps).max(axis=1)
    ms = np.ceil(moved.duration[block] * 1000 / cuts[block] - 1e-9)
    ms = np.maximum(np.maximum(ms, dialect.min_ms), np.ceil(fastest / MAX_STEPS_MS))
    moves = np.column_stack([ms.astype(np.int64), steps])
    keep = steps.any(axis=1)
    return Slices(moved.stroke[block][keep], moved.down[block][keep], moves[keep], at[keep])
