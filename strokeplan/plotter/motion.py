"""How a plotter moves along polylines: trapezoids of speed between junctions, with look-ahead, as GRBL 1.1 plans them.

Every segment is a block. Its speed and acceleration are the largest that no axis exceeds along its direction; the
speed at a junction is what the centripetal acceleration allows on a circle that passes the corner at the junction
deviation; a block is entered no faster than the blocks in the planner's buffer allow it to stop, and left no faster
than it can accelerate. A move of the pen empties the buffer: strokes and travels begin and end at rest. Speeds
are exact under this model; nothing is stepped through time, so the plan costs a pass over the blocks. Times are within
0.2 % of those of GRBL's own code (docs/motion.md).

Known limits: constant acceleration (no S-curves); the buffer is taken to be full whenever there is more to come,
which a slow serial line does not keep up with on very short segments; CoreXY speeds are those of the pen, while
GRBL's own CoreXY build measures the way of its two belts; GRBL dwells in steps of 0.05 s, which `Pen` must be given.

Sources: S. Jeon, "Improving Grbl: Cornering Algorithm" (2011); GRBL 1.1 (settings $11, $100, $110, $120).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan.errors import InputError
from strokeplan.jit import kernel

STRAIGHT = 0.999999
"""Cosine beyond which a junction counts as straight, or as a full turn back (GRBL's own figure)."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a machine can do. Rates in mm/min, accelerations in mm/s², for the axes x and y or the motors A and B."""

    rate: tuple[float, float]
    acceleration: tuple[float, float]
    junction_deviation: float = 0.01
    """mm between a corner and the circle on which it is taken ($11)."""
    lookahead: int = 15
    """Blocks that the planner sees at once; GRBL's ring of 16 holds 15."""
    steps_mm: float | None = None
    """Steps per mm: corners are rounded to whole steps as the machine does ($100); None keeps them exact."""
    kinematics: Literal["cartesian", "corexy"] = "cartesian"

    def __post_init__(self) -> None:
        for name in ("rate", "acceleration"):
            if not all(0 < value < np.inf for value in getattr(self, name)):
                raise InputError(f"{name} {getattr(self, name)} must be above 0 for both axes")
        if not 0 <= self.junction_deviation < np.inf:
            raise InputError(f"junction_deviation {self.junction_deviation} must be a length in mm, 0 or more")
        if self.lookahead < 1:
            raise InputError(f"lookahead {self.lookahead} must be at least 1 block")
        if self.steps_mm is not None and not 0 < self.steps_mm < np.inf:
            raise InputError(f"steps_mm {self.steps_mm} must be above 0")


@dataclass(frozen=True, slots=True)
class Pen:
    """Seconds for which the machine stands still while the pen goes down, and up."""

    down_s: float = 0.0
    up_s: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.down_s < np.inf and 0 <= self.up_s < np.inf):
            raise InputError(f"pen delays {self.down_s} and {self.up_s} must be seconds, 0 or more")


