"""How one talks with a GRBL that draws nothing: who it is, how it does, hold, reset, home. Waits in the link.

Sources: GRBL 1.1 wiki (interface, commands).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from strokeplan.errors import DriveError
from strokeplan.plotter.driving.codec import recognise, refuse_other
from strokeplan.plotter.driving.link import Link

NAME = "GRBL"
BUFFER = 127
"""Bytes of the receive buffer that are used where the machine does not say how large it is."""
POLL_S = 0.25
"""Between two status polls; the manual asks for at most five a second."""
BANNER_S = 3.0
"""From opening the port to the banner: an Arduino's boot loader takes up to two seconds."""
ANSWER_S = 3.0
IDLE_S = 120.0
"""The longest that a machine may finish what it has."""
REPORTS = 40
"""The offset of coordinates stands in one report of 10, of a machine that works in one of 30."""
TAGS = 99
BANNER = re.compile(r"(Grbl|GrblHAL|DrawCore|FluidNC)\b.*\d.*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Met:
    """What is known of a machine after it was greeted.

    said    what it says of itself.
    kept    it has not started anew: it knows its place.
    locked  it is in alarm, and must be homed or unlocked.
    room    bytes of its receive buffer that may be used.
    tagged  `$G` shows the tool number that was given last.
    """

    said: str
    kept: bool
    locked: bool
    room: int
    tagged: bool


def meet(link: Link) -> Met:
    """Greet a machine and wait until it rests. Raises WrongDeviceError, DriveError."""
    found = link.hear(lambda line: line if BANNER.match(line) or recognise(line) else None, BANNER_S)
    refuse_other(NAME, recognise(found or ""))
    kept = found is None  # it did not start anew
    link.drain(0.2)
    link.forget()
    link.say("#")  # what is left of an earlier line, if anything, is refused with it
    link.drain(0.2)
    version, options = _identify(link)
    said = found or version
    if said is None:
        raise DriveError("no answer: is the machine on, is this its port? (the profile speaks GRBL at 115200 baud)")
    locked, undisturbed = _rested(link)
    sizes = re.findall(r",(\d+)", options)
    room = max(int(sizes[1]) - 1, 40) if len(sizes) >= 2 else BUFFER
    said = " ".join(filter(None, [said.split(" [")[0], version]))
    return Met(said, kept and undisturbed, locked, room, _shows_tags(link))


def _identify(link: Link) -> tuple[str | None, str]:
    """What $I says: version, options."""
    lines = query(link, "$I")
    for line in lines:
        refuse_other(NAME, recognise(line))
    version = next((line[5:-1].strip(":") for line in lines if line.startswith("[VER:")), None)
    return version, next((line for line in lines if line.startswith("[OPT:")), "")


def _rested(link: Link) -> tuple[bool, bool]:
    """Wait for what an earlier host may have left, end a hold: whether it is locked, and whether its place is kept."""
    until, kept = link.now() + IDLE_S, True
    while link.now() < until:
        state = ask_state(link)
        if state.startswith(("Idle", "Alarm")):
            return state.startswith("Alarm"), kept
        if state.startswith(("Hold", "Door", "Check", "Sleep")):
            kept = not reset(link) and kept
        link.drain(POLL_S, POLL_S)
    raise DriveError(f"the machine does not come to rest in {IDLE_S:g} s; switch it off and on")


def _shows_tags(link: Link) -> bool:
    query(link, f"T{TAGS + 1}")
    return any(line.startswith("[GC:") and f" T{TAGS + 1} " in f"{line[:-1]} " for line in query(link, "$G"))


def query(link: Link, text: str) -> list[str]:
    """What a line is answered with, up to its ok or error; or to a word of another kind of machine."""
    lines: list[str] = []

    def collect(line: str) -> bool | None:
        lines.append(line)
        ended = line == "ok" or line.startswith(("error", "ALARM")) or recognise(line) not in (None, NAME)
        return True if ended else None

    link.say(text)
    link.hear(collect, ANSWER_S)
    return lines


def home(link: Link) -> None:
    """Look for the switches. Raises DriveError."""
    link.say("$H")
    found = link.hear(lambda line: line if line == "ok" or line.startswith(("error", "ALARM")) else None, IDLE_S)
    if found != "ok":
        raise DriveError(f"the machine does not home ({found or 'no answer'}); has it switches, and is $22 set?")


def state_in(line: str) -> str | None:
    """ "Run" of "<Run|MPos:…>"; None for what is no whole status report."""
    if not (line.startswith("<") and line.endswith(">")):
        return None
    return re.split(r"[|,]", line[1:-1])[0]


def ask_state(link: Link, tries: int = 3) -> str:
    """ "Idle", "Hold:0", …; "" for a machine that is silent."""
    for _ in range(tries):
        link.push(b"?")
        found = link.hear(state_in, 1.0)
        if found:
            return found
    return ""


def place(link: Link) -> tuple[float, float] | None:
    """x and y in mm from status reports: WPos, or MPos less the offset, which some reports show; None if none does."""
    scale = 25.4 if "$13=1" in query(link, "$$") else 1.0
    seen: dict[str, tuple[float, float]] = {}
    for _ in range(REPORTS):
        link.push(b"?")
        report = link.hear(lambda line: line if state_in(line) is not None else None, 1.0) or ""
        for name, first, second in re.findall(r"\|(WPos|MPos|WCO):(-?[\d.]+),(-?[\d.]+)", report):
            seen[name] = float(first) * scale, float(second) * scale
        if "MPos" in seen and "WCO" in seen:
            (x, y), (dx, dy) = seen["MPos"], seen["WCO"]
            return x - dx, y - dy
        if "WPos" in seen:
            return seen["WPos"]
    return None


def shift(link: Link) -> tuple[float, float] | None:
    """What G92 has moved the origin by, which a reset forgets; None: by nothing."""
    line = next((line for line in query(link, "$#") if line.startswith("[G92:")), "")
    found = re.match(r"\[G92:(-?[\d.]+),(-?[\d.]+)", line)
    by = (float(found[1]), float(found[2])) if found else (0.0, 0.0)
    return by if any(by) else None


def hold(link: Link) -> bool:
    """Feed hold until the machine stands; whether it does: only then does a reset keep the position."""
    link.push(b"!")
    until = link.now() + IDLE_S
    while link.now() < until:
        state = ask_state(link)
        if state.startswith(("Hold:0", "Door:0", "Idle")) or state in ("Hold", "Check"):
            return True
        if state.startswith(("Alarm", "Sleep")) or not state:
            return False
        link.drain(0.05, POLL_S)
    return False


def reset(link: Link) -> bool:
    """Soft reset, and its banner; whether the machine is locked after it. Raises DriveError."""
    link.forget()
    link.push(b"\x18")
    if link.hear(lambda line: line if BANNER.match(line) else None, BANNER_S) is None:
        raise DriveError("the machine does not come back from its reset")
    after = link.drain(0.3)
    return any("unlock" in line.lower() for line in after) or ask_state(link).startswith("Alarm")
