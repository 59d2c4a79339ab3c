"""Profiles: those that ship are sound and say where their figures are from; what is wrong in one is named."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest
from conftest import ROOT
from drawings import BAR, drawing
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strokeplan.errors import ProfileError, StrokeplanError
from strokeplan.page import Page
from strokeplan.plotter.files import encode
from strokeplan.plotter.layout import LayoutOptions
from strokeplan.plotter.profile import begin, load_profile, names, parse, source, user_folder
from strokeplan.plotter.program import PlotOptions, limits, program

SHIPPED = sorted(path.stem for path in (ROOT / "plotter_profiles").glob("*.toml"))
ASKED = (
    "axidraw_v3 axidraw_se_a4 axidraw_v3a3 axidraw_v3xl axidraw_minikit axidraw_clone nextdraw_2234 idraw_2 grbl_servo "
    "grbl_z fluidnc grblhal ender3 linuxcnc hp7475a hp7470a roland_dxy uarm_swift_pro dexarm watercolorbot robot_brush"
)


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "strokeplan" / "profiles"


def test_the_machines_that_people_have_are_there() -> None:
    assert set(ASKED.split()) <= set(SHIPPED) == set(names())


@pytest.mark.parametrize("name", SHIPPED)
def test_every_profile_draws(name: str) -> None:
    """A line in the middle of a sheet that the machine takes."""
    profile = load_profile(name)
    if profile.papers:
        page = profile.papers[0].sheet
    else:
        spans = profile.machine.x_mm, profile.machine.y_mm
        page = Page(*(min(100.0, 0.5 * (high - low)) for low, high in spans))
    plan = drawing([BAR], (100.0, 100.0))
    job = program(plan, profile, PlotOptions(LayoutOptions(page=page)))
    assert len(encode(job)) > 50
    assert limits(profile).rate[0] <= profile.speeds.travel_mm_min


@pytest.mark.parametrize("name", SHIPPED)
def test_every_figure_has_its_source(name: str) -> None:
    """Each line with a number ends in a comment; the generic brush says at its top that all is assumed."""
    lines = source(name).decode().splitlines()
    assert lines[0].startswith("# ")
    bare = [line for line in lines if re.match(r"\w+ = [-\d\[][^#]*\d[^#]*$", line) or re.match(r"\w+ = \d+$", line)]
    if name != "robot_brush":
        assert bare == []


WRONG = [
    ("x_mm = [0, 300]", "x_mm = [300, 0]", r"machine: x_mm = \[300\.0, 0\.0\] must rise"),
    ("x_mm = [0, 300]", "x_mm = [0, nan]", "machine.x_mm"),
    ("x_mm = [0, 300]", "x_mm = [0, inf]", "machine.x_mm"),
    ("x_mm = [0, 300]", "", "missing required field `x_mm`"),
    ("x_mm = [0, 300]", "x_mm = [0, 300]\nspeed = 3", "unknown field `speed`; known are x_mm, y_mm, axes"),
    ('axes = ["right", "up"]', 'axes = ["right", "left"]', "one across"),
    ("draw_mm_min = 2500", "draw_mm_min = 0", "speeds.draw_mm_min = 0: Expected `float` > 0"),
    ("draw_mm_min = 2500", "draw_mm_min = nan", "speeds.draw_mm_min"),
    ('type = "servo"', 'type = "carousel"\npens = 2', "carousel|unknown field"),
    ('type = "servo"', 'type = "laser"', "tool.type = 'laser': Invalid value"),
    ('flavour = "grbl"', 'flavour = "smoothie"', "dialect.flavour = 'smoothie': Invalid enum"),
    ('curves = "arcs"', 'curves = "cubics"', "grbl knows no G5"),
    ("park_mm = [0, 0]", "park_mm = [0, 500]", "outside of the machine's travel"),
    ("[change]", '[[pens]]\nname = "a"\ndown_mm = 1\n[change]', "down_mm of 'a' is none that a servo has"),
    ("[change]", '[[pens]]\nname = "a"\n[[pens]]\nname = "a"\n[change]', "'a' stands there twice"),
]


@pytest.mark.parametrize(("right", "wrong", "message"), WRONG)
def test_what_is_wrong_is_named(right: str, wrong: str, message: str) -> None:
    text = source("grbl_servo").decode()
    assert right in text
    with pytest.raises(ProfileError, match=message) as caught:
        parse(text.replace(right, wrong, 1).encode(), "mine.toml", "mine")
    assert str(caught.value).startswith("profile mine.toml: ")
    assert "\n" not in str(caught.value)


LINES = (
    ("$H", "$RST=*", "M500", "M30 /job.gco", "M28 x.gco", "M997", "G0 X0 Y0", "G1 Z-50", "G28 X0\\nM500", "G92 X5"),
    ("G10 L2 P1 X0", "G20", "G91", "M112", "\\u001bM500", "g4 p1", "G4 P1 ; M500", "(MSG)", "G4 P1 M500", "O100 call"),
    ("#1=2", "%", "G4 P1\\u2028M5", "", "G4 P٣", "M3 X1", "G4 P" + "1" * 9),
)


@pytest.mark.parametrize("line", [line for row in LINES for line in row])
def test_no_line_that_moves_stores_or_opens(line: str) -> None:
    text = source("grbl_servo").decode().replace('flavour = "grbl"', f'flavour = "grbl"\nprologue = ["{line}"]')
    with pytest.raises(ProfileError, match=r"prologue|TOML"):
        parse(text.encode(), "mine", "mine")


@pytest.mark.parametrize("data", [b"\xff", b"a = ", b"[" * 5000, b"", b"a = 1", b"x" * 2_000_000, b"machine = 3\n" * 2])
def test_any_bytes_are_a_profile_or_an_error(data: bytes, tmp_path: Path) -> None:
    file = tmp_path / "any.toml"
    file.write_bytes(data)
    with pytest.raises(ProfileError):
        load_profile(file)


VALUES = (
    *("1e400", "-1", "nan", "[1]", "[[[1]]]", "{a = 1}", '"x"', '"\\n"', "true", "9" * 40, "1979-05-27", "[]"),
    *('"""', "[nan, inf]", '["$H"]', '["right", "right"]', '"\\u0000"'),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_profile_is_a_profile_or_one_line(data: st.DataObject) -> None:
    """Lines lost, doubled or given another value: no other error than ours, and none of several lines."""
    lines = (ROOT / "plotter_profiles" / f"{data.draw(st.sampled_from(SHIPPED))}.toml").read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        k = data.draw(st.integers(0, len(lines) - 1))
        key = lines[k].partition("=")[0]
        changes = [*(f"{key}= {value}" for value in VALUES), "", lines[k] + "\n" + lines[k], "[machine]", "[[tool]]"]
        lines[k] = data.draw(st.sampled_from(changes))
    said = ""
    try:
        parse("\n".join(lines).encode(), "damaged", "damaged")
    except ProfileError as error:
        said = str(error)
    assert "\n" not in said
    assert len(said) < 1000


def test_unknown_names_say_what_is_known() -> None:
    for name in ("nosuch", "../../etc/passwd", "", "a\nb"):
        with pytest.raises(StrokeplanError, match="known are axidraw_clone") as caught:
            load_profile(name)
        assert "\n" not in str(caught.value)


def test_the_users_profile_goes_before_the_shipped_one(own_folder: Path) -> None:
    made = begin("mine", "grbl_z")
    assert made == own_folder / "mine.toml" == user_folder() / "mine.toml"
    assert load_profile("mine") == msgspec.structs.replace(load_profile("grbl_z"), name="mine")
    with pytest.raises(ProfileError, match="is there already"):
        begin("mine", "grbl_servo")
    (own_folder / "grbl_z.toml").write_text(source("grbl_servo").decode())
    assert load_profile("grbl_z").description == load_profile("grbl_servo").description
    with pytest.raises(ProfileError, match="no name of a profile"):
        begin("../x", "grbl_servo")
