"""The EiBotBoard: slices of motion, never more than one that runs and one that waits.

A third one would stand in the parser, and while it does USB takes nothing, not even a stop. A move is therefore
sent only when the board says that its FIFO is empty (QG, or QM before firmware 2.6.2), asked about when the one that
runs should end. A fence is two answers in a row that nothing runs or waits, the board's own count of steps (QS), which
must be that of all moves sent, and a look at the motors' supply (QC).

The host knows the place by the steps that it sent; after an orderly stop it drives the pen home, slowly.

Known limits: without their supply the motors do not move while the board counts on: at a fence at the latest that is
found. FIFOs deeper than one (firmware 3) are not used.

Sources: EBB command set, legacy and current (evil-mad.github.io/EggBot).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from strokeplan.errors import DriveError
from strokeplan.plotter.driving.codec import Button, Event, Fault, Fence, Fenced, Item, Phrases, recognise, refuse_other
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.through import through

ANSWER_S = 2.0
GREETINGS = 4
DEPTH = 2
"""Moves in the board: one runs, one waits."""
SOON_S = 0.002
IDLES = 2
LEAST_VOLTS = 6.0
HOME_STEPS_MS = 2.4
"""80 steps a millimetre: 30 mm/s."""
HOME_MS = 1000
_COMMAND = re.compile(r"(?:(?:XM|SM|SP|S2|TP)(?:,-?\d+){1,7}|SC,(?:4|5|8|9|10|11|12|13),\d+|EM,[0-5],[0-5])", re.ASCII)
_VERSION = re.compile(r"EBB.*Version (\d+)\.(\d+)\.(\d+)")


def volts(reading: int) -> float:
    """The motors' supply, from QC's second number."""
    return reading / 1023 * 3.3 * 9.2 + 0.3


@dataclass(slots=True)
class _Asked:
    """The command whose answer is awaited."""

    text: str
    sent_s: float
    motion_s: float = 0.0
    steps: tuple[int, int] = (0, 0)
    answered: bool = False
    """QS, QC: the number has come, and not yet the OK."""

    @property
    def name(self) -> str:
        return self.text.split(",")[0]


class EbbCodec:
    """The codec of an EiBotBoard (codec.py tells what its methods are for)."""

    name = "EBB"
    halted = ""
    kept = False  # EM counts from where the pen stands

    def __init__(self, phrases: Phrases) -> None:
        self.phrases = phrases
        self.link: Link | None = None
        self.version = (2, 8, 0)
        self._clear()
        self.steps = [0, 0]
        """Where motors 1 and 2 are from home."""
        self.zero = [0, 0]
        """Where the board counts from: EM begins anew."""
        self.sure = True
        """Whether every command was answered."""
        self.strict = True
        """Whether fences look at steps and power."""

    def _clear(self) -> None:
        self.asked: _Asked | None = None
        self.inside = 0
        """Moves in the board, at most."""
        self.busy_until = self.ask_at = 0.0
        self.fence: int | None = None
        self.idles = 0
        self.settling = False
        """Something is to be sent that waits for all moves."""
        self.questions: list[str] = []
        """What is still asked at the fence."""
        self.out = b""

    # Conversations

    def greet(self, link: Link) -> str:
        self.link = link
        for _ in range(GREETINGS):
            link.forget()
            link.say("?", "\r")  # what is left of an earlier command, if anything, is refused with it
            link.drain(0.1, 1.0)
            link.say("V", "\r")
            found = link.hear(self._versioned, ANSWER_S)
            if found is not None:
                self.version = (int(found[1]), int(found[2]), int(found[3]))
                link.drain(0.1, 1.0)
                self._plain(link)
                self._power(link)
                return f"EiBotBoard, firmware {'.'.join(map(str, self.version))}"
        raise DriveError("no answer: is the machine on, is this its port? (the profile speaks EBB)")

    def _versioned(self, line: str) -> re.Match[str] | None:
        refuse_other(self.name, recognise(line))
        return _VERSION.search(line)

    def _plain(self, link: Link) -> None:
        """Future syntax off, which another program may have left on."""
        if self.version >= (3, 0, 0):
            link.say("CU,10,0", "\r")
            link.drain(0.1, 1.0)

    def _power(self, link: Link) -> None:
        link.say("QC", "\r")
        found = link.hear(lambda line: re.search(r"(\d+),(\d+)", line), ANSWER_S)
        link.drain(0.05, 1.0)
        if found is not None and volts(int(found[2])) < LEAST_VOLTS:
            raise DriveError(f"the motors have no power ({volts(int(found[2])):.1f} V): plug in the machine's supply")

    def home(self, link: Link) -> None:
        raise DriveError("this machine has no switches: put the carriage to its home corner by hand, leave out --home")

    def start(self, link: Link) -> None:
        self.steps, self.zero, self.sure, self.strict = [0, 0], [0, 0], True, True
        self.say(link, (*self.phrases.start, *self.phrases.up))

    def say(self, link: Link, commands: tuple[str, ...]) -> None:
        through(self, link, commands)

    def stop(self, link: Link, fault: Fault | None = None) -> bool:
        link.forget()
        self.sure = self.sure and self.asked is None
        if self.asked is not None:
            name = self.asked.name
            ended = link.hear(lambda line: True if line in ("OK", name) or line.startswith("!") else None, ANSWER_S)
            if ended is not None and self.asked.motion_s:
                self._moved(self.asked)
                self.sure = True
        link.drain(0.1, 1.0)
        self._clear()
        self.strict = False  # what is wrong is known
        self.say(link, self.phrases.up)
        known = self.sure and (fault is None or fault.kind in ("refused", "confused", "held"))
        if known:
            self.say(link, self._way_home())
        self.say(link, ("EM,0,0",))
        return known

    def _way_home(self) -> tuple[str, ...]:
        """Back to where the motors were switched on, in slices of a second."""
        commands = []
        count = int(max(map(abs, self.steps)) / HOME_STEPS_MS / HOME_MS) + 1
        for k in range(count):
            one, two = (-(value * (k + 1) // count - value * k // count) for value in self.steps)
            if one or two:
                commands.append(f"SM,{int(max(abs(one), abs(two)) / HOME_STEPS_MS) + 10},{one},{two}")
        return tuple(commands)

    def emergency(self, link: Link) -> None:
        link.forget()
        link.push(b"\rES\r" + (b"SP,3\r" if self.version >= (3, 0, 1) else b"SP,1\r"))

    # Streaming

    def check(self, command: str) -> None:
        if _COMMAND.fullmatch(command) is None:
            raise DriveError(f"{command!r} is no command of drawing: it is not sent")

    def take(self, item: Item, now: float) -> bool:
        if self.asked is not None or self.fence is not None:
            return False
        if isinstance(item, Fence):
            self.fence, self.idles, self.questions = item.key, 0, ["QS", "QC"] if self.strict else []
            self.ask_at = min(self.busy_until, now + ANSWER_S)
            return True
        if item.startswith("EM") and self.inside:  # it acts at once, in the middle of a move
            self.settling = True
            return False
        self.settling = False
        seconds, steps = _motion(item)
        if seconds and self.inside >= DEPTH:
            return False
        self._send(_Asked(item, now, seconds, steps))
        return True

    def _send(self, asked: _Asked) -> None:
        self.asked = asked
        self.out += asked.text.encode("ascii") + b"\r"

    def outgoing(self, now: float) -> bytes:
        if self.asked is None and now >= self.ask_at and self._curious:
            done = self.fence is not None and self.idles >= IDLES
            self._send(_Asked(self.questions.pop(0) if done and self.questions else self._question, now))
        data, self.out = self.out, b""
        return data

    @property
    def _curious(self) -> bool:
        """Whether the board is to be asked what it does."""
        return self.fence is not None or self.inside >= DEPTH or self.settling

    @property
    def _question(self) -> str:
        return "QG" if self.version >= (2, 6, 2) else "QM"

    def wait_s(self, now: float) -> float:
        if self.asked is not None:
            return max(self.asked.sent_s + self._patience() - now, 0.0)
        return max(self.ask_at - now, 0.0)

    def _patience(self) -> float:
        motion_s = self.asked.motion_s if self.asked else 0.0
        return ANSWER_S + motion_s + max(self.busy_until - (self.asked.sent_s if self.asked else 0.0), 0.0)

    def feed(self, data: bytes, now: float) -> list[Event]:
        if self.link is None:
            return []
        events: list[Event] = []
        for line in self.link.lines(data):
            if _VERSION.search(line):
                events.append(Fault("reset", "the board has started anew in the middle"))
            elif self.asked is not None:
                events += self._answered(self.asked, line, now)
        return events

    def _answered(self, asked: _Asked, line: str, now: float) -> list[Event]:
        name = asked.name
        text = line.removeprefix(f"{name},") if line != name else "OK"  # "XM", "QG,3E": future syntax
        if text.startswith("!"):
            self.asked = None
            return [Fault("refused", f"the machine refuses {asked.text!r} ({text})")]
        if name in ("QG", "QM"):
            return self._state(name, text, now)
        if name in ("QS", "QC"):
            return self._told(asked, text, whole=line.startswith(f"{name},"))
        if text == "OK":
            self.asked = None
            if name == "EM":
                self.zero = list(self.steps)
            if asked.motion_s:
                self._moved(asked)
                self.busy_until = max(now, self.busy_until) + asked.motion_s
                self.ask_at = self.busy_until - asked.motion_s
        return []

    def _moved(self, asked: _Asked) -> None:
        self.inside += 1
        self.steps = [self.steps[0] + asked.steps[0], self.steps[1] + asked.steps[1]]

    def _state(self, name: str, text: str, now: float) -> list[Event]:
        """What QG (bits) or QM (fields) tells of the moves in the board."""
        if name == "QG":
            if not re.fullmatch(r"[0-9A-Fa-f]{2}", text):
                return []
            bits = int(text, 16)
            runs, waits, button = bool(bits & 8), bool(bits & 1), bool(bits & 32)
        else:
            found = re.fullmatch(r"(\d),\d,\d,(\d)", text)
            if found is None:
                return []
            runs, waits, button = found[1] != "0", found[2] != "0", False
        self.asked = None
        self.inside = runs + (waits * (DEPTH - 1))
        if not runs and not waits:
            self.idles += 1
            if self.fence is not None and self.idles >= IDLES and not self.questions:
                return self._passed()
            self.busy_until = now
            self.ask_at = now
        else:
            self.idles = 0
            self.ask_at = max(now + SOON_S, min(self.busy_until, now + 0.5) if self.fence is not None else 0.0)
        return [Button()] if button else []

    def _told(self, asked: _Asked, text: str, *, whole: bool) -> list[Event]:
        """A number at a fence, and the OK behind it, which only legacy syntax has; `whole` if none follows."""
        if found := re.fullmatch(r"(-?\d+),(-?\d+)", text):
            asked.answered = True
            wrong = self._compared(asked.name, int(found[1]), int(found[2]))
            if wrong is not None:
                self.asked = None
                return [wrong]
        if not (text == "OK" or (whole and asked.answered)):
            return []
        self.asked = None
        if not asked.answered:  # the number was damaged on the way
            self.questions.insert(0, asked.name)
        elif asked.name == "QC":
            return self._passed()
        return []

    def _compared(self, name: str, one: int, two: int) -> Fault | None:
        """What is wrong with the steps of the two motors, or with their supply."""
        if name == "QS" and [one, two] != [self.steps[k] - self.zero[k] for k in range(2)]:
            self.sure = False
            return Fault("reset", "the board's count of steps is not that of the drawing: it has started anew")
        if name == "QC" and volts(two) < LEAST_VOLTS:
            return Fault("alarm", "the motors have lost their power: the position is not known any more")
        return None

    def _passed(self) -> list[Event]:
        key, self.fence = self.fence, None
        self.asked = None
        self.idles = 0
        return [] if key is None else [Fenced(key)]

    def overdue(self, now: float) -> list[Event]:
        if self.asked is None or now - self.asked.sent_s <= self._patience():
            return []
        return [Fault("silent", f"the machine does not answer {self.asked.text!r}")]


def _motion(command: str) -> tuple[float, tuple[int, int]]:
    """Seconds that a command keeps the board busy, and its steps of motors 1 and 2."""
    name, *given = command.split(",")
    values = [int(value) for value in given]
    if name == "XM":
        return values[0] / 1000, (values[1] + values[2], values[1] - values[2])
    if name == "SM":
        return values[0] / 1000, (values[1], values[2] if len(values) > 2 else 0)
    if name in ("SP", "TP"):
        return (values[1] if len(values) > 1 else 0) / 1000 or SOON_S, (0, 0)
    if name == "S2":
        return (values[3] if len(values) > 3 else 0) / 1000 or SOON_S, (0, 0)
    return 0.0, (0, 0)
