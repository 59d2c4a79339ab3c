"""Outlines of strokes of varying width, against discs laid side by side and against what is known of them."""

from __future__ import annotations

from itertools import pairwise
from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import Polygon

from strokeplan.curves import flatten
from strokeplan.outlines import outline, outline_curves

SIDE = 160
Chain = NDArray[np.float64]


def straight(*knots: tuple[float, float]) -> Chain:
    """Straight cubics from knot to knot."""
    ends = np.array(knots, float)
    inner = ends[:-1, None] + (ends[1:] - ends[:-1])[:, None] * (np.arange(1, 4) / 3)[:, None]
    return np.concatenate([ends[:1], inner.reshape(-1, 2)])


def filled(polygon: Chain) -> NDArray[np.bool_]:
    """The pixels whose centres lie within a polygon by the nonzero rule: counted crossings of a ray to the right."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    winding = np.zeros((SIDE, SIDE), int)
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        rows = slice(*(np.clip(np.ceil(np.sort([y0, y1]) - 0.5), 0, SIDE).astype(int)))
        if rows.start < rows.stop:
            crossing = x0 + (y[rows] - y0) * (x1 - x0) / (y1 - y0)
            winding[rows] += np.where(crossing > x[rows], 1 if y1 > y0 else -1, 0)
    return winding != 0


def distance_to_discs(chain: Chain, radii: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each pixel's centre lies from discs laid closely along a chain; negative within one."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    distance = np.full((SIDE, SIDE), np.inf)
    for k, (r0, r1) in enumerate(pairwise(radii)):
        p = chain[3 * k : 3 * k + 4]
        for t in np.linspace(0, 1, 400):
            cx, cy = np.array([(1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3]) @ p
            np.minimum(distance, np.hypot(x - cx, y - cy) - (1 - t) * r0 - t * r1, out=distance)
    return distance


def area(polygon: Chain) -> float:
    x, y = polygon.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


TIGHT = [
    ("S", [(30, 80), (60, 20), (100, 140), (130, 80)], [3, 14]),
    ("hairpin", [(40, 60), (140, 60), (140, 80), (40, 80)], [16, 22]),
    ("loop", [(30, 60), (190, 130), (-30, 130), (130, 60)], [6, 20]),
    ("cusp", [(50, 60), (110, 120), (50, 120), (110, 60)], [20, 10]),
    ("there and back", [(40, 80), (140, 80), (140, 80), (40, 80)], [4, 12]),
    ("handles that cross", [(60, 80), (140, 20), (10, 20), (90, 80)], [18, 18]),
    (
        "pressure that falls at once",
        [(60, 80), (60, 80), (60, 80), (60, 80), (90, 80), (120, 80), (150, 80)],
        [24, 2, 4],
    ),
    ("pressure that leaps", [(10, 80), (30, 60), (60, 80), (90, 80), (91, 80), (92, 80), (93, 80)], [4, 2, 30]),
    ("standing still at first", [(60, 80), (60, 80), (60, 80), (110, 90)], [8, 15]),
]


@pytest.mark.parametrize(("chain", "radii"), [case[1:] for case in TIGHT], ids=[case[0] for case in TIGHT])
def test_a_round_stroke_is_what_its_discs_cover(chain: list[tuple[float, float]], radii: list[float]) -> None:
    points, r = np.array(chain, float), np.array(radii, float)
    distance = distance_to_discs(points, r)
    for polygon in (outline(points, r, 0.05), flatten(outline_curves(points, r, 0.1), 0.01)):
        covered = filled(polygon)
        assert np.all(covered[distance < -0.25])  # no hole, however tight the bend
        assert not np.any(covered[distance > 0.25])


@settings(max_examples=15)
@given(
    st.lists(st.tuples(*[st.floats(30, 130)] * 2), min_size=7, max_size=7),
    st.lists(st.floats(1, 25), min_size=3, max_size=3),
)
def test_any_round_stroke_is_what_its_discs_cover(chain: list[tuple[float, float]], radii: list[float]) -> None:
    points, r = np.array(chain), np.array(radii)
    covered, distance = filled(outline(points, r, 0.05)), distance_to_discs(points, r)
    assert np.all(covered[distance < -0.3])
    assert not np.any(covered[distance > 0.3])


def test_a_tapered_stroke_is_two_discs_and_their_tangents() -> None:
    polygon = outline(straight((20, 50), (80, 50)), np.array([10.0, 4.0]), 1e-3)
    lean = np.arcsin(6 / 60)
    caps = 0.5 * 10**2 * (pi + 2 * lean) + 0.5 * 4**2 * (pi - 2 * lean)
    assert area(polygon) == pytest.approx(sqrt(60**2 - 6**2) * (10 + 4) + caps, rel=1e-3)
    assert Polygon(polygon).is_valid
    np.testing.assert_allclose([polygon.min(axis=0), polygon.max(axis=0)], [(10, 40), (84, 60)], atol=0.02)


def test_butt_caps_end_with_a_straight_cut() -> None:
    polygon = outline(straight((20, 50), (80, 50)), np.array([10.0, 4.0]), 0.01, round_caps=False)
    assert sorted(map(tuple, np.round(polygon, 9).tolist())) == [(20, 40), (20, 60), (80, 46), (80, 54)]


def test_a_short_wide_stroke_with_butt_caps_keeps_its_area() -> None:
    polygon = outline(straight((50, 50), (52, 50)), np.array([20.0, 5.0]), 0.01, round_caps=False)
    assert area(polygon) == pytest.approx(2 * (20 + 5))


def test_a_joint_is_round() -> None:
    corner = straight((40, 40), (100, 40), (100, 100))
    covered = filled(outline(corner, np.full(3, 12.0), 0.01))
    assert covered[32, 107]  # within the disc of the joint, beyond both edges
    assert not covered[30, 110]  # the tip that a mitre would fill


def test_a_disc_in_the_place_of_a_stroke_without_length() -> None:
    still = np.full((4, 2), 50.0)
    polygon = outline(still, np.array([3.0, 9.0]), 1e-3)
    np.testing.assert_allclose(np.hypot(*(polygon - 50).T), 9)
    assert area(polygon) == pytest.approx(pi * 81, rel=1e-3)
    assert len(outline(still, np.array([3.0, 9.0]), 1e-3, round_caps=False)) == 0


@pytest.mark.parametrize("round_caps", [True, False])
def test_a_stroke_without_pressure_at_all_has_no_area(round_caps: bool) -> None:
    chain = np.array([(10, 10), (40, 60), (60, 0), (90, 50)], float)
    for polygon in (
        outline(chain, np.zeros(2), 0.01, round_caps=round_caps),
        outline_curves(chain, np.zeros(2), 0.01, round_caps=round_caps),
    ):
        assert area(polygon) == pytest.approx(0, abs=1e-6) if len(polygon) else True


def test_curves_follow_the_polygon_within_the_tolerance_and_with_fewer_points() -> None:
    chain = np.array([(30, 80), (60, 20), (100, 140), (130, 80)], float)
    radii = np.array([3.0, 14.0])
    curves = outline_curves(chain, radii, 0.1)
    assert len(curves) % 3 == 1
    np.testing.assert_array_equal(curves[0], curves[-1])
    fine = Polygon(outline(chain, radii, 1e-3))
    assert Polygon(flatten(curves, 1e-3)).exterior.hausdorff_distance(fine.exterior) <= 0.1
    assert len(curves) // 3 < len(outline(chain, radii, 0.02)) / 4


def test_a_curve_far_larger_than_the_tolerance_stays_affordable() -> None:
    chain = np.array([(-1e7, -1e7), (1e7, -1e7), (1e7, 1e7), (-1e7, 1e7)])
    assert len(outline(chain, np.array([1.0, 1e6]), 1e-8)) < 20_000
