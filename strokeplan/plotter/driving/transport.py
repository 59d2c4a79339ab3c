"""Bytes to and from a machine: a small protocol, and what pyserial opens (device paths, socket://, rfc2217://).

Time belongs to the transport: whoever waits for a machine waits in `read`, so that a simulated one, with time of its
own, runs as fast as it can. Nothing here waits for room to write: `write` takes what it can.

Known limits: rfc2217:// is read and written through pyserial's own buffers, a write there may wait.
"""

from __future__ import annotations

import os
import select
import time
from contextlib import suppress
from typing import Any, Protocol

from strokeplan.errors import DeviceLost, DriveError, MissingExtraError

CHUNK = 4096
SLICE_S = 0.005
"""How long a port that cannot be waited for rests between two looks."""


class Transport(Protocol):
    """A line to a machine."""

    def write(self, data: bytes) -> int:
        """Hand over bytes; how many were taken (0..len). Does not wait. Raises DeviceLost if the device is gone."""

    def read(self, timeout_s: float) -> bytes:
        """What has come; waits at most timeout_s for the first byte; b"" if nothing came. Raises DeviceLost."""

    def now(self) -> float:
        """Seconds of a monotonic clock: real, or the simulation's."""

    def close(self) -> None:
        """Give the port back; more than once is no error."""


class FilePort:
    """A transport over an open file descriptor (a serial port, a socket, a pseudo-terminal), which it makes its own."""

    def __init__(self, descriptor: int, name: str, owner: Any = None) -> None:
        self.descriptor, self.name, self.owner = descriptor, name, owner
        os.set_blocking(descriptor, False)

    def write(self, data: bytes) -> int:
        try:
            return os.write(self.descriptor, data[:CHUNK])
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._lost(error) from None

    def read(self, timeout_s: float) -> bytes:
        try:
            if not select.select([self.descriptor], [], [], max(timeout_s, 0.0))[0]:
                return b""
            data = os.read(self.descriptor, CHUNK)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:  # ValueError: the descriptor is closed
            raise self._lost(error) from None
        if not data:  # ready, and nothing there: the other side is gone
            raise self._lost(None)
        return data

    def now(self) -> float:
        return time.monotonic()

    def close(self) -> None:
        with suppress(OSError):
            if self.owner is not None:
                self.owner.close()
            else:
                os.close(self.descriptor)

    def _lost(self, error: Exception | None) -> DeviceLost:
        why = f" ({getattr(error, 'strerror', None) or error})" if error else ""
        return DeviceLost(f"{self.name}: the machine is gone{why}; look at its cable and its power")


class PyserialPort:
    """A transport over a pyserial object that has no file descriptor (rfc2217://, Windows)."""

    def __init__(self, port: Any, name: str) -> None:
        self.port, self.name = port, name

    def write(self, data: bytes) -> int:
        try:
            return int(self.port.write(data[:CHUNK]) or 0)
        except OSError as error:  # SerialException is one
            if "timeout" in str(error).lower():
                return 0
            raise DeviceLost(f"{self.name}: the machine is gone ({error})") from None

    def read(self, timeout_s: float) -> bytes:
        until = self.now() + timeout_s
        try:
            while not (waiting := self.port.in_waiting):
                left = until - self.now()
                if left <= 0:
                    return b""
                time.sleep(min(left, SLICE_S))
            return bytes(self.port.read(waiting))
        except (OSError, TypeError) as error:
            raise DeviceLost(f"{self.name}: the machine is gone ({error})") from None

    def now(self) -> float:
        return time.monotonic()

    def close(self) -> None:
        with suppress(OSError):
            self.port.close()


def require_serial() -> Any:
    """The serial module, or a MissingExtraError that says how to get it."""
    try:
        import serial
    except ImportError:
        raise MissingExtraError("a port needs pyserial: pip install 'strokeplan[serial]'") from None
    return serial


def open_port(url: str, baud: int, *, hardware_handshake: bool = False, xonxoff: bool = False) -> Transport:
    """The transport of a device path or a URL, for this process alone. Raises DriveError for a port that cannot be had.

    Opening a port raises DTR, which resets most boards of the Arduino kind: whoever greets the machine waits for it.
    """
    serial = require_serial()
    try:
        port = serial.serial_for_url(url, baudrate=baud, timeout=0, do_not_open=True)
        if not url.startswith("rfc2217:"):  # which writes to a socket, and knows no such time
            port.write_timeout = 0
        port.rtscts, port.xonxoff = hardware_handshake, xonxoff
        with suppress(ValueError, NotImplementedError, AttributeError):
            port.exclusive = True  # another program on the port would take half of the answers
        port.open()
    except (OSError, ValueError, NotImplementedError) as error:
        raise DriveError(_reason(url, error)) from None
    try:
        descriptor = port.fileno() if os.name == "posix" else None
    except (OSError, AttributeError):  # io.UnsupportedOperation is an OSError
        descriptor = None
    return PyserialPort(port, url) if descriptor is None else FilePort(descriptor, url, port)


def _reason(url: str, error: Exception) -> str:
    """One line on why a port cannot be opened, and what to do."""
    text = " ".join(str(error).split())
    number = getattr(error, "errno", None)
    if "exclusively lock" in text or number in (11, 16):
        return f"{url}: another program has the port; close it"
    if number == 13:
        return f"{url}: no permission; on Linux become a member of the group dialout (or uucp), and log in again"
    if number == 2:
        return f"{url}: there is no such port; `strokeplan ports` lists what is plugged in"
    return f"{url}: cannot be opened ({text})"
