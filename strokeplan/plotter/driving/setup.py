"""Setting a machine up before anything is drawn: where its pen is and may go, and how far down it goes.

A session stands on the codec of the machine's dialect and knows no protocol itself. Moves are made pen up, within the
profile's travel, one at a time: each has been carried out when it returns. A codec that is a Locator says where the
machine stands; another machine is taken to stand at its origin when the session begins, and its moves are added up.

`safely` is around whatever moves: Ctrl-C, a fault and every other way out end in a machine that stands, pen up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace

import msgspec
import numpy as np

from strokeplan.errors import DeviceLost, DriveError, InputError, PlotError
from strokeplan.page import Page
from strokeplan.plotter.driving.codec import Codec, Fault, Locator, Phrases
from strokeplan.plotter.driving.codecs import codec_for
from strokeplan.plotter.driving.link import LOOK_S, Emergency, Link
from strokeplan.plotter.driving.units import Script, script
from strokeplan.plotter.machine import TOLERANCE_MM, PageTransform
from strokeplan.plotter.profile import PenSettings, Point, Profile
from strokeplan.plotter.program import JobPen, Program
from strokeplan.plotter.report import bounds
from strokeplan.plotter.tools import EbbBrush, EbbServo, Tool, ZBrush, ZPen

PEN = PenSettings(name="pen")


class Watch:
    """Ctrl-C as it comes: the first one ends what is under way; while the machine is stopped, only another does."""

    def __init__(self) -> None:
        self.stops = self.heeded = 0

    def interrupted(self, *_: object) -> None:
        """A signal."""
        self.stops += 1

    def wanted(self) -> bool:
        """Whether there is one that nobody has heeded yet."""
        return self.stops > self.heeded


class Session:
    """One machine, from its greeting until the port is closed."""

    def __init__(self, link: Link, profile: Profile, pen: str | None = None) -> None:
        self.link, self.profile, self.pen = link, profile, pen
        self.script = bench(profile, pen)
        self.codec: Codec = codec_for(profile, phrases(self.script))
        self.at: Point = (0.0, 0.0)
        """Where the pen is, in mm of the machine."""
        self.told = False
        """Whether the machine has said so."""
        self.begun = self.down = self.homed = False
        self.taken = False
        """Whether a plotter that fetches its pens itself has one."""

    @property
    def sure(self) -> bool:
        """Whether the machine knows its place: it was homed here, or has not started anew."""
        return self.told and (self.homed or self.codec.kept)

    # Coming and going

    def greet(self) -> str:
        """Who is there. Raises WrongDeviceError, DriveError; nothing moves."""
        try:
            return self.codec.greet(self.link)
        except Emergency:
            raise DriveError("stopped before anything moved") from None

    def begin(self) -> None:
        """Raise the pen, and see where it is. Raises DriveError."""
        self.codec.start(self.link)
        self.begun, self.down = True, False
        self._locate()

    def home(self) -> None:
        """Have the machine look for its switches, pen up where it can be raised before. Raises DriveError."""
        with suppress(DriveError):  # a locked machine takes no other command
            self.codec.start(self.link)
        self.codec.home(self.link)
        self.homed = True
        self.begin()

    def _locate(self) -> None:
        place = self.codec.place(self.link) if isinstance(self.codec, Locator) else None
        if place is not None:
            unit = self.script.unit_mm
            self.at, self.told = (place[0] * unit, place[1] * unit), True

    @contextmanager
    def safely(self, watch: Watch) -> Iterator[None]:
        """What is done within ends pen up, whatever happens. Raises DriveError for a stop."""
        try:
            yield
            self._store()
        except Emergency:
            raise self._stopped("stopped", None, watch) from None
        except DeviceLost as lost:
            raise DeviceLost(f"{lost}; see to the pen") from None
        except DriveError as error:
            if not self.begun:
                raise
            raise self._stopped(str(error), Fault("confused", str(error)), watch) from None
        finally:
            if self.down:
                self._raise_at_last()

    def _stopped(self, reason: str, fault: Fault | None, watch: Watch) -> DriveError:
        """Stop the machine; the error that says so."""
        self.down = False
        try:
            if watch.stops > 1:
                raise Emergency
            watch.heeded = watch.stops
            known = self.codec.stop(self.link, fault)
        except Emergency:
            with suppress(DriveError):
                self.codec.emergency(self.link)
            said = ("emergency stop: see to the pen", "the machine has lost its place", self.codec.halted)
            return DriveError("; ".join(filter(None, said)))
        except DriveError as error:
            also = "" if str(error) == reason else f"; then {error}"
            return DriveError(f"{reason}{also}; see to the pen")
        return DriveError(f"{reason}; the pen is up" + ("" if known else "; the machine has lost its place"))

    def _store(self) -> None:
        """A plotter that fetches its pens itself puts them back."""
        if self.taken and not self.down and self.script.by_itself:
            self.codec.say(self.link, (*self.codec.phrases.up, *self.script.phrases(0).end))

    def _raise_at_last(self) -> None:
        with suppress(DriveError, Emergency):
            self.up()

    # The pen

    def up(self) -> None:
        """Raise the pen."""
        self.codec.say(self.link, self.codec.phrases.up)
        self.down = False

    def lower(self) -> None:
        """Lower the pen where it stands."""
        self.down = True
        fetched = () if self.taken else self.script.taken(self.script.program.pens[0])
        self.taken = True
        self.codec.say(self.link, (*fetched, *self.codec.phrases.down))

    def cycle(self, times: int, rest_s: float) -> None:
        """Lower and raise it, as often, resting at each end."""
        for _ in range(times):
            self.lower()
            self.rest(rest_s)
            self.up()
            self.rest(rest_s)

    def use(self, profile: Profile) -> None:
        """Go on with another height of the pen, which it takes at once if it is down."""
        before = self.codec.phrases
        self.profile, self.script = profile, bench(profile, self.pen)
        self.codec.phrases = phrases(self.script)
        new = tuple(text for text in self.codec.phrases.start if text not in before.start)
        if new:  # heights that a board is told beforehand
            self.codec.say(self.link, new)
        if self.down:
            self.lower()

    def rest(self, seconds: float) -> None:
        """Wait, and hear the machine meanwhile. Raises DriveError for what happens to it, Emergency."""
        until = self.link.now() + seconds
        while (left := until - self.link.now()) > 0:
            if self.link.emergency():
                raise Emergency
            data = self.link.read(min(left, LOOK_S))
            for event in self.codec.feed(data, self.link.now()) if data else ():
                if isinstance(event, Fault):
                    raise DriveError(event.text)

    # Moves

    def go(self, x_mm: float, y_mm: float) -> None:
        """To a place, pen up. Raises PlotError for one beyond the travel, before anything moves."""
        target = (x_mm, y_mm)
        check_reach(self.profile, target)
        if self.down:
            self.up()
        self.codec.say(self.link, tuple(self.script.travel(self.at, target)))
        self.at = target

    def walk(self, corners: Sequence[Point]) -> None:
        """From corner to corner, and back to where it began if that is within the travel."""
        begun = self.at if reaches(self.profile, self.at) else corners[0]
        for corner in corners:
            check_reach(self.profile, corner)
        for corner in (*corners, begun):
            self.codec.say(self.link, tuple(self.script.travel(self.at, corner)))
            self.at = corner

    def put(self, x_mm: float, y_mm: float) -> str:
        """Let the present place be these coordinates; how, in words. Raises InputError where that cannot be."""
        if isinstance(self.codec, Locator):
            unit = self.script.unit_mm
            done = self.codec.put(self.link, x_mm / unit, y_mm / unit)
        elif (x_mm, y_mm) == (0.0, 0.0):
            done = "nothing was sent: such a machine takes the place where it stands when drawing begins as its origin"
        else:
            raise InputError(
                f"{self.profile.name} takes the place where it stands when drawing begins as X0 Y0, and cannot be told "
                f"that it is X{x_mm:g} Y{y_mm:g}; carry it to its own origin"
            )
        self.at = (x_mm, y_mm)
        return done

    def claim(self, x_mm: float, y_mm: float) -> None:
        """Where the pen stands, as people say. Raises InputError for a machine that knows better."""
        if isinstance(self.codec, Locator):
            self.put(x_mm, y_mm)
        self.at = (x_mm, y_mm)

    def put_corner(self) -> str:
        """Let the present place be the page's origin corner; how, in words. Raises InputError."""
        check_corner(self.profile)
        return self.put(*self.profile.machine.offset_mm)


