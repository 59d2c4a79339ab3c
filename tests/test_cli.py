"""The command line: what it writes, what it says, and how it ends.

Most tests call `main` in this process; what depends on a fresh interpreter, a signal or a terminal runs
the command as a user does.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import pty
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import heard
from numpy.typing import NDArray
from PIL import Image

import strokeplan
from strokeplan.cli import main
from strokeplan.errors import ImageError
from strokeplan.evaluate import COLUMNS
from strokeplan.presets import names

COMMANDS = ("plan", "render", "export", "info", "evaluate", "inspect", "inkscape", "montage", "presets", "preview")
FORMATS = (".json", ".json.gz", ".svg", ".svgz", ".png")
PAPER = ("--preset", "paper")
TINY = (*PAPER, "--set", "layers.1.width=16", "--set", "layers.1.sigma=3")
"""Settings of the paper's preset that leave more than one stroke in the first layer of a tiny picture."""


@dataclass(frozen=True)
class Ended:
    """How a run of the command ended."""

    code: int
    out: str
    err: str

    @property
    def complaints(self) -> list[str]:
        """The lines on stderr that are no notes."""
        return [line for line in self.err.splitlines() if not line.startswith(("note: ", "compiling "))]


Cli = Callable[..., Ended]


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Run the command line in this process."""
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)  # Typer sets its own

    def run(*arguments: str | Path) -> Ended:
        monkeypatch.setattr(sys, "argv", ["strokeplan", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return Ended(ended.value.code, captured.out, captured.err)

    return run


def command(*arguments: str | Path, folder: Path, start: tuple[str, ...] = ("-m", "strokeplan")) -> Ended:
    """Run the command line as a process of its own, in `folder`."""
    run = subprocess.run(
        [sys.executable, *start, *map(str, arguments)], cwd=folder, capture_output=True, text=True, timeout=120
    )
    return Ended(run.returncode, run.stdout, run.stderr)


def png(pixels: NDArray[np.uint8]) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def jpeg(pixels: NDArray[np.uint8]) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG")
    return stream.getvalue()


def bomb() -> bytes:
    """A PNG whose header claims 60000 × 60000 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


def contents(folder: Path) -> dict[str, bytes | None]:
    """What is in a folder, hidden files too: name → bytes, None for folders."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture(scope="session")
def picture() -> NDArray[np.uint8]:
    """48 × 32 pixels: rings over a gradient."""
    y, x = np.mgrid[:32, :48].astype(float)
    channels = (128 + 100 * np.sin(np.hypot(x - 20, y - 15) / 3), 5 * x, 255 - 7 * y)
    return np.clip(np.stack(channels, axis=-1), 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def strokes(picture: NDArray[np.uint8], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The strokes file of the picture, decoded."""
    path = tmp_path_factory.mktemp("strokes") / "plan.json"
    strokeplan.plan(picture, "paper", seed=1).save(path)
    document: dict[str, Any] = json.loads(path.read_bytes())
    return document


@pytest.fixture
def folder(tmp_path: Path, picture: NDArray[np.uint8], strokes: dict[str, Any]) -> Path:
    """A folder with a photo and a strokes file, in which the test works."""
    (tmp_path / "photo.png").write_bytes(png(picture))
    (tmp_path / "plan.json").write_text(json.dumps(strokes), encoding="utf-8")
    return tmp_path


