"""HP-GL pen plotters: what fits the buffer is sent, which is asked for (ESC.B); fences answer with a place.

The plotter tells its free bytes; no more than these, less a reserve, are sent, so that it needs no other handshake
and nothing overflows. A fence is `OE;OA;`: carried out in its turn, it answers with an error's number and the place
where the pen is, which must be the end of the line that was drawn: a damaged coordinate there does not pass.

Numbers that come alone are told apart by their size: errors of HP-GL are 0 to 8, free bytes stay above the reserve.

Known limits: an error in the middle of a line that HP-GL can read (another digit) is drawn; that the plotter waits at
its own buttons is guessed from its buffer, which empties no more.

Source: HP 7475A Interfacing and Programming Manual, chapters 9 to 12.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from strokeplan.errors import DriveError, InputError
from strokeplan.plotter.driving.codec import Event, Fault, Fence, Fenced, Item, Note, Phrases, recognise, refuse_other
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.through import through

RESERVE = 32
"""Bytes of the buffer that stay free."""
AHEAD = 3
"""Lines that are under way at most: a pause waits for them."""
ASK_S = 0.1
ANSWER_S = 2.0
TRIES = 6
LATE_S = 10.0
"""A fence is not answered, with an empty buffer, for so long: the answer is lost."""
STILL_S = 30.0
STOP_S = 30.0
GREETINGS = 6
FENCE = "OE;OA;"
_PAIR = r"-?\d+,-?\d+"
_COMMAND = re.compile(rf"(?:IN|PA|PR|PU|PD|(?:PA|PR|PU|PD){_PAIR}(?:,{_PAIR})*|PS\d+|SP\d+|VS\d+(?:\.\d+)?);", re.ASCII)
_PLACE = re.compile(r"(-?\d+),(-?\d+),[01]")
_ERRORS = {1: "an instruction", 2: "a number of parameters", 3: "a parameter", 5: "a character set", 6: "a place"}


@dataclass(slots=True)
class _Awaited:
    """A fence: its key, and where the pen must be."""

    key: int
    at: tuple[int, int] | None


class HpglCodec:
    """The codec of a pen plotter (codec.py tells what its methods are for)."""

    name = "HP-GL"
    halted = ""
    kept = True  # it finds its zero when it is switched on

    def __init__(self, phrases: Phrases, size: int) -> None:
        self.phrases, self.size = phrases, size
        self.link: Link | None = None
        self.credit = 0
        self.asked_s: float | None = None
        """When the free bytes were asked for; None: no answer is awaited."""
        self.ask_at = 0.0
        self.tries = 0
        self.awaited: list[_Awaited] = []
        self.clean = False
        self.at: tuple[int, int] | None = None
        self.relative = False
        self.seen: tuple[int, int] | None = None
        """The last place that OA told."""
        self.out = b""
        self.free = -1
        self.moved_s = 0.0
        """When something last happened at the plotter."""
        self.told = False

    # Conversations

    def greet(self, link: Link) -> str:
        self.link = link
        for _ in range(GREETINGS):
            link.forget()
            link.push(b"\x1b.R\x1b.K\x1b.B\r")
            found = link.hear(self._number_or_other, ANSWER_S)
            if found is not None:
                link.drain(0.2)
                link.push(b"\x1b.L")
                size = link.hear(lambda line: int(line) if line.isdigit() else None, ANSWER_S)
                self.size = size if size and size >= RESERVE + 40 else self.size
                link.push(b"OI;")
                model = link.hear(lambda line: line if re.search(r"\d", line) and "," not in line else None, 5.0)
                link.drain(0.2)
                return f"plotter {model or 'of a model that it does not tell'}, {self.size} bytes"
        raise DriveError("no answer: is the plotter on, is this its port, is the speed (--baud) that of its switches?")

    def _number_or_other(self, line: str) -> int | None:
        refuse_other(self.name, recognise(line))
        return int(line) if line.isdigit() else None

    def home(self, link: Link) -> None:
        raise DriveError("a pen plotter finds its own zero: leave out --home")

    def start(self, link: Link) -> None:
        self.say(link, (*self.phrases.start, *self.phrases.up))

    def say(self, link: Link, commands: tuple[str, ...]) -> None:
        self.moved_s = link.now()
        through(self, link, commands)

    def place(self, link: Link) -> tuple[float, float] | None:
        self.seen = None
        self.say(link, ())
        return self.seen

    def put(self, link: Link, x: float, y: float) -> str:
        raise InputError("a pen plotter's zero is its own: move the sheet, or the drawing on it")

    def stop(self, link: Link, fault: Fault | None = None) -> bool:
        link.forget()
        link.push(b"\x1b.K")
        link.drain(0.3, 2.0)
        self._clear()
        link.push(b";")  # ends what stood in the middle of an instruction
        self.moved_s = link.now()
        through(self, link, (*self.phrases.up, "SP0;"), STOP_S)
        return True

    def emergency(self, link: Link) -> None:
        link.forget()
        link.push(b"\x1b.K;PU;")

    def _clear(self) -> None:
        self.awaited.clear()
        self.credit, self.asked_s, self.out, self.at = 0, None, b"", None
        self.tries = 0

    # Streaming

    def check(self, command: str) -> None:
        if _COMMAND.fullmatch(command) is None:
            raise DriveError(f"{command!r} is no command of drawing: it is not sent")

    def take(self, item: Item, now: float) -> bool:
        text = FENCE if isinstance(item, Fence) else item
        if len(self.awaited) >= AHEAD:
            return False
        if len(text) > self.credit or self.asked_s is not None:
            self._ask(now)
            return False
        self.credit -= len(text)
        self.out += text.encode("ascii")
        if isinstance(item, Fence):
            if not self.awaited:
                self.moved_s = now
            self.awaited.append(_Awaited(item.key, self.at))
        else:
            self._follow(item)
        return True

    def _follow(self, command: str) -> None:
        """Where the pen is after a command, in units; None: not known."""
        word, numbers = command[:2], [int(text) for text in re.findall(r"-?\d+", command)]
        if word == "IN":
            self.at, self.relative = None, False
        if word in ("PA", "PR"):
            self.relative = word == "PR"
        if word not in ("PA", "PR", "PU", "PD") or not numbers:
            return
        if not self.relative:
            self.at = numbers[-2], numbers[-1]
        elif self.at is not None:
            self.at = self.at[0] + sum(numbers[::2]), self.at[1] + sum(numbers[1::2])

    def _ask(self, now: float) -> None:
        """Ask for the free bytes, if that was not just done."""
        if self.asked_s is None and now >= self.ask_at:
            self.out += b"\x1b.B"
            self.asked_s = now

    def outgoing(self, now: float) -> bytes:
        if self.awaited and now >= self.ask_at:
            self._ask(now)  # so that it is known that the plotter lives
        if self.asked_s is not None and now - self.asked_s > ANSWER_S:
            self.asked_s, self.tries = now, self.tries + 1
            self.out += b"\x1b.B"
        data, self.out = self.out, b""
        return data

    def wait_s(self, now: float) -> float:
        if self.asked_s is not None:
            return max(self.asked_s + ANSWER_S - now, 0.0)
        return max(self.ask_at - now, 0.0) if self.awaited or self.ask_at > now else ASK_S

    def feed(self, data: bytes, now: float) -> list[Event]:
        if self.link is None:
            return []
        events: list[Event] = []
        for line in self.link.lines(data):
            if found := _PLACE.fullmatch(line):
                events += self._placed((int(found[1]), int(found[2])), now)
            elif line.isdigit():
                events += self._counted(int(line), now)
        return events

    def _counted(self, number: int, now: float) -> list[Event]:
        if number == 0:
            self.clean = bool(self.awaited)
        elif number in _ERRORS or number < RESERVE // 2:
            what = _ERRORS.get(number, "what it got")
            return [Fault("confused", f"the plotter does not understand {what} (error {number}): bytes were damaged")]
        elif self.asked_s is not None and number <= self.size:
            if number != self.free:
                self.free, self.moved_s, self.told = number, now, False
            self.credit, self.asked_s, self.tries = number - RESERVE, None, 0
            self.ask_at = now + (ASK_S if number < self.size // 2 or self.awaited else 0.0)
        return []

    def _placed(self, at: tuple[int, int], now: float) -> list[Event]:
        """The answer of a fence. The error's number is read once: where an answer is lost, an error may be."""
        clean, self.clean = self.clean, False
        self.seen = at
        self.moved_s = now
        if not self.awaited:
            return []
        awaited = self.awaited.pop(0)
        if awaited.at not in (at, None):
            return [
                Fault("confused", f"the pen is at {at[0]},{at[1]}, where no line ends: bytes were damaged, or lost")
            ]
        if not clean:
            return [Fault("confused", "the plotter's answer was damaged on the way: an error may have gone with it")]
        return [Fenced(awaited.key)]

    def overdue(self, now: float) -> list[Event]:
        if self.tries >= TRIES:
            return [Fault("silent", f"the plotter says nothing for {TRIES * ANSWER_S:g} s")]
        if not self.awaited or now - self.moved_s < LATE_S:
            return []
        if self.free >= self.size:
            return [Fault("confused", "the plotter has nothing to do, and does not say where its pen is")]
        if now - self.moved_s > STILL_S and not self.told:
            self.told = True
            return [Note("the plotter does not go on: is it paused, or the lever of its paper up?")]
        return []
