"""Merging on strokes whose fate is known: dashes, crossings, and what must stay apart."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import strokeplan
from strokeplan import merging
from strokeplan.canvas import pack
from strokeplan.curves import flatten
from strokeplan.image import as_photo
from strokeplan.layer_fields import layer_field
from strokeplan.merging import LONGEST, merge
from strokeplan.painting import Brush, LayerStrokes, layer_brush, paint_strokes, wander_key
from strokeplan.planner import Report
from strokeplan.presets import load_preset
from strokeplan.pursuit import Pursuit
from strokeplan.pursuit.scene import SEEDINGS, Rules
from strokeplan.workers import Workers

WIDTH, LENGTH = 4.0, 400.0
RED, NEARLY_RED, BLUE = 0xC02020, 0xC42424, 0x2020C0
Point = tuple[float, float]


def brush(length: float = LENGTH) -> Brush:
    preset = load_preset("paper").override({"layers.1.width": WIDTH, "layers.1.length": length})
    return layer_brush(preset, preset.layers[0])


def straight(a: Point, b: Point) -> NDArray[np.float64]:
    """One cubic along the edge a–b."""
    return np.array(a) + np.linspace(0, 1, 4)[:, None] * (np.array(b) - np.array(a))


def layer(*chains: NDArray[np.float64], widths: float | list[float] = WIDTH, colours: object = RED) -> LayerStrokes:
    n = len(chains)
    return LayerStrokes(
        np.concatenate(chains),
        np.array([len(chain) for chain in chains]),
        np.broadcast_to(np.asarray(widths, np.float64), n).copy(),
        np.broadcast_to(np.asarray(colours, np.uint32), n).copy(),
    )


def curves(strokes: LayerStrokes) -> list[NDArray[np.float64]]:
    return np.split(strokes.points, np.cumsum(strokes.counts)[:-1])


def same(a: LayerStrokes, b: LayerStrokes) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("points", "counts", "widths", "colours"))


def distance(points: NDArray[np.float64], polyline: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each point from a polyline."""
    a, edge = polyline[:-1], np.diff(polyline, axis=0)
    along = np.einsum("pkd,kd->pk", points[:, None] - a, edge) / np.maximum(np.sum(edge**2, axis=1), 1e-300)
    feet = a + np.clip(along, 0, 1)[..., None] * edge
    return np.asarray(np.linalg.norm(points[:, None] - feet, axis=2).min(axis=1))


@pytest.mark.parametrize("gap", [-6.0, 0.0, 1.9])
@pytest.mark.parametrize("turned", [False, True])
def test_two_dashes_on_one_line(gap: float, turned: bool) -> None:
    second = straight((40 + gap, 10), (90, 10))
    merged = merge(layer(straight((10, 10), (40, 10)), second[::-1] if turned else second), brush(), 1)
    (chain,) = curves(merged)
    assert sorted(chain[[0, -1], 0]) == [10, 90]
    assert chain[:, 1] == pytest.approx(10)
    assert merged.widths == [WIDTH]
    assert merged.colours == [RED]


def test_dashes_too_far_apart() -> None:
    apart = layer(straight((10, 10), (40, 10)), straight((42.1, 10), (90, 10)))
    assert same(merge(apart, brush(), 1), apart)


