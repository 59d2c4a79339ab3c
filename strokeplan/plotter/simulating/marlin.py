"""Marlin 2: numbered lines with checksums, Resend, a queue of four commands, `busy` while it works.

Bytes come into a ring of 128 and out of it into lines as long as the queue has room, even while a command blocks;
a line longer than 95 characters is cut without a word. A command is answered when it has been done, which for a move
means that it is in the planner.

Sources: Marlin's G-code index and configuration documents; behaviour of MarlinFirmware/Marlin's queue.cpp, emergency
parser and host keepalive.
Known limits: no heaters, no SD card, no leveling; soft endstops clamp after G28 as Marlin's do.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Generator
from dataclasses import dataclass
from functools import reduce
from math import atan2, ceil, cos, hypot, inf, pi, sin

import numpy as np

from strokeplan.curves import flatten
from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.device import Device, Main, Wait
from strokeplan.plotter.simulating.recording import Spot
from strokeplan.plotter.simulating.steppers import Place

RX = 128
BUFSIZE = 4
MAX_CMD_SIZE = 96
BUSY_S = 2.0
PARSE_S = 0.0005  # [assumed]
HOMING_S = 5.0  # [assumed]
SETTINGS = {
    *range(20, 35), 92, *range(200, 210), 301, 304, *range(500, 505), 540, 569, 575, 851, 906, 913, 914, 928, 936, 997,
}  # fmt: skip
"""M numbers that change settings, firmware or files."""
IDLE = {
    "G17", "G40", "G49", "G54", "G80", "G94", "M3", "M4", "M5", "M7", "M8", "M9", "M17", "M82", "M83", "M85", "M106",
    "M107", "M108", "M113", "M117", "M211", "M300", "M410",
}  # fmt: skip
"""Known, and nothing that a pen feels."""
URGENT = re.compile(rb"\s*(?:N\d+\s*)?M(108|112|410)(?!\d)")


@dataclass(frozen=True, slots=True)
class Build:
    """What a Marlin is built with."""

    emergency_parser: bool = False
    ok_after_resend: bool = True
    advanced_ok: bool = False
    arcs: bool = True
    cubics: bool = False
    name: str = "Ender-3"


class Marlin(Device):
    """A board with Marlin."""

    blocks = 15
    end = b"\n"

    def __init__(
        self, profile: Profile, build: Build | None = None, *, resets: bool = True, boot_s: float = 2.0,
        at_mm: Spot = (0.0, 0.0),
    ) -> None:  # fmt: skip
        self.build = build or Build()
        self.rx: deque[int] = deque()
        self.lost = 0
        self._storm = 0
        super().__init__(profile, resets=resets, boot_s=boot_s, at_mm=at_mm)

    def _lose(self) -> None:
        self.rx.clear()
        self.queue: deque[tuple[str, int | None]] = deque()
        self._line, self._isr, self._comment = bytearray(), bytearray(), False
        self._deaf_until = self.now + self.boot_s
        self._last_n = 0
        self._killed = self._homed = False
        self._absolute, self._scale, self._feed = True, 1.0, 1500.0
        self._position: Place = (0.0, 0.0, 0.0)
        self._offset: Place = (0.0, 0.0, 0.0)
        """Logical coordinates plus this are the motors' count (G92)."""
        self._busy_s, self._busy = inf, "processing"
        self._user = False
        self._stand_s = 0.0

    def boot(self) -> Main:
        yield self.now + self.boot_s
        self.say("start")
        self.say("echo:Marlin 2.1.2")
        self.say("")
        self.say("echo: Free Memory: 5124  PlannerBufferBytes: 1168")
        yield from self._loop()

    # The world

    def alarm(self, code: int, at_s: float) -> None:
        """A heater or a driver is out of control: Marlin kills itself."""
        super().alarm(code, at_s)
        if self.powered:
            self._kill()

    def fail(self, code: int) -> None:
        """The next line is found damaged."""
        self._storm += 1

    def _kill(self) -> None:
        self._quickstop()
        self._killed = True
        self._busy_s = inf
        self.queue.clear()
        self.say("Error:Printer halted. kill() called!")
        self._main = None

    def _quickstop(self) -> None:
        self._trace(self.now)
        before = self.steppers.place(self.now)
        x, y = self.steppers.kill(self.now)
        self._overrun(before, x, y)
        at = self.steppers.count
        self._position = tuple(a - o for a, o in zip(at, self._offset, strict=True))  # type: ignore[assignment]

    # Bytes

    def _take(self, data: bytes) -> None:
        for byte in data:
            if self._killed or self.now < self._deaf_until:
                self.lost += 1
                continue
            if self.build.emergency_parser:
                self._watch(byte)
            if len(self.rx) < RX:
                self.rx.append(byte)
            else:
                self.lost += 1
            self._read()

    def _watch(self, byte: int) -> None:
        """The emergency parser sees bytes before any buffer."""
        if byte not in b"\r\n":
            self._isr.append(byte)
            return
        found = URGENT.match(bytes(self._isr))
        self._isr.clear()
        if found:
            self._urgent(int(found[1]))

    def _urgent(self, number: int) -> None:
        if number == 108:
            self._user = False
        elif number == 410:
            self._quickstop()
        else:
            self._kill()

    def _read(self) -> None:
        """Bytes become lines while the queue has room: in the main loop and while a command waits."""
        while self.rx and len(self.queue) < BUFSIZE and not self._killed:
            byte = self.rx.popleft()
            if byte in b"\r\n":
                line, self._line, self._comment = bytes(self._line), bytearray(), False
                if line.strip():
                    self._line_done(line)
            elif byte == ord(";"):
                self._comment = True
            elif not self._comment and len(self._line) < MAX_CMD_SIZE - 1:
                self._line.append(byte)

    def _line_done(self, line: bytes) -> None:
        text = line.decode("latin-1").strip()
        number: int | None = None
        if text.startswith("N"):
            setting = re.search(r"M110\b(?:\s*N(-?\d+))?", text)
            found = re.match(r"N\s*(-?\d+)", text)
            number = int(setting[1] if setting and setting[1] else found[1] if found else 0)
            if self._storm:
                self._storm -= 1
                self._damaged("checksum mismatch")
                return
            if number != self._last_n + 1 and not setting:
                self._damaged("Line Number is not Last Line Number+1")
                return
            body, star, given = text.rpartition("*")
            if not star:
                self._damaged("No Checksum with line number")
                return
            value = re.match(r"\s*\d+", given)
            if (int(value[0]) if value else 0) != reduce(lambda a, b: a ^ b, body.encode("latin-1"), 0):
                self._damaged("checksum mismatch")
                return
            self._last_n = number
            text = re.sub(r"^N\s*-?\d+\s*", "", body)
        text = text.split("*")[0].strip()
        if not self.build.emergency_parser and text in ("M108", "M112", "M410"):
            self._urgent(int(text[1:]))
            if self._killed:
                return
        self.queue.append((text, number))

    def _damaged(self, what: str) -> None:
        self.say(f"Error:{what}, Last Line: {self._last_n}")
        self.rx.clear()
        self._line.clear()
        self.say(f"Resend: {self._last_n + 1}")
        if self.build.ok_after_resend:
            self.say("ok")

    # Time

    def _due(self) -> float:
        due = super()._due()
        return min(due, self._busy_s) if self.powered else due

    def _happen(self) -> None:
        super()._happen()
        if self._busy_s <= self.now:
            self.say(f"echo:busy: {self._busy}")
            self._busy_s = self.now + BUSY_S

    # Commands

    def _loop(self) -> Main:
        while True:
            self._read()
            if not self.queue:
                self.steppers.begin(self.now)
                yield lambda: bool(self.queue)
            text, number = self.queue[0]
            self._busy_s, self._busy = self.now + BUSY_S, "processing"
            yield self.now + PARSE_S
            self.received.append(text)
            yield from self._command(text)
            self._busy_s = inf
            self.queue.popleft()
            room = f" P{self.blocks - self.steppers.held} B{BUFSIZE - len(self.queue)}"
            name = f" N{number}" if number is not None else ""
            self.say(f"ok{name}{room}" if self.build.advanced_ok else "ok")
            self._read()

    def _command(self, text: str) -> Main:
        found = re.match(r"([GMT])\s*(\d+)(?:\.\d+)?", text)
        if not found:
            self.say(f'echo:Unknown command: "{text}"')
            return
        word, rest = f"{found[1]}{int(found[2])}", text[found.end() :]
        values = {m[0]: float(m[1] or 0) for m in re.findall(r"([A-Z])\s*(-?\d*\.?\d+|)", rest)}
        if found[1] == "M" and int(found[2]) in SETTINGS:
            self.forbid(text)
        if word in ("G0", "G1"):
            yield from self._line_to(values)
        elif word in ("G2", "G3") and self.build.arcs:
            yield from self._arc(values, left=word == "G3")
        elif word == "G5" and self.build.cubics:
            yield from self._cubic(values)
        elif not (yield from self._other(word, values)):
            self.say(f'echo:Unknown command: "{text}"')

    def _other(self, word: str, values: dict[str, float]) -> Generator[Wait, None, bool]:
        """Everything but moves; whether the command is known (the generator's value)."""
        if word == "G4":
            yield from self._still()
            yield self.now + (values["S"] if "S" in values else values.get("P", 0.0) / 1000)
        elif word == "G28":
            yield from self._home()
        elif word == "G92":
            yield from self._still()
            self._set_position(values)
        elif word in ("G20", "G21"):
            self._scale = 25.4 if word == "G20" else 1.0
        elif word in ("G90", "G91"):
            self._absolute = word == "G90"
        elif word in ("M400", "M84", "M18"):
            yield from self._still()
        elif word in ("M0", "M1"):
            yield from self._pause(values)
        elif word == "M280":
            self._servo(values)
        elif word in ("M114", "M115", "M105", "M119"):
            self._report(word)
        elif word == "M110":
            self._last_n = int(values.get("N", self._last_n))
        elif word not in IDLE:
            return int(word[1:]) in SETTINGS
        return True

    def _still(self) -> Main:
        self.steppers.begin(self.now)
        yield lambda: self.steppers.idle

    def _pause(self, values: dict[str, float]) -> Main:
        yield from self._still()
        self._busy, self._user = "paused for user", True
        self.say("//action:prompt_end")
        until = self.now + (values["S"] if "S" in values else values["P"] / 1000) if {"S", "P"} & set(values) else inf
        if until < inf:
            yield until
        else:
            yield lambda: not self._user
        self._busy = "processing"

    def _servo(self, values: dict[str, float]) -> None:
        down = self.touch.angle(int(values.get("P", 0)), values.get("S", 0.0))
        if down is not None:
            self.recorder.settle(self.now)
            self.recorder.pen(self.now + self.touch.late(down), down=down)

    def _report(self, word: str) -> None:
        if word == "M114":
            x, y, z = self._position
            steps = [round(at * 80) for at in self.steppers.place(self.now)]
            self.say(f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 Count X:{steps[0]} Y:{steps[1]} Z:{steps[2]}")
        elif word == "M115":
            self.say(
                "FIRMWARE_NAME:Marlin 2.1.2 (Jan 15 2023 12:00:00) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin "
                f"PROTOCOL_VERSION:1.0 MACHINE_TYPE:{self.build.name} EXTRUDER_COUNT:1 "
                "UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff"
            )
            caps = {"SERIAL_XON_XOFF": 0, "EEPROM": 1, "EMERGENCY_PARSER": int(self.build.emergency_parser),
                    "HOST_ACTION_COMMANDS": 1, "PROMPT_SUPPORT": 0, "ARCS": int(self.build.arcs)}  # fmt: skip
            for name, value in caps.items():
                self.say(f"Cap:{name}:{value}")
        elif word == "M105":
            self.say(" T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0")
        else:
            self.say("Reporting endstop status")

    # Moves

    def _to(self, values: dict[str, float]) -> Place:
        at = list(self._position)
        for k, letter in enumerate("XYZ"):
            if letter in values:
                value = values[letter] * self._scale
                at[k] = value if self._absolute else at[k] + value
        if self._homed:  # soft endstops
            machine = self.profile.machine
            at[0] = min(max(at[0], machine.x_mm[0]), machine.x_mm[1])
            at[1] = min(max(at[1], machine.y_mm[0]), machine.y_mm[1])
        if values.get("F"):
            self._feed = values["F"] * self._scale
        return at[0], at[1], at[2]

    def _add(self, to: Place) -> Main:
        if self.steppers.full:
            self.steppers.begin(self.now)
            yield lambda: not self.steppers.full
        count = to[0] + self._offset[0], to[1] + self._offset[1], to[2] + self._offset[2]
        self.steppers.add(count, self._feed / 60)
        self._position = to
        if len(self.steppers.queue) > 1:
            self.steppers.begin(self.now)

    def _line_to(self, values: dict[str, float]) -> Main:
        yield from self._add(self._to(values))

    def _arc(self, values: dict[str, float], *, left: bool) -> Main:
        begin, end = self._position, self._to(values)
        i, j = values.get("I", 0.0) * self._scale, values.get("J", 0.0) * self._scale
        r = hypot(i, j)
        if r == 0:
            self.say("Error:G2/G3 bad parameters")
            return
        cx, cy = begin[0] + i, begin[1] + j
        a = atan2(-j, -i)
        turn = (atan2(end[1] - cy, end[0] - cx) - a) % (2 * pi)
        turn = (turn or 2 * pi) if left else (turn - 2 * pi if turn else -2 * pi)
        parts = max(ceil(abs(turn) * r), ceil(abs(turn) / (2 * pi) * 72), 1)
        for k in range(1, parts):
            u = a + turn * k / parts
            yield from self._add((cx + r * cos(u), cy + r * sin(u), begin[2] + (end[2] - begin[2]) * k / parts))
        yield from self._add(end)

    def _cubic(self, values: dict[str, float]) -> Main:
        a, end = self._position, self._to(values)
        first = a[0] + values.get("I", 0.0), a[1] + values.get("J", 0.0)
        second = end[0] + values.get("P", 0.0), end[1] + values.get("Q", 0.0)
        for x, y in flatten(np.array([a[:2], first, second, end[:2]], float), 0.005)[1:].tolist():
            yield from self._add((x, y, end[2]))

    def _home(self) -> Main:
        yield from self._still()
        yield self.now + HOMING_S
        if self.recorder.down:
            self.recorder.move(self.now - HOMING_S, self.now, (0.0, 0.0))
        else:
            self.recorder.carry((0.0, 0.0), self.now)
        self.slip, self._offset = (0.0, 0.0), (0.0, 0.0, 0.0)
        self.steppers.reset((0.0, 0.0, self.steppers.count[2]))
        self._position, self._homed = self.steppers.count, True

    def _set_position(self, values: dict[str, float]) -> None:
        given = [letter for letter in "XYZ" if letter in values] or list("XYZ")
        at = list(self._position)
        for letter in given:
            at["XYZ".index(letter)] = values.get(letter, 0.0) * self._scale
        count = self.steppers.planned
        self._position = at[0], at[1], at[2]
        self._offset = count[0] - at[0], count[1] - at[1], count[2] - at[2]
