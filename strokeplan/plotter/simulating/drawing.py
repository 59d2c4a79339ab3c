"""What a simulated pen drew as a StrokePlan, to be written as SVG: one layer and colour for each pen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.recording import Drawn
from strokeplan.strokes import Layer, StrokePlan

COLOURS = (
    (0, 0, 0),
    (200, 30, 30),
    (20, 110, 200),
    (20, 140, 60),
    (230, 130, 0),
    (130, 50, 160),
    (0, 150, 160),
    (120, 80, 40),
)
"""Of pens 1 to 8, then again."""
WIDTH_MM = 0.3
DOT_MM = 0.01


def as_plan(drawn: Drawn, profile: Profile) -> StrokePlan:
    """The lines on the machine's whole travel, as one looks at it; mm."""
    machine = profile.machine
    size = np.array([machine.x_mm[1] - machine.x_mm[0], machine.y_mm[1] - machine.y_mm[0]])
    signs = {"right": (0, 1), "left": (0, -1), "down": (1, 1), "up": (1, -1)}
    (first, sign0), (second, sign1) = signs[machine.axes[0]], signs[machine.axes[1]]
    page = np.empty(2)
    page[[first, second]] = size
    order = sorted(range(len(drawn)), key=lambda k: drawn.slots[k])
    chains = []
    for k in order:
        line = drawn.lines[k] - (machine.x_mm[0], machine.y_mm[0])
        turned = np.empty_like(line)
        turned[:, first] = line[:, 0] if sign0 > 0 else size[0] - line[:, 0]
        turned[:, second] = line[:, 1] if sign1 > 0 else size[1] - line[:, 1]
        chains.append(_chain(turned))
    slots = [drawn.slots[k] for k in order]
    begins = [k for k in range(len(slots)) if k == 0 or slots[k] != slots[k - 1]]
    ends = [*begins[1:], len(slots)][: len(begins)]
    layers = [Layer(f"pen {slots[a]}", a, b, "ink") for a, b in zip(begins, ends, strict=True)]
    return StrokePlan(
        width=float(page[0]),
        height=float(page[1]),
        points=np.concatenate(chains) if chains else np.empty((0, 2)),
        starts=np.cumsum([0, *(len(chain) for chain in chains)], dtype=np.int64),
        widths=np.full(len(chains), WIDTH_MM),
        colors=np.array([COLOURS[(slot - 1) % len(COLOURS)] for slot in slots], np.uint8).reshape(-1, 3),
        layers=tuple(layers),
        pens=tuple(f"pen {slot}" for slot in slots) or None,
    )


def _chain(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """A polyline as a chain of straight cubics; a dot as a very short one."""
    if len(line) == 1:
        line = np.vstack([line, line + np.array([DOT_MM, 0.0])])
    a, b = line[:-1, None], line[1:, None]
    middle = np.concatenate([(2 * a + b) / 3, (a + 2 * b) / 3, b], axis=1).reshape(-1, 2)
    return np.concatenate([line[:1], middle])
