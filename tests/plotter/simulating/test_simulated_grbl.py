"""The simulated GRBL against what its documentation says, byte by byte.

Transcripts: GRBL 1.1 wiki, "Interface" and "Commands".
"""

from __future__ import annotations

import pytest
from hosts import Host
from hypothesis import given, settings
from hypothesis import strategies as st

from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.simulating.grbl import Grbl


def board(**options: object) -> Host:
    profile = load_profile("grbl_servo")
    return Host(profile, Grbl(profile, **options))  # type: ignore[arg-type]


def test_it_greets_after_its_boot_loader_and_hears_nothing_before() -> None:
    host = board()
    assert host.greeting == "\r\nGrbl 1.1h ['$' for help]\r\n"
    host.port = host.port.reopen()
    assert "ok" not in host.ask("G21\n", 1.0)
    assert host.hear(2.0) == "\r\nGrbl 1.1h ['$' for help]\r\n"


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        ("\n", "ok\r\n"), ("G0 X1\r\n", "ok\r\nok\r\n"), ("(hello) ; there\n", "ok\r\n"), ("g1x1f100 \n", "ok\r\n"),
        ("$I\n", "[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"),
        ("$G\n", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n"),
        ("HELLO\n", "error:2\r\n"), ("1\n", "error:1\r\n"), ("G5 X1\n", "error:20\r\n"), ("G1 X1\n", "error:22\r\n"),
        ("G0 G1 X1\n", "error:21\r\n"), ("G0 X1 X2\n", "error:25\r\n"), ("G0 X1 Q2\n", "error:20\r\n"),
        ("G2 X2 Y0 I5 F100\n", "error:33\r\n"), ("G2 X2 Y0 F100\n", "error:35\r\n"),
        ("G2 X9 Y0 R1 F100\n", "error:34\r\n"),
        ("G4\n", "error:28\r\n"), ("G0 I1\n", "error:36\r\n"), ("F-1\n", "error:4\r\n"), ("G92\n", "error:26\r\n"),
        ("G10 L2 P9 X0\n", "error:29\r\n"), ("G80 X1\n", "error:31\r\n"), ("T256\n", "error:38\r\n"),
        ("G1 F100 X" + "0" * 69 + "1\n", "ok\r\n"), ("G1 F100 X" + "0" * 74 + "1\n", "error:11\r\n"),
        ("$H\n", "error:5\r\n"), ("$FOO\n", "error:2\r\n"), ("$J=X1\n", "error:22\r\n"), ("$X\n", "ok\r\n"),
    ],
)  # fmt: skip
def test_replies(line: str, reply: str) -> None:
    assert board().ask(line) == reply


def test_status_reports_carry_offsets_and_overrides_now_and_then() -> None:
    host = board()
    reports = [host.ask("?") for _ in range(12)]
    assert reports[0] == "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"
    assert reports[1] == "<Idle|MPos:0.000,0.000,0.000|FS:0,0|Ov:100,100,100>\r\n"
    assert reports[2] == "<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
    assert sum("WCO" in report for report in reports) == 2
    host.ask("$10=2\n")
    host.ask("G92 X5\n")
    assert host.ask("?").startswith("<Idle|WPos:5.000,0.000,0.000|Bf:15,128|FS:0,0|WCO:-5.000")


def test_the_ring_of_128_bytes_loses_what_does_not_fit() -> None:
    """While a dwell runs 128 bytes wait; the next ones are lost without a word."""
    host = board()
    host.port.write(b"G4 P2\n")
    host.hear(0.5)
    host.port.write(b"G91\n" * 40)  # 160 bytes
    replies = host.hear(5.0)
    assert replies == "ok\r\n" * 33  # the dwell's, and 32 whole lines of the ring
    assert host.device.lost == 32


def test_character_counting_within_the_ring_loses_nothing_and_keeps_order() -> None:
    host = board()
    lines = [f"G1 X{k % 7} Y{k % 5} F6000\n".encode() for k in range(1, 200)]
    sent, waiting, used = [], list(lines), 0
    host.port.read(0)
    while waiting or sent:
        while waiting and used + len(waiting[0]) <= 128:
            used += len(waiting[0])
            host.port.write(waiting[0])
            sent.append(waiting.pop(0))
        came = host.port.read(10.0)
        assert came
        for _ in range(came.count(b"\n")):
            used -= len(sent.pop(0))
    host.hear(20)
    assert host.device.received == [line.decode().strip().replace(" ", "") for line in lines]
    assert host.device.lost == 0


def test_the_planner_holds_15_blocks_and_then_answers_wait() -> None:
    host = board()
    host.ask("$10=3\n")
    replies = host.ask("".join(f"G1 X{k * 10} F60\n" for k in range(1, 8)) + "".join(f"X{k}\n" for k in range(20)), 3.0)
    assert replies == "ok\r\n" * 15
    assert "|Bf:0," in host.ask("?")


