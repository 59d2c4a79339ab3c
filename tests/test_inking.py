"""What pen drawings are made of: even lines, what ink covers, dashes, mending."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from strokeplan.coverage import cover
from strokeplan.dashes import dash
from strokeplan.hatching import END, STEP_MM, hatch
from strokeplan.linework import NO_LINES, Lines, chains
from strokeplan.mending import mend
from strokeplan.rendering import Surface

PIXEL, WIDTH, SIDE = 0.1, 0.3, 24.0
LENGTHS = {"min_length_mm": 1.0, "max_length_mm": 60.0, "min_radius_mm": 0.5}


def straight(degrees: float) -> NDArray[np.float32]:
    field = np.zeros((24, 24, 3), np.float32)
    field[..., :2] = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return field


def rings() -> NDArray[np.float32]:
    y, x = np.mgrid[:96, :96] - 47.5
    norm = np.maximum(np.hypot(x, y), 1e-6)
    return np.stack([-y / norm, x / norm, np.ones_like(x)], axis=-1).astype(np.float32)


def flat(value: float) -> NDArray[np.float32]:
    return np.full((240, 240), value, np.float32)


def covered(lines: Lines) -> NDArray[np.float32]:
    sheet = flat(0)
    cover(lines, WIDTH, PIXEL, sheet)
    return sheet


def inner(sheet: NDArray[np.float32]) -> float:
    return float(sheet[30:-30, 30:-30].mean())


def every(lines: Lines) -> list[NDArray[np.float64]]:
    return [lines.points[a:b] for a, b in pairwise(lines.starts)]


# Lines


@pytest.mark.parametrize("degrees", [0, 30, 90, 141])
@pytest.mark.parametrize("separation", [0.4, 0.7, 1.4])
def test_lines_of_a_flat_tone_cover_it_as_asked(degrees: float, separation: float) -> None:
    lines = hatch(straight(degrees), 1.0, flat(separation), PIXEL, **LENGTHS)
    assert inner(covered(lines)) == pytest.approx(WIDTH / separation, rel=0.08)


def test_lines_keep_their_distance() -> None:
    separation = np.tile(np.linspace(0.5, 2, 240, dtype=np.float32), (240, 1))
    lines = hatch(rings(), 0.25, separation, PIXEL, **LENGTHS)
    number = np.repeat(np.arange(len(lines.starts) - 1), np.diff(lines.starts))
    nearest, which = cKDTree(lines.points).query(lines.points, k=40, distance_upper_bound=2.0)
    other = (which < len(number)) & (number[np.minimum(which, len(number) - 1)] != number[:, None])
    gaps = np.where(other, nearest, np.inf).min(axis=1)
    asked = np.interp(lines.points[:, 0], (np.arange(240) + 0.5) * PIXEL, separation[0])
    # A pixel, a step between stamps, and a gradient of tone stand between the rule and the measure.
    assert np.quantile(gaps / asked, 0.01) > 0.75 * END
    assert len(lines.starts) > 20


def test_lines_follow_the_field_and_never_go_round_twice() -> None:
    for line in every(hatch(rings(), 0.25, flat(1.0), PIXEL, **LENGTHS)):
        radius = np.hypot(line[:, 0] - 12, line[:, 1] - 12)
        assert np.ptp(radius) < 0.25
        assert (len(line) - 1) * STEP_MM < 2 * np.pi * radius.max() + 2 * STEP_MM


def test_no_line_where_none_is_asked_for() -> None:
    separation = flat(0.6)
    separation[:, 120:] = 0
    lines = hatch(straight(20), 1.0, separation, PIXEL, **LENGTHS)
    assert lines.points[:, 0].max() < 12
    assert len(hatch(straight(20), 1.0, flat(0), PIXEL, **LENGTHS).points) == 0


def test_lines_are_as_long_as_asked() -> None:
    lengths = {"min_length_mm": 2.0, "max_length_mm": 5.0, "min_radius_mm": 0.5}
    steps = np.diff(hatch(straight(70), 1.0, flat(0.8), PIXEL, **lengths).starts) - 1
    assert steps.min() * STEP_MM >= 2.0
    assert steps.max() * STEP_MM <= 5.0 + 2 * STEP_MM


# What ink covers


def test_coverage_is_what_cairo_paints() -> None:
    rng = np.random.default_rng(3)
    counts = rng.integers(2, 9, 60)
    starts = np.concatenate([[0], np.cumsum(counts)])
    lines = Lines(rng.uniform(-1, 25, (starts[-1], 2)), starts)
    surface = Surface(240, 240)
    context = surface.context
    context.set_source_rgb(0, 0, 0)
    context.set_line_width(WIDTH / PIXEL)
    context.set_line_cap(1)
    context.set_line_join(1)
    for line in every(lines):
        for x, y in line / PIXEL:
            context.line_to(x, y)
        context.stroke()
    painted = 1 - surface.picture()[..., 0] / 255
    sheet = flat(0)
    for line in every(lines):  # they cross: one by one
        cover(Lines(line, np.array([0, len(line)])), WIDTH, PIXEL, sheet)
    assert abs(float(sheet.mean() - painted.mean())) < 0.01
    assert np.abs(sheet - painted).mean() < 0.02
    assert np.abs(sheet - painted[::-1]).mean() > 0.1  # it can fail


def test_a_stroke_does_not_darken_itself_and_two_do() -> None:
    there_and_back = np.array([[5.0, 12.04], [15.0, 12.04], [5.0, 12.04]])
    once = covered(Lines(there_and_back[:2], np.array([0, 2])))
    assert np.array_equal(covered(Lines(there_and_back, np.array([0, 3]))), once)
    twice = once.copy()
    cover(Lines(there_and_back[:2], np.array([0, 2])), WIDTH, PIXEL, twice)
    assert np.allclose(twice, 1 - (1 - once) ** 2, atol=1e-6)


@pytest.mark.parametrize("gap", [0.0, 0.02, 0.05])
def test_lines_side_by_side_leave_what_lies_between_them(gap: float) -> None:
    """Gaps far below a pixel count in full, wherever they lie on the raster."""
    apart = WIDTH + gap
    tops = 6.0 + apart * np.arange(int(12 / apart))
    ends = np.stack([np.stack([np.full_like(tops, -1), tops], 1), np.stack([np.full_like(tops, 25), tops], 1)], 1)
    sheet = covered(Lines(ends.reshape(-1, 2), 2 * np.arange(len(tops) + 1)))
    assert sheet[80:160].mean() == pytest.approx(WIDTH / apart, abs=0.01)


# Dashes


@pytest.mark.parametrize("demand", [0.02, 0.06, 0.15])
def test_dashes_cover_what_is_asked_evenly(demand: float) -> None:
    side = 60.0
    wanted = np.full((200, 200), demand, np.float32)
    lines = dash(straight(30), 2.5, wanted, 0.3, (side, side), WIDTH, shortest_mm=0.3, longest_mm=2.0, full=0.2, seed=1)
    sheet = np.zeros((600, 600), np.float32)
    cover(lines, WIDTH, PIXEL, sheet)
    assert sheet[60:-60, 60:-60].mean() == pytest.approx(demand, rel=0.2)
    blocks = sheet.reshape(6, 100, 6, 100).mean(axis=(1, 3))
    assert blocks.std() < 0.25 * demand  # as many strokes at random would have about as much as this or more
    assert lines.points.min() >= 0
    assert lines.points.max() <= side


def test_dashes_depend_on_the_seed_alone() -> None:
    wanted = np.full((40, 40), 0.1, np.float32)

    def drawn(seed: int) -> bytes:
        options = {"shortest_mm": 0.3, "longest_mm": 2.0, "full": 0.2}
        return dash(straight(0), 1.0, wanted, 0.3, (12, 12), WIDTH, seed=seed, **options).points.tobytes()

    assert drawn(1) == drawn(1) != drawn(2)


# Mending


def mended(lines: Lines, demand: NDArray[np.float32], degrees: float = 0) -> Lines:
    target = 1 - demand.reshape(80, 3, 80, 3).mean(axis=(1, 3))
    return mend(
        lines, straight(degrees), 1.0, target, demand.shape, PIXEL, (SIDE, SIDE), WIDTH,
        sigma_mm=0.45, lengths_mm=(3.0, 1.0), least_mm=2.0, seed=0,
    )  # fmt: skip


def error(lines: Lines, demand: NDArray[np.float32]) -> float:
    """Mean squared difference of blurred light to what was asked for, as Cairo paints the lines."""
    surface = Surface(480, 480)
    context = surface.context
    context.set_source_rgb(0, 0, 0)
    context.set_line_width(2 * WIDTH / PIXEL)
    context.set_line_cap(1)
    context.set_line_join(1)
    for line in every(lines):
        for x, y in line * 2 / PIXEL:
            context.line_to(x, y)
        context.stroke()
    light = (surface.picture()[..., 0] / 255).reshape(240, 2, 240, 2).mean(axis=(1, 3))
    return float(((gaussian_filter(light, 4.5) - gaussian_filter(1 - demand, 4.5))[20:-20, 20:-20] ** 2).mean())


@pytest.mark.parametrize(("separation", "wanted"), [(1.0, 0.5), (0.7, 0.3), (0.5, 0.8)])
def test_mending_lowers_the_difference_that_an_eye_sees(separation: float, wanted: float) -> None:
    """Where lines leave it too light, and where short ones make it too dark."""
    demand = flat(wanted)
    long, short = LENGTHS, LENGTHS | {"max_length_mm": 1.6}
    lines = hatch(straight(0), 1.0, flat(separation), PIXEL, **(short if WIDTH / separation > wanted else long))
    more = mended(lines, demand)
    assert error(more, demand) < 0.5 * error(lines, demand)
    assert abs(inner(covered(more)) - wanted) < 0.06
    assert more.points.min() >= 0
    assert more.points.max() <= SIDE


def test_what_nobody_asked_for_goes_and_lines_keep_their_least_length() -> None:
    dash = np.stack([np.arange(9) * STEP_MM + 5, np.full(9, 6.0)], 1)
    line = np.stack([np.arange(60) * STEP_MM + 5, np.full(60, 12.0)], 1)
    left = every(mended(Lines(np.concatenate([dash, line]), np.array([0, 9, 69])), flat(0)))
    assert len(left) == 1
    assert np.ptp(left[0][:, 0]) == pytest.approx(2.0, abs=6 * STEP_MM)
    assert set(left[0][:, 1].round(9)) == {12.0}


def test_nothing_is_added_to_bare_paper() -> None:
    assert len(mended(NO_LINES, flat(0)).starts) == 1


# Chains


def test_chains_stay_on_their_lines() -> None:
    lines = hatch(rings(), 0.25, flat(1.0), PIXEL, **LENGTHS)
    points, starts = chains(lines, 0.04)
    assert len(starts) == len(lines.starts)
    assert np.array_equal(points[starts[:-1]], lines.points[lines.starts[:-1]])
    on_curve = np.concatenate([points[a:b:3] for a, b in pairwise(starts)])
    assert cKDTree(lines.points).query(on_curve)[0].max() < 0.1
    assert len(points) < 0.5 * len(lines.points)
    assert len(chains(NO_LINES, 0.04)[0]) == 0


def test_a_line_that_is_a_point_is_a_dot() -> None:
    """A dash in the corner of the sheet has no way to go; its chain was whatever stood in memory."""
    line = np.array([[10.0, 10.0], [20.0, 12.0], [30.0, 10.0]])
    lines = Lines(np.concatenate([line, np.full((11, 2), 7.0), line]), np.array([0, 3, 14, 17]))
    points, starts = chains(lines, 0.05)
    assert np.diff(starts).tolist() == [starts[1], 4, starts[1]]
    assert (points[starts[1] : starts[2]] == 7.0).all()
    assert np.array_equal(points[: starts[1]], points[starts[2] :])
