"""Layers by colour and by pen: every stroke in one of them, and the picture of paint as it was."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plans import TINY, plans

from strokeplan.errors import InputError
from strokeplan.grouping import NO_PEN, regroup
from strokeplan.rendering import render
from strokeplan.strokes import Layer, StrokePlan, rgb_to_hex

RED, BLUE = (200, 0, 0), (0, 0, 200)


def lines(
    colors: list[tuple[int, int, int]], medium: str = "paint", pens: tuple[str | None, ...] | None = None
) -> StrokePlan:
    """Wide lines that cross near the middle, one layer."""
    n = len(colors)
    ends = np.array([(20 + 15 * np.cos(a), 20 + 15 * np.sin(a)) for a in np.arange(n)])
    chains = [np.linspace(end, 40 - end, 4) for end in ends]
    return StrokePlan(
        width=40, height=40, points=np.concatenate(chains), starts=4 * np.arange(n + 1), widths=np.arange(3.0, 3 + n),
        colors=np.array(colors, np.uint8), layers=(Layer("1", 0, n, medium), ), pens=pens,  # type: ignore[arg-type]
    )  # fmt: skip


def strokes(plan: StrokePlan) -> list[tuple[object, ...]]:
    """Each stroke with all that it has."""
    knots = plan.first_knots
    columns = (plan.pressures, plan.angles)
    along = [[c[a:b].tobytes() if c is not None else b"" for c in columns] for a, b in pairwise(knots)]
    media = [(layer.medium, layer.cap) for layer in plan.layers for _ in range(layer.first, layer.last)]
    pens = plan.pens or (None,) * len(plan)
    return [
        (plan.stroke(i).tobytes(), plan.widths[i], tuple(plan.colors[i]), *along[i], media[i], pens[i])
        for i in range(len(plan))
    ]


@given(st.lists(st.sampled_from([RED, BLUE, (0, 99, 0)]), min_size=1, max_size=7))
def test_paint_keeps_its_order_and_its_picture(colors: list[tuple[int, int, int]]) -> None:
    plan = lines(colors)
    grouped = regroup(plan, "colour")
    np.testing.assert_array_equal(render(grouped), render(plan))
    assert strokes(grouped) == strokes(plan)
    names = [layer.name for layer in grouped.layers]
    assert all(a != b for a, b in pairwise(names))
    assert [
        name for layer, name in zip(grouped.layers, names, strict=True) for _ in range(layer.first, layer.last)
    ] == [rgb_to_hex(color) for color in colors]


def test_ink_of_a_colour_is_one_layer() -> None:
    grouped = regroup(lines([RED, BLUE, RED, BLUE, BLUE], "ink"), "colour")
    assert [(layer.name, layer.first, layer.last) for layer in grouped.layers] == [("#c80000", 0, 2), ("#0000c8", 2, 5)]
    assert grouped.widths.tolist() == [3, 5, 4, 6, 7]


def test_a_pen_is_one_layer_whatever_it_draws() -> None:
    grouped = regroup(lines([RED] * 4, pens=("fine", None, "broad", "fine")), "pen")
    assert [(layer.name, layer.first, layer.last) for layer in grouped.layers] == [
        ("fine", 0, 2), (NO_PEN, 2, 3), ("broad", 3, 4),
    ]  # fmt: skip
    assert grouped.pens == ("fine", "fine", None, "broad")


def test_pens_that_nobody_names_are_refused() -> None:
    with pytest.raises(InputError, match="names a pen"):
        regroup(lines([RED]), "pen")


def test_layers_stay_as_they_are_by_default() -> None:
    plan = lines([RED, BLUE])
    assert regroup(plan, "layer") is plan


def test_no_stroke_is_lost_and_media_and_caps_are_not_mixed() -> None:
    @given(plans(), st.sampled_from(["colour", "pen"]))
    def holds(plan: StrokePlan, by: str) -> None:
        if by == "pen" and plan.pens is None:
            return
        grouped = regroup(plan, by)  # type: ignore[arg-type]
        assert Counter(strokes(grouped)) == Counter(strokes(plan))
        assert all(layer.last > layer.first for layer in grouped.layers)

    holds()
    assert len(regroup(replace(TINY, colors=np.zeros((3, 3), np.uint8)), "colour").layers) == 2
