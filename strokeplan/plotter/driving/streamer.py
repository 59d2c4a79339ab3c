"""The one streamer: units go to a codec, fences come back, people are heard, and every end is a safe one.

It knows no protocol. Units are offered to the codec as it has room; what is proven drawn goes to the journal. A pause
waits for the strokes that the machine already has, so that the pen is up while it waits; a stop does not wait: the
codec stops the machine, lifts the pen, and the stroke is drawn again when the job is resumed.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

from strokeplan.errors import DeviceLost, DriveError, StrokeplanError
from strokeplan.plotter.driving.codec import Button, Codec, Event, Fault, Fence, Fenced, Item, Note
from strokeplan.plotter.driving.link import LOOK_S, Emergency, Link
from strokeplan.plotter.driving.units import Script, Unit

HURRY_S = 0.02
"""How long a read may take while the codec has just had room: more may fit at once."""


class Wish(Enum):
    """What people want of a machine that draws."""

    PAUSE = auto()
    """Pause, or go on."""
    UP = auto()
    DOWN = auto()
    STOP = auto()
    EMERGENCY = auto()


class Control(Protocol):
    """Who sits at the machine."""

    def wish(self) -> Wish | None:
        """The next thing that they want; each is told once, but EMERGENCY, which stays."""

    def ask(self, text: str) -> bool:
        """Have something done; False: they want to stop instead."""

    def note(self, text: str) -> None:
        """Something to know."""

    def progress(self, done: int, paused: bool) -> None:
        """So many units are proven drawn."""


class Keeper(Protocol):
    """Who remembers what was drawn (journal.py)."""

    def advance(self, key: int, now: float) -> None:
        """Unit `key` and all before it are drawn. Raises OutputError where it cannot be written down."""

    def settle(self) -> None:
        """All of it is on the disk. Raises OutputError."""


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run ended: units proven drawn, whether that is all, and if not, why, in one line."""

    done: int
    finished: bool
    reason: str = ""
    pen_up: bool = True
    position_known: bool = True


