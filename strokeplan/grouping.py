"""Strokes gathered into layers by colour or by pen, so that each can be shown, hidden or plotted by itself.

Paint covers what lies below it, so its order is part of the picture: a layer of paint falls into runs of
consecutive strokes of one colour, and a colour has as many layers as it has runs. Ink and pens lay lines
whose order does not show: all strokes of a colour of ink become one layer, and so do all of a pen.

Known limit: opaque inks of several colours that cross show the later one on top; that may be another
after gathering.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.formats.json import hex_colors
from strokeplan.formats.options import GroupBy
from strokeplan.strokes import Layer, StrokePlan

NO_PEN = "no pen"


def regroup(plan: StrokePlan, by: GroupBy) -> StrokePlan:
    """The plan with layers by colour or by pen, named after it ("#aabbcc", the pen's name); its picture is the same.

    No layer mixes media or caps. Raises InputError for pens that a plan does not name.
    """
    if by == "layer":
        return plan
    if by == "pen" and plan.pens is None:
        raise InputError("no stroke of the plan names a pen; group by layer or by colour")
    labels = _labels(plan, by)
    runs: dict[tuple[str, str, str, int], list[int]] = {}
    run = 0
    for layer in plan.layers:
        ordered = by == "colour" and layer.medium == "paint"
        for i in range(layer.first, layer.last):
            # Paint begins a group with every change of colour; ink and pens know a group by its name alone.
            run += ordered and (i == layer.first or labels[i] != labels[i - 1])
            runs.setdefault((labels[i], layer.medium, layer.cap, run if ordered else -1), []).append(i)
    order = np.fromiter((i for strokes in runs.values() for i in strokes), np.int64, len(plan))
    ends = np.cumsum([len(strokes) for strokes in runs.values()], dtype=np.int64).tolist()
    layers = tuple(
        Layer(name, end - len(strokes), end, medium, cap)  # type: ignore[arg-type]
        for ((name, medium, cap, _), strokes), end in zip(runs.items(), ends, strict=True)
    )
    return replace(reordered(plan, order), layers=layers)


def _labels(plan: StrokePlan, by: GroupBy) -> list[str]:
    if by == "pen" and plan.pens is not None:
        return [NO_PEN if pen is None else pen for pen in plan.pens]
    return hex_colors(plan.colors)


def reordered(plan: StrokePlan, order: NDArray[np.int64]) -> StrokePlan:
    """The strokes `order` of a plan, in that order and in one layer; one may stand there more than once."""
    return replace(
        plan,
        points=plan.points[gathered(plan.starts, order)],
        starts=np.concatenate([[0], np.cumsum(plan.counts[order])]),
        widths=plan.widths[order],
        colors=plan.colors[order],
        layers=(Layer("", 0, len(order)),),
        pressures=None if plan.pressures is None else plan.pressures[gathered(plan.first_knots, order)],
        angles=None if plan.angles is None else plan.angles[gathered(plan.first_knots, order)],
        pens=None if plan.pens is None else tuple(plan.pens[i] for i in order.tolist()),
    )


def gathered(starts: NDArray[np.int64], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """The rows of strokes in an order: starts[i] … starts[i + 1] − 1 for each i of it."""
    counts = np.diff(starts)[order]
    ends = np.cumsum(counts)
    rows: NDArray[np.int64] = np.arange(int(counts.sum())) + np.repeat(starts[order] - (ends - counts), counts)
    return rows
