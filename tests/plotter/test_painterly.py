"""Strokes of paint as lines of pens: shapely's areas are the oracle, and what a person would see."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
import shapely
from drawings import BAR, EYE, SWAN, curve, drawing
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from strokeplan.curves import flatten
from strokeplan.errors import InputError, PlotError
from strokeplan.pens import Pen, PenSet
from strokeplan.plotter.areas import areas_of
from strokeplan.plotter.bundles import bundled
from strokeplan.plotter.covering import uncovered
from strokeplan.plotter.options import PlotOptions
from strokeplan.plotter.painterly import pen_lines
from strokeplan.plotter.profile import PenSettings, load_profile
from strokeplan.plotter.program import program
from strokeplan.strokes import Layer, StrokePlan

GRBL = load_profile("grbl_servo")


def painted(chains: list[NDArray[np.float64]], width: float = 6.0, cap: str = "round", **more: object) -> StrokePlan:
    n = len(chains)
    layers = (Layer("paint", 0, n, "paint", cap),)  # type: ignore[arg-type]
    return drawing(chains, layers=layers, widths=np.full(n, width), **more)


def union(plan: StrokePlan, i: int, width: float | None = None, cap: str = "round") -> shapely.Geometry:
    """What a stroke of one width paints, by shapely alone."""
    line = shapely.LineString(flatten(plan.stroke(i), 1e-3))
    return line.buffer((width or plan.widths[i]) / 2, quad_segs=32, cap_style=cap)


CURL = np.concatenate([EYE, np.add(EYE[1:], (0.4, 0.3))])
CURL[7:9] = EYE[0]


@pytest.mark.parametrize(("chain", "width"), [(SWAN, 6.0), (SWAN, 1.3), (EYE, 5.0), (BAR, 0.9), (CURL, 7.0)])
def test_a_bundle_inks_the_area_and_little_else(chain: NDArray[np.float64], width: float) -> None:
    pen = 0.5
    plan = painted([chain], width)
    passes, source = bundled(plan, np.array([pen]), 0.01)
    assert not source.any()
    ink = shapely.union_all([union(passes, i, pen) for i in range(len(passes))])
    area = union(plan, 0)
    assert shapely.area(area - ink) < 0.012 * area.area
    assert shapely.area(ink - area.buffer(0.02)) < 1e-3 * area.area
    length = sum(shapely.LineString(flatten(line, 0.01)).length for line in passes)
    assert length * pen < 1.35 * area.area + 2 * pen * shapely.LineString(flatten(chain, 0.01)).length


def test_a_stroke_as_wide_as_the_pen_is_its_middle() -> None:
    plan = painted([SWAN, BAR], 0.52)
    passes, source = bundled(plan, np.array([0.5, 0.5]), 0.01)
    assert source.tolist() == [0, 1]
    assert np.array_equal(passes.points, plan.points)


def test_a_bundle_ends_where_butt_caps_do() -> None:
    plan = painted([BAR], 6.0, "butt")
    passes, _ = bundled(plan, np.array([0.5]), 0.01)
    ink = shapely.union_all([union(passes, i, 0.5) for i in range(len(passes))])
    area = union(plan, 0, cap="flat")
    assert shapely.area(ink - area.buffer(0.02)) == pytest.approx(0, abs=1e-3)
    assert shapely.area(area - ink) < 0.02 * area.area


def test_a_short_stroke_with_butt_caps_is_drawn_all_the_same() -> None:
    plan = painted([curve(50, 70, 50.1, 70, 50.2, 70, 50.3, 70)], 6.0, "butt")
    assert len(bundled(plan, np.array([0.5]), 0.01)[0]) == 1


def test_rings_of_a_bundle_are_drawn_without_a_lift() -> None:
    options = PlotOptions(strokes="bundle", pen_width_mm=0.5)
    assert len(program(painted([SWAN]), GRBL, options)) == 1


def test_the_area_of_pressure_and_of_butt_caps() -> None:
    pressures = np.array([0.2, 1.0])
    plan = painted([BAR, BAR], 8.0, pressures=np.tile(pressures, 2))
    swept = shapely.union_all(
        [shapely.Point(50 + 30 * t, 70).buffer(4 * (0.2 + 0.8 * t), quad_segs=64) for t in np.linspace(0, 1, 400)]
    )
    assert shapely.area(areas_of(plan, 0.01)[0] ^ swept) < 0.01 * swept.area
    butt = areas_of(painted([SWAN], 6.0, "butt"), 0.01)[0]
    expected = union(painted([SWAN], 6.0), 0, cap="flat")
    assert shapely.area(butt ^ expected) < 0.005 * expected.area


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["round", "butt"]))
def test_what_is_left_is_the_difference_of_shapely(seed: int, cap: str) -> None:
    """Exact: the same length as the difference of the lines and the later strokes' areas, and nothing within these."""
    rng = np.random.default_rng(seed)
    straight = [curve(*np.linspace(rng.uniform(10, 60, 2), rng.uniform(10, 60, 2), 4).ravel()) for _ in range(8)]
    plan = painted(straight, 4.0, cap)
    lines, source = uncovered(plan, np.arange(8), plan, 0.0, 0.01)
    style = "round" if cap == "round" else "flat"
    for i in range(8):
        later = shapely.union_all([union(plan, j, cap=style) for j in range(i + 1, 8)])
        expected = shapely.LineString(plan.stroke(i)[::3]) - later
        left = [lines.stroke(k)[::3] for k in np.flatnonzero(source == i)]
        made = shapely.MultiLineString(left)
        assert made.length == pytest.approx(expected.length, abs=0.05)
        assert shapely.length(made & later.buffer(-0.01)) < 1e-6


