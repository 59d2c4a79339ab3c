"""Order of strokes side by side: python benchmarks/order.py --vpype PYTHON --saxi FOLDER [-o docs/plotting-order.json]

PYTHON is the interpreter of an environment with vpype (pip install vpype), FOLDER one with saxi's optimizer (npm
install optimize-paths@1.2.2). Every program gets the same polylines from the same file and hands back what it would
draw; lifts and pen-up travel are counted here, from its polylines. Seconds are CPU, in the program's own process,
of ordering and merging alone, without reading, writing, starting and compiling.

The drawings: strokes of eight points at random, evenly spread (three seeds) and in clusters, and samples planned with
`fine` and `sketch`, laid on A4.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import strokeplan
from strokeplan.curves import flatten_all
from strokeplan.page import Page
from strokeplan.plotter.motion import Limits, Pen, plan
from strokeplan.plotter.order import merge, order

ROOT = Path(__file__).parent.parent
TOLERANCE_MM = 0.5
"""Gaps that are crossed with the pen down: saxi's default, ten times vpype's."""
LIFT_MM = 25.0
"""What a lift costs in travel: a quarter of a second at 100 mm/s."""
FLATNESS_MM = 0.05
PAGE = Page(210, 297, 10)
LIMITS = Limits((6000, 6000), (1000, 1000), 0.01)
FEED_MM_MIN = 3000
PEN = Pen(0.15, 0.1)

VPYPE = """
import json, sys, time, numpy, vpype, vpype_cli
lines = [numpy.array(line) @ (1, 1j) for line in json.load(open(sys.argv[1]))]
document = vpype.Document(vpype.LineCollection(lines), page_size=(297, 210))
began = time.process_time()
document = vpype_cli.execute(f"linemerge -t {sys.argv[3]} " + sys.argv[4], document)
seconds = time.process_time() - began
lines = [[[p.real, p.imag] for p in line] for line in document.layers[1]]
json.dump({"seconds": seconds, "lines": lines}, open(sys.argv[2], "w"))
"""
SAXI = """
const fs = require("fs"), optimizer = require("optimize-paths");
const [source, target, tolerance] = process.argv.slice(1);
const paths = JSON.parse(fs.readFileSync(source)).map(line => line.map(([x, y]) => ({x, y})));
const began = process.cpuUsage();
const done = optimizer.merge(optimizer.reorder(paths), Number(tolerance));
const used = process.cpuUsage(began);
const lines = done.map(line => line.map(({x, y}) => [x, y]));
fs.writeFileSync(target, JSON.stringify({seconds: (used.user + used.system) / 1e6, lines}));
"""


class Drawing(NamedTuple):
    """Polylines: points (p, 2) mm, and where each begins (n + 1,)."""

    points: NDArray[np.float64]
    starts: NDArray[np.int64]

    @property
    def lines(self) -> list[NDArray[np.float64]]:
        return np.split(self.points, self.starts[1:-1])

    @property
    def ends(self) -> NDArray[np.float64]:
        return np.stack([self.points[self.starts[:-1]], self.points[self.starts[1:] - 1]], axis=1)


class Row(NamedTuple):
    """What a program made of a drawing."""

    drawing: str
    program: str
    lifts: int
    pen_up_m: float
    hours: float
    cpu_s: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vpype", required=True, help="Python of an environment with vpype")
    parser.add_argument("--saxi", required=True, help="folder whose node_modules has optimize-paths")
    parser.add_argument("--strokes", type=int, default=100_000, help="strokes of the random drawings")
    parser.add_argument("-o", type=Path, help="where the figures go as JSON")
    arguments = parser.parse_args()
    order(np.zeros((10, 2, 2)))  # compiles
    rows = []
    for name, drawing in drawings(arguments.strokes):
        rows += compare(name, drawing, arguments.vpype, arguments.saxi)
    if arguments.o:
        arguments.o.write_text(json.dumps([row._asdict() for row in rows], indent=1) + "\n")


def drawings(n: int) -> Iterator[tuple[str, Drawing]]:
    for photo in ("coffee", "astronaut"):
        for preset in ("fine", "sketch"):
            yield f"samples/{photo}.jpg, `{preset}`", planned(ROOT / "samples" / f"{photo}.jpg", preset)
    for seed in range(3):
        yield f"random, seed {seed}", scattered(n, seed, clusters=0)
    yield "200 clusters", scattered(n, 0, clusters=200)


def planned(photo: Path, preset: str) -> Drawing:
    strokes = strokeplan.plan(photo, preset=preset)
    place = PAGE.fit(strokes.width, strokes.height)
    return Drawing(*flatten_all(place.points(strokes.points), strokes.starts, FLATNESS_MM))


def scattered(n: int, seed: int, clusters: int) -> Drawing:
    """Strokes of eight points: walks of half a millimetre a step on A4."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(10, 200, (n, 2))
    if clusters:
        middle = rng.uniform(30, 180, (clusters, 2))[rng.integers(clusters, size=n)] + rng.normal(0, 3, (n, 2))
    points = middle[:, None] + np.cumsum(rng.normal(0, 0.5, (n, 8, 2)), axis=1)
    return Drawing(points.reshape(-1, 2), np.arange(n + 1) * 8)


