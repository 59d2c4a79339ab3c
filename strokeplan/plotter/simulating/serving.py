"""A simulated device in real time behind a pseudo-terminal or a TCP port, for programs that think it is real."""

from __future__ import annotations

import os
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

from strokeplan.errors import DeviceLost, InputError
from strokeplan.plotter.simulating.device import Device
from strokeplan.plotter.simulating.firmware import Firmware
from strokeplan.plotter.simulating.port import SimulatedPort

TICK_S = 0.02
"""How late a byte may be."""
CHUNK = 4096


class Server(Protocol):
    """Where a host comes from."""

    url: str
    """What the host opens."""

    def host(self) -> bool:
        """Whether a host has the port open; waits a tick for one."""

    def read(self, timeout_s: float) -> bytes:
        """What the host sent; waits at most that long."""

    def write(self, data: bytes) -> None:
        """Send it to the host."""

    def close(self) -> None:
        """Give the port up."""


def serve(
    device: Firmware,
    server: Server,
    baud: int,
    *,
    told: Callable[[str], None],
    clock: Callable[[], float] = time.monotonic,
    by_hand: bool = False,
) -> None:
    """Serve one host after the other until interrupted; `told` hears what happens. Raises KeyboardInterrupt.

    `by_hand`: before, the carriage of a board that starts anew with its port is put to its origin, as `plot` asks for.
    """
    begin = clock()
    while True:
        if not server.host():
            device.advance(clock() - begin)
            continue
        told("opened")
        if by_hand and isinstance(device, Device) and device.resets:
            device.by_hand((0.0, 0.0), clock() - begin, 0.0)
        port = SimulatedPort(device, baud, clock() - begin)
        with suppress(DeviceLost, OSError):
            _talk(port, server, lambda: clock() - begin)
        told("closed")


def _talk(port: SimulatedPort, server: Server, now: Callable[[], float]) -> None:
    """Pass bytes to and fro until the host is gone."""
    waiting = b""
    while server.host():
        waiting = waiting[port.write(waiting) :]
        until = now()
        while port.now() < until:
            server.write(port.read(until - port.now()))
        waiting += server.read(min(max(port.next_s() - port.now(), 0.0), TICK_S))


class PtyServer:
    """A pseudo-terminal; a host is there as long as somebody has its other end open."""

    def __init__(self) -> None:
        if not hasattr(os, "openpty"):
            raise InputError("--port pty: this system has no pseudo-terminals; take --port tcp")
        self._fd, slave = os.openpty()
        self.url = os.ttyname(slave)
        self._raw()
        os.close(slave)
        self._there = False

    def _raw(self) -> None:
        import tty

        tty.setraw(self._fd)

    def host(self) -> bool:
        """No hang-up: somebody has it open."""
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        there = not any(event & select.POLLHUP for _, event in poll.poll(0))
        if there and not self._there:
            self._raw()
        if not there:
            time.sleep(TICK_S)
        self._there = there
        return there

    def read(self, timeout_s: float) -> bytes:
        """What the host sent."""
        if not select.select([self._fd], [], [], timeout_s)[0]:
            return b""
        try:
            return os.read(self._fd, CHUNK)
        except OSError:  # Linux's way to say that the other end was closed
            return b""

    def write(self, data: bytes) -> None:
        """A host that does not read loses what does not fit."""
        if data:
            os.set_blocking(self._fd, False)
            with suppress(BlockingIOError):
                os.write(self._fd, data)
            os.set_blocking(self._fd, True)

    def close(self) -> None:
        """Hang up."""
        os.close(self._fd)


class TcpServer:
    """A TCP port of this computer, one host at a time."""

    def __init__(self, port: int = 0) -> None:
        try:
            self._listening = socket.create_server(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            raise InputError(f"--port tcp:{port}: cannot be opened ({error}); take another number, or none") from None
        self.url = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self._host: socket.socket | None = None

    def host(self) -> bool:
        """Whether a host is connected; takes the next one."""
        if self._host is None and select.select([self._listening], [], [], TICK_S)[0]:
            self._host, _ = self._listening.accept()
            self._host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._host is not None

    def read(self, timeout_s: float) -> bytes:
        """What the host sent."""
        if self._host is None or not select.select([self._host], [], [], timeout_s)[0]:
            return b""
        try:
            data = self._host.recv(CHUNK)
        except ConnectionError:
            data = b""
        if not data:
            self._host.close()
            self._host = None
        return data

    def write(self, data: bytes) -> None:
        """Send it to the host."""
        if self._host is not None and data:
            with suppress(ConnectionError):
                self._host.sendall(data)

    def close(self) -> None:
        """Give the port up."""
        if self._host is not None:
            self._host.close()
        self._listening.close()


@contextmanager
def opened(kind: str) -> Iterator[Server]:
    """The server that "pty", "tcp" or "tcp:PORT" names. Raises InputError."""
    name, _, number = kind.partition(":")
    server: Server
    if name == "pty" and not number:
        server = PtyServer()
    elif name == "tcp" and (number.isdecimal() or not number) and int(number or 0) < 65536:
        server = TcpServer(int(number or 0))
    else:
        raise InputError(f"--port {kind!r} is neither pty nor tcp nor tcp:PORT, like tcp:5000")
    try:
        yield server
    finally:
        server.close()
