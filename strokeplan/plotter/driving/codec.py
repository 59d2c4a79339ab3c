"""What a codec is: all that one machine's protocol knows, and the streamer does not.

A codec lives as long as a connection. It has two sides:

* **Streaming**, which never waits. The streamer offers items in order: commands (str, without their line's end) and
  fences. `take` says whether there is room for one now; what is to be written is collected in `outgoing`, replies go
  into `feed`, which says what they mean (events). `wait_s` tells when the codec has something to do by itself (a status
  poll, a repetition, a time that runs out): the streamer calls `outgoing` and `overdue` no later.

      while ...: if codec.take(item, now): next item
      link.push(codec.outgoing(now)); data = link.read(codec.wait_s(now)); codec.feed(data, now); codec.overdue(now)

  A `Fence(key)` stands after the pen went up. `Fenced(key)` may come only when it is *proven* that the machine has
  carried out everything before it: not taken, not parsed, carried out; and never for an `ok` that may be a stray. It
  proves all earlier keys, too. Keys rise.

* **Conversations**, which wait in the link (`greet`, `home`, `start`, `say`, `stop`, `emergency`). They begin when
  nothing is streaming: `greet` first, then `home` if wished, then `start`; `stop` at any time, after which nothing is
  streamed any more.

A codec sends no more than it was made for: `check` refuses every command of a unit that is not one of drawing;
settings, firmware and files are out of reach of a plan or a profile.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from strokeplan.errors import DriveError
from strokeplan.plotter.driving.link import Link


@dataclass(frozen=True, slots=True)
class Fence:
    """A place in the stream, after the pen went up; `key` rises."""

    key: int


Item = str | Fence


@dataclass(frozen=True, slots=True)
class Fenced:
    """Everything before the fence has been carried out."""

    key: int


@dataclass(frozen=True, slots=True)
class Fault:
    """The stream cannot go on. `kind` says what may still be done:

    refused   the machine refused a command; it stands, position known.
    confused  answers do not fit what was sent; the machine is there, position known.
    held      someone held the machine at its own buttons (hold, door, button).
    alarm     it locked itself; position not to be trusted.
    reset     it started anew; position lost.
    silent    it says nothing.
    """

    kind: Literal["refused", "confused", "held", "alarm", "reset", "silent"]
    text: str
    """What happened and what to do, in one line."""


@dataclass(frozen=True, slots=True)
class Note:
    """Something for people to know; the stream goes on."""

    text: str


@dataclass(frozen=True, slots=True)
class Button:
    """The machine's own pause button: a wish for a pause at the end of the stroke."""


Event = Fenced | Fault | Note | Button


@dataclass(frozen=True, slots=True)
class Phrases:
    """What a codec says between units, in commands of its dialect; made from the profile (units.phrases)."""

    start: tuple[str, ...]
    """Units, absolute coordinates, the profile's prologue: before anything else, and after every reset."""
    up: tuple[str, ...]
    down: tuple[str, ...]
    lift: tuple[str, ...]
    """Pen up where the position is lost: relative, for pens on an axis."""
    park: tuple[str, ...] = ()
    """To the place where the machine waits, pen up; only where the position is known."""
    end: tuple[str, ...] = ()
    """The profile's epilogue."""


class Codec(Protocol):
    """One machine's protocol (module docstring)."""

    name: str
    """What people call it: "GRBL", "Marlin"."""
    phrases: Phrases
    """Of the pen that draws; the streamer puts those of another one in their place."""

    kept: bool
    """After `greet`: whether the machine knows its place from before, so that nobody must put it to its origin."""
    halted: str
    """What the person must do after `emergency` before the machine listens again; "" where a greeting is enough."""

    def greet(self, link: Link) -> str:
        """Find out who is there; what it says of itself. Raises WrongDeviceError, DriveError (silent, locked)."""

    def home(self, link: Link) -> None:
        """Drive to the machine's switches, after which its position is known. Raises DriveError where it cannot."""

    def start(self, link: Link) -> None:
        """Restore modal state, pen up; from here on it may be streamed. Raises DriveError."""

    def check(self, command: str) -> None:
        """Raise DriveError for a command that is not one of drawing."""

    def take(self, item: Item, now: float) -> bool:
        """Whether the item was taken; False: offer it again after some replies."""

    def outgoing(self, now: float) -> bytes:
        """What is to be written now; each byte is handed over once."""

    def feed(self, data: bytes, now: float) -> list[Event]: ...

    def overdue(self, now: float) -> list[Event]:
        """What the passing of time alone means: nothing, a note, a fault."""

    def wait_s(self, now: float) -> float:
        """Seconds until `outgoing` or `overdue` has something by itself."""

    def say(self, link: Link, commands: tuple[str, ...]) -> None:
        """Have some commands carried out, and wait until they are: between units, everything fenced."""

    def stop(self, link: Link, fault: Fault | None = None) -> bool:
        """Stop safely, as the fault lets it: motion ends, pen up, parked if all is well; whether position is known.

        Raises DriveError where the machine does not follow.
        """

    def emergency(self, link: Link) -> None:
        """Stop at once; what the machine answers does not matter."""


@runtime_checkable
class Locator(Protocol):
    """What a codec has besides if its machine knows where it stands; set-up commands ask whether it does (setup.py).

    Coordinates are those of the codec's commands: millimetres, or the units that a script's `unit_mm` tells.
    """

    def place(self, link: Link) -> tuple[float, float] | None:
        """Where the machine says that it stands, at rest; None if it does not say. After `greet`."""

    def put(self, link: Link, x: float, y: float) -> str:
        """Let the present place be these coordinates, and write no setting; how, in words, and how long it lasts.

        Raises InputError for a machine whose origin is its own. A codec's `stop` keeps what was put.
        """


class WrongDeviceError(DriveError):
    """Another kind of machine answers on the port."""


_KNOWN = (
    ("EBB", ("EBBv", "EiBotBoard", "!8 Err: Unknown command")),
    ("GRBL", ("Grbl", "GRBL", "[VER:", "[OPT:", "[GC:", "DrawCore")),
    ("Marlin", ("FIRMWARE_NAME:", "Marlin ", "echo:Unknown command", "echo:Marlin", "Printer halted")),
    ("uArm", ("@1", "@5", "$1 ok", "uArm")),
)


def recognise(line: str) -> str | None:
    """The protocol that a line is typical of; None for one that says nothing."""
    if re.fullmatch(r"error:\d+", line):
        return "GRBL"
    for name, marks in _KNOWN:
        if any(mark in line for mark in marks):
            return name
    return None


def refuse_other(mine: str, heard: str | None, port: str = "the port") -> None:
    """Raise WrongDeviceError if what was recognised is not the profile's protocol."""
    if heard is not None and heard != mine:
        raise WrongDeviceError(f"{port} answers as {heard}, and the profile speaks {mine}; take a profile for {heard}")
