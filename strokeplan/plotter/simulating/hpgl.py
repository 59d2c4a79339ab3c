"""Pen plotters that speak HP-GL: HP 7475A and 7470A, Roland DXY.

Bytes come into a buffer of 1024 (7470A: 255); what finds it full is lost, and only ESC.E and a lamp tell. Instructions
are carried out one by one, a list of points pair by pair; device control (ESC.) is answered at once, out of turn.

Source: HP 7475A Interfacing and Programming Manual (1984), chapters 9 to 12 (device control, handshakes, outputs).
Known limits: no text, no scaling, no digitizing, no ENQ/ACK; a pen is fetched in 2 s wherever it is [assumed].
"""

from __future__ import annotations

import re
from collections import deque
from math import inf

from strokeplan.plotter.profile import Hpgl as Dialect
from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.device import Device, Main
from strokeplan.plotter.simulating.recording import Spot
from strokeplan.plotter.simulating.steppers import Place
from strokeplan.plotter.tools import Carousel

PEN_S = 2.0  # [assumed]
AUTO_LIFT_S = 55.0
"""The 7470A lifts a pen that has stood still for so long."""
XOFF, XON = 19, 17
OUTPUTS = ("OA", "OC", "OE", "OF", "OH", "OI", "OO", "OP", "OS", "OW")
SILENT = ["PS", "AS", "FS", "IP", "IW", "LT", "PT", "RO", "SS", "CA", "CS", "DI", "DR", "IM", "DC", "AP"]
"""Known, and nothing that changes where lines are drawn here."""
WITH_VALUES = b"@HIMNPQST"


