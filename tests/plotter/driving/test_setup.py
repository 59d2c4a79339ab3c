"""Set-up sessions against simulated machines: moves, the pen, stops. What counts is where the pen truly is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from drawings import EYE, SWAN, drawing, drawn
from machines import Port, session

from strokeplan.errors import DeviceLost, DriveError, InputError, PlotError
from strokeplan.plotter.driving.codec import Locator
from strokeplan.plotter.driving.setup import Session, bench, corners, towards
from strokeplan.plotter.driving.tuning import tried
from strokeplan.plotter.profile import load_profile, names
from strokeplan.plotter.program import PlotOptions, program

MACHINES = (
    "grbl_servo", "grbl_z", "fluidnc", "grblhal", "idraw_2", "ender3", "axidraw_v3", "nextdraw_2234", "hp7475a",
    "uarm_swift_pro", "watercolorbot",
)  # fmt: skip
NEAR_MM = 0.03


def near(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return bool(np.allclose(a[:2], b[:2], rtol=0, atol=NEAR_MM))


def run(made: Session, port: Port, *steps: Callable[[], object]) -> None:
    """A session from its beginning to whatever ends it."""
    with made.safely(port.watch):
        made.begin()
        for step in steps:
            step()


def pressed(port: Port, *after_s: float) -> Callable[[], None]:
    """Ctrl-C so much later."""
    return lambda: port.presses.extend(port.now() + s for s in after_s)


def far(made: Session) -> Callable[[], None]:
    return lambda: made.go(200, 180)


def bug() -> None:
    raise ValueError("bug")


def inside(name: str) -> tuple[float, float]:
    """A place within the travel, 20 mm from its lower ends."""
    machine = load_profile(name).machine
    return machine.x_mm[0] + 20, machine.y_mm[0] + 20


@pytest.mark.parametrize("name", MACHINES)
def test_moves_are_made_pen_up_and_true(name: str) -> None:
    made, port = session(name)
    with made.safely(port.watch):
        made.begin()
        x, y = inside(name)
        made.go(x, y)
        assert near(port.device.place_mm, (x, y))
        made.go(x + 7.5, y - 3)
        assert near(port.device.place_mm, (x + 7.5, y - 3))
        assert not port.lowered
        made.lower()
        assert port.device.pen_down
        made.go(x, y)
    assert near(port.device.place_mm, (x, y))
    assert not port.device.pen_down
    assert port.device.forbidden == ()
    assert all(np.ptp(line, axis=0).max() < NEAR_MM for line in port.device.drawn.lines)  # a dot where it was lowered


@pytest.mark.parametrize("name", ["grbl_servo", "ender3", "hp7475a", "uarm_swift_pro"])
def test_machines_say_where_they_stand(name: str) -> None:
    made, port = session(name)
    with made.safely(port.watch):
        made.begin()
        made.go(*inside(name))
        made.at = (0.0, 0.0)
        made.begin()
    assert made.told
    assert near(made.at, inside(name))


@pytest.mark.parametrize("mask", ["0", "1", "2", "3"])
def test_grbl_reports_of_all_kinds_are_read(mask: str) -> None:
    """$10: MPos or WPos, with the offset now and then."""
    made, port = session("grbl_servo")
    port.device.settings["10"] = mask  # type: ignore[attr-defined]
    made.begin()
    made.go(30, 20)
    made.put(1, 2)
    made.at = (0, 0)
    made.begin()
    assert near(made.at, (1, 2))


def test_places_beyond_the_travel_are_refused_before_a_byte() -> None:
    made, port = session("grbl_servo")
    made.begin()
    before = port.written
    with pytest.raises(
        PlotError, match=r"X300.5 Y10 is beyond the travel of grbl_servo, X 0..300, .*: X300.5 is 0.5 mm"
    ):
        made.go(300.5, 10)
    with pytest.raises(PlotError, match=r"Y-1 is 1 mm too far"):
        made.walk([(10, 10), (10, -1)])
    assert port.written == before


@pytest.mark.parametrize("name", ["grbl_servo", "ender3", "axidraw_v3", "hp7475a", "uarm_swift_pro"])
def test_an_error_within_leaves_the_pen_up(name: str) -> None:
    made, port = session(name)
    with pytest.raises(ValueError, match="bug"):
        run(made, port, made.lower, bug)
    assert not port.device.pen_down


@pytest.mark.parametrize("name", ["grbl_servo", "grbl_z", "axidraw_v3", "ender3", "hp7475a", "uarm_swift_pro"])
def test_ctrl_c_while_the_pen_is_down_raises_it(name: str) -> None:
    made, port = session(name)
    with pytest.raises(DriveError, match="stopped; the pen is up"):
        run(made, port, made.lower, pressed(port, 1), lambda: made.rest(60))
    assert not port.device.pen_down


@pytest.mark.parametrize("name", ["grbl_servo", "grbl_z", "fluidnc"])
def test_ctrl_c_stops_a_long_move_in_the_middle(name: str) -> None:
    made, port = session(name)
    with pytest.raises(DriveError, match=r"^stopped; the pen is up$"):
        run(made, port, pressed(port, 1), far(made))
    x, y = port.device.place_mm[:2]
    assert 20 < x < 180
    port.read(0.5)
    assert near(port.device.place_mm, (x, y))
    assert made.codec.place(made.link) == pytest.approx((x, y), abs=NEAR_MM)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "variant"),
    [("ender3", None), ("ender3", "marlin-emergency-parser"), ("axidraw_v3", None), ("nextdraw_2234", "ebb-3.0"),
     ("hp7475a", None), ("uarm_swift_pro", None)],
)  # fmt: skip
def test_ctrl_c_stops_every_machine_with_its_pen_up(name: str, variant: str | None) -> None:
    """Some finish their move, an EBB goes back to where it began: by dialect, docs/driving.md."""
    made, port = session(name, variant)
    with pytest.raises(DriveError, match=r"^stopped; the pen is up$"):
        run(made, port, pressed(port, 0.5), lambda: made.go(200, 90))
    assert not port.device.pen_down
    stood = port.device.place_mm
    port.read(0.5)
    assert near(port.device.place_mm, stood)
    if isinstance(made.codec, Locator):
        assert near(made.codec.place(made.link) or (), tuple(at / made.script.unit_mm for at in stood))
    else:
        assert near(stood, (0, 0))


def test_a_second_ctrl_c_is_the_emergency_stop() -> None:
    made, port = session("grbl_servo")
    with pytest.raises(DriveError, match="emergency stop: see to the pen"):
        run(made, port, pressed(port, 1, 1.01), far(made))
    assert port.written.endswith(b"!\x18")


def test_what_happens_to_the_machine_is_told() -> None:
    made, port = session("grbl_servo")
    device: Any = port.device
    with pytest.raises(DriveError, match=r"limit switch|locked"):
        run(made, port, lambda: device.alarm(1, port.now() + 1), far(made))
    assert not port.device.pen_down
    made, port = session("grbl_servo")
    device = port.device
    with pytest.raises(DeviceLost, match="see to the pen"):
        run(made, port, lambda: device.unplug(port.now() + 1), far(made))


def test_a_locked_machine_is_left_locked_until_it_is_homed() -> None:
    made, port = session("grbl_servo", "grbl-homing")
    with pytest.raises(DriveError, match="locked"), made.safely(port.watch):
        made.begin()
    assert b"$X" not in port.written
    with made.safely(port.watch):
        made.home()
        made.go(10, 10)
        assert near(port.device.place_mm, (10, 10))
        made.home()  # what was answered before is not taken for the end of the homing
        assert near(port.device.place_mm, (0, 0))
        made.go(12, 10)
    assert near(port.device.place_mm, (12, 10))


def test_machines_without_switches_say_so() -> None:
    made, port = session("axidraw_v3")
    with pytest.raises(DriveError, match="no switches"), made.safely(port.watch):
        made.home()
    assert not port.device.pen_down


@pytest.mark.parametrize("name", ["grbl_servo", "ender3"])
def test_an_origin_that_was_put_is_kept_by_a_stop(name: str) -> None:
    made, port = session(name)
    with pytest.raises(DriveError, match="the pen is up"):
        run(made, port, lambda: made.go(40, 30), made.put_corner, pressed(port, 0.5), far(made))
    x, y = port.device.place_mm[:2]
    assert made.codec.place(made.link) == pytest.approx((x - 40, y - 30), abs=NEAR_MM)  # type: ignore[attr-defined]
    assert port.device.forbidden == ()


def test_an_origin_outlasts_the_session_where_the_port_does_not_reset_the_board() -> None:
    made, port = session("grbl_servo", "grbl-no-reset")
    made.begin()
    made.go(40, 30)
    made.put_corner()
    again = type(made)(made.link, made.profile)
    again.link.transport = port.reopen(1.0)
    again.greet()
    again.begin()
    assert again.at == pytest.approx((0, 0), abs=1e-3)
    again.go(10, 5)
    assert near(port.device.place_mm, (50, 35))


@pytest.mark.parametrize(
    ("name", "why"),
    [("hp7475a", "move the sheet"), ("uarm_swift_pro", "its origin stays"), ("watercolorbot", "cannot be told")],
)
def test_machines_whose_origin_is_their_own(name: str, why: str) -> None:
    made, _ = session(name)
    made.begin()
    with pytest.raises(InputError, match=why):
        made.put_corner()


@pytest.mark.parametrize("name", ["grbl_servo", "ender3", "axidraw_v3", "hp7475a"])
def test_frame_walks_around_the_drawing_and_back(name: str) -> None:
    """Where the pen was: the box of the drawing's densely flattened curves, and the place it began at."""
    size = (297.0, 210.0) if name == "hp7475a" else (100.0, 80.0)
    plan = drawing([SWAN + 15, EYE + 15], size)
    made, port = session(name)
    job = program(plan, made.profile, PlotOptions(keep_order=True))
    expected = job.transform.points(np.concatenate(drawn(plan)))
    made.begin()
    first = expected.min(axis=0)
    made.go(float(first[0]), float(first[1]))
    port.places.clear()
    made.walk(corners(job))
    been = np.array(port.places)
    assert been.min(axis=0) == pytest.approx(expected.min(axis=0), abs=0.1)
    assert been.max(axis=0) == pytest.approx(expected.max(axis=0), abs=0.1)
    assert near(port.device.place_mm, tuple(first))
    assert not port.lowered