def check_corner(profile: Profile) -> None:
    """Raise InputError for a machine on which the page's corner lies where its papers do."""
    if profile.papers:
        raise InputError(f"{profile.name} knows where its sheets lie; move the sheet, not the origin")


def reaches(profile: Profile, at: Point) -> bool:
    """Whether a place is within the travel of a profile's machine."""
    try:
        check_reach(profile, at)
    except PlotError:
        return False
    return True


def check_reach(profile: Profile, at: Point) -> None:
    """Raise PlotError for a place beyond the travel of a profile's machine."""
    machine = profile.machine
    for axis, value, (low, high) in zip("XY", at, (machine.x_mm, machine.y_mm), strict=True):
        if not low - TOLERANCE_MM <= value <= high + TOLERANCE_MM:
            raise PlotError(
                f"X{at[0]:g} Y{at[1]:g} is beyond the travel of {profile.name}, X {machine.x_mm[0]:g}.."
                f"{machine.x_mm[1]:g}, Y {machine.y_mm[0]:g}..{machine.y_mm[1]:g} mm: {axis}{value:g} is "
                f"{max(low - value, value - high):g} mm too far"
            )


def corners(program: Program) -> list[Point]:
    """The four corners of what is drawn, mm of the machine, in the order of a walk."""
    (left, low), (right, high) = (reached.tolist() for reached in bounds(program))
    return [(left, low), (right, low), (right, high), (left, high)]


