"""Arcs against the curves that they stand for, measured both ways by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from strokeplan.biarcs import FLAT, ArcChains, Arcs, biarcs, biarcs_all, chords
from strokeplan.errors import InputError

Points = NDArray[np.float64]


def on_chain(chain: Points, n: int = 1500) -> Points:
    t = np.linspace(0, 1, n)[:, None]
    s = 1 - t
    pieces = [chain[c : c + 4] for c in range(0, len(chain) - 1, 3)]
    return np.concatenate([s**3 * p[0] + 3 * s**2 * t * p[1] + 3 * s * t**2 * p[2] + t**3 * p[3] for p in pieces])


def on_arcs(arcs: Arcs) -> Points:
    """Points on the arcs, as lines within 1e-4 of them, by turning chords: another way than through centres."""
    out = []
    for a, b, bulge in zip(arcs.points[:-1], arcs.points[1:], arcs.bulges, strict=True):
        angle = 4 * np.arctan(bulge)
        u = np.linspace(0, 1, 2 + int(np.sqrt(1250 * np.hypot(*(b - a)) * abs(angle))))
        ratio = np.sin(u * angle / 2) / np.sin(angle / 2) if bulge else u
        turn = -(1 - u) * angle / 2
        x, y = b - a
        out.append(a + ratio[:, None] * np.stack([x * np.cos(turn) - y * np.sin(turn),
                                                  x * np.sin(turn) + y * np.cos(turn)], axis=1))  # fmt: skip
    return np.concatenate(out)


def apart(chain: Points, arcs: Arcs) -> float:
    """Hausdorff distance, points of each against the other as lines finer than it matters."""
    one, two = on_chain(chain), on_arcs(arcs)
    there = shapely.distance(shapely.points(one[::3]), shapely.LineString(two)).max()
    back = shapely.distance(shapely.points(two), shapely.LineString(one)).max()
    return float(max(there, back))


chains = st.integers(1, 3).flatmap(
    lambda k: hnp.arrays(np.float64, (3 * k + 1, 2), elements=st.integers(-40, 40).map(float), unique=True)
)


@given(chain=chains, tolerance=st.sampled_from([0.02, 0.1, 1.0]))
def test_arcs_stay_within_the_tolerance_both_ways(chain: Points, tolerance: float) -> None:
    arcs = biarcs(chain, tolerance)
    assert np.array_equal(arcs.points[0], chain[0])
    assert np.allclose(arcs.points[-1], chain[-1])
    assert apart(chain, arcs) <= tolerance + 1e-4


def test_the_oracle_sees_a_wrong_arc() -> None:
    chain = np.array([[0, 0], [0, 30], [30, 30], [30, 0.0]])
    arcs = biarcs(chain, 0.05)
    assert apart(chain, Arcs(arcs.points, -arcs.bulges)) > 10 * 0.05


@given(chain=chains)
def test_joints_within_a_cubic_are_tangent(chain: Points) -> None:
    chain, tolerance = chain[:4], 0.1
    slopes = np.diff(on_chain(chain), axis=0) * 1500
    assume(np.hypot(*slopes.T).min() > 5)  # a cusp has no tangent to keep
    arcs = biarcs(chain, tolerance)
    chord = np.diff(arcs.points, axis=0)
    heading, half = np.arctan2(chord[:, 1], chord[:, 0]), 2 * np.arctan(arcs.bulges)
    turn = (heading[1:] - half[1:]) - (heading[:-1] + half[:-1])
    turns = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    flat = np.where(arcs.bulges == 0, 4 * FLAT * tolerance / np.hypot(*chord.T), 0)  # what a line for an arc may turn
    assert np.all(turns <= 2e-4 + flat[1:] + flat[:-1])


def test_a_quarter_of_a_circle_is_one_arc() -> None:
    k = 4 / 3 * np.tan(np.pi / 8)
    arcs = biarcs(10 * np.array([[1, 0], [1, k], [k, 1], [0, 1.0]]), 0.01)
    assert len(arcs.bulges) == 1
    assert arcs.bulges[0] == pytest.approx(np.tan(np.pi / 8), abs=1e-6)
    assert arcs.centres[0] == pytest.approx([0, 0], abs=1e-6)


def test_a_straight_cubic_is_one_line() -> None:
    arcs = biarcs(np.array([[0, 0], [1, 1], [2, 2], [9, 9.0]]), 0.01)
    assert list(arcs.bulges) == [0]
    assert np.isnan(arcs.centres).all()


def test_pieces_grow_as_the_cube_root_of_the_tolerance() -> None:
    """A biarc's error is of third order: a thousandth of the tolerance costs about ten times the arcs."""
    chain = np.array([[0, 0], [30, 60], [90, -40], [120, 20.0]])
    coarse, fine = (len(biarcs(chain, tolerance).bulges) for tolerance in (0.5, 0.0005))
    assert 4 <= fine / coarse <= 20


def test_a_point_has_no_arcs() -> None:
    assert len(biarcs(np.ones((4, 2)), 0.1).bulges) == 0


@given(data=st.data())
def test_a_plan_has_the_arcs_of_its_strokes(data: st.DataObject) -> None:
    parts = data.draw(st.lists(st.one_of(chains, st.just(np.ones((1, 2)))), max_size=5))
    starts = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
    made = biarcs_all(np.concatenate([np.empty((0, 2)), *parts]), starts, 0.1)
    assert len(made) == len(parts)
    for i, part in enumerate(parts):
        alone = biarcs(part, 0.1)
        assert np.array_equal(made.chain(i).points, alone.points)
        assert np.array_equal(made.chain(i).bulges, alone.bulges)


@given(chain=chains, tolerance=st.sampled_from([0.002, 0.05]))
def test_chords_are_as_far_from_their_arcs_as_asked(chain: Points, tolerance: float) -> None:
    made = biarcs_all(chain, np.array([0, len(chain)]), 0.1)
    points, starts = chords(made, tolerance)
    arcs = made.chain(0)
    assert list(starts) == [0, len(points)]
    if len(arcs.bulges):
        true, line = shapely.LineString(on_arcs(arcs)), shapely.LineString(points)
        assert shapely.distance(shapely.points(points), true).max() < 1e-3
        assert shapely.distance(shapely.points(on_arcs(arcs)), line).max() < 4 * tolerance + 1e-3  # GRBL rounds down


def test_half_a_circle_is_cut_as_grbl_cuts_it() -> None:
    """mc_arc: floor(½ π · 10 / √(0.002 (20 − 0.002))) = 78 lines."""
    half = ArcChains(np.array([[10, 0], [-10, 0.0]]), np.array([1.0, 0]), np.array([0, 2]))
    points, _ = chords(half, 0.002)
    assert len(points) == 79
    assert np.hypot(*points.T) == pytest.approx(np.full(79, 10))
    assert points[39] == pytest.approx([0, 10])


@pytest.mark.parametrize("starts", [[0, 3, 8], [0, 4], [1, 8]])
def test_what_are_no_chains_is_refused(starts: list[int]) -> None:
    with pytest.raises(InputError, match=r"3k \+ 1"):
        biarcs_all(np.zeros((8, 2)), np.array(starts), 0.1)


@pytest.mark.parametrize(
    ("chain", "tolerance"), [(np.zeros((3, 2)), 0.1), (np.zeros((4, 2)), 0.0), (np.full((4, 2), np.nan), 0.1)]
)
def test_what_is_no_curve_is_refused(chain: Points, tolerance: float) -> None:
    with pytest.raises(InputError):
        biarcs(chain, tolerance)
