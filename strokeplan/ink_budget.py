"""The best drawing that a budget of strokes, length or time allows for.

A budget is met by giving ink a price: of each demand so much is granted as makes the squared difference and the price
together least, which for a given sum of ink leaves the least sum of squared differences. A difference is one of tone,
half as it is seen (L*), half as it is measured (the part of the paper that is covered): as an eye sees, ink does most
where there is much already, so shadows keep their depth and the lightest tones are the first to stay paper.

What a drawing costs follows the ink that is granted, nearly: the price is found by a secant on the logarithms of both,
within a bracket, and the first guess is as good as that rule.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Sequence
from math import isfinite, log

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.ink_presets import InkRecipe
from strokeplan.separation import lightness
from strokeplan.strokes import StrokePlan

Budget = tuple[Callable[[StrokePlan], float], float]
"""What a plan costs, and the most that it may."""

SEARCHES = 10
"""Drawings made at most to find the one for a budget."""
NEAR_ENOUGH = 0.97
"""A drawing that uses this part of a budget is the one."""
AIM = 0.985
"""The part of a budget that the next drawing aims at: two with nearly the same λ differ by some half a per cent."""
SEEN = 0.5
"""The part of a difference that is one of L*; the rest is one of coverage, in hundredths."""
LEVELS = 401
"""Demands are granted by a table of so many, from 0 to 1."""
COARSELY = 4
"""The ink that is asked for is summed over every so many-th pixel."""
SECONDS = {"h": 3600.0, "min": 60.0, "m": 60.0, "s": 1.0}


def own_budgets(recipe: InkRecipe) -> list[Budget]:
    """What a recipe allows for in strokes and length. Raises InputError."""
    found: list[Budget] = []
    if recipe.strokes is not None:
        if recipe.strokes < 1:
            raise InputError(f"strokes {recipe.strokes} is below 1")
        found.append((len, recipe.strokes))
    if recipe.max_length_mm is not None:
        if not (isfinite(recipe.max_length_mm) and recipe.max_length_mm > 0):
            raise InputError(f"length {recipe.max_length_mm:g} mm is none; give more than 0")
        found.append((length_mm, recipe.max_length_mm))
    return found


def length_mm(plan: StrokePlan) -> float:
    """Length of all strokes in the unit of the plan: how far a pen draws."""
    from strokeplan.curves import flatten_all

    vertices, starts = flatten_all(plan.points, plan.starts, 0.01)
    steps = np.hypot(*np.diff(vertices, axis=0).T)
    inner = np.ones(len(steps), np.bool_)
    inner[starts[1:-1] - 1] = False
    return float(steps[inner].sum())


def parse_time(text: str) -> float:
    """ "90min", "1h30m", "1.5h" or "5400s" in seconds. Raises InputError."""
    parts = re.findall(r"(\d+\.?\d*|\.\d+)\s*(h|min|m|s)", text.strip().lower())
    units = [unit.removesuffix("in") for _, unit in parts]
    said = "".join(f"{number}{unit}" for number, unit in parts)
    if not parts or said != re.sub(r"\s", "", text.lower()) or units != sorted(set(units), key="hms".index):
        raise InputError(f"max-time {reprlib.repr(text)} is no time; give one like 90min, 1h30m, 1.5h or 5400s")
    return sum(float(number) * SECONDS[unit] for number, unit in parts)


def within(
    drawing: Callable[[float], StrokePlan], demands: Sequence[NDArray[np.float32]], budgets: Sequence[Budget]
) -> StrokePlan:
    """The drawing of the most ink that all budgets allow for.

    `drawing` makes that of a price, at which it grants what is asked for in `demands`. Raises InputError where not even
    a stroke fits.
    """
    best = drawing(0.0)
    share = _share(best, budgets)
    if share <= 1:
        return best
    asked = _Asked(demands)
    low, high = 0.0, asked.highest
    fits, used = None, 0.0
    power, before = 1.0, (asked.ink(0.0), share)
    for _ in range(SEARCHES):
        ink, cost = before
        guess = asked.price(ink * (AIM / cost) ** (1 / power)) if cost > 0 else low
        if not low < guess < high:
            guess = 0.5 * (low + high)
        plan = drawing(guess)
        share = _share(plan, budgets)
        if used < share <= 1:
            fits, used = plan, share
        if NEAR_ENOUGH <= share <= 1:
            break
        low, high = (guess, high) if share > 1 else (low, guess)
        now = asked.ink(guess), share
        power = _power(before, now)
        before = now
    if fits is None:
        whole = _share(best, budgets)
        raise InputError(f"no stroke fits the budget, of which the whole drawing takes {whole:,.0f} times; give more")
    return fits


def grant(demand: NDArray[np.float32], price: float) -> NDArray[np.float32]:
    """(h, w) what is granted of a demand at a price of ink; at 0, all."""
    if price <= 0:
        return demand
    return np.interp(demand, _LEVELS, _granted(price)).astype(np.float32)


def _granted(price: float) -> NDArray[np.float64]:
    """(LEVELS,) what is granted of each level."""
    granted: NDArray[np.float64] = _LEVELS[np.argmin(_DIFFERENCES + price * _LEVELS, axis=1)]
    return granted


def _differences() -> NDArray[np.float64]:
    """(LEVELS, LEVELS) squared difference of each level that is asked for and each that is granted; none is more."""
    asked, granted = np.meshgrid(_LEVELS, _LEVELS, indexing="ij")
    light = lightness((1 - _LEVELS).astype(np.float32)).astype(np.float64)
    seen, measured = light[:, None] - light, 100 * (asked - granted)
    return np.where(granted > asked, np.inf, SEEN * seen**2 + (1 - SEEN) * measured**2)


_LEVELS = np.linspace(0, 1, LEVELS)
_DIFFERENCES = _differences()


class _Asked:
    """How much ink is granted at a price."""

    def __init__(self, demands: Sequence[NDArray[np.float32]]) -> None:
        values = np.concatenate([demand[::COARSELY, ::COARSELY].ravel() for demand in demands])
        self._pixels = np.bincount(np.rint(values * (LEVELS - 1)).astype(np.int64), minlength=LEVELS)
        self.highest = 1.0
        while self.ink(self.highest) > 0:
            self.highest *= 2

    def ink(self, price: float) -> float:
        """The sum of what is granted."""
        return float(self._pixels @ _granted(price))

    def price(self, ink: float) -> float:
        """The price at which that sum is `ink`."""
        low, high = 0.0, self.highest
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.ink(middle) > ink else (low, middle)
        return 0.5 * (low + high)


def _power(before: tuple[float, float], now: tuple[float, float]) -> float:
    """p where cost is as ink to the power p, from two drawings (ink, cost)."""
    if min(*before, *now) <= 0 or abs(log(now[0] / before[0])) < 1e-6:
        return 1.0
    return min(max(log(now[1] / before[1]) / log(now[0] / before[0]), 0.3), 3.0)


def _share(plan: StrokePlan, budgets: Sequence[Budget]) -> float:
    """How much of the tightest budget a plan takes."""
    return max((cost(plan) / limit for cost, limit in budgets), default=0.0)
