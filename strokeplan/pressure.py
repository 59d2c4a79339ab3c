"""Pressure and angle of the brush along each stroke (paper, "Future Work": "angle and pressure can be
estimated from the tract and used to aid the brush rendering").

Pressure is full·strength + (1 − strength), and full lies between FLOOR and 1:

    full = FLOOR + (1 − FLOOR) · taper · bend · sureness
    taper     1 − depth · (1 − x)², x = distance to the nearer end / length of the taper, at most 1: the brush
              touches down and lifts. The taper is TAPER · width long and 1 deep; in a stroke without room
              for two it is shorter and as much less deep, so that a short dab is not pinched to a dot
    bend      1 / (1 + (κ · width / 2)²): a bend as tight as the brush is wide is painted half as hard
    sureness  LIGHT + (1 − LIGHT) · coherence: where the structure is clear the hand is sure

A hand feels the path over the width of its brush: κ is measured as the turn between the stretches of
FEEL · width before and after a point, and bend · sureness is averaged over both.

The angle is that of a flat brush that is dragged: its tip follows the handle LAG · width behind (a
tractrix), and its long axis lies across the line from tip to handle. So on a gentle curve the brush is
held across the stroke, and in a bend it comes after. It is followed from the first point to the last.

Values stand at on-curve points, so cubics are split where the values between two points would not be a
straight line over the parameter (to PRESSURE_TOLERANCE and ANGLE_TOLERANCE). The curve stays what it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import point
from strokeplan.errors import InputError
from strokeplan.field import OrientationField
from strokeplan.jit import kernel
from strokeplan.strokes import Layer, StrokePlan
from strokeplan.tractography import sample

FLOOR = 0.15
"""Least pressure at full strength: ink never vanishes."""
TAPER = 1.0
"""Length of a taper in widths of the brush."""
LIGHT = 0.5
"""Sureness where there is no coherence at all."""
FEEL = 1.0
"""How far a brush feels the path before and behind it, in its widths."""
LAG = 0.5
"""Distance from a brush's handle to its tip, in widths of the brush."""
PRESSURE_TOLERANCE = 0.03
"""Between on-curve points pressure differs from its estimate by this at most …"""
ANGLE_TOLERANCE = 0.2
"""… and the angle by this, in radians;"""
MAX_TURN = 1.2
"""two neighbouring angles differ by less than a quarter turn, so that it is plain which way round it goes."""
STEPS_PER_WIDTH = 8
"""A stroke is measured at this many points a width, …"""
MIN_STEPS, MAX_STEPS = 32, 4096
"""… but at this many in all at least, and at about this many at most."""


def add_pressure(plan: StrokePlan, fields: Iterable[OrientationField], strength: float) -> StrokePlan:
    """The plan with pressures and angles estimated along every stroke; its curves are the same, in more pieces.

    fields    the orientation field of each layer, in the plan's coordinates; read one after the other, so
              a generator need hold but one.
    strength  0 (the plan as it is) to 1. No pressure is below 1 − strength · (1 − FLOOR).

    Raises InputError for a strength out of range, or fields that are not those of the plan's layers.
    """
    if not 0 <= strength <= 1:
        raise InputError(f"pressure {strength:g} is outside 0..1")
    if strength == 0 or len(plan) == 0:
        return plan
    parts = []
    for layer, field in _paired(plan, fields):
        first, last = plan.starts[layer.first], plan.starts[layer.last]
        parts.append(
            press(
                plan.points[first:last], plan.starts[layer.first : layer.last + 1] - first,
                plan.widths[layer.first : layer.last], field.samples, field.scale, strength,
            )
        )  # fmt: skip
    points, counts, pressures, angles = (np.concatenate(column) for column in zip(*parts, strict=True))
    return replace(
        plan, points=points, starts=np.concatenate([[0], np.cumsum(counts)]), pressures=pressures, angles=angles
    )


def _paired(plan: StrokePlan, fields: Iterable[OrientationField]) -> Iterator[tuple[Layer, OrientationField]]:
    """Each layer with its field, once the field is found to be one of this plan."""
    given = 0
    for given, field in enumerate(fields, start=1):
        if given > len(plan.layers):
            break
        if (field.width, field.height) != (plan.width, plan.height):
            raise InputError(
                f"the field of layer {given} is of a photo of {field.width} × {field.height} pixels, "
                f"the canvas is {plan.width:g} × {plan.height:g}; give the fields of the photo that was planned"
            )
        yield plan.layers[given - 1], field
    if given != len(plan.layers):
        raise InputError(f"there must be one field for each of the {len(plan.layers)} layers")


