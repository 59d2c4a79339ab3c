"""G-code in the flavours of GRBL, FluidNC, grblHAL, LinuxCNC, Marlin, DrawCore and uArm.

Absolute millimetres. A line of the pen is: G0 to its beginning, pen down, G1/G2/G3/G5 along it, pen up. Curves are
arcs (biarcs within the tolerance), cubics (G5) or lines, as the profile says the firmware knows them. Arcs are made
from points already rounded to the file's decimals, so that their two radii agree as firmwares demand.

Sources: GRBL 1.1 wiki (commands, interface); NIST RS274/NGC and LinuxCNC's G-code reference; Marlin's G-code index.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, hypot, sqrt
from typing import NamedTuple

import numpy as np

from strokeplan.biarcs import Arcs
from strokeplan.plotter.brush import Visit, heights, turns_deg, visits_by_line
from strokeplan.plotter.profile import Gcode
from strokeplan.plotter.program import JobPen, Program
from strokeplan.plotter.tools import AngleServo, PwmServo, ZBrush, ZPen

DECIMALS = 3
RESOLUTION_MM = 10.0**-DECIMALS
MIN_CHORD_MM = 0.02
"""An arc of a shorter chord is a line: rounding would decide its centre."""
MAX_RADIUS_MM = 5_000.0
"""An arc of a larger radius is lines: controllers that count in 32 bits lose its centre."""


class Flavour(NamedTuple):
    """What firmwares differ in."""

    dwell_ms: bool
    """G4 P in milliseconds; else in seconds."""
    rapid: str
    """The word for a travel; without a rapid of its own a feed stands with it."""
    rapid_feed: bool
    wait: str
    """What lets the machine finish before what follows; "" where nothing is needed."""
    pause: str
    end: str
    start: tuple[str, ...]


_START = ("G21", "G90", "G17", "G94")
FLAVOURS = {
    # GRBL: G4 P in seconds; M0 waits for cycle start; M2 ends and resets modes (GRBL 1.1 wiki).
    "grbl": Flavour(False, "G0", False, "", "M0", "M2", _START),
    "grblhal": Flavour(False, "G0", False, "", "M0", "M2", _START),
    "fluidnc": Flavour(False, "G0", False, "", "M0", "M2", _START),
    "drawcore": Flavour(False, "G0", False, "", "M0", "M2", _START),
    # LinuxCNC: exact arcs' centres relative (G91.1) is its default; G64 P sets how far corners may be cut.
    "linuxcnc": Flavour(False, "G0", False, "", "M0", "M2", (*_START, "G91.1")),
    # Marlin: G4 P in ms; G0 takes the feed of the last move unless it has its own; M400 waits for moves.
    "marlin": Flavour(True, "G0", True, "M400", "M0", "M400", ("G21", "G90")),
    # uArm: G4 P in ms, G0/G1 with a feed (uArm Swift Pro developer guide).
    "uarm": Flavour(True, "G0", True, "", "", "", ("G21", "G90")),
}


def number(value: float) -> str:
    """A coordinate as short as can be."""
    text = f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def encode(program: Program, header: list[str]) -> bytes:
    """The file of a program; `header` stands before it as comments."""
    dialect = program.profile.dialect
    if not isinstance(dialect, Gcode):
        raise TypeError("a profile of another dialect")
    lines = [f"; {comment(text)}" for text in header]
    lines += [*FLAVOURS[dialect.flavour].start, *dialect.prologue]
    lines += Writer(program, dialect).body()
    lines += [line for line in (*dialect.epilogue, FLAVOURS[dialect.flavour].end) if line]
    return ("\n".join(lines) + "\n").encode("ascii")


def comment(text: str) -> str:
    """A text as a comment may have it: printable ASCII without what ends one or begins a command."""
    plain = text.replace("×", "x").encode("ascii", "replace").decode()
    return "".join(c if c.isalnum() or c in " .,:=/+-_#" else "_" for c in plain)[:100]


class Writer:
    """Writes the lines of one program, for a file or for a machine that listens (driving/units.py)."""

    def __init__(self, program: Program, dialect: Gcode) -> None:
        self.program, self.dialect = program, dialect
        self.flavour = FLAVOURS[dialect.flavour]
        self.tool = program.profile.tool
        self.travel = f" F{number(program.profile.speeds.travel_mm_min)}" if self.flavour.rapid_feed else ""
        self.brush = heights(program, self.tool) if isinstance(self.tool, ZBrush) else None
        self.feeds: list[float] = program.feeds.tolist()
        self.arcs = program.arcs if dialect.curves == "arcs" and self.brush is None else None

    def body(self) -> Iterator[str]:
        """Everything between the start and the end."""
        program = self.program
        changes, pen = set(program.changes), program.pens[0]
        stops = visits_by_line(program)
        yield from self.up(pen)
        for j in range(len(program)):
            if j in changes:
                pen = program.pens[program.pen[j]]
                yield from self.change(pen, first=j == 0)
            for stop in stops.get(j, ()):
                yield from self.visit(stop)
            yield from self.line(j, pen)
        for stop in stops.get(len(program), ()):
            yield from self.visit(stop)
        yield from self.park()

    def line(self, j: int, pen: JobPen) -> Iterator[str]:
        """One line: there, down, along, up."""
        feed = f" F{number(self.feeds[j])}"
        if isinstance(self.tool, ZBrush):
            yield from self.painted(j, feed)
            return
        moves = self.moves(j)
        yield self.rapid(next(moves))
        yield from self.down(pen)
        first = True
        for move in moves:
            yield move + feed if first else move
            first = False
        if first:  # a line shorter than the file's decimals: a dot, drawn where it stands
            yield self.dot(j) + feed
        yield from self.up(pen)

    def dot(self, j: int) -> str:
        x, y = self.program.line(j)[0].tolist()
        return f"G1 X{number(x)} Y{number(y)}"

    def rapid(self, where: str) -> str:
        return f"{self.flavour.rapid} {where}{self.travel}"

    def moves(self, j: int) -> Iterator[str]:
        """Where the line begins ("X… Y…"), then the commands that draw it."""
        chain = self.program.line(j)
        yield f"X{number(chain[0, 0])} Y{number(chain[0, 1])}"
        if self.arcs is not None:
            yield from arc_moves(self.arcs.chain(j))
        elif self.dialect.curves == "cubics":
            yield from cubic_moves(chain.tolist())
        else:
            points, starts = self.program.polylines
            yield from straight_moves(points[starts[j] : starts[j + 1]].tolist())

    def painted(self, j: int, feed: str) -> Iterator[str]:
        """A line of the brush, its height along it."""
        if self.brush is None or not isinstance(self.tool, ZBrush):
            raise TypeError("no brush")
        points, starts = self.brush
        line = points[starts[j] : starts[j + 1]]
        axis = self.tool.angle_axis
        turn = [f" {axis}{number(a)}" for a in turns_deg(line[:, :2]).tolist()] if axis else [""] * len(line)
        x, y, z = line[0].tolist()
        yield f"{self.rapid(f'X{number(x)} Y{number(y)}')}{turn[0]}"
        rate = f" F{number(self.tool.rate_mm_min)}"
        yield f"G1 Z{number(z)}{rate}"
        for k, (x, y, z) in enumerate(line[1:].tolist(), start=1):
            yield f"G1 X{number(x)} Y{number(y)} Z{number(z)}{turn[k]}{feed if k == 1 else ''}"
        yield f"G1 Z{number(self.tool.safe_mm)}{rate}"

    def down(self, pen: JobPen) -> Iterator[str]:
        tool, own = self.tool, pen.settings
        if isinstance(tool, ZPen):
            height = tool.down_mm if own.down_mm is None else own.down_mm
            yield f"G1 Z{number(height)} F{number(tool.rate_mm_min)}"
        elif isinstance(tool, PwmServo):
            yield f"M3 S{number(tool.down_pwm if own.down_pwm is None else own.down_pwm)}"
        elif isinstance(tool, AngleServo):
            yield from filter(None, [self.flavour.wait])
            yield f"M280 P{tool.index} S{number(tool.down_deg if own.down_deg is None else own.down_deg)}"
        yield from self.dwell(tool.lower_s if own.lower_s is None else own.lower_s)

    def up(self, pen: JobPen) -> Iterator[str]:
        tool, own = self.tool, pen.settings
        if isinstance(tool, ZPen):
            # A feed and no rapid: the z of a printer is slower than what G0 may ask for.
            yield f"G1 Z{number(tool.up_mm)} F{number(tool.rate_mm_min)}"
        elif isinstance(tool, ZBrush):
            yield f"G1 Z{number(tool.safe_mm)} F{number(tool.rate_mm_min)}"
        elif isinstance(tool, PwmServo):
            yield "M5" if tool.up_pwm is None else f"M3 S{number(tool.up_pwm)}"
        elif isinstance(tool, AngleServo):
            yield from filter(None, [self.flavour.wait])
            yield f"M280 P{tool.index} S{number(tool.up_deg)}"
        yield from self.dwell(tool.raise_s if own.raise_s is None else own.raise_s)

    def dwell(self, seconds: float) -> Iterator[str]:
        if seconds > 0:
            yield f"G4 P{number(seconds * 1000 if self.flavour.dwell_ms else seconds)}"

    def change(self, pen: JobPen, *, first: bool) -> Iterator[str]:
        """Another pen: the machine parks and waits; before the first one it only says which."""
        yield f"; pen {pen.slot}: {comment(pen.name)}"
        if first or isinstance(self.tool, ZBrush):
            return
        yield from self.park()
        yield from filter(None, [self.flavour.wait])
        yield self.flavour.pause

    def park(self) -> Iterator[str]:
        park = self.program.profile.change.park_mm
        if park is not None:
            yield self.rapid(f"X{number(park[0])} Y{number(park[1])}")

    def visit(self, stop: Visit) -> Iterator[str]:
        """Down into a well, to and fro, and up again."""
        tool, well = self.tool, stop.well
        if not isinstance(tool, ZBrush):
            return
        x, y = well.at_mm
        rate, feed = f" F{number(tool.rate_mm_min)}", f" F{number(self.program.profile.speeds.draw_mm_min)}"
        yield f"; {stop.kind} {comment(well.name or '')}".rstrip()
        yield self.rapid(f"X{number(x)} Y{number(y)}")
        yield f"G1 Z{number(well.bottom)}{rate}"
        for x, y in well.stirs:
            yield f"G1 X{number(x)} Y{number(y)}{feed}"
        yield f"G1 Z{number(tool.safe_mm)}{rate}"


def straight_moves(points: list[list[float]]) -> Iterator[str]:
    """G1 along a polyline; what rounds to where the pen is says nothing."""
    before = f"X{number(points[0][0])} Y{number(points[0][1])}"
    for x, y in points[1:]:
        where = f"X{number(x)} Y{number(y)}"
        if where != before:
            yield f"G1 {where}"
        before = where


def cubic_moves(chain: list[list[float]]) -> Iterator[str]:
    """G5: I, J from the beginning to the first handle, P, Q from the end to the second; straight ones as G1."""
    for k in range(0, len(chain) - 1, 3):
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = chain[k : k + 4]
        way = hypot(bx - ax, by - ay) + hypot(cx - bx, cy - by) + hypot(dx - cx, dy - cy)
        if way < RESOLUTION_MM:
            continue
        if way - hypot(dx - ax, dy - ay) < RESOLUTION_MM:
            yield f"G1 X{number(dx)} Y{number(dy)}"
        else:
            handles = f"I{number(bx - ax)} J{number(by - ay)} P{number(cx - dx)} Q{number(cy - dy)}"
            yield f"G5 {handles} X{number(dx)} Y{number(dy)}"


def arc_moves(arcs: Arcs) -> Iterator[str]:
    """G1, G2 and G3 along arcs; centres from the rounded points."""
    points = np.round(arcs.points, DECIMALS).tolist()
    ax, ay = points[0]
    for (bx, by), bulge in zip(points[1:], arcs.bulges.tolist(), strict=True):
        dx, dy = bx - ax, by - ay
        chord = hypot(dx, dy)
        if chord < RESOLUTION_MM / 2:
            continue  # the same point as the file has it: an arc to it would be a full circle
        where = f"X{number(bx)} Y{number(by)}"
        radius = chord * (1 / abs(bulge) + abs(bulge)) / 4 if bulge else 0.0
        if bulge == 0 or chord < MIN_CHORD_MM:
            yield f"G1 {where}"
        elif radius > MAX_RADIUS_MM:
            yield from flat_moves(ax, ay, dx, dy, abs(bulge) * chord / 2, bulge)
        else:
            rise = (1 - bulge * bulge) / (4 * bulge)
            centre = f"I{number(dx / 2 - dy * rise)} J{number(dy / 2 + dx * rise)}"
            yield f"{'G3' if bulge > 0 else 'G2'} {where} {centre}"
        ax, ay = bx, by


def flat_moves(ax: float, ay: float, dx: float, dy: float, rise: float, bulge: float) -> Iterator[str]:
    """G1 along a flat arc that rises by `rise` above its chord (dx, dy), as a parabola; within the file's decimals."""
    pieces = max(ceil(sqrt(rise / RESOLUTION_MM)), 1)
    for k in range(1, pieces + 1):
        t = k / pieces
        side = 2 * bulge * t * (1 - t)  # 4 t (1 − t) of the rise, bulge · chord / 2, to the right of the chord
        yield f"G1 X{number(ax + t * dx + side * dy)} Y{number(ay + t * dy - side * dx)}"
