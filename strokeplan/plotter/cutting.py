"""Strokes cut in pieces: those that nothing cuts keep their curves, the others become polylines.

A piece keeps its stroke's width, colour and pen, and has the mean of its pressure.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strokeplan.grouping import reordered
from strokeplan.strokes import Layer, StrokePlan


def rebuilt(
    plan: StrokePlan,
    whole: NDArray[np.bool_],
    vertices: NDArray[np.float64],
    counts: NDArray[np.int64],
    source: NDArray[np.int64],
) -> tuple[StrokePlan, NDArray[np.int64]]:
    """The strokes that are `whole` (n,) as they are, and pieces of others in their places; layers stay, empty ones too.

    Returns them, and the stroke that each is of.

    vertices, counts, source   polylines (v, 2) of `counts` vertices each, and the stroke that each is a piece of.
    """
    kept = np.flatnonzero(whole)
    stroke = np.concatenate([kept, source])
    order = np.argsort(stroke, kind="stable")
    rows = np.concatenate([kept, len(plan) + np.arange(len(source))])[order]
    both = _after(plan, _pieces(plan, vertices, counts, source))
    return replace(reordered(both, rows), layers=regained(plan.layers, stroke[order])), stroke[order]


def regained(layers: tuple[Layer, ...], source: NDArray[np.int64]) -> tuple[Layer, ...]:
    """The layers of strokes (m,) that are made of the strokes `source` (rising) of a plan with these layers."""
    ends: list[int] = np.searchsorted(source, [layer.last for layer in layers]).tolist()
    return tuple(
        replace(layer, first=first, last=last) for layer, first, last in zip(layers, [0, *ends[:-1]], ends, strict=True)
    )


def straight(vertices: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Polylines (v, d) of `counts` vertices each, one after the other, as chains of straight cubics."""
    firsts = np.concatenate([[0], np.cumsum(counts)])
    knots = 3 * np.arange(len(vertices)) - 2 * np.repeat(np.arange(len(counts)), counts)
    points = np.empty((3 * len(vertices) - 2 * len(counts), vertices.shape[1]))
    points[knots] = vertices
    begin = np.ones(len(vertices), np.bool_)
    begin[firsts[1:] - 1] = False  # the last of a line begins no cubic
    a = np.flatnonzero(begin)
    points[knots[a] + 1] = (2 * vertices[a] + vertices[a + 1]) / 3
    points[knots[a] + 2] = (vertices[a] + 2 * vertices[a + 1]) / 3
    return points


def _pieces(
    plan: StrokePlan, vertices: NDArray[np.float64], counts: NDArray[np.int64], source: NDArray[np.int64]
) -> StrokePlan:
    """The polylines as strokes like those they are of."""
    like = reordered(plan, source)
    pressures = None
    if plan.pressures is not None and len(plan):
        means = np.add.reduceat(plan.pressures, plan.first_knots[:-1]) / plan.knots
        pressures = np.repeat(means[source], counts)
    return StrokePlan(
        plan.width,
        plan.height,
        straight(vertices, counts),
        np.concatenate([[0], np.cumsum(3 * counts - 2)]),
        like.widths,
        like.colors,
        (Layer("", 0, len(counts)),),
        pressures=pressures,
        pens=like.pens,
    )


def _after(plan: StrokePlan, more: StrokePlan) -> StrokePlan:
    """The plan and the strokes `more` after its own, in one layer."""
    pressures, angles = None, None
    if plan.pressures is not None and more.pressures is not None:
        pressures = np.concatenate([plan.pressures, more.pressures])
    if plan.angles is not None:
        angles = np.concatenate([plan.angles, np.full(int(more.knots.sum()), np.nan)])
    return replace(
        plan,
        points=np.concatenate([plan.points, more.points]),
        starts=np.concatenate([plan.starts, len(plan.points) + more.starts[1:]]),
        widths=np.concatenate([plan.widths, more.widths]),
        colors=np.concatenate([plan.colors, more.colors]),
        layers=(Layer("", 0, len(plan) + len(more)),),
        pressures=pressures,
        angles=angles,
        pens=None if plan.pens is None else (*plan.pens, *(more.pens or ())),
    )
