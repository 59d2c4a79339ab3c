"""GRBL 1.1 and its kin (grblHAL, FluidNC, DrawCore): character counting, fences that name themselves, safe stops.

Commands are sent as long as all that are unanswered fit the receive buffer; each is answered by one `ok` or `error:n`.
A fence is `G4 P0.01 T<n>` and `$G`: the dwell waits for the motion before it, and the reply of `$G` shows the tool
number, so that it is known which fence was reached, whatever has become of an `ok`. The tool number means nothing to a
machine that never changes tools. Where a machine does not show it, the replies of `$G` are counted: one that is lost
leaves a fence unproven, never too many proven. A reply that is missing at the end is asked for again.

`ok`s that were lost on the way are made up for at the next fence; one too many, or a feed that `$G` does not show any
more (the board has started anew and its banner was lost), ends the stream.

Known limits: GRBL has no checksum. A byte of a coordinate that is damaged on its way to the machine is drawn.

Sources: GRBL 1.1 wiki (interface, commands), grbl/report.c, protocol.c.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass

from strokeplan.errors import DriveError
from strokeplan.plotter.dialects.gcode import number
from strokeplan.plotter.driving.codec import Event, Fault, Fence, Fenced, Item, Phrases
from strokeplan.plotter.driving.codecs.grbl_talk import (
    ANSWER_S,
    BANNER,
    BUFFER,
    NAME,
    POLL_S,
    TAGS,
    ask_state,
    hold,
    home,
    meet,
    place,
    query,
    reset,
    shift,
    state_in,
)
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.through import through
from strokeplan.plotter.profile import Profile
from strokeplan.plotter.tools import PwmServo

FLAVOURS = ("grbl", "grblhal", "fluidnc", "drawcore")
MAX_LINE = 79
SILENT_S = 5.0
MOST_LOST = 3
"""More answers than these are not lost on a line that works: commands are."""
AHEAD = 8
"""Lines that are under way at most: a pause waits for them."""
ASK_S = 0.3
"""After the last answer: what `$G` showed was damaged, and it is asked for again."""
TRIES = 5
_WORDS = {
    "G0", "G1", "G2", "G3", "G4", "G17", "G21", "G40", "G49", "G54", "G61", "G64", "G80", "G90", "G91.1", "G94",
    "M3", "M5", "M7", "M8", "M9",
}  # fmt: skip
_COMMAND = re.compile(r"(?:([GM]\d+(?:\.\d)?) ?)?((?:[XYZABCIJPSQFT]-?\d+(?:\.\d+)?(?: |$))*)", re.ASCII)
_HEAD = re.compile(r"F(\d+(?:\.\d+)?)")
ALARMS = {
    "1": "a limit switch was hit", "2": "the move leaves the travel", "3": "it was reset while it moved",
    "6": "homing was reset", "7": "its door was opened while homing", "8": "homing did not leave the switch",
    "9": "homing found no switch", "10": "homing found no second switch",
}  # fmt: skip


@dataclass(slots=True)
class _Sent:
    """A command on its way: its bytes count until it is answered."""

    size: int
    text: str
    tag: int | None = None


@dataclass(frozen=True, slots=True)
class _Awaited:
    """A fence that `$G` has not shown yet: its key, and the feed that it must show."""

    key: int
    feed: float | None


class GrblCodec:
    """The codec of a GRBL (codec.py tells what its methods are for)."""

    name = NAME
    halted = ""

    def __init__(self, phrases: Phrases, profile: Profile) -> None:
        self.phrases, self.profile = phrases, profile
        self.room = BUFFER
        self.tagged = False
        self.sent: deque[_Sent] = deque()
        self.used = 0
        self.awaited: dict[int, _Awaited] = {}
        self.tag = 0
        self.feed_said: float | None = None
        self.asked = 0
        self.dwelt = False
        self.longest_dwell_s = 0.0
        self.out = b""
        self.locked = self.kept = False
        self.shift: tuple[float, float] | None = None
        """What G92 has moved the origin by."""
        self.link: Link | None = None
        self.polled = self.heard = self.answered = 0.0
        self.state = ""
        self.idle_since: float | None = None

    # Conversations

    def greet(self, link: Link) -> str:
        self.link = link
        met = meet(link)
        self.kept, self.locked, self.room, self.tagged = met.kept, met.locked, met.room, met.tagged
        self.shift = shift(link)
        if isinstance(self.profile.tool, PwmServo) and "$32=1" in query(link, "$$"):
            raise DriveError("the machine is in laser mode ($32=1), which drops the pen on its way; set $32=0")
        return met.said

    def home(self, link: Link) -> None:
        self._settle(link)
        home(link)
        self.locked = False

    def start(self, link: Link) -> None:
        if self.locked:
            raise DriveError("the machine is locked (alarm): home it (--home), or unlock it with $X and set its origin")
        self.say(link, self.phrases.start)
        self.say(link, self.phrases.up)

    def say(self, link: Link, commands: tuple[str, ...]) -> None:
        through(self, link, commands)

    def place(self, link: Link) -> tuple[float, float] | None:
        self._settle(link)
        return place(link)

    def put(self, link: Link, x: float, y: float) -> str:
        self.say(link, (f"G92 X{number(x)} Y{number(y)}",))
        self._settle(link)
        self.shift = shift(link)
        return "G92, which lasts until the machine is reset or switched off"

    def _settle(self, link: Link) -> None:
        """Hear the `ok` of a fence that was proven before it: it must not be taken for another answer."""
        until = link.now() + ANSWER_S
        while self.sent and link.now() < until:
            if data := link.read(POLL_S):
                self.feed(data, link.now())

    def _shift_again(self, link: Link) -> None:
        """What G92 said before a reset that the position has survived."""
        at = self.place(link) if self.shift else None
        if self.shift and at:
            self.say(link, (f"G92 X{number(at[0] - self.shift[0])} Y{number(at[1] - self.shift[1])}",))

    def stop(self, link: Link, fault: Fault | None = None) -> bool:
        known = fault is None or fault.kind in ("refused", "confused", "held")
        link.forget()
        if known and not hold(link):
            known = False
        if fault is None or fault.kind != "reset":
            locked = reset(link)
        else:
            link.drain(0.5)
            locked = ask_state(link).startswith("Alarm")
        self._clear()
        if locked:
            known = False
            query(link, "$X")
        self.say(link, self.phrases.start)
        if known:
            self._shift_again(link)
        self.say(link, self.phrases.up if known else self.phrases.lift)
        if fault is None and known:
            self.say(link, self.phrases.park)
        return known

    def emergency(self, link: Link) -> None:
        link.forget()
        link.push(b"!\x18")

    def _clear(self) -> None:
        self.sent.clear()
        self.awaited.clear()
        self.used, self.out, self.feed_said, self.dwelt, self.asked = 0, b"", None, False, 0

    # Streaming

    def check(self, command: str) -> None:
        found = _COMMAND.fullmatch(command)
        if found is None or not command or (found[1] and found[1] not in _WORDS) or len(command) > MAX_LINE:
            raise DriveError(f"{command!r} is no command of drawing: it is not sent")

    def take(self, item: Item, now: float) -> bool:
        if isinstance(item, Fence):
            return self._take_fence(item, now)
        size = len(item) + 1
        if self.used + size > self.room:
            return False
        self._send(_Sent(size, item), now)
        self.dwelt = item.startswith("G4")
        if self.dwelt and (seconds := re.search(r"P([\d.]+)", item)):
            self.longest_dwell_s = max(self.longest_dwell_s, float(seconds[1]))
        if feed := _HEAD.search(item):
            self.feed_said = float(feed[1])
        return True

    def _take_fence(self, fence: Fence, now: float) -> bool:
        tag = self.tag % TAGS + 1
        wait = f"T{tag}" if self.dwelt else f"G4 P0.01 T{tag}"
        if not self.tagged:
            wait = "G4 P0.01"
        if self.used + len(wait) + 4 > self.room or len(self.awaited) >= AHEAD:
            return False
        self.tag = tag
        self.awaited[tag] = _Awaited(fence.key, self.feed_said)
        self._send(_Sent(len(wait) + 1, wait), now)
        self._send(_Sent(3, "$G", tag), now)
        self.dwelt = True
        return True

    def _send(self, sent: _Sent, now: float) -> None:
        if not self.sent:
            self.answered = now
        self.sent.append(sent)
        self.used += sent.size
        self.out += sent.text.encode("ascii") + b"\n"

    def outgoing(self, now: float) -> bytes:
        data, self.out = self.out, b""
        if self.awaited and not self.sent and now - self.answered > ASK_S and self.asked < TRIES:
            self.asked += 1
            self.awaited = dict([self.awaited.popitem()])
            self._send(_Sent(3, "$G", next(iter(self.awaited))), now)
            return self.outgoing(now)
        if now - self.polled >= POLL_S:
            if now - self.polled > 10 * POLL_S:  # the stream rested: the machine was not asked
                self.heard = self.answered = now
            self.polled = now
            data = b"?" + data
        return data

    def wait_s(self, now: float) -> float:
        return max(self.polled + POLL_S - now, 0.0)  # a poll is more frequent than anything else

    def feed(self, data: bytes, now: float) -> list[Event]:
        if self.link is None:
            return []
        self.heard = now
        events: list[Event] = []
        for line in self.link.lines(data):
            if line == "ok":
                self.answered = now
                events += self._acknowledged()
            elif line[0] in "<[":
                events += self._pushed(line, now)
            elif line.startswith(("error", "ALARM")) or BANNER.match(line):
                events.append(self._broken(line))
        return events

    def _acknowledged(self) -> list[Event]:
        if not self.sent:
            return [Fault("confused", "the machine answers more often than it was told; bytes were damaged on the way")]
        sent = self.sent.popleft()
        self.used -= sent.size
        return []

    def _pushed(self, line: str, now: float) -> list[Event]:
        """A status report, or what `$G` shows."""
        if (state := state_in(line)) is not None:
            return self._status(state, now)
        shown = re.search(r"^\[GC:.* T(\d+) F([\d.]+)", line)
        if shown is None or not self.awaited:
            return []
        tag = int(shown[1]) if self.tagged else next(iter(self.awaited))
        if tag not in self.awaited:
            return []
        return self._reached(tag, float(shown[2]), self.awaited[tag])

    def _reached(self, tag: int, feed: float, awaited: _Awaited) -> list[Event]:
        if awaited.feed is not None and abs(feed - awaited.feed) > 1.0:
            return [Fault("reset", "the machine has started anew, or lost commands: it has forgotten its feed")]
        before = [sent.tag for sent in self.sent]
        if tag not in before and self.asked:  # every command was answered, and the question was put again
            before = [tag]
        if tag not in before:
            return [Fault("confused", "the machine answers more often than it was told; bytes were damaged on the way")]
        lost = before.index(tag)
        if lost > MOST_LOST:
            return [Fault("confused", f"{lost} answers are missing: commands were lost on the way")]
        for _ in range(lost):
            self.used -= self.sent.popleft().size
        for earlier in [key for key, one in self.awaited.items() if one.key <= awaited.key]:
            del self.awaited[earlier]
        self.asked = 0
        return [Fenced(awaited.key)]

    def _status(self, state: str, now: float) -> list[Event]:
        self.state = state
        if not state.startswith("Idle") or not self.sent:
            self.idle_since = None
        elif self.idle_since is None:
            self.idle_since = now
        if state.startswith("Alarm"):
            return [Fault("alarm", "the machine has locked itself (alarm): see to it, home it")]
        if state.startswith(("Hold", "Door", "Sleep", "Check")):
            return [Fault("held", f"the machine was held at its own buttons ({state})")]
        return []

    def _broken(self, line: str) -> Fault:
        if line.startswith("error"):
            text = self.sent[0].text if self.sent else "nothing"
            return Fault("refused", f"the machine refuses {text!r} ({line})")
        if line.startswith("ALARM"):
            code = line.partition(":")[2].strip()
            return Fault("alarm", f"the machine has locked itself: {ALARMS.get(code, 'its manual tells why')} ({line})")
        return Fault("reset", "the machine has started anew in the middle (its power, its reset button, its cable)")

    def overdue(self, now: float) -> list[Event]:
        if now - self.heard > SILENT_S:
            return [Fault("silent", f"the machine says nothing for {SILENT_S:g} s")]
        if self.asked >= TRIES and now - self.answered > ASK_S:
            return [Fault("confused", "the machine does not show its state ($G) any more")]
        still = self.longest_dwell_s + 2.0
        if self.sent and self.idle_since is not None and min(now - self.idle_since, now - self.answered) > still:
            return [Fault("confused", "the machine rests, and answers are missing: bytes were lost on the way")]
        return []
