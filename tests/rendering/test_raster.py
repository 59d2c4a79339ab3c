"""Pixels: the right size, the right pixels in the right order, and an honest word where Pycairo is missing."""

from __future__ import annotations

import io
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from strokeplan.errors import InputError, MissingExtraError
from strokeplan.rendering import Surface, encode_png, paint, render, require_cairo
from strokeplan.strokes import Cap, Layer, StrokePlan

PAPER = (250, 240, 230)
RED, BLUE = (200, 30, 20), (10, 40, 250)

REDUCED_PSNR_DB = 39.5
"""Painted at 4× and reduced against painted at 1×: 39.8 dB measured on 200 random strokes."""
FULL_PRESSURE_PSNR_DB = 43.0
"""Outlines of 200 random strokes at full pressure against Cairo's own strokes: 43.8 dB measured. What differs is
mostly Cairo's: of the pixels on the wrong side of exact offset curves it has 931, the outlines 620."""


def plan_of(
    *strokes: tuple[list[tuple[float, float]], float, tuple[int, int, int]],
    caps: tuple[Cap, ...] = ("butt",),
    size: tuple[float, float] = (40, 20),
) -> StrokePlan:
    """A plan of chains, widths and colours; the strokes are dealt out evenly to one layer for each cap."""
    ends = np.linspace(0, len(strokes), len(caps) + 1).astype(int).tolist()
    return StrokePlan(
        width=size[0],
        height=size[1],
        points=np.concatenate([np.array(chain, float) for chain, _, _ in strokes]),
        starts=np.cumsum([0, *(len(chain) for chain, _, _ in strokes)]),
        widths=np.array([width for _, width, _ in strokes], float),
        colors=np.array([color for _, _, color in strokes], np.uint8),
        layers=tuple(Layer("", ends[k], ends[k + 1], cap=cap) for k, cap in enumerate(caps)),
        background=PAPER,
    )


