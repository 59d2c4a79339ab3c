"""A serial port in virtual time: the wire between a host and a simulated device."""

from __future__ import annotations

from collections import deque
from math import inf

from strokeplan.errors import DeviceLost
from strokeplan.plotter.simulating.firmware import Firmware

BITS = 10
"""Of a byte on the wire: start, eight, stop."""
HOST_BYTES = 4096
"""What the host's own buffer holds; a write beyond it is partial."""
CHUNK = 16
"""Bytes that reach the device together at most."""
PLAIN = frozenset(b"ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .,-+")


class SimulatedPort:
    """A Transport whose clock is the simulation's: it moves when somebody waits in `read`."""

    def __init__(self, device: Firmware, baud: int = 115200, start_s: float = 0.0, *, rtscts: bool = False) -> None:
        self.device, self.baud = device, baud
        self.byte_s = BITS / baud
        self._rtscts = rtscts
        self._now = start_s
        self._wire: deque[int] = deque()
        """Bytes of the host that have not left it."""
        self._free_s = start_s
        """When the wire to the device is free again."""
        self._back: deque[tuple[float, int]] = deque()
        """Bytes of the device, and when they arrive."""
        self._back_s = start_s
        self._closed = False
        device.opened(start_s)
        self._collect(start_s)

    # Transport

    def write(self, data: bytes) -> int:
        """How many bytes the host's buffer took."""
        self._check()
        taken = data[: min(HOST_BYTES - len(self._wire), self._most())]
        if taken and not self._wire:
            self._free_s = max(self._free_s, self._now)
        self._wire.extend(taken)
        return len(taken)

    def read(self, timeout_s: float) -> bytes:
        """What has come; time goes on until the first byte or for as long."""
        self._check()
        end = self._now + timeout_s
        while not (self._back and self._back[0][0] <= self._now):
            step = self.next_s()
            if step > end or (timeout_s <= 0 and step > self._now):
                self._go(end)
                break
            self._go(step)
            if not self.device.link:
                break
        self._check()
        came = bytearray()
        while self._back and self._back[0][0] <= self._now and len(came) < self._most():
            came.append(self._back.popleft()[1])
        return bytes(came)

    def now(self) -> float:
        """Seconds of the simulation."""
        return self._now

    def close(self) -> None:
        """What has not left the host is lost."""
        self._closed = True
        self._wire.clear()

    def reopen(self, after_s: float = 0.0) -> SimulatedPort:
        """The same device, opened again by another host after some time."""
        self.close()
        self._drain(self._now + after_s)
        return type(self)(self.device, self.baud, self._now, rtscts=self._rtscts)

    def wait(self, seconds: float) -> None:
        """Time goes on; what comes is kept."""
        self._drain(self._now + seconds)

    def next_s(self) -> float:
        """When something happens next by itself."""
        return min(self._next(), self._back[0][0] if self._back else inf)

    # The wire

    def _room(self) -> int:
        """Bytes that the device takes now."""
        if self._rtscts and not getattr(self.device, "clear_to_send", True):
            return 0
        return self.device.room()

    def _most(self) -> int:
        """Bytes that the system's port takes or gives at once."""
        return getattr(self.device, "partial", None) or HOST_BYTES

    def _check(self) -> None:
        if self._closed or not self.device.link:
            raise DeviceLost("the port is closed" if self._closed else "the device is gone: the cable or its power")

    def _drain(self, end: float) -> None:
        while (step := self._next()) <= end:
            self._go(step)
        self._go(end)

    def _next(self) -> float:
        """When something happens next: a byte reaches the device, or it does something."""
        due = self.device.next_event_s()
        step = inf if due is None else max(due, self._now)
        if self._wire and self._room() > 0:
            step = min(step, max(self._chunk()[1], self._now))
        return step

    def _chunk(self) -> tuple[int, float]:
        """How many bytes reach the device before it can tell them apart, and when the last of them is there."""
        due, room, count = self.device.next_event_s(), self._room(), 0
        most = 1 if self._rtscts else CHUNK
        first = max(self._free_s, self._now if self._room() < 1 << 16 else 0.0)
        limit = inf if due is None else due
        for byte in self._wire:
            if count == room or (count and first + (count + 1) * self.byte_s > limit):
                break
            count += 1
            if count == most:
                break
            if byte not in PLAIN:
                break
        return count, first + count * self.byte_s

    def _go(self, to_s: float) -> None:
        """Time goes on until then."""
        if self._wire and self._room() > 0:
            count, at_s = self._chunk()
            if at_s <= to_s:
                data = bytes(self._wire.popleft() for _ in range(count))
                self._free_s = at_s
                self._collect(at_s)
                self.device.receive(data, at_s)
        self._now = max(self._now, to_s)
        self._collect(self._now)

    def _collect(self, at_s: float) -> None:
        for byte in self.device.advance(at_s):
            self._back_s = max(self._back_s, at_s) + self.byte_s
            self._back.append((self._back_s, byte))
