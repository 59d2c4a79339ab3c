"""Faults: what may go wrong between a host and a device, as a schedule of frozen values, the same each time.

A fault waits for a moment: a time, a number of bytes that reached the device, or a number of lines that it sent. The
moment is counted from when the device was made, over all times that its port was opened.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Literal

from strokeplan.plotter.simulating.recording import Drawn, Spot

if TYPE_CHECKING:
    from strokeplan.plotter.simulating.device import Device

Kind = Literal[
    "drop-reply", "corrupt-reply", "duplicate-reply", "delay-reply", "noise", "drop-bytes", "corrupt-bytes", "silence",
    "slow", "reset", "alarm", "refuse", "unplug", "power-cut", "button", "partial",
]  # fmt: skip
Unit = Literal["s", "bytes", "lines"]
REPLIES = ("drop-reply", "corrupt-reply", "duplicate-reply", "delay-reply")


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong.

    kind     drop-reply, corrupt-reply, duplicate-reply: one line of the device; delay-reply: it and all behind it come
             `amount` seconds later; noise: `data` comes to the host; drop-bytes, corrupt-bytes: `amount` bytes to the
             device; silence: the device says nothing for `amount` seconds, what it would have said is lost; slow: from
             now on each line comes `amount` seconds later than the one before; reset: the board restarts; alarm:
             number `amount`; refuse: the next `amount` commands; unplug; power-cut; button; partial: from now on the
             port takes and gives at most `amount` bytes at a time.
    at       when, in `unit`: seconds, bytes received, lines sent.
    """

    kind: Kind
    at: float
    unit: Unit = "s"
    amount: float = 1
    data: bytes = b"\xff\x00~"


@dataclass(frozen=True, slots=True)
class Faults:
    """A schedule."""

    faults: tuple[Fault, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.faults)


NONE = Faults()


