"""Pressure and angle along strokes: on lines and circles of even coherence it is known what they must be."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import asin, cos, exp, pi, sin, tan
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import strokeplan
from strokeplan.errors import InputError
from strokeplan.field import OrientationField
from strokeplan.image import as_photo
from strokeplan.layer_fields import layer_field
from strokeplan.pressure import (
    FEEL,
    FLOOR,
    LAG,
    LIGHT,
    MAX_TURN,
    PRESSURE_TOLERANCE,
    TAPER,
    add_pressure,
)
from strokeplan.strokes import Layer, StrokePlan

Chain = NDArray[np.float64]
SIZE = 400


def plan_of(*chains: Chain, width: float = 10.0) -> StrokePlan:
    n = len(chains)
    return StrokePlan(
        width=SIZE,
        height=SIZE,
        points=np.concatenate(chains),
        starts=np.cumsum([0, *(len(chain) for chain in chains)]),
        widths=np.full(n, float(width)),
        colors=np.zeros((n, 3), np.uint8),
        layers=(Layer("1", 0, n),),
    )


def even_field(coherence: float) -> OrientationField:
    samples = np.zeros((SIZE // 4, SIZE // 4, 3), np.float32)
    samples[..., 0], samples[..., 2] = 1, coherence
    return OrientationField(samples, 4, SIZE, SIZE)


def ramp_field() -> OrientationField:
    """Coherence that grows from 0 at the left edge to 1 at the right."""
    samples = np.zeros((SIZE, SIZE, 3), np.float32)
    samples[..., 0], samples[..., 2] = 1, (np.arange(SIZE) + 0.5) / SIZE
    return OrientationField(samples, 1, SIZE, SIZE)


def line(x0: float, y0: float, x1: float, y1: float) -> Chain:
    return np.array([(x0 + (x1 - x0) * t, y0 + (y1 - y0) * t) for t in (0, 1 / 3, 2 / 3, 1)])


def arc(radius: float, sweep: float, pieces: int = 8) -> Chain:
    """An arc about the middle of the canvas, from the right towards the bottom; to 1e-5 of the radius a circle."""
    step = sweep / pieces
    handle = 4 / 3 * tan(step / 4)
    points = [(1.0, 0.0)]
    for k in range(pieces):
        for angle, along in ((k * step, handle), ((k + 1) * step, -handle), ((k + 1) * step, 0.0)):
            points.append((cos(angle) - along * sin(angle), sin(angle) + along * cos(angle)))
    return SIZE / 2 + radius * np.array(points)


def along(plan: StrokePlan, column: NDArray[np.float64] | None, i: int) -> NDArray[np.float64]:
    assert column is not None
    return column[plan.first_knots[i] : plan.first_knots[i + 1]]


def pressure(plan: StrokePlan, i: int = 0) -> tuple[Callable[[float], Any], float]:
    """Pressure of a straight or circular stroke by arc length, as the file is read; and its length."""
    points = plan.stroke(i)
    s, values = [0.0], along(plan, plan.pressures, i)
    pressures = [values[0]]
    for k in range(len(values) - 1):
        t = np.linspace(0, 1, 41)[:, None]
        p = points[3 * k : 3 * k + 4]
        xy = (1 - t) ** 3 * p[0] + 3 * (1 - t) ** 2 * t * p[1] + 3 * (1 - t) * t**2 * p[2] + t**3 * p[3]
        s += (s[-1] + np.cumsum(np.hypot(*np.diff(xy, axis=0).T))).tolist()
        pressures += ((1 - t[1:, 0]) * values[k] + t[1:, 0] * values[k + 1]).tolist()
    return lambda x: np.interp(x, s, pressures), s[-1]


def full(part: float) -> float:
    return FLOOR + (1 - FLOOR) * part


# The taper


def test_a_straight_sure_stroke_is_pressed_fully_between_its_tapers() -> None:
    at, length = pressure(add_pressure(plan_of(line(50, 200, 350, 200)), [even_field(1)], 1))
    assert length == pytest.approx(300)
    s = np.linspace(0, length, 1000)
    x = np.minimum(np.minimum(s, length - s) / (TAPER * 10), 1)
    np.testing.assert_allclose(at(s), full(1 - (1 - x) ** 2), atol=PRESSURE_TOLERANCE)
    assert at(0) == pytest.approx(FLOOR)
    assert at(length) == pytest.approx(FLOOR)
    assert at(150) == pytest.approx(1)


def test_a_taper_is_as_long_as_the_brush_is_wide_and_not_as_the_stroke() -> None:
    for width in (4.0, 16.0):
        for length in (100, 300):
            plan = plan_of(line(50, 200, 50 + length, 200), width=width)
            at, _ = pressure(add_pressure(plan, [even_field(1)], 1))
            assert at(TAPER * width / 2) == pytest.approx(full(0.75), abs=PRESSURE_TOLERANCE)


@pytest.mark.parametrize("length", [0.1, 2.0, 8.0, 19.0])
def test_a_short_dab_is_as_much_less_pointed_as_it_is_short(length: float) -> None:
    at, _ = pressure(add_pressure(plan_of(line(50, 200, 50 + length, 200)), [even_field(1)], 1))
    assert at(length / 2) == pytest.approx(1, abs=PRESSURE_TOLERANCE)
    assert at(0) == pytest.approx(full(1 - length / 2 / (TAPER * 10)), abs=1e-6)


# Bends and coherence


@pytest.mark.parametrize("radius", [5.0, 10.0, 40.0])
def test_a_bend_is_pressed_by_its_curvature(radius: float) -> None:
    width = 10.0
    at, length = pressure(add_pressure(plan_of(arc(radius, 1.9 * pi), width=width), [even_field(1)], 1))
    if length > 4 * TAPER * width:
        s = np.linspace(TAPER * width, length - TAPER * width, 50)
        expected = full(1 / (1 + (width / 2 / radius) ** 2))
        np.testing.assert_allclose(at(s), expected, atol=PRESSURE_TOLERANCE)
    assert at(length / 2) == pytest.approx(full(1 / (1 + (width / 2 / radius) ** 2)), abs=PRESSURE_TOLERANCE)


def test_a_tighter_bend_is_painted_lighter() -> None:
    middles = []
    for radius in (5, 8, 15, 30, 60):
        at, length = pressure(add_pressure(plan_of(arc(radius, 1.9 * pi)), [even_field(1)], 1))
        middles.append(at(length / 2))
    assert middles == sorted(middles)
    assert middles[-1] - middles[0] > 0.3


@pytest.mark.parametrize("coherence", [0.0, 0.3, 1.0])
def test_a_stroke_is_pressed_by_the_coherence_under_it(coherence: float) -> None:
    at, length = pressure(add_pressure(plan_of(line(50, 200, 350, 200)), [even_field(coherence)], 1))
    assert at(length / 2) == pytest.approx(full(LIGHT + (1 - LIGHT) * coherence), abs=1e-6)


def test_coherence_is_read_where_the_stroke_lies() -> None:
    at, _ = pressure(add_pressure(plan_of(line(50, 200, 350, 200)), [ramp_field()], 1))
    s = np.linspace(TAPER * 10, 300 - TAPER * 10, 200)
    expected = full(LIGHT + (1 - LIGHT) * (50 + s) / SIZE)
    np.testing.assert_allclose(at(s), expected, atol=PRESSURE_TOLERANCE + 1e-3)


def test_a_patch_smaller_than_the_brush_is_hardly_felt() -> None:
    field = even_field(1)
    field.samples[:, 50, 2] = 0  # four pixels wide; the mean is over 2 · FEEL · 10
    at, length = pressure(add_pressure(plan_of(line(50, 200, 350, 200)), [field], 1))
    lightest = at(np.linspace(20, length - 20, 300)).min()
    assert lightest == pytest.approx(full(1 - (1 - LIGHT) * 4 / (20 * FEEL)), abs=2 * PRESSURE_TOLERANCE)
    assert lightest < 0.95


# Strength


def test_strength_mixes_full_modulation_with_none() -> None:
    plan = plan_of(line(50, 200, 350, 200))
    at, _ = pressure(add_pressure(plan, [even_field(0)], 0.4))
    assert at(0) == pytest.approx(1 - 0.4 * (1 - full(0)))
    assert at(150) == pytest.approx(1 - 0.4 * (1 - full(LIGHT)))


def test_no_strength_leaves_the_plan_as_it_is() -> None:
    plan = plan_of(line(50, 200, 350, 200))
    assert add_pressure(plan, [even_field(1)], 0) is plan


# The angle


def quarter(angle: float) -> float:
    """How far an axis is from another, in 0…π/2."""
    return abs((angle + pi / 2) % pi - pi / 2)


@pytest.mark.parametrize("direction", [0.0, 0.5, 2.0, pi, 5.0])
def test_on_a_straight_stroke_the_brush_lies_across(direction: float) -> None:
    x, y = 120 * cos(direction), 120 * sin(direction)
    plan = add_pressure(plan_of(line(200 - x, 200 - y, 200 + x, 200 + y)), [even_field(1)], 1)
    for angle in along(plan, plan.angles, 0):
        assert quarter(angle - direction - pi / 2) < 1e-9


@pytest.mark.parametrize("radius", [10.0, 20.0, 80.0])
def test_in_a_bend_the_brush_comes_after(radius: float) -> None:
    width = 10.0
    plan = add_pressure(plan_of(arc(radius, 1.9 * pi), width=width), [even_field(1)], 1)
    last = along(plan, plan.angles, 0)[-1]
    # The handle's heading is that of the arc's end; a dragged tip settles behind it by sin δ = lag / radius.
    heading = 1.9 * pi + pi / 2
    assert quarter(last - (heading - asin(LAG * width / radius) + pi / 2)) < 0.02


def test_after_a_corner_the_brush_turns_as_a_tractrix_does() -> None:
    plan = plan_of(np.concatenate([line(50, 100, 200, 100), line(200, 100, 200, 300)[1:]]))
    plan = add_pressure(plan, [even_field(1)], 1)
    angles, knots = along(plan, plan.angles, 0), plan.stroke(0)[::3]
    after = knots[:, 1] > 100
    assert np.count_nonzero(after & (knots[:, 1] < 130)) >= 3
    for (_, y), angle in zip(knots[after], angles[after], strict=True):
        behind = 2 * np.arctan(tan(pi / 4) * exp(-(y - 100) / (LAG * 10)))
        assert quarter(angle - (pi / 2 - behind + pi / 2)) < 1e-6


def test_neighbouring_angles_are_less_than_a_quarter_turn_apart() -> None:
    plan = add_pressure(plan_of(arc(60, 1.9 * pi, pieces=3), width=4), [even_field(1)], 1)
    angles = along(plan, plan.angles, 0)
    assert max(quarter(b - a) for a, b in pairwise(angles)) <= MAX_TURN
    turned = np.diff(np.unwrap(angles, period=pi)).sum()
    assert turned == pytest.approx(1.9 * pi, abs=0.1)  # the shorter way round is the right one


# The curve


coordinates = st.floats(0, SIZE)


@st.composite
def chains(draw: st.DrawFn) -> Chain:
    pieces = draw(st.integers(1, 3))
    points = draw(st.lists(st.tuples(coordinates, coordinates), min_size=3 * pieces + 1, max_size=3 * pieces + 1))
    return np.array(points)


def sub_cubic(p: Chain, t0: float, t1: float) -> Chain:
    """The part t0 … t1 of a cubic, by its values and derivatives at both ends."""

    def at(t: float) -> Chain:
        s = 1 - t
        value: Chain = s**3 * p[0] + 3 * s * s * t * p[1] + 3 * s * t * t * p[2] + t**3 * p[3]
        return value

    def slope(t: float) -> Chain:
        d = np.diff(p, axis=0)
        value: Chain = 3 * ((1 - t) ** 2 * d[0] + 2 * (1 - t) * t * d[1] + t * t * d[2])
        return value

    third = (t1 - t0) / 3
    return np.array([at(t0), at(t0) + third * slope(t0), at(t1) - third * slope(t1), at(t1)])


def parameters(pieces: list[Chain]) -> list[float]:
    """Where cubics were cut that together are one: the third differences of a part are its length cubed."""
    lengths = np.cbrt([np.abs(np.diff(p, n=3, axis=0)).max() for p in pieces])
    return [0.0, *(np.cumsum(lengths) / lengths.sum()).tolist()]


def test_pieces_are_exact_parts_of_the_curve() -> None:
    whole = np.array([(20, 200), (120, 20), (160, 380), (390, 210)], float)
    split = add_pressure(plan_of(whole, width=30), [ramp_field()], 1).stroke(0)
    pieces = [split[k : k + 4] for k in range(0, len(split) - 1, 3)]
    assert len(pieces) > 5
    cuts = parameters(pieces)
    for piece, (t0, t1) in zip(pieces, pairwise(cuts), strict=True):
        np.testing.assert_allclose(piece, sub_cubic(whole, t0, t1), rtol=0, atol=1e-6)


@given(st.lists(chains(), min_size=1, max_size=3), st.floats(0.5, 100), st.floats(0.01, 1), st.floats(0, 1))
def test_any_plan_keeps_its_ends_joints_columns_and_floor(
    strokes: list[Chain], width: float, strength: float, coherence: float
) -> None:
    plan = plan_of(*strokes, width=width)
    pressed = add_pressure(plan, [even_field(coherence)], strength)
    assert (len(pressed), pressed.layers) == (len(plan), plan.layers)
    for i, chain in enumerate(strokes):
        split = pressed.stroke(i)
        np.testing.assert_array_equal(split[[0, -1]], chain[[0, -1]])
        found = {tuple(knot) for knot in split[::3].tolist()}
        assert {tuple(knot) for knot in chain[::3].tolist()} <= found
    assert pressed.pressures is not None
    assert pressed.pressures.min() >= 1 - strength * (1 - FLOOR) - 1e-12
    assert pressed.angles is not None
    assert not np.isnan(pressed.angles).any()


def test_a_stroke_without_length_is_pressed_by_coherence_alone() -> None:
    plan = add_pressure(plan_of(np.full((4, 2), 200.0)), [even_field(0.5)], 1)
    np.testing.assert_allclose(along(plan, plan.pressures, 0), full(LIGHT + (1 - LIGHT) * 0.5), rtol=1e-6)


def test_strokes_do_not_touch_each_other() -> None:
    both = add_pressure(plan_of(arc(50, 3), line(10, 10, 300, 20)), [ramp_field()], 1)
    alone = add_pressure(plan_of(line(10, 10, 300, 20)), [ramp_field()], 1)
    np.testing.assert_array_equal(both.stroke(1), alone.stroke(0))
    np.testing.assert_array_equal(along(both, both.pressures, 1), alone.pressures)
    np.testing.assert_array_equal(along(both, both.angles, 1), alone.angles)


# A planned picture


def test_every_layer_is_read_from_its_own_field(small_picture: NDArray[np.uint8], small_plan: StrokePlan) -> None:
    photo, preset = as_photo(small_picture), strokeplan.load_preset("paper")
    fields = [layer_field(photo, preset, number) for number in range(1, len(small_plan.layers) + 1)]
    pressed = add_pressure(small_plan, iter(fields), 1)
    assert len(pressed) == len(small_plan)
    np.testing.assert_array_equal(pressed.widths, small_plan.widths)
    np.testing.assert_array_equal(pressed.colors, small_plan.colors)
    dull = [OrientationField(0 * field.samples, field.scale, field.width, field.height) for field in fields]
    for number, layer in enumerate(small_plan.layers):
        changed = [*fields[:number], dull[number], *fields[number + 1 :]]
        other = add_pressure(small_plan, changed, 1)
        for k, one in enumerate(small_plan.layers):
            means = [
                np.mean([along(p, p.pressures, i).mean() for i in range(one.first, one.last)]) for p in (pressed, other)
            ]
            assert (means[1] < means[0]) == (k == number), (layer.name, one.name)


@pytest.mark.parametrize("strength", [-0.1, 1.5, float("nan")])
def test_a_strength_that_is_none_is_refused(strength: float) -> None:
    with pytest.raises(InputError, match=f"^pressure {strength:g} is outside 0..1$"):
        add_pressure(plan_of(line(1, 1, 9, 9)), [even_field(1)], strength)


@pytest.mark.parametrize("count", [0, 2])
def test_fields_must_be_as_many_as_layers(count: int) -> None:
    with pytest.raises(InputError, match="there must be one field for each of the 1 layers"):
        add_pressure(plan_of(line(1, 1, 9, 9)), [even_field(1)] * count, 1)


def test_a_field_of_another_photo_is_refused() -> None:
    other = OrientationField(even_field(1).samples, 4, 399, SIZE)
    with pytest.raises(InputError, match="the field of layer 1 is of a photo of 399 × 400 pixels, the canvas is 400"):
        add_pressure(plan_of(line(1, 1, 9, 9)), [other], 1)


def test_a_plan_without_strokes_needs_no_field() -> None:
    none = np.empty(0)
    plan = StrokePlan(6, 4, none.reshape(0, 2), np.zeros(1, np.int64), none, np.empty((0, 3), np.uint8), ())
    assert add_pressure(plan, [], 1) is plan
