"""Simplification and fitting against shapely, known curves, and a stored corpus of tracts."""

from __future__ import annotations

import json
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from strokeplan import curves
from strokeplan.curves import fit_tract, flatten, flatten_all, simplify, subdivisions
from strokeplan.errors import InputError

Points = NDArray[np.float64]
CORPUS = Path(__file__).parent / "golden" / "tracts.json"


def on_chain(chain: Points, samples: int = 64) -> Points:
    """Points of a chain of cubics at equal parameters, by de Casteljau: independent of the kernels."""
    t = np.linspace(0, 1, samples + 1)[:, None]
    pieces = []
    for c in range(0, len(chain) - 1, 3):
        p = [np.broadcast_to(chain[c + k], (len(t), 2)) for k in range(4)]
        while len(p) > 1:
            p = [(1 - t) * a + t * b for a, b in pairwise(p)]
        pieces.append(p[0])
    return np.concatenate(pieces)


def straying(chain: Points, polyline: Points) -> float:
    """Furthest distance of the curve from the polyline."""
    return float(shapely.distance(shapely.points(on_chain(chain)), shapely.LineString(polyline)).max())


@st.composite
def smooth_tracts(draw: st.DrawFn) -> Points:
    """Walks whose direction changes steadily, as streamlines do, now and then sharply."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(2, 150))
    bend = draw(st.floats(0, 0.6))
    turns = np.cumsum(rng.normal(0, bend / 5, n)) + rng.choice([0, 2.0], n, p=[0.97, 0.03])
    steps = rng.uniform(0.05, 2.0, n)
    return np.cumsum(np.stack([steps * np.cos(turns), steps * np.sin(turns)], -1), axis=0) + 500


def polylines(limit: float = 50, max_size: int = 30) -> st.SearchStrategy[Points]:
    """Any polyline at all: spikes, loops, repeated points."""
    coordinate = st.floats(-limit, limit, allow_nan=False, width=32)
    return st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=max_size).map(np.array)


@given(points=st.one_of(smooth_tracts(), polylines()), tolerance=st.floats(0, 5))
def test_simplify_is_shapelys_douglas_peucker(points: Points, tolerance: float) -> None:
    expected = shapely.LineString(points).simplify(tolerance, preserve_topology=False)
    found = simplify(points, tolerance)
    furthest = shapely.hausdorff_distance(shapely.LineString(points), shapely.MultiPoint(found).union(expected))
    if len(found) == len(expected.coords):
        assert np.array_equal(found, np.array(expected.coords))
    else:
        # Equally distant vertices may be kept in another order; the promise is the same.
        kept = shapely.LineString(found) if len(found) > 1 else shapely.Point(found[0])
        assert shapely.distance(shapely.points(points), kept).max() <= tolerance + 1e-9
        assert furthest >= 0


@given(points=st.one_of(smooth_tracts(), polylines()), fit=st.sampled_from([0.1, 0.75, 3.0]))
@example(points=np.array([[0, 0], [10, 0], [0, 0.001], [10, 10.0]]), fit=0.75)
@example(points=np.array([[0, 0], [100, 0], [100, 0.5], [0, 0.5]]), fit=0.75)
def test_no_curve_strays_from_its_tract(points: Points, fit: float) -> None:
    """The promise: within the two tolerances together, everywhere between the vertices too."""
    chain = fit_tract(points, 0.25, fit)
    if len(chain) == 0:
        assert len(simplify(points, 0.25)) < 2
        return
    assert np.isfinite(chain).all()
    assert (len(chain) - 1) % 3 == 0
    assert np.allclose(chain[0], points[0])
    assert np.allclose(chain[-1], points[-1])
    assert straying(chain, points) <= 0.25 + fit + 1e-9


@given(points=st.one_of(smooth_tracts(), polylines()))
def test_pieces_share_the_tangent_at_their_joint(points: Points) -> None:
    chain = fit_tract(points)
    for joint in range(3, len(chain) - 3, 3):
        before, after = chain[joint] - chain[joint - 1], chain[joint + 1] - chain[joint]
        lengths = np.hypot(*before) * np.hypot(*after)
        assert before @ after > 0
        assert abs(before[0] * after[1] - before[1] * after[0]) <= 1e-6 * lengths + 1e-12


@given(points=smooth_tracts())
def test_no_handle_is_longer_than_the_arc_it_spans(points: Points) -> None:
    chain = fit_tract(points)
    arc = np.hypot(*np.diff(points, axis=0).T).sum()
    for c in range(0, len(chain) - 1, 3):
        assert np.hypot(*(chain[c + 1] - chain[c])) <= arc
        assert np.hypot(*(chain[c + 3] - chain[c + 2])) <= arc


def test_the_published_fit_strays_where_ours_does_not() -> None:
    """What the bound is for: handles from few vertices overshoot between them. The comparator can fail."""
    stored = [np.array(entry["points"]) for entry in json.loads(CORPUS.read_text())]
    worst = 0.0
    for points in stored:
        vertices = simplify(points, 1.0)
        if len(vertices) > 3:
            chain = np.empty((3 * len(vertices), 2))
            pieces = curves.fit(vertices, len(vertices), 1.0, False, chain, 0, curves.scratch(len(vertices)))
            worst = max(worst, straying(chain[: 3 * pieces + 1], points))
    assert worst > 4


@pytest.mark.parametrize(("tolerance", "most"), [(0.01, 7), (0.5, 2), (5, 1)])
def test_a_true_cubic_needs_about_as_many_pieces_as_in_an_independent_fit(tolerance: float, most: int) -> None:
    """fit-curve 0.2.0 takes 5, 2 and 1 (its tolerance is a squared distance); ours also bounds what lies between."""
    points = on_chain(np.array([[0, 0], [30, 60], [90, -40], [120, 20.0]]), 400)
    assert (len(fit_tract(points, 0.0, np.sqrt(tolerance))) - 1) // 3 <= most


def test_a_half_circle_is_one_piece_of_known_handles() -> None:
    angle = np.linspace(0, np.pi / 2, 30)
    chain = fit_tract(100 * np.stack([np.cos(angle), np.sin(angle)], -1), 0.01, 0.5)
    assert len(chain) == 4
    handle = 100 * 4 / 3 * np.tan(np.pi / 8)
    assert np.allclose(chain, [[100, 0], [100, handle], [handle, 100], [0, 100]], atol=0.5)


def test_a_straight_tract_is_one_straight_piece() -> None:
    points = np.linspace([3, 4], [63, 84], 25)
    chain = fit_tract(points)
    assert len(chain) == 4
    assert straying(chain, points) < 1e-9


@pytest.mark.parametrize("points", [np.empty((0, 2)), np.array([[1.0, 2]]), np.array([[1.0, 2]] * 5)])
def test_a_point_is_no_stroke(points: Points) -> None:
    assert fit_tract(points).shape == (0, 2)


@given(points=polylines(max_size=8), tolerance=st.floats(0.01, 2))
def test_flattening_stays_on_the_curve(points: Points, tolerance: float) -> None:
    chain = fit_tract(points, 0.0, 5.0)
    if len(chain):
        line = flatten(chain, tolerance)
        assert shapely.distance(shapely.points(on_chain(chain)), shapely.LineString(line)).max() <= tolerance + 1e-9


@given(lines=st.lists(polylines(max_size=6), max_size=4), tolerance=st.floats(0.01, 2))
def test_many_chains_are_flattened_as_each_alone(lines: list[Points], tolerance: float) -> None:
    chains = [chain for chain in (fit_tract(points, 0.0, 5.0) for points in lines) if len(chain)]
    points = np.concatenate([np.empty((0, 2)), *chains])
    starts = np.cumsum([0, *map(len, chains)])
    vertices, begins = flatten_all(points, starts, tolerance)
    assert len(begins) == len(chains) + 1
    assert begins[-1] == len(vertices)
    for chain, a, b in zip(chains, begins, begins[1:], strict=False):
        assert np.allclose(vertices[a:b], flatten(chain, tolerance), rtol=1e-12, atol=1e-9)


def test_absurd_tolerance_is_refused_before_memory_is_taken() -> None:
    piece = np.array([[0, 0], [0, 1e7], [1e7, 1e7], [1e7, 0.0]])
    with pytest.raises(InputError, match="raise it"):
        flatten_all(piece, np.array([0, 4]), 1e-9)


def test_flattening_spends_no_more_than_wangs_bound() -> None:
    piece = np.array([[0, 0], [0, 30], [30, 30], [30, 0.0]])
    bend = np.hypot(*np.array([30, -30]))
    assert subdivisions(piece, 0, 0.1) == int(np.ceil(np.sqrt(0.75 * bend / 0.1)))


def test_stored_tracts_keep_their_curves() -> None:
    """200 tracts of the sample photos: the pinned counts show any drift of the fit, the curves a change of it."""
    stored = json.loads(CORPUS.read_text())
    assert len(stored) == 200
    counts: Counter[int] = Counter()
    for entry in stored:
        points, expected = np.array(entry["points"]), np.array(entry["chain"])
        chain = fit_tract(points)
        assert straying(chain, points) <= 1.0
        counts[(len(chain) - 1) // 3] += 1
        if len(chain) == len(expected):
            assert np.allclose(chain, expected, atol=0.02)
    drift = counts - Counter((len(entry["chain"]) - 1) // 3 for entry in stored)
    assert sum(drift.values()) <= 2  # rounding may tip a split; more is a change of the method
