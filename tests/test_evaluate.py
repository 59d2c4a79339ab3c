"""The figures of merit against their formulas, written out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from strokeplan import InputError, StrokePlan
from strokeplan.evaluate import compare, evaluate
from strokeplan.image import Photo
from strokeplan.rendering import paint, render


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
    assert figures.rgb == pytest.approx(np.sqrt((difference**2).sum(axis=2)).mean(), rel=1e-6)
    assert figures.ssim == pytest.approx(ssim(a, b, side=7), rel=1e-6)


def test_the_same_picture_has_no_distance() -> None:
    figures = compare(noise(1), noise(1))
    assert (figures.psnr_db, figures.ssim, figures.rgb) == (math.inf, 1, 0)


def test_an_offset_of_ten() -> None:
    a = noise(1) // 2
    figures = compare(a + np.uint8(10), a)
    assert figures.psnr_db == pytest.approx(20 * math.log10(25.5))
    assert figures.rgb == pytest.approx(10 * math.sqrt(3))
    assert 0.9 < figures.ssim < 1


def test_black_against_white_is_as_far_as_it_gets() -> None:
    figures = compare(np.zeros((9, 9, 3), np.uint8), np.full((9, 9, 3), 255, np.uint8))
    assert figures.psnr_db == 0
    assert figures.rgb == pytest.approx(255 * math.sqrt(3))
    assert figures.ssim == pytest.approx(0, abs=1e-3)


def test_figures_do_not_depend_on_the_order() -> None:
    there, back = compare(noise(1), noise(2)), compare(noise(2), noise(1))
    assert (there.psnr_db, there.rgb) == (back.psnr_db, back.rgb)
    assert there.ssim == pytest.approx(back.ssim)


@pytest.mark.parametrize(("shape", "side"), [((6, 40), 5), ((40, 5), 5), ((4, 4), 3), ((3, 40), 3), ((7, 7), 7)])
def test_a_small_picture_is_compared_in_a_smaller_window(shape: tuple[int, int], side: int) -> None:
    a, b = noise(1, *shape), noise(2, *shape)
    assert compare(a, b).ssim == pytest.approx(ssim(a, b, side), rel=1e-6)


@pytest.mark.parametrize("shape", [(2, 40), (40, 2), (1, 1)])
def test_a_picture_below_three_pixels_has_no_ssim(shape: tuple[int, int]) -> None:
    figures = compare(noise(1, *shape), noise(2, *shape))
    assert math.isnan(figures.ssim)
    assert 0 < figures.psnr_db < 20
    assert 0 < figures.rgb < 442


def test_a_plan_is_compared_as_it_is_painted(small_plan: StrokePlan, small_picture: NDArray[np.uint8]) -> None:
    figures = evaluate(small_plan, Photo(small_picture))
    assert figures == compare(render(small_plan), small_picture)
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
