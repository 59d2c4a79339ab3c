"""The figures of merit against their formulas, written out."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from strokeplan import InputError, StrokePlan
from strokeplan.evaluate import (
    COLUMNS,
    Figures,
    PlanFigures,
    cells,
    compare,
    edge_agreement,
    evaluate,
    json_figures,
    means,
    uncovered_percent,
)  # fmt: skip
from strokeplan.formats.svg import encode
from strokeplan.image import Photo
from strokeplan.rendering import paint, render
from strokeplan.strokes import Layer


def noise(seed: int, height: int = 30, width: int = 40) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def ssim(a: NDArray[np.uint8], b: NDArray[np.uint8], side: int) -> float:
    """Structural similarity (Wang et al. 2004, equation 13) with a square window, mean over the channels."""
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    unbiased = side**2 / (side**2 - 1)
    border = side // 2
    means = []
    for channel in range(3):
        x, y = a[..., channel].astype(float), b[..., channel].astype(float)
        mx, my, mxx, myy, mxy = (uniform_filter(v, side) for v in (x, y, x * x, y * y, x * y))
        vx, vy, vxy = (unbiased * (m - n) for m, n in ((mxx, mx * mx), (myy, my * my), (mxy, mx * my)))
        similarity = (2 * mx * my + c1) * (2 * vxy + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2))
        means.append(similarity[border : len(x) - border, border : x.shape[1] - border].mean())
    return float(np.mean(means))


def test_figures_are_their_formulas() -> None:
    a, b = noise(1), noise(2)
    a[:, :20] = b[:, :20] // 2 + 60
    figures = compare(a, b)
    difference = a.astype(float) - b
    assert figures.psnr_db == pytest.approx(10 * math.log10(255**2 / np.mean(difference**2)), rel=1e-9)
    assert figures.rgb_8bit == pytest.approx(np.sqrt((difference**2).sum(axis=2)).mean(), rel=1e-6)
    assert figures.ssim == pytest.approx(ssim(a, b, side=7), rel=1e-6)


def test_the_same_picture_has_no_distance() -> None:
    figures = compare(noise(1), noise(1))
    assert figures == Figures(psnr_db=math.inf, ssim=1, rgb_8bit=0, ciede2000=0, edge_f1=1)


def test_an_offset_of_ten() -> None:
    a = noise(1) // 2
    figures = compare(a + np.uint8(10), a)
    assert figures.psnr_db == pytest.approx(20 * math.log10(25.5))
    assert figures.rgb_8bit == pytest.approx(10 * math.sqrt(3))
    assert 0.9 < figures.ssim < 1


def test_black_against_white_is_as_far_as_it_gets() -> None:
    figures = compare(np.zeros((9, 9, 3), np.uint8), np.full((9, 9, 3), 255, np.uint8))
    assert figures.psnr_db == 0
    assert figures.rgb_8bit == pytest.approx(255 * math.sqrt(3))
    assert figures.ssim == pytest.approx(0, abs=1e-3)


def test_figures_do_not_depend_on_the_order() -> None:
    there, back = compare(noise(1), noise(2)), compare(noise(2), noise(1))
    assert (there.psnr_db, there.rgb_8bit, there.edge_f1) == (back.psnr_db, back.rgb_8bit, back.edge_f1)
    assert there.ssim == pytest.approx(back.ssim)
    assert there.ciede2000 == pytest.approx(back.ciede2000)


@pytest.mark.parametrize(("shape", "side"), [((6, 40), 5), ((40, 5), 5), ((4, 4), 3), ((3, 40), 3), ((7, 7), 7)])
def test_a_small_picture_is_compared_in_a_smaller_window(shape: tuple[int, int], side: int) -> None:
    a, b = noise(1, *shape), noise(2, *shape)
    assert compare(a, b).ssim == pytest.approx(ssim(a, b, side), rel=1e-6)


@pytest.mark.parametrize("shape", [(2, 40), (40, 2), (1, 1)])
def test_a_picture_below_three_pixels_has_no_ssim(shape: tuple[int, int]) -> None:
    figures = compare(noise(1, *shape), noise(2, *shape))
    assert math.isnan(figures.ssim)
    assert 0 < figures.psnr_db < 20
    assert 0 < figures.rgb_8bit < 442


def test_a_plan_is_compared_as_it_is_painted(small_plan: StrokePlan, small_picture: NDArray[np.uint8]) -> None:
    figures = evaluate(small_plan, Photo(small_picture))
    likeness = compare(render(small_plan), small_picture)
    assert {name: getattr(figures, name) for name in asdict(likeness)} == asdict(likeness)
    assert figures.psnr_db > compare(np.full_like(small_picture, 255), small_picture).psnr_db + 3


def test_a_plan_is_painted_at_the_photo_s_size(small_plan: StrokePlan) -> None:
    large = render(small_plan, scale=3)
    assert evaluate(small_plan, Photo(large)).psnr_db == math.inf


@pytest.mark.parametrize("shape", [(64, 96), (65, 96), (63, 96), (64, 97), (64, 95), (192, 289), (641, 960), (32, 49)])
def test_a_photo_may_be_a_rounding_away_from_the_plan_s_shape(small_plan: StrokePlan, shape: tuple[int, int]) -> None:
    rows, columns = shape
    assert evaluate(small_plan, Photo(paint(small_plan, columns, rows))).psnr_db == math.inf


@pytest.mark.parametrize("shape", [(96, 64), (64, 64), (67, 96), (640, 980)])
def test_another_picture_is_refused(small_plan: StrokePlan, shape: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=f"^the plan is 96 × 64, the photo {shape[1]} × {shape[0]}: another picture"):
        evaluate(small_plan, Photo(np.zeros((*shape, 3), np.uint8)))


# Colour difference


def grey_picture(value: int, height: int = 4, width: int = 6) -> NDArray[np.uint8]:
    return np.full((height, width, 3), value, np.uint8)


def test_ciede2000_of_greys_is_their_weighted_lightness() -> None:
    """Without colour, ΔE00 is ΔL / S_L, S_L = 1 + 0.015 (L̄ − 50)² / √(20 + (L̄ − 50)²) (Sharma et al. 2005)."""

    def lightness(value: int) -> float:
        c = value / 255
        y = ((c + 0.055) / 1.055) ** 2.4  # sRGB's curve above its linear foot
        return 116 * y ** (1 / 3) - 16

    for a, b in ((60, 200), (100, 110), (250, 90)):
        low, high = lightness(a), lightness(b)
        middle = (low + high) / 2
        weight = 1 + 0.015 * (middle - 50) ** 2 / math.sqrt(20 + (middle - 50) ** 2)
        assert compare(grey_picture(a), grey_picture(b)).ciede2000 == pytest.approx(abs(high - low) / weight, rel=1e-3)


def test_ciede2000_is_the_same_in_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = compare(noise(1), noise(2)).ciede2000
    monkeypatch.setattr("strokeplan.evaluate.STRIP_PIXELS", 7 * 40)
    assert compare(noise(1), noise(2)).ciede2000 == pytest.approx(whole, rel=1e-9)


# Edges


def step(at: int, bright: int = 255, height: int = 600, width: int = 800) -> NDArray[np.uint8]:
    """White (or grey) right of column `at`, black left of it; the diagonal is 1000 pixels."""
    picture = np.zeros((height, width, 3), np.uint8)
    picture[:, at:] = bright
    return picture


@pytest.mark.parametrize(("shift", "agreement"), [(0, 1), (1, 1), (2, 1), (4, 0), (40, 0)])
def test_an_edge_is_found_again_within_the_tolerance(shift: int, agreement: float) -> None:
    """2.5 pixels at this diagonal."""
    assert edge_agreement(step(400 + shift), step(400)) == agreement
    assert edge_agreement(step(400), step(400 + shift)) == agreement


def test_a_second_edge_costs_precision_or_recall() -> None:
    both = step(400)
    both[:, 600:] = 0
    assert edge_agreement(both, step(400)) == pytest.approx(2 / 3)
    assert edge_agreement(step(400), both) == pytest.approx(2 / 3)


@pytest.mark.parametrize(("bright", "agreement"), [(255, 1), (64, 1), (38, 0)])
def test_an_edge_painted_too_faint_is_missed(bright: int, agreement: float) -> None:
    """The contrast asked for is 0.2 of the range: 51."""
    assert edge_agreement(step(400, bright), step(400)) == agreement


def test_pictures_without_edges_agree_with_each_other_alone() -> None:
    assert edge_agreement(grey_picture(9, 30, 40), grey_picture(200, 30, 40)) == 1
    assert edge_agreement(grey_picture(9, 600, 800), step(400)) == 0


@pytest.mark.parametrize(("shift", "agreement"), [(0.002, 1), (0.004, 0)])
@pytest.mark.parametrize("diagonal", [500, 1000, 2000])
def test_the_tolerance_grows_with_the_picture(diagonal: int, shift: float, agreement: float) -> None:
    height, width = diagonal * 3 // 5, diagonal * 4 // 5
    first, second = (step(at, 255, height, width) for at in (width // 2, width // 2 + round(shift * diagonal)))
    assert edge_agreement(first, second) == agreement


# The plan: what it covers and what it takes


def strip_plan(lines: list[tuple[float, float]], width: float = 40, height: float = 20) -> StrokePlan:
    """Straight butt strokes across the whole canvas, at y and of a width, in white on black."""
    x = np.array([-10, width / 3, width * 2 / 3, width + 10])
    return StrokePlan(
        width=width, height=height,
        points=np.concatenate([np.stack([x, np.full(4, y)], axis=1) for y, _ in lines]),
        starts=np.arange(len(lines) + 1) * 4, widths=np.array([w for _, w in lines]),
        colors=np.full((len(lines), 3), 255, np.uint8), layers=(Layer("1", 0, len(lines), cap="butt"),),
        background=(0, 0, 0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("lines", "uncovered"),
    [
        ([(10.0, 20.0)], 0),
        ([(10.0, 10.0)], 50),
        ([(5.0, 10.0), (7.0, 10.0)], 40),
        ([(10.0, 10.8)], 50),  # 0.4 of the next row on each side: no centre
        ([(10.0, 11.2)], 40),  # 0.6 of it
        ([(1.0, 1.2), (2.0, 0.8)], 90),  # centres at 0.5, 1.5, 2.5 …: the second covers 1.6 to 2.4, none
    ],
)
def test_pixels_are_uncovered_whose_centre_no_stroke_covers(lines: list[tuple[float, float]], uncovered: float) -> None:
    assert uncovered_percent(strip_plan(lines), 40, 20) == pytest.approx(uncovered)


def test_colours_of_strokes_and_canvas_do_not_matter_to_what_is_covered(small_plan: StrokePlan) -> None:
    inverse = replace(small_plan, colors=255 - small_plan.colors, background=(0, 0, 0))
    assert uncovered_percent(inverse, 96, 64) == uncovered_percent(small_plan, 96, 64)


def test_a_plan_is_as_large_as_its_files(
    small_plan: StrokePlan, small_picture: NDArray[np.uint8], tmp_path: Path
) -> None:
    figures = evaluate(small_plan, Photo(small_picture))
    for name in ("plan.svg", "plan.svgz"):
        small_plan.save(tmp_path / name)
    assert figures.svg_bytes == (tmp_path / "plan.svg").stat().st_size == len(encode(small_plan))
    assert figures.svgz_bytes == (tmp_path / "plan.svgz").stat().st_size
    assert (figures.strokes, figures.cubics) == (len(small_plan), small_plan.cubics)


# What is told


def test_figures_are_told_to_people_and_programs() -> None:
    perfect = PlanFigures(
        psnr_db=math.inf, ssim=math.nan, rgb_8bit=0, ciede2000=0, edge_f1=1, uncovered_percent=0.5, strokes=3,
        cubics=1234, svg_bytes=5, svgz_bytes=6,
    )  # fmt: skip
    assert list(COLUMNS) == list(asdict(perfect))
    told = json_figures(asdict(perfect))
    assert (told["psnr_db"], told["ssim"], told["edge_f1"], told["cubics"]) == (None, None, 1, 1234)
    assert cells(asdict(perfect))[-5:] == ["0.50 %", "3", "1,234", "5", "6"]
    assert means([perfect, replace(perfect, uncovered_percent=1.5, cubics=1235)])["uncovered_percent"] == 1
    assert means([perfect, replace(perfect, cubics=1235)])["cubics"] == 1234.5
