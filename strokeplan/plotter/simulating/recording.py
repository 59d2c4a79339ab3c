"""What a simulated pen draws: where it was while it was down, and where it rested on the paper.

A pen needs time to come down and to lift: a change is ordered with the time at which it takes effect, and one that is
ordered before the last took effect replaces it, as a servo does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Spot = tuple[float, float]
REST_S = 1.0
"""Standing this long with the pen down is a rest: ink runs."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """What was drawn, in order.

    lines   (n_i, 2) mm in the machine's frame; a dot is one point.
    times   (n_i,) seconds of each of these points.
    slots   the pen of each line.
    rests   (begin, end) seconds of every rest of the pen on the paper.
    """

    lines: tuple[NDArray[np.float64], ...]
    times: tuple[NDArray[np.float64], ...]
    slots: tuple[int, ...]
    rests: tuple[tuple[float, float], ...]

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def length_mm(self) -> float:
        """How much was drawn."""
        return float(sum(np.hypot(*np.diff(line, axis=0).T).sum() for line in self.lines if len(line) > 1))


class Recorder:
    """Follows one pen."""

    def __init__(self, at: Spot = (0.0, 0.0), *, down: bool = False) -> None:
        self.at = at
        self.down = down
        self.slot = 1
        self._ordered: tuple[float, bool] | None = None
        self._since = 0.0
        self._lines: list[list[tuple[float, float, float]]] = []
        self._slots: list[int] = []
        self._rests: list[tuple[float, float]] = []
        if down:
            self._begin(0.0)

    def pen(self, effective_s: float, *, down: bool) -> None:
        """Order the pen down or up, from that time on."""
        self._ordered = (effective_s, down) if down != self.down else None

    def swap(self, slot: int) -> None:
        """Another pen is held from now on."""
        self.slot = slot

    def carry(self, at: Spot, at_s: float) -> None:
        """The pen is moved by hand: nothing is drawn on the way."""
        self.settle(at_s)
        self.at = at
        if self.down:
            self._begin(at_s)

    def lift(self, at_s: float) -> None:
        """The pen is up, at once."""
        self.settle(at_s)
        self._ordered = None
        self._change(at_s, down=False)

    def settle(self, until_s: float) -> None:
        """What was ordered takes effect, if its time has come."""
        if self._ordered and self._ordered[0] <= until_s:
            at_s, down = self._ordered
            self._ordered = None
            self._change(at_s, down=down)

    def freeze(self, at_s: float) -> None:
        """No power: what was ordered and has not happened never will."""
        self.settle(at_s)
        self._ordered = None

    def move(self, begin_s: float, end_s: float, to: Spot) -> None:
        """A straight move from where the pen is, at an even speed."""
        self.settle(begin_s)
        if self._ordered and self._ordered[0] < end_s:
            part = (self._ordered[0] - begin_s) / (end_s - begin_s)
            middle = self.at[0] + part * (to[0] - self.at[0]), self.at[1] + part * (to[1] - self.at[1])
            middle_s = self._ordered[0]
            self._go(begin_s, middle_s, middle)
            self.settle(middle_s)
            begin_s = middle_s
        self._go(begin_s, end_s, to)

    def drawn(self, now_s: float) -> Drawn:
        """All until now."""
        lines = [np.array(line) for line in self._lines]
        rests = list(self._rests)
        if self.down and now_s - self._since >= REST_S:
            rests.append((self._since, now_s))
        return Drawn(
            tuple(line[:, :2] for line in lines), tuple(line[:, 2] for line in lines), tuple(self._slots), tuple(rests)
        )

    def _begin(self, at_s: float) -> None:
        self._lines.append([(*self.at, at_s)])
        self._slots.append(self.slot)
        self._since = at_s

    def _rested(self, until_s: float) -> None:
        if until_s - self._since >= REST_S:
            self._rests.append((self._since, until_s))

    def _change(self, at_s: float, *, down: bool) -> None:
        if self.down and not down:
            self._rested(at_s)
        self.down = down
        if down:
            self._begin(at_s)

    def _go(self, begin_s: float, end_s: float, to: Spot) -> None:
        if to == self.at:
            return
        if self.down:
            self._rested(begin_s)
            self._lines[-1].append((*to, end_s))
            self._since = end_s
        self.at = to
