"""Real ports: pseudo-terminals and sockets, which take and give what they like, and go away."""

from __future__ import annotations

import os
import socket
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from strokeplan.errors import DeviceLost, DriveError
from strokeplan.plotter.driving.link import Emergency, Link
from strokeplan.plotter.driving.transport import FilePort, Transport, open_port

pytest.importorskip("serial")


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """The machine's end of a pseudo-terminal, and the name of the host's."""
    machine, host = os.openpty()
    tty.setraw(machine)
    name = os.ttyname(host)
    os.close(host)
    yield machine, name
    with suppress(OSError):
        os.close(machine)


def test_a_terminal_takes_what_fits_and_the_rest_stays(terminal: tuple[int, str]) -> None:
    machine, name = terminal
    port = open_port(name, 115200)
    link = Link(port)
    data = bytes(range(32, 127)) * 500
    link.push(data)
    assert 0 < len(link.pending) < len(data)
    heard = b""
    while len(heard) < len(data):
        heard += os.read(machine, 1000)
        link.push()
    assert heard == data
    assert link.pending == b""
    port.close()
    port.close()


def test_lines_come_together_from_the_pieces_that_are_read(terminal: tuple[int, str]) -> None:
    machine, name = terminal
    link = Link(open_port(name, 115200))
    os.write(machine, b"Grbl 1.1h ['$'")
    assert link.lines(link.read(1.0)) == []
    os.write(machine, b" for help]\r\nok\r")
    assert link.lines(link.read(1.0)) == ["Grbl 1.1h ['$' for help]", "ok"]
    begin = time.monotonic()
    assert link.read(0.05) == b""
    assert 0.04 < time.monotonic() - begin < 1.0


@pytest.mark.parametrize("what", ["read", "write"])
def test_a_device_that_disappears_is_lost(terminal: tuple[int, str], what: str) -> None:
    machine, name = terminal
    port = open_port(name, 115200)
    assert port.write(b"?") == 1
    os.close(machine)
    with suppress(DeviceLost):
        port.write(b"?")  # the first one may still be taken
    with pytest.raises(DeviceLost, match=f"{name}: the machine is gone"):
        port.read(0.1) if what == "read" else port.write(b"?")


def test_a_port_in_use_or_missing_is_refused_with_what_to_do(terminal: tuple[int, str], tmp_path: Path) -> None:
    _, name = terminal
    first = open_port(name, 115200)
    with pytest.raises(DriveError, match="another program has the port"):
        open_port(name, 115200)
    first.close()
    open_port(name, 115200).close()
    with pytest.raises(DriveError, match="no such port"):
        open_port(str(tmp_path / "ttyUSB9"), 115200)
    with pytest.raises(DriveError, match="cannot be opened"):
        open_port("nonsense://x", 115200)


def test_a_socket_is_a_port() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    heard: list[bytes] = []

    def answer() -> None:
        connection, _ = server.accept()
        heard.append(connection.recv(100))
        connection.sendall(b"ok\r\n")
        connection.close()

    thread = threading.Thread(target=answer)
    thread.start()
    port: Transport = open_port(f"socket://127.0.0.1:{server.getsockname()[1]}", 115200)
    assert port.write(b"G0 X1\n") == 6
    data = b""
    while len(data) < 4:
        data += port.read(1.0)
    thread.join()
    with pytest.raises(DeviceLost):
        port.read(1.0)
    server.close()
    port.close()
    assert (heard, data) == ([b"G0 X1\n"], b"ok\r\n")


def test_a_port_that_takes_nothing_is_an_error_and_an_emergency_is_heard() -> None:
    class Stuck:
        time = 0.0

        def write(self, data: bytes) -> int:
            return 0

        def read(self, timeout_s: float) -> bytes:
            self.time += timeout_s
            return b""

        def now(self) -> float:
            return self.time

        def close(self) -> None:
            pass

    link = Link(Stuck())
    link.push(b"?")
    with pytest.raises(DriveError, match="takes no bytes"):
        link.hear(lambda line: line, 60.0)
    link = Link(Stuck(), emergency=lambda: True)
    with pytest.raises(Emergency):
        link.hear(lambda line: line, 60.0)


def test_noise_without_an_end_is_cut() -> None:
    ends = socket.socketpair()
    link = Link(FilePort(ends[0].detach(), "x"))
    assert link.lines(b"x" * 1000) == ["x" * 1000]
    link.transport.close()
    ends[1].close()