@dataclass(frozen=True, slots=True)
class Instants:
    """Where the pen is at some times: points (k, 2), speeds (k,) mm/s, whether it is down, and its stroke."""

    points: NDArray[np.float64]
    speeds: NDArray[np.float64]
    down: NDArray[np.bool_]
    strokes: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Motion:
    """Blocks in the order of time, as columns of b values. Speeds in mm/s, times in s."""

    begin: NDArray[np.float64]
    """(b, 2) mm."""
    end: NDArray[np.float64]
    stroke: NDArray[np.int64]
    """The stroke that a block draws, or leads to."""
    down: NDArray[np.bool_]
    """Whether a block is drawn."""
    acceleration: NDArray[np.float64]
    entry: NDArray[np.float64]
    cruise: NDArray[np.float64]
    """The largest speed within the block."""
    exit: NDArray[np.float64]
    began: NDArray[np.float64]
    """When the block begins."""
    duration: NDArray[np.float64]
    travel_s: NDArray[np.float64]
    """(n,) seconds on the way to each stroke, the pen up."""
    draw_s: NDArray[np.float64]
    """(n,) seconds that each stroke is drawn for."""
    pen: Pen

    @property
    def stroke_s(self) -> NDArray[np.float64]:
        """(n,) seconds for each stroke with all that belongs to it."""
        return self.travel_s + self.draw_s + (self.pen.down_s + self.pen.up_s)

    @property
    def total_s(self) -> float:
        """Seconds for the whole job."""
        return float(self.stroke_s.sum())

    def by(self, members: ArrayLike) -> dict[int, float]:
        """Seconds for each layer, pen or whatever number `members` (n,) gives each stroke."""
        kinds, member = np.unique(np.asarray(members), return_inverse=True)
        sums = np.bincount(member, self.stroke_s, len(kinds))
        return dict(zip(kinds.tolist(), sums.tolist(), strict=True))

    def at(self, times: ArrayLike) -> Instants:
        """Where the pen is at `times` (k,) in seconds; before the start and after the end it stands."""
        t = np.atleast_1d(np.asarray(times, np.float64))
        if not len(self.began):
            raise InputError("a motion without a move is nowhere")
        k = np.clip(np.searchsorted(self.began, t, "right") - 1, 0, len(self.began) - 1)
        into = np.clip(t - self.began[k], 0, self.duration[k])
        way, speed = _along(into, self.acceleration[k], self.entry[k], self.cruise[k], self.exit[k], self.duration[k])
        step = self.end[k] - self.begin[k]
        length = np.hypot(*step.T)
        moving = (t >= self.began[k]) & (t < self.began[k] + self.duration[k])
        points = self.begin[k] + step * np.minimum(way / length, 1)[:, None]
        return Instants(points, np.where(moving, speed, 0.0), self.down[k] & moving, self.stroke[k])


def plan(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    limits: Limits,
    feed: ArrayLike,
    *,
    pen: Pen | None = None,
    start: tuple[float, float] = (0.0, 0.0),
) -> Motion:
    """The motion that draws polylines one after the other, from rest at `start`.

    points  (p, 2) mm; starts (n + 1,): where each polyline begins.
    feed    mm/min while drawing, one for all or (n,); travels are as fast as the axes can.

    Raises InputError for points that are no numbers and feeds that are not above 0.
    """
    pen = pen or Pen()
    starts = np.asarray(starts, np.int64)
    n = len(starts) - 1
    points = _check(points, starts, n)
    feeds = np.broadcast_to(np.asarray(feed, np.float64), (n,))
    if not np.all((feeds > 0) & (feeds < np.inf)):
        raise InputError(f"feed {feed!r} must be above 0 mm/min")
    begin, end, stroke, down = _blocks(points, starts, start, limits.steps_mm)
    speed2, acceleration, length, junction2 = _bounds(begin, end, stroke, down, limits, feeds / 60)
    entry2, exit2 = _speeds(speed2, acceleration, length, junction2, limits.lookahead)
    peak2 = np.minimum(speed2, (entry2 + exit2) / 2 + acceleration * length)
    entry, cruise, leave = np.sqrt(entry2), np.sqrt(np.maximum(peak2, np.maximum(entry2, exit2))), np.sqrt(exit2)
    ramps = (2 * cruise**2 - entry2 - exit2) / (2 * acceleration)
    duration = (2 * cruise - entry - leave) / acceleration + np.maximum(length - ramps, 0) / cruise
    travel_s = np.bincount(stroke[~down], duration[~down], n).astype(np.float64)
    draw_s = np.bincount(stroke[down], duration[down], n).astype(np.float64)
    began = np.concatenate([[0.0], np.cumsum(duration)[:-1]])[: len(duration)]
    began = began + (pen.down_s + pen.up_s) * stroke + pen.down_s * down
    return Motion(
        begin, end, stroke, down, acceleration, entry, cruise, leave, began, duration, travel_s, draw_s, pen
    )  # fmt: skip


def _check(points: NDArray[np.float64], starts: NDArray[np.int64], n: int) -> NDArray[np.float64]:
    points = np.ascontiguousarray(points, np.float64)
    if points.ndim != 2 or points.shape[1:] != (2,):
        raise InputError(f"points are {points.shape}, must be (p, 2)")
    if n < 0 or starts[0] != 0 or starts[-1] != len(points) or np.any(np.diff(starts) < 1):
        raise InputError(f"starts must rise from 0 to the number of points, {len(points)}")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f"point {bad[0]} is no number: {points[bad[0]].tolist()}")
    return points


