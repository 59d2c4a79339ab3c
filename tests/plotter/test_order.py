"""Tours of strokes: valid whatever comes in, short, and as free as they were allowed to be."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.plotter.order import Tour, directed, keep_order, merge, order, seat, travel

Ends = NDArray[np.float64]


def scattered(n: int, seed: int = 0) -> Ends:
    rng = np.random.default_rng(seed)
    first = rng.uniform(0, 200, (n, 2))
    return np.stack([first, first + rng.normal(0, 3, (n, 2))], axis=1)


def ends_of(most: int) -> st.SearchStrategy[Ends]:
    """Few different coordinates, so that many ends coincide."""
    coordinate = st.one_of(st.integers(-3, 3).map(float), st.floats(-50, 50))
    return st.integers(0, most).flatmap(lambda n: hnp.arrays(np.float64, (n, 2, 2), elements=coordinate))


def price(ends: Ends, tour: Tour, tolerance: float = 0.0, lift: float = 0.0) -> float:
    gaps = travel(ends, tour)
    return float(gaps.sum() + lift * (gaps > tolerance).sum())


def best_of_all(ends: Ends, tolerance: float, lift: float) -> float:
    n = len(ends)
    tours = product(permutations(range(n)), product((False, True), repeat=n))
    return min(price(ends, Tour(np.array(i), np.array(f)), tolerance, lift) for i, f in tours)


@given(ends=ends_of(40), data=st.data())
def test_every_stroke_is_drawn_once_and_groups_stay_together(ends: Ends, data: st.DataObject) -> None:
    n = len(ends)
    groups = data.draw(hnp.arrays(np.int64, n, elements=st.integers(-2, 3)))
    one_way = data.draw(hnp.arrays(np.bool_, n))
    tour = order(ends, groups, one_way=one_way, tolerance=0.5, lift=data.draw(st.sampled_from([0.0, 20.0])))
    assert np.array_equal(np.sort(tour.index), np.arange(n))
    assert not (tour.reversed & one_way[tour.index]).any()
    blocks = [group for k, group in enumerate(groups[tour.index]) if k == 0 or group != groups[tour.index][k - 1]]
    assert blocks == list(dict.fromkeys(groups.tolist()))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("lift", [0.0, 100.0])
def test_few_strokes_are_near_the_best_of_all_tours(seed: int, lift: float) -> None:
    ends = scattered(5, seed)
    assert price(ends, order(ends, tolerance=40, lift=lift), 40, lift) <= 1.15 * best_of_all(ends, 40, lift)


def test_a_shuffled_row_is_found_again() -> None:
    row = np.array([[[k, 0], [k + 0.9, 0]] for k in range(200)], float)
    rng = np.random.default_rng(3)
    ends = row[rng.permutation(200)]
    ends = np.where((rng.random(200) < 0.5)[:, None, None], ends[:, ::-1], ends)
    assert np.array_equal(directed(ends, order(ends)), row)


def test_many_strokes_are_within_a_quarter_of_what_greedy_takes() -> None:
    """Nearest neighbour over a tree of scipy: another method by other code."""
    from scipy.spatial import cKDTree

    ends = scattered(3000)
    nodes = ends.reshape(-1, 2)
    tree, used, at, far = cKDTree(nodes), np.zeros(6000, bool), np.zeros(2), 0.0
    for _ in range(3000):
        k = 2
        while True:
            gaps, near = tree.query(at, min(k, 6000))
            free = np.flatnonzero(~used[near])
            if len(free):
                break
            k *= 4
        node = int(near[free[0]])
        far += float(gaps[free[0]])
        used[[node, node ^ 1]] = True
        at = nodes[node ^ 1]
    assert travel(ends, order(ends)).sum() < 0.8 * far


def test_a_lift_that_costs_saves_lifts() -> None:
    ends = scattered(3000)
    short, few = order(ends, tolerance=1), order(ends, tolerance=1, lift=25)
    lifts = [len(merge(ends, tour, tolerance=1)) - 1 for tour in (short, few)]
    assert lifts[1] < lifts[0] < 3000


def test_nearly_as_few_lifts_as_there_can_be() -> None:
    """Strokes that keep their direction: exits and entries are two sides, whose largest matching scipy knows."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import maximum_bipartite_matching
    from scipy.spatial import cKDTree

    n, tolerance = 4000, 2.0
    ends = scattered(n)
    near = cKDTree(ends[:, 1]).query_ball_point(ends[:, 0], tolerance)
    pairs = np.array([(i, j) for i, js in enumerate(near) for j in js if i != j])
    partners = maximum_bipartite_matching(coo_array((np.ones(len(pairs)), pairs.T), (n, n)).tocsr())
    fewest = n - np.count_nonzero(partners >= 0)
    tour = order(ends, one_way=np.ones(n, bool), tolerance=tolerance, lift=25)
    lifts = len(merge(ends, tour, tolerance=tolerance)) - 1
    assert fewest <= lifts <= 1.05 * fewest
    assert fewest < 0.7 * n