@kernel
def press(
    points: NDArray[np.float64],
    starts: NDArray[np.int64],
    widths: NDArray[np.float64],
    samples: NDArray[np.float32],
    scale: float,
    strength: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Points of the split strokes, how many each has, and pressure and angle at the on-curve points of all."""
    n = len(widths)
    counts = np.empty(n, np.int64)
    out = np.empty((4 * len(points) + 64, 2))
    values = np.empty((len(out), 2))
    at, knot = 0, 0
    for i in range(n):
        chain, width = points[starts[i] : starts[i + 1]], widths[i]
        path, first = _walk(chain, width)
        s = _arc_lengths(path)
        pressure = _pressures(path, s, width, samples, scale, strength)
        angle = _angles(path, s, width)
        kept = _knots(pressure, angle, first)
        counts[i] = 3 * kept.sum() - 2
        out, values = _with_room(out, at + counts[i]), _with_room(values, knot + kept.sum())
        _split(chain, first, kept, out, at)
        for j in np.flatnonzero(kept):
            values[knot, 0], values[knot, 1] = pressure[j], _axis(angle[j] + 0.5 * np.pi)
            knot += 1
        at += counts[i]
    return out[:at].copy(), counts, values[:knot, 0].copy(), values[:knot, 1].copy()


@kernel
def _with_room(table: NDArray[np.float64], rows: int) -> NDArray[np.float64]:
    """The table, or a longer copy if it has fewer rows."""
    if len(table) >= rows:
        return table
    grown = np.empty((2 * rows, 2))
    grown[: len(table)] = table
    return grown


@kernel
def _axis(angle: float) -> float:
    """The angle of an axis in [0, π)."""
    angle %= np.pi
    return angle if 0.0 <= angle < np.pi else 0.0  # the remainder of a tiny negative number is rounded to π


@kernel
def _walk(chain: NDArray[np.float64], width: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points along a chain, evenly over each cubic's parameter, and where among them each cubic begins and ends."""
    pieces = (len(chain) - 1) // 3
    legs = np.sqrt((chain[1:, 0] - chain[:-1, 0]) ** 2 + (chain[1:, 1] - chain[:-1, 1]) ** 2)
    length = legs.sum()  # of the handles too: not less than the arc
    step = max(min(width / STEPS_PER_WIDTH, length / MIN_STEPS), length / MAX_STEPS)
    first = np.zeros(pieces + 1, np.int64)
    for k in range(pieces):
        own = legs[3 * k] + legs[3 * k + 1] + legs[3 * k + 2]
        first[k + 1] = first[k] + (max(int(np.ceil(own / step)), 1) if step > 0.0 else 1)
    path = np.empty((first[pieces] + 1, 2))
    path[0] = chain[0]
    for k in range(pieces):
        steps = first[k + 1] - first[k]
        for j in range(1, steps + 1):
            path[first[k] + j, 0], path[first[k] + j, 1] = point(chain, 3 * k, j / steps)
    return path, first


@kernel
def _arc_lengths(path: NDArray[np.float64]) -> NDArray[np.float64]:
    s = np.zeros(len(path))
    for j in range(1, len(path)):
        s[j] = s[j - 1] + np.sqrt((path[j, 0] - path[j - 1, 0]) ** 2 + (path[j, 1] - path[j - 1, 1]) ** 2)
    return s


@kernel
def _pressures(
    path: NDArray[np.float64],
    s: NDArray[np.float64],
    width: float,
    samples: NDArray[np.float32],
    scale: float,
    strength: float,
) -> NDArray[np.float64]:
    """Pressure at each point of the path."""
    n = len(path)
    length = s[n - 1]
    taper = min(TAPER * width, 0.5 * length)
    depth = taper / (TAPER * width)
    reach = min(FEEL * width, 0.5 * length)
    force, so_far = np.empty(n), np.zeros(n)  # at each point, and its integral up to there
    for j in range(n):
        coherence = sample(samples, scale, True, path[j, 0], path[j, 1], 1.0, 0.0)[2]
        force[j] = LIGHT + (1.0 - LIGHT) * coherence
        if length > 0.0:
            turn = _turn(path, s, min(max(s[j], reach), length - reach), reach)
            force[j] /= 1.0 + (0.5 * width * turn / reach) ** 2
        if j > 0:
            so_far[j] = so_far[j - 1] + 0.5 * (force[j - 1] + force[j]) * (s[j] - s[j - 1])
    pressure = np.empty(n)
    for j in range(n):
        full = force[j]
        if length > 0.0:
            low, high = max(s[j] - reach, 0.0), min(s[j] + reach, length)
            x = min(min(s[j], length - s[j]) / taper, 1.0)
            full = (_lookup(so_far, s, high) - _lookup(so_far, s, low)) / (high - low)
            full *= 1.0 - depth * (1.0 - x) ** 2
        full = FLOOR + (1.0 - FLOOR) * full
        pressure[j] = min(max(1.0 - strength * (1.0 - full), 0.0), 1.0)
    return pressure


@kernel
def _place(s: NDArray[np.float64], x: float) -> tuple[int, float]:
    """The interval j … j + 1 of the ascending s that holds x, and the part of it that lies before x."""
    after = int(np.searchsorted(s, x, side="right"))
    j = min(max(after - 1, 0), len(s) - 2)
    gap = s[j + 1] - s[j]
    return j, min(max((x - s[j]) / gap, 0.0), 1.0) if gap > 0.0 else 0.0


@kernel
def _lookup(values: NDArray[np.float64], s: NDArray[np.float64], x: float) -> float:
    j, part = _place(s, x)
    value: float = values[j] + part * (values[j + 1] - values[j])
    return value


@kernel
def _turn(path: NDArray[np.float64], s: NDArray[np.float64], middle: float, reach: float) -> float:
    """Angle in 0…π between the chords of path over the arc lengths `reach` before and after `middle`."""
    ax, ay = _lookup(path[:, 0], s, middle - reach), _lookup(path[:, 1], s, middle - reach)
    bx, by = _lookup(path[:, 0], s, middle), _lookup(path[:, 1], s, middle)
    cx, cy = _lookup(path[:, 0], s, middle + reach), _lookup(path[:, 1], s, middle + reach)
    ux, uy, vx, vy = bx - ax, by - ay, cx - bx, cy - by
    turn: float = np.arctan2(abs(ux * vy - uy * vx), ux * vx + uy * vy)
    return turn


@kernel
def _angles(path: NDArray[np.float64], s: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """Direction from the tip of the dragged brush to its handle at each point of the path, without jumps."""
    angle = np.zeros(len(path))
    begun = False
    for j in range(1, len(path)):
        angle[j] = angle[j - 1]
        step = s[j] - s[j - 1]
        if step == 0.0:
            continue
        heading = np.arctan2(path[j, 1] - path[j - 1, 1], path[j, 0] - path[j - 1, 0])
        if not begun:
            angle[: j + 1], begun = heading, True
            continue
        # A handle that moves straight turns its tip by tan(δ / 2) = tan(δ₀ / 2)·exp(−step / lag).
        behind = np.sin(angle[j] - heading), np.cos(angle[j] - heading)
        before = np.arctan2(behind[0], behind[1])
        after = 2.0 * np.arctan(np.tan(0.5 * before) * np.exp(-step / (LAG * width)))
        angle[j] += after - before
    return angle


@kernel
def _knots(pressure: NDArray[np.float64], angle: NDArray[np.float64], first: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which points stay, so that straight lines between them keep to the tolerances; ends of cubics always do.

    Ramer–Douglas–Peucker with the distance along the value's axis, as the parameter runs evenly.
    """
    kept = np.zeros(len(pressure), np.bool_)
    kept[first] = True
    stack = np.empty((len(pressure) + 1, 2), np.int64)
    for k in range(len(first) - 1):
        stack[0, 0], stack[0, 1] = first[k], first[k + 1]
        depth = 1
        while depth > 0:
            depth -= 1
            a, b = stack[depth, 0], stack[depth, 1]
            worst, split = 1.0, -1
            for j in range(a + 1, b):
                t = (j - a) / (b - a)
                e = max(
                    abs(pressure[j] - (1.0 - t) * pressure[a] - t * pressure[b]) / PRESSURE_TOLERANCE,
                    abs(angle[j] - (1.0 - t) * angle[a] - t * angle[b]) / ANGLE_TOLERANCE,
                )
                if e > worst:
                    worst, split = e, j
            if split < 0 and b - a > 1 and abs(angle[b] - angle[a]) > MAX_TURN:
                split = (a + b) // 2
            if split >= 0:
                kept[split] = True
                stack[depth, 0], stack[depth, 1] = a, split
                stack[depth + 1, 0], stack[depth + 1, 1] = split, b
                depth += 2
    return kept


@kernel
def _split(
    chain: NDArray[np.float64],
    first: NDArray[np.int64],
    kept: NDArray[np.bool_],
    out: NDArray[np.float64],
    at: int,
) -> None:
    """Write the chain to out[at:], each cubic cut at the kept points (de Casteljau)."""
    out[at, 0], out[at, 1] = chain[0, 0], chain[0, 1]
    for k in range(len(first) - 1):
        steps = first[k + 1] - first[k]
        a = 0
        for b in range(1, steps + 1):
            if not kept[first[k] + b]:
                continue
            t0, t1 = a / steps, b / steps
            for axis in range(2):
                p = chain[3 * k : 3 * k + 4, axis]
                out[at + 1, axis] = _blossom(p, t0, t0, t1)
                out[at + 2, axis] = _blossom(p, t0, t1, t1)
                out[at + 3, axis] = _blossom(p, t1, t1, t1)
            at += 3
            a = b


@kernel
def _blossom(p: NDArray[np.float64], u: float, v: float, w: float) -> float:
    """Polar form of a cubic: de Casteljau's algorithm with another parameter in each of its rounds."""
    q0, q1, q2 = (1.0 - u) * p[0] + u * p[1], (1.0 - u) * p[1] + u * p[2], (1.0 - u) * p[2] + u * p[3]
    r0, r1 = (1.0 - v) * q0 + v * q1, (1.0 - v) * q1 + v * q2
    value: float = (1.0 - w) * r0 + w * r1
    return value
