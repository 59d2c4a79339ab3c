"""Commands of the EiBotBoard (AxiDraw and its kin): the host plans the motion, the board turns two motors.

Every block of the planned motion (motion.py) is cut into slices of time; a slice is one XM (SM where each motor drives
an axis of its own), whole steps between where the pen is at its two ends: rounding never adds up. A slice shorter than
the board keeps up with is stretched, which slows the pen down and moves it nowhere else; so is one that would exceed 25
kHz on a motor.

Lines that begin with # are for people (the header): whoever sends the file leaves them out. The file begins and ends
at the home corner, where motors were switched on.

Source: EiBotBoard command set (evil-mad.github.io/EggBot/ebb.html), commands EM, S2, SC, SM, SP, XM.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import PlotError
from strokeplan.plotter import motion
from strokeplan.plotter.profile import Ebb, Profile
from strokeplan.plotter.program import JobPen, Program, limits
from strokeplan.plotter.tools import EbbServo

MAX_STEPS_MS = 24.9
"""Steps of one motor in a millisecond; the board's end is 25."""
SIXTEENTH = 1
"""EM's number for 16 microsteps."""
UNIT_PER_MS = 12_000
"""Of a servo's pulse: 83.3 ns."""


def encode(program: Program, header: list[str]) -> bytes:
    """The file of a program. Raises PlotError for more than one pen: the board cannot wait for a change."""
    dialect, tool = program.profile.dialect, program.profile.tool
    if not (isinstance(dialect, Ebb) and isinstance(tool, EbbServo)):
        raise TypeError("a profile of another dialect")
    if len(program.pens) > 1:
        names = ", ".join(pen.name for pen in program.pens[:10])
        raise PlotError(f"an .ebb file cannot wait for a change of pen ({names}); write one a pen: --file-per-pen")
    lines = [f"# {_plain(text)}" for text in header]
    return ("\r".join([*lines, *_commands(program, dialect, tool)]) + "\r").encode("ascii")


def _plain(text: str) -> str:
    return "".join(c if " " <= c <= "~" else "x" if c == "×" else "?" for c in text)[:200]


def _commands(program: Program, dialect: Ebb, tool: EbbServo) -> Iterator[str]:
    pen = program.pens[0]
    up, lower = pen_commands(tool, pen)
    yield from start(tool, pen)
    yield up
    lines = range(len(program) + 1)
    stroke, drawn, moves = _slices(program, dialect)
    commands = written(moves, program.profile)
    begins = np.searchsorted(stroke, lines).tolist()
    downs = (begins + np.bincount(stroke[~drawn], minlength=len(lines))).tolist()
    for j in lines[:-1]:
        yield from commands[begins[j] : downs[j]]
        yield lower
        yield from commands[downs[j] : begins[j + 1]]  # none for a dot
        yield up
    yield from commands[begins[-1] :]
    yield "EM,0,0"


def start(tool: EbbServo, pen: JobPen) -> Iterator[str]:
    """Motors on, and where the servo has the pen."""
    own = pen.settings
    down = tool.down_percent if own.down_percent is None else own.down_percent
    yield f"EM,{SIXTEENTH},{SIXTEENTH}"
    yield f"SC,4,{_pulse(tool, tool.up_percent)}"
    yield f"SC,5,{_pulse(tool, down)}"
    yield f"SC,11,{tool.raise_rate}"
    yield f"SC,12,{tool.lower_rate}"


def pen_commands(tool: EbbServo, pen: JobPen) -> tuple[str, str]:
    """Up and down."""
    own = pen.settings
    down = tool.down_percent if own.down_percent is None else own.down_percent
    lower_s = tool.lower_s if own.lower_s is None else own.lower_s
    raise_s = tool.raise_s if own.raise_s is None else own.raise_s
    if tool.pin is None:
        return f"SP,1,{round(raise_s * 1000)}", f"SP,0,{round(lower_s * 1000)}"
    return (
        f"S2,{_pulse(tool, tool.up_percent)},{tool.pin},{tool.raise_rate},{round(raise_s * 1000)}",
        f"S2,{_pulse(tool, down)},{tool.pin},{tool.lower_rate},{round(lower_s * 1000)}",
    )


def written(moves: NDArray[np.int64], profile: Profile) -> list[str]:
    """Slices (s, 3) as commands; XM where the motors drive x and y together."""
    word = "XM" if profile.machine.kinematics == "corexy" else "SM"
    return [f"{word},{ms},{x},{y}" for ms, x, y in moves.tolist()]


def _pulse(tool: EbbServo, percent: float) -> int:
    return round(tool.low + (tool.high - tool.low) * percent / 100)


def _slices(program: Program, dialect: Ebb) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    """Line and whether it is drawn, (s,) each, and ms and steps of x and y (s, 3): from home and back to it."""
    points, starts = program.polylines
    points = np.concatenate([points, [[0.0, 0.0]]])
    starts = np.concatenate([starts, [len(points)]])
    feeds = np.concatenate([program.feeds, [program.profile.speeds.travel_mm_min]])
    return slices(points, starts, feeds, program.profile, dialect)


def slices(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    feeds: NDArray[np.float64],
    profile: Profile,
    dialect: Ebb,
    begin: tuple[float, float] = (0.0, 0.0),
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    """Of polylines that are drawn from `begin` on: line and whether drawn, (s,) each; ms and steps of x, y (s, 3)."""
    moved = motion.plan(points, starts, limits(profile), feeds, start=begin)
    if not len(moved.duration):  # a dot where the pen is
        return moved.stroke, moved.down, np.empty((0, 3), np.int64)
    cuts = np.maximum(np.ceil(moved.duration * 1000 / dialect.slice_ms), 1).astype(np.int64)
    block = np.repeat(np.arange(len(cuts)), cuts)
    part = (np.arange(len(block)) - np.repeat(np.cumsum(cuts) - cuts, cuts) + 1) / cuts[block]
    at = moved.at(moved.began[block] + part * moved.duration[block]).points
    last = part == 1
    at[last] = moved.end[block[last]]
    first = np.rint(np.array([begin]) * dialect.steps_mm).astype(np.int64)
    steps = np.diff(np.rint(at * dialect.steps_mm).astype(np.int64), axis=0, prepend=first)
    corexy = profile.machine.kinematics == "corexy"  # a motor turns by x + y, the other by x − y
    fastest = np.abs(steps).sum(axis=1) if corexy else np.abs(steps).max(axis=1)
    ms = np.ceil(moved.duration[block] * 1000 / cuts[block] - 1e-9)
    ms = np.maximum(np.maximum(ms, dialect.min_ms), np.ceil(fastest / MAX_STEPS_MS))
    moves = np.column_stack([ms.astype(np.int64), steps])
    keep = steps.any(axis=1)
    return moved.stroke[block][keep], moved.down[block][keep], moves[keep]