@pytest.mark.parametrize(
    ("name", "key", "value", "said"),
    [
        ("grbl_servo", "down_pwm", 410, b"M3 S410\n"),
        ("grbl_z", "down_mm", -0.5, b"G1 Z-0.5 F"),
        ("ender3", "down_mm", 0.25, b"G1 Z0.25 F"),
        ("axidraw_v3", "down_percent", 20, b"SC,5,13450\r"),  # 9855 + 0.2 · (27831 − 9855)
        ("nextdraw_2234", "down_percent", 20, b"SC,5,"),
    ],
)
def test_a_height_that_is_tried_reaches_the_machine(name: str, key: str, value: float, said: bytes) -> None:
    made, port = session(name)
    with made.safely(port.watch):
        made.begin()
        made.lower()
        before = port.written
        made.use(tried(made.profile, key, value))
        assert said in port.written[len(before) :]
    assert not port.device.pen_down


def test_every_machine_that_can_be_driven_has_a_bench() -> None:
    """Phrases to begin with, to raise and to lower, also of those with brushes."""
    for name in names():
        profile = load_profile(name)
        try:
            made = bench(profile)
        except PlotError:
            assert profile.dialect.flavour == "linuxcnc"  # type: ignore[union-attr]
            continue
        phrases = made.phrases(0)
        assert phrases.up
        assert phrases.down
        assert phrases.up != phrases.down
        assert list(made.travel((0.0, 0.0), (5.0, 5.0)))


def test_arrows_go_as_one_looks_at_the_page() -> None:
    assert towards(load_profile("grbl_servo"), "up") == (0.0, 1.0)
    assert towards(load_profile("axidraw_v3"), "up") == (0.0, -1.0)
    assert towards(load_profile("uarm_swift_pro"), "right") == (0.0, -1.0)
    assert towards(load_profile("uarm_swift_pro"), "up") == (1.0, 0.0)