def bench(profile: Profile, pen: str | None = None) -> Script:
    """The script of a profile's machine with nothing to draw but a dot, with one of its pens.

    Raises PlotError for a machine of files only.
    """
    held = PEN if pen is None else next(one for one in profile.pens if one.name == pen)
    profile = msgspec.structs.replace(profile, tool=_as_pen(profile.tool))
    paper = profile.papers[0] if profile.papers else None
    x_mm, y_mm = (paper.x_mm, paper.y_mm) if paper else (profile.machine.x_mm, profile.machine.y_mm)
    page = paper.sheet if paper else Page(x_mm[1] - x_mm[0], y_mm[1] - y_mm[0])
    offset = paper.offset_mm if paper else profile.machine.offset_mm
    dot = Program(
        profile=profile,
        transform=PageTransform(page, profile.machine.axes, profile.machine.origin, offset, x_mm, y_mm),
        points=np.full((4, 2), (x_mm[0], y_mm[0])),
        starts=np.array([0, 4]),
        radii=np.zeros(2),
        pen=np.zeros(1, np.int64),
        layer=np.zeros(1, np.int64),
        pens=(JobPen(held.name, held.slot or 1, held),),
        layers=("set-up",),
        strokes=1,
        title="set-up",
    )
    return script(dot)


def _as_pen(tool: Tool) -> Tool:
    """A brush as a pen that is lowered until it touches; any other tool as it is."""
    if isinstance(tool, ZBrush):
        return ZPen(up_mm=tool.safe_mm, down_mm=tool.touch_mm, rate_mm_min=tool.rate_mm_min)
    if isinstance(tool, EbbBrush):
        lower_s = tool.lower_s + tool.way_s(tool.safe_percent, tool.touch_percent)
        raise_s = tool.raise_s + tool.way_s(tool.touch_percent, tool.safe_percent)
        return EbbServo(
            up_percent=tool.safe_percent, down_percent=tool.touch_percent, low=tool.low, high=tool.high, pin=tool.pin,
            raise_rate=tool.raise_rate, lower_rate=tool.lower_rate, lower_s=lower_s, raise_s=raise_s,
        )  # fmt: skip
    return tool


def phrases(made: Script) -> Phrases:
    """What a codec says in a session: it parks nowhere, and does not end a job."""
    return replace(made.phrases(0), park=(), end=())


def towards(profile: Profile, direction: str) -> Point:
    """The unit step of the machine's coordinates that goes right, left, up or down, as one looks at the page."""
    opposite = {"right": "left", "left": "right", "up": "down", "down": "up"}
    axes = profile.machine.axes
    step = [1.0 if axis == direction else -1.0 if axis == opposite[direction] else 0.0 for axis in axes]
    return step[0], step[1]