class Hpgl(Device):
    """A plotter of a model: "7475A", "7470A" or "DXY"."""

    end = b"\r"

    def __init__(self, profile: Profile, model: str = "7475A", *, at_mm: Spot = (0.0, 0.0)) -> None:
        dialect = profile.dialect
        if not isinstance(dialect, Dialect):
            raise TypeError("a profile of another dialect")
        self.model, self.unit_mm, self.size = model, dialect.unit_mm, dialect.buffer_bytes
        self.pens = profile.tool.pens if isinstance(profile.tool, Carousel) else 1
        self.limits = _limits(profile)
        self.lever = self.paused = False
        self.lost = 0
        self._fails = 0
        super().__init__(profile, resets=False, boot_s=3.0, at_mm=at_mm)

    def _lose(self) -> None:
        self.buffer: deque[int] = deque()
        self._control = bytearray()
        self._xoff: int | None = None
        """Free bytes below which it says Xoff; None without that handshake."""
        self._off = False
        self._hardwire = False
        self._block = 80
        self.io_error = 0
        self._reset_graphics()
        self.slot = 0
        self._still_s = self.now
        self._follow = False
        self._deaf_until = self.now + self.boot_s

    def _reset_graphics(self) -> None:
        self.error, self.initialized = 0, True
        self._down = False
        self._relative = False
        self._speed_cm_s = 38.1
        self._at = (0, 0)
        """Where the pen is told to be, in units."""

    def boot(self) -> Main:
        yield self.now + self.boot_s
        # it finds its own zero
        self.steppers.reset((0.0, 0.0, 0.0))
        self.slip = (0.0, 0.0)
        self.recorder.lift(self.now)
        self.recorder.carry((0.0, 0.0), self.now)
        yield from self._instructions()

    # The world

    def press(self, at_s: float) -> None:
        """The VIEW or PAUSE button: it stops behind the vector that it draws, its pen up; once more: it goes on."""
        super().press(at_s)
        self.paused = not self.paused
        self._pen_follows()

    def alarm(self, code: int, at_s: float) -> None:
        """The paper's lever is raised; 0: lowered again."""
        super().alarm(code, at_s)
        self.lever = code != 0
        self._pen_follows()

    def fail(self, code: int) -> None:
        """The next instruction is not understood."""
        self._fails += 1

    def _pen_follows(self) -> None:
        """Behind the vector that is drawn."""
        self._follow = not self.steppers.idle
        if self._follow:
            return
        stopped = self.paused or self.lever
        self.recorder.settle(self.now)
        self.recorder.pen(self.now, down=self._down and self.slot > 0 and not stopped)

    @property
    def clear_to_send(self) -> bool:
        """The plotter's DTR, which a cable leads to the host's CTS."""
        return not self._hardwire or self.size - len(self.buffer) >= self._block

    # Bytes

    def _take(self, data: bytes) -> None:
        for byte in data:
            if self.now < self._deaf_until:
                self.lost += 1
            elif self._control or byte == 0x1B:
                self._control.append(byte)
                self._controlled()
            elif len(self.buffer) < self.size:
                self.buffer.append(byte)
                self._brake_host()
            else:
                self.lost += 1
                self.io_error = 16

    def _brake_host(self) -> None:
        free = self.size - len(self.buffer)
        if self._xoff is not None and not self._off and free < self._xoff:
            self._off = True
            self._out.append(XOFF)

    def _release_host(self) -> None:
        if self._off and len(self.buffer) <= self.size // 2:
            self._off = False
            self._out.append(XON)

    def _controlled(self) -> None:
        """A device control sequence, as far as it has come."""
        text = bytes(self._control)
        if len(text) == 2 and text[1:] != b".":
            self.io_error = 11
            self._control.clear()
        if len(text) < 3:
            return
        letter = text[2:3]
        if letter in WITH_VALUES:
            if text[-1:] != b":":
                if len(text) > 60 or not re.fullmatch(rb"[0-9;]*", text[3:]):
                    self.io_error = 12
                    self._control.clear()
                return
            self._configure(letter, text[3:-1].decode("ascii").split(";"))
        else:
            self._answer(letter)
        self._control.clear()

    def _configure(self, letter: bytes, values: list[str]) -> None:
        numbers = [int(value) if value.isdigit() else None for value in values]
        numbers += [None] * 3
        if letter == b"@":
            self._hardwire = bool((numbers[1] or 0) & 1)
        elif letter == b"I":
            self._block = numbers[0] or 80
            self._xoff = self._block if numbers[2] == XON else None
        elif letter == b"N" and numbers[1] not in (None, XOFF):
            self._xoff = None

    def _answer(self, letter: bytes) -> None:
        if letter == b"B":
            self._say(self.size - len(self.buffer))
        elif letter == b"E":
            self._say(self.io_error)
            self.io_error = 0
        elif letter == b"L":
            self._say(self.size)
        elif letter == b"O":
            # 8 only means that the buffer is empty: the last instruction may still be drawn
            self._say(8 * (not self.buffer) + 16 * self.paused + 32 * self.lever)
        elif letter == b"K":
            self.buffer.clear()
            self._main, self._wait = self._aborted(), self.now
        elif letter == b"R":
            self._xoff, self._hardwire, self._off = None, False, False
        elif letter not in b"J(YZ)":
            self.io_error = 11

    def _say(self, number: int) -> None:
        self._out += f"{number}\r".encode("ascii")

    def _busy(self) -> bool:
        return bool(self.buffer) or not self.steppers.idle or (not callable(self._wait) and self._wait > self.now)

    # Instructions

    def _runs(self) -> bool:
        return not (self.paused or self.lever)

    def _due(self) -> float:
        due = super()._due()
        if self.powered and self.model == "7470A" and self._down and not self._busy():
            due = min(due, max(self._still_s + AUTO_LIFT_S, self.now))
        return due

    def _happen(self) -> None:
        super()._happen()
        if self._follow and self.steppers.idle:
            self._pen_follows()
        if self.model == "7470A" and self._down and self._still_s + AUTO_LIFT_S <= self.now and not self._busy():
            self.recorder.settle(self.now)
            self.recorder.pen(self.now, down=False)
            self._still_s = inf

    def _byte(self) -> Main:
        """Wait for a byte; it is left in the buffer."""
        if not self.buffer:
            self._still_s = self.now
            yield lambda: bool(self.buffer)

    def _pop(self) -> str:
        char = chr(self.buffer.popleft())
        self._release_host()
        return char

    def _aborted(self) -> Main:
        """ESC.K: the vector that runs is finished, all else forgotten."""
        yield lambda: self.steppers.idle
        yield from self._instructions()

    def _instructions(self) -> Main:
        while True:
            yield from self._byte()
            first = self._pop()
            if not first.isalpha():
                if first not in ";, \r\n\t":
                    self.error = 1
                continue
            yield from self._byte()
            name = (first + self._pop()).upper()
            if not name[1].isalpha():
                self.error = 1
                continue
            yield from self._instruction(name)

    def _instruction(self, name: str) -> Main:
        """Its parameters, up to a semicolon or the next letter; points are gone to as soon as a pair is there."""
        values: list[float] = []
        text = ""
        moves = name in ("PU", "PD", "PA", "PR")
        skip = self._fails > 0
        if skip:
            self._fails -= 1
            self.error = 1
        if name in ("PU", "PD") and not skip:
            yield from self._pen(down=name == "PD")
        if name in ("PA", "PR"):
            self._relative = name == "PR"
        while True:
            yield from self._byte()
            char = chr(self.buffer[0])
            if char.isdigit() or char in "+-.":
                text += self._pop()
                continue
            if not char.isalpha():
                self._pop()
            if text:
                values.append(_number(text))
                text = ""
                if moves and len(values) % 2 == 0 and not skip:
                    yield from self._go(values[-2], values[-1])
            if char.isalpha() or char == ";":
                break
            if char not in ", \r\n\t":
                self.error = 3
        self.received.append(f"{name}{','.join(f'{v:g}' for v in values)};")
        if moves and len(values) % 2:
            self.error = 2
        elif not skip and not moves:
            yield from self._simple(name, values)

    def _simple(self, name: str, values: list[float]) -> Main:
        if name in ("IN", "DF"):
            yield from self._pen(down=False)
            at = self._at
            self._reset_graphics()
            self._at = at
        elif name == "SP":
            yield from self._select(int(values[0]) if values else 0)
        elif name == "VS":
            self._speed_cm_s = min(max(values[0], 0.38), 127) if values else 38.1
        elif name in OUTPUTS:
            self._output(name)
        elif name not in SILENT:
            self.error = 1

    def _output(self, name: str) -> None:
        x, y = self._at
        pen = int(self._down)
        low, high = self.limits
        if name in ("OA", "OC"):
            self._out += f"{x},{y},{pen}\r".encode("ascii")
        elif name == "OE":
            self._say(self.error)
            self.error = 0
        elif name == "OF":
            self._out += b"40,40\r"
        elif name in ("OH", "OP", "OW"):
            self._out += f"{low[0]},{low[1]},{high[0]},{high[1]}\r".encode("ascii")
        elif name == "OI":
            self._out += f"{self.model}\r".encode("ascii")
        elif name == "OO":
            self._out += b"0,1,0,0,1,0,0,0\r"
        else:
            self._say(int(self._down) + 8 * self.initialized + 16 + 32 * (self.error > 0))
            self.initialized = False

    # Motion

    def _pen(self, *, down: bool) -> Main:
        if down == self._down and self.recorder.down == (down and self.slot > 0):
            return
        self._down = down
        wait = self.profile.tool.lower_s if down else self.profile.tool.raise_s
        self.recorder.settle(self.now)
        self.recorder.pen(self.now + self.touch.late(down), down=down and self.slot > 0)
        yield self.now + wait

    def _select(self, slot: int) -> Main:
        if not 0 <= slot <= self.pens:
            self.error = 3
            return
        yield from self._pen(down=False)
        if slot != self.slot:
            yield self.now + PEN_S
            self.slot = slot
            self.recorder.swap(slot)

    def _go(self, x: float, y: float) -> Main:
        if self._relative:
            x, y = self._at[0] + x, self._at[1] + y
        if not (abs(x) <= 32767 and abs(y) <= 32767):
            self.error = 6
            return
        self._still_s = inf
        begin, end = self._at, (int(x), int(y))
        self._at = end
        inside = _clipped(begin, end, self.limits)
        if inside is None:
            yield from self._lifted(self._clamped(end))
            return
        if inside[0] != begin and self._down:
            yield from self._lifted(inside[0])
        yield from self._vector(inside[1])
        if inside[1] != end and self._down:
            yield from self._lifted(self._clamped(end))

    def _lifted(self, to: Spot) -> Main:
        """Beyond the limits the pen is up."""
        self.recorder.settle(self.now)
        self.recorder.pen(self.now, down=False)
        yield from self._vector(to)
        inside = self._clamped(self._at) == self._at
        self.recorder.pen(self.now, down=self._down and self.slot > 0 and inside)

    def _vector(self, to: Spot) -> Main:
        speed = self._speed_cm_s * 10 if self._down else 381.0
        if self.steppers.add((to[0] * self.unit_mm, to[1] * self.unit_mm, 0.0), speed):
            self.steppers.begin(self.now)
            yield lambda: self.steppers.idle

    def _clamped(self, at: Spot) -> Spot:
        (x0, y0), (x1, y1) = self.limits
        return min(max(at[0], x0), x1), min(max(at[1], y0), y1)

    def _real(self, place: Place) -> Spot:
        return place[0], place[1]  # it finds its zero itself


