"""One value of a profile changed: the text around it stays, and whatever is not certain is refused."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from strokeplan.errors import ProfileError
from strokeplan.plotter.driving.tuning import DOWN, UP, changed, key_of, saved, tried, value_of
from strokeplan.plotter.profile import load_profile, names, source

TUNABLE = [name for name in names() if type(load_profile(name).tool) in DOWN]


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "strokeplan" / "profiles"


def comments(text: bytes) -> Counter[str]:
    return Counter(re.findall(r"#.*", text.decode()))


@given(st.sampled_from(TUNABLE), st.booleans(), st.integers(-5000, 5000).map(lambda v: v / 1000))
def test_only_the_value_changes(name: str, down: bool, value: float) -> None:
    before = source(name)
    key = key_of(load_profile(name), down=down)
    after = changed(before, "tool", key, value, where=name)
    expected = tomllib.loads(before.decode())
    expected["tool"][key] = value
    assert tomllib.loads(after.decode()) == expected
    assert comments(after) == comments(before)
    lines, edited = before.splitlines(), after.splitlines()
    assert len([line for line in edited if line not in lines]) <= 1


def test_a_shipped_profile_is_copied_first_and_yours_is_changed_in_place(own_folder: Path) -> None:
    path, begun = saved("grbl_servo", "tool", "down_pwm", 345)
    assert (path, begun) == (own_folder / "grbl_servo.toml", True)
    assert value_of(load_profile("grbl_servo"), "down_pwm") == 345
    path.write_text(path.read_text() + "# mine\n")
    assert saved("grbl_servo", "tool", "up_pwm", 12.5) == (path, False)
    mine = load_profile("grbl_servo")
    assert (value_of(mine, "down_pwm"), value_of(mine, "up_pwm")) == (345, 12.5)
    assert path.read_text().endswith("# mine\n")
    assert [file.name for file in own_folder.iterdir()] == ["grbl_servo.toml"]


def test_a_file_is_changed_where_it_stands(tmp_path: Path, own_folder: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(source("grbl_z").replace(b"\n", b"\r\n"))
    assert saved(str(file), "machine", "offset_mm", [12.5, -3.0]) == (file, False)
    assert load_profile(str(file)).machine.offset_mm == (12.5, -3)
    assert file.read_bytes().count(b"\n") == file.read_bytes().count(b"\r\n")
    assert not own_folder.exists()


def test_a_pen_of_its_own_is_changed_and_no_other(tmp_path: Path) -> None:
    file = tmp_path / "two.toml"
    pens = '\n[[pens]]\nname = "thin"\ndown_pwm = 280 # felt\n\n[[pens]]\nname = "thick"\n'
    file.write_text(source("grbl_servo").decode() + pens)
    saved(str(file), "pens", "down_pwm", 333, item=1)
    profile = load_profile(str(file))
    assert [value_of(profile, "down_pwm", pen) for pen in (None, "thin", "thick")] == [300, 280, 333]
    saved(str(file), "pens", "down_pwm", 281, item=0)
    assert value_of(load_profile(str(file)), "down_pwm", "thin") == 281
    assert "# felt" in file.read_text()
    with pytest.raises(ProfileError, match="says nothing of a pen 'red'; of its own it has thin, thick"):
        value_of(profile, "down_pwm", "red")


@pytest.mark.parametrize(
    "text",
    [
        'tool = {type = "z", up_mm = 3}\n',
        'note = """\n[tool]\nup_mm = 1\n"""\n[tool]\nup_mm = 3\n',
        '["tool"]\nup_mm = 3\n',
        "[tool]\nup_mm = [\n 3\n]\n",
        '[tool]\n"up_mm" = 3\n',
        "tool.up_mm = 3\n",
    ],
)
def test_unusual_text_is_left_to_people(text: str) -> None:
    with pytest.raises(ProfileError, match=r"x: its text is not the usual one; set up_mm = 5 in \[tool\] by hand"):
        changed(text.encode(), "tool", "up_mm", 5, where="x")


def test_values_that_no_machine_has_are_refused_and_nothing_is_written(own_folder: Path) -> None:
    with pytest.raises(ProfileError, match=r"--pwm -3: .*>= 0"):
        tried(load_profile("grbl_servo"), "down_pwm", -3)
    with pytest.raises(ProfileError, match="where the pen is down, too"):
        tried(load_profile("grbl_z"), "down_mm", load_profile("grbl_z").tool.up_mm)  # type: ignore[union-attr]
    with pytest.raises(ProfileError, match="percent"):
        saved("axidraw_v3", "tool", "down_percent", 101)
    with pytest.raises(ProfileError, match="unknown"):
        saved("nothing", "tool", "down_mm", 1)
    with pytest.raises(ProfileError, match="no height to set"):
        key_of(load_profile("hp7475a"), down=True)
    assert not own_folder.exists()


def test_every_tool_with_a_height_has_both_ends() -> None:
    assert DOWN.keys() == UP.keys()
