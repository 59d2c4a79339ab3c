"""The uArm Swift Pro: every command has a number, which comes back with its answer.

One command at a time. All coordinates are absolute, so that a command whose answer does not come is sent again: done
twice, it changes nothing. A fence is M2200, asked until it says twice that the arm does not move (V0).

Known limits: no checksum; a byte of a coordinate that is damaged on its way to the arm is drawn.

Source: uArm Swift Pro developer guide (protocol, error codes, M2200).
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass

from strokeplan.errors import DriveError, InputError
from strokeplan.plotter.driving.codec import Event, Fault, Fence, Fenced, Item, Phrases, recognise, refuse_other
from strokeplan.plotter.driving.codecs.marlin import MAX_LINE
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.through import through

PATIENCE_S = 5.0
LONGEST_S = 120.0
"""A move that takes longer than this does not exist: the arm's buffer frees a place before."""
ASK_S = 0.05
TRIES = 4
GREETING_S = 3.0
_COMMAND = re.compile(r"(G[0124]|G21|G90|G17|G40|G49|G54|G80|M5|M7|M8|M9|M17)((?: [XYZPSF]-?\d*(?:\.\d+)?)*)", re.ASCII)
_ANSWER = re.compile(r"\$(\d+)\s+(ok|E\d+)\b\s*(.*)", re.IGNORECASE)


@dataclass(slots=True)
class _Asked:
    """The command that waits for its answer."""

    number: int
    command: str
    key: int | None
    tries: int = 0


class UarmCodec:
    """The codec of a uArm (codec.py tells what its methods are for)."""

    name = "uArm"
    halted = ""
    kept = True  # it measures its joints

    def __init__(self, phrases: Phrases) -> None:
        self.phrases = phrases
        self.link: Link | None = None
        self.number = 0
        self.asked: _Asked | None = None
        self.waiting: deque[tuple[str, int | None]] = deque()
        self.rested = 0
        """How often in a row the arm has said that it rests."""
        self.ask_at: float | None = None
        self.out = b""
        self.heard = 0.0

    # Conversations

    def greet(self, link: Link) -> str:
        self.link = link
        refuse_other(self.name, link.hear(recognise, GREETING_S))
        for _ in range(TRIES):
            link.drain(0.3)
            link.forget()
            self.number += 1
            link.say("")
            link.say(f"#{self.number} P2203")
            if version := link.hear(self._version, GREETING_S):
                self.heard = link.now()
                return f"uArm, firmware {version}"
        raise DriveError("no answer: is the arm on, is this its port? (the profile speaks uArm at 115200 baud)")

    def _version(self, line: str) -> str | None:
        found = _ANSWER.match(line)
        if found and int(found[1]) == self.number:
            return found[3] or "unknown"
        refuse_other(self.name, recognise(line))
        return None

    def home(self, link: Link) -> None:
        raise DriveError("a uArm knows where it is: leave out --home")

    def start(self, link: Link) -> None:
        self.say(link, (*self.phrases.start, *self.phrases.up))

    def say(self, link: Link, commands: tuple[str, ...]) -> None:
        through(self, link, commands)

    def place(self, link: Link) -> tuple[float, float] | None:
        self.number = self.number % 9000 + 1
        link.say(f"#{self.number} P2220")
        found = link.hear(lambda line: self._place(line), GREETING_S)
        self.heard = link.now()
        return found

    def _place(self, line: str) -> tuple[float, float] | None:
        answer = _ANSWER.search(line)
        found = re.match(r"X(-?[\d.]+) Y(-?[\d.]+)", answer[3]) if answer and int(answer[1]) == self.number else None
        return None if found is None else (float(found[1]), float(found[2]))

    def put(self, link: Link, x: float, y: float) -> str:
        raise InputError(
            "an arm measures where it is: its origin stays; move the sheet, or set offset_mm in its profile"
        )

    def stop(self, link: Link, fault: Fault | None = None) -> bool:
        link.forget()
        self._clear()
        link.drain(0.3, 2.0)
        link.say("")
        link.drain(0.2, 1.0)
        self.heard = link.now()
        self.say(link, (*self.phrases.start, *self.phrases.up))  # heights are the arm's own: it measures its joints
        if fault is None:
            self.say(link, self.phrases.park)
        return True

    def emergency(self, link: Link) -> None:
        link.forget()
        link.push(b"\n#9999 M410\n")

    def _clear(self) -> None:
        self.asked, self.ask_at, self.out, self.rested = None, None, b"", 0
        self.waiting.clear()

    # Streaming

    def check(self, command: str) -> None:
        if _COMMAND.fullmatch(command) is None or len(command) > MAX_LINE:
            raise DriveError(f"{command!r} is no command of drawing: it is not sent")

    def take(self, item: Item, now: float) -> bool:
        if self.asked is not None or self.ask_at is not None:
            return False
        if isinstance(item, Fence):
            self.rested = 0
            self._ask("M2200", item.key, now)
        else:
            self._ask(item, None, now)
        return True

    def _ask(self, command: str, key: int | None, now: float) -> None:
        self.number = self.number % 9000 + 1
        self.asked = _Asked(self.number, command, key)
        self._send(now)

    def _send(self, now: float) -> None:
        if self.asked is not None:
            self.out += f"#{self.asked.number} {self.asked.command}\n".encode("ascii")
            self.heard = now

    def outgoing(self, now: float) -> bytes:
        if self.ask_at is not None and now >= self.ask_at and self.asked is not None:
            self.ask_at = None
            self._ask(self.asked.command, self.asked.key, now)
        data, self.out = self.out, b""
        return data

    def wait_s(self, now: float) -> float:
        return max((self.heard + PATIENCE_S if self.ask_at is None else self.ask_at) - now, 0.0)

    def feed(self, data: bytes, now: float) -> list[Event]:
        if self.link is None:
            return []
        events: list[Event] = []
        for line in self.link.lines(data):
            if "@1" in line:  # noise may stand before it
                events.append(Fault("reset", "the arm has started anew in the middle (its power, its reset button)"))
            elif (found := _ANSWER.search(line)) and self.asked is not None and int(found[1]) == self.asked.number:
                events += self._answered(found[2].lower(), found[3], now)
        return events

    def _answered(self, kind: str, text: str, now: float) -> list[Event]:
        if self.asked is None or self.ask_at is not None:
            return []
        self.heard = now
        if kind != "ok":
            return self._again(now, f"the arm refuses {self.asked.command!r} ({kind.upper()})", "refused")
        if self.asked.key is None:
            self.asked = None
            return []
        self.rested = self.rested + 1 if re.match(r"V0\b", text) else 0
        if self.rested < 2:
            self.ask_at = now + ASK_S
            return []
        key, self.asked = self.asked.key, None
        return [Fenced(key)]

    def _again(self, now: float, text: str, kind: str) -> list[Event]:
        """Bytes may have been damaged: the same once more."""
        if self.asked is None:
            return []
        if self.asked.tries >= TRIES:
            return [Fault("silent" if kind == "silent" else "refused", text)]
        self.asked.tries += 1
        self._send(now)
        return []

    def overdue(self, now: float) -> list[Event]:
        if self.asked is None or self.ask_at is not None or now - self.heard <= PATIENCE_S:
            return []
        return self._again(now, f"the arm says nothing for {TRIES * PATIENCE_S:g} s", "silent")
