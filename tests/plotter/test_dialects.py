"""Files for machines, read back by programs that share nothing with their writers."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import msgspec
import numpy as np
import pytest
import shapely
from conftest import need_program
from drawings import BAR, EYE, THREE, curve, drawing, drawings, drawn
from hypothesis import given, settings
from readers import distance, read_canonical, read_ebb, read_gcode, read_hpgl

from strokeplan.errors import PlotError
from strokeplan.page import Page
from strokeplan.plotter.files import encode
from strokeplan.plotter.layout import LayoutOptions
from strokeplan.plotter.profile import Gcode, PenSettings, Profile, load_profile
from strokeplan.plotter.program import PlotOptions, program
from strokeplan.plotter.tools import AngleServo
from strokeplan.strokes import StrokePlan

GOLDEN = Path(__file__).parent / "golden"
ROUNDING = 0.0015
"""mm: half the last decimal in x and in y, and a reader's own."""


def change(profile: Profile, **fields: object) -> Profile:
    return msgspec.structs.replace(profile, **fields)


def grbl(curves: str = "arcs", **fields: object) -> Profile:
    flavour = "linuxcnc" if curves == "cubics" else "grbl"
    dialect = Gcode(flavour=flavour, curves=curves)  # type: ignore[arg-type]
    return change(load_profile("grbl_servo"), dialect=dialect, **fields)


def upright(plan: StrokePlan) -> list[np.ndarray]:  # type: ignore[type-arg]
    """What a machine whose y grows up, with the page's lower left corner at its origin, must draw."""
    return [np.column_stack([line[:, 0], plan.height - line[:, 1]]) for line in drawn(plan)]


def linuxcnc() -> str:
    """LinuxCNC's interpreter (Debian: linuxcnc-uspace), too large a package to ask of everybody."""
    found = shutil.which("rs274")
    if found is None:
        pytest.skip("rs274 is not installed")
    return found


@pytest.mark.parametrize("curves", ["arcs", "cubics", "lines"])
def test_gcode_draws_the_strokes(curves: str) -> None:
    made = read_gcode(encode(program(THREE, grbl(curves))))
    assert len(made) == 3
    assert distance(made, upright(THREE)) <= 0.02 + ROUNDING


@pytest.mark.parametrize("curves", ["arcs", "cubics", "lines"])
@settings(max_examples=20)
@given(plan=drawings())
def test_gcode_draws_any_strokes(curves: str, plan: StrokePlan) -> None:
    job = program(plan, grbl(curves, tolerance_mm=0.05, join_mm=0.0))
    assert distance(read_gcode(encode(job)), upright(plan)) <= 0.05 + ROUNDING


def test_a_wrong_file_is_told_from_a_right_one() -> None:
    """The comparator fails where a line is off by more than the tolerance, missing, or an arc turns the other way."""
    right = encode(program(THREE, grbl())).decode()
    lines = right.splitlines()
    arcs = [k for k, line in enumerate(lines) if line.startswith("G3")]
    moved = "\n".join([*lines[: arcs[0]], re.sub(r"X\S+", "X7", lines[arcs[0]]), *lines[arcs[0] + 1 :]])
    missing = right.replace(next(line for line in lines if line.startswith("G1 X")) + "\n", "")
    assert distance(read_gcode(missing.encode()), upright(THREE)) > 0.1
    with pytest.raises(AssertionError, match="GRBL"):
        read_gcode(moved.encode())
    with pytest.raises(AssertionError, match="120"):
        read_gcode(right.replace("G3", "G2").encode())


@pytest.mark.parametrize("curves", ["arcs", "lines"])
def test_linuxcnc_draws_the_strokes(tmp_path: Path, curves: str) -> None:
    rs274 = linuxcnc()
    file = tmp_path / "three.ngc"
    file.write_bytes(encode(program(THREE, grbl(curves))))
    assert distance(read_canonical(rs274, file), upright(THREE)) <= 0.02 + ROUNDING


def test_linuxcnc_takes_every_kind_of_arc_and_cubic(tmp_path: Path) -> None:
    """Its interpreter refuses arcs whose radii differ, feeds that are missing, and words that it does not know."""
    rs274 = linuxcnc()
    rng = np.random.default_rng(3)
    plan = drawing(
        [rng.uniform(5, 75, (3 * k + 1, 2)) * rng.uniform(0.05, 1) + 1 for k in range(1, 12)], (100.0, 100.0)
    )
    for curves in ("arcs", "cubics"):
        file = tmp_path / f"{curves}.ngc"
        file.write_bytes(encode(program(plan, grbl(curves))))
        ran = subprocess.run([rs274, "-g", str(file)], capture_output=True, text=True, timeout=120)
        assert ran.returncode == 0, ran.stdout[-500:] + ran.stderr
        assert ("NURBS_FEED" in ran.stdout) == (curves == "cubics")
    assert distance(read_canonical(rs274, tmp_path / "arcs.ngc"), upright(plan)) <= 0.02 + ROUNDING


