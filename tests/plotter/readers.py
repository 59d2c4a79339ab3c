"""Readers of machine files that share nothing with what writes them: each returns what is drawn, as polylines in mm."""

from __future__ import annotations

import re
import subprocess
from itertools import pairwise
from math import atan2, cos, hypot, pi, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Line = NDArray[np.float64]


def arc(
    a: tuple[float, float], b: tuple[float, float], centre: tuple[float, float], *, left: bool
) -> list[list[float]]:
    """Points on an arc from a to b, 1° apart, in the sense asked for; the two radii must agree as GRBL demands."""
    r0, r1 = hypot(a[0] - centre[0], a[1] - centre[1]), hypot(b[0] - centre[0], b[1] - centre[1])
    assert abs(r0 - r1) <= max(0.005, 0.001 * r0), "GRBL: error 33"
    begin, end = atan2(a[1] - centre[1], a[0] - centre[0]), atan2(b[1] - centre[1], b[0] - centre[0])
    turn = (end - begin) % (2 * pi) if left else -((begin - end) % (2 * pi))
    assert 0 < abs(turn) < 0.8 * pi, "no arc we make turns by more than 120°"
    parts = max(12, int(abs(turn) / (pi / 180)))
    steps = [(k / parts, begin + turn * k / parts) for k in range(1, parts + 1)]
    return [[centre[0] + (r0 + (r1 - r0) * t) * cos(u), centre[1] + (r0 + (r1 - r0) * t) * sin(u)] for t, u in steps]


def cubic(p: list[list[float]], parts: int = 40) -> Line:
    """Points on a cubic by Bernstein's polynomials, its first left out."""
    t = np.linspace(0, 1, parts + 1)[1:, None]
    a, b, c, d = np.asarray(p, float)
    points: Line = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
    return points


def read_gcode(data: bytes, *, pen: str = "M3") -> list[Line]:
    """Lines drawn while the pen is down ("M3" until "M5", or "Z0" at that height), parsed by gcodeparser."""
    from gcodeparser import parse_gcode_lines

    lines: list[list[list[float]]] = []
    x = y = 0.0
    down = False
    for command in parse_gcode_lines(data.decode("ascii"), include_comments=False):
        word, number = command.command
        p = command.params
        if (word, number) in (("M", 3), ("M", 5)):
            down = (word, number) == ("M", 3)
            lines += [[[x, y]]] if down else []
        if word != "G" or number not in (0, 1, 2, 3, 5):
            continue
        if pen == "Z" and "Z" in p:
            down = p["Z"] <= 0
            lines += [[[x, y]]] if down else []
            continue
        to = float(p.get("X", x)), float(p.get("Y", y))
        if down:
            assert number != 0, "a rapid with the pen down"
            if number == 1:
                lines[-1].append(list(to))
            elif number == 5:
                handles = [[x + p["I"], y + p["J"]], [to[0] + p["P"], to[1] + p["Q"]]]
                lines[-1] += cubic([[x, y], *handles, list(to)]).tolist()
            else:
                lines[-1] += arc((x, y), to, (x + p["I"], y + p["J"]), left=number == 3)
        else:
            assert number in (0, 1)
        x, y = to
    return [np.array(line) for line in lines]


def read_canonical(program: str, path: Path) -> list[Line]:
    """Lines as LinuxCNC's own interpreter (rs274) understands a file, spindle on meaning that the pen is down."""
    ran = subprocess.run([program, "-g", str(path)], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    lines: list[list[list[float]]] = []
    at, down = (0.0, 0.0), False
    for name, text in re.findall(r"(\w+)\((.*?)\)", ran.stdout):
        v = [float(value) for value in re.findall(r"-?\d+\.\d+|-?\d+", text)]
        if name == "START_SPINDLE_CLOCKWISE":
            down = True
            lines.append([list(at)])
        elif name == "STOP_SPINDLE_TURNING":
            down = False
        elif name in ("STRAIGHT_FEED", "STRAIGHT_TRAVERSE"):
            if down:
                lines[-1].append(v[:2])
            at = v[0], v[1]
        elif name == "ARC_FEED":
            assert down
            lines[-1] += arc(at, (v[0], v[1]), (v[2], v[3]), left=v[4] > 0)
            at = v[0], v[1]
    return [np.array(line) for line in lines]


def read_hpgl(data: bytes, unit_mm: float, room: int) -> list[Line]:
    """Lines of an HP-GL file; no command may be longer than `room` bytes."""
    lines: list[list[list[float]]] = []
    at = [0.0, 0.0]
    for command in data.decode("ascii").replace("\n", "").split(";"):
        assert len(command) < room
        numbers = [float(value) for value in command[2:].split(",") if value]
        points = (
            [list(pair) for pair in zip(numbers[::2], numbers[1::2], strict=True)]
            if command[:1] == "P" and command[:2] != "PS"
            else []
        )
        if command[:2] == "PD":
            if not lines or lines[-1][-1] != at:
                lines.append([at])
            lines[-1] += points
        at = points[-1] if points else at
    return [unit_mm * np.array(line) for line in lines]


def read_ebb(data: bytes, steps_mm: float) -> tuple[list[Line], list[float], list[float]]:
    """Lines of an EBB file, the corner where it ends, and how many steps a ms its motors make at most."""
    lines: list[list[list[float]]] = []
    x = y = 0
    down, rates = False, [0.0]
    for command in data.decode("ascii").split("\r"):
        name, *rest = command.split(",")
        if name == "SP":
            down = rest[0] == "0"
            lines += [[[x, y]]] if down else []
        elif name in ("XM", "SM"):
            ms, a, b = map(int, rest)
            x, y = x + a, y + b
            rates += [abs(a + b) / ms, abs(a - b) / ms] if name == "XM" else [abs(a) / ms, abs(b) / ms]
            if down:
                lines[-1].append([x, y])
        else:
            assert name in ("EM", "SC", "") or name.startswith("#")
    return [np.array(line) / steps_mm for line in lines], [x / steps_mm, y / steps_mm], rates


def distance(a: list[Line], b: list[Line]) -> float:
    """The largest distance of a point of one drawing from the other, both ways (Hausdorff), in mm."""
    return max(_one_way(a, b), _one_way(b, a))


def _one_way(a: list[Line], b: list[Line]) -> float:
    import shapely

    segments = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in map(dense, b)])
    tree = shapely.STRtree(shapely.linestrings(segments))
    points = shapely.points(np.concatenate([dense(line) for line in a]))
    _, apart = tree.query_nearest(points, return_distance=True, all_matches=False)
    return float(apart.max())


def dense(line: Line, step: float = 0.5) -> Line:
    """A polyline with points no further apart than `step`; a single point twice."""
    if len(line) < 2:
        return np.vstack([line, line])
    parts = [np.linspace(p, q, max(2, int(np.hypot(*(q - p)) / step) + 1)) for p, q in pairwise(line)]
    return np.concatenate(parts)
