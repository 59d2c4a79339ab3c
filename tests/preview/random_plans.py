"""A plan of random strokes that several tests share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strokeplan.strokes import Layer, StrokePlan


def random_plan(n: int = 400, *, seed: int = 0, pressure: bool = True) -> StrokePlan:
    """Wide, middle and thin strokes in three layers, the second with butt caps, every other one with pressure."""
    rng = np.random.default_rng(seed)
    pieces = rng.integers(1, 4, n)
    counts = 3 * pieces + 1
    starts = np.concatenate([[0], np.cumsum(counts)])
    headings = np.cumsum(rng.normal(0, 0.3, starts[-1]))
    steps = rng.uniform(4, 7, (starts[-1], 1)) * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    paths = np.cumsum(steps, axis=0)
    begins = rng.uniform((0, 0), (300, 200), (n, 2))
    points = paths - np.repeat(paths[starts[:-1]] - begins, counts, axis=0)
    ends = [0, n // 10, n // 3, n]
    widths = np.empty(n)
    for width, first, last in zip((24, 8.5, 3), ends[:-1], ends[1:], strict=True):
        widths[first:last] = width
    layers = (
        Layer("1", 0, ends[1]),
        Layer("middle", ends[1], ends[2], cap="butt"),
        Layer("fine & last", ends[2], n, "ink"),
    )
    plan = StrokePlan(
        width=300,
        height=200,
        points=points,
        starts=starts.astype(np.int64),
        widths=widths,
        colors=rng.integers(0, 256, (n, 3), dtype=np.uint8),
        layers=layers,
        background=(250, 240, 230),
    )
    if not pressure:
        return plan
    pressed = np.repeat(np.arange(n) % 2 == 1, plan.knots)
    return replace(plan, pressures=np.where(pressed, rng.uniform(0.2, 1, len(pressed)), np.nan))


def first_strokes(plan: StrokePlan, n: int) -> StrokePlan:
    """The plan of the first n strokes."""
    points = int(plan.starts[n])
    return replace(
        plan,
        points=plan.points[:points],
        starts=plan.starts[: n + 1],
        widths=plan.widths[:n],
        colors=plan.colors[:n],
        layers=tuple(replace(layer, first=min(layer.first, n), last=min(layer.last, n)) for layer in plan.layers),
        pressures=None if plan.pressures is None else plan.pressures[: plan.first_knots[n]],
        angles=None,
        pens=plan.pens and plan.pens[:n],
    )
