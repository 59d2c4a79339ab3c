"""A planner's queue of straight blocks and the motors behind it, in time.

Blocks are trapezoids of speed with look-ahead over what the queue holds when a block begins; a block that has begun is
not planned again. Times are near those of a real planner, order and buffering are the same.

The pen's real place is what the firmware counts plus a slip: motors that are stopped dead run on by the way they would
have needed to brake, and the count does not know.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import inf, sqrt

Place = tuple[float, float, float]
STRAIGHT = 0.999999


@dataclass(frozen=True, slots=True)
class Axes:
    """What the motors can do, for x, y, z: mm/s and mm/s²."""

    rate: Place
    acceleration: Place
    deviation_mm: float = 0.01


@dataclass(slots=True)
class Block:
    """A straight move; `speed` and `entry` in mm/s, `entry` the most at its beginning."""

    start: Place
    end: Place
    length: float
    unit: Place
    speed: float
    acceleration: float
    entry: float


@dataclass(slots=True)
class Run:
    """A block on its way: from `begin_s`, at v0 to begin with, cruise, and v1 at its end."""

    block: Block
    begin_s: float
    v0: float
    cruise: float
    v1: float
    rise_s: float
    flat_s: float
    fall_s: float
    braked: bool = False
    """It ends at rest wherever it does: a feed hold."""
    stop: Place | None = None

    @property
    def end_s(self) -> float:
        return self.begin_s + self.rise_s + self.flat_s + self.fall_s

    def speed(self, at_s: float) -> float:
        """mm/s at a time."""
        t = at_s - self.begin_s
        if t < self.rise_s:
            return self.v0 + (self.cruise - self.v0) * t / self.rise_s
        t -= self.rise_s + self.flat_s
        if t <= 0:
            return self.cruise
        return self.v1 if t >= self.fall_s else self.cruise + (self.v1 - self.cruise) * t / self.fall_s

    def way(self, at_s: float) -> float:
        """mm made until a time."""
        t = max(at_s - self.begin_s, 0.0)
        rise = min(t, self.rise_s)
        flat = min(max(t - self.rise_s, 0.0), self.flat_s)
        fall = min(max(t - self.rise_s - self.flat_s, 0.0), self.fall_s)
        way = self.v0 * rise + self.cruise * (flat + fall)
        if self.rise_s:
            way += (self.cruise - self.v0) * rise * rise / (2 * self.rise_s)
        if self.fall_s:
            way -= (self.cruise - self.v1) * fall * fall / (2 * self.fall_s)
        return way

    def at(self, at_s: float) -> Place:
        """Where it is at a time."""
        if at_s >= self.end_s:
            return self.block.end if self.stop is None else self.stop
        part = min(self.way(at_s) / self.block.length, 1.0) if self.block.length else 1.0
        a, b = self.block.start, self.block.end
        return a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])


class Steppers:
    """The queue, the block that runs, and where the count stands."""

    def __init__(self, axes: Axes, size: int) -> None:
        self.axes, self.size = axes, size
        self.queue: deque[Block] = deque()
        self.run: Run | None = None
        self.count: Place = (0.0, 0.0, 0.0)
        """Where the firmware thinks that the pen is."""
        self.planned: Place = self.count
        """Where the last block of the queue ends."""

    @property
    def held(self) -> int:
        """Blocks in the ring: the one that runs keeps its place until it is done."""
        return len(self.queue) + (self.run is not None)

    @property
    def full(self) -> bool:
        return self.held >= self.size

    @property
    def idle(self) -> bool:
        return self.run is None and not self.queue

    def add(self, end: Place, speed_mm_s: float = inf) -> bool:
        """A move from where the last one ends; False if it goes nowhere."""
        start = self.planned
        d = end[0] - start[0], end[1] - start[1], end[2] - start[2]
        length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        if length < 1e-9:
            return False
        unit = d[0] / length, d[1] / length, d[2] / length
        speed, acceleration = max(speed_mm_s, 1e-3), inf
        for u, rate, most in zip(unit, self.axes.rate, self.axes.acceleration, strict=True):
            if u:
                speed, acceleration = min(speed, rate / abs(u)), min(acceleration, most / abs(u))
        last = self.queue[-1] if self.queue else self.run.block if self.run else None
        entry = 0.0 if last is None else min(self._corner(last.unit, unit, acceleration), speed, last.speed)
        self.queue.append(Block(start, end, length, unit, speed, acceleration, entry))
        self.planned = end
        return True

    def _corner(self, a: Place, b: Place, acceleration: float) -> float:
        cosine = -(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
        if cosine > STRAIGHT:
            return 0.0
        if cosine < -STRAIGHT:
            return inf
        half = sqrt(0.5 * (1 - cosine))
        return sqrt(acceleration * self.axes.deviation_mm * half / (1 - half))

    def begin(self, at_s: float, v0: float = 0.0) -> None:
        """The next block sets out, if none runs."""
        if self.run is not None or not self.queue:
            return
        v1 = 0.0
        for block in reversed(list(self.queue)[1:]):
            v1 = min(block.entry, sqrt(v1 * v1 + 2 * block.acceleration * block.length))
        block = self.queue.popleft()
        self.run = _trapezoid(block, at_s, min(v0, block.speed), min(v1, block.speed))

    def finish(self) -> Run:
        """The block that runs is done: the count is at its end. Returns it."""
        run = self.run
        if run is None:
            raise ValueError("no block runs")
        self.count = run.block.end if run.stop is None else run.stop
        self.run = None
        if run.stop is not None and run.stop != run.block.end:  # the rest of a braked block is still to be done
            block = run.block
            left = block.length - run.way(run.end_s)
            self.queue.appendleft(
                Block(run.stop, block.end, max(left, 1e-9), block.unit, block.speed, block.acceleration, 0.0)
            )
        return run

    def brake(self, at_s: float) -> None:
        """The block that runs comes to rest as soon as it can, at its end at the latest."""
        run = self.run
        if run is None or run.braked:
            return
        v, made, block = run.speed(at_s), run.way(at_s), run.block
        left = max(block.length - made, 0.0)
        way = min(v * v / (2 * block.acceleration), left)
        here = run.at(at_s)
        stop = here[0] + way * block.unit[0], here[1] + way * block.unit[1], here[2] + way * block.unit[2]
        whole = block.length - made - way < 1e-9
        part = Block(here, block.end, max(left, 1e-12), block.unit, block.speed, block.acceleration, 0.0)
        fall_s = 2 * way / v if v > 0 else 0.0
        self.run = Run(part, at_s, v, v, 0.0, 0.0, 0.0, fall_s, braked=True, stop=block.end if whole else stop)

    def kill(self, at_s: float) -> tuple[float, float]:
        """Stop dead and forget the queue; the slip (x, y) in mm of motors stopped at speed."""
        slip = (0.0, 0.0)
        if self.run is not None:
            v, block = self.run.speed(at_s), self.run.block
            self.count = self.run.at(at_s)
            over = v * v / (2 * block.acceleration)
            slip = over * block.unit[0], over * block.unit[1]
        self.run = None
        self.queue.clear()
        self.planned = self.count
        return slip

    def place(self, at_s: float) -> Place:
        """Where the count stands at a time."""
        return self.count if self.run is None else self.run.at(at_s)

    def reset(self, count: Place) -> None:
        """The count is set, at rest."""
        self.queue.clear()
        self.run = None
        self.count = self.planned = count


def _trapezoid(block: Block, begin_s: float, v0: float, v1: float) -> Run:
    a, length = block.acceleration, block.length
    v1 = min(v1, sqrt(v0 * v0 + 2 * a * length))
    peak = sqrt(max(a * length + (v0 * v0 + v1 * v1) / 2, 0.0))
    cruise = max(min(block.speed, peak), v0, v1)
    rise, fall = (cruise * cruise - v0 * v0) / (2 * a), (cruise * cruise - v1 * v1) / (2 * a)
    if rise + fall > length * (1 + 1e-9):  # entered faster than it can brake: brakes harder
        return Run(block, begin_s, v0, v0, v1, 0.0, 0.0, 2 * length / (v0 + v1))
    return Run(
        block, begin_s, v0, cruise, v1, (cruise - v0) / a, max(length - rise - fall, 0.0) / cruise, (cruise - v1) / a
    )
