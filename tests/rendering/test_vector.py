"""PDF, PostScript and EPS: sound for other programs, still vector, and the picture that `render` paints."""

from __future__ import annotations

import io
import re
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import need_program
from numpy.typing import NDArray
from PIL import Image

from strokeplan import ExportOptions, Page, StrokePlan
from strokeplan.errors import InputError
from strokeplan.rendering import render
from strokeplan.rendering.vector import Kind, encode_vector
from strokeplan.strokes import Layer, Source

KINDS: tuple[Kind, ...] = ("pdf", "ps", "eps")
SCALE = 4
PSNR_DB = {"pdf": 44.5, "ps": 39.0, "eps": 39.0}
"""On the rings of `drawing`: Poppler paints edges nearly as Cairo does (45.1 dB), Ghostscript in its own way (39.9).
A layer that is missing, or a shift of one pixel, gives less than 30 dB."""


@pytest.fixture(scope="module")
def drawing() -> StrokePlan:
    """Rings and rays, wide and narrow, round and butt, some with pressure, on a coloured ground of 120 × 80."""
    angles = np.arange(24) * 0.9
    ends = np.stack([60 + 10 * np.cos(angles), 40 + 10 * np.sin(angles)], axis=1)
    away = np.stack([60 + 45 * np.cos(angles + 0.7), 40 + 30 * np.sin(angles + 0.7)], axis=1)
    chains = ends[:, None] + (away - ends)[:, None] * np.array([0, 0.5, 0.4, 1])[None, :, None]
    pressures = np.where(np.arange(24)[:, None] % 3, np.nan, np.array([0.2, 1.0])).ravel()
    return StrokePlan(
        width=120, height=80, points=chains.reshape(-1, 2), starts=4 * np.arange(25), widths=np.linspace(1, 9, 24),
        colors=np.random.default_rng(5).integers(0, 256, (24, 3)).astype(np.uint8),
        layers=(Layer("wide", 0, 14), Layer("fine", 14, 24, "ink", "butt")), background=(240, 230, 200),
        source=Source("rings 漢.png", "", 120, 80), pressures=pressures,
    )  # fmt: skip


def painted(data: bytes, kind: Kind, dpi: float, tmp_path: Path) -> NDArray[np.float64]:
    """The page as Poppler (PDF) or Ghostscript (PostScript) paints it."""
    path = tmp_path / f"page.{kind}"
    path.write_bytes(data)
    if kind == "pdf":
        command = [need_program("pdftoppm"), "-r", f"{dpi:g}", "-png", str(path)]
    else:
        antialias = ["-dTextAlphaBits=4", "-dGraphicsAlphaBits=4"]
        crop = ["-dEPSCrop"] if kind == "eps" else []
        command = [need_program("gs"), "-q", "-dSAFER", "-dBATCH", "-dNOPAUSE", "-sDEVICE=png16m", f"-r{dpi:g}",
                   *antialias, *crop, "-sOutputFile=-", str(path)]  # fmt: skip
    run = subprocess.run(command, capture_output=True, check=True, timeout=100)
    return np.asarray(Image.open(io.BytesIO(run.stdout)).convert("RGB"), float)