def test_a_hold_keeps_the_place_and_a_reset_in_it_too() -> None:
    host = board()
    host.ask("G1 X100 F6000\n", 0.5)
    assert host.ask("!", 0.05) == ""
    assert host.ask("?", 0.02).startswith("<Hold:1|")
    host.hear(1.0)
    assert host.ask("?", 1.0).startswith("<Hold:0|")
    assert host.ask("G1 X0\n") == ""  # nothing is parsed while it holds
    x = host.device.place_mm[0]
    assert 10 < x < 90
    assert host.ask("\x18") == "\r\nGrbl 1.1h ['$' for help]\r\n"
    assert host.ask("?").startswith(f"<Idle|MPos:{x:.3f},")
    assert host.device.slip == (0.0, 0.0)


def test_a_held_move_is_finished_after_cycle_start() -> None:
    host = board()
    host.ask("G1 X100 F6000\nG1 Y10\n", 0.5)
    host.ask("!", 1.0)
    host.ask("~", 3.0)
    assert host.device.place_mm == pytest.approx((100, 10))
    assert host.ask("?").startswith("<Idle|")


def test_a_reset_while_it_moves_loses_the_place_and_locks() -> None:
    host = board()
    host.ask("G1 X100 F6000\n", 0.5)
    said = host.ask("\x18", 0.1)
    assert said == "ALARM:3\r\n"
    assert host.hear(1.0) == "\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n"
    assert host.device.slip[0] > 1  # it ran on; the count does not know
    assert host.ask("G0 X0\n") == "error:9\r\n"
    assert host.ask("$X\n") == "[MSG:Caution: Unlocked]\r\nok\r\n"
    host.ask("G0 X0\n", 5.0)
    assert host.device.place_mm[0] > 1


def test_homing_makes_the_place_true_again() -> None:
    host = board(homing=True, at_mm=(30.0, 40.0))
    assert host.greeting.endswith("[MSG:'$H'|'$X' to unlock]\r\n")
    assert host.ask("$H\n", 0.5) == ""
    assert host.ask("?", 3.0) == ""  # nobody answers while it homes
    assert host.hear(5.0).startswith("ok\r\n")
    assert host.device.place_mm == (0.0, 0.0)


def test_soft_limits_stop_before_the_travel_and_wait_for_a_reset() -> None:
    host = board(homing=True, soft_limits=True)
    host.ask("$X\n")
    assert host.ask("$J=X-5 F1000\n") == "error:15\r\n"
    assert host.ask("G0 X500\n", 2.0) == "ALARM:2\r\n[MSG:Reset to continue]\r\n"
    assert host.ask("?\n$X\n") == ""
    assert "unlock" in host.ask("\x18")


def test_a_soft_reset_forgets_g92_and_turns_the_servo_off() -> None:
    host = board()
    host.ask("G92 X7\nM3 S300\n", 2.0)
    assert host.device.pen_down
    host.ask("\x18", 2.0)
    assert not host.device.pen_down
    assert "[G92:0.000,0.000,0.000]" in host.ask("$#\n")


def test_bytes_are_lost_while_the_eeprom_is_written() -> None:
    host = board()
    assert host.ask("$11=0.02\nG91\nG90\nG91\n").count("ok") < 4
    assert host.device.lost > 0
    assert host.device.forbidden == ("$11=0.02",)


def test_a_board_that_is_switched_off_stops_where_it_is_and_forgets() -> None:
    host = board()
    host.ask("M3 S300\nG4 P1\nG1 X100 F1000\n", 3.0)
    host.device.power_cut(host.port.now())
    place = host.device.place_mm
    assert host.device.pen_down
    host.port = host.port.reopen(60.0)
    assert "Grbl" in host.hear(3.0)
    assert host.device.place_mm == place
    assert host.ask("?").startswith("<Idle|MPos:0.000,0.000,0.000|")
    assert not host.device.pen_down  # no pulse: the servo lifts it
    assert host.device.drawn.rests


def test_the_tool_number_lasts_for_its_line() -> None:
    host = board()
    assert " T5 " in host.ask("G4 P0.01 T5\n$G\n")
    assert " T0 " in host.ask("T5\nG90\n$G\n")
    kept = Host("fluidnc")
    assert " T5 " in kept.ask("T5\nG90\n$G\n")


@settings(max_examples=60)
@given(st.binary(max_size=200))
def test_no_bytes_break_it(data: bytes) -> None:
    """Any bytes: the board goes on, and after a reset it answers as ever."""
    host = board(boot_s=0.01)
    host.ask(data, 1.0)
    host.ask("\x18", 2.0)
    host.ask("$X\n", 1.0)
    assert host.ask("G21\n").endswith("ok\r\n")
