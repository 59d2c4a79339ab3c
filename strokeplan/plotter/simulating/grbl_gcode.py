"""G-code as GRBL 1.1 understands it: a line becomes actions, or an error's number, and changes the modes.

Numbers of errors: GRBL 1.1 wiki, "Interface", table of error codes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from math import atan2, ceil, cos, hypot, pi, sin, sqrt

from strokeplan.plotter.simulating.steppers import Place

INCH = 25.4
ARC_TOLERANCE_MM = 0.002
"""$12."""
WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))?")
MOTION = ("G0", "G1", "G2", "G3", "G38.2", "G80")
GROUPS = (
    MOTION, ("G4", "G10", "G28", "G28.1", "G30", "G30.1", "G53", "G92", "G92.1"), ("G17", "G18", "G19"),
    ("G90", "G91"), ("G91.1",), ("G93", "G94"), ("G20", "G21"), ("G40",), ("G43.1", "G49"),
    ("G54", "G55", "G56", "G57", "G58", "G59"), ("G61",), ("M0", "M1", "M2", "M30"), ("M3", "M4", "M5"),
    ("M7", "M8", "M9"),
)  # fmt: skip
GROUP = {word: k for k, words in enumerate(GROUPS) for word in words}
NONMODAL = 1
SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59")
ZERO: Place = (0.0, 0.0, 0.0)


class GcodeError(Exception):
    """A line that is refused, by its number."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error:{code}")
        self.code = code


@dataclass(frozen=True, slots=True)
class Move:
    """A straight move in machine coordinates; mm/min, None as fast as can be."""

    to: Place
    feed: float | None


@dataclass(frozen=True, slots=True)
class Spindle:
    """Wait for the motors, then the output: a pulse, 0 for off."""

    pulse: float


