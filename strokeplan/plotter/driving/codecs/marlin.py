"""Marlin: one numbered line with a checksum at a time, so that whatever is lost or damaged on the wire is sent again.

The line numbers decide, not the `ok`s: a line whose answer does not come is sent again under its number, and the
machine either takes it or asks for the next one, which says that it has it. An `ok` after `Resend:` comes from some
versions and not from others; a line is sent again only when that `ok` has come, or had the time to.
A fence is M400, which waits for the motion, and M114, whose answer (X:… Y:…) nothing else gives, and must be the place
where the line ends.

Known limits: an 8-bit checksum (XOR) misses one damaged line in 256; in builds without keepalive ("busy:"), a move
longer than the patience of a line is asked for again, which does no harm.

Sources: Marlin's queue.cpp (line numbers, resends), G-code index (M110, M113, M114, M115, M400, M112).
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from functools import partial, reduce
from operator import xor

from strokeplan.errors import DriveError
from strokeplan.plotter.dialects.gcode import number
from strokeplan.plotter.driving.codec import Event, Fault, Fence, Fenced, Item, Note, Phrases, recognise, refuse_other
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.through import through
from strokeplan.plotter.profile import Profile

MAX_LINE = 90
"""MAX_CMD_SIZE is 96: what is longer is cut without a word."""
PATIENCE_S = 6.0
"""Without any word, a line is sent again; `busy:` comes every two seconds."""
TRIES = 5
REMEMBERED = 16
NEAR_MM = 0.06
"""M114 rounds to hundredths."""
SETTLE_S = 0.15
"""An `ok` that belongs to a `Resend:` has come by then."""
GREETINGS = 5
GREETING_S = 3.0
_WORDS = {
    "G0", "G1", "G2", "G3", "G4", "G5", "G17", "G21", "G28", "G40", "G49", "G54", "G80", "G90",
    "M3", "M5", "M7", "M8", "M9", "M17", "M18", "M82", "M84", "M106", "M107", "M211", "M280", "M300", "M400",
}  # fmt: skip
_COMMAND = re.compile(r"([GM]\d+)((?: [XYZABCEIJPQSF]-?\d*(?:\.\d+)?)*)", re.ASCII)
_RESEND = re.compile(r"(?:Resend|rs)\b[:\s]*N?(\d+)", re.IGNORECASE)
_POSITION = re.compile(r"X:\s*(-?\d+\.\d+) Y:\s*(-?\d+\.\d+)")
_PLACE = re.compile(r"([XY])(-?\d+(?:\.\d+)?)")
_WIRE = ("checksum", "line number", "expected line")


def framed(number: int, command: str) -> bytes:
    """A line with its number and checksum."""
    text = f"N{number} {command}".encode("ascii")
    return text + b"*%d\n" % reduce(xor, text, 0)


@dataclass(slots=True)
class _Line:
    """The line that waits for its answer."""

    number: int
    command: str
    key: int | None
    """Of the fence that its position report proves."""
    resends: int = 0
    repeats: int = 0
    shown: bool = False


class MarlinCodec:
    """The codec of a Marlin (codec.py tells what its methods are for)."""

    name = "Marlin"
    halted = "Marlin listens no more: lift the pen, and reset the board or switch it off and on"

    def __init__(self, phrases: Phrases, profile: Profile) -> None:
        self.phrases, self.profile = phrases, profile
        self.link: Link | None = None
        self.kept = False
        self.waiting: deque[tuple[str, int | None]] = deque()
        self.line: _Line | None = None
        self.sent: deque[_Line] = deque(maxlen=REMEMBERED)
        self.rewinds = 0
        """How often in a row lines were asked for that had an answer."""
        self.number = 1
        self.out = b""
        self.heard = 0.0
        self.hold_until: float | None = None
        """After a Resend: nothing is sent until its `ok` has come, or this time."""
        self.told: set[str] = set()
        self.seen: tuple[float, float] | None = None
        """The last place that M114 showed."""
        self.at: tuple[float | None, float | None] = None, None
        """Where M114 must see the pen."""
        self.relative = False

    # Conversations

    def greet(self, link: Link) -> str:
        self.link = link
        begun = link.hear(lambda line: self.name if line == "start" else recognise(line), GREETING_S)
        refuse_other(self.name, begun)
        self.kept = begun is None  # it did not start anew
        for _ in range(GREETINGS):
            link.drain(0.3)
            link.forget()
            link.say("")
            link.say("M115")
            heard: list[str] = []
            if link.hear(partial(self._named, heard), GREETING_S):
                heard += link.drain(0.3)
                self._number_anew(link)
                return self._title(heard)
        raise DriveError("no answer: is the machine on, is this its port? (the profile speaks Marlin at 115200 baud)")

    def _named(self, heard: list[str], line: str) -> bool | None:
        heard.append(line)
        if "FIRMWARE_NAME:" in line:
            return True
        refuse_other(self.name, recognise(line))
        return None

    def _title(self, heard: list[str]) -> str:
        named = next(
            (found for line in heard if (found := re.search(r"FIRMWARE_NAME:(.*?)(?: [A-Z_]+:|$)", line))), None
        )
        return named[1].strip() if named else self.name

    def _number_anew(self, link: Link) -> None:
        """Lines are counted from 0 again; whatever was under way is forgotten."""
        self._clear()
        for _ in range(TRIES):
            link.drain(0.2)
            link.push(b"\n" + framed(0, "M110 N0"))
            if link.hear(lambda line: True if line.startswith("ok") else None, PATIENCE_S):
                link.drain(0.1)
                self.number, self.heard = 1, link.now()
                return
        raise DriveError("the machine does not answer; switch it off and on")

    def home(self, link: Link) -> None:
        through(self, link, ("G28 X Y",))

    def start(self, link: Link) -> None:
        self.say(link, self.phrases.start)
        self.say(link, self.phrases.up)

    def say(self, link: Link, commands: tuple[str, ...]) -> None:
        self.heard = link.now()
        through(self, link, commands)

    def place(self, link: Link) -> tuple[float, float] | None:
        self.seen = None
        self.say(link, ())
        return self.seen

    def put(self, link: Link, x: float, y: float) -> str:
        self.say(link, (f"G92 X{number(x)} Y{number(y)}",))
        return "G92, which lasts until the machine is homed, reset or switched off"

    def stop(self, link: Link, fault: Fault | None = None) -> bool:
        kind = fault.kind if fault else ""
        if kind == "alarm":
            raise DriveError("it has halted: see to it, switch it off and on")
        link.forget()
        if kind == "reset":
            link.drain(1.5, 10.0)
        self._number_anew(link)  # no M410 before: motors that it stops at speed lose steps, and Marlin does not say so
        self.say(link, self.phrases.start)
        known = kind not in ("reset", "silent")
        self.say(link, self.phrases.up if known else self.phrases.lift)
        if fault is None:
            self.say(link, self.phrases.park)
        return known

    def emergency(self, link: Link) -> None:
        link.forget()
        link.push(b"\nM112\n")

    def _clear(self) -> None:
        self.waiting.clear()
        self.sent.clear()
        self.rewinds, self.at, self.relative = 0, (None, None), False
        self.line, self.out, self.hold_until = None, b"", None

    # Streaming

    def check(self, command: str) -> None:
        found = _COMMAND.fullmatch(command)
        if found is None or found[1] not in _WORDS or len(command) > MAX_LINE:
            raise DriveError(f"{command!r} is no command of drawing: it is not sent")

    def take(self, item: Item, now: float) -> bool:
        if self.line is not None or self.waiting or self.hold_until is not None:
            return False
        if isinstance(item, Fence):
            self.waiting += [("M400", None), ("M114", item.key)]
        else:
            self._follow(item)
            self.waiting.append((item, None))
        self._next(now)
        return True

    def _follow(self, command: str) -> None:
        """Where the pen is after a command; None for an axis that is not known."""
        word = command.split(" ")[0]
        if word in ("G0", "G1", "G2", "G3", "G5", "G92") and not self.relative:
            found = {name: float(value) for name, value in _PLACE.findall(command)}
            self.at = found.get("X", self.at[0]), found.get("Y", self.at[1])
        elif word == "G28":
            self.at = None, None
        elif word in ("G90", "G91"):
            self.relative = word == "G91"

    def _next(self, now: float) -> None:
        """Send the line that waits."""
        if self.line is None and self.waiting and self.hold_until is None:
            command, key = self.waiting.popleft()
            self._begin(command, key, now)

    def _begin(self, command: str, key: int | None, now: float, repeats: int = 0) -> None:
        self.line = _Line(self.number, command, key, repeats=repeats)
        self.sent.append(self.line)
        self.number += 1
        self._send(now)

    def _send(self, now: float) -> None:
        if self.line is not None:
            self.out += framed(self.line.number, self.line.command)
            self.heard = now

    def outgoing(self, now: float) -> bytes:
        if self.hold_until is not None and now >= self.hold_until:
            self._released(now)
        data, self.out = self.out, b""
        return data

    def wait_s(self, now: float) -> float:
        until = self.heard + PATIENCE_S if self.hold_until is None else self.hold_until
        return max(until - now, 0.0)

    def _released(self, now: float) -> None:
        """The `ok` of a Resend has come, or never will."""
        self.hold_until = None
        if self.line is not None:
            self._send(now)
        else:
            self._next(now)

    def feed(self, data: bytes, now: float) -> list[Event]:
        if self.link is None:
            return []
        events: list[Event] = []
        for line in self.link.lines(data):
            self.heard = now
            events += self._said(line, now)
        return events

    def _said(self, line: str, now: float) -> list[Event]:
        if re.match(r"ok\b", line):
            place = _POSITION.match(line[2:].lstrip())  # some answer M114 in one line: "ok X:…"
            return (self._shown(now) if place else []) + self._acknowledged(line, now)
        if found := _RESEND.match(line):
            return self._again(int(found[1]), now)
        if place := _POSITION.match(line):
            self.seen = float(place[1]), float(place[2])
            return self._shown(now)
        if line == "start" or line.startswith("Marlin "):
            return [Fault("reset", "the machine has started anew in the middle (its power, its reset button)")]
        if "kill()" in line or line.startswith("!! KILL") or "Printer halted" in line or "STOP called" in line:
            return [Fault("alarm", f"the machine has halted: {line}")]
        if line.startswith("echo:Unknown command") and self.line is not None:
            return [Fault("refused", f"the machine refuses {self.line.command!r} ({line})")]
        if "paused for user" in line and line not in self.told:
            self.told.add(line)
            return [Note("the machine waits for someone at its own buttons")]
        if line.startswith("Error:") and not any(word in line.lower() for word in _WIRE):
            return [Fault("alarm", f"the machine reports: {line}")]
        return []

    def _acknowledged(self, line: str, now: float) -> list[Event]:
        if self.hold_until is not None:
            self._released(now)
            return []
        if self.line is None:
            return []  # a stray: numbers decide
        numbered = re.match(r"ok N(\d+)", line)
        if numbered and int(numbered[1]) != self.line.number:
            return []
        if self.line.key is not None and not self.line.shown:
            return self._ask_again(now)
        self.line = None
        self._next(now)
        return []

    def _ask_again(self, now: float) -> list[Event]:
        """M114 was answered without a position: it was damaged on the way, or the `ok` was another's."""
        if self.line is None:
            return []
        if self.line.repeats >= TRIES:
            return [Fault("confused", "the machine does not say where it is")]
        self._begin("M114", self.line.key, now, self.line.repeats + 1)
        return []

    def _shown(self, now: float) -> list[Event]:
        if self.line is None or self.line.key is None or self.line.shown:
            return []
        self.line.shown, self.rewinds = True, 0
        for wanted, seen in zip(self.at, self.seen or self.at, strict=True):
            if wanted is not None and seen is not None and abs(wanted - seen) > NEAR_MM:
                return [
                    Fault("confused", f"the pen is not where the line ends, but at {self.seen}: bytes were damaged")
                ]
        return [Fenced(self.line.key)]

    def _again(self, number: int, now: float) -> list[Event]:
        """`Resend: n`: n is the line that the machine wants next."""
        if self.line is None:
            return [] if number == self.number else self._rewound(number, now)
        if number == self.line.number:
            self.line.resends += 1
            if self.line.resends > TRIES:
                return [Fault("confused", f"the machine asks for the same line {TRIES} times: the cable is bad")]
        elif number == self.line.number + 1:
            if self.line.key is not None and not self.line.shown:
                repeats = self.line.repeats + 1
                self.waiting.appendleft(("M114", self.line.key))
                self.line = None
                if repeats > TRIES:
                    return [Fault("confused", "the machine does not say where it is")]
            else:
                self.line = None
        else:
            return self._rewound(number, now)
        self.hold_until = now + SETTLE_S
        return []

    def _rewound(self, number: int, now: float) -> list[Event]:
        """The machine wants lines from `number` on again: an `ok` was another's. The last ones are still known."""
        known = [one for one in self.sent if one.number >= number]
        if number == 1 or not known or known[0].number != number or self.rewinds >= TRIES:
            return [self._lost(number)]
        self.rewinds += 1
        for one in reversed(known):
            self.sent.remove(one)
            self.waiting.appendleft((one.command, one.key))
        self.line, self.number, self.hold_until = None, number, now + SETTLE_S
        return []

    def _lost(self, number: int) -> Fault:
        if number == 1:
            return Fault("reset", "the machine has started anew in the middle: it counts lines from 1")
        return Fault("confused", f"the machine asks for line {number}, which was carried out long ago")

    def overdue(self, now: float) -> list[Event]:
        if self.line is None or self.hold_until is not None or now - self.heard <= PATIENCE_S:
            return []
        self.line.repeats += 1
        if self.line.repeats > TRIES:
            return [Fault("silent", f"the machine says nothing for {TRIES * PATIENCE_S:g} s")]
        self._send(now)
        return []
