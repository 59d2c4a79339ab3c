"""A brush in the hand of a machine: how hard it is pressed, and when it visits the wells.

Height follows width: the tip touches at one height and makes its widest line at another, linear between; it comes down
along the beginning of a line and lifts off along its end. The brush is dipped when it has painted as far as one dip
lasts, counted across strokes and by the paint left in it; a change of paint washes and wipes it first.

Known limits: a line longer than a dip lasts is painted to its end, and the brush filled after it; the width of a
brush is taken to be linear in its height, which is what the calibration of two heights gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import flatten_all
from strokeplan.errors import PlotError
from strokeplan.plotter import motion
from strokeplan.plotter.program import Program, limits
from strokeplan.plotter.segments import with_values
from strokeplan.plotter.tools import Brush, Well


@dataclass(frozen=True, slots=True)
class Visit:
    """A stay at a well before line `line`."""

    line: int
    kind: Literal["dip", "wash", "wipe"]
    well: Well


def visits_by_line(program: Program) -> dict[int, list[Visit]]:
    """Stays at wells, by the line that they stand before."""
    found: dict[int, list[Visit]] = {}
    for stop in visits(program):
        found.setdefault(stop.line, []).append(stop)
    return found


def visits(program: Program) -> list[Visit]:
    """Where the brush goes between lines, in order. Raises PlotError for a pen that no well has the paint of."""
    tool = program.profile.tool
    if not isinstance(tool, Brush) or tool.refill_mm is None:
        return []
    points, starts = program.polylines
    step = np.concatenate([np.hypot(*np.diff(points, axis=0).T), [0.0]])
    step[starts[1:] - 1] = 0.0
    lengths = np.add.reduceat(step, starts[:-1])
    wells = [_well(tool, pen.name, len(program.pens)) for pen in program.pens]
    stops: list[Visit] = []
    left, loaded = 0.0, (-1, -1)
    layers = program.layer.tolist() if tool.wash_layers else [0] * len(program)
    for j, (pen, layer, length) in enumerate(zip(program.pen.tolist(), layers, lengths.tolist(), strict=True)):
        if loaded not in ((-1, -1), (pen, layer)):
            stops += _cleaning(tool, j)
        if loaded != (pen, layer) or left <= 0 or (length > left and left < tool.refill_mm):
            stops.append(Visit(j, "dip", wells[pen]))
            left = tool.refill_mm
        left -= length
        loaded = pen, layer
    return stops + _cleaning(tool, len(program))


def _well(tool: Brush, pen: str, pens: int) -> Well:
    for well in tool.paints:
        if well.name == pen:
            return well
    if pens == 1:
        return tool.paints[0]
    known = ", ".join(well.name or "one without a name" for well in tool.paints)
    raise PlotError(f"no well has the paint of pen {pen!r}; [[tool.paints]] has {known}")


def _cleaning(tool: Brush, line: int) -> list[Visit]:
    stops = [Visit(line, "wash", well) for well in tool.water]
    return [*stops, Visit(line, "wipe", tool.cloth)] if tool.cloth else stops


def visit_s(program: Program, visit: Visit) -> float:
    """Seconds for a stay at a well, the brush's way down and up included."""
    tool = program.profile.tool
    if not isinstance(tool, Brush):
        return 0.0
    (safe, *_), well, profile = tool.heights, visit.well, program.profile
    stood = tool.lower_s + tool.way_s(safe, well.bottom) + tool.way_s(well.bottom, safe) + tool.raise_s
    line = np.array([well.at_mm, *well.stirs])
    ends = np.array([0, len(line)])
    return stood + motion.plan(line, ends, limits(profile), profile.speeds.draw_mm_min, start=well.at_mm).total_s


def heights(program: Program, tool: Brush) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (v, 3) and starts (m + 1,): the lines with the height of the brush, ramps at both ends."""
    _, touch, press = tool.heights
    part = (2 * program.radii - tool.touch_width_mm) / (tool.press_width_mm - tool.touch_width_mm)
    z = touch + np.clip(part, 0, 1) * (press - touch)
    tolerance = program.profile.tolerance_mm
    vertices, starts = flatten_all(with_values(program.points, program.starts, z), program.starts, tolerance)
    lines = [
        _ramped(vertices[a:b], touch, tool.approach_mm)
        for a, b in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)
    ]
    return np.concatenate(lines), np.cumsum([0, *(len(line) for line in lines)], dtype=np.int64)


def _ramped(line: NDArray[np.float64], touch: float, approach_mm: float) -> NDArray[np.float64]:
    """A line that begins and ends where the tip just touches, and reaches its height along the ramps."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    ramp = min(approach_mm, way[-1] / 2)
    if ramp <= 0:
        return line
    marks = np.union1d(way, [ramp, way[-1] - ramp])
    made = np.column_stack([np.interp(marks, way, line[:, k]) for k in range(3)])
    pressed = np.clip(np.minimum(marks, way[-1] - marks) / ramp, 0, 1)
    made[:, 2] = touch + pressed * (made[:, 2] - touch)
    return made


def turns_deg(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """(v,) degrees that the brush is turned to at each vertex of a line (v, 2): along it, without leaps."""
    step = np.diff(line, axis=0)
    angle = np.arctan2(step[:, 1], step[:, 0])
    along = np.unwrap(np.concatenate([angle[:1], angle]))
    degrees: NDArray[np.float64] = np.degrees(along)
    return degrees
