"""StrokePlan: what a plan promises, and that an empty one is a plan too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import strokeplan
from strokeplan.evaluate import evaluate
from strokeplan.image import Photo
from strokeplan.strokes import Layer, Source, StrokePlan, describe, hex_to_rgb, rgb_to_hex

FIRST = np.array([(1, 1), (2, 3), (4, 3), (5, 1)], float)
SECOND = np.array([(0, 9), (1, 8), (2, 8), (3, 9), (4, 10), (5, 10), (6, 9)], float)


def two_strokes(**changes: Any) -> StrokePlan:
    """A plan of two strokes in two layers, with some fields replaced."""
    fields: dict[str, Any] = {
        "width": 12,
        "height": 10,
        "points": np.concatenate([FIRST, SECOND]),
        "starts": np.array([0, 4, 11], np.int64),
        "widths": np.array([3.0, 1.5]),
        "colors": np.array([(255, 0, 16), (255, 0, 16)], np.uint8),
        "layers": (Layer("wide", 0, 1), Layer("fine", 1, 2, "ink", "butt")),
    }
    return StrokePlan(**{**fields, **changes})


def empty(*layers: Layer) -> StrokePlan:
    """A plan without strokes."""
    none = np.empty(0)
    return StrokePlan(6, 4, none.reshape(0, 2), np.zeros(1, np.int64), none, np.empty((0, 3), np.uint8), layers)


# What holds for every plan


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"points": np.zeros((11, 3))}, r"points must be \(11, 2\) float64, not \(11, 3\) float64"),
        ({"points": np.zeros((11, 2), np.float32)}, r"points must be \(11, 2\) float64, not \(11, 2\) float32"),
        ({"points": np.zeros((12, 2))}, "starts must begin with 0 and end with the number of points, 12"),
        ({"starts": np.array([4, 7, 11])}, "starts must begin with 0"),
        ({"starts": np.array([0, 11])}, r"starts must be \(3,\) int64, not \(2,\) int64"),
        ({"starts": np.array([0.0, 4, 11])}, r"starts must be \(3,\) int64, not \(3,\) float64"),
        ({"widths": np.ones((2, 1))}, r"widths must be \(2,\) float64, not \(2, 1\) float64"),
        ({"colors": np.zeros((2, 4), np.uint8)}, r"colors must be \(2, 3\) uint8, not \(2, 4\) uint8"),
        ({"colors": np.array([(255, 0, 0)] * 2)}, r"colors must be \(2, 3\) uint8, not \(2, 3\) int64"),
        ({"starts": np.array([0, 3, 11])}, "3k \\+ 1"),
        ({"starts": np.array([0, 5, 11])}, "3k \\+ 1"),
        ({"starts": np.array([0, 1, 11])}, "3k \\+ 1"),
        ({"starts": np.array([0, 15, 11])}, "3k \\+ 1"),
        ({"layers": ()}, "layers must cover strokes 0 … 2 in order"),
        ({"layers": (Layer("", 0, 1),)}, "layers must cover"),
        ({"layers": (Layer("", 0, 1), Layer("", 0, 2))}, "layers must cover"),
        ({"layers": (Layer("", 1, 2), Layer("", 0, 1))}, "layers must cover"),
        ({"layers": (Layer("", 0, 5), Layer("", 5, 2))}, "layers must cover"),
        ({"layers": (Layer("", 0, 3),)}, "layers must cover"),
        ({"points": np.full((11, 2), np.nan)}, "a coordinate is not within ±1e\\+07"),
        ({"points": np.full((11, 2), -np.inf)}, "a coordinate is not within"),
        ({"points": np.full((11, 2), 1.1e7)}, "a coordinate is not within"),
        ({"widths": np.array([1.0, 0.0])}, "the width of a stroke is not above 0"),
        ({"widths": np.array([1.0, np.nan])}, "the width of a stroke is not above 0"),
        ({"widths": np.array([1.0, 2e6])}, "the width of a stroke is not above 0 and at most 1e\\+06"),
        ({"width": 0}, "the canvas, 0 × 10, has a side not in 0.001..1e\\+06"),
        ({"height": float("nan")}, "the canvas, 12 × nan"),
        ({"background": (255, 255, 256)}, "the background"),
        ({"background": (1, 1, 1, 1)}, "the background"),
        ({"pens": ("red",)}, "1 pens for 2 strokes"),
        ({"pressures": np.ones(4)}, r"pressures must be \(5,\) float64, not \(4,\) float64"),
        ({"pressures": np.array([0, 1, 0, 0.5, 1.5])}, "pressures of a stroke lie in 0..1"),
        ({"pressures": np.array([0, 1, 0, 0.5, np.nan])}, "pressures of a stroke lie in 0..1, or are all NaN"),
        ({"angles": np.ones(4)}, r"angles must be \(5,\) float64, not \(4,\) float64"),
        ({"angles": np.array([0, 1, 0, 0.5, np.pi])}, "angles of a stroke lie in 0..π, π itself excluded, or are all"),
        ({"angles": np.array([0, -0.1, 0, 0.5, 1])}, "angles of a stroke lie in 0..π"),
        ({"angles": np.array([0, np.nan, 0, 0.5, 1])}, "angles of a stroke lie in 0..π"),
        ({"settings": {"a": {1, 2}}}, r"\{1, 2\} is no JSON value"),
        ({"settings": {"a": [float("nan")]}}, "nan is no JSON value"),
    ],
)
def test_columns_that_do_not_fit_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        two_strokes(**changes)


@pytest.mark.parametrize("size", [(0, 5), (5, -1), (2 * 10**6, 5)])
def test_a_source_without_a_size_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="a photo of"):
        Source("a.jpg", "", *size)


def test_pressures_and_angles_may_be_given_for_some_strokes() -> None:
    plan = two_strokes(pressures=np.array([np.nan, np.nan, 0, 0.5, 1]), angles=np.array([0, 3.1, *[np.nan] * 3]))
    assert plan.pressures is not None
    assert plan.angles is not None


def test_settings_are_what_json_keeps() -> None:
    plan = two_strokes(settings={"layers": ({"width": 5}, {"width": 2.5}), "name": "\udcff", "on": True, "no": None})
    assert plan.settings == {"layers": [{"width": 5}, {"width": 2.5}], "name": "?", "on": True, "no": None}


# Reading a plan


def test_stroke_is_a_chain_of_cubics() -> None:
    plan = two_strokes()
    assert plan.stroke(0).tolist() == FIRST.tolist()
    assert plan.stroke(1).tolist() == plan.stroke(-1).tolist() == SECOND.tolist()


@pytest.mark.parametrize("i", [2, -3])
def test_there_is_no_stroke_past_the_end(i: int) -> None:
    with pytest.raises(IndexError):
        two_strokes().stroke(i)


def test_iteration_gives_every_stroke_in_painting_order() -> None:
    plan = two_strokes()
    assert [chain.tolist() for chain in plan] == [FIRST.tolist(), SECOND.tolist()]
    assert len(plan) == 2


def test_counts_of_points_knots_and_cubics() -> None:
    plan = two_strokes()
    assert (plan.counts.tolist(), plan.knots.tolist(), plan.cubics) == ([4, 7], [2, 3], 3)


def test_repr_is_short_and_tells_the_sizes() -> None:
    assert repr(two_strokes(width=12.5)) == "<StrokePlan 12.5 × 10, 2 layers, 2 strokes, 3 cubics>"


def test_notebooks_show_the_svg() -> None:
    shown = ElementTree.fromstring(two_strokes()._repr_svg_())  # noqa: S314 - our own document
    assert shown.tag == "{http://www.w3.org/2000/svg}svg"
    assert len(list(shown.iter("{http://www.w3.org/2000/svg}path"))) == 2


def test_describe_tells_what_a_plan_holds() -> None:
    plan = two_strokes(
        source=Source("cat.jpg", "", 24, 20),
        settings={"preset": {"name": "paper"}, "seed": 7, "strokeplan": "1.2"},
        widths=np.array([3.0, 1.5]),
    )
    assert describe(plan) == [
        ("canvas", "12 × 10, background #ffffff"),
        ("source", "cat.jpg, 24 × 20 pixels"),
        ("strokes", "2 of 3 cubics, 1 colours"),
        ("layer wide", "1 strokes of width 3, paint, round caps"),
        ("layer fine", "1 strokes of width 1.5, ink, butt caps"),
        ("made with", "preset paper, seed 7, strokeplan 1.2"),
    ]


def test_describe_tells_a_span_of_widths_and_leaves_out_what_is_not_there() -> None:
    assert describe(two_strokes(layers=(Layer("all", 0, 2), Layer("none", 2, 2)))) == [
        ("canvas", "12 × 10, background #ffffff"),
        ("strokes", "2 of 3 cubics, 1 colours"),
        ("layer all", "2 strokes of width 1.5 to 3, paint, round caps"),
        ("layer none", "0 strokes of width –, paint, round caps"),
    ]


def test_colours_are_hex_and_back() -> None:
    assert rgb_to_hex((255, 0, 16)) == "#ff0010"
    assert hex_to_rgb("#fF0010") == (255, 0, 16)


# A plan without strokes

EMPTY = [
    empty(),
    empty(Layer("1", 0, 0), Layer("2", 0, 0)),
    replace(empty(), pressures=np.empty(0), angles=np.empty(0), pens=()),
]


@pytest.mark.parametrize("plan", EMPTY, ids=["no layers", "empty layers", "empty columns"])
class TestEmptyPlan:
    def test_reads_as_empty(self, plan: StrokePlan) -> None:
        assert (len(plan), list(plan), plan.cubics) == (0, [], 0)
        assert repr(plan) == f"<StrokePlan 6 × 4, {len(plan.layers)} layers, 0 strokes, 0 cubics>"
        assert ("strokes", "0 of 0 cubics, 0 colours") in describe(plan)

    def test_is_painted_as_bare_canvas(self, plan: StrokePlan) -> None:
        picture = strokeplan.render(replace(plan, background=(9, 8, 7)), scale=2)
        assert picture.shape == (8, 12, 3)
        assert np.all(picture == (9, 8, 7))

    def test_is_evaluated(self, plan: StrokePlan) -> None:
        assert evaluate(plan, Photo(np.full((4, 6, 3), 255, np.uint8))).rgb_8bit == 0

    @pytest.mark.parametrize("suffix", [".json", ".json.gz", ".svg", ".svgz", ".png"])
    def test_is_saved(self, plan: StrokePlan, suffix: str, tmp_path: Path) -> None:
        plan.save(tmp_path / f"a{suffix}")
        assert (tmp_path / f"a{suffix}").stat().st_size > 0

    def test_is_loaded(self, plan: StrokePlan, tmp_path: Path) -> None:
        plan.save(tmp_path / "a.json")
        again = strokeplan.load(tmp_path / "a.json")
        assert (len(again), again.layers, again.points.shape, again.colors.shape) == (0, plan.layers, (0, 2), (0, 3))

    def test_has_its_layers_in_the_svg(self, plan: StrokePlan) -> None:
        shown = ElementTree.fromstring(plan._repr_svg_())  # noqa: S314 - our own document
        assert len(shown.findall("{http://www.w3.org/2000/svg}g")) == len(plan.layers)
