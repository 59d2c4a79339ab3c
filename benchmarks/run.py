"""All speed and memory figures, in one run: python benchmarks/run.py [--write]

Prints the tables of docs/benchmarks.md, and with --write puts them there. Processes are timed whole, by
the operating system's own accounting; ratios are of medians taken in the same run.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from results import table
from timing import SAMPLES, STROKEPLAN, apart, median, repeated, run, tiled_photo

import strokeplan
from strokeplan.formats import json as strokes_json
from strokeplan.formats import svg
from strokeplan.strokes import Layer, StrokePlan

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "benchmarks.md"
RUNS = 5


def main() -> None:
    sections = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for section in (planning, resolutions, first_run, start_up, sizes, files):
            print(f"… {section.__name__}", file=sys.stderr)
            sections.append(section(folder))
    head = (
        "# Speed and memory\n\nMade by `make bench` "
        f"({platform.machine()}, {len(os.sched_getaffinity(0))} processors, Python {platform.python_version()}, "
        f"strokeplan {strokeplan.__version__}). Whole processes, median of {RUNS} warm runs unless it says otherwise; "
        "CPU counts all threads.\n"
    )
    page = "\n".join([head, *sections])
    print(page)
    if "--write" in sys.argv:
        PAGE.write_text(page)


def planning(folder: Path) -> str:
    photo, plan = str(tiled_photo(folder / "photo.jpg", 2000, 1300)), str(folder / "plan.json")
    command = (*STROKEPLAN, "plan", photo, "-p", "paper", "-o", plan, "-q")
    bound = (sys.executable, str(HERE / "lower_bound.py"), photo, plan)
    run(*command)
    run(*bound)
    ours, one, bounds = [], [], []
    for _ in range(RUNS):  # in turn, so that a drift of the machine meets all alike
        ours.append(run(*command))
        one.append(run(*command, "--threads", "1"))
        bounds.append(run(*bound))
    a, b, c = median(ours), median(one), median(bounds)
    strokes = len(strokeplan.load(plan))
    rows = [
        ("`strokeplan plan`, preset paper", f"{a.wall_s:.2f} s", f"{a.cpu_s:.2f} s", f"{a.peak_mb:.0f} MB"),
        ("the same with --threads 1", f"{b.wall_s:.2f} s", f"{b.cpu_s:.2f} s", f"{b.peak_mb:.0f} MB"),
        ("lower bound", f"{c.wall_s:.2f} s", f"{c.cpu_s:.2f} s", f"{c.peak_mb:.0f} MB"),
        ("ratio to the lower bound", f"{a.wall_s / c.wall_s:.2f}", f"{a.cpu_s / c.cpu_s:.2f}", ""),
    ]
    return (
        f"## A photo of 2000 × 1300 pixels to a strokes file\n\n{strokes:,} strokes. The lower bound "
        "(benchmarks/lower_bound.py) is the orientation fields by scipy once and Pycairo painting the finished plan "
        "once. The paper reports about 15 minutes for a photo of this size.\n\n"
        + table(("whole process", "wall", "CPU", "peak memory"), rows)
    )


def first_run(folder: Path) -> str:
    photo, plan = str(tiled_photo(folder / "small.jpg", 800, 600)), str(folder / "plan.json")
    command = (*STROKEPLAN, "plan", photo, "-o", plan, "-q")
    cold = [run(*command, environment={"NUMBA_CACHE_DIR": str(folder / f"cache{k}")}) for k in range(2)]
    warm = repeated(3, *command)
    first = median(cold)
    rows = [
        ("first run, compiling", f"{first.wall_s:.2f} s", f"{first.cpu_s:.2f} s"),
        ("warm run", f"{warm.wall_s:.2f} s", f"{warm.cpu_s:.2f} s"),
        ("difference", f"{first.wall_s - warm.wall_s:.2f} s", f"{first.cpu_s - warm.cpu_s:.2f} s"),
    ]
    return "## The first run on a machine (median of 2)\n\n" + table(("800 × 600 photo", "wall", "CPU"), rows)


def start_up(folder: Path) -> str:
    photo = str(tiled_photo(folder / "tiny.jpg", 16, 16))
    rows = [
        (name, f"{cost.wall_s:.2f} s", f"{cost.cpu_s:.2f} s")
        for name, cost in (
            ("`strokeplan --help`", repeated(RUNS, *STROKEPLAN, "--help")),
            ("a plan of 16 × 16 pixels: start-up and nothing else", repeated(
                RUNS, *STROKEPLAN, "plan", photo, "-p", "paper", "-o", str(folder / "tiny.json"), "-q")),
        )
    ]  # fmt: skip
    return "## Start-up\n\n" + table(("whole process", "wall", "CPU"), rows)


def sizes(folder: Path) -> str:
    rows: list[tuple[str, ...]] = []
    before: tuple[int, float] | None = None
    for width, height in ((1225, 816), (2450, 1633), (4899, 3266), (6000, 4000)):
        photo = str(apart(tiled_photo, folder / f"{width}.jpg", width, height))
        plan = str(folder / "plan.json")
        cost = median([run(*STROKEPLAN, "plan", photo, "-p", "paper", "-o", plan, "-q") for _ in range(3)])
        megapixels = width * height / 1e6
        grown = f"{(cost.peak_mb - before[1]) * 2**20 / (width * height - before[0]):.0f}" if before else ""
        before = (width * height, cost.peak_mb)
        rows.append((
            f"{megapixels:.1f}", f"{apart(strokes_in, plan):,}", f"{cost.wall_s:.2f} s", f"{cost.cpu_s:.2f} s",
            f"{cost.cpu_s / megapixels:.2f} s", f"{cost.peak_mb:.0f} MB", grown,
        ))  # fmt: skip
    header = ("megapixels", "strokes", "wall", "CPU", "CPU per megapixel", "peak memory", "bytes per further pixel")
    return (
        "## Time and memory are linear in pixels\n\nPreset paper, JSON (median of 3). The peak includes Python and "
        "its libraries, the plan and its file.\n\n" + table(header, rows)
    )


def strokes_in(plan: str) -> int:
    return len(strokeplan.load(plan))


def resolutions(folder: Path) -> str:
    rows: list[tuple[str, ...]] = []
    for width, height in ((640, 426), (1024, 1024), (2000, 1300), (4000, 2500), (11600, 8640)):
        photo, plan = str(apart(enlarged_photo, folder / f"{width}.jpg", width, height)), str(folder / "plan.svg")
        cost = median([run(*STROKEPLAN, "plan", photo, "-o", plan, "-q") for _ in range(3)])
        strokes = Path(plan).read_bytes().count(b"<path ")
        megapixels = width * height / 1e6
        rows.append((
            f"{megapixels:.1f}", f"{strokes:,}", f"{cost.wall_s:.2f} s", f"{cost.cpu_s:.2f} s",
            f"{cost.wall_s / megapixels:.2f} s", f"{cost.cpu_s / megapixels:.2f} s", f"{cost.peak_mb:.0f} MB",
        ))  # fmt: skip
    header = ("megapixels", "strokes", "wall", "CPU", "wall per megapixel", "CPU per megapixel", "peak memory")
    return (
        "## The default preset plans photos of any size alike\n\nPreset fine, samples/astronaut.jpg enlarged, to SVG "
        "(median of 3).\n\n" + table(header, rows)
    )


def enlarged_photo(path: Path, width: int, height: int) -> Path:
    """A sample at another size."""
    with Image.open(SAMPLES / "astronaut.jpg") as sample:
        sample.resize((width, height), Image.Resampling.BICUBIC).save(path, quality=90)
    return path


def files(folder: Path) -> str:
    plan = strokeplan.plan(tiled_photo(folder / "photo.jpg", 2000, 1300), "paper")
    chosen = np.arange(100_000) % len(plan)
    big = StrokePlan(
        width=plan.width, height=plan.height,
        points=np.concatenate([plan.stroke(i) for i in chosen]),
        starts=np.concatenate([[0], np.cumsum(plan.counts[chosen])]),
        widths=plan.widths[chosen], colors=plan.colors[chosen], layers=(Layer("1", 0, len(chosen)),),
        settings=plan.settings, source=plan.source,
    )  # fmt: skip
    data = strokes_json.encode(big)

    def cpu(work: Callable[[], object]) -> str:
        spent = []
        for _ in range(RUNS):
            began = time.process_time()
            work()
            spent.append(time.process_time() - began)
        return f"{sorted(spent)[RUNS // 2]:.2f} s"

    rows = [
        ("encode SVG", cpu(lambda: svg.encode(big)), f"{len(svg.encode(big)) / 1e6:.1f} MB"),
        ("encode JSON", cpu(lambda: strokes_json.encode(big)), f"{len(data) / 1e6:.1f} MB"),
        ("decode and validate JSON", cpu(lambda: strokes_json.decode(data)), ""),
    ]
    return f"## Files of 100,000 strokes ({big.cubics:,} cubics)\n\n" + table(("", "CPU", "size"), rows)


if __name__ == "__main__":
    if subprocess.run([*STROKEPLAN, "--version"], capture_output=True).returncode:
        sys.exit("install strokeplan first: make bench")
    main()