@pytest.fixture
def refused(cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Run a command that must end with exit code 2 and one line that has all the words, and write nothing."""
    monkeypatch.chdir(folder)

    def run(arguments: tuple[str, ...], *words: str) -> None:
        before = contents(folder)
        ended = cli(*arguments)
        assert ended.code == 2, ended
        assert len(ended.complaints) == 1, ended
        assert ended.complaints[0].startswith("error: ")
        for word in words:
            assert word in ended.complaints[0]
        assert ended.out == ""
        assert contents(folder) == before

    return run


Refused = Callable[..., None]


# What it writes


@pytest.fixture(scope="session")
def planned(tmp_path_factory: pytest.TempPathFactory, picture: NDArray[np.uint8]) -> tuple[Path, Ended]:
    """A plan in all formats, by the command as a user runs it, and how that run ended."""
    folder = tmp_path_factory.mktemp("planned")
    (folder / "photo.png").write_bytes(png(picture))
    outputs = [argument for suffix in FORMATS for argument in ("-o", f"out{suffix}")]
    return folder, command("plan", "photo.png", *outputs, *TINY, "--seed", "3", "--threads", "2", folder=folder)


def test_plan_writes_all_formats_in_one_go(planned: tuple[Path, Ended]) -> None:
    folder, ended = planned
    assert ended.code == 0, ended
    assert ended.complaints == []
    assert sorted(path.name for path in folder.iterdir()) == sorted(["photo.png", *(f"out{x}" for x in FORMATS)])
    document = json.loads((folder / "out.json").read_bytes())
    assert document["source"]["name"] == "photo.png"
    assert document["settings"]["preset"]["layers"][0]["width"] == 16
    assert sum(len(layer["strokes"]) for layer in document["layers"]) > 20
    assert gzip.decompress((folder / "out.json.gz").read_bytes()) == (folder / "out.json").read_bytes()
    assert gzip.decompress((folder / "out.svgz").read_bytes()) == (folder / "out.svg").read_bytes()
    assert ElementTree.parse(folder / "out.svg").getroot().get("viewBox") == "0 0 48 32"  # noqa: S314 (our own file)
    with Image.open(folder / "out.png") as image:
        assert image.size == (48, 32)


def test_plan_says_what_it_made(planned: tuple[Path, Ended]) -> None:
    folder, ended = planned
    document = json.loads((folder / "out.json").read_bytes())
    first, _, last = ended.out.splitlines()
    assert first.startswith(f"{sum(len(layer['strokes']) for layer in document['layers'])} strokes (")
    assert last.startswith("wrote out.json (")
    assert last.count("kB") == len(FORMATS)


@pytest.mark.parametrize("threads", ["1", "2", "4"])
def test_outputs_are_the_same_bytes_for_any_number_of_threads_and_across_runs(
    cli: Cli, planned: tuple[Path, Ended], tmp_path: Path, threads: str
) -> None:
    before = planned[0]
    outputs = [argument for suffix in FORMATS for argument in ("-o", str(tmp_path / f"out{suffix}"))]
    ended = cli("plan", before / "photo.png", *outputs, *TINY, "--seed", "3", "--threads", threads)
    assert ended.code == 0, ended
    for suffix in FORMATS:
        assert (tmp_path / f"out{suffix}").read_bytes() == (before / f"out{suffix}").read_bytes(), suffix


def test_another_seed_gives_other_strokes(cli: Cli, planned: tuple[Path, Ended], tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert cli("plan", planned[0] / "photo.png", "-o", out, *TINY, "--seed", "4").code == 0
    ours, theirs = (json.loads(path.read_bytes())["layers"] for path in (out, planned[0] / "out.json"))
    assert ours != theirs


def test_quiet_says_nothing(cli: Cli, folder: Path) -> None:
    ended = cli("plan", folder / "photo.png", "-o", folder / "out.svg", "--quiet")
    assert (ended.code, ended.out, ended.complaints) == (0, "", [])


def test_orientation_and_preset_options_reach_the_plan(cli: Cli, folder: Path) -> None:
    (folder / "mine.toml").write_text(
        "[[layers]]\nsigma = 1\nlength = 20\nwidth = 5\ncolor_threshold = 50\n", encoding="utf-8"
    )
    options = ("--preset", folder / "mine.toml", "--orientation", "gradient", "--set", "cap=butt")
    assert cli("plan", folder / "photo.png", "-o", folder / "out.json", *options).code == 0
    document = json.loads((folder / "out.json").read_bytes())
    preset = document["settings"]["preset"]
    assert (preset["name"], preset["orientation"], preset["cap"]) == ("mine", "gradient", "butt")
    assert [layer["cap"] for layer in document["layers"]] == ["butt"]


def test_budget_palette_and_mask_reach_the_plan(cli: Cli, folder: Path) -> None:
    (folder / "mask.png").write_bytes(
        png(np.repeat(np.repeat([[[255], [0]]], 24, 1), 32, 0).repeat(3, 2).astype(np.uint8))
    )
    options = ("--strokes", "40", "--palette", "#102030,#e0d0c0", "--mask", folder / "mask.png")
    assert cli("plan", folder / "photo.png", "-o", folder / "out.json", *options).code == 0
    plan = strokeplan.load(folder / "out.json")
    assert 10 < len(plan) <= 40
    assert plan.settings["strokes"] == 40
    assert {tuple(colour) for colour in plan.colors.tolist()} == {(0x10, 0x20, 0x30), (0xE0, 0xD0, 0xC0)}
    bold, minute = folder / "bold.json", folder / "minute.json"
    for path, detail in ((bold, "0"), (minute, "1")):
        assert cli("plan", folder / "photo.png", "-o", path, "--detail", detail).code == 0
    assert len(strokeplan.load(minute)) > 1.5 * len(strokeplan.load(bold))


def test_render_paints_a_picture_of_any_size(cli: Cli, folder: Path) -> None:
    for option, value, size in (("--width", "96", (96, 64)), ("--height", "16", (24, 16)), ("--scale", "3", (144, 96))):
        ended = cli("render", folder / "plan.json", "-o", folder / "out.png", option, value)
        assert ended.code == 0, ended
        assert f"{size[0]} × {size[1]} pixels" in ended.out
        with Image.open(folder / "out.png") as image:
            assert image.size == size


def test_export_writes_other_formats(cli: Cli, folder: Path) -> None:
    outputs = [argument for suffix in FORMATS for argument in ("-o", folder / f"out{suffix}")]
    ended = cli("export", folder / "plan.json", *outputs)
    assert (ended.code, ended.complaints) == (0, [])
    again = cli("export", folder / "out.json.gz", "-o", folder / "again.json")
    assert again.code == 0, again
    assert (folder / "again.json").read_bytes() == (folder / "out.json").read_bytes()


def test_export_takes_a_page_and_what_else_its_formats_know(cli: Cli, folder: Path) -> None:
    outputs = [argument for suffix in (".svg", ".svgz") for argument in ("-o", folder / f"page{suffix}")]
    page = ("--page", "A5", "--landscape", "--margin", "1cm")
    more = ("--group-by", "colour", "--classes", "--outline", "--clip", "--precision", "2", "--units", "mm")
    ended = cli("export", folder / "plan.json", *outputs, *page, *more)
    assert (ended.code, ended.complaints) == (0, [])
    text = (folder / "page.svg").read_text()
    assert 'width="210mm"' in text
    assert 'class="f0"' in text
    assert 'clip-path="url(#canvas)"' in text
    ended = cli(
        "export", folder / "plan.json", "-o", folder / "a.pdf", "-o", folder / "a.eps", "-o", folder / "a.ps", *page
    )
    assert (ended.code, ended.complaints) == (0, [])
    assert (folder / "a.pdf").read_bytes().startswith(b"%PDF-1.")
    assert cli("export", folder / "plan.json", "-o", folder / "a.dxf", "--outline").code == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--page", "A9"), ("page 'A9'", "A4")),
        (("--page", "0x0mm"), ("0 × 0 mm",)),
        (("--margin", "3"), ("margin needs a page",)),
        (("--page", "A4", "--margin", "200"), ("margin 200 mm",)),
        (("--precision", "7"), ("precision 7", "0..6")),
        (("--group-by", "pen"), ("names a pen",)),
        (("-o", "old.pdf", "--classes"), ("old.pdf", "no option classes", ".svg, .svgz")),
        (("-o", "old.json", "--page", "A4"), ("old.json", "no option page", ".pdf")),
    ],
)
def test_options_that_cannot_be_met_are_refused(
    refused: Refused, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    refused(("export", "plan.json", "-o", "old.svg", *options), *words)


def test_a_plan_is_made_again_from_its_own_svg(cli: Cli, folder: Path) -> None:
    made = ("--set", "layers.1.width=9", "--seed", "5", "--palette", "3", "--preset", "paper")
    assert cli("plan", folder / "photo.png", "-o", folder / "first.svg", *made).code == 0
    ended = cli("plan", folder / "photo.png", "-o", folder / "again.svg", "--preset", folder / "first.svg")
    assert (ended.code, ended.complaints) == (0, [])
    assert (folder / "again.svg").read_bytes() == (folder / "first.svg").read_bytes()


def test_info_says_what_is_in_a_file(cli: Cli, folder: Path, strokes: dict[str, Any]) -> None:
    ended = cli("info", folder / "plan.json")
    assert ended.code == 0, ended
    assert "48 × 32" in ended.out
    for layer in strokes["layers"]:
        assert f"layer {layer['name']}     {len(layer['strokes'])} strokes" in ended.out
    assert "preset paper, seed 1" in ended.out


def test_evaluate_gives_its_figures(cli: Cli, planned: tuple[Path, Ended]) -> None:
    plan, photo = planned[0] / "out.json", planned[0] / "photo.png"
    ended = cli("evaluate", plan, photo)
    assert (ended.code, ended.err) == (0, "")
    shown = {line[:13].strip(): line[13:].split()[0] for line in ended.out.splitlines()}
    assert list(shown) == [heading for heading, _ in COLUMNS.values()]
    assert 5 < float(shown["PSNR"]) < 50
    assert 0 < float(shown["SSIM"]) < 1
    assert 0 < float(shown["RGB distance"]) < 200
    told = json.loads(cli("evaluate", plan, photo, "--json").out)
    assert list(told) == list(COLUMNS)
    assert told["psnr_db"] == pytest.approx(float(shown["PSNR"]), abs=0.005)
    assert told["strokes"] == int(shown["strokes"].replace(",", ""))
    assert told["svg_bytes"] == (planned[0] / "out.svg").stat().st_size
    assert told["svgz_bytes"] == (planned[0] / "out.svgz").stat().st_size


def test_evaluate_writes_json_that_anyone_can_read(cli: Cli, folder: Path) -> None:
    """A perfect picture of 2 × 2 pixels has an infinite PSNR and no SSIM."""
    (folder / "white.png").write_bytes(png(np.full((2, 2, 3), 255, np.uint8)))
    assert cli("plan", folder / "white.png", "-o", folder / "white.json", *PAPER).code == 0
    ended = cli("evaluate", folder / "white.json", folder / "white.png", "--json")
    told = json.loads(ended.out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert (told["psnr_db"], told["ssim"], told["rgb_8bit"], told["uncovered_percent"]) == (None, None, 0, 100)


@pytest.fixture
def photos(folder: Path, picture: NDArray[np.uint8]) -> Path:
    """A folder of two photos."""
    photos = folder / "photos"
    photos.mkdir()
    (photos / "a.png").write_bytes(png(picture))
    (photos / "b.png").write_bytes(png(picture[::-1]))
    return photos


def test_evaluate_compares_presets_on_a_set(cli: Cli, photos: Path, folder: Path) -> None:
    (folder / "mine.toml").write_text(
        "[[layers]]\nsigma = 1\nlength = 20\nwidth = 8\ncolor_threshold = 20\n", encoding="utf-8"
    )
    styles = ("--preset", "paper", "--preset", str(folder / "mine.toml"))
    ended = cli("evaluate", "--set", photos, *styles)
    assert ended.code == 0, ended
    assert [line.split(":")[0] for line in ended.complaints] == [f"{p}.png, {s}" for p in "ab" for s in styles[1::2]]
    header, *rows = ended.out.splitlines()
    assert header.split()[:3] == ["photo", "preset", "PSNR"]
    assert [row.split()[0] for row in rows] == ["a.png", "a.png", "b.png", "b.png", "mean", "mean"]
    assert len({len(row) for row in rows} | {len(header)}) == 1

    told = json.loads(cli("evaluate", "--set", photos, *styles, "--json").out)
    assert [(one["photo"], one["preset"]) for one in told["photos"]] == [
        (f"{photo}.png", style) for photo in "ab" for style in styles[1::2]
    ]
    for style in styles[1::2]:
        for name in COLUMNS:
            figures = [one[name] for one in told["photos"] if one["preset"] == style]
            assert told["means"][style][name] == pytest.approx(sum(figures) / 2)
    cli("plan", photos / "a.png", "-o", folder / "a.json", "-p", "paper")
    alone = json.loads(cli("evaluate", folder / "a.json", photos / "a.png", "--json").out)
    assert told["photos"][0] == {"photo": "a.png", "preset": "paper"} | alone


def test_evaluate_takes_all_presets_by_default(cli: Cli, photos: Path) -> None:
    told = json.loads(cli("evaluate", "--set", photos, "--json").out)
    assert list(told["means"]) == names()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("PLAN and IMAGE", "--set DIR")),
        (("plan.json",), ("PLAN and IMAGE", "--set DIR")),
        (("plan.json", "photo.png", "--set", "empty"), ("not both", "plan.json", "empty")),
        (("plan.json", "photo.png", "--preset", "paper"), ("--preset paper", "--set DIR")),
        (("--set", "empty"), ("empty: no pictures there",)),
        (("--set", "photo.png"), ("--set photo.png: is no folder",)),
        (("--set", "nowhere"), ("--set nowhere: is no folder",)),
        (("--set", "empty", "--preset", "papre"), ("'papre'", ", ".join(names()))),
    ],
    ids=lambda value: " ".join(value),
)
def test_evaluate_refuses_what_cannot_be_compared(
    refused: Refused, folder: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    (folder / "empty").mkdir()
    refused(("evaluate", *arguments), *words)


def test_inspect_draws_the_figures(cli: Cli, folder: Path) -> None:
    ended = cli("inspect", folder / "photo.png", "-o", folder / "figures", *PAPER, "--layer", "3", "--compare")
    assert ended.code == 0, ended
    assert sorted(path.name for path in (folder / "figures").iterdir()) == [
        "coherence.png", "compare.png", "orientation.png", "tract.png",
    ]  # fmt: skip


def test_inspect_draws_tracts_that_wander(cli: Cli, folder: Path) -> None:
    for options, name in ((("--wander", "0.5"), "one"), (("--set", "wander=0.5"), "two")):
        ended = cli(
            "inspect", folder / "photo.png", "-o", folder / name, *TINY, "--layer", "1", "--count", "9", *options
        )
        assert ended.code == 0, ended
    assert (folder / "one" / "spread.png").read_bytes() == (folder / "two" / "spread.png").read_bytes()
    still = cli("inspect", folder / "photo.png", "-o", folder / "three", *TINY, "--layer", "1")
    assert still.code == 0, still
    assert not (folder / "three" / "spread.png").exists()
    assert (folder / "one" / "tract.png").read_bytes() == (folder / "three" / "tract.png").read_bytes()


def test_figures_and_sheets_are_written_as_any_picture(cli: Cli, folder: Path, photos: Path) -> None:
    ended = cli("inspect", folder / "photo.png", "-o", folder / "figures", *TINY, "--layer", "1", "--format", "tif")
    assert ended.code == 0, ended
    assert sorted(path.name for path in (folder / "figures").iterdir()) == [
        "coherence.tif",
        "orientation.tif",
        "tract.tif",
    ]
    sheets = [folder / f"sheet{suffix}" for suffix in (".png", ".tif", ".jpg", ".webp")]
    for sheet in sheets:
        ended = cli("montage", photos, "-o", sheet, "--columns", "2", "--tile", "48", "--originals")
        assert ended.code == 0, ended
    kinds = {"PNG": 0.0, "TIFF": 0.0, "JPEG": 12.0, "WEBP": 12.0}
    with Image.open(sheets[0]) as image:
        wanted = np.asarray(image).astype(float)
    for sheet, (kind, bound) in zip(sheets, kinds.items(), strict=True):
        with Image.open(sheet) as image:
            assert image.format == kind
            assert np.abs(np.asarray(image.convert("RGB")) - wanted).mean() <= bound


def test_montage_makes_a_sheet_of_photos(cli: Cli, folder: Path, photos: Path, picture: NDArray[np.uint8]) -> None:
    ended = cli("montage", photos, "-o", folder / "sheet.png", "--columns", "2", "--tile", "48", "--originals")
    assert ended.code == 0, ended
    with Image.open(folder / "sheet.png") as image:
        assert image.size == (48 + 8 + 48, 32)
        np.testing.assert_array_equal(np.asarray(image)[:, :48], picture)
    ended = cli("montage", photos, "-o", folder / "strokes.png", "--tile", "48")
    assert ended.code == 0, ended
    assert [line.split(":")[0] for line in ended.complaints] == ["a.png", "b.png"]


def test_presets_lists_the_styles(cli: Cli) -> None:
    ended = cli("presets")
    assert ended.code == 0
    assert {"fine", "paper", "paper-published"} <= {line.split()[0] for line in ended.out.splitlines()}


def test_what_presets_show_prints_is_sound(cli: Cli, folder: Path) -> None:
    shown = cli("presets", "show", "paper")
    assert shown.code == 0
    (folder / "mine.toml").write_text(shown.out, encoding="utf-8")
    checked = cli("presets", "check", folder / "mine.toml")
    assert checked.code == 0, checked
    assert "sound; 4 layers of width 50, 25, 5, 2.5" in checked.out


def test_version(cli: Cli) -> None:
    assert cli("--version") == Ended(0, f"strokeplan {strokeplan.__version__}\n", "")


@pytest.mark.parametrize(
    "path", [(), *((name,) for name in COMMANDS), ("presets", "show"), ("presets", "check"), ("inkscape", "install")]
)
def test_every_command_has_help(cli: Cli, path: tuple[str, ...]) -> None:
    for flag in ("--help", "-h"):
        ended = cli(*path, flag)
        assert (ended.code, ended.err) == (0, "")
        assert " ".join(("Usage: strokeplan", *path)) in ended.out


def test_help_of_strokeplan_names_every_command(cli: Cli) -> None:
    out = cli("--help").out
    assert [name for name in COMMANDS if name not in out] == []


# Unusual pictures that must be planned


def numbers(value: Any) -> Iterator[float]:
    """Every number in a JSON document."""
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from numbers(part)
    elif isinstance(value, int | float):
        yield value


@pytest.mark.parametrize("level", [0, 77, 255])
def test_a_picture_of_one_colour_gives_a_plan_without_nan(cli: Cli, folder: Path, level: int) -> None:
    """Nothing has a direction there, so no stroke is laid, and the plan says so."""
    (folder / "flat.png").write_bytes(png(np.full((20, 30, 3), level, np.uint8)))
    outputs = [argument for suffix in FORMATS for argument in ("-o", folder / f"flat-out{suffix}")]
    ended = cli("plan", folder / "flat.png", *outputs, *PAPER)
    assert ended.code == 0, ended
    assert ended.out.startswith("0 strokes (0 + 0 + 0 + 0)")
    assert "nan" not in ended.out
    document = json.loads((folder / "flat-out.json").read_bytes())
    assert [layer["strokes"] for layer in document["layers"]] == [[], [], [], []]
    assert np.isfinite(list(numbers(document))).all()
    with Image.open(folder / "flat-out.png") as image:
        assert np.asarray(image).min() == 255
    for arguments in (("info", "flat-out.json"), ("evaluate", "flat-out.json", "flat.png")):
        ended = cli(arguments[0], *(folder / name for name in arguments[1:]))
        assert (ended.code, ended.complaints) == (0, [])
        assert "nan" not in ended.out


def test_a_very_narrow_picture_is_planned(cli: Cli, folder: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (2000, 3, 3), np.uint8)
    (folder / "narrow.png").write_bytes(png(pixels))
    ended = cli("plan", folder / "narrow.png", "-o", folder / "out.json", "-o", folder / "out.svg", *PAPER)
    assert ended.code == 0, ended
    plan = strokeplan.load(folder / "out.json")
    assert (plan.width, plan.height) == (3, 2000)
    assert len(plan) > 100
    assert np.isfinite(plan.points).all()


def test_the_smallest_picture_is_planned(cli: Cli, folder: Path) -> None:
    (folder / "smallest.png").write_bytes(png(np.array([[[0] * 3, [255] * 3]] * 2, np.uint8)))
    ended = cli("plan", folder / "smallest.png", "-o", folder / "out.json", "-o", folder / "out.png")
    assert (ended.code, ended.complaints) == (0, [])


def test_a_deep_picture_is_planned_with_a_note(folder: Path) -> None:
    """In a process of its own: pytest turns warnings into errors in this one."""
    pixels = np.random.default_rng(1).integers(0, 65536, (8, 12, 3)).astype(">u2")
    (folder / "deep.ppm").write_bytes(b"P6\n12 8\n65535\n" + pixels.tobytes())
    ended = command("plan", "deep.ppm", "-o", "out.json", folder=folder)
    assert (ended.code, ended.complaints) == (0, [])
    assert "note: 16-bit colour is cut to 8 bits a channel" in ended.err.splitlines()


# Bad photos

BAD_PHOTOS: dict[str, tuple[str, bytes | None, tuple[str, ...]]] = {
    "empty": ("empty.png", b"", ("empty.png", "empty")),
    "cut short JPEG": (
        "cut.jpg",
        jpeg(np.arange(4800, dtype=np.uint8).reshape(40, 40, 3))[:-100],
        ("cut.jpg", "damaged"),
    ),
    "cut short PNG": ("cut.png", png(np.arange(4800, dtype=np.uint8).reshape(40, 40, 3))[:200], ("cut.png", "damaged")),
    "text": ("text.jpg", b"This is no picture.\n", ("text.jpg", "known are JPEG, PNG")),
    "bomb": ("bomb.png", bomb(), ("bomb.png", "3600000000", "limit is")),
    "1 x 1": ("one.png", png(np.zeros((1, 1, 3), np.uint8)), ("one.png", "1 × 1", "at least 2")),
    "missing": ("missing.png", None, ("missing.png", "no such file")),
}


@pytest.mark.parametrize("case", BAD_PHOTOS)
@pytest.mark.parametrize(
    "arguments",
    [("plan", "PHOTO", "-o", "out.svg"), ("evaluate", "plan.json", "PHOTO"), ("inspect", "PHOTO", "-o", "figures"),
     ("montage", "PHOTO", "-o", "out.png")],
    ids=lambda arguments: arguments[0],
)  # fmt: skip
def test_a_bad_photo_is_refused(refused: Refused, folder: Path, case: str, arguments: tuple[str, ...]) -> None:
    name, data, words = BAD_PHOTOS[case]
    if data is not None:
        (folder / name).write_bytes(data)
    refused(tuple(name if argument == "PHOTO" else argument for argument in arguments), *words)


def test_a_folder_is_no_photo(refused: Refused, folder: Path) -> None:
    (folder / "photos").mkdir()
    refused(("plan", "photos", "-o", "out.svg"), "photos: is a folder; give a picture file")
    refused(("evaluate", "plan.json", "photos"), "photos: is a folder")
    refused(("montage", "photos", "-o", "out.png"), "photos: no pictures there")


def test_the_plan_of_a_photo_of_another_shape_is_not_evaluated(refused: Refused, folder: Path) -> None:
    (folder / "other.png").write_bytes(png(np.zeros((30, 90, 3), np.uint8)))
    refused(("evaluate", "plan.json", "other.png"), "48 × 32", "90 × 30")


def test_another_photo_of_the_same_shape_is_evaluated_with_a_note(
    cli: Cli, planned: tuple[Path, Ended], folder: Path, picture: NDArray[np.uint8]
) -> None:
    (folder / "other.png").write_bytes(png(picture[::-1]))
    ended = cli("evaluate", planned[0] / "out.json", folder / "other.png")
    assert ended.code == 0
    assert ended.err == f"note: {planned[0] / 'out.json'} was planned from another file, photo.png\n"


# Bad outputs


@pytest.mark.parametrize("name", ["out.bmp", "out", "out.json.zip", "out.gz"])
def test_an_unknown_suffix_is_refused(refused: Refused, name: str) -> None:
    refused(("plan", "photo.png", "-o", name), name, "unknown suffix", ".json, .json.gz, .svg, .svgz, .png")
    refused(("export", "plan.json", "-o", name), name, "unknown suffix", ".svg")
    refused(("render", "plan.json", "-o", name), name, "unknown suffix", ".png")


@pytest.mark.parametrize("arguments", [("plan", "photo.png"), ("export", "plan.json"), ("render", "plan.json")])
def test_a_place_that_cannot_be_written_is_refused(refused: Refused, folder: Path, arguments: tuple[str, ...]) -> None:
    refused((*arguments, "-o", "nowhere/out.png"), "nowhere/out.png", "the folder nowhere does not exist")
    refused((*arguments, "-o", "x" * 300 + ".png"), "xxx.png", "too long")
    (folder / "taken.png").mkdir()
    refused((*arguments, "-o", "taken.png"), "taken.png: is a folder; give a file name in it")


def test_one_bad_output_of_two_writes_neither(refused: Refused) -> None:
    refused(("plan", "photo.png", "-o", "out.svg", "-o", "out.bmp"), "out.bmp")
    refused(("export", "plan.json", "-o", "out.svg", "-o", "nowhere/out.svg"), "nowhere")


def test_a_photo_is_not_painted_over(refused: Refused, folder: Path) -> None:
    refused(("plan", "photo.png", "-o", "out.svg", "-o", "photo.png"), "photo.png: is what the work starts from")
    (folder / "link.png").symlink_to("photo.png")
    refused(("plan", "photo.png", "-o", "link.png"), "link.png: is what the work starts from")


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan", "photo.png", "-o", "old.json", "--set", "coherence=2"),
        ("plan", "missing.png", "-o", "old.json"),
        ("export", "old.svg", "-o", "old.json"),
        ("render", "plan.json", "-o", "old.png", "--width", "0"),
        ("evaluate", "old.json", "photo.png"),
    ],
    ids=" ".join,
)
def test_what_stood_there_survives_a_failed_run(refused: Refused, folder: Path, arguments: tuple[str, ...]) -> None:
    for suffix in FORMATS:
        (folder / f"old{suffix}").write_bytes(b"what stood there before")
    refused(arguments)


def test_what_stood_there_survives_a_full_disk(refused: Refused, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    (folder / "out.svg").write_bytes(b"what stood there before")
    monkeypatch.setattr(Path, "replace", full)
    refused(("export", "plan.json", "-o", "out.svg"), "out.svg: cannot be written (No space left on device)")


# Bad settings


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--preset", "papre"), ("'papre'", ", ".join(names()))),
        (("--preset", "missing.toml"), ("missing.toml", "No such file")),
        (("--preset", "broken.toml"), ("broken.toml", "is not TOML")),
        (("--preset", "misspelt.toml"), ("misspelt.toml", "layers.1", "widht", "width")),
        (("--set", "coherense=0.5"), ("coherense", "unknown key", "coherence")),
        (("--set", "layers.2.widht=8"), ("layers.2.widht", "unknown key", "width")),
        (("--set", "layers.9.width=8"), ("layers.9.width", "numbered 1 to 5")),
        (("--set", "layers.0.width=8"), ("layers.0.width", "numbered 1 to 5")),
        (("--set", "coherence"), ("'coherence'", "KEY=VALUE")),
        (("--set", "coherence=1.5"), ("coherence = 1.5", "<= 1")),
        (("--set", "coherence=nan"), ("coherence = nan", ">= 0")),
        (("--set", "layers.2.width=inf"), ("layers.2.width = inf", "<= 100000")),
        (("--set", "layers.2.width=-8"), ("layers.2.width = -8", ">= 0.1")),
        (("--set", "layers.2.width=wide"), ("layers.2.width = 'wide'", "float")),
        (("--set", "cap=square"), ("cap = 'square'", "round, butt")),
        (("--seed", "-1"), ("seed -1", "0 or more")),
        (("--threads", "0"), ("threads 0", "below 1")),
        (("--threads", "-2"), ("threads -2", "below 1")),
        (("--strokes", "0"), ("strokes 0", "1..")),
        (("--detail", "1.5"), ("detail 1.5", "0..1")),
        (("--strokes", "9", "--detail", "0.5"), ("strokes 9", "detail 0.5", "give one")),
        (("--mask", "missing.png"), ("missing.png", "no such file")),
        (("--mask", "broken.toml"), ("broken.toml",)),
        (("--mask", "square.png"), ("mask", "20 × 20", "48 × 32")),
        (("--palette", "#12"), ("#12",)),
        (("--palette", "0"), ("0",)),
    ],
    ids=lambda value: "=".join(value) if isinstance(value, tuple) and value[0].startswith("--") else "",
)
def test_a_bad_setting_is_refused(
    refused: Refused, folder: Path, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    (folder / "broken.toml").write_text("layers = [", encoding="utf-8")
    (folder / "misspelt.toml").write_text("[[layers]]\nwidht = 5\n", encoding="utf-8")
    (folder / "square.png").write_bytes(png(np.zeros((20, 20, 3), np.uint8)))
    refused(("plan", "photo.png", "-o", "out.svg", *options), *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--width", "0"), ("width 0", "more than 0")),
        (("--width", "-5"), ("width -5", "more than 0")),
        (("--height", "0"), ("height 0", "more than 0")),
        (("--scale", "nan"), ("scale nan", "more than 0")),
        (("--scale", "inf"), ("scale inf", "more than 0")),
        (("--width", "48", "--height", "32"), ("width and height",)),
        (("--width", "1000000000"), ("1000000000", "300000")),
        (("--scale", "1e9"), ("300000",)),
    ],
    ids=lambda value: "=".join(value) if value[0].startswith("--") else "",
)
def test_a_bad_size_is_refused(refused: Refused, options: tuple[str, ...], words: tuple[str, ...]) -> None:
    refused(("render", "plan.json", "-o", "out.png", *options), *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("presets", "show", "papre"), ("'papre'", ", ".join(names()))),
        (("presets", "check", "missing.toml"), ("missing.toml", "No such file")),
        (("presets", "check", "photo.png"), ("photo.png",)),
        (("inspect", "photo.png", "-o", "figures", "--layer", "9"), ("layer 9", "1 to 5")),
        (("inspect", "photo.png", "-o", "figures", "--point", "1;2"), ("'1;2'", "X,Y")),
        (("inspect", "photo.png", "-o", "figures", "--point", "999,1"), ("999,1", "outside")),
        (("inspect", "photo.png", "-o", "figures", "--spacing", "nan"), ("spacing nan",)),
        (("inspect", "photo.png", "-o", "figures", "--count", "5"), ("wander 0", "up to 1")),
        (("inspect", "photo.png", "-o", "figures", "--wander", "0.5", "--count", "0"), ("count 0",)),
        (("inspect", "photo.png", "-o", "figures", "--wander", "2"), ("wander = 2", "<= 1")),
        (("montage", "photo.png", "-o", "out.png", "--columns", "0"), ("columns 0",)),
        (("montage", "photo.png", "-o", "out.png", "--tile", "0"), ("tile 0",)),
    ],
    ids=lambda value: " ".join(value),
)
def test_bad_options_of_other_commands_are_refused(
    refused: Refused, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    refused(arguments, *words)


# Bad strokes files


def damaged(change: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any]], bytes]:
    """A strokes file in which `change` has been at work."""

    def make(document: dict[str, Any]) -> bytes:
        copy = json.loads(json.dumps(document))
        changed = change(copy)
        return json.dumps(copy if changed is None else changed).encode()

    return make


def first_stroke(document: dict[str, Any]) -> dict[str, Any]:
    stroke: dict[str, Any] = document["layers"][2]["strokes"][0]
    return stroke


WIDTH, COLOR, CHAIN = (f"$.layers[2].strokes[0].{key}" for key in ("width", "color", "d"))

BAD_STROKES: dict[str, tuple[str, Callable[[dict[str, Any]], bytes] | None, tuple[str, ...]]] = {
    "missing": ("bad.json", None, ("no such file",)),
    "missing gz": ("bad.json.gz", None, ("no such file",)),
    "empty": ("bad.json", lambda _: b"", ()),
    "cut short": ("bad.json", lambda document: json.dumps(document).encode()[:-100], ()),
    "cut short gz": ("bad.json.gz", lambda document: gzip.compress(json.dumps(document).encode())[:-50], ("gzip",)),
    "no gz": ("bad.json.gz", lambda document: json.dumps(document).encode(), ("gzip",)),
    "newer version": ("bad.json", damaged(lambda d: d.update(version=2)), ("version 2", "up to version 1")),
    "another format": ("bad.json", damaged(lambda d: d.update(format="geojson")), ("'geojson'",)),
    "another file": ("bad.json", damaged(lambda _: {"name": "package", "version": 1}), ("not a strokes file",)),
    "a list": ("bad.json", damaged(lambda _: [1, 2]), ()),
    "a photo": ("bad.json", lambda _: png(np.zeros((4, 4, 3), np.uint8)), ()),
    "no strokes file by its suffix": ("bad.txt", lambda _: b"text", (".json, .json.gz",)),
    "wrong type": ("bad.json", damaged(lambda d: first_stroke(d).update(width="5")), (WIDTH, "float")),
    "unknown field": ("bad.json", damaged(lambda d: first_stroke(d).update(colour="red")), ("`colour`", "$.layers[2]")),
    "negative width": ("bad.json", damaged(lambda d: first_stroke(d).update(width=-1)), (WIDTH,)),
    "bad colour": ("bad.json", damaged(lambda d: first_stroke(d).update(color="red")), (COLOR,)),
    "NaN": ("bad.json", damaged(lambda d: first_stroke(d)["d"].__setitem__(3, float("nan"))), ()),
    "infinity": ("bad.json", lambda d: json.dumps(d).replace('"d": [', '"d": [1e999, ').encode(), ()),
    "1e9": ("bad.json", damaged(lambda d: first_stroke(d)["d"].__setitem__(3, 1e9)), (CHAIN,)),
    "odd": ("bad.json", damaged(lambda d: first_stroke(d)["d"].append(1.0)), (CHAIN, "2 + 6k")),
    "canvas without width": ("bad.json", damaged(lambda d: d["canvas"].update(width=None)), ("$.canvas.width",)),
    "deeply nested": ("bad.json", lambda _: b'{"settings":' + b"[" * 100_000, ()),
    "not UTF-8": ("bad.json", lambda _: b'{"format":"\xff"}', ()),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_STROKES)
@pytest.mark.parametrize(
    "arguments",
    [("info", "PLAN"), ("render", "PLAN", "-o", "out.png"), ("export", "PLAN", "-o", "out.svg"),
     ("evaluate", "PLAN", "photo.png")],
    ids=lambda arguments: arguments[0],
)  # fmt: skip
def test_a_bad_strokes_file_is_refused(
    refused: Refused, folder: Path, strokes: dict[str, Any], case: str, arguments: tuple[str, ...]
) -> None:
    name, make, words = BAD_STROKES[case]
    if make is not None:
        (folder / name).write_bytes(make(strokes))
    refused(tuple(name if argument == "PLAN" else argument for argument in arguments), name, *words)


def test_a_folder_is_no_strokes_file(refused: Refused, folder: Path) -> None:
    (folder / "plans.json").mkdir()
    refused(("info", "plans.json"), "plans.json: is a folder")


# Errors of usage


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("plan",), ("Usage: strokeplan plan", "Missing argument", "IMAGE")),
        (("plan", "photo.png"), ("Missing option", "--output")),
        (("plan", "photo.png", "-o", "out.svg", "--bogus"), ("No such option", "--bogus")),
        (("plan", "photo.png", "-o", "out.svg", "--seed", "many"), ("--seed", "valid int")),
        (("plan", "photo.png", "-o", "out.svg", "--orientation", "up"), ("--orientation", "'up'", "tensor")),
        (("plan", "photo.png", "-o", "out.svg", "--seed"), ("--seed", "requires an argument")),
        (("plan", "photo.png", "another.png", "-o", "out.svg"), ("another.png",)),
        (("render", "plan.json", "-o", "out.png", "--scale", "big"), ("--scale", "valid")),
        (("bogus",), ("No such command", "bogus")),
        (("presets", "bogus"), ("No such command", "bogus")),
        (("--bogus",), ("No such option", "--bogus")),
    ],
    ids=lambda value: " ".join(value),
)
def test_an_error_of_usage_is_told_with_exit_code_2(
    cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(folder)
    before = contents(folder)
    ended = cli(*arguments)
    assert ended.code == 2
    assert ended.out == ""
    text = " ".join(ended.err.replace("│", " ").split())
    assert "Error" in text
    for word in words:
        assert word in text
    assert contents(folder) == before


def test_without_arguments_it_shows_its_help(cli: Cli) -> None:
    ended = cli()
    assert ended.code in (0, 2)  # by the version of Typer
    assert "Usage: strokeplan" in ended.out


# How it runs as a process


def test_a_bad_input_ends_the_process_with_one_line(folder: Path) -> None:
    before = contents(folder)
    ended = command("plan", "missing.jpg", "-o", "out.svg", folder=folder)
    assert (ended.code, ended.out, ended.complaints) == (2, "", ["error: missing.jpg: no such file"])
    assert contents(folder) == before


def test_an_error_of_usage_ends_the_process_without_a_traceback(folder: Path) -> None:
    ended = command("plan", "--bogus", folder=folder)
    assert ended.code == 2
    assert "No such option: --bogus" in ended.err
    assert "Traceback" not in ended.err


def test_the_installed_command_is_the_same(folder: Path) -> None:
    installed = Path(sys.executable).with_name("strokeplan")
    if not installed.exists():
        pytest.skip("the strokeplan command is not installed beside this Python")
    run = subprocess.run([installed, "--version"], cwd=folder, capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stdout, run.stderr) == (0, f"strokeplan {strokeplan.__version__}\n", "")


def test_debug_shows_where_an_error_comes_from(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["strokeplan", "--debug", "plan", "missing.jpg", "-o", "out.svg"])
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    with pytest.raises(ImageError, match=r"missing\.jpg: no such file"):
        main()


@pytest.mark.parametrize("arguments", [("--help",), ("plan", "--help"), ("--version",), ("presets", "--help")])
def test_help_loads_nothing_heavy(folder: Path, arguments: tuple[str, ...]) -> None:
    ended = command("-X", "importtime", "-m", "strokeplan", *arguments, folder=folder, start=())
    assert ended.code == 0
    loaded = {line.rpartition("|")[2].strip().partition(".")[0] for line in ended.err.splitlines()}
    assert "typer" in loaded
    assert loaded & {"numpy", "numba", "scipy", "PIL", "skimage", "msgspec", "cairo"} == set()


WITHOUT_CAIRO = """
import sys
sys.modules["cairo"] = None
from strokeplan.cli import main
for output in sys.argv[1:]:
    sys.argv = ["strokeplan", "plan", "photo.png", "--quiet", "-o", output]
    try:
        main()
    except SystemExit as ended:
        print(output, ended.code)
"""


def test_without_pycairo_only_pictures_are_refused(folder: Path) -> None:
    ended = command("out.png", "out.json", "out.svg", folder=folder, start=("-c", WITHOUT_CAIRO))
    assert ended.out.splitlines() == ["out.png 2", "out.json 0", "out.svg 0"]
    assert len(ended.complaints) == 1
    assert ended.complaints[0].startswith("error: ")
    assert "pip install 'strokeplan[raster]'" in ended.complaints[0]
    assert set(contents(folder)) == {"photo.png", "plan.json", "out.json", "out.svg"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--width", "1.5"), "--width 1.5 is no whole number of pixels; try 2"),
        (("--width", "297mm"), "say how fine it is printed"),
        (("--width", "0"), "--width 0 is no size"),
        (("--brush", "bristle:hairs=0"), "hairs=0"),
        (("--region", "999,999,5,5"), "lies outside the canvas"),
        (("--layers", "nose"), "no layer 'nose'"),
        (("--background", "sky"), "background 'sky' is no colour"),
        (("--dpi", "0"), "dpi 0 is no resolution"),
    ],
)
def test_a_picture_that_makes_no_sense_is_refused(
    refused: Refused, folder: Path, options: tuple[str, str], words: str
) -> None:
    refused(("render", "plan.json", "-o", "out.png", *options), words)


def test_a_picture_that_its_format_cannot_hold_is_refused_before_the_work(refused: Refused, folder: Path) -> None:
    Image.fromarray(np.zeros((3, 20_000, 3), np.uint8)).save(folder / "long.png")
    refused(("plan", "long.png", "-o", "long.json", "-o", "long.webp"), "16383 pixels a side, not 20000 × 3")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("inspect", "photo.png", "-o", "photo.png"), "is a file; give a folder"),
        (("inspect", "photo.png", "-o", "figures", "--format", "bmp"), "--format .bmp is no picture's; known are .png"),
        (("montage", "photo.png", "-o", "sheet.svg"), "for a picture; known are .png, .tif"),
        (("montage", "photo.png", "-o", "photo.png"), "is what the work starts from"),
        (("montage", "photo.png", "-o", "sheet.png", "--columns", "0"), "columns 0"),
        (("montage", "photo.png", "-o", "sheet.png", "--tile", "0"), "tile 0"),
        (("inspect", "photo.png", "-o", "figures", "--layer", "9"), "there is no layer 9"),
        (("inspect", "photo.png", "-o", "figures", "--point", "a,b"), "is not X,Y"),
        (("inspect", "photo.png", "-o", "figures", "--point", "9999,0"), "outside the photo"),
    ],
)
def test_figures_that_cannot_be_drawn_are_refused(refused: Refused, arguments: tuple[str, ...], words: str) -> None:
    refused(arguments, words)


@pytest.mark.parametrize("options", [(), ("--strokes", "5000"), ("--strokes", "50"), PAPER])
def test_at_a_terminal_a_run_shows_its_progress_and_ends_well(folder: Path, options: tuple[str, ...]) -> None:
    ours, theirs = pty.openpty()
    start = [sys.executable, "-m", "strokeplan", "plan", "photo.png", "-o", "out.json", *options]
    with subprocess.Popen(start, cwd=folder, stdout=theirs, stderr=theirs) as run:
        os.close(theirs)
        shown = b""
        while said := heard(ours):
            shown += said
        os.close(ours)
    assert run.returncode == 0, shown.decode()
    assert b"layer " in shown
    assert b"wrote out.json" in shown
    assert b"error:" not in shown


# Python ignores Ctrl-C where its parent does, as shells have it for jobs in the background.
LISTENING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
CALL = "from strokeplan.cli import main; main()"


@pytest.mark.parametrize(
    ("preset", "sign", "patience_s", "cold"),
    [
        ("paper", "layer ", 0, False),
        ("fine", "layer ", 0, False),
        ("engraving", "drawing", 0.5, False),
        ("fine", "compiling the kernels", 2, True),
    ],
)
def test_ctrl_c_ends_a_run_at_once_and_leaves_no_file(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, preset: str, sign: str, patience_s: float, cold: bool
) -> None:
    """At a terminal, with the progress bar under way; and while the kernels are compiled for the first time."""
    pixels = np.random.default_rng(1).integers(0, 256, (4000, 5000, 3), np.uint8)
    (folder / "large.ppm").write_bytes(b"P6\n5000 4000\n255\n" + pixels.tobytes())
    before = set(contents(folder))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("cache"))} if cold else None
    ours, theirs = pty.openpty()
    outputs = ["-o", "out.json", "-o", "out.png"]
    start = [sys.executable, "-c", LISTENING + CALL, "plan", "large.ppm", *outputs, "--preset", preset]
    with subprocess.Popen(start, cwd=folder, stdout=subprocess.PIPE, stderr=theirs, env=environment) as run:
        try:
            os.close(theirs)
            shown = b""
            while sign.encode() not in shown:
                said = heard(ours)
                assert said, f"the command ended: {shown.decode()}"
                shown += said
            time.sleep(patience_s)
            run.send_signal(signal.SIGINT)
            code = run.wait(timeout=60)  # a run that goes on ends with 0 and its files
            while more := heard(ours):
                shown += more
            out, _ = run.communicate()
        finally:
            run.kill()
            os.close(ours)
    assert (code, out) == (130, b"")
    assert shown.decode().splitlines()[-1].endswith("error: interrupted; no file was left half written")
    assert b"Traceback" not in shown
    assert set(contents(folder)) == before
