"""The simulated Marlin against its documentation: numbers, checksums, Resend, busy, kill."""

from __future__ import annotations

import pytest
from hosts import Host
from hypothesis import given, settings
from hypothesis import strategies as st


def numbered(n: int, text: str) -> str:
    line, check = f"N{n} {text}", 0
    for char in line:
        check ^= ord(char)
    return f"{line}*{check}\n"


def test_it_says_start_and_who_it_is() -> None:
    host = Host("ender3")
    assert host.greeting.startswith("start\n")
    reply = host.ask("M115\n")
    assert reply.startswith("FIRMWARE_NAME:Marlin 2.")
    assert "Cap:EMERGENCY_PARSER:0\n" in reply
    assert reply.endswith("\nok\n")


def test_a_checksum_of_the_documentation() -> None:
    """Marlin's own example: N123 G0 X… with its XOR of all bytes before the star."""
    host = Host("ender3")
    assert host.ask("N0 M110 N0*125\n") == "ok\n"


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("N4 G21*27\n", "Line Number is not Last Line Number+1"), ("N3 G21*1\n", "checksum mismatch"),
        ("N3 G21\n", "No Checksum with line number"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("ok", ["ok\n", ""])
def test_a_damaged_line_is_asked_for_again(line: str, error: str, ok: str) -> None:
    host = Host("ender3", variant="marlin" if ok else "marlin-no-ok-after-resend")
    host.ask(numbered(0, "M110 N0") + numbered(1, "G21") + numbered(2, "G90"))
    assert host.ask(line) == f"Error:{error}, Last Line: 2\nResend: 3\n{ok}"
    assert host.ask(numbered(3, "G21")) == "ok\n"


def test_m110_sets_the_number_with_or_without_one_of_its_own() -> None:
    host = Host("ender3")
    assert host.ask("M110 N20\n" + numbered(21, "G21")) == "ok\nok\n"
    assert host.ask(numbered(7, "M110 N3") + numbered(4, "G21")) == "ok\nok\n"


def test_it_takes_four_commands_and_a_ring_and_loses_the_rest() -> None:
    host = Host("ender3")
    host.ask("G4 S5\n", 0.5)
    host.port.write(b"G91\n" * 60)
    assert host.hear(10.0).count("ok") < 50
    assert host.device.lost > 0


def test_long_lines_are_cut_without_a_word() -> None:
    host = Host("ender3")
    assert host.ask("G1 X1 F600" + " " * 90 + "Y5\n") == "ok\n"
    host.hear(2.0)
    assert host.device.place_mm == (1.0, 0.0)


def test_it_says_busy_while_it_waits_for_moves() -> None:
    host = Host("ender3")
    said = host.ask("G1 X100 F600\nM400\n", 12.0)
    assert said == "ok\n" + "echo:busy: processing\n" * 5 + "ok\n"


def test_a_pause_waits_for_its_user() -> None:
    host = Host("ender3")
    assert host.ask("M0\n", 5.0).count("echo:busy: paused for user\n") == 2
    assert host.ask("M108\n").startswith("ok\n")


@pytest.mark.parametrize(("variant", "at_once"), [("marlin", False), ("marlin-emergency-parser", True)])
def test_m112_gets_through_full_buffers_only_with_the_emergency_parser(variant: str, at_once: bool) -> None:
    host = Host("ender3", variant=variant)
    host.ask("G4 S20\n" * 6, 1.0)
    killed = "kill() called" in host.ask("M112\n", 1.0)
    assert killed == at_once


def test_killed_it_is_silent_until_it_is_reset() -> None:
    host = Host("ender3")
    assert host.ask("M112\n") == "Error:Printer halted. kill() called!\n"
    assert host.ask("M115\n") == ""
    host.port = host.port.reopen()
    assert host.hear(3.0).startswith("start\n")


def test_settings_and_files_are_noted() -> None:
    host = Host("ender3")
    host.ask("M500\nM92 X80\nM28 a.g\nM30 a.g\nG21\nM400\n")
    assert host.device.forbidden == ("M500", "M92 X80", "M28 a.g", "M30 a.g")


@settings(max_examples=40)
@given(st.binary(max_size=200).filter(lambda data: b"112" not in data))
def test_no_bytes_break_it(data: bytes) -> None:
    host = Host("ender3")
    host.ask(data + b"\n", 1.0)
    host.port = host.port.reopen()
    host.hear(3.0)
    assert host.ask("G21\n") == "ok\n"
