"""The planning raster against shapely's geometry and plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from strokeplan.canvas import _unseen, mean_distance, pack, paint_chain, unpack
from strokeplan.curves import fit_tract, flatten

INK = np.uint32(0x123456)


def painted(chain: NDArray[np.float64], width: float, round_cap: bool, shape: tuple[int, int]) -> NDArray[np.bool_]:
    canvas = np.zeros(shape, np.uint32)
    paint_chain(canvas, chain, 0, (len(chain) - 1) // 3, width, round_cap, INK)
    assert set(np.unique(canvas)) <= {0, INK}
    return canvas == INK


def test_packing_keeps_every_colour() -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)
    assert np.array_equal(unpack(pack(rgb)), rgb)
    assert pack(np.array([[[0x12, 0x34, 0x56]]], np.uint8))[0, 0] == INK


@given(
    seed=st.integers(0, 2**32 - 1),
    width=st.floats(0.8, 30),
    round_cap=st.booleans(),
    bend=st.sampled_from([0.0, 0.05, 0.3]),
)
def test_a_footprint_is_the_buffer_of_its_curve(seed: int, width: float, round_cap: bool, bend: float) -> None:
    """Pixels whose centre is clearly inside the stroke are painted, those clearly outside are not."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(0, bend, 40)) + rng.uniform(0, 7)
    points = np.cumsum(1.5 * np.stack([np.cos(heading), np.sin(heading)], -1), axis=0) + rng.uniform(0, 60, 2)
    chain = fit_tract(points)
    found = painted(chain, width, round_cap, (60, 70))
    line = shapely.LineString(flatten(chain, 0.01))
    cap, slack = ("round" if round_cap else "flat"), max(0.25, 0.012 * width)
    y, x = np.mgrid[:60, :70] + 0.5
    centres = shapely.points(x, y)
    inside = shapely.contains(line.buffer(width / 2 - slack, cap_style=cap, quad_segs=64), centres)
    near = shapely.buffer(line, width / 2 + slack, cap_style=cap, quad_segs=64)
    if not round_cap:
        # Ends are cut by the last chord, whose direction differs a little from the curve's.
        ends = shapely.union_all([shapely.Point(points[k]).buffer(width / 2 + 1) for k in (0, -1)])
        inside &= ~shapely.contains(ends, centres)
        near = near.union(ends)
    assert not np.any(inside & ~found)
    assert not np.any(found & ~shapely.contains(near, centres))


def test_a_straight_stroke_covers_exactly_its_rectangle() -> None:
    chain = np.array([[10, 20], [15, 20], [25, 20], [30, 20.0]])
    expected = np.zeros((40, 40), bool)
    expected[18:22, 10:30] = True
    assert np.array_equal(painted(chain, 4, False, (40, 40)), expected)
    assert painted(chain, 4, True, (40, 40)).sum() > expected.sum()


def test_strokes_outside_the_canvas_paint_nothing_and_harm_nothing() -> None:
    for offset in (-500.0, 500.0):
        chain = np.array([[0, 0], [5, 9], [20, 9], [30, 0.0]]) + offset
        assert not painted(chain, 8, True, (20, 20)).any()
    across = np.array([[-1e4, 10], [-3e3, 10], [3e3, 10], [1e4, 10.0]])
    assert painted(across, 2, True, (20, 20)).sum() == 2 * 20


def test_butt_caps_leave_out_what_round_caps_add() -> None:
    chain = np.array([[10, 10], [14, 14], [20, 20], [24, 24.0]])
    butt, round_ = (painted(chain, 8, cap, (36, 36)) for cap in (False, True))
    assert (round_ | butt).sum() == round_.sum()
    assert round_.sum() - butt.sum() == pytest.approx(np.pi * 16, rel=0.15)


@given(
    seed=st.integers(0, 2**32 - 1),
    stride=st.integers(1, 4),
    gain=st.sampled_from([1.0, 1 / 255]),
    top=st.integers(0, 5),
)
def test_mean_distance_is_the_mean_of_norms(seed: int, stride: int, gain: float, top: int) -> None:
    rng = np.random.default_rng(seed)
    photo, canvas = rng.integers(0, 256, (2, 12, 15, 3)).astype(np.uint8)
    found = mean_distance(pack(photo), pack(canvas), top, 12, 2, 15, stride, gain)
    window = (slice(top, 12, stride), slice(2, 15, stride))
    expected = np.linalg.norm(photo[window] * gain - canvas[window], axis=-1).mean()
    assert found == pytest.approx(expected)


def test_an_empty_window_has_no_distance() -> None:
    blank = np.zeros((4, 4), np.uint32)
    assert np.isnan(mean_distance(blank, blank, 0, 0, 0, 4, 1, 1.0))


SPANS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 30), st.integers(1, 12)), max_size=20)


@given(strokes=st.lists(SPANS, max_size=4))
def test_what_a_stroke_has_not_had_is_its_span_without_the_spans_before(
    strokes: list[list[tuple[int, int, int]]],
) -> None:
    """Against plain sets: what is left out has been had, and where a row's spans touch, nothing comes twice."""
    rows = np.full((4, 3), -1, np.int32)
    for mark, spans in enumerate(strokes):
        had: list[set[int]] = [set() for _ in rows]
        remembered: list[set[int]] = [set() for _ in rows]
        for i, first, length in spans:
            span = set(range(first, first + length))
            left, right = _unseen(rows, mark, i, first, first + length)
            given_out = [*range(first, left), *range(right, first + length)]
            assert len(given_out) == len(set(given_out))
            assert span - had[i] <= set(given_out) <= span
            touching = set(range(first - 1, first + length + 1)) & remembered[i]
            assert set(given_out) == (span - remembered[i] if touching else span)
            remembered[i] = remembered[i] | span if touching else span
            had[i] |= span
            assert span <= had[i]
