"""The wire in virtual time, faults on it, and simulated machines in real time behind real ports."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import time
from itertools import count
from pathlib import Path

import pytest
from conftest import ROOT, heard
from hosts import Host
from hypothesis import given, settings
from hypothesis import strategies as st

from strokeplan.errors import DeviceLost, InputError
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.simulating.device import Device
from strokeplan.plotter.simulating.faults import Fault, Faults, Faulty
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import HOST_BYTES
from strokeplan.plotter.simulating.serving import opened, serve


def faulty(*faults: Fault, profile: str = "grbl_servo") -> Host:
    machine = load_profile(profile)
    return Host(machine, firmware(machine, faults=Faults(faults)))  # type: ignore[arg-type]


def test_bytes_take_the_wire_their_time() -> None:
    host = Host("ender3")
    begin = host.port.now()
    host.port.write(b"G21" + b" " * 112 + b"\n")  # 116 bytes there, 3 back
    while host.port.read(5.0) != b"\n":
        pass
    assert host.port.now() - begin == pytest.approx((116 + 3) * 10 / 115200 + 0.0005, abs=1e-6)


def test_reading_without_waiting_moves_no_time() -> None:
    host = Host("grbl_servo")
    host.port.write(b"?")
    now = host.port.now()
    assert host.port.read(0.0) == b""
    assert host.port.now() == now
    assert host.port.read(1.0)


def test_a_full_host_buffer_takes_a_part() -> None:
    host = Host("grbl_servo")
    assert host.port.write(b"\n" * 5000) == HOST_BYTES
    host.port.wait(0.1)
    assert 0 < host.port.write(b"\n" * 5000) < 1300


def test_the_same_schedule_gives_the_same_bytes_at_the_same_times() -> None:
    def run() -> list[tuple[float, bytes]]:
        host = faulty(Fault("drop-reply", 3, "lines"), Fault("noise", 2.5), Fault("slow", 40, "bytes", 0.3))
        host.port.write(b"G1 X5 F600\n?" * 10)
        came = []
        while host.port.now() < 30:
            came.append((host.port.now(), host.port.read(1.0)))
        return came

    assert run() == run()


@pytest.mark.parametrize(
    ("fault", "reply"),
    [
        (Fault("drop-reply", 3, "lines"), "ok\r\n"), (Fault("duplicate-reply", 3, "lines"), "ok\r\nok\r\nok\r\n"),
        (Fault("corrupt-reply", 3, "lines"), "oz\x1f\x18\r\n"), (Fault("drop-bytes", 1, "bytes", 4), "ok\r\n"),
        (Fault("noise", 3, "bytes", data=b"\xfe"), "\xfeok\r\nok\r\n"),
        (Fault("refuse", 1, "bytes"), "error:20\r\nok\r\n"),
        (Fault("silence", 1, "bytes", 60), ""), (Fault("delay-reply", 3, "lines", 0.5), "ok\r\nok\r\n"),
    ],
)  # fmt: skip
def test_faults_of_the_wire(fault: Fault, reply: str) -> None:
    host = faulty(fault)
    said = host.ask("G21\nG90\n")
    if fault.kind == "corrupt-reply":
        assert said.count("ok") == 1
        assert len(said) == 8
    else:
        assert said == reply
    assert [fault for _, fault in host.device.happened] == [fault]  # type: ignore[attr-defined]


def test_an_unplugged_cable_ends_the_port_and_the_board_goes_on() -> None:
    host = faulty(Fault("unplug", 5.0))
    host.port.write(b"M3 S300\nG4 P0.5\nG1 X100 F1000\nG1 X0\n")
    with pytest.raises(DeviceLost):
        host.hear(10.0)
    with pytest.raises(DeviceLost):
        host.port.write(b"?")
    host.port.device.device.resets = False  # type: ignore[attr-defined]
    host.port = host.port.reopen(60.0)
    assert host.ask("?").startswith("<Idle|MPos:0.000")
    assert host.device.drawn.length_mm == pytest.approx(200)


def test_a_cut_of_power_stops_the_line_there() -> None:
    host = faulty(Fault("power-cut", 6.0))
    host.port.write(b"M3 S300\nG4 P0.5\nG1 X100 F1000\nG1 X0\n")
    with pytest.raises(DeviceLost):
        host.hear(10.0)
    host.port = host.port.reopen(60.0)
    assert 10 < host.device.drawn.length_mm < 40
    assert "Grbl" in host.hear(3.0)


def test_a_port_that_takes_and_gives_little() -> None:
    host = faulty(Fault("partial", 1, "bytes", 2))
    host.ask("\n")
    assert host.port.write(b"G21\n") == 2
    assert len(host.port.read(1.0)) <= 2


kinds = st.sampled_from(
    ["drop-reply", "corrupt-reply", "duplicate-reply", "delay-reply", "noise", "drop-bytes", "corrupt-bytes", "silence",
     "slow", "reset", "alarm", "refuse", "button", "partial"]
)  # fmt: skip
schedules = st.lists(
    st.builds(Fault, kinds, st.integers(0, 60), st.sampled_from(["s", "bytes", "lines"]), st.integers(1, 5)), max_size=6
).map(lambda faults: Faults(tuple(faults)))


@settings(max_examples=40)
@given(faults=schedules, name=st.sampled_from(["grbl_servo", "ender3", "axidraw_v3", "hp7475a", "uarm_swift_pro"]))
def test_no_schedule_of_faults_stops_the_clock(faults: Faults, name: str) -> None:
    profile = load_profile(name)
    device = firmware(profile, faults=faults)
    host = Host(profile, device)  # type: ignore[arg-type]
    while host.port.now() < 80:
        try:
            host.ask("G1 X10 F600\nSM,100,10,10\rPU100,100;PD0,0;OA;?\n" * 5, 80.0)
        except DeviceLost:
            host.port = host.port.reopen(1.0)
    assert host.port.now() > 80
    assert isinstance(device, Faulty | Device)


def test_variants_that_there_are_not_are_named() -> None:
    with pytest.raises(InputError, match="there are ebb-2"):
        firmware(load_profile("axidraw_v3"), variant="?")
    with pytest.raises(InputError, match="no simulator"):
        firmware(load_profile("linuxcnc"))


def test_ports_are_pty_or_tcp() -> None:
    for text in ("usb", "tcp:x", "tcp:99999", "pty:3"):
        with pytest.raises(InputError, match="neither pty nor tcp"), opened(text):
            pass


def simulate(*arguments: str, cwd: Path) -> tuple[subprocess.Popen[str], str]:
    """The command, and the URL that it prints."""
    command = [sys.executable, "-m", "strokeplan", "simulate", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, cwd=cwd, env=environment, text=True, **pipes)  # type: ignore[call-overload]
    return process, process.stdout.readline().rsplit(" ", 1)[1].strip()


def end(process: subprocess.Popen[str]) -> tuple[str, str]:
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60)
    assert process.returncode == 0
    return said


def until(read: int, text: bytes) -> bytes:
    came = b""
    while text not in came:
        came += heard(read)
    return came


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_a_pseudo_terminal_in_real_time(tmp_path: Path) -> None:
    """A program that opens it meets a GRBL that restarts; what is drawn becomes an SVG."""
    import tty

    process, url = simulate("grbl_servo", "-o", "drawn.svg", cwd=tmp_path)
    terminal = os.open(url, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(terminal)
    until(terminal, b"help]\r\n")
    os.write(terminal, b"G0 X1\nM3 S300\nG4 P0.2\nG1 X6 F6000\nM5\nG4 P0.2\n")
    assert until(terminal, b"ok\r\n" * 6) == b"ok\r\n" * 6
    os.close(terminal)
    _, told = end(process)
    assert "1 lines, 0.01 m, pen up" in told
    assert 'd="M1 220' in (tmp_path / "drawn.svg").read_text()


def test_a_tcp_port_in_real_time_serves_one_host_after_the_other(tmp_path: Path) -> None:
    process, url = simulate("ender3", "--port", "tcp", cwd=tmp_path)
    for _ in range(2):
        with socket.create_connection(("127.0.0.1", int(url.rsplit(":", 1)[1])), timeout=60) as host:
            came = b""
            while b"PlannerBufferBytes" not in came:
                came += host.recv(1000)
            host.sendall(b"M114\n")
            while b"ok\n" not in came:
                assert select.select([host], [], [], 60)[0]
                came += host.recv(1000)
        assert came.startswith(b"start\n")
        time.sleep(0.1)
    end(process)


@pytest.mark.parametrize("by_hand", [True, False])
def test_a_person_puts_the_carriage_to_its_origin(by_hand: bool) -> None:
    """Between two hosts; without, a board that starts anew takes any place for zero."""
    device, hosts, ticks = firmware(load_profile("ender3")), iter([True, False, True, False]), count()
    assert isinstance(device, Device)
    starts: list[tuple[float, float]] = []

    class Server:
        url = "nowhere"

        def host(self) -> bool:
            try:
                return next(hosts)
            except StopIteration:
                raise KeyboardInterrupt from None

        def read(self, timeout_s: float) -> bytes:
            return b""

        def write(self, data: bytes) -> None: ...

        def close(self) -> None: ...

    def told(what: str) -> None:
        if what == "closed":
            starts.append(device.recorder.at)
            device.by_hand((30.0, 40.0), float(next(ticks)), 5.0)

    with pytest.raises(KeyboardInterrupt):
        serve(device, Server(), 115200, told=told, clock=lambda: float(next(ticks)), by_hand=by_hand)
    assert starts == [(0.0, 0.0), (0.0, 0.0) if by_hand else (30.0, 40.0)]
