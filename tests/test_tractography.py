"""Streamlines on analytic fields, and against scipy's Runge–Kutta methods."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from strokeplan.field import OrientationField, orientation_field
from strokeplan.tractography import MAX_STEP_PX, Course, depart, sample, splitmix64, track, tract_capacity, travel


def analytic_field(
    width: int, height: int, angle: object, coherence: object = 1.0, scale: float = 1.0
) -> OrientationField:
    """A field of given angle and coherence, each a number or a function of photo coordinates x, y."""
    rows, cols = round(height / scale), round(width / scale)
    y, x = (np.mgrid[:rows, :cols] + 0.5) * scale
    angles = np.broadcast_to(angle(x, y) if callable(angle) else angle, x.shape)
    coherences = np.broadcast_to(coherence(x, y) if callable(coherence) else coherence, x.shape)
    samples = np.stack([np.cos(angles), np.sin(angles), coherences], -1).astype(np.float32)
    return OrientationField(samples, scale, width, height)


def rings(size: int, scale: float = 1.0, **options: object) -> OrientationField:
    """Circles around the middle."""
    c = size / 2
    return analytic_field(size, size, lambda x, y: np.arctan2(y - c, x - c) + np.pi / 2, scale=scale, **options)


def length(points: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@pytest.mark.parametrize("radius", [10, 20, 40, 90])
def test_tracts_of_rings_are_circles(radius: float) -> None:
    tract = track(rings(200), (100 + radius, 100), max_length=4 * np.pi * radius)
    radii = np.hypot(*(tract - 100).T)
    assert np.abs(radii - radius).max() < 0.1


def test_tracts_of_a_picture_of_rings_are_circles() -> None:
    """The whole way from pixels: structure tensor of concentric waves, then tractography."""
    y, x = np.mgrid[:200, :200] + 0.5
    picture = (0.5 + 0.5 * np.sin(np.hypot(x - 100, y - 100) / 2)).astype(np.float32)
    field = orientation_field(picture, sigma=1.0)
    for radius in (15, 40, 80):
        tract = track(field, (100, 100 - radius), max_length=2 * np.pi * radius)
        assert length(tract) > 6 * radius
        assert np.abs(np.hypot(*(tract - 100).T) - radius).max() < 0.25


@given(angle=st.floats(0, np.pi))
def test_parallel_lines_are_straight_at_any_angle(angle: float) -> None:
    tract = track(analytic_field(120, 120, angle), (60, 60), max_length=80)
    along = (tract - 60) @ (np.cos(angle), np.sin(angle))
    across = (tract - 60) @ (-np.sin(angle), np.cos(angle))
    assert np.abs(across).max() < 1e-4
    assert np.allclose(sorted((along[0], along[-1])), (-40, 40), atol=1e-3)


def test_the_method_is_of_third_order() -> None:
    """Fixed steps on rings: halving the step divides the global error by eight."""
    field = rings(16, scale=0.01)
    errors = []
    for step in (1.0, 0.5, 0.25):
        tract = track(field, (12, 8), max_length=12, tolerance=1e9, max_step=step, both_ways=False)
        assert np.allclose(np.hypot(*np.diff(tract, axis=0).T), step, rtol=0.02)
        end = np.array([8 + 4 * np.cos(3), 8 + 4 * np.sin(3)])
        errors.append(np.hypot(*(tract[-1] - end)))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 2.7) & (orders < 3.4)), (errors, orders)


@pytest.mark.parametrize("tolerance", [0.5, 0.05, 0.005])
def test_the_tolerance_bounds_the_error_of_a_turn(tolerance: float) -> None:
    tract = track(rings(64), (42, 32), max_length=60, tolerance=tolerance, max_step=50, both_ways=False)
    assert np.abs(np.hypot(*(tract - 32).T) - 10).max() < max(4 * tolerance, 0.05)


def test_scipy_finds_the_same_streamline() -> None:
    field = analytic_field(100, 100, lambda x, y: 0.02 * x + 0.5 * np.sin(y / 15))

    def direction(_: float, p: NDArray[np.float64]) -> tuple[float, float]:
        return sample(field.samples, 1.0, True, p[0], p[1], 1.0, 0.0)[:2]

    oracle = solve_ivp(direction, (0, 60), (20, 40), method="RK45", rtol=1e-9, atol=1e-9)
    tract = track(field, (20, 40), max_length=60, tolerance=1e-4, both_ways=False)
    assert np.hypot(*(tract[-1] - oracle.y[:, -1])) < 0.02


def test_the_sign_of_an_eigenvector_means_nothing() -> None:
    field = rings(80)
    flip = np.random.default_rng(0).choice([-1, 1], field.samples.shape[:2]).astype(np.float32)
    samples = field.samples.copy()
    samples[..., :2] *= flip[..., None]
    flipped = OrientationField(samples, 1.0, 80, 80)
    straight, mixed = (track(f, (60, 40), max_length=50) for f in (field, flipped))
    if np.hypot(*(straight[0] - mixed[0])) > 1:  # the seed's own sign decides which end comes first
        mixed = mixed[::-1]
    assert np.allclose(straight, mixed, atol=1e-9)
    astray = track(flipped, (60, 40), max_length=50, aligned=False)
    assert np.abs(np.hypot(*(astray - 40).T) - 20).max() > 1


def test_a_tract_keeps_its_heading() -> None:
    tract = track(rings(100), (80, 50), max_length=300, both_ways=False)
    steps = np.diff(tract, axis=0)
    assert ((steps[1:] * steps[:-1]).sum(1) > 0).all()


def test_a_tract_ends_on_the_border() -> None:
    tract = track(analytic_field(50, 40, 0.0), (20, 11), max_length=500)
    assert np.allclose(sorted(tract[[0, -1], 0]), (0, 50), atol=0.02)
    assert tract[:, 0].min() >= 0
    assert tract[:, 0].max() <= 50


def test_a_tract_ends_where_the_coherence_falls_below_the_threshold() -> None:
    field = analytic_field(100, 20, 0.0, lambda x, y: 1 - x / 100)
    tract = track(field, (20, 10), max_length=500, min_coherence=0.3)
    assert max(tract[0, 0], tract[-1, 0]) == pytest.approx(70, abs=0.05)


def test_no_tract_leaps_across_a_band_of_incoherence() -> None:
    """Not even with steps that the smooth field would let grow: a band as wide as a step stops it."""
    field = analytic_field(300, 20, 0.0, lambda x, y: np.where(np.abs(x - 150) < 2, 0.0, 1.0))
    tract = track(field, (20, 10), max_length=1000)
    assert max(tract[0, 0], tract[-1, 0]) == pytest.approx(148, abs=1)
    leap = track(field, (20, 10), max_length=1000, max_step=50)
    assert max(leap[0, 0], leap[-1, 0]) > 160


@pytest.mark.parametrize("coherence", [0.0, 0.49])
def test_an_incoherent_seed_goes_nowhere(coherence: float) -> None:
    assert len(track(analytic_field(50, 50, 0.3, coherence), (25, 25), max_length=20)) == 1


def test_coherence_one_is_followed_to_the_end() -> None:
    assert length(track(rings(100), (80, 50), max_length=77, min_coherence=1 - 1e-6)) == pytest.approx(77, rel=1e-3)


@pytest.mark.parametrize(("both_ways", "reach"), [(True, 15), (False, 30)])
def test_the_length_is_that_of_the_whole_tract(both_ways: bool, reach: float) -> None:
    tract = track(analytic_field(100, 100, 0.0), (50, 50), max_length=30, both_ways=both_ways)
    assert length(tract) == pytest.approx(30, abs=1e-6)
    assert np.abs(tract[:, 0] - 50).max() == pytest.approx(reach, abs=1e-6)


@given(
    seed=st.integers(0, 2**32 - 1),
    both_ways=st.booleans(),
    aligned=st.booleans(),
    scale=st.sampled_from([1.0, 4.0]),
    wander=st.sampled_from([0.0, 1.0]),
)
def test_any_field_gives_a_sound_tract(seed: int, both_ways: bool, aligned: bool, scale: float, wander: float) -> None:
    """Random directions and coherences: finite points inside, no long step, no more than the length."""
    rng = np.random.default_rng(seed)
    rows, cols = rng.integers(1, 20, 2)
    samples = np.concatenate([rng.normal(size=(rows, cols, 2)), rng.random((rows, cols, 1))], -1)
    samples[..., :2] /= np.hypot(samples[..., 0], samples[..., 1])[..., None]
    width, height = int(cols * scale), int(rows * scale)
    field = OrientationField(samples.astype(np.float32), scale, width, height)
    start = (rng.random() * width, rng.random() * height)
    options = {"both_ways": both_ways, "aligned": aligned, "wander": wander, "key": seed}
    tract = track(field, start, max_length=40, min_coherence=0.2, **options)
    assert np.isfinite(tract).all()
    assert (tract >= 0).all()
    assert (tract <= (width, height)).all()
    assert np.hypot(*(tract - start).T).min() == 0
    assert np.hypot(*np.diff(tract, axis=0).T).max(initial=0) <= 1.5 * MAX_STEP_PX
    assert length(tract) <= 40 * 1.01
    assert len(tract) <= tract_capacity(40)


@given(
    seed=st.integers(0, 2**32 - 1),
    both_ways=st.booleans(),
    wander=st.sampled_from([0.0, 1.0]),
    part=st.sampled_from([0.05, 0.3, 0.5]),
)
def test_a_tract_followed_on_is_the_tract_followed_at_once(
    seed: int, both_ways: bool, wander: float, part: float
) -> None:
    """To the bit, wherever the first reach cut a step short."""
    field = analytic_field(40, 40, 0.0)
    rng = np.random.default_rng(seed)
    angles = 1.5 * rng.random() + np.cumsum(rng.normal(scale=0.3, size=field.samples.shape[:2]), axis=1)
    certain = rng.random(angles.shape) ** 0.2
    samples = np.stack([np.cos(angles), np.sin(angles), certain], axis=-1).astype(np.float32)
    course = Course(samples, field.scale, 40, 40, 0.2, 0.05, MAX_STEP_PX, True, wander, 10.0, np.uint64(seed))
    start, reach = 40 * rng.random(2), 15.0
    points = np.empty((tract_capacity(30), 2))
    ahead, back = depart(course, *start, both_ways, points)
    first, last, _, _ = travel(course, ahead, back, reach, points)
    at_once = points[first:last].copy()
    _, _, ahead, back = travel(course, ahead, back, part * reach, points)
    first, last, _, _ = travel(course, ahead, back, reach, points)
    assert np.array_equal(points[first:last], at_once)


# Wandering


def headings(tract: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.arctan2(*np.diff(tract, axis=0).T[::-1])


@pytest.mark.parametrize(("coherence", "wander"), [(0.9, 1.0), (0.6, 1.0), (0.6, 0.5), (0.3, 0.5)])
def test_headings_deviate_as_the_coherence_says(coherence: float, wander: float) -> None:
    """Doubled angles of mean resultant length √coherence, wrapped normal: half their deviation, times wander."""
    field = analytic_field(400, 400, 0.3, coherence)
    options = {"max_length": 60, "min_coherence": 0.0, "wander": wander, "bend": 20.0, "both_ways": False}
    tracts = [track(field, (200, 200), max_step=0.5, key=key, **options) for key in range(1500)]
    expected = wander * 0.5 * np.sqrt(-2 * np.log(np.sqrt(coherence)))
    for at in (0, 17, 50, 80, 110):  # at knots and between them
        angles = np.array([headings(tract[at : at + 2])[0] for tract in tracts]) - 0.3
        assert angles.std() == pytest.approx(expected, rel=0.08)
        assert abs(angles.mean()) < 4 * expected / np.sqrt(1500)


def test_full_coherence_leaves_nothing_to_chance() -> None:
    field = analytic_field(100, 100, 0.3)
    assert np.array_equal(track(field, (50, 50), max_length=50, wander=1.0), track(field, (50, 50), max_length=50))


def test_no_uncertainty_turns_a_tract_back() -> None:
    field = analytic_field(400, 400, 0.0, 0.0)
    for key in range(50):
        tract = track(field, (200, 200), max_length=80, min_coherence=0, wander=1.0, key=key, both_ways=False)
        assert (np.diff(tract[:, 0]) > -1e-6).all()


def test_without_wander_the_key_means_nothing() -> None:
    field = rings(100, coherence=0.6)
    tract = track(field, (80, 50), max_length=60)
    assert np.array_equal(track(field, (80, 50), max_length=60, wander=0.0, key=9, bend=3.0), tract)


def test_the_same_key_is_the_same_tract_and_another_another() -> None:
    field = rings(100, coherence=0.6)

    def tract(key: int) -> NDArray[np.float64]:
        return track(field, (80, 50), max_length=60, wander=0.7, key=key)

    one_by_one = [tract(key) for key in range(40)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(tract, reversed(range(40))))[::-1]
    for first, second in zip(one_by_one, together, strict=True):
        assert np.array_equal(first, second)
    ends = np.array([points[-1] for points in one_by_one])
    assert len(np.unique(ends.round(3), axis=0)) == 40


def test_steps_do_not_change_a_wandering_tract() -> None:
    """The deviation belongs to the arc length: shorter steps come to the same tract."""
    field = rings(300, coherence=0.7)
    ends = [
        track(field, (230, 150), max_length=60, wander=1.0, key=5, max_step=step, tolerance=1e-4, both_ways=False)[-1]
        for step in (2.0, 1.0, 0.5)
    ]
    assert np.abs(np.array(ends) - ends[-1]).max() < 0.02


def test_a_wandering_tract_is_smooth_through_its_seed() -> None:
    field = analytic_field(400, 400, 0.3, 0.5)
    strays = []
    for key in range(30):
        tract = track(field, (200, 200), max_length=80, wander=1.0, bend=20, max_step=0.5, key=key)
        turns = np.diff(np.unwrap(headings(tract)))
        assert np.abs(turns).max() < 0.2
        strays.append(np.abs(headings(tract) - 0.3).max())
    assert np.median(strays) > 0.4


def test_splitmix64_gives_the_published_numbers() -> None:
    numbers = [int(splitmix64(np.uint64(0), np.uint64(n))) for n in range(3)]
    assert numbers == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