class Faulty:
    """A device whose link and world follow a schedule; a Firmware itself."""

    def __init__(self, device: Device, faults: Faults) -> None:
        self.device = device
        self.waiting = list(faults.faults)
        self.happened: list[tuple[float, Fault]] = []
        self.bytes_in = self.lines_out = 0
        self.partial: int | None = None
        self._line = bytearray()
        self._late: list[tuple[float, bytes]] = []
        """Lines that are kept back, and until when; in order."""
        self._silent_until = -inf
        self._slow_s = 0.0
        self._hold_s = 0.0
        self._eat = self._spoil = 0
        self._now = 0.0

    # Firmware

    def receive(self, data: bytes, at_s: float) -> None:
        """Bytes that reach the device, as the faults leave them."""
        self._due(at_s)
        for byte in data:
            self.bytes_in += 1
            self._due(at_s)
            if self._eat:
                self._eat -= 1
                continue
            if self._spoil:
                self._spoil -= 1
                byte ^= 0x04
            self.device.receive(bytes([byte]), at_s)

    def advance(self, to_s: float) -> bytes:
        """Run until then; what the host gets to hear."""
        while True:
            times = [at for at in self._times() if at <= to_s]
            if not times:
                break
            self._hear(max(min(times), self._now))
            self._due(self._now)
        self._hear(to_s)
        return self._release()

    def next_event_s(self) -> float | None:
        """When it will do something by itself."""
        due = self.device.next_event_s()
        times = [inf if due is None else due]
        times += self._times()
        times += [until for until, _ in self._late[:1]]
        soon = min(times)
        return None if soon == inf else max(soon, self._now)

    def room(self) -> int:
        """As the device's."""
        return self.device.room()

    def opened(self, at_s: float) -> None:
        """A host opens the port."""
        self._now = max(self._now, at_s)
        self._late.clear()
        self._line.clear()
        self.partial = None
        self._slow_s = 0.0
        self.device.opened(at_s)

    @property
    def link(self) -> bool:
        """Whether the cable is in."""
        return self.device.link

    @property
    def drawn(self) -> Drawn:
        """What was drawn."""
        return self.device.drawn

    @property
    def pen_down(self) -> bool:
        """Whether the pen is on the paper."""
        return self.device.pen_down

    @property
    def forbidden(self) -> tuple[str, ...]:
        """Commands that change settings, firmware or files."""
        return self.device.forbidden

    @property
    def place_mm(self) -> Spot:
        """Where the pen is."""
        return self.device.place_mm

    # What happens

    def _times(self) -> list[float]:
        """When faults strike by themselves; those of replies wait for one."""
        return [fault.at for fault in self.waiting if fault.unit == "s" and fault.kind not in REPLIES]

    def _due(self, at_s: float) -> None:
        for fault in [fault for fault in self.waiting if fault.kind not in REPLIES]:
            count = {"s": at_s, "bytes": self.bytes_in, "lines": self.lines_out}[fault.unit]
            if count >= fault.at and fault in self.waiting:
                self.waiting.remove(fault)
                self.happened.append((at_s, fault))
                self._strike(fault, at_s)

    def _strike(self, fault: Fault, at_s: float) -> None:
        device, amount = self.device, fault.amount
        if fault.kind == "noise":
            self._late.append((max(at_s, self._last()), fault.data))
        elif fault.kind == "drop-bytes":
            self._eat += int(amount)
        elif fault.kind == "corrupt-bytes":
            self._spoil += int(amount)
        elif fault.kind == "silence":
            self._silent_until = at_s + amount
        elif fault.kind == "slow":
            self._slow_s = amount
        elif fault.kind == "reset":
            if device.powered:
                device.restart(at_s)
        elif fault.kind == "alarm":
            device.alarm(int(amount), at_s)
        elif fault.kind == "refuse":
            for _ in range(int(amount)):
                device.fail(20)
        elif fault.kind == "unplug":
            device.unplug(at_s)
        elif fault.kind == "power-cut":
            device.power_cut(at_s)
        elif fault.kind == "button":
            device.press(at_s)
        elif fault.kind == "partial":
            self.partial = max(int(amount), 1)

    def _hear(self, to_s: float) -> None:
        """Let the device run, and take its bytes apart into lines."""
        self._now = max(self._now, to_s)
        for byte in self.device.advance(self._now):
            self._line.append(byte)
            if byte in b"\n\r" and (byte == 0x0A or self._ends_with_cr()):
                line, self._line = bytes(self._line), bytearray()
                self._said(line)
                self._due(self._now)
        if self._line and not self._holds_lines():
            self._said(bytes(self._line), whole=False)
            self._line.clear()

    def _ends_with_cr(self) -> bool:
        return self.device.end == b"\r"

    def _holds_lines(self) -> bool:
        return any(fault.kind in REPLIES for fault in self.waiting)

    def _said(self, line: bytes, *, whole: bool = True) -> None:
        self.lines_out += whole
        times = 1
        for fault in [fault for fault in self.waiting if fault.kind in REPLIES]:
            count = {"s": self._now, "bytes": self.bytes_in, "lines": self.lines_out}[fault.unit]
            if count < fault.at:
                continue
            self.waiting.remove(fault)
            self.happened.append((self._now, fault))
            if fault.kind == "drop-reply":
                times = 0
            elif fault.kind == "duplicate-reply":
                times = 2
            elif fault.kind == "corrupt-reply":
                middle = len(line.rstrip()) // 2
                line = line[:middle] + bytes([line[middle] ^ 0x15]) + line[middle + 1 :]
            else:
                self._hold_s = self._now + fault.amount
        if self._now < self._silent_until:
            return
        until = max(self._now, self._last(), self._hold_s)
        if self._slow_s:
            until += self._slow_s
        self._late += [(until, line)] * times

    def _last(self) -> float:
        return self._late[-1][0] if self._late else 0.0

    def _release(self) -> bytes:
        out = bytearray()
        while self._late and self._late[0][0] <= self._now:
            out += self._late.pop(0)[1]
        return bytes(out) if self.device.link else b""
