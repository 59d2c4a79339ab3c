"""The simulated EiBotBoard against its command reference: replies to the byte, the FIFO, USB that waits."""

from __future__ import annotations

import pytest
from hosts import Host
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        ("V", "EBBv13_and_above EB Firmware Version 2.8.1\r\n"), ("QB", "0\r\nOK\r\n"), ("QC", "0394,0300\r\nOK\r\n"),
        ("QG", "10\r\n"), ("QM", "QM,0,0,0,0\n\r"), ("QS", "0,0\n\rOK\r\n"), ("EM,1,1", "OK\r\n"), ("SP,1", "OK\r\n"),
        ("ES", "0,0,0,0,0\n\rOK\r\n"), ("XX", "!8 Err: Unknown command 'XX:5858'\r\n"),
        ("SM,0,1,1", "!6 Err: Invalid parameter value\r\n"),
        ("\r\n", ""), ("QU,2", "!8 Err: Unknown command 'QU:5155'\r\n"),
    ],
)  # fmt: skip
def test_legacy_replies(command: str, reply: str) -> None:
    assert Host("axidraw_v3").ask(f"{command}\r") == reply


def test_future_syntax_is_left_on_until_it_is_switched_off() -> None:
    host = Host("nextdraw_2234", variant="ebb-3.0-future")
    assert host.ask("V\r") == "V,EBBv13_and_above EB Firmware Version 3.0.3\n"
    assert host.ask("QG\rSP,1\r") == "QG,10\nSP\n"
    host.port = host.port.reopen()
    assert host.ask("QB\r") == "QB,0\n"
    assert host.ask("CU,10,0\r") == "OK\r\n"
    assert host.ask("QB\r") == "0\r\nOK\r\n"


def test_old_boards_have_no_general_query() -> None:
    assert Host("axidraw_v3", variant="ebb-2.5").ask("QG\r").startswith("!8 Err")


def test_one_move_runs_one_waits_one_stands_in_the_parser_and_usb_waits() -> None:
    host = Host("axidraw_v3")
    move = "SM,3000,800,0\r"
    assert host.ask(move * 3 + "ES\r", 1.0) == "OK\r\nOK\r\n"  # ES does not get in
    assert host.device.room() < 64
    host.port.write(b"QB\r" * 100)
    host.hear(0.5)
    assert host.device.room() == 0  # and the host's bytes stay with it
    assert host.hear(3.0).startswith("OK\r\n1,800,0,800,0\n\r")  # the second has just begun


def test_a_deeper_fifo_of_firmware_3() -> None:
    host = Host("nextdraw_2234", variant="ebb-3.0")
    assert host.ask("QU,2\r") == "QU,2,32\r\nOK\r\n"
    assert host.ask("CU,4,8\r") == "OK\r\n"
    assert host.ask("SM,3000,800,0\r" * 12, 1.0) == "OK\r\n" * 9
    assert host.ask("SP,3\r", 0.5) == ""  # behind a full FIFO nothing helps


@pytest.mark.parametrize(("command", "steps"), [("XM,500,160,80", (240, 80)), ("SM,500,160,80", (160, 80))])
def test_mixed_axes(command: str, steps: tuple[int, int]) -> None:
    host = Host("axidraw_v3")
    host.ask(f"{command}\r")
    assert host.ask("QS\r") == f"{steps[0]},{steps[1]}\n\rOK\r\n"
    x, y = (steps[0] + steps[1]) / 160, (steps[0] - steps[1]) / 160
    assert host.device.place_mm == pytest.approx((x, y))


def test_lm_lasts_as_its_rate_says() -> None:
    """LM's rate is 2³¹ · 40 µs · Hz: 1000 steps at 1000 Hz are a second."""
    host = Host("axidraw_v3")
    host.ask("LM,85899346,1000,0,85899346,1000,0\r", 0.9)
    assert host.ask("QM\r", 0.05) == "QM,1,1,1,0\n\r"
    host.hear(0.2)
    assert host.ask("QM\r") == "QM,0,0,0,0\n\r"


def test_home_is_where_the_counters_were_zeroed() -> None:
    host = Host("axidraw_v3")
    host.ask("XM,500,800,0\r")
    host.ask("EM,1,1\rXM,500,0,800\r", 2.0)
    host.ask("HM,2000\r", 3.0)
    assert host.device.place_mm == pytest.approx((10, 0))


def test_the_button_is_told_once() -> None:
    host = Host("axidraw_v3")
    host.device.press(host.port.now())
    assert host.ask("QG\r") == "30\r\n"
    assert host.ask("QB\r") == "0\r\nOK\r\n"


def test_without_the_motors_supply_steps_are_counted_and_nothing_moves() -> None:
    host = Host("nextdraw_2234", variant="ebb-3.0")
    host.device.alarm(1, host.port.now())
    host.ask("SM,500,800,800\r", 2.0)
    assert host.ask("QC\r") == "0394,0008\r\nOK\r\n"
    assert host.ask("QG\r") == "50\r\n"
    assert host.ask("QS\r").startswith("800,800")
    assert host.device.place_mm == (0.0, 0.0)


def test_emergency_stop_at_speed_loses_steps_and_slowly_none() -> None:
    for ms, lost in ((1000, True), (8000, False)):
        host = Host("axidraw_v3")
        host.ask(f"SM,{ms},16000,16000\r", ms / 2000)
        reply = host.ask("ES\r")
        assert reply.startswith("1,0,0,")
        assert (host.device.slip != (0.0, 0.0)) == lost
        left, done = int(reply.split(",")[3]), int(host.ask("QS\r").split(",")[0])
        assert left + done == 16000


def test_a_brush_is_down_at_and_below_the_height_where_it_touches() -> None:
    """The WaterColorBot's touches at 19550, 35 % of 15000..28000; another pin's servo is another one."""
    host = Host("watercolorbot")
    for pulse, pin, down in ((24100, 4, False), (20000, 4, False), (19550, 4, True), (18250, 4, True), (24100, 5, True),
                             (19600, 4, False)):  # fmt: skip
        host.ask(f"S2,{pulse},{pin},1177,300\r", 1.0)
        assert host.device.pen_down == down, pulse


def test_names_and_the_boot_loader_are_noted() -> None:
    host = Host("axidraw_v3")
    host.ask("ST,Me\rBL\rQT\r")
    assert host.device.forbidden == ("ST,ME", "BL")


@settings(max_examples=40)
@given(st.binary(max_size=200))
def test_no_bytes_break_it(data: bytes) -> None:
    host = Host("nextdraw_2234", variant="ebb-3.0")
    host.ask(data, 1.0)
    host.device.restart(host.port.now())
    host.port = host.port.reopen()
    host.hear(1.0)
    assert host.ask("\rV\r").endswith("EBBv13_and_above EB Firmware Version 3.0.3\r\n")