def psnr(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(10 * np.log10(255**2 / max(np.mean((a - b) ** 2), 1e-9)))


@pytest.mark.parametrize("kind", KINDS)
def test_picture_is_the_one_that_render_paints(kind: Kind, drawing: StrokePlan, tmp_path: Path) -> None:
    shown = painted(encode_vector(drawing, kind), kind, 96 * SCALE, tmp_path)
    own = render(drawing, scale=SCALE).astype(float)
    assert shown.shape == own.shape
    assert psnr(shown, own) > PSNR_DB[kind]
    assert psnr(np.roll(shown, 1, axis=1), own) < PSNR_DB[kind] - 9
    other = replace(drawing, layers=(Layer("all", 0, 24),))  # caps
    assert psnr(painted(encode_vector(other, kind), kind, 96 * SCALE, tmp_path), own) < PSNR_DB[kind] - 9


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_plan_gives_the_same_bytes_and_tells_no_time(kind: Kind, drawing: StrokePlan) -> None:
    data = encode_vector(drawing, kind)
    assert data == encode_vector(replace(drawing), kind)
    assert b"CreationDate" not in data
    assert b"ModDate" not in data


def pdf_content(data: bytes) -> bytes:
    """Every stream of a PDF that zlib unpacks."""
    return b"\n".join(
        zlib.decompress(stream) for stream in re.findall(rb"stream\r?\n(x.*?)\r?\nendstream", data, re.DOTALL)
    )


def test_a_pdf_holds_strokes_and_no_picture(drawing: StrokePlan) -> None:
    data = encode_vector(drawing, "pdf")
    assert b"/Image" not in data
    content = pdf_content(data)
    assert len(re.findall(rb"\bS\b", content)) == 16  # strokes of one width
    assert len(re.findall(rb"\bf\b", content)) == 8 + 1  # outlines, and the ground
    outlined = pdf_content(encode_vector(drawing, "pdf", ExportOptions(outline=True)))
    assert (len(re.findall(rb"\bS\b", outlined)), len(re.findall(rb"\bf\b", outlined))) == (0, 24 + 1)
    for kind in ("ps", "eps"):
        assert not re.search(rb"\bimage\b.*\bexec\b", encode_vector(drawing, kind))


def test_a_pdf_is_sound_and_has_its_title_and_page(drawing: StrokePlan, tmp_path: Path) -> None:
    path = tmp_path / "a.pdf"
    path.write_bytes(encode_vector(drawing, "pdf", ExportOptions(page=Page(297, 210, 10), clip=True)))
    run = subprocess.run([need_program("qpdf"), "--check", str(path)], capture_output=True, check=False)
    assert run.returncode == 0, run.stderr
    told = subprocess.run([need_program("pdfinfo"), str(path)], capture_output=True, check=True).stdout.decode()
    assert re.search(r"Title: +rings 漢.png", told)
    assert re.search(r"Page size: +841\.89 x 595\.27\d pts \(A4\)", told)


@pytest.mark.parametrize("clip", [False, True])
def test_only_clipped_pictures_keep_to_the_margin(clip: bool, drawing: StrokePlan, tmp_path: Path) -> None:
    far = replace(drawing, points=60 + 3 * (drawing.points - 60), pressures=None)
    page = ExportOptions(page=Page(120, 120, 20), clip=clip)  # the canvas is 80 × 53.3 mm in the middle
    shown = painted(encode_vector(far, "pdf", page), "pdf", 25.4, tmp_path)
    assert shown.shape == (120, 120, 3)
    margin = np.ones((120, 120), bool)
    margin[32:88, 19:101] = False
    assert bool((shown[margin] == 255).all()) is clip
    assert bool((shown[~margin] == 255).all()) is False


def test_an_eps_is_bounded_by_its_picture(drawing: StrokePlan) -> None:
    data = encode_vector(drawing, "eps")
    assert data.startswith(b"%!PS-Adobe-3.0 EPSF-3.0\n")
    assert b"\n%%BoundingBox: 0 0 90 60\n" in data
    assert b"\n%%Title: rings ?.png\n" in data


@pytest.mark.parametrize("name", ["a\nb) showpage (", "\x00\x1b", "%%EOF", "x" * 5000])
@pytest.mark.parametrize("kind", KINDS)
def test_no_name_breaks_out_of_its_title(kind: Kind, name: str, drawing: StrokePlan, tmp_path: Path) -> None:
    named = replace(drawing, source=Source(name, "", 1, 1))
    plain = painted(encode_vector(drawing, kind), kind, 96, tmp_path)
    np.testing.assert_array_equal(painted(encode_vector(named, kind), kind, 96, tmp_path), plain)


def test_strokes_out_of_all_bounds_do_not_wrap_around(drawing: StrokePlan, tmp_path: Path) -> None:
    points = drawing.points.copy()
    points[:8] = [(1e7, -1e7 + k) for k in range(8)]
    shown = painted(encode_vector(replace(drawing, points=points), "pdf"), "pdf", 96, tmp_path)
    rest = replace(
        drawing, points=points[8:], starts=4 * np.arange(23), widths=drawing.widths[2:], colors=drawing.colors[2:],
        layers=(Layer("", 0, 12), Layer("", 12, 22, cap="butt")), pressures=drawing.pressures[4:],
    )  # fmt: skip
    np.testing.assert_array_equal(shown, painted(encode_vector(rest, "pdf"), "pdf", 96, tmp_path))


def test_a_picture_too_thin_for_its_page_is_refused() -> None:
    line = StrokePlan(
        width=1e6, height=1e-3, points=np.empty((0, 2)), starts=np.zeros(1, np.int64), widths=np.empty(0),
        colors=np.empty((0, 3), np.uint8), layers=(),
    )  # fmt: skip
    with pytest.raises(InputError, match="too thin"):
        encode_vector(line, "pdf", ExportOptions(page=Page(210, 297)))