def test_the_file_s_order_hardly_matters() -> None:
    """The same strokes shuffled: another tour perhaps, not a worse one."""
    ends = scattered(3000)
    mixed = ends[np.random.default_rng(1).permutation(3000)]
    one, other = (price(e, order(e, tolerance=1, lift=25), 1, 25) for e in (ends, mixed))
    assert other == pytest.approx(one, rel=0.02)


def test_threads_and_repetitions_give_the_same_tour() -> None:
    ends = scattered(2000)
    first = order(ends, tolerance=1, lift=25)
    with ThreadPoolExecutor(4) as pool:
        for tour in pool.map(lambda _: order(ends, tolerance=1, lift=25), range(4)):
            assert np.array_equal(tour.index, first.index)
            assert np.array_equal(tour.reversed, first.reversed)


def test_one_way_strokes_cost_more_but_not_order() -> None:
    ends = scattered(2000)
    free, bound = order(ends), order(ends, one_way=np.ones(2000, bool))
    assert travel(ends, free).sum() < travel(ends, bound).sum() < 0.1 * travel(ends, keep_order(ends)).sum()


@pytest.mark.parametrize("ends", [np.full((30_000, 2, 2), 1e5), scattered(30_000)])
def test_coinciding_strokes_do_no_harm(ends: Ends) -> None:
    """Many ends in one place, also far out, where a float is coarse: a tree that cannot split them takes minutes."""
    ends = ends.copy()
    ends[:, 0] = 1e5
    tour = order(ends, tolerance=0.1, lift=25)
    assert np.array_equal(np.sort(tour.index), np.arange(30_000))


@given(ends=ends_of(6), lift=st.sampled_from([0.0, 3.0]), data=st.data())
def test_kept_order_has_the_best_directions(ends: Ends, lift: float, data: st.DataObject) -> None:
    n = len(ends)
    one_way = data.draw(hnp.arrays(np.bool_, n))
    tour = keep_order(ends, one_way=one_way, tolerance=0.5, lift=lift)
    assert np.array_equal(tour.index, np.arange(n))
    assert not (tour.reversed & one_way).any()
    choices = [np.array(f, bool) for f in product((False, True), repeat=n) if not (np.array(f, bool) & one_way).any()]
    best = min(price(ends, Tour(np.arange(n), f), 0.5, lift) for f in choices)
    assert price(ends, tour, 0.5, lift) == pytest.approx(best, abs=1e-9)


@given(ends=ends_of(30), data=st.data())
def test_chains_break_where_the_pen_lifts(ends: Ends, data: st.DataObject) -> None:
    groups = data.draw(hnp.arrays(np.int64, len(ends), elements=st.integers(0, 1)))
    tour = order(ends, groups, tolerance=1.5)
    starts = merge(ends, tour, groups, tolerance=1.5)
    gaps, member = travel(ends, tour), groups[tour.index]
    for k in range(1, len(ends)):
        assert (k in starts) == (gaps[k] > 1.5 or member[k] != member[k - 1])
    assert starts[0] == 0
    assert starts[-1] == len(ends)


def test_a_closed_stroke_begins_where_the_pen_comes_from() -> None:
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]], float)
    points = np.concatenate([square, [[20, 10], [30, 10]]])
    starts = np.array([0, 5, 7])
    tour = Tour(np.array([0, 1]), np.zeros(2, bool))
    assert list(seat(points, starts, tour, start=(11, 20))) == [2, 0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ends": np.zeros((3, 2))}, r"must be \(n, 2, 2\)"),
        ({"ends": np.array([[[0, 0], [0, 1]], [[0, np.nan], [0, 0]]])}, "stroke 1 has an end that is no number"),
        ({"tolerance": -1.0}, "tolerance -1.0"),
        ({"groups": [1]}, "one value for each of 2 strokes"),
        ({"one_way": [True]}, "one value for each of 2 strokes"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        order(**{"ends": np.zeros((2, 2, 2)), **change})  # type: ignore[arg-type]