def test_lines_that_nothing_covers_keep_their_curves_and_ink_neither_hides_nor_is_hidden() -> None:
    plan = painted([SWAN, BAR, EYE], 2.0)
    kept, source = uncovered(plan, np.arange(3), plan, 0.0, 0.01)
    assert np.array_equal(kept.points, plan.points)
    assert source.tolist() == [0, 1, 2]
    ink = replace(painted([SWAN, SWAN], 2.0), layers=(Layer("1", 0, 1, "paint"), Layer("2", 1, 2, "ink")))
    assert len(uncovered(ink, np.arange(2), ink, 0.0, 0.01)[0]) == 2
    paint = painted([SWAN, SWAN], 2.0)
    _, source = uncovered(paint, np.arange(2), paint, 0.0, 0.01)
    assert source.tolist() == [1]


def test_layers_and_pressure_of_pieces() -> None:
    plan = replace(
        painted(
            [BAR, curve(65, 60, 65, 65, 65, 75, 65, 80), EYE], 4.0, pressures=np.array([1, 1, 1, 1, 0.5, 0.5, 1.0])
        ),
        layers=(Layer("1", 0, 1), Layer("2", 1, 3)),
    )
    left, source = uncovered(plan, np.arange(3), plan, 0.0, 0.01)
    assert source.tolist() == [0, 0, 1, 2]
    assert [(k.name, k.first, k.last) for k in left.layers] == [("1", 0, 2), ("2", 2, 4)]
    assert left.stroke(0)[-1] == pytest.approx([63, 70])
    assert left.stroke(1)[0] == pytest.approx([67, 70])


RED, BLUE = (200, 20, 20), (20, 30, 200)
SET = PenSet(pens=(Pen(name="red", color="#c01010", width_mm=0.8), Pen(name="blue", color="#1010c0", width_mm=0.4)))


def test_colours_become_the_nearest_pens_and_paper_is_left_bare() -> None:
    colors = np.array([RED, BLUE, (250, 250, 248)], np.uint8)
    plan = painted([SWAN, BAR, EYE], 2.0, colors=colors)
    lines, join = pen_lines(plan, GRBL, PlotOptions(pens=SET, strokes="bundle"))
    assert set(lines.pens or ()) == {"red", "blue"}
    assert set(lines.widths.tolist()) == {0.8, 0.4}
    assert join == 0.4
    job = program(plan, GRBL, PlotOptions(pens=SET))
    assert [(pen.name, pen.color, pen.width_mm) for pen in job.pens] == [
        ("red", "#c01010", 0.8),
        ("blue", "#1010c0", 0.4),
    ]
    assert program(plan, GRBL, PlotOptions(pens=2)).pens[0].name.startswith("#")


def test_the_profile_s_own_pens() -> None:
    pens = (PenSettings(name="r", color="#c01010", width_mm=0.7), PenSettings(name="b", color="#0000c0", slot=4))
    own = msgspec.structs.replace(GRBL, pens=pens)
    job = program(painted([SWAN, BAR], colors=np.array([RED, BLUE], np.uint8)), own, PlotOptions(pens="profile"))
    assert [(pen.name, pen.slot, pen.width_mm) for pen in job.pens] == [("r", 1, 0.7), ("b", 4, None)]


def test_what_cannot_be_is_said() -> None:
    plan = painted([SWAN, BAR])
    cases = [
        (PlotOptions(strokes="bundle"), "bundles need the width of the pen"),
        (PlotOptions(pens="profile"), "grbl_servo has no pen with a color"),
    ]
    for options, message in cases:
        with pytest.raises(PlotError, match=message):
            program(plan, GRBL, options)
    white = painted([SWAN], colors=np.full((1, 3), 255, np.uint8))
    with pytest.raises(PlotError, match="no line is left to draw"):
        program(white, GRBL, PlotOptions(pens=SET))
    for wrong in ({"pens": 0}, {"pens": 100}, {"pen_width_mm": float("nan")}, {"by_colour": True, "pens": 3}):
        with pytest.raises(InputError):
            PlotOptions(**wrong)  # type: ignore[arg-type]
    many = painted([BAR] * 120, colors=np.tile(np.arange(120, dtype=np.uint8)[:, None], 3))
    with pytest.raises(PlotError, match="120 pens, one for each colour; 99 are the most: try --pens 8"):
        program(many, GRBL, PlotOptions(by_colour=True))