class Streamer:
    """Runs a script once, from a unit on."""

    def __init__(self, link: Link, codec: Codec, script: Script, control: Control, keeper: Keeper) -> None:
        self.link, self.codec, self.script = link, codec, script
        self.control, self.keeper = control, keeper
        self.done = 0
        self.key = 0
        self.paused = False
        self.marks: dict[int, int | None] = {}
        """Fences under way, by their keys, and the unit that each ends."""
        self.fence_key = 0
        self.pen: int | None = None

    def run(self, first: int = 0) -> Ending:
        """Draw from unit `first` on. Every way out of here is an Ending; bugs are raised, after a stop."""
        self.done = first
        try:
            self.codec.start(self.link)
            for unit in self.script.units(first):
                self._unit(unit)
            self._finish()
        except _Stop as stop:
            return self._stopped(stop.reason, stop.fault)
        except Emergency:
            return self._emergency()
        except DeviceLost as lost:
            return self._end(str(lost), pen_up=False, known=False)
        except StrokeplanError as error:  # a machine that does not follow, a disk that is full
            return self._stopped(str(error), Fault("confused", str(error)))
        except BaseException:  # a fault of this program is no reason to leave the pen on the paper
            self._stopped("", None)
            raise
        return self._end("", finished=True)

    # The stream

    def _unit(self, unit: Unit) -> None:
        if unit.prompt is not None:
            self._stand()
            if unit.before:
                self.codec.say(self.link, unit.before)
            if not self.control.ask(unit.prompt):
                raise _Stop("stopped")
        elif self.paused:
            self._pause()
        if unit.pen != self.pen:
            self.pen, self.codec.phrases = unit.pen, self.script.phrases(unit.pen)
        for command in unit.commands:
            self.codec.check(command)
            self._offer(command)
        self._fence(unit.key)

    def _fence(self, unit: int | None) -> None:
        self.fence_key += 1
        self.marks[self.fence_key] = unit
        self._offer(Fence(self.fence_key))

    def _offer(self, item: Item) -> None:
        while not self.codec.take(item, self.link.now()):
            self._turn()
        if len(self.link.pending) == 0:
            self._flush()

    def _flush(self) -> None:
        self.link.push(self.codec.outgoing(self.link.now()))

    def _turn(self) -> None:
        """One look at the wire, the clock and the people."""
        self._flush()
        now = self.link.now()
        data = self.link.read(min(self.codec.wait_s(now), LOOK_S))
        now = self.link.now()
        events: list[Event] = self.codec.feed(data, now) if data else []
        for event in (*events, *self.codec.overdue(now)):
            self._happened(event, now)
        self._listen()

    def _happened(self, event: Event, now: float) -> None:
        if isinstance(event, Fenced):
            passed = [key for key in self.marks if key <= event.key]
            units = [unit for key in passed if (unit := self.marks.pop(key)) is not None]
            if units:
                self.keeper.advance(max(units), now)
                self.done = max(units) + 1
                self.control.progress(self.done, self.paused)
        elif isinstance(event, Fault):
            raise _Stop(event.text, event)
        elif isinstance(event, Note):
            self.control.note(event.text)
        elif isinstance(event, Button):
            self.paused = True

    def _listen(self) -> None:
        wish = self.control.wish()
        if wish is Wish.EMERGENCY:
            raise Emergency
        if wish is Wish.STOP:
            raise _Stop("stopped")
        if wish is Wish.PAUSE:
            self.paused = not self.paused
            self.control.progress(self.done, self.paused)

    def _stand(self) -> None:
        """Wait until everything that was sent is carried out."""
        if self.marks:
            while self.marks:
                self._turn()
        self.keeper.settle()

    def _pause(self) -> None:
        """Wait, the pen up, until people want to go on."""
        self._stand()
        self.control.progress(self.done, paused=True)
        while self.paused:
            wish = self.control.wish()
            if wish is Wish.EMERGENCY:
                raise Emergency
            if wish is Wish.STOP:
                raise _Stop("stopped")
            if wish is Wish.PAUSE:
                self.paused = False
            elif wish in (Wish.UP, Wish.DOWN):
                phrases = self.codec.phrases
                self.codec.say(self.link, phrases.up if wish is Wish.UP else phrases.down)
            else:
                self._hear()
        self.codec.say(self.link, self.codec.phrases.up)
        self.control.progress(self.done, paused=False)

    def _hear(self) -> None:
        """What the machine says of itself while nothing is asked of it: that it has started anew, say."""
        data = self.link.read(LOOK_S)
        for event in self.codec.feed(data, self.link.now()) if data else ():
            self._happened(event, self.link.now())

    def _finish(self) -> None:
        self._stand()
        phrases = self.codec.phrases
        self.codec.say(self.link, (*self.script.last(), *phrases.up, *phrases.park, *phrases.end))

    # The ends

    def _stopped(self, reason: str, fault: Fault | None) -> Ending:
        """Stop the machine as far as it can be reached, and say what became of it."""
        try:
            known = self._stop_once(fault)
        except Emergency:
            return self._emergency()
        except StrokeplanError as error:
            also = "" if isinstance(error, DeviceLost) or str(error) == reason else f"; then {error}"
            return self._end(f"{reason}{also}", pen_up=False, known=False)
        return self._end(reason, known=known)

    def _stop_once(self, fault: Fault | None) -> bool:
        """Stop; where that fails in the middle, once more as if the machine had started anew, so that the pen is up."""
        try:
            return self.codec.stop(self.link, fault)
        except DeviceLost:
            raise
        except DriveError as error:
            return self.codec.stop(self.link, Fault("reset", str(error)))

    def _emergency(self) -> Ending:
        with suppress(StrokeplanError):
            self.codec.emergency(self.link)
        return self._end("; ".join(filter(None, ("emergency stop", self.codec.halted))), pen_up=False, known=False)

    def _end(self, reason: str, *, finished: bool = False, pen_up: bool = True, known: bool = True) -> Ending:
        try:
            self.keeper.settle()
        except StrokeplanError as error:
            reason = f"{reason}; {error}" if reason and str(error) not in reason else reason or str(error)
            finished = False
        return Ending(self.done, finished, reason, pen_up, known)


class _Stop(Exception):  # noqa: N818 - the way out of the stream, no error
    def __init__(self, reason: str, fault: Fault | None = None) -> None:
        super().__init__(reason)
        self.reason, self.fault = reason, fault