def _limits(profile: Profile) -> tuple[tuple[int, int], tuple[int, int]]:
    """The hard-clip limits in units, of the first paper."""
    unit = profile.dialect.unit_mm if isinstance(profile.dialect, Dialect) else 0.025
    spans = [(paper.x_mm, paper.y_mm) for paper in profile.papers] or [(profile.machine.x_mm, profile.machine.y_mm)]
    x, y = max(spans, key=lambda span: span[0][1])
    return (round(x[0] / unit), round(y[0] / unit)), (round(x[1] / unit), round(y[1] / unit))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def _clipped(a: Spot, b: Spot, limits: tuple[Spot, Spot]) -> tuple[Spot, Spot] | None:
    """The part of a line within a rectangle (Liang, Barsky 1984)."""
    enter, leave = 0.0, 1.0
    for k in range(2):
        d = b[k] - a[k]
        for low, sign in ((limits[0][k], 1), (limits[1][k], -1)):
            way, room = sign * d, sign * (low - a[k])
            if way == 0:
                if room > 0:
                    return None
            elif way > 0:
                enter = max(enter, room / way)
            else:
                leave = min(leave, room / way)
    if enter > leave:
        return None

    def at(t: float) -> Spot:
        return a if t == 0 else b if t == 1 else (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]))

    return at(enter), at(leave)
