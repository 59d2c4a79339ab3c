"""strokeplan preview: what it writes, what it says, and how it ends."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image
from random_plans import random_plan

from strokeplan import formats
from strokeplan.cli import main
from strokeplan.preview import encode

Cli = Callable[..., tuple[int, str, str]]


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Run the command line in this process: exit code, stdout, stderr."""
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)  # Typer sets its own

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["strokeplan", "preview", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, captured.out, captured.err

    return run


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "plan.json"
    random_plan(40).save(path)
    return path


def test_page_and_time_lapse_are_written_and_named(cli: Cli, plan: Path, tmp_path: Path) -> None:
    page, video = tmp_path / "page.html", tmp_path / "video.GIF"
    code, out, err = cli(plan, "-o", page, "--video", video, "--seconds", "1", "--fps", "4", "--width", "90")
    assert (code, err) == (0, "")
    assert out.startswith(f"wrote {page} (")
    assert f", {video} (" in out
    assert page.read_bytes() == encode(formats.load(plan))
    with Image.open(video) as file:
        assert (file.format, file.n_frames, file.size) == ("GIF", 4, (90, 60))


def test_quiet_says_nothing(cli: Cli, plan: Path, tmp_path: Path) -> None:
    assert cli(plan, "-q", "--video", tmp_path / "a.webp", "--seconds", "0.2") == (0, "", "")


@pytest.mark.parametrize("found", [True, False])
def test_open_shows_the_page(
    found: bool, cli: Cli, plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or found)
    page = tmp_path / "a page.html"
    code, _, err = cli(plan, "-o", page, "--open")
    assert (code, opened) == (0, [page.as_uri()])
    assert err == ("" if found else f"note: no browser was found; open {page} in one\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "nothing to write; give -o OUT.html for the page or --video OUT.gif for the time lapse"),
        (("--open", "--video", "a.gif"), "--open has no page to open; give -o OUT.html"),
        (("-o", "a.svg"), "a.svg: unknown suffix '.svg' for a page; known is .html"),
        (("--video", "a.mp4"), "a.mp4: unknown suffix '.mp4' for a time lapse; known are .gif and .webp"),
        (("-o", "no/a.html"), "no/a.html: the folder no does not exist"),
        (("-o", "a.html", "--scale", "0.5"), "scale is for machines: give --profile"),
        (("--video", "a.gif", "--fps", "99"), "fps 99 is no frame rate; give more than 0 and at most 50"),
    ],
)
def test_what_cannot_be_is_one_line_and_no_file(
    arguments: tuple[str, ...], said: str, cli: Cli, plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli(plan, *arguments) == (2, "", f"error: {said}\n")
    assert list(tmp_path.iterdir()) == [plan]


def test_a_plan_of_another_kind_is_refused(cli: Cli, tmp_path: Path) -> None:
    other = tmp_path / "photo.txt"
    other.write_text("no plan")
    code, _, err = cli(other, "-o", tmp_path / "page.html")
    assert code == 2
    assert err.startswith(f"error: {other}: ")
    assert not (tmp_path / "page.html").exists()


def test_the_plan_itself_is_never_overwritten(cli: Cli, plan: Path, tmp_path: Path) -> None:
    link = tmp_path / "page.html"
    link.symlink_to(plan)
    before = plan.read_bytes()
    assert cli(plan, "-o", link)[0] == 2
    assert plan.read_bytes() == before


def test_a_time_lapse_without_pycairo_says_how_to_get_it(
    cli: Cli, plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cairo", None)
    code, _, err = cli(plan, "--video", tmp_path / "a.gif")
    assert code == 2
    assert "pip install 'strokeplan[raster]'" in err
    assert cli(plan, "-o", tmp_path / "page.html")[0] == 0