def test_marlin_lifts_by_z_and_waits_in_milliseconds() -> None:
    profile = load_profile("ender3")
    data = encode(program(THREE, change(profile, tool=msgspec.structs.replace(profile.tool, lower_s=0.25))))
    assert distance(read_gcode(data, pen="Z"), upright(THREE)) <= 0.02 + ROUNDING
    assert b"G4 P250\n" in data
    assert b"G1 Z1.5 F300\n" in data
    assert all(len(line) <= 96 for line in data.splitlines())


def test_marlin_turns_a_servo_when_the_moves_are_done() -> None:
    """M280 acts at once, while moves wait in the buffer: M400 before it, and time to turn after it."""
    tool = AngleServo(index=1, up_deg=90, down_deg=40, lower_s=0.15, raise_s=0.1)
    text = encode(program(drawing([BAR]), change(load_profile("ender3"), tool=tool))).decode()
    body = [line for line in text.splitlines() if not line.startswith(";")]
    down = body.index("M280 P1 S40")
    assert body[down - 1 : down + 2] == ["M400", "M280 P1 S40", "G4 P150"]
    assert body[down - 2].startswith("G0 X")
    assert body[down + 3 : down + 6] == ["M400", "M280 P1 S90", "G4 P100"]


def test_hpgl_draws_the_strokes() -> None:
    profile = load_profile("hp7475a")
    page = Page(297, 210, 20)
    job = program(THREE, profile, PlotOptions(LayoutOptions(page=page)))
    scale = min(257 / 100, 170 / 80)
    x0, y0 = (297 - 100 * scale) / 2, (210 - 80 * scale) / 2
    expected = [
        np.column_stack([x0 + scale * x - 10, 210 - y0 - scale * y - 4]) for x, y in (k.T for k in drawn(THREE))
    ]
    assert distance(read_hpgl(encode(job), 0.02488, 512), expected) <= 0.03 + 0.02488


def test_a_portrait_page_is_turned_on_a_landscape_machine() -> None:
    """Its upper edge lies to the right: a mark near it has a large x, and the page's right edge is at small y."""
    profile = load_profile("hp7475a")
    plan = drawing([curve(150, 40, 155, 40, 160, 40, 165, 40)], (210.0, 297.0))
    job = program(plan, profile)
    assert job.transform.turned
    assert job.points.max(axis=0) == pytest.approx([297 - 40 - 10, 210 - 150 - 4])
    assert "turned by a quarter clockwise" in job.transform.describe()


def test_hp2xx_draws_the_strokes(tmp_path: Path) -> None:
    hp2xx = need_program("hp2xx")
    file, svg = tmp_path / "three.plt", tmp_path / "three.svg"
    profile = load_profile("hp7475a")
    data = encode(program(THREE, profile, PlotOptions(LayoutOptions(page=Page(297, 210, 20)))))
    file.write_bytes(data)
    subprocess.run(
        [hp2xx, "-q", "-t", "-m", "svg", "-f", str(svg), str(file)], check=True, capture_output=True, timeout=60
    )
    paths = re.findall(r'<path d="([^"]+)"', svg.read_text())
    theirs = [np.array(re.findall(r"(-?[\d.]+), (-?[\d.]+)", path), float) * 25.4 / 72 for path in paths]  # mm
    ours = read_hpgl(data, 0.025, 512)  # hp2xx takes a unit for 0.025 mm
    top = max(line[:, 1].max() for line in theirs) + min(line[:, 1].min() for line in ours)
    assert distance([np.column_stack([line[:, 0], top - line[:, 1]]) for line in theirs], ours) <= 0.01


def test_ebb_draws_the_strokes_and_goes_home() -> None:
    lines, end, rates = read_ebb(encode(program(THREE, load_profile("axidraw_v3"))), 80)
    assert distance(lines, drawn(THREE)) <= 0.02 + 0.02
    assert end == [0, 0]
    assert 5 < max(rates) <= 25


def test_ebb_turns_motors_of_x_and_y_each_for_itself() -> None:
    """The WaterColorBot is no CoreXY: SM, and its paper begins 77.28 mm from home."""
    pen = load_profile("axidraw_v3").tool
    data = encode(program(THREE, msgspec.structs.replace(load_profile("watercolorbot"), tool=pen)))
    assert b"XM," not in data
    lines, end, rates = read_ebb(data, 34.93)
    assert distance([line - (77.28, 0) for line in lines], drawn(THREE)) <= 0.02 + 0.03
    assert end == [0, 0]
    assert max(rates) <= 25


