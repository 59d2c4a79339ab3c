"""Documents stay true: what they name exists, what exists is named, and their figures are the measured ones."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest
from conftest import ROOT

from strokeplan.cli import app
from strokeplan.presets import names

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
