"""Plans that the tests of several formats share: one by hand, and any valid one by Hypothesis."""

from __future__ import annotations

from dataclasses import fields
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from strokeplan.strokes import MAX_COORDINATE, MAX_SIZE, MIN_SIZE, Layer, Source, StrokePlan

TINY = StrokePlan(
    width=20,
    height=10,
    points=np.array(
        [
            *((2, 5), (7, 5), (13, 5), (18, 5)),
            *((2, 2), (4, 0.5), (6, 0.5), (8, 2), (10, 3.5), (12, 3.5), (14, 2.25)),
            *((1, 9), (5, 7.25), (15, 7.25), (19, 9)),
        ]
    ),
    starts=np.array([0, 4, 11, 15], np.int64),
    widths=np.array([4, 2.5, 0.5]),
    colors=np.array([(204, 51, 34), (0, 68, 170), (17, 17, 17)], np.uint8),
    layers=(Layer("wide", 0, 2), Layer("fine & last", 2, 3, "ink", "butt")),
    background=(255, 253, 240),
    settings={"strokeplan": "0", "seed": 7, "preset": {"name": "by hand", "layers": []}},
    source=Source("tiny.png", "00ff" * 16, 20, 10),
    pressures=np.array([np.nan, np.nan, np.nan, np.nan, np.nan, 0.25, 1]),
    angles=np.array([np.nan, np.nan, np.nan, np.nan, np.nan, 1.5, 0]),
    pens=(None, None, "black"),
)
"""The plan of golden/tiny.json and golden/tiny.svg."""


def assert_same(a: StrokePlan, b: StrokePlan) -> None:
    """Fail unless two plans agree in every field, columns to the last bit and type."""
    for field in fields(StrokePlan):
        left, right = getattr(a, field.name), getattr(b, field.name)
        if isinstance(left, np.ndarray):
            np.testing.assert_array_equal(left, right, err_msg=field.name, strict=True)
        else:
            assert left == right, field.name


def _json_values() -> st.SearchStrategy[Any]:
    leaves = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
    return st.recursive(leaves, lambda v: st.lists(v, max_size=3) | st.dictionaries(st.text(), v, max_size=3))


@st.composite
def plans(draw: st.DrawFn) -> StrokePlan:
    """Any plan: empty layers and no layers, strokes with and without pressure, angle and pen, any text, any size."""
    sizes = st.floats(MIN_SIZE, MAX_SIZE)
    layer_lengths = draw(st.lists(st.integers(0, 3), max_size=3))
    ends = accumulate(layer_lengths, initial=0)
    layers = tuple(
        Layer(draw(st.text()), first, last, draw(st.sampled_from(["paint", "ink"])), draw(_caps()))
        for first, last in pairwise(ends)
    )
    n = sum(layer_lengths)
    pieces = draw(st.lists(st.integers(1, 3), min_size=n, max_size=n))
    counts = [3 * k + 1 for k in pieces]
    p = sum(counts)
    coordinates = st.floats(-MAX_COORDINATE, MAX_COORDINATE) | st.integers(-9999, 99999).map(lambda v: v / 100)
    numbers = draw(st.lists(coordinates, min_size=2 * p, max_size=2 * p))
    source = st.builds(Source, st.text(), st.text(), st.integers(1, 10**6), st.integers(1, 10**6))
    return StrokePlan(
        width=draw(sizes),
        height=draw(sizes),
        points=np.array(numbers, np.float64).reshape(p, 2),
        starts=np.array([*accumulate(counts, initial=0)], np.int64),
        widths=np.array(draw(st.lists(st.floats(0, MAX_SIZE, exclude_min=True), min_size=n, max_size=n)), np.float64),
        colors=np.array(draw(st.lists(_colors(), min_size=n, max_size=n)), np.uint8).reshape(n, 3),
        layers=layers,
        background=draw(_colors()),
        settings=draw(st.dictionaries(st.text(), _json_values(), max_size=3)),
        source=draw(st.none() | source),
        pressures=draw(_along([k + 1 for k in pieces], st.floats(0, 1))),
        angles=draw(_along([k + 1 for k in pieces], st.floats(0, np.pi, exclude_max=True))),
        pens=draw(st.none() | st.tuples(*[st.none() | st.text()] * n).filter(any)),
    )


def _caps() -> st.SearchStrategy[Any]:
    return st.sampled_from(["round", "butt"])


def _colors() -> st.SearchStrategy[tuple[int, int, int]]:
    return st.tuples(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))


@st.composite
def _along(draw: st.DrawFn, knots: list[int], values: st.SearchStrategy[float]) -> NDArray[np.float64] | None:
    """Values at the on-curve points of some of the strokes; None if of none."""
    strokes = [draw(st.none() | st.lists(values, min_size=k, max_size=k)) for k in knots]
    if not any(strokes):
        return None
    return np.concatenate(
        [np.full(k, np.nan) if given is None else given for k, given in zip(knots, strokes, strict=True)]
    )
