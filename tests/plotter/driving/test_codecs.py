"""What codecs send and understand: windows, whitelists, lost and stray answers, other machines on the port."""

from __future__ import annotations

from pathlib import Path

import pytest
from rehearsal import check, rehearse, short_job

from strokeplan.errors import DriveError
from strokeplan.plotter.driving.codec import Codec, Fault, Fence, Fenced, WrongDeviceError, recognise
from strokeplan.plotter.driving.codecs import codec_for
from strokeplan.plotter.driving.codecs.ebb import volts
from strokeplan.plotter.driving.codecs.grbl import GrblCodec
from strokeplan.plotter.driving.codecs.marlin import framed
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.units import script
from strokeplan.plotter.simulating import faults as wrong
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort

ONE_EACH = ("grbl_servo", "ender3", "axidraw_v3", "hp7475a", "uarm_swift_pro")


def codec_of(name: str) -> Codec:
    job = short_job(name, 1)
    return codec_for(job.profile, script(job).phrases(0))


def greeted(name: str, at: str, variant: str | None = None) -> str:
    port = SimulatedPort(firmware(short_job(at, 1).profile, variant=variant))
    return codec_of(name).greet(Link(port))


@pytest.mark.parametrize("name", ONE_EACH)
@pytest.mark.parametrize("other", ONE_EACH[:3])
def test_another_machine_on_the_port_is_refused_by_name(name: str, other: str) -> None:
    if name == other:
        assert greeted(name, name)
        return
    with pytest.raises(WrongDeviceError, match=f"answers as {'GRBL|Marlin|EBB'}"):
        greeted(name, other)


@pytest.mark.parametrize("name", ONE_EACH)
def test_a_port_where_nobody_answers_is_an_error_within_a_minute(name: str) -> None:
    class Silence:
        time = 0.0

        def write(self, data: bytes) -> int:
            return len(data)

        def read(self, timeout_s: float) -> bytes:
            self.time += timeout_s
            return b""

        def now(self) -> float:
            return self.time

        def close(self) -> None:
            pass

    port = Silence()
    with pytest.raises(DriveError, match="no answer"):
        codec_of(name).greet(Link(port))
    assert port.time < 60


@pytest.mark.parametrize("name", ONE_EACH)
@pytest.mark.parametrize(
    "command",
    ["$100=80", "$RST=*", "M500", "M502", "M28 x.g", "M30", "G10 L20 P1 X0", "M997", "\x1b.K", "SL,3", "RB", "BL",
     "CU,1,1", "G92 X0", "G1 X1\n$H", "", "ST,name", "IP0,0,1,1;", "M2", "M112", "G28.1", "#1 G0", "N1 G0*3"],
)  # fmt: skip
def test_no_plan_makes_a_codec_send_settings_files_or_firmware(name: str, command: str) -> None:
    with pytest.raises(DriveError, match="not sent"):
        codec_of(name).check(command)


def test_what_machines_say_tells_which_they_are() -> None:
    assert recognise("Grbl 1.1h ['$' for help]") == "GRBL"
    assert recognise("FIRMWARE_NAME:Marlin 2.1") == "Marlin"
    assert recognise("EBBv13_and_above EB Firmware Version 2.8.1") == "EBB"
    assert recognise("@1") == "uArm"
    assert recognise("ok") is None


# GRBL


def grbl() -> GrblCodec:
    codec = codec_of("grbl_servo")
    assert isinstance(codec, GrblCodec)
    codec.link, codec.tagged = Link(SimulatedPort(firmware(short_job("grbl_servo", 1).profile))), True
    return codec


def test_grbl_never_has_more_bytes_on_their_way_than_the_buffer_holds() -> None:
    codec, answered = grbl(), 0
    for k in range(200):
        while not codec.take(f"G1 X{k} Y{k}", 0.0):
            codec.feed(b"ok\r\n", 0.0)
            answered += 1
        size = sum(one.size for one in codec.sent)
        assert size == codec.used <= 127
        assert len(codec.sent) == k + 1 - answered
    assert codec.used > 127 - 12


