"""Ports by their USB ids, by asking, and the one that is meant by auto."""

from __future__ import annotations

import os
import termios
from collections.abc import Sequence
from types import SimpleNamespace

import pytest
from machines import Port as Simulated

from strokeplan.errors import DeviceLost, InputError, PlotError
from strokeplan.plotter.driving import ports
from strokeplan.plotter.driving.codecs import baud_of, codec_for
from strokeplan.plotter.driving.ports import IDS, Port, ask, chosen, family, keep_awake, recognised
from strokeplan.plotter.driving.setup import bench
from strokeplan.plotter.driving.transport import FilePort
from strokeplan.plotter.profile import load_profile, names
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort


def listed(name: str, vendor: int | None, product: int | None, text: str) -> SimpleNamespace:
    """A port as pyserial lists it."""
    return SimpleNamespace(device=name, vid=vendor, pid=product, description=text)


def test_ids_tell_what_they_can() -> None:
    found = recognised(
        [
            listed("/dev/ttyUSB1", 0x1A86, 0x7523, "USB Serial"),
            listed("/dev/ttyACM0", 0x04D8, 0xFD92, "EiBotBoard"),
            listed("/dev/ttyACM1", 0x2341, 0x0043, "ttyACM1"),
            listed("/dev/ttyACM2", 0x1234, 0x5678, "n/a"),
            listed("/dev/ttyACM3", 0x1D50, 0x0001, "EiBotBoard,Bertha"),
            listed("/dev/ttyS0", None, None, "ttyS0\x1b[31m"),
        ]
    )
    assert [port.device for port in found] == sorted(port.device for port in found)
    told = {port.device: port.describe() for port in found}
    assert told["/dev/ttyACM0"] == "04D8:FD92 EiBotBoard: EBB"
    assert told["/dev/ttyACM1"] == "2341:0043 Arduino: GRBL or Marlin or uArm (ttyACM1)"
    assert told["/dev/ttyACM2"] == "1234:5678 not known"
    assert told["/dev/ttyACM3"] == "1D50:0001 EiBotBoard: EBB (EiBotBoard,Bertha)"
    assert told["/dev/ttyS0"] == "not known (ttyS0[31m)"  # nothing that steers a terminal
    assert told["/dev/ttyUSB1"] == "1A86:7523 CH340: GRBL or Marlin or uArm or HP-GL (USB Serial)"


def port(name: str, vendor: int, product: int) -> Port:
    return Port(name, "", f"{vendor:04X}:{product:04X}", *IDS[vendor, product])


EBB, CH340, FTDI = port("A", 0x04D8, 0xFD92), port("B", 0x1A86, 0x7523), port("C", 0x0403, 0x6001)


@pytest.mark.parametrize(
    ("name", "there", "device"),
    [
        ("axidraw_v3", [EBB, CH340, FTDI], "A"),
        ("grbl_servo", [EBB, CH340], "B"),
        ("hp7475a", [EBB, FTDI], "C"),
        ("ender3", [CH340], "B"),
        ("uarm_swift_pro", [EBB, port("D", 0x2341, 0x0042)], "D"),
    ],
)
def test_auto_is_the_only_one_that_fits(name: str, there: Sequence[Port], device: str) -> None:
    assert chosen("auto", load_profile(name), lambda: there) == device
    assert chosen("/dev/mine", load_profile(name), lambda: there) == "/dev/mine"


def test_auto_names_the_candidates_otherwise() -> None:
    profile = load_profile("grbl_servo")
    with pytest.raises(InputError, match=r"2 ports may be grbl_servo \(GRBL\): B \(CH340\), C \(FT232\); name one"):
        chosen("auto", profile, lambda: [EBB, CH340, FTDI])
    with pytest.raises(InputError, match=r"no port looks like grbl_servo \(GRBL\); plugged in: A \(EiBotBoard\); give"):
        chosen("auto", profile, lambda: [EBB])
    with pytest.raises(InputError, match="plugged in: nothing"):
        chosen("auto", profile, list)


def test_families_are_the_names_of_the_codecs() -> None:
    for name in names():
        profile = load_profile(name)
        try:
            codec = codec_for(profile, bench(profile).phrases(0))
        except PlotError:
            with pytest.raises(PlotError, match="cannot be driven"):
                family(profile)
            continue
        assert family(profile) == codec.name
        assert any(codec.name in families for _, families in IDS.values())


@pytest.mark.parametrize(
    ("name", "variant", "protocol"),
    [
        ("grbl_servo", None, "GRBL"), ("grbl_servo", "grbl-no-reset", "GRBL"), ("fluidnc", None, "GRBL"),
        ("grblhal", "grblhal-no-reset", "GRBL"), ("idraw_2", None, "GRBL"), ("ender3", None, "Marlin"),
        ("axidraw_v3", None, "EBB"), ("axidraw_v3", "ebb-3.0-future", "EBB"), ("hp7475a", None, "HP-GL"),
        ("roland_dxy", None, "HP-GL"), ("uarm_swift_pro", None, "uArm"),
    ],
)  # fmt: skip
def test_machines_say_who_they_are_and_do_nothing(name: str, variant: str | None, protocol: str) -> None:
    profile = load_profile(name)
    device, right, begun = firmware(profile, variant=variant), baud_of(profile), [0.0]

    def open_at(baud: int) -> SimulatedPort:
        begun[0] += 100.0
        return Simulated(device, baud, begun[0]) if baud == right else Deaf(begun[0])  # type: ignore[return-value]

    before = device.place_mm
    found = ask(open_at)
    assert found is not None
    assert found[0] == protocol
    assert device.place_mm == before
    assert not device.pen_down
    assert device.forbidden == ()


class Deaf:
    """A port on which nothing that is known is said."""

    def __init__(self, at_s: float = 0.0, says: bytes = b"") -> None:
        self.at_s, self.says, self.closed = at_s, says, False

    def write(self, data: bytes) -> int:
        return len(data)

    def read(self, timeout_s: float) -> bytes:
        self.at_s += timeout_s
        return self.says

    def now(self) -> float:
        return self.at_s

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize("says", [b"", b"\xff\x00\x81", b"hello\r\n"])
def test_nobody_is_nobody(says: bytes) -> None:
    made: list[Deaf] = []

    def open_at(_: int) -> Deaf:
        made.append(Deaf(says=says))
        return made[-1]

    assert ask(open_at) is None
    assert len(made) == 2
    assert all(one.closed for one in made)


def test_a_port_that_goes_away_is_closed() -> None:
    class Gone(Deaf):
        def read(self, timeout_s: float) -> bytes:
            raise DeviceLost("gone")

    gone = Gone()
    with pytest.raises(Exception, match="asked, and then: gone"):
        ask(lambda _: gone)
    assert gone.closed


def test_closing_the_port_does_not_drop_its_line() -> None:
    master, slave = os.openpty()
    line = FilePort(slave, "pty")
    keep_awake(line)
    assert not termios.tcgetattr(slave)[2] & termios.HUPCL
    keep_awake(line, awake=False)
    assert termios.tcgetattr(slave)[2] & termios.HUPCL
    line.close()
    os.close(master)
    keep_awake(Deaf())  # no descriptor: nothing to do


def test_ids_are_ids() -> None:
    assert all(0 < vendor <= 0xFFFF and (product is None or 0 < product <= 0xFFFF) for vendor, product in IDS)
    assert ports.IDS[0x04D8, 0xFD92][1] == ("EBB",)
