"""Times of `strokeplan.plotter.motion` against those of GRBL 1.1: python benchmarks/motion.py --grbl PROGRAM [-o FILE]

PROGRAM is GRBL's own planner and step generator (planner.c, the segment generator of stepper.c, mc_arc) compiled for
this machine, with a main() that feeds it a file and adds up the ticks of the step timer. It reads G-code from its
standard input, takes

    PROGRAM steps/mm mm/min mm/s²(x) mm/s²(y) junction-deviation arc-tolerance

and prints the seconds that the job takes. docs/motion.md says what it must do.

The drawings: long lines, zigzags, many short segments, circles of lines and of arcs, walks, hatches, and with --plan a
strokes file on A4. The figures in tests/plotter/grbl_times.json are what this writes without --plan.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import strokeplan
from strokeplan.biarcs import ArcChains, biarcs_all, chords
from strokeplan.curves import flatten_all
from strokeplan.page import Page
from strokeplan.plotter.motion import Limits, Motion, Pen, plan
from strokeplan.plotter.order import order

STEPS_MM, RATE, ARC_TOLERANCE_MM = 80, 6000, 0.002
PEN = Pen(0.15, 0.1)
SETTINGS = ((500, 500, 0.01, 3000), (2000, 2000, 0.05, 6000), (200, 200, 0.002, 1500), (800, 300, 0.02, 4000))
"""mm/s² for x and y, mm, mm/min."""
DECIMALS = 3


class Drawing(NamedTuple):
    """Chains of arcs; lines are arcs without a bulge."""

    name: str
    arcs: ArcChains


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grbl", required=True, help="the program, see above")
    parser.add_argument("--plan", type=Path, nargs="*", default=[], help="strokes files to draw as well")
    parser.add_argument("-o", type=Path, help="where the seconds go as JSON")
    arguments = parser.parse_args()
    times = {}
    for drawing in [*drawings(), *(strokes(path) for path in arguments.plan)]:
        for setting in SETTINGS:
            theirs, ours = grbl_s(arguments.grbl, drawing, setting), motion(drawing, setting).total_s
            times[f"{drawing.name} {setting}"] = round(theirs, 3)
            print(f"| {drawing.name} | {setting} | {theirs:.2f} | {ours:.2f} | {100 * (ours / theirs - 1):+.2f} % |")
    if arguments.o:
        arguments.o.write_text(json.dumps(times, indent=1) + "\n")


def drawings() -> Iterator[Drawing]:
    rng = np.random.default_rng(1)
    yield lines("long lines", [rng.uniform(0, 200, (2, 2)) for _ in range(40)])
    zigzag = np.stack([np.arange(40) * 4.0, np.arange(40) % 2 * 3.0], axis=1)
    yield lines("zigzags", [zigzag + np.array([0, 6 * k]) for k in range(20)])
    hatch = np.stack([np.repeat(np.arange(60) * 0.4, 2), np.tile([0, 30, 30, 0], 30)], axis=1)
    yield lines("hatches", [hatch, hatch[:, ::-1] + 50])
    t = np.linspace(0, 1, 4000)
    yield lines("segments of 0.05 mm", [np.stack([200 * t, 50 + 10 * np.sin(40 * t)], axis=1)])
    angle = np.linspace(0, 2 * np.pi, 120)
    circle = 100 + np.stack([np.cos(angle), np.sin(angle)], axis=1)
    yield lines("circles of 119 lines", [100 + r * (circle - 100) for r in (1, 2, 5, 10, 20, 40)])
    yield lines("rough walks", [100 + np.cumsum(rng.normal(0, 0.3, (200, 2)), axis=0) for _ in range(40)])
    k = 4 / 3 * np.tan(np.pi / 8)
    quarter = np.array([[1, 0], [1, k], [k, 1], [0, 1.0]])
    wave = np.cumsum(rng.normal(0, 3, (40, 10, 2)), axis=1)
    wave[:, [4, 7]] = (wave[:, [3, 6]] + wave[:, [5, 8]]) / 2
    curves = [*(100 + r * quarter for r in (1, 3, 10, 40)), *(100 + wave)]
    starts = np.concatenate([[0], np.cumsum([len(curve) for curve in curves])])
    yield Drawing("arcs of curves", biarcs_all(np.concatenate(curves), starts, 0.05))


def lines(name: str, polylines: list[NDArray[np.float64]]) -> Drawing:
    points = np.concatenate(polylines)
    starts = np.concatenate([[0], np.cumsum([len(line) for line in polylines])])
    return Drawing(name, ArcChains(points, np.zeros(len(points)), starts))


def strokes(path: Path) -> Drawing:
    """A plan, laid on A4, flattened and put in order."""
    made = strokeplan.load(path)
    place = Page(210, 297, 10).fit(made.width, made.height)
    points, starts = flatten_all(place.points(made.points), made.starts, 0.05)
    tour = order(np.stack([points[starts[:-1]], points[starts[1:] - 1]], axis=1), tolerance=0.1, lift=25)
    chains = [points[starts[i] : starts[i + 1]] for i in tour.index]
    return lines(path.name, [line[::-1] if back else line for line, back in zip(chains, tour.reversed, strict=True)])


def motion(drawing: Drawing, setting: tuple[int, int, float, int]) -> Motion:
    x, y, deviation, feed = setting
    arcs = drawing.arcs
    rounded = ArcChains(np.round(arcs.points, DECIMALS), arcs.bulges, arcs.starts)
    limits = Limits((RATE, RATE), (x, y), deviation, steps_mm=STEPS_MM)
    return plan(*chords(rounded, ARC_TOLERANCE_MM), limits, feed, pen=PEN)


def grbl_s(program: str, drawing: Drawing, setting: tuple[int, int, float, int]) -> float:
    x, y, deviation, feed = setting
    command = [program, *map(str, (STEPS_MM, RATE, x, y, deviation, ARC_TOLERANCE_MM))]
    done = subprocess.run(command, input=gcode(drawing.arcs, feed), capture_output=True, text=True, check=True)
    return float(done.stdout.split()[0])


def gcode(arcs: ArcChains, feed: int) -> str:
    """Lines and arcs, the pen put down by M3 and up by M5, each with its dwell."""
    out = []
    for i in range(len(arcs)):
        chain = arcs.chain(i)
        points, centres = np.round(chain.points, DECIMALS), chain.centres
        out += [f"G0X{points[0, 0]:.3f}Y{points[0, 1]:.3f}", "M3S90", f"G4P{PEN.down_s}", f"G1F{feed}"]
        for k, (x, y) in enumerate(points[1:]):
            if chain.bulges[k]:
                a, b = centres[k] - points[k]
                out.append(f"G{3 if chain.bulges[k] > 0 else 2}X{x:.3f}Y{y:.3f}I{a:.3f}J{b:.3f}")
            else:
                out.append(f"G1X{x:.3f}Y{y:.3f}")
        out += ["M5", f"G4P{PEN.up_s}"]
    return "\n".join([*out, ""])


if __name__ == "__main__":
    main()