def fence(codec: GrblCodec, key: int) -> None:
    assert codec.take("G1 X1 Y1 F500", 0.0)
    assert codec.take("M5", 0.0)
    assert codec.take(Fence(key), 0.0)


def test_grbl_fences_are_proven_by_what_they_show_and_not_by_an_ok() -> None:
    codec = grbl()
    fence(codec, 7)
    assert codec.out.decode().split("\n")[2:4] == ["G4 P0.01 T1", "$G"]
    assert codec.feed(b"ok\r\nok\r\nok\r\n", 0.0) == []
    assert codec.feed(b"[GC:G1 G54 G17 G21 G90 G94 M5 M9 T1 F500 S0]\r\n", 0.0) == [Fenced(7)]


def test_grbl_makes_up_for_an_answer_that_was_lost() -> None:
    codec = grbl()
    fence(codec, 1)
    assert codec.feed(b"ok\r\no\xffk\r\nok\r\n[GC:G1 T1 F500 S0]\r\nok\r\n", 0.0) == [Fenced(1)]
    assert codec.used == 0
    assert not codec.sent


def test_grbl_stops_for_an_answer_too_many_and_for_a_feed_that_was_forgotten() -> None:
    codec = grbl()
    fence(codec, 1)
    events = codec.feed(b"ok\r\nok\r\nok\r\nok\r\n[GC:G1 T1 F500 S0]\r\n", 0.0)
    assert [type(event) for event in events] == [Fault]
    codec = grbl()
    fence(codec, 1)
    events = codec.feed(b"[GC:G0 T1 F0 S0]\r\n", 0.0)
    assert isinstance(events[0], Fault)
    assert events[0].kind == "reset"


def test_grbl_asks_again_for_the_last_fence() -> None:
    codec = grbl()
    fence(codec, 3)
    codec.outgoing(0.0)
    codec.feed(b"ok\r\nok\r\nok\r\n[GC:G1 Tx F500 S0]\r\nok\r\n", 0.0)
    assert b"$G\n" in codec.outgoing(0.5)
    assert codec.feed(b"[GC:G1 T1 F500 S0]\r\nok\r\n", 0.6) == [Fenced(3)]


def test_grbl_uses_the_buffer_that_the_machine_tells_of() -> None:
    codec = codec_of("grblhal")
    codec.greet(Link(SimulatedPort(firmware(short_job("grblhal", 1).profile))))
    assert isinstance(codec, GrblCodec)
    assert codec.room == 1023


def test_a_locked_grbl_is_not_moved_before_it_is_homed() -> None:
    port = SimulatedPort(firmware(short_job("grbl_servo", 1).profile, variant="grbl-homing"))
    codec, link = codec_of("grbl_servo"), Link(port)
    codec.greet(link)
    with pytest.raises(DriveError, match="--home"):
        codec.start(link)
    codec.home(link)
    codec.start(link)


# Marlin


def test_lines_of_marlin_have_the_checksum_of_its_manual() -> None:
    assert framed(3, "T0") == b"N3 T0*57\n"
    assert framed(0, "M110 N0") == b"N0 M110 N0*125\n"


@pytest.mark.parametrize("variant", ["marlin", "marlin-no-ok-after-resend", "marlin-emergency-parser"])
def test_marlin_sends_again_what_was_damaged_and_what_was_not_answered(variant: str, tmp_path: Path) -> None:
    job = short_job("ender3")
    bad = wrong.Faults(
        (
            wrong.Fault("corrupt-bytes", 400, "bytes"),
            wrong.Fault("drop-bytes", 600, "bytes", 3),
            wrong.Fault("drop-reply", 60, "lines"),
            wrong.Fault("corrupt-reply", 75, "lines"),
            wrong.Fault("duplicate-reply", 90, "lines"),
        )
    )
    result = rehearse(job, tmp_path, faults=bad, variant=variant)
    assert len(result.runs) == 1
    check(result)


