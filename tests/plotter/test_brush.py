"""A brush: how hard it is pressed along a line, and when it is dipped, washed and wiped."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pytest
from drawings import BAR, EYE, drawing

from strokeplan.errors import PlotError, ProfileError
from strokeplan.plotter.brush import turns_deg, visits
from strokeplan.plotter.estimate import estimate
from strokeplan.plotter.files import encode
from strokeplan.plotter.profile import Profile, load_profile, parse, source
from strokeplan.plotter.program import program
from strokeplan.plotter.tools import ZBrush, ZWell
from strokeplan.strokes import Layer

ROBOT = load_profile("robot_brush")
LINES = [BAR - (30, 10 * k) for k in range(6)]
"""Six lines of 30 mm."""


def brush(**fields: object) -> Profile:
    return msgspec.structs.replace(ROBOT, tool=msgspec.structs.replace(ROBOT.tool, **fields))


def positions(data: bytes) -> np.ndarray:  # type: ignore[type-arg]
    """(n, 3): where the brush is after each move."""
    at = dict.fromkeys("XYZ", 0.0)
    found = []
    for line in data.decode().splitlines():
        if line.startswith(("G0 ", "G1 ")):
            at |= {axis: float(value) for axis, value in re.findall(r"([XYZ])(-?[\d.]+)", line)}
            found.append(list(at.values()))
    return np.array(found)


def test_height_follows_width_with_ramps_at_both_ends() -> None:
    """Widths 0.8 and 8 mm are heights 2 and −1; 4.4 mm lies in the middle, at 0.5, from 4 mm after the beginning on."""
    at = positions(encode(program(drawing([BAR], widths=np.array([4.4])), brush(refill_mm=None))))
    line = at[at[:, 2] <= 2]
    assert line[[0, -1], 2] == pytest.approx([2, 2])
    assert line[:, 2].min() == pytest.approx(0.5)
    assert np.abs(line[line[:, 2] < 0.5001][[0, -1], 0] - 90) == pytest.approx([54, 76])


def test_pressure_is_pressed_and_no_stroke_goes_deeper_than_the_brush_may() -> None:
    plan = drawing([BAR], widths=np.array([100.0]), pressures=np.array([0.0, 1.0]))
    height = positions(encode(program(plan, brush(refill_mm=None, approach_mm=0.0))))[:, 2]
    assert height.min() == -1
    assert 2 in height


def test_it_travels_only_above() -> None:
    text = encode(program(drawing(LINES), ROBOT)).decode()
    height = 0.0
    for line in text.splitlines():
        assert not (line.startswith("G0 ") and height != 15), line
        found = re.search(r"Z(-?[\d.]+)", line)
        height = float(found[1]) if found else height


def test_it_is_dipped_by_painted_distance_across_lines() -> None:
    """Six lines of 30 mm with 70 mm a dip: two lines fit, a third would not."""
    job = program(drawing(LINES), brush(refill_mm=70.0))
    dips = [stop.line for stop in visits(job) if stop.kind == "dip"]
    assert dips == [0, 2, 4]
    assert estimate(job).refills == 3
    assert encode(job).decode().count("; dip") == 3


def test_another_paint_washes_first() -> None:
    paints = tuple(ZWell(name=name, at_mm=(40, y), bottom_mm=-5) for name, y in (("red", 20), ("blue", 60)))
    plan = drawing([BAR, EYE, BAR - 20], pens=("red", "blue", "blue"))
    stops = visits(program(plan, brush(paints=paints)))
    assert [(stop.line, stop.kind) for stop in stops] == [
        (0, "dip"), (1, "wash"), (1, "wash"), (1, "wipe"), (1, "dip"), (3, "wash"), (3, "wash"), (3, "wipe"),
    ]  # fmt: skip
    with pytest.raises(PlotError, match="no well has the paint of pen 'blue'"):
        visits(program(plan, brush(paints=paints[:1])))


def test_water_before_every_layer_if_asked() -> None:
    plan = drawing([BAR, EYE], layers=(Layer("wide", 0, 1), Layer("fine", 1, 2)))
    for asked, washes in ((False, {2}), (True, {1, 2})):
        stops = visits(program(plan, brush(wash_layers=asked)))
        assert {stop.line for stop in stops if stop.kind == "wash"} == washes


def test_paint_keeps_its_order() -> None:
    far = [BAR - (0, k) for k in (60, 5, 40)]
    job = program(drawing(far), ROBOT)
    assert [float(job.line(j)[0, 1]) for j in range(3)] == [80 - 70 + k for k in (60, 5, 40)]


def test_a_brush_that_turns_has_no_leaps() -> None:
    circle = np.column_stack([np.cos(np.linspace(0, 6, 60)), np.sin(np.linspace(0, 6, 60))])
    assert np.abs(np.diff(turns_deg(circle))).max() < 10
    assert re.search(rb"G1 X\S+ Y\S+ Z\S+ A0", encode(program(drawing([BAR]), brush(angle_axis="A"))))


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("at_mm = [40, 40]", "at_mm = [-40, 40]", "well at"),
        ("touch_mm = 2 ", "touch_mm = 20 ", "must go one way"),
        ("press_width_mm = 8", "press_width_mm = 0.1", "must be above touch_width_mm"),
    ],
)
def test_what_is_wrong_with_a_brush_is_named(right: str, wrong: str, message: str) -> None:
    text = source("robot_brush").decode()
    assert right in text
    with pytest.raises(ProfileError, match=message):
        parse(text.replace(right, wrong, 1).encode(), "mine", "mine")
    assert isinstance(ROBOT.tool, ZBrush)