@settings(max_examples=15)
@given(plan=drawings())
def test_ebb_never_runs_away(plan: StrokePlan) -> None:
    job = program(plan, change(load_profile("axidraw_v3"), join_mm=0.0))
    lines, end, rates = read_ebb(encode(job), 80)
    assert end == [0, 0]
    assert max(rates) <= 25
    assert distance(lines, drawn(plan)) <= 0.02 + 0.02


def test_a_lift_on_another_pin_is_moved_by_s2() -> None:
    """NextDraw: RB2 is RP5; 60 % and 30 % of 5400..12600."""
    commands = encode(program(drawing([BAR]), load_profile("nextdraw_2234"))).decode().split("\r")
    lifts = [command.split(",")[:3] for command in commands if command.startswith("S2")]
    assert lifts == [["S2", "9720", "5"], ["S2", "7560", "5"], ["S2", "9720", "5"]]
    assert not any(command.startswith("SP") for command in commands)


def test_ebb_has_one_pen_a_file() -> None:
    with pytest.raises(PlotError, match="cannot wait for a change of pen"):
        encode(program(drawing([EYE, BAR], pens=("red", "blue")), load_profile("axidraw_v3")))


def test_pens_change_by_hand_with_a_park_and_a_pause() -> None:
    pens = (PenSettings(name="red", draw_mm_min=1200, down_pwm=250, lower_s=0.5),)
    plan = drawing([EYE, BAR, EYE + 20], pens=("red", "blue", "red"))
    text = encode(program(plan, grbl(pens=pens))).decode()
    assert re.findall(r"^; pen (.*)$", text, re.MULTILINE) == ["1: red", "2: blue"]
    red, blue = text.split("; pen 2: blue")
    assert blue.startswith("\nG0 X0 Y0\nM0\nG0 ")
    assert red.count("M3 S250\nG4 P0.5\n") == 2
    assert "F1200" in red
    assert "M3 S300\nG4 P0.2\n" in blue
    assert "F2500" in blue


def test_pens_of_a_carousel() -> None:
    plan = drawing([EYE, BAR], pens=("red", "blue"))
    text = encode(
        program(plan, load_profile("hp7475a"), PlotOptions(LayoutOptions(Page(297, 210, 20)), slots=(("red", 4),)))
    )
    assert re.findall(rb"SP\d", text) == [b"SP4", b"SP1", b"SP0"]


def test_texts_cannot_become_commands() -> None:
    plan = drawing([EYE, BAR], pens=("a\nM3 S1000\r$H\x18!?~", "b;(M30)*%"))
    text = encode(program(plan, grbl())).decode()
    assert {line[:2] for line in text.splitlines()} <= {
        "; ",
        "G0",
        "G1",
        "G2",
        "G3",
        "G4",
        "M0",
        "M2",
        "M3",
        "M5",
        "G9",
    }
    assert "$" not in text
    assert "M3 S1000" not in re.sub(r"^;.*$", "", text, flags=re.MULTILINE)


def test_the_same_plan_gives_the_same_bytes() -> None:
    assert encode(program(THREE, grbl())) == encode(program(THREE, grbl()))


@pytest.mark.parametrize(
    ("name", "profile"),
    [("three.gcode", "grbl_servo"), ("three.plt", "hp7475a"), ("three.ebb", "axidraw_v3"), ("z.gcode", "ender3")],
)
def test_golden_files(name: str, profile: str) -> None:
    page = PlotOptions(
        LayoutOptions(page=Page(210, 148, 20)) if profile != "hp7475a" else LayoutOptions(page=Page(297, 210, 20))
    )
    data = encode(program(THREE, load_profile(profile), page))
    expected = (GOLDEN / name).read_bytes()
    assert re.sub(rb"strokeplan \S+:", b"strokeplan:", data) == expected


def test_lines_that_cross_the_travel_are_refused_before_anything_is_written() -> None:
    plan = drawing([EYE, curve(10, 10, 40, -40, 60, -40, 90, 10)])
    with pytest.raises(
        PlotError, match=r"stroke 2 \(layer 'ink'\) goes to X50\.\d+ Y107\.\d+, 7\.\d+ mm beyond the travel"
    ):
        program(plan, grbl(machine=msgspec.structs.replace(load_profile("grbl_servo").machine, y_mm=(0, 100))))


def test_handles_outside_of_the_travel_are_no_breach() -> None:
    plan = drawing([curve(10, 10, 40, -5, 60, -5, 90, 10)])
    profile = grbl(machine=msgspec.structs.replace(load_profile("grbl_servo").machine, y_mm=(0, 82)))
    assert shapely.MultiLineString([read_gcode(encode(program(plan, profile)))[0]]).bounds[3] <= 82