def line(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    """A straight chain of one cubic."""
    return [(x0 + (x1 - x0) * t, y0 + (y1 - y0) * t) for t in (0, 1 / 3, 2 / 3, 1)]


def expected(*boxes: tuple[slice, slice, tuple[int, int, int]]) -> NDArray[np.uint8]:
    """Bare paper, 20 × 40, with boxes of colour painted one over the other."""
    picture = np.full((20, 40, 3), PAPER, np.uint8)
    for rows, columns, color in boxes:
        picture[rows, columns] = color
    return picture


# Sizes


@pytest.mark.parametrize(
    ("wanted", "shape"),
    [
        ({}, (300, 451)),
        ({"scale": 1}, (300, 451)),
        ({"scale": 2.0}, (600, 902)),
        ({"scale": 0.5}, (150, 226)),  # 225.5, to the even neighbour
        ({"scale": 1e-6}, (1, 1)),
        ({"width": 100}, (67, 100)),
        ({"height": 100}, (100, 150)),
        ({"width": 1}, (1, 1)),
        ({"height": 1}, (1, 2)),
        ({"width": 32_767, "tall": 2.0}, (145, 32_767)),
    ],
)
def test_size_of_the_picture(wanted: dict[str, Any], shape: tuple[int, int]) -> None:
    plan = plan_of((line(1, 1, 2, 1), 1, RED), size=(451, wanted.pop("tall", 300)))
    assert render(plan, **wanted).shape == (*shape, 3)


def test_canvas_of_odd_size_becomes_whole_pixels() -> None:
    assert render(plan_of((line(1, 1, 2, 1), 1, RED), size=(10.4, 10.6))).shape == (11, 10, 3)


@pytest.mark.parametrize("name", ["width", "height", "scale"])
@pytest.mark.parametrize("value", [0, -1, math.nan, math.inf])
def test_a_size_that_is_none_is_refused(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"^{name} {value:g} is no size; give more than 0$"):
        render(plan_of((line(1, 1, 2, 1), 1, RED)), **{name: value})


@pytest.mark.parametrize("given", [{"width": 8, "height": 8}, {"width": 8, "scale": 1}, {"height": 8, "scale": 1}])
def test_two_sizes_are_refused(given: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"^give one of width, height and scale, not {' and '.join(given)}$"):
        render(plan_of((line(1, 1, 2, 1), 1, RED)), **given)


@pytest.mark.parametrize(
    ("wanted", "size"),
    [
        ({"width": 300_001}, "300001 × 150000"),
        ({"height": 200_000}, "400000 × 200000"),
        ({"scale": 1e4}, "400000 × 200000"),
        ({"scale": 1e308}, "inf × inf"),
    ],
)
def test_a_picture_beyond_all_limits_is_refused(wanted: dict[str, Any], size: str) -> None:
    with pytest.raises(InputError, match=f"^a picture of {size} pixels is too large; a side may have 300000$"):
        render(plan_of((line(1, 1, 2, 1), 1, RED)), **wanted)


def test_no_surface_is_larger_than_cairo_s_limit() -> None:
    with pytest.raises(InputError, match="a picture of 2 × 40000 pixels is too large"):
        Surface(2, 40_000)


def test_paint_stretches_to_the_size_it_is_given() -> None:
    plan = plan_of((line(10, 10, 30, 10), 10, RED))
    wanted = expected((slice(5, 15), slice(10, 30), RED)).repeat(3, 0).repeat(2, 1)
    np.testing.assert_array_equal(paint(plan, 80, 60), wanted)


# Which pixels


def test_a_straight_stroke_with_butt_caps_covers_exactly_its_pixels() -> None:
    picture = render(plan_of((line(10, 10, 30, 10), 4, RED)))
    np.testing.assert_array_equal(picture, expected((slice(8, 12), slice(10, 30), RED)))


def test_an_upright_stroke_covers_exactly_its_pixels() -> None:
    picture = render(plan_of((line(7, 3, 7, 15), 6, RED)))
    np.testing.assert_array_equal(picture, expected((slice(3, 15), slice(4, 10), RED)))


def test_round_caps_add_half_a_disc_at_each_end() -> None:
    picture = render(plan_of((line(12, 10, 28, 10), 10, RED), caps=("round",)))
    np.testing.assert_array_equal(picture[5:15, 12:28], expected((slice(None), slice(None), RED))[5:15, 12:28])
    assert np.abs(picture.astype(int) - picture[:, ::-1]).max() <= 1
    coverage = (picture.astype(float) - PAPER).sum(axis=2) / (np.array(RED, float) - PAPER).sum()
    assert coverage.sum() == pytest.approx(16 * 10 + math.pi * 5**2, rel=0.003)
    assert np.flatnonzero(coverage.any(axis=0)).tolist() == list(range(7, 33))


def test_half_a_pixel_is_half_the_colour() -> None:
    picture = render(plan_of((line(10, 10, 30, 10), 5, RED)))
    # Cairo looks at 15 rows in a pixel.
    assert np.abs(picture[[7, 12], 10:30] - np.add(RED, PAPER) / 2).max() <= 255 / 15
    assert np.all(picture[8:12, 10:30] == RED)


def test_width_and_place_scale_with_the_picture() -> None:
    picture = render(plan_of((line(10, 10, 30, 10), 4, RED)), scale=3)
    np.testing.assert_array_equal(picture, expected((slice(8, 12), slice(10, 30), RED)).repeat(3, 0).repeat(3, 1))


def test_caps_are_those_of_the_layer() -> None:
    strokes = (line(10, 5, 30, 5), 4, RED), (line(10, 15, 30, 15), 4, BLUE)
    butt_then_round = render(plan_of(*strokes, caps=("butt", "round")))
    round_then_butt = render(plan_of(*strokes, caps=("round", "butt")))
    assert [np.any(butt_then_round[row, 9] != PAPER) for row in (5, 15)] == [False, True]
    assert [np.any(round_then_butt[row, 9] != PAPER) for row in (5, 15)] == [True, False]


def test_every_cubic_of_a_chain_is_painted() -> None:
    chain = [*line(4, 10, 20, 10), *line(20, 10, 36, 10)[1:]]
    picture = render(plan_of((chain, 4, RED)))
    np.testing.assert_array_equal(picture, expected((slice(8, 12), slice(4, 36), RED)))


def test_joints_are_round() -> None:
    chain = [*line(5, 15, 20, 15), *line(20, 15, 20, 2)[1:]]
    picture = render(plan_of((chain, 6, RED)))
    assert np.all(picture[16, 21] == RED)  # inside the disc of the joint, outside both edges
    assert np.any(picture[17, 22] != RED)  # the tip that a mitred joint would fill


def test_later_strokes_cover_earlier_ones() -> None:
    across, down = (slice(8, 12), slice(5, 35)), (slice(2, 18), slice(18, 22))
    red, blue = (line(5, 10, 35, 10), 4, RED), (line(20, 2, 20, 18), 4, BLUE)
    np.testing.assert_array_equal(render(plan_of(red, blue)), expected((*across, RED), (*down, BLUE)))
    np.testing.assert_array_equal(render(plan_of(blue, red)), expected((*down, BLUE), (*across, RED)))


def test_later_layers_cover_earlier_ones() -> None:
    red, blue = (line(5, 10, 35, 10), 4, RED), (line(20, 2, 20, 18), 4, BLUE)
    two_layers = render(plan_of(red, blue, caps=("butt", "butt")))
    np.testing.assert_array_equal(two_layers, render(plan_of(red, blue)))


def test_strokes_off_the_canvas_do_no_harm() -> None:
    far = [(-1e7, -1e7), (1e7, -1e7), (1e7, -9e6), (-1e7, -1e7)]
    picture = render(plan_of((far, 1, BLUE), (line(-50, 10, 90, 10), 4, RED)))
    np.testing.assert_array_equal(picture, expected((slice(8, 12), slice(None), RED)))


def test_the_same_plan_gives_the_same_pixels() -> None:
    plan = random_plan()
    np.testing.assert_array_equal(render(plan), render(plan))


# Pressure


def pressed(plan: StrokePlan, *pressures: float) -> StrokePlan:
    return replace(plan, pressures=np.array(pressures, float))


def test_a_stroke_is_as_wide_as_it_is_pressed() -> None:
    chain = [*line(4, 10, 20, 10), *line(20, 10, 36, 10)[1:]]
    picture = render(pressed(plan_of((chain, 16, RED)), 0.5, 0.5, 1), scale=10)
    across = np.all(picture == RED, axis=2).sum(axis=0)
    assert np.abs(across[50:195] - 80).max() <= 1
    assert across[280] == pytest.approx(120, abs=2)  # half way from 8 to 16
    assert across[350] == pytest.approx(155, abs=2)
    assert not across[:39].any()
    assert not across[361:].any()


def test_full_pressure_is_the_stroke_without() -> None:
    plan = random_plan()
    full = pressed(plan, *[1.0] * int(plan.knots.sum()))
    assert psnr(render(full), render(plan)) > FULL_PRESSURE_PSNR_DB
    assert psnr(render(pressed(plan, *[0.9] * int(plan.knots.sum()))), render(plan)) < FULL_PRESSURE_PSNR_DB - 15


def test_full_pressure_with_butt_caps_is_the_stroke_without() -> None:
    plan = plan_of(([(5, 12), (15, 6), (25, 14), (35, 8)], 4, RED))
    assert psnr(render(pressed(plan, 1, 1), scale=8), render(plan, scale=8)) > FULL_PRESSURE_PSNR_DB


def test_no_pressure_leaves_the_paper_bare() -> None:
    plan = plan_of((line(10, 10, 30, 10), 4, RED), caps=("round",))
    np.testing.assert_array_equal(render(pressed(plan, 0, 0)), expected())


def test_strokes_without_pressure_are_painted_as_ever_among_others() -> None:
    red, blue = (line(5, 5, 35, 5), 4, RED), (line(5, 15, 35, 15), 4, BLUE)
    mixed = render(pressed(plan_of(red, blue), np.nan, np.nan, 0.5, 0.5))
    wanted = expected((slice(3, 7), slice(5, 35), RED), (slice(14, 16), slice(5, 35), BLUE))
    np.testing.assert_array_equal(mixed, wanted)


def test_a_stroke_with_pressure_has_no_seams() -> None:
    loop = [(4.0, 4.0), (44.0, 18.0), (-4.0, 18.0), (36.0, 4.0)]
    picture = render(pressed(plan_of((loop, 6, RED), caps=("round",)), 0.3, 1), scale=20)
    surely, paper = np.all(picture == RED, axis=2), np.all(picture == PAPER, axis=2)
    assert ndimage.label(paper)[1] == ndimage.label(surely)[1] == 1
    # Only its rim is neither: what lies deeper than antialiasing reaches is full colour.
    assert np.all(surely[ndimage.binary_erosion(~paper, iterations=3)])


def test_an_enlarged_picture_of_pressed_strokes_is_the_same_picture() -> None:
    plan = random_plan()
    pressures = np.random.default_rng(2).uniform(0.2, 1, int(plan.knots.sum()))
    plan = pressed(plan, *pressures)
    reduced = np.asarray(Image.fromarray(render(plan, scale=4)).reduce(4))
    assert psnr(reduced, render(plan)) > REDUCED_PSNR_DB


# Enlarged


def random_plan(caps: tuple[Cap, ...] = ("round",)) -> StrokePlan:
    """200 curved strokes, wide to fine."""
    rng = np.random.default_rng(1)
    strokes = []
    for width in np.geomspace(30, 2, 200):
        start, *steps = rng.uniform(0, (160, 120)), *rng.normal(0, 15, (3, 2))
        chain = np.cumsum([start, *steps], axis=0)
        strokes.append((chain.tolist(), float(width), tuple(rng.integers(0, 256, 3).tolist())))
    return plan_of(*strokes, caps=caps, size=(160, 120))


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    return float(10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2)))