def _blocks(
    points: NDArray[np.float64], starts: NDArray[np.int64], start: tuple[float, float], steps_mm: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
    """Moves between all points in order; those of no length are left out, as the machine does."""
    if steps_mm is not None:
        points = np.rint(points * steps_mm) / steps_mm
    begin = np.concatenate([np.array([start], np.float64), points[:-1]])[: len(points)]
    down = np.ones(len(points), np.bool_)
    down[starts[:-1]] = False
    stroke = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    moves = np.any(begin != points, axis=1)
    return begin[moves], points[moves], stroke[moves], down[moves]


def _bounds(
    begin: NDArray[np.float64],
    end: NDArray[np.float64],
    stroke: NDArray[np.int64],
    down: NDArray[np.bool_],
    limits: Limits,
    feeds: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Of each block the squared nominal speed, acceleration, length and squared speed of the junction before it."""
    step = end - begin
    length = np.hypot(*step.T)
    unit = step / length[:, None]
    speed = _within(np.array(limits.rate) / 60, unit, limits)
    speed = np.where(down, np.minimum(speed, feeds[stroke]), speed)
    acceleration = _within(np.array(limits.acceleration), unit, limits)
    junction2 = np.zeros(len(length))
    joined = (stroke[1:] == stroke[:-1]) & (down[1:] == down[:-1])
    junction2[1:] = np.where(joined, _junctions2(unit, limits), 0.0)
    junction2[1:] = np.minimum(junction2[1:], np.minimum(speed[1:], speed[:-1]) ** 2)
    return speed**2, acceleration, length, junction2


def _within(most: NDArray[np.float64], unit: NDArray[np.float64], limits: Limits) -> NDArray[np.float64]:
    """The largest value along the directions `unit` (b, 2) for which no axis has more than its `most`."""
    axes = unit if limits.kinematics == "cartesian" else np.stack([unit[:, 0] + unit[:, 1], unit[:, 0] - unit[:, 1]], 1)
    with np.errstate(divide="ignore"):
        largest: NDArray[np.float64] = (most / np.abs(axes)).min(axis=1, initial=np.inf)
    return largest


def _junctions2(unit: NDArray[np.float64], limits: Limits) -> NDArray[np.float64]:
    """Squared speed on the circle that passes each corner (b − 1,) at the junction deviation."""
    cosine = -np.sum(unit[1:] * unit[:-1], axis=1)
    turn = unit[1:] - unit[:-1]
    norm = np.hypot(*turn.T)
    straight = cosine < -STRAIGHT
    turn = turn / np.where(norm > 0, norm, 1)[:, None]
    half = np.sqrt(0.5 * (1 - np.clip(cosine, -1, 1)))
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = _within(np.array(limits.acceleration), turn, limits)
        corner = bend * limits.junction_deviation * half / (1 - half)
    return np.where(straight, np.inf, np.where(cosine > STRAIGHT, 0.0, corner))


@kernel
def _speeds(
    speed2: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    length: NDArray[np.float64],
    junction2: NDArray[np.float64],
    lookahead: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Squared speeds at which blocks are entered and left.

    Backwards: a block is entered only as fast as it can stop within what the planner saw when the block
    before it began, `lookahead` blocks with that one. Forwards: only as fast as that one can have become.
    """
    n = len(length)
    entry2, exit2 = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        v2 = 0.0
        for j in range(min(k + lookahead - 2, n - 1), k - 1, -1):
            v2 = min(junction2[j], v2 + 2.0 * acceleration[j] * length[j])
        v2 = min(v2, entry2[k - 1] + 2.0 * acceleration[k - 1] * length[k - 1])
        entry2[k] = exit2[k - 1] = v2
    return entry2, exit2


def _along(
    t: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    entry: NDArray[np.float64],
    cruise: NDArray[np.float64],
    leave: NDArray[np.float64],
    duration: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Way (mm) and speed t seconds into blocks: up the ramp, along the top, down the ramp."""
    up, fall = (cruise - entry) / acceleration, (cruise - leave) / acceleration
    rise, left = np.minimum(t, up), np.minimum(duration - t, fall)
    level = np.clip(t - up, 0, np.maximum(duration - up - fall, 0))
    down = np.maximum(t - (duration - fall), 0)
    way = entry * rise + acceleration * rise**2 / 2 + cruise * level + cruise * down - acceleration * down**2 / 2
    speed = np.minimum(entry + acceleration * rise, leave + acceleration * left)
    return way, speed
