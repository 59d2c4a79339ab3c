"""Picture files, sizes, regions, layers and grounds: what is asked for is what other programs find in the file."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms

from strokeplan.errors import FormatError, InputError, OutputError
from strokeplan.files import atomic_write
from strokeplan.rendering import pictures
from strokeplan.rendering.raster import job, render
from strokeplan.rendering.view import View, chosen_strokes, parse_layers, parse_region, parse_side, view
from strokeplan.strokes import Layer, StrokePlan

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".webp")


def written(plan: StrokePlan, path: Path, *, dpi: float | None = None, scale: float = 1.0, **more: Any) -> Path:
    with atomic_write(path) as stream:
        pictures.write_picture(stream, path, job(plan, view(plan, scale=scale), **more), dpi=dpi)
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_holds_the_picture_its_resolution_and_its_profile(
    suffix: str, small_plan: StrokePlan, tmp_path: Path
) -> None:
    path = written(replace(small_plan, settings={"title": "Ringe – ein Bild"}), tmp_path / f"a{suffix}", dpi=300)
    with Image.open(path) as image:
        image.load()
        error = np.abs(np.asarray(image.convert("RGB")).astype(int) - render(small_plan)).mean()
        assert error == 0 if suffix in (".png", ".tif", ".tiff") else error < 12
        dpi = image.info.get("dpi") or (image.getexif()[282], image.getexif()[283])
        assert [round(float(value)) for value in dpi] == [300, 300]
        assert "srgb" in image.info or "sRGB" in ImageCms.getProfileDescription(
            ImageCms.ImageCmsProfile(__import__("io").BytesIO(image.info["icc_profile"]))
        )
        told = image.info.get("Software") or image.getexif()[305]
        assert told.startswith("strokeplan ")
    assert "Ringe – ein Bild".encode() in path.read_bytes()
    assert written(small_plan, tmp_path / f"b{suffix}").read_bytes() == pictures.encode(small_plan, suffix)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".webp"])
def test_transparent_pictures(suffix: str, small_plan: StrokePlan, tmp_path: Path) -> None:
    few = replace(small_plan, background=(1, 2, 3))
    path = written(few, tmp_path / f"a{suffix}", background="transparent", layers=["2"])
    with Image.open(path) as image:
        assert image.mode == "RGBA"
        found = np.asarray(image)
    wanted = render(few, background="transparent", layers=[2])
    np.testing.assert_array_equal(found[..., 3], wanted[..., 3])
    assert {0, 255} <= set(np.unique(found[..., 3]))
    # Laid over a colour it is what is painted on that colour.
    alpha = wanted[..., 3:] / 255.0
    over = wanted[..., :3] * alpha + np.array([1, 2, 3]) * (1 - alpha)
    assert np.abs(over - render(few, layers=[2])).max() <= 3


def test_a_jpeg_cannot_be_transparent(small_plan: StrokePlan) -> None:
    with pytest.raises(InputError, match=r"a JPEG cannot be transparent; write \.png, \.tif or \.webp"):
        pictures.check_picture("a.jpg", view(small_plan), channels=4)


def test_limits_of_formats() -> None:
    with pytest.raises(InputError, match=r"a WebP may have 16383 pixels a side, not 20000 × 10; write a \.tif"):
        pictures.check_picture("a.webp", View(20_000, 10, 0, 0, 20_000, 10), 3)
    with pytest.raises(InputError, match=r"takes 270\.0 GB of memory"):
        pictures.check_picture("a.png", View(300_000, 300_000, 0, 0, 300_000, 300_000), 3)
    pictures.check_picture("a.tif", View(300_000, 300_000, 0, 0, 300_000, 300_000), 3)
    with pytest.raises(FormatError, match=r"unknown suffix '\.bmp' for a picture; known are \.png"):
        pictures.picture_format("a.bmp")


def test_a_tiff_wider_than_cairo_is_written_in_strips(small_plan: StrokePlan, tmp_path: Path) -> None:
    """Read back by tifffile; where a small render shows the same it is the same."""
    shown = view(small_plan, width=40_000, region=(0, 30, 96, 0.7))
    path = tmp_path / "wide.tif"
    with atomic_write(path) as stream:
        pictures.write_picture(stream, path, job(small_plan, shown))
    picture = tifffile.imread(path)
    assert picture.shape == (shown.height, 40_000, 3)
    part = render(small_plan, scale=40_000 / 96, region=(91, 30, 2, 0.7))
    left = round(91 * 40_000 / 96)
    np.testing.assert_array_equal(part, picture[:, left : left + part.shape[1]])


def test_a_picture_beyond_4_gb_is_a_bigtiff(small_plan: StrokePlan, monkeypatch: pytest.MonkeyPatch) -> None:
    assert pictures.encode(small_plan, "a.tif")[2] == 42
    monkeypatch.setattr(pictures, "BIG_TIFF_BYTES", 1000)
    assert pictures.encode(small_plan, "a.tif")[2] == 43


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
def test_a_full_disk_leaves_the_old_picture(
    suffix: str, small_plan: StrokePlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")

    def full(*_: object) -> Iterator[NDArray[np.uint8]]:
        yield np.zeros((16, 96, 3), np.uint8)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("strokeplan.rendering.raster.Job.bands", full)
    with pytest.raises(OutputError, match="No space left on device"):
        written(small_plan, path)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [(path.name, b"old")]


@pytest.mark.parametrize(
    ("text", "dpi", "pixels"),
    [("4000", None, 4000), ("4000", 300, 4000), ("297mm", 300, 3508), ("29.7cm", 300, 3508), ("2in", 150, 300),
     ("2 IN", 150, 300), ("300px", None, 300)],
)  # fmt: skip
def test_sides(text: str, dpi: float | None, pixels: int) -> None:
    assert parse_side(text, dpi) == pixels


@pytest.mark.parametrize(
    ("text", "dpi", "message"),
    [("0", None, "width 0 is no size"), ("-5mm", 300, "width -5mm is no size"), ("wide", None, "width 'wide' is no"),
     ("10mm", None, "a length on paper; say how fine"), ("1.5", None, "no whole number"), ("1e999", None, "no size")],
)  # fmt: skip
def test_sides_that_are_none(text: str, dpi: float | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_side(text, dpi)


def test_regions(small_plan: StrokePlan) -> None:
    assert parse_region("25%,50%,50%,25%", small_plan) == (24, 32, 48, 16)
    assert parse_region("1, 2, 3,4", small_plan) == (1, 2, 3, 4)
    assert render(small_plan, width=200, region=(10, 10, 40, 20)).shape == (100, 200, 3)
    assert render(small_plan, region=(-10, -10, 20, 30)).shape == (20, 10, 3)
    with pytest.raises(InputError, match="region 96,0,5,5 lies outside the canvas, which is 96 × 64"):
        view(small_plan, region=(96, 0, 5, 5))
    with pytest.raises(InputError, match="give x, y and a width and height above 0"):
        view(small_plan, region=(0, 0, 0, 5))
    for wrong in ("1,2,3", "a,b,c,d", ""):
        with pytest.raises(InputError, match="is not X,Y,WIDTH,HEIGHT"):
            parse_region(wrong, small_plan)
    with pytest.raises(InputError, match="at this size the whole canvas would have"):
        view(small_plan, width=100_000, region=(0, 0, 0.01, 0.01))


def test_layers(small_plan: StrokePlan) -> None:
    n = len(small_plan)
    assert n > 30
    layers = (Layer("base", 0, 10), Layer("2", 10, 20), Layer("eyes", 20, n))
    plan = replace(small_plan, layers=layers)
    assert chosen_strokes(plan, ["eyes", 1]).tolist() == [*range(10), *range(20, n)]
    assert chosen_strokes(plan, parse_layers("2-3")).tolist() == list(range(10, n))
    assert chosen_strokes(plan, ["2", "base"]).tolist() == list(range(20))
    for wrong in ("4", "0", "nose", "3-2", "2-9"):
        with pytest.raises(InputError, match=f"no layer '{wrong}' in the plan; it has 3: base, 2, eyes"):
            chosen_strokes(plan, [wrong])


def test_a_picture_as_background_covers_the_canvas(small_plan: StrokePlan, tmp_path: Path) -> None:
    halves = np.zeros((10, 40, 3), np.uint8)
    halves[:, 20:] = 200
    Image.fromarray(halves).save(tmp_path / "halves.png")
    bare = replace(small_plan, layers=(Layer("none", 0, 0), Layer("all", 0, len(small_plan))))
    picture = render(bare, scale=4, background=tmp_path / "halves.png", layers=["none"])
    assert picture.shape == (256, 384, 3)
    assert np.all(picture[:, :176] == 0)
    assert np.all(picture[:, 208:] == 200)
    part = render(bare, scale=4, background=tmp_path / "halves.png", layers=["none"], region=(40, 20, 20, 20))
    np.testing.assert_array_equal(part, picture[80:160, 160:240])
    for wrong, message in (("sky", "is no colour; try"), ("#12345", "is no colour"), ("none.png", "no such file")):
        with pytest.raises(InputError, match=message):
            render(bare, background=wrong)
