"""The command line for machines: export --profile, info --profile, profiles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawings import BAR, EYE, THREE, curve, drawing
from readers import distance, read_gcode
from typer.testing import CliRunner

from strokeplan.cli import app
from strokeplan.errors import StrokeplanError
from strokeplan.formats import save
from strokeplan.strokes import Layer, StrokePlan

SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="80mm" viewBox="0 0 200 160">
<path d="M20 20 C80 0 120 80 180 20" fill="none" stroke="#000"/></svg>"""


def run(*words: object) -> str:
    """What a command prints; its error, if it raises one."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if isinstance(result.exception, StrokeplanError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)


def saved(plan: StrokePlan, folder: Path) -> Path:
    save(plan, folder / "plan.json")
    return folder / "plan.json"


def test_any_svg_goes_to_a_machine(tmp_path: Path) -> None:
    """In the size that it says it has: 100 × 80 mm, two units a millimetre, y down."""
    svg, out = tmp_path / "any.svg", tmp_path / "any.gcode"
    svg.write_text(SVG)
    said = run("export", svg, "-o", out, "--profile", "grbl_servo")
    assert "its lower left corner is at X0 Y0, X grows right, Y grows up" in said
    assert "any.gcode" in said
    expected = drawing([curve(10, 70, 40, 80, 60, 40, 90, 70)])
    from drawings import drawn

    assert distance(read_gcode(out.read_bytes()), drawn(expected)) <= 0.0215


def test_options_reach_the_machine(tmp_path: Path) -> None:
    plan, out = saved(drawing([BAR, EYE], pens=("red", "blue")), tmp_path), tmp_path / "x.plt"
    said = run("export", plan, "-o", out, "--profile", "hp7475a", "--page", "A4", "--margin", 20, "--pen", "red=5")
    assert "turned by a quarter" in said
    assert "1 of the pen" in said
    assert b"SP5;" in out.read_bytes()
    dated = tmp_path / "d.gcode"
    run(
        "export",
        plan,
        "-o",
        dated,
        "--profile",
        "grbl_servo",
        "--date",
        "2026-01-02",
        "--rotate",
        90,
        "--mirror",
        "--clip",
    )
    assert b"; date 2026-01-02\n" in dated.read_bytes()
    said = run("export", plan, "-o", dated, "--profile", "grbl_servo", "--file-per-pen")
    assert {path.name for path in tmp_path.glob("d-*.gcode")} == {"d-red.gcode", "d-blue.gcode"}
    assert "d-red.gcode" in said


def test_info_says_what_a_machine_needs(tmp_path: Path) -> None:
    plan = saved(THREE, tmp_path)
    said = run("info", plan, "--profile", "ender3")
    for word in ("strokes", "lines", "travelled", "time", "(estimated)", "Ender-3"):
        assert word in said
    assert "Ender-3" not in run("info", plan)
    for option, value in (("page", "A4"), ("group-by", "colour"), ("keep-order", None), ("pen-width", 1)):
        with pytest.raises(StrokeplanError, match=f"^{option} is for machines: give --profile"):
            run("info", plan, f"--{option}", *([] if value is None else [value]))


def test_options_mean_the_same_in_every_command(tmp_path: Path) -> None:
    """What `info` and a dry run of `plot` say is what `export` writes, whatever way the drawing is laid and drawn."""
    plan = saved(drawing([BAR, EYE, BAR - np.array([0, 20])], pens=("red", "blue", "red")), tmp_path)
    area = tmp_path / "area.svg"
    area.write_text(SVG.replace("M20 20 C80 0 120 80 180 20", "M20 20 H210 V280 H20 Z"))
    laid = ["--page", "A5", "--margin", 12, "--landscape", "--rotate", 180, "--mirror", "--scale", 0.9, "--clip"]
    options = [*laid, "--within", area, "--keep-order", "--pen-width", 0.7, "--pen", "blue=2", "--group-by", "pen"]
    machine = ["--profile", "grbl_servo"]
    told = run("export", plan, "-o", tmp_path / "x.gcode", *machine, *options, "--dry-run").splitlines()[:-1]
    assert run("plot", plan, *machine, *options, "--dry-run").splitlines() == told
    assert run("info", plan, *machine, *options).splitlines()[-len(told) :] == told
    plain = run("export", plan, "-o", tmp_path / "x.gcode", *machine, "--dry-run").splitlines()[:-1]
    assert plain != told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["x.gcode"], "is for a machine; say which"),
        (["x.gcode", "--profile", "nosuch"], "profile 'nosuch' is unknown"),
        (["x.plt", "--profile", "grbl_servo"], "grbl_servo takes .gcode"),
        (["x.svg", "--profile", "grbl_servo"], "grbl_servo takes .gcode"),
        (["x.svg", "--rotate", 90], "rotate is for machines"),
        (["x.gcode", "--profile", "grbl_servo", "--outline"], "no option outline"),
        (["x.gcode", "--profile", "grbl_servo", "--rotate", 45], "rotate 45"),
        (["x.gcode", "--profile", "grbl_servo", "--page", "A1"], "larger than what grbl_servo reaches"),
        (["x.gcode", "--profile", "grbl_servo", "--pen", "red"], "is not NAME=SLOT"),
        (["x.gcode", "--profile", "grbl_servo", "--pen", "red=1"], "used by no stroke"),
        (["x.gcode", "--profile", "grbl_servo", "--date", "soon"], "give YYYY-MM-DD"),
        (["nosuch/x.gcode", "--profile", "grbl_servo"], "does not exist"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(tmp_path: Path, words: list[object], message: str) -> None:
    plan = saved(THREE, tmp_path)
    with pytest.raises(StrokeplanError) as caught:
        run("export", plan, "-o", tmp_path / str(words[0]), *words[1:])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]


def test_profiles_are_listed_shown_checked_and_begun(tmp_path: Path) -> None:
    assert "grbl_servo        GRBL 1.1, pen on a servo" in run("profiles")
    assert "travel_mm_min" in run("profiles", "show", "ender3")
    assert "sound" in run("profiles", "check", "ender3")
    assert "mine.toml" in run("profiles", "new", "mine", "--like", "ender3")
    assert run("profiles", "show", "mine") == run("profiles", "show", "ender3")
    file = tmp_path / "config" / "strokeplan" / "profiles" / "mine.toml"
    file.write_text(file.read_text().replace("draw_mm_min", "draw_speed"))
    assert "mine              broken: profile mine: speeds" in run("profiles")
    with pytest.raises(StrokeplanError, match=r"unknown field `draw_speed`|missing required field"):
        run("profiles", "check", file)


def test_the_two_lists_of_suffixes_agree() -> None:
    """One is read without loading the plotter."""
    from strokeplan.formats import MACHINE_SUFFIXES
    from strokeplan.plotter.files import SUFFIXES

    assert set(MACHINE_SUFFIXES) == set(SUFFIXES)


def test_a_dry_run_says_all_and_writes_nothing(tmp_path: Path) -> None:
    plan = saved(THREE, tmp_path)
    said = run("export", plan, "-o", tmp_path / "x.gcode", "--profile", "grbl_servo", "--dry-run")
    for words in ("lower left corner is at X0 Y0", "draws within X 10.00..90.00", "(estimated)", "nothing is written"):
        assert words in said
    assert sorted(tmp_path.iterdir()) == [plan]


def test_a_painting_becomes_bundles_of_few_pens(tmp_path: Path) -> None:
    paint = replace(THREE, layers=(Layer("1", 0, 3),), widths=np.full(3, 4.0))
    plan = saved(paint, tmp_path)
    words = ["--profile", "grbl_servo", "--strokes", "bundle", "--pen-width", "0.5mm", "--pens", "2"]
    run("export", plan, "-o", tmp_path / "x.gcode", *words)
    assert "pens        #" in run("info", plan, *words)
    run("preview", plan, "-o", tmp_path / "x.html", *words)
    inked = sum(len(line) for line in read_gcode((tmp_path / "x.gcode").read_bytes()))
    assert inked > 200
    assert '"plot":{' in (tmp_path / "x.html").read_text()
