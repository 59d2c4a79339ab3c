"""At which resolution a photo is planned, and that a JPEG decoded at that is the photo all the same."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray
from PIL import Image, ImageCms

import strokeplan
from strokeplan.formats import json as strokes_json
from strokeplan.image import Photo, load_photo
from strokeplan.planner import Report
from strokeplan.presets import Preset, load_preset
from strokeplan.resolution import load_for, working_copy, working_size

Pixels = NDArray[np.uint8]
TURNS: dict[int, Image.Transpose | None] = {
    1: None,
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_90,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_270,
}
"""What is done to an upright picture to store it with each of EXIF's orientations."""
ALIKE = 45.0
"""PSNR above which two pictures are the same but for how they were reduced."""


@pytest.fixture(scope="module")
def upright() -> Image.Image:
    """A sample enlarged to sides that no block of a JPEG divides."""
    with Image.open(ROOT / "samples" / "chelsea.jpg") as sample:
        return sample.convert("RGB").resize((1901, 1271), Image.Resampling.BICUBIC)


@pytest.fixture(scope="module")
def coarse() -> Preset:
    """The default preset without its finest brushes: planned at some 360 × 360."""
    fine = load_preset("fine")
    return fine.override({"layers": msgspec.to_builtins(fine)["layers"][:3]})


def stored(folder: Path, upright: Image.Image, orientation: int = 1, **options: Any) -> Path:
    """The picture as a JPEG that is turned and says so."""
    turn, exif = TURNS[orientation], Image.Exif()
    exif[0x0112] = orientation
    path = folder / "photo.jpg"
    (upright if turn is None else upright.transpose(turn)).save(path, quality=92, exif=exif, **options)
    return path


def psnr(a: Pixels, b: Pixels) -> float:
    return float(10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2)))


@pytest.mark.parametrize("orientation", TURNS)
def test_a_large_jpeg_is_decoded_at_the_size_it_is_planned_at(
    tmp_path: Path, upright: Image.Image, coarse: Preset, orientation: int
) -> None:
    path = stored(tmp_path, upright, orientation)
    drafted, whole = load_for(path, coarse), load_photo(path)
    assert (drafted.width, drafted.height) == (whole.width, whole.height) == upright.size
    assert drafted.decoded == working_size(coarse, *upright.size) < whole.decoded
    assert (drafted.name, drafted.sha256) == (whole.name, hashlib.sha256(path.read_bytes()).hexdigest())
    shown, expected = working_copy(drafted, coarse), working_copy(whole, coarse)
    assert shown.rgb is drafted.rgb
    assert (shown.width, shown.height) == (expected.width, expected.height) == drafted.decoded
    assert psnr(shown.rgb, expected.rgb) > ALIKE
    # Up to half a pixel aside would be seen.
    aside = np.asarray(Image.fromarray(whole.rgb).resize(shown.decoded, box=(2, 2, *upright.size), reducing_gap=3.0))
    assert psnr(aside, expected.rgb) < ALIKE


@pytest.mark.parametrize("mode", ["L", "CMYK"])
def test_grey_and_ink_are_decoded_smaller_too(tmp_path: Path, upright: Image.Image, coarse: Preset, mode: str) -> None:
    path = stored(tmp_path, upright.convert(mode))
    drafted = load_for(path, coarse)
    assert drafted.size == upright.size
    assert psnr(drafted.rgb, working_copy(load_photo(path), coarse).rgb) > ALIKE


def test_its_colours_are_those_of_its_profile(tmp_path: Path, upright: Image.Image, coarse: Preset) -> None:
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    # The primaries of red and blue exchanged.
    swapped = srgb.replace(b"rXYZ", b"????").replace(b"bXYZ", b"rXYZ").replace(b"????", b"bXYZ")
    path = stored(tmp_path, upright, icc_profile=swapped)
    drafted, plain = load_for(path, coarse), load_for(stored(tmp_path, upright), coarse)
    assert psnr(drafted.rgb, plain.rgb) < 30
    np.testing.assert_allclose(drafted.rgb[..., ::-1], plain.rgb, atol=2)


def test_other_photos_are_decoded_whole(tmp_path: Path, upright: Image.Image, coarse: Preset) -> None:
    small = upright.resize((700, 467))
    for name, picture, preset in (
        ("small.jpg", small, coarse),  # less than twice twice the size
        ("photo.png", upright, coarse),
        ("photo.jpg", upright, load_preset("paper")),  # lengths in pixels
    ):
        path = tmp_path / name
        picture.save(path)
        loaded = load_for(path, preset)
        assert loaded.size is None
        np.testing.assert_array_equal(loaded.rgb, load_photo(path).rgb)


def test_a_cut_jpeg_is_refused_as_ever(tmp_path: Path, upright: Image.Image, coarse: Preset) -> None:
    path = stored(tmp_path, upright)
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(strokeplan.ImageError, match=r"photo\.jpg: is damaged or cut short"):
        load_for(path, coarse)


def planned(image: Path | Photo, preset: Preset) -> tuple[strokeplan.StrokePlan, Pixels]:
    reports: list[Report] = []
    plan = strokeplan.plan(image, preset, report=reports.append)
    return plan, reports[0].canvas


def test_its_plan_is_as_near_to_the_photo(tmp_path: Path, upright: Image.Image, coarse: Preset) -> None:
    path = stored(tmp_path, upright, 6)
    (plan, canvas), (expected, other) = planned(path, coarse), planned(load_photo(path), coarse)
    assert (plan.width, plan.height, plan.source) == (expected.width, expected.height, expected.source)
    assert abs(len(plan) - len(expected)) < 0.05 * len(expected)
    shown = working_copy(load_photo(path), coarse).rgb
    assert abs(psnr(canvas, shown) - psnr(other, shown)) < 0.2
    assert strokes_json.encode(planned(load_for(path, coarse), coarse)[0]) == strokes_json.encode(plan)


def test_a_budget_decides_what_is_decoded(tmp_path: Path, upright: Image.Image) -> None:
    """Few strokes are planned much smaller than the preset: the command line and the library decode alike."""
    from typer.testing import CliRunner

    from strokeplan.cli import app

    path, out = stored(tmp_path, upright), tmp_path / "plan.json"
    plan = strokeplan.plan(path, strokes=5)
    assert (plan.width, plan.height) == upright.size
    ended = CliRunner().invoke(app, ["plan", str(path), "-o", str(out), "--strokes", "5", "-q"])
    assert ended.exit_code == 0, ended.output
    assert out.read_bytes() == strokes_json.encode(plan)
    assert strokes_json.encode(strokeplan.plan(load_photo(path), strokes=5)) != out.read_bytes()


def test_what_a_photo_is_decoded_for_is_known_without_numba() -> None:
    """The command line decodes while Numba, which takes longer, is imported."""
    code = "import sys, strokeplan.budget, strokeplan.resolution; print({'numba', 'scipy'} & set(sys.modules))"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr) == ("set()\n", "")