def compare(name: str, drawing: Drawing, vpype: str, saxi: str) -> list[Row]:
    rows = [measure(name, "as planned", drawing, 0.0), measure(name, "strokeplan", *_ours(drawing))]
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "in.json"), Path(folder, "out.json")
        source.write_text(json.dumps([line.tolist() for line in drawing.lines]))
        files = [str(source), str(target), str(TOLERANCE_MM)]
        rows.append(_theirs(name, "vpype linemerge linesort", [vpype, "-c", VPYPE, *files, "linesort"], target))
        rows.append(_theirs(name, "saxi", ["node", "-e", SAXI, *files], target, cwd=saxi))
    return rows


def _ours(drawing: Drawing) -> tuple[Drawing, float]:
    began = time.process_time()
    tour = order(drawing.ends, tolerance=TOLERANCE_MM, lift=LIFT_MM)
    chains = merge(drawing.ends, tour, tolerance=TOLERANCE_MM)
    seconds = time.process_time() - began
    lines = drawing.lines
    way = [lines[i][::-1] if back else lines[i] for i, back in zip(tour.index, tour.reversed, strict=True)]
    return joined([np.concatenate(way[a:b]) for a, b in pairwise(chains)]), seconds


def _theirs(name: str, program: str, command: list[str], target: Path, cwd: str | None = None) -> Row:
    subprocess.run(command, check=True, cwd=cwd)
    made = json.loads(target.read_text())
    return measure(name, program, joined([np.array(line) for line in made["lines"]]), made["seconds"])


def joined(lines: list[NDArray[np.float64]]) -> Drawing:
    return Drawing(np.concatenate(lines), np.concatenate([[0], np.cumsum([len(line) for line in lines])]))


def measure(name: str, program: str, drawing: Drawing, cpu_s: float) -> Row:
    """Lifts, and travel between the polylines; the way to the first is left out, as not all know where the pen is."""
    first, last = drawing.points[drawing.starts[1:-1]], drawing.points[drawing.starts[1:-1] - 1]
    far = float(np.hypot(*(first - last).T).sum()) / 1000
    hours = plan(drawing.points, drawing.starts, LIMITS, FEED_MM_MIN, pen=PEN).total_s / 3600
    row = Row(name, program, len(drawing.starts) - 1, round(far, 3), round(hours, 3), round(cpu_s, 2))
    print(
        f"| {name} | {program} | {row.lifts:,} | {row.pen_up_m:.2f} | {row.hours:.2f} | {row.cpu_s:.2f} |", flush=True
    )
    return row


if __name__ == "__main__":
    main()
