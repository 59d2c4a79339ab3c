"""Brushes: the same at every size and in every crop, obeying pressure and angle, and refusing nonsense."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray
from PIL import Image

import strokeplan
from strokeplan.errors import ImageError, InputError
from strokeplan.rendering import BRUSHES, Stamp, as_brush
from strokeplan.rendering.raster import render
from strokeplan.strokes import Layer, StrokePlan

REDUCED_PSNR_DB = 38.0
"""What is promised: painted at 4× and reduced against painted at 1×."""
INK, PAPER = (20, 40, 90), (255, 255, 255)


def one_stroke(*points: tuple[float, float], width: float = 20, size: tuple[float, float] = (120, 80)) -> StrokePlan:
    return StrokePlan(
        width=size[0], height=size[1], points=np.array(points, float), starts=np.array([0, len(points)]),
        widths=np.array([width], float), colors=np.array([INK], np.uint8), layers=(Layer("1", 0, 1),),
    )  # fmt: skip


def straight(x0: float, y0: float, x1: float, y1: float, width: float = 20) -> StrokePlan:
    return one_stroke(*[(x0 + (x1 - x0) * t, y0 + (y1 - y0) * t) for t in (0, 1 / 3, 2 / 3, 1)], width=width)


def paint_laid(picture: NDArray[np.uint8]) -> float:
    """Area of paint, in pixels of full colour."""
    return float((255.0 - picture[..., 0]).sum() / (255 - INK[0]))


@pytest.fixture(scope="module")
def coffee() -> StrokePlan:
    """A photo planned in a style whose strokes have pressure and angles."""
    plan = strokeplan.plan(ROOT / "samples" / "coffee.jpg", "impressionist")
    assert plan.pressures is not None
    assert plan.angles is not None
    return plan


@pytest.mark.parametrize("brush", BRUSHES)
def test_painted_at_4_times_the_size_and_reduced_it_is_the_same_picture(brush: str, coffee: StrokePlan) -> None:
    """A part of the cup, within one row of tiles at either size: the others would be painted for nothing."""
    once, large = (render(coffee, scale=scale, brush=brush, region=(190, 130, 160, 60)) for scale in (1, 4))
    reduced = np.asarray(Image.fromarray(large).reduce(4))
    psnr = [10 * np.log10(255**2 / np.mean((np.roll(reduced, k, 1).astype(float) - once) ** 2)) for k in (0, 1)]
    assert psnr[0] >= REDUCED_PSNR_DB
    assert psnr[1] < psnr[0] - 6  # one pixel aside is another picture


@pytest.mark.parametrize("brush", BRUSHES)
def test_a_region_is_a_crop_of_the_whole_to_the_byte(brush: str, small_plan: StrokePlan) -> None:
    fine = {"brush": brush, "layers": [len(small_plan.layers)], "scale": 6}
    whole = render(small_plan, threads=1, **fine)
    for x, y, wide, tall in ((10, 37, 31, 22), (95, 63, 1, 1)):  # the first lies on two rows of tiles
        part = render(small_plan, region=(x, y, wide, tall), threads=2, **fine)
        np.testing.assert_array_equal(part, whole[6 * y : 6 * (y + tall), 6 * x : 6 * (x + wide)])


@pytest.mark.parametrize("brush", BRUSHES)
def test_pressure_makes_a_stroke_narrow(brush: str) -> None:
    plan = straight(20, 40, 100, 40)
    light = replace(plan, pressures=np.array([0.4, 0.4]))
    full, half = (paint_laid(render(one, scale=2, brush=brush)) for one in (plan, light))
    assert 0.1 * full < half < 0.65 * full


@pytest.mark.parametrize("brush", [name for name in BRUSHES if name not in ("round", "stamp")])
def test_a_brush_is_thin_along_its_long_axis(brush: str) -> None:
    along, across = (
        replace(straight(20, 40, 100, 40), angles=np.array([angle, angle])) for angle in (0.0, 0.5 * np.pi)
    )
    assert paint_laid(render(along, brush=brush)) < 0.5 * paint_laid(render(across, brush=brush))
    set_angle = render(across, brush=f"{brush}:angle=0")
    np.testing.assert_array_equal(set_angle, render(along, brush=brush))


@pytest.mark.parametrize("brush", BRUSHES)
def test_paint_stays_within_reach(brush: str) -> None:
    plan = straight(45, 40, 75, 40, width=16)
    rows, columns = np.nonzero(np.any(render(plan, brush=brush) != 255, axis=2))
    reach = as_brush(brush).reach * 8 + 1
    assert rows.min() >= 40 - reach
    assert rows.max() < 40 + reach
    assert columns.min() >= 45 - reach
    assert columns.max() < 75 + reach


def test_angles_that_pass_through_zero_turn_the_short_way() -> None:
    """From just below π to just above 0 is a small turn; a line brush would show it as a twist."""
    plan = one_stroke(*[(20 + 10 * k, 40.0) for k in range(7)])
    turning = replace(plan, angles=np.array([np.pi - 0.02, 0.02, 0.04]))
    steady = replace(plan, angles=np.array([0.02, 0.02, 0.04]))
    difference = render(turning, brush="flat").astype(int) - render(steady, brush="flat")
    assert np.count_nonzero(np.abs(difference).max(axis=2) > 40) < 60


def test_texture_belongs_to_the_stroke_not_to_its_place() -> None:
    plan = straight(20, 40, 80, 40)
    moved = replace(plan, points=plan.points + np.array([7.0, -3.0]))
    there, here = render(moved, brush="bristle"), render(plan, brush="bristle")
    np.testing.assert_array_equal(there[:70, 10:], here[3:73, 3:113])


def test_no_two_strokes_have_the_same_hairs() -> None:
    plan = straight(20, 20, 90, 20)
    both = StrokePlan(
        width=120, height=80, points=np.concatenate([plan.points, plan.points + np.array([0.0, 40.0])]),
        starts=np.array([0, 4, 8]), widths=np.array([20.0, 20.0]), colors=np.array([INK, INK], np.uint8),
        layers=(Layer("1", 0, 2),),
    )  # fmt: skip
    picture = render(both, brush="bristle")
    assert np.any(picture[5:35] != picture[45:75])


def test_a_line_brush_paints_as_many_lines() -> None:
    for lines in (1, 3, 7):
        picture = render(straight(20, 40, 100, 40, width=60), brush=f"line:lines={lines},jitter=0", scale=2)
        dark = picture[:, 120, 0] < 128
        assert np.count_nonzero(dark[1:] & ~dark[:-1]) == lines


def test_a_stamp_paints_its_image(tmp_path: Path) -> None:
    bar = np.full((32, 32), 255, np.uint8)
    bar[:, 12:20] = 0
    Image.fromarray(bar).save(tmp_path / "bar.png")
    brush = f"stamp:image={tmp_path / 'bar.png'},spacing=2,jitter=0"
    picture = render(straight(20, 40, 100, 40), brush=brush, scale=2)
    dark = picture[80, :, 0] < 128
    assert np.count_nonzero(dark[1:] & ~dark[:-1]) == 3  # a bar at 20, 60 and 100
    turned = render(straight(20, 40, 100, 40), brush=brush + ",angle=90", scale=2)
    assert np.count_nonzero(turned[80, :, 0] < 128) > 2 * np.count_nonzero(dark)


@pytest.mark.parametrize(
    ("brush", "message"),
    [
        ("rnd", "no brush 'rnd'; there are round, flat"),
        ("bristle:hair=3", "brush bristle has no 'hair'; it has hairs, load"),
        ("bristle:hairs=0", "brush bristle: hairs=0: Expected `int` >= 2"),
        ("bristle:hairs=many", "brush bristle: hairs=many: Expected `int`"),
        ("bristle:load", "'load' is not KEY=VALUE"),
        ("bristle:load=nan", "load=nan"),
        ("round:hairs=2", "brush round has no 'hairs'; it has no settings"),
    ],
)
def test_a_wrong_brush_is_named(brush: str, message: str) -> None:
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        as_brush(brush)


def test_a_stamp_without_its_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"^stamp .*none.png: no such file$"):
        as_brush(f"stamp:image={tmp_path / 'none.png'}")
    Image.new("L", (8, 8), 255).save(tmp_path / "white.png")
    with pytest.raises(ImageError, match="paints nothing"):
        strokeplan.render(straight(20, 40, 100, 40), brush=Stamp(image=str(tmp_path / "white.png")))
    Image.new("1", (8000, 6000)).save(tmp_path / "huge.png")
    with pytest.raises(ImageError, match=r"^stamp .*huge.png: "):
        as_brush(f"stamp:image={tmp_path / 'huge.png'}")
