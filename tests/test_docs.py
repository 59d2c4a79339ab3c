"""Documents stay true: what they name exists, what exists is named, and their figures are the measured ones."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import msgspec
import pytest
from conftest import ROOT
from PIL import Image

from strokeplan.cli import app
from strokeplan.presets import load_preset, names, style

README = (ROOT / "README.md").read_text()
PAGES = [*sorted(ROOT.glob("docs/*.md")), ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "samples" / "README.md"]


def commands() -> set[str]:
    found = {command.name for command in app.registered_commands} | {group.name for group in app.registered_groups}
    return {name for name in found if name}


def test_readme_names_every_command_and_no_other() -> None:
    rows = set(re.findall(r"^\| `strokeplan (\w+)", README, flags=re.MULTILINE))
    assert rows == commands()
    assert set(re.findall(r"strokeplan (\w+) ", " ".join(re.findall(r"`([^`\n]+)`", README)))) <= commands()


def test_readme_names_every_preset() -> None:
    for name in names():
        assert f"- `{name}`:" in README


@pytest.mark.parametrize("name", names())
def test_every_preset_has_its_sample_and_description_on_the_page_of_styles(name: str) -> None:
    page = (ROOT / "docs" / "styles.md").read_text()
    assert f"| `{name}`<br>{load_preset(name).description} | " in page
    assert f"(styles/{name}.jpg)" in page
    with Image.open(ROOT / "docs" / "styles" / f"{name}.jpg") as sample:
        assert sample.width == 640
    assert (ROOT / "docs" / "styles" / f"{name}.jpg").stat().st_size <= 100_000


def test_page_of_styles_shows_no_preset_that_is_gone() -> None:
    assert {path.stem for path in (ROOT / "docs" / "styles").glob("*.jpg")} == set(names())


def test_commands_of_the_page_of_options_are_sound() -> None:
    """Files that are there, presets that load, settings that they take."""
    found = re.findall(r"^    strokeplan plan (.*)$", (ROOT / "docs" / "options.md").read_text(), flags=re.MULTILINE)
    assert len(found) > 20
    for command in found:
        photo, *words = shlex.split(command)
        options = [(words[k], words[k + 1]) for k in range(0, len(words), 2)]
        assert (ROOT / photo).exists()
        style(dict(options)["--preset"], [value for key, value in options if key == "--set"])
        assert all((ROOT / value).exists() for key, value in options if key == "--mask")
        assert {key for key, _ in options} <= {"-o", "--preset", "--set", "--mask"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize(
    ("page", "rows"),
    [
        ("benchmarks.md", [r"`strokeplan plan`, preset paper", r"lower bound", r"`strokeplan --help`"]),
        ("fidelity.md", [r"`paper-published`", r"`paper`"]),
    ],
)
def test_figures_of_readme_are_those_of_the_measured_page(page: str, rows: list[str]) -> None:
    measured = (ROOT / "docs" / page).read_text()
    for row in rows:
        cells = next(line for line in measured.splitlines() if line.startswith(f"| {row} |")).split("|")[2:5]
        for cell in cells:
            assert not cell.strip() or cell.strip() in README, (row, cell)


def test_every_key_of_a_preset_is_explained() -> None:
    """A docstring under each field: what `presets show` cannot say."""
    source = "".join((ROOT / "strokeplan" / name).read_text() for name in ("presets.py", "color_settings.py"))
    from strokeplan.presets import LayerPreset, Preset

    for kind in (LayerPreset, Preset):
        for key in msgspec.structs.fields(kind):
            if key.name not in ("layers", "name", "description", "lengths", "orientation", "cap"):
                assert re.search(rf"^    {key.name}: .*\n    \"\"\"", source, flags=re.MULTILINE), key.name