@dataclass(frozen=True, slots=True)
class Dwell:
    """Wait for the motors, then stand."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Store:
    """Write to the EEPROM, during which bytes are lost."""


@dataclass(frozen=True, slots=True)
class Pause:
    """M0: wait for the motors, then hold."""


@dataclass(frozen=True, slots=True)
class End:
    """M2, M30."""


Action = Move | Spindle | Dwell | Store | Pause | End


@dataclass(frozen=True, slots=True)
class Modes:
    """What a line leaves behind for the next one; positions in machine coordinates, mm."""

    motion: str = "G0"
    plane: str = "G17"
    system: str = "G54"
    absolute: bool = True
    inches: bool = False
    inverse: bool = False
    spindle: str = "M5"
    coolant: str = "M9"
    feed: float = 0.0
    pulse: float = 0.0
    tool: int = 0
    position: Place = ZERO
    g92: Place = ZERO
    systems: dict[str, Place] = field(default_factory=lambda: dict.fromkeys(SYSTEMS, ZERO))
    homes: dict[str, Place] = field(default_factory=lambda: {"G28": ZERO, "G30": ZERO})

    @property
    def offset(self) -> Place:
        """Work coordinates plus this are machine coordinates."""
        return _plus(self.systems[self.system], self.g92)

    def report(self) -> str:
        """As $G prints it."""
        words = (
            self.motion, self.system, self.plane, "G20" if self.inches else "G21", "G90" if self.absolute else "G91",
            "G93" if self.inverse else "G94", self.spindle, self.coolant, f"T{self.tool}", f"F{self.feed:.0f}",
            f"S{self.pulse:.0f}",
        )  # fmt: skip
        return f"[GC:{' '.join(words)}]"


def words(line: str) -> list[tuple[str, float]]:
    """A line without spaces and comments as letters and numbers. Raises GcodeError."""
    found, at = [], 0
    while at < len(line):
        match = WORD.match(line, at)
        if not match:
            raise GcodeError(1)
        if match[2] is None:
            raise GcodeError(2)
        found.append((match[1], float(match[2])))
        at = match.end()
    return found


def execute(line: str, modes: Modes, *, jog: bool = False, arcs: bool = True) -> tuple[Modes, list[Action]]:
    """The modes after a line and what it does. Raises GcodeError, the modes then stay."""
    commands, values = _sorted(words(line), arcs=arcs)
    if jog:
        return _jog(commands, values, modes)
    if "N" in values and not 0 <= values.pop("N") <= 9_999_999:
        raise GcodeError(27)
    for letter in "FST":
        if values.get(letter, 0) < 0:
            raise GcodeError(4)
    tool = values.pop("T", 0.0)
    if tool != int(tool) or tool > 255:
        raise GcodeError(23 if tool != int(tool) else 38)
    modes = replace(modes, tool=int(tool))
    new, actions = _set_modes(commands, values, modes)
    special = commands.get(NONMODAL)
    if special == "G4":
        if "P" not in values:
            raise GcodeError(28)
        if values["P"] < 0:
            raise GcodeError(4)
        actions.append(Dwell(values.pop("P")))
    motion = commands.get(0)
    if motion:
        new = replace(new, motion=motion)
    axes = [letter for letter in "XYZ" if letter in values]
    if special in ("G10", "G28", "G28.1", "G30", "G30.1", "G92", "G92.1"):
        if motion and motion != "G80" and axes:
            raise GcodeError(24)
        new = _special(special, values, axes, new, actions)
    elif axes or (motion and motion not in ("G0", "G1", "G80")):
        new = _move(values, axes, new, actions, machine=special == "G53", inverse_feed=values.get("F"))
    values.pop("F", None)
    if any(letter not in "S" for letter in values):
        raise GcodeError(36)
    flow = commands.get(GROUP["M0"])
    if flow == "M0":
        actions.append(Pause())
    elif flow in ("M2", "M30"):
        new = replace(
            new, motion="G1", plane="G17", system="G54", absolute=True, inverse=False, spindle="M5", coolant="M9"
        )
        actions += [Spindle(0.0), End()]
    return new, actions


def _sorted(found: list[tuple[str, float]], *, arcs: bool) -> tuple[dict[int, str], dict[str, float]]:
    commands: dict[int, str] = {}
    values: dict[str, float] = {}
    for letter, value in found:
        if letter in "GM":
            word = f"{letter}{value:g}"
            if word == "M1":
                continue
            if word not in GROUP or (not arcs and word in ("G2", "G3")):
                raise GcodeError(20 if value == int(value) or letter == "G" else 23)
            if GROUP[word] in commands:
                raise GcodeError(21)
            commands[GROUP[word]] = word
        elif letter in "FIJKLNPRSTXYZ":
            if letter in values:
                raise GcodeError(25)
            values[letter] = value
        else:
            raise GcodeError(20)
    return commands, values


def _set_modes(commands: dict[int, str], values: dict[str, float], modes: Modes) -> tuple[Modes, list[Action]]:
    new, actions = modes, list[Action]()
    for word in commands.values():
        if word in ("G20", "G21"):
            new = replace(new, inches=word == "G20")
        elif word in ("G17", "G18", "G19"):
            new = replace(new, plane=word)
        elif word in ("G90", "G91"):
            new = replace(new, absolute=word == "G90")
        elif word in ("G93", "G94"):
            new = replace(new, inverse=word == "G93", feed=0.0 if (word == "G93") != modes.inverse else new.feed)
        elif word in SYSTEMS:
            new = replace(new, system=word)
        elif word in ("M7", "M8", "M9"):
            new = replace(new, coolant=word)
    if "F" in values and not new.inverse:
        new = replace(new, feed=values["F"] * (INCH if new.inches else 1))
    spindle, pulse = commands.get(GROUP["M3"], new.spindle), values.get("S", new.pulse)
    if spindle != modes.spindle or pulse != modes.pulse:
        actions.append(Spindle(0.0 if spindle == "M5" else pulse))
        new = replace(new, spindle=spindle, pulse=pulse)
    return new, actions


def _special(word: str, values: dict[str, float], axes: list[str], modes: Modes, actions: list[Action]) -> Modes:
    scale = INCH if modes.inches else 1.0
    given = {letter: values.pop(letter) * scale for letter in axes}
    if word == "G92.1":
        return replace(modes, g92=ZERO)
    if word == "G92":
        if not given:
            raise GcodeError(26)
        base = modes.systems[modes.system]
        g92 = tuple(
            modes.position[k] - base[k] - given[letter] if letter in given else modes.g92[k]
            for k, letter in enumerate("XYZ")
        )
        return replace(modes, g92=g92)  # type: ignore[arg-type]
    if word == "G10":
        return _stored(values, given, modes, actions)
    name = word[:3]
    if word.endswith(".1"):
        actions.append(Store())
        return replace(modes, homes={**modes.homes, name: modes.position})
    if given:
        actions.append(Move(_target(given, modes), None))
    home = modes.homes[name]
    to = home if not given else tuple(
        home[k] if letter in given else modes.position[k] for k, letter in enumerate("XYZ")
    )  # fmt: skip
    actions.append(Move(to, None))  # type: ignore[arg-type]
    return replace(modes, position=to)  # type: ignore[arg-type]


def _stored(values: dict[str, float], given: dict[str, float], modes: Modes, actions: list[Action]) -> Modes:
    if not given:
        raise GcodeError(26)
    kind, number = values.pop("L", None), values.pop("P", None)
    if kind is None or number is None:
        raise GcodeError(28)
    if kind not in (2, 20):
        raise GcodeError(20)
    if not 0 <= number <= 6:
        raise GcodeError(29)
    name = SYSTEMS[int(number) - 1] if number else modes.system
    old = modes.systems[name]
    new = list(old)
    for k, letter in enumerate("XYZ"):
        if letter in given:
            new[k] = given[letter] if kind == 2 else modes.position[k] - modes.g92[k] - given[letter]
    actions.append(Store())
    return replace(modes, systems={**modes.systems, name: (new[0], new[1], new[2])})


def _target(given: dict[str, float], modes: Modes, *, machine: bool = False) -> Place:
    """Where coordinates (mm) lead."""
    offset = ZERO if machine else modes.offset
    to = list(modes.position)
    for k, letter in enumerate("XYZ"):
        if letter in given:
            to[k] = given[letter] + offset[k] if machine or modes.absolute else to[k] + given[letter]
    return to[0], to[1], to[2]


def _move(
    values: dict[str, float], axes: list[str], modes: Modes, actions: list[Action], *, machine: bool,
    inverse_feed: float | None,
) -> Modes:  # fmt: skip
    motion, scale = modes.motion, INCH if modes.inches else 1.0
    if motion == "G80":
        raise GcodeError(31)
    if machine and motion not in ("G0", "G1"):
        raise GcodeError(30)
    to = _target({letter: values.pop(letter) * scale for letter in axes}, modes, machine=machine)
    if motion == "G0":
        actions.append(Move(to, None))
        return replace(modes, position=to)
    if motion == "G38.2":
        raise GcodeError(20)  # no probe here
    feed = inverse_feed if modes.inverse else modes.feed
    if not feed:
        raise GcodeError(22)
    points = [to]
    if motion in ("G2", "G3"):
        points = _arc(values, axes, modes, to, left=motion == "G3")
    if modes.inverse:
        feed *= sum(_far(a, b) for a, b in zip([modes.position, *points[:-1]], points, strict=True))
    actions += [Move(point, feed) for point in points]
    return replace(modes, position=to)


def _arc(values: dict[str, float], axes: list[str], modes: Modes, to: Place, *, left: bool) -> list[Place]:
    if modes.plane != "G17":
        raise GcodeError(20)  # GRBL does; no plotter needs it
    if not {"X", "Y"} & set(axes):
        raise GcodeError(32 if axes else 26)
    scale = INCH if modes.inches else 1.0
    ax, ay, az = modes.position
    dx, dy = to[0] - ax, to[1] - ay
    if "R" in values:
        r = values.pop("R") * scale
        square = 4 * r * r - dx * dx - dy * dy
        if (dx, dy) == (0.0, 0.0):
            raise GcodeError(33)
        if square < 0:
            raise GcodeError(34)
        h = -sqrt(square) / hypot(dx, dy) * (-1 if left else 1) * (-1 if r < 0 else 1)
        i, j = 0.5 * (dx - dy * h), 0.5 * (dy + dx * h)
        r = abs(r)
    else:
        if not {"I", "J"} & set(values):
            raise GcodeError(35)
        i, j = values.pop("I", 0.0) * scale, values.pop("J", 0.0) * scale
        r = hypot(i, j)
        off = abs(hypot(dx - i, dy - j) - r)
        if off > 0.5 or (off > 0.005 and off > 0.001 * r):
            raise GcodeError(33)
    cx, cy = ax + i, ay + j
    begin = atan2(-j, -i)
    turn = atan2(to[1] - cy, to[0] - cx) - begin
    if left and turn <= 5e-7:
        turn += 2 * pi
    elif not left and turn >= -5e-7:
        turn -= 2 * pi
    parts = int(abs(0.5 * turn * r) / sqrt(ARC_TOLERANCE_MM * max(2 * r - ARC_TOLERANCE_MM, 1e-9)))
    middle = [
        (cx + r * cos(begin + turn * k / parts), cy + r * sin(begin + turn * k / parts), az + (to[2] - az) * k / parts)
        for k in range(1, parts)
    ]
    return [*middle, to]


def _jog(commands: dict[int, str], values: dict[str, float], modes: Modes) -> tuple[Modes, list[Action]]:
    """$J=: a move with its own modes, which does not change those of the program."""
    allowed = {"G20", "G21", "G90", "G91", "G53"}
    axes = [letter for letter in "XYZ" if letter in values]
    if set(commands.values()) - allowed or not axes or not values.get("F"):
        raise GcodeError(16 if set(commands.values()) - allowed else 22 if axes else 26)
    own, _ = _set_modes(commands, {}, modes)
    scale = INCH if own.inches else 1.0
    to = _target({a: values[a] * scale for a in axes}, own, machine="G53" in commands.values())
    return replace(modes, position=to), [Move(to, values["F"] * scale)]


def _plus(a: Place, b: Place) -> Place:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _far(a: Place, b: Place) -> float:
    return sqrt(sum((p - q) ** 2 for p, q in zip(a, b, strict=True)))


def seconds_up(seconds: float, step: float = 0.05) -> float:
    """Dwells last whole steps."""
    return ceil(round(seconds / step, 6)) * step
