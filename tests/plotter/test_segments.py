"""Segments for machines: near the curves by another library's measure, and as few short ones as the tolerance lets."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from strokeplan.curves import flatten_all
from strokeplan.errors import InputError
from strokeplan.plotter.segments import FLATTENED, REACH, segments

Points = NDArray[np.float64]
chains = st.integers(0, 6).flatmap(
    lambda k: hnp.arrays(np.float64, (3 * k + 1, 2), elements=st.integers(-60, 60).map(lambda v: v / 10))
)


def joined(parts: list[Points]) -> tuple[Points, NDArray[np.int64]]:
    return np.concatenate(parts), np.concatenate([[0], np.cumsum([len(part) for part in parts])])


def wave(n: int) -> Points:
    """A sine of n short cubics: 60 mm long."""
    x = np.linspace(0, 60, 3 * n + 1)
    return np.stack([x, 5 * np.sin(x / 5)], axis=1)


@given(parts=st.lists(chains, min_size=1, max_size=4), tolerance=st.sampled_from([0.02, 0.2]), data=st.data())
def test_nothing_strays_and_ends_stay(parts: list[Points], tolerance: float, data: st.DataObject) -> None:
    points, starts = joined(parts)
    shortest = data.draw(hnp.arrays(np.float64, len(parts), elements=st.sampled_from([0.0, 0.3, 3.0])))
    vertices, begins = segments(points, starts, tolerance, shortest)
    fine, fine_begins = flatten_all(points, starts, 1e-3)
    for i, part in enumerate(parts):
        line, true = vertices[begins[i] : begins[i + 1]], fine[fine_begins[i] : fine_begins[i + 1]]
        assert np.array_equal(line[0], part[0])
        assert np.allclose(line[-1], part[-1])
        if len(part) > 1:
            assert shapely.distance(shapely.points(true), shapely.LineString(line)).max() <= tolerance + 1e-9
            assert shapely.distance(shapely.points(line), shapely.LineString(true)).max() <= 2e-3


@given(parts=st.lists(chains, min_size=1, max_size=3), shortest=st.sampled_from([0.3, 3.0]))
def test_a_short_segment_is_one_that_the_tolerance_demands(parts: list[Points], shortest: float) -> None:
    points, starts = joined(parts)
    tolerance = 0.1
    kept, begins = segments(points, starts, tolerance, shortest)
    all_, firsts = flatten_all(points, starts, FLATTENED * tolerance)
    for i in range(len(parts)):
        line, fine = kept[begins[i] : begins[i + 1]], all_[firsts[i] : firsts[i + 1]]
        at = positions(line, fine)
        for a, b in pairwise(at[:-1]):  # the last may be short: it ends where the stroke does
            if np.hypot(*(fine[b] - fine[a])) < shortest and b - a < REACH:
                longer = shapely.LineString(fine[[a, b + 1]])
                strays = shapely.distance(shapely.points(fine[a : b + 2]), longer).max()
                assert strays > (1 - FLATTENED) * tolerance - 1e-9


def positions(line: Points, fine: Points) -> list[int]:
    """Where the vertices of the one are among those of the other."""
    at, k = [], 0
    for vertex in line[:-1]:
        k += int(np.flatnonzero((fine[k:] == vertex).all(axis=1))[0])
        at.append(k)
        k += 1
    return [*at, len(fine) - 1]


def test_short_cubics_make_no_short_segments() -> None:
    chain = wave(2000)
    starts = np.array([0, len(chain)])
    before, after = (segments(chain, starts, 0.05, shortest)[0] for shortest in (0.0, 0.5))
    assert np.hypot(*np.diff(before, axis=0).T).max() < 0.05
    assert np.hypot(*np.diff(after, axis=0).T).min() >= 0.5
    assert len(after) < len(before) / 10


def test_without_a_shortest_length_curves_are_flattened_as_ever() -> None:
    chain = wave(20)
    starts = np.array([0, len(chain)])
    for one, other in zip(segments(chain, starts, 0.05), flatten_all(chain, starts, 0.05), strict=True):
        assert np.array_equal(one, other)


def test_many_vertices_in_one_place_take_time_in_proportion() -> None:
    chain = np.full((3 * 100_000 + 1, 2), 7.0)
    vertices, _ = segments(chain, np.array([0, len(chain)]), 0.05, 1.0)
    assert len(vertices) <= 100_000 / REACH + 3


@pytest.mark.parametrize(("tolerance", "shortest"), [(0.0, 1.0), (np.nan, 1.0), (0.1, -1.0), (0.1, np.inf)])
def test_lengths_that_are_none_are_refused(tolerance: float, shortest: float) -> None:
    with pytest.raises(InputError, match="must be"):
        segments(np.zeros((4, 2)), np.array([0, 4]), tolerance, shortest)