def test_an_enlarged_picture_is_the_same_picture() -> None:
    plan = random_plan()
    reduced = np.asarray(Image.fromarray(render(plan, scale=4)).reduce(4))
    assert psnr(reduced, render(plan)) > REDUCED_PSNR_DB
    assert psnr(np.roll(reduced, 1, axis=1), render(plan)) < REDUCED_PSNR_DB - 15


# Surfaces, files, Pycairo


def test_surface_over_a_picture_shows_it() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    np.testing.assert_array_equal(Surface.over(picture, scale=1).picture(), picture)


def test_surface_over_a_picture_draws_in_the_picture_s_coordinates() -> None:
    surface = Surface.over(np.zeros((10, 10, 3), np.uint8), scale=3)
    surface.context.set_source_rgb(1, 1, 1)
    surface.context.rectangle(2, 4, 5, 1)
    surface.context.fill()
    shown = surface.picture()
    assert shown.shape == (30, 30, 3)
    assert np.argwhere(shown.all(axis=2)).tolist() == [[y, x] for y in range(12, 15) for x in range(6, 21)]


def test_png_holds_the_same_pixels() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (9, 13, 3), dtype=np.uint8)
    data = encode_png(picture)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(data), formats=["PNG"])), picture)
    assert encode_png(picture) == data


def test_without_pycairo_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    plan = plan_of((line(1, 1, 2, 1), 1, RED))
    monkeypatch.setitem(sys.modules, "cairo", None)
    for use in (require_cairo, lambda: render(plan), lambda: plan.save(tmp_path / "a.png")):
        with pytest.raises(MissingExtraError, match=r"pip install 'strokeplan\[raster\]'"):
            use()
    assert list(tmp_path.iterdir()) == []


def test_without_pycairo_curves_can_still_be_saved(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "cairo", None)
    for name in ("a.json", "a.svg"):
        plan_of((line(1, 1, 2, 1), 1, RED)).save(tmp_path / name)
    assert len(list(tmp_path.iterdir())) == 2
