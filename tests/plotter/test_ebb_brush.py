"""A brush on an EiBotBoard's servo: heights between slices, wells, and the way back, read from the commands alone."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np
import pytest
from drawings import BAR, EYE, SWAN, drawing, drawn
from numpy.typing import NDArray
from readers import distance

from strokeplan.errors import PlotError, ProfileError
from strokeplan.plotter.estimate import estimate
from strokeplan.plotter.files import encode
from strokeplan.plotter.profile import Profile, load_profile, parse, source
from strokeplan.plotter.program import program
from strokeplan.strokes import StrokePlan

BOT = load_profile("watercolorbot")
STEPS_MM = 34.93
PAPER = (77.28, 0.0)
SAFE, TOUCH, PRESS = 24100, 19550, 18250
"""70, 35 and 25 % of 15000..28000."""
PERCENT = 130
LINES = [BAR - (30, 10 * k) for k in range(6)]
"""Six lines of 30 mm."""


class Read(NamedTuple):
    """What the commands do: (n, 3) x, y in mm and the pulse after each move of the motors; contacts; seconds."""

    places: NDArray[np.float64]
    contacts: list[NDArray[np.float64]]
    """(k, 3) each: from where the tip comes down until it is up again."""
    changes: list[tuple[int, int]]
    """Pulses before and after each S2 for which the motors do not stand."""
    seconds: float


def bot(**fields: object) -> Profile:
    return msgspec.structs.replace(BOT, tool=msgspec.structs.replace(BOT.tool, **fields))


def read(data: bytes) -> Read:
    x = y = ms = 0
    pulse = SAFE
    places: list[tuple[float, float, int]] = []
    contacts: list[list[tuple[float, float, int]]] = []
    changes = []
    for command in data.decode("ascii").split("\r"):
        name, *given = command.split(",")
        if name == "S2":
            to, pin, _, wait = map(int, given)
            assert pin == 4
            contacts += [[(x / STEPS_MM, y / STEPS_MM, to)]] if pulse == SAFE and to != SAFE else []
            changes += [(pulse, to)] if wait == 0 else []
            pulse, ms = to, ms + wait
        elif name == "SM":
            x, y, ms = x + int(given[1]), y + int(given[2]), ms + int(given[0])
            places.append((x / STEPS_MM, y / STEPS_MM, pulse))
            if pulse != SAFE:
                contacts[-1].append(places[-1])
    assert pulse == SAFE
    return Read(np.array(places), [np.array(contact) for contact in contacts], changes, ms / 1000)


def painted(plan: StrokePlan, profile: Profile) -> list[NDArray[np.float64]]:
    """Contacts on the paper, in mm of it."""
    return [part - (*PAPER, 0) for part in read(encode(program(plan, profile))).contacts if part[0, 0] > 70]


def test_height_follows_width_with_ramps_at_both_ends() -> None:
    """Widths 1 and 6 mm are 35 and 25 %: 3.5 mm are 30 %, from 4 mm after the beginning to 4 mm before the end."""
    (line,) = painted(drawing([BAR], widths=np.array([3.5])), bot(refill_mm=None))
    assert line[0, 2] == line[-1, 2] == TOUCH
    middle = (line[1:, 0] + line[:-1, 0]) / 2 - 50
    expected = TOUCH - 5 * PERCENT * np.clip(np.minimum(middle, 30 - middle) / 4, 0, 1)
    assert np.abs(line[1:, 2] - expected).max() <= PERCENT
    assert (line[(line[:, 0] > 57) & (line[:, 0] < 73), 2] == TOUCH - 5 * PERCENT).all()


def test_pressure_is_pressed_and_no_stroke_goes_deeper_than_the_brush_may() -> None:
    plan = drawing([BAR], widths=np.array([100.0]), pressures=np.array([0.0, 1.0]))
    (line,) = painted(plan, bot(refill_mm=None, approach_mm=0.0, press_percent=25.4))
    assert line[0, 2] == TOUCH
    assert line[:, 2].min() == 15000 + round(25.4 * PERCENT)


def test_only_heights_that_are_seen_are_commanded() -> None:
    plan = drawing([SWAN], widths=np.array([6.0]), pressures=np.array([0.1, 1.0]))
    changes = read(encode(program(plan, bot(refill_mm=None)))).changes
    assert all(abs(b - a) >= PERCENT for a, b in changes)
    assert 10 < len(changes) <= 20  # 10 % and back
    even = drawing([SWAN, EYE], widths=np.array([4.0, 2.0]))
    assert read(encode(program(even, bot(refill_mm=None, approach_mm=0.0)))).changes == []


def test_it_paints_the_strokes_and_is_up_on_every_other_way() -> None:
    plan = drawing([SWAN, EYE, BAR], widths=np.array([1.0, 3.0, 6.0]))
    data = encode(program(plan, BOT))
    found = read(data)
    paper = [part[:, :2] - PAPER for part in found.contacts if part[0, 0] > 70]
    assert distance(paper, drawn(plan)) <= 0.02 + 0.03
    pulses = {int(pulse) for part in found.contacts for pulse in part[:, 2]}
    assert max(pulses) == TOUCH
    assert found.places[-1].tolist() == [0, 0, SAFE]
    assert b"SC,4,24100\r" in data  # where SP,1 raises it in an emergency


def test_a_dot_is_pressed_where_it_stands() -> None:
    dot = np.tile([[40.0, 40.0]], (4, 1))
    for shape in (dot, dot + np.linspace([0, 0], [0.006, 0], 4)):
        (line,) = painted(drawing([shape], widths=np.array([6.0])), bot(refill_mm=None))
        assert line == pytest.approx(np.array([[40, 40, PRESS]]), abs=0.02)


def test_it_is_dipped_by_painted_distance_across_lines() -> None:
    """Six lines of 30 mm with 70 mm a dip: two lines fit, a third would not."""
    job = program(drawing(LINES), bot(refill_mm=70.0))
    where = [
        "pan" if 20 < part[0, 0] < 70 else "paper" if part[0, 0] > 70 else "water"
        for part in read(encode(job)).contacts
    ]
    assert where == ["pan", "paper", "paper"] * 3 + ["water"] * 3
    assert estimate(job).refills == 3


def test_another_paint_is_washed_out_first() -> None:
    plan = drawing([BAR, EYE, BAR - 20], pens=("red", "blue", "blue"), widths=np.full(3, 2.0))
    parts = [part for part in read(encode(program(plan, BOT))).contacts if part[0, 0] < 70]
    pots = [(round(float(part[0, 0]), 1), round(float(part[0, 1]), 1), int(part[0, 2])) for part in parts]
    water = [(0.0, y, 17600) for y in (8.6, 94.5, 171.7)]
    assert pots == [(44.4, 40.9, PRESS), *water, (44.4, 143.2, PRESS), *water]
    red, first = parts[0], parts[1]
    assert (red[:, 0].min(), red[:, 0].max()) == pytest.approx((44.4 - 17.2, 44.4 + 17.2), abs=0.03)
    assert (first[:, 1].min(), first[:, 1].max()) == pytest.approx((0, 17.2), abs=0.03)
    assert np.ptp(first[:, 0]) == 0
    turns = np.diff(np.sign(np.diff(red[:, 0])))
    assert np.count_nonzero(turns) == 7  # 4 times to and fro
    with pytest.raises(PlotError, match="no well has the paint of pen 'grey'"):
        encode(program(drawing([BAR, EYE], pens=("red", "grey")), BOT))


def test_the_estimate_knows_sweeps_and_stirring() -> None:
    """Slices are whole milliseconds: the file is a little slower."""
    job = program(drawing(LINES * 2, widths=np.full(12, 4.0)), bot(refill_mm=70.0))
    assert read(encode(job)).seconds == pytest.approx(estimate(job).total_s, rel=0.06)
    slow = msgspec.structs.replace(job.profile.tool, raise_rate=100, lower_rate=100)
    slower = program(drawing(LINES * 2, widths=np.full(12, 4.0)), msgspec.structs.replace(job.profile, tool=slow))
    assert read(encode(slower)).seconds == pytest.approx(estimate(slower).total_s, rel=0.06)
    assert estimate(slower).total_s > estimate(job).total_s + 20


def test_paint_keeps_its_order() -> None:
    far = [BAR - (0, k) for k in (60, 5, 40)]
    assert [round(float(line[0, 1])) for line in painted(drawing(far), BOT)] == [10, 65, 30]


def test_lines_are_no_slower_for_their_heights() -> None:
    """Heights stand between the slices of the same motion."""
    plan, flat = drawing([SWAN, EYE], widths=np.full(2, 6.0)), drawing([SWAN, EYE], widths=np.full(2, 1.0))
    moves = [
        [command for command in encode(program(each, bot(refill_mm=None))).split(b"\r") if command[:2] == b"SM"]
        for each in (plan, flat)
    ]
    assert moves[0] == moves[1]


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        (
            "touch_percent = 35 ",
            "touch_percent = 75 ",
            "safe_percent, touch_percent, press_percent = 70, 75, 25 must go",
        ),
        ("press_percent = 25 ", "press_mm = 25 ", "unknown field"),
        ("at_mm = [44.4, 14.3]", "at_mm = [10, 14.3]", r"the well at \[10.0, 14.3\] with its stir is outside"),
        ("draw_x_mm = [77.28, 361.5]", "draw_x_mm = [77.28, 370]", r"draw_x_mm = .* within x_mm = \[0.0, 361.5\]"),
        ("stir_mm = 8.6", "stir_mm = 9.0", r"the well at \[0.0, 8.6\] with its stir is outside"),
        ("bottom_percent = 25", "bottom_percent = 125", "125"),
    ],
)
def test_what_is_wrong_with_a_brush_is_named(right: str, wrong: str, message: str) -> None:
    text = source("watercolorbot").decode()
    assert right in text
    with pytest.raises(ProfileError, match=message):
        parse(text.replace(right, wrong, 1).encode(), "mine", "mine")


def test_a_brush_belongs_to_its_dialect() -> None:
    for profile, other in (("robot_brush", "watercolorbot"), ("watercolorbot", "robot_brush")):
        with pytest.raises(ValueError, match=r"dialect .* has .*, no "):
            msgspec.structs.replace(load_profile(profile), tool=load_profile(other).tool)


@pytest.mark.parametrize(("name", "begins"), [("watercolorbot", 77.28), ("robot_brush", 90)])
def test_no_stroke_lies_among_the_wells(name: str, begins: float) -> None:
    """A stroke that begins 5 mm left of the paper is refused, though the machine gets there; wells are visited."""
    profile = load_profile(name)
    with pytest.raises(PlotError, match=rf"5\.00 mm beyond the travel of {name}, X {begins:g}\.\."):
        program(drawing([BAR - (55, 0)]), profile)
    assert encode(program(drawing([BAR - (50, 0)]), profile))
    outside = msgspec.structs.replace(profile.machine, draw_x_mm=None)
    assert program(drawing([BAR - (55, 0)]), msgspec.structs.replace(profile, machine=outside))


def test_every_change_of_height_is_one_step_of_the_way() -> None:
    """Up from a line or a pot, down to one: with a wait; and never two commands for the same height."""
    commands = encode(program(drawing(LINES, widths=np.full(6, 6.0)), BOT)).decode().split("\r")
    sweeps = [command.split(",")[1] for command in commands if command.startswith("S2")]
    assert all(a != b for a, b in pairwise(sweeps))