def test_marlin_goes_back_to_a_line_whose_ok_was_another_ones() -> None:
    codec = codec_of("ender3")
    codec.link = Link(SimulatedPort(firmware(short_job("ender3", 1).profile)))  # type: ignore[attr-defined]
    for k in range(3):
        assert codec.take(f"G1 X{k} Y0", 0.0)
        codec.feed(b"ok\n", 0.0)
    assert codec.take("G1 X9 Y9", 0.0)
    codec.outgoing(0.0)
    assert codec.feed(b"Error:expected line 2 got 4\nResend: 2\nok\n", 0.0) == []
    sent = []
    for _ in range(3):
        sent.append(codec.outgoing(1.0))
        assert codec.feed(b"ok\n", 1.0) == []
    assert sent == [framed(2, "G1 X1 Y0"), framed(3, "G1 X2 Y0"), framed(4, "G1 X9 Y9")]
    for number, kind in ((1, "reset"), (77, "confused")):
        (event,) = codec.feed(b"Resend: %d\n" % number, 2.0)
        assert isinstance(event, Fault)
        assert event.kind == kind


# EBB


def test_the_supply_of_the_motors_is_read_as_the_maker_says() -> None:
    assert volts(300) == pytest.approx(9.2, abs=0.05)
    assert volts(8) < 1


@pytest.mark.parametrize("variant", ["ebb-2.5", "ebb-3.0", "ebb-3.0-future"])
def test_all_kinds_of_ebb_draw(variant: str, tmp_path: Path) -> None:
    check(rehearse(short_job("axidraw_v3", 2), tmp_path, variant=variant))


def test_an_ebb_without_power_is_not_begun() -> None:
    port = SimulatedPort(firmware(short_job("axidraw_v3", 1).profile))
    port.device.supply = False  # type: ignore[attr-defined]
    with pytest.raises(DriveError, match="no power"):
        codec_of("axidraw_v3").greet(Link(port))


# HP-GL


@pytest.mark.parametrize("variant", ["7475A", "7470A", "DXY"])
def test_nothing_overflows_in_a_pen_plotter(variant: str, tmp_path: Path) -> None:
    result = rehearse(short_job("hp7475a"), tmp_path, variant=variant)
    check(result)
    assert result.port.device.io_error == 0  # type: ignore[attr-defined]


def test_a_board_that_does_not_start_anew_keeps_its_place(tmp_path: Path) -> None:
    """The cable is pulled and put in again; nobody moves the carriage, and nobody is told to."""
    job = short_job("grbl_servo")
    device = firmware(job.profile, variant="grbl-no-reset")
    port = SimulatedPort(device)
    codec, link = codec_of("grbl_servo"), Link(port)
    codec.greet(link)
    assert not codec.kept  # it was just switched on
    codec.start(link)
    codec.say(link, ("G0 X20 Y30",))
    port = port.reopen(1.0)
    codec, link = codec_of("grbl_servo"), Link(port)
    codec.greet(link)
    assert codec.kept
    codec.start(link)
    codec.say(link, ("G0 X21 Y30",))
    assert device.place_mm == pytest.approx((21.0, 30.0), abs=0.02)


def test_boards_that_are_reset_by_their_port_must_be_put_to_the_origin() -> None:
    for name, kept in (("grbl_servo", False), ("ender3", False), ("axidraw_v3", False), ("hp7475a", True)):
        codec = codec_of(name)
        codec.greet(Link(SimulatedPort(firmware(short_job(name, 1).profile))))
        assert codec.kept is kept


def test_marlin_must_be_where_the_line_ends() -> None:
    for told, kind in ((b"X:3.00 Y:4.01 Z:0.00\n", Fenced), (b"X:3.00 Y:0.00 Z:0.00\n", Fault)):
        codec = codec_of("ender3")
        codec.link = Link(SimulatedPort(firmware(short_job("ender3", 1).profile)))  # type: ignore[attr-defined]
        for item in ("G0 X1 Y2", "G1 X3 Y4 F500", Fence(5)):
            assert codec.take(item, 0.0)
            codec.feed(b"ok\n", 0.0)
        (event,) = codec.feed(told, 0.0)
        assert isinstance(event, kind)