def crossing(degrees: float, beyond: float = 3.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two strokes of 60 that cross so near to an end of each."""
    turn = np.radians(degrees)
    way = np.array([np.cos(turn), np.sin(turn)])
    return straight((10, 20), (70, 20)), np.array([70 - beyond, 20]) + straight((0, 0), (60, 0))[:, :1] * way - (
        beyond * way
    )


def test_a_crossing_at_a_small_angle() -> None:
    first, second = crossing(12)
    (chain,) = curves(merge(layer(first, second), brush(), 1))
    assert np.array_equal(chain[[0, -1]], [first[0], second[-1]])
    near = np.minimum(distance(flatten(chain, 0.1), first), distance(flatten(chain, 0.1), second))
    assert near.max() < 1 + 0.1


@pytest.mark.parametrize("degrees", [35, 90, 145])
def test_a_crossing_at_a_large_angle(degrees: float) -> None:
    apart = layer(*crossing(degrees))
    assert same(merge(apart, brush(), 442), apart)


def test_a_crossing_of_which_too_much_would_be_left() -> None:
    """An X: whichever way is taken, half of both strokes is left over."""
    apart = layer(*crossing(20, beyond=30))
    assert same(merge(apart, brush(), 442), apart)


def test_unlike_colours_and_unlike_widths() -> None:
    dashes = straight((10, 10), (40, 10)), straight((40, 10), (90, 10))
    unlike = layer(*dashes, colours=[RED, BLUE])
    assert same(merge(unlike, brush(), 200), unlike)
    assert len(merge(unlike, brush(), 300).counts) == 1
    unlike = layer(*dashes, widths=[WIDTH, 1.2 * WIDTH])
    assert same(merge(unlike, brush(), 442), unlike)
    assert len(merge(layer(*dashes, widths=[WIDTH, 1.05 * WIDTH]), brush(), 442).counts) == 1


def test_colours_are_averaged_by_area() -> None:
    dashes = straight((0, 10), (10, 10)), straight((10, 10), (40, 10))
    areas = WIDTH * np.array([10, 30]) + np.pi / 4 * WIDTH**2
    merged = merge(layer(*dashes, colours=[0x102030, 0x182838]), brush(), 20)
    added = round(8 * areas[1] / areas.sum())
    assert merged.colours == [0x102030 + 0x010101 * added]


@pytest.mark.parametrize("seed", range(3))
def test_a_chain_of_ten_dashes(seed: int) -> None:
    knots = np.stack([np.linspace(0, 300, 11), 40 * np.sin(np.linspace(0, 3, 11))], axis=1)
    dashes = [straight(tuple(a), tuple(b)) for a, b in pairwise(knots)]
    rng = np.random.default_rng(seed)
    shuffled = [dashes[k][:: rng.choice([-1, 1])] for k in rng.permutation(10)]
    (chain,) = curves(merge(layer(*shuffled), brush(), 1))
    assert sorted(map(tuple, chain[[0, -1]])) == [tuple(knots[0]), tuple(knots[-1])]
    # No more than one fit's tolerance, and what the change from dash to dash cuts off their corners.
    assert distance(flatten(chain, 0.05), knots).max() < 1 + 0.4


def test_no_stroke_becomes_longer_than_its_layer_allows() -> None:
    dashes = [straight((30 * k, 10), (30 * k + 30, 10)) for k in range(40)]
    merged = curves(merge(layer(*dashes), brush(length=100), 1))
    lengths = [abs(chain[-1, 0] - chain[0, 0]) for chain in merged]
    assert sum(lengths) == pytest.approx(1200)
    assert max(lengths) <= LONGEST * 100
    assert len(merged) <= 12


@pytest.mark.parametrize("larger_first", [False, True])
def test_the_merged_stroke_lies_where_the_larger_lay(larger_first: bool) -> None:
    small, large, between = straight((10, 10), (40, 10)), straight((40, 10), (90, 10)), straight((40, 50), (40, 90))
    ends = [large, small] if larger_first else [small, large]
    merged = merge(layer(ends[0], between, ends[1], colours=[RED, BLUE, NEARLY_RED]), brush(), 20)
    assert len(merged.counts) == 2
    assert merged.colours[1 if larger_first else 0] == BLUE


def test_little_or_nothing_to_merge() -> None:
    none = LayerStrokes(np.empty((0, 2)), np.empty(0, np.int64), np.empty(0), np.empty(0, np.uint32))
    assert len(merge(none, brush(), 442).counts) == 0
    one = layer(straight((1, 2), (3, 4)))
    assert same(merge(one, brush(), 442), one)
    # A stroke of no length has no direction, and no stroke runs as it does.
    dots = layer(straight((5, 5), (5, 5)), straight((5, 5), (40, 5)), straight((5, 5), (5, 5)))
    assert same(merge(dots, brush(), 442), dots)


bends = st.tuples(
    st.floats(0, 200), st.floats(0, 200), st.floats(0, 6.28), st.floats(1, 120), st.floats(-1, 1), st.integers(0, 40)
)


@given(st.lists(bends, min_size=1, max_size=60))
def test_what_holds_for_any_strokes(described: list[tuple[float, float, float, float, float, int]]) -> None:
    chains, colours = [], []
    for x, y, turn, length, bend, red in described:
        # Directions are few, so that many strokes run alike.
        turn = np.round(turn / 3) * 3 + 0.1 * bend
        along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        t = np.linspace(0, length, 4)[:, None]
        chains.append(np.array([x, y]) + t * along + 0.2 * bend * np.array([[0], [length], [length], [0]]) * across)
        colours.append(red << 16)
    strokes = layer(*chains, colours=colours)
    points = strokes.points.copy()
    merged = merge(strokes, brush(), 15)

    assert np.array_equal(strokes.points, points), "what came in is not changed"
    assert same(merged, merge(strokes, brush(), 15))
    assert 1 <= len(merged.counts) <= len(chains)
    old_ends = {tuple(chain[k]) for chain in chains for k in (0, -1)}
    for chain in curves(merged):
        assert {tuple(chain[0]), tuple(chain[-1])} <= old_ends
        curve = flatten(chain, 0.05)
        assert np.hypot(*np.diff(curve, axis=0).T).sum() <= LONGEST * LENGTH + 1
        near = np.min([distance(curve, flatten(old, 0.05)) for old in chains], axis=0)
        assert near.max() <= 0.5 * WIDTH + 1 + 0.1, "half a width between two strokes, and the fit's tolerances"
    assert min(colours) >> 16 <= (merged.colours >> 16).min() <= (merged.colours >> 16).max() <= max(colours) >> 16


@pytest.mark.parametrize("seed", range(3))
def test_meetings_are_those_that_geometry_finds(seed: int) -> None:
    """Straight strokes, all pairs of them, by Shapely: every crossing is found, and nothing that is no meeting."""
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-50, 100, (150, 2))
    chains = [straight(tuple(a), tuple(a + rng.uniform((5, -9), (40, 9)))) for a in starts]
    strokes = layer(*chains)
    lines = merging._measure([line for line in merging._spread(strokes, brush()).lines if line is not None])
    _, pairs = merging._find(lines, strokes.widths, np.zeros((150, 3)), np.ones(150, np.bool_), 1.0)
    found = set(map(tuple, pairs))
    assert len(found) > 50
    edges = [shapely.LineString(chain[[0, -1]]) for chain in chains]
    for a, b in combinations(range(150), 2):
        slope_a, slope_b = (np.arctan2(*(chains[k][-1] - chains[k][0])[::-1]) for k in (a, b))
        alike = abs(slope_a - slope_b) < np.radians(25)
        ends = [
            shapely.Point(chains[k][end]).distance(edges[other]) for k, other in ((a, b), (b, a)) for end in (0, -1)
        ]
        if alike and edges[a].crosses(edges[b]):
            assert (a, b) in found
        if (a, b) in found:
            assert alike
            assert edges[a].crosses(edges[b]) or min(ends) <= 0.5 * WIDTH


def repainted(shape: tuple[int, ...], layers: list[LayerStrokes]) -> NDArray[np.uint32]:
    canvas = np.full(shape[:2], 0xFFFFFF, np.uint32)
    for strokes in layers:
        paint_strokes(canvas, strokes, True)
    return canvas


def test_a_plan_by_the_paper_with_merged_strokes(small_picture: NDArray[np.uint8]) -> None:
    """Fewer strokes, the same for any number of threads, and the canvas shows them."""
    style = load_preset("paper")
    reports: list[Report] = []
    plain = strokeplan.plan(small_picture, style)
    merged = strokeplan.plan(small_picture, style.override({"merge": 30}), threads=1, report=reports.append)
    again = strokeplan.plan(small_picture, style.override({"merge": 30}), threads=3)
    assert len(merged) < len(plain)
    assert np.array_equal(merged.points, again.points)
    assert np.array_equal(merged.colors, again.colors)
    strokes = LayerStrokes(merged.points, merged.counts, merged.widths, pack(merged.colors[None])[0])
    # Coordinates of a plan are rounded: a few pixels at the rims of strokes differ.
    assert np.mean(repainted(small_picture.shape, [strokes]) != pack(reports[0].canvas)) < 0.005


def test_a_pursuit_shows_its_merged_strokes(small_picture: NDArray[np.uint8]) -> None:
    preset = load_preset("fine").override({"lengths": "pixels", "layers.3.width": 6, "layers.3.length": 20})
    resolved, photo = preset.layers[2], pack(small_picture)
    pursuit = Pursuit.begin(photo, np.ones(photo.shape, np.float32), 0xFFFFFF)
    rules = Rules(SEEDINGS["grid"], 6.0, True, 2e4, 10.0, False, 1.0, 6.0, False)
    fine = layer_brush(preset, resolved)
    field = layer_field(as_photo(small_picture), preset, 3)
    pursuit.paint_layer(field, fine, rules, wander_key((0, 3)), Workers(), lambda *_: None)
    before, colour = pursuit.strokes, pursuit.colours.copy()
    pursuit.merge(fine, 1e-3)
    assert pursuit.strokes == before
    assert np.array_equal(pursuit.colours, colour)
    pursuit.merge(fine, 80)
    assert 10 < pursuit.strokes < before
    assert np.array_equal(pursuit.canvas(), repainted(photo.shape, pursuit.layers))


def test_a_covered_canvas_stays_covered(small_picture: NDArray[np.uint8]) -> None:
    reports: list[Report] = []
    style = load_preset("fine").override({"merge": 442, "background": "#ff00ff"})
    strokeplan.plan(small_picture, style, report=reports.append)
    assert not np.any(pack(reports[0].canvas) == 0xFF00FF)
