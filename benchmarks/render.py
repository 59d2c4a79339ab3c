"""What painting costs: python benchmarks/render.py [--write]

100,000 round strokes against bare Pycairo calls, on one thread and on two; and a TIFF of 60,000 × 40,000 pixels with
a plain and with a textured brush, whose peak memory the operating system accounts for and of which tifffile reads a
part back. Prints docs/rendering.md, and with --write puts it there. Takes some minutes, and two gigabytes of disk.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cairo
import numpy as np
import tifffile
from numpy.typing import NDArray
from timing import SAMPLES, STROKEPLAN, Cost, run

from strokeplan.formats import load
from strokeplan.rendering import render
from strokeplan.strokes import Layer, StrokePlan

PAGE = Path(__file__).parent.parent / "docs" / "rendering.md"
STROKES, WIDTH, HEIGHT = 100_000, 2000, 1300
REPEATS = 3
TIFF_WIDTH, TIFF_HEIGHT = 60_000, 40_000
REGION_WIDTH, REGION_HEIGHT = 4.0, 2.0
"""Around the beginning of a stroke, in units of a canvas of 600 × 400."""


def random_strokes(n: int, width: float, height: float, widths: tuple[float, float], step: float) -> StrokePlan:
    """Strokes of one cubic anywhere on a canvas, wide ones first."""
    rng = np.random.default_rng(1)
    headings = rng.uniform(0, 2 * np.pi, (n, 1)) + np.cumsum(rng.normal(0, 0.3, (n, 3)), axis=1)
    steps = step * np.stack([np.cos(headings), np.sin(headings)], axis=2)
    first = rng.uniform(0, (width, height), (n, 1, 2))
    points = np.concatenate([first, first + np.cumsum(steps, axis=1)], axis=1).reshape(-1, 2)
    return StrokePlan(
        width=width, height=height, points=points,
        starts=4 * np.arange(n + 1), widths=np.geomspace(*widths, n),
        colors=rng.integers(0, 256, (n, 3), dtype=np.uint8), layers=(Layer("1", 0, n),),
    )  # fmt: skip


def bare(plan: StrokePlan) -> NDArray[np.uint8]:
    """What one writes with Pycairo alone: one surface, one path a stroke."""
    columns, rows = round(plan.width), round(plan.height)
    surface = cairo.ImageSurface(cairo.FORMAT_RGB24, columns, rows)
    context = cairo.Context(surface)
    context.set_source_rgb(1, 1, 1)
    context.paint()
    context.set_line_cap(cairo.LINE_CAP_ROUND)
    context.set_line_join(cairo.LINE_JOIN_ROUND)
    points, widths, colors = plan.points.reshape(-1, 8).tolist(), plan.widths.tolist(), (plan.colors / 255).tolist()
    for (x, y, *rest), width, color in zip(points, widths, colors, strict=True):
        context.set_source_rgb(*color)
        context.set_line_width(width)
        context.move_to(x, y)
        context.curve_to(*rest)
        context.stroke()
    surface.flush()
    pixels = np.ndarray((rows, columns, 4), np.uint8, surface.get_data())
    return np.ascontiguousarray(pixels[..., [2, 1, 0]])


def strokes_table() -> list[str]:
    plan = random_strokes(STROKES, WIDTH, HEIGHT, (30.0, 2.0), 12.0)
    ways: dict[str, Callable[[], NDArray[np.uint8]]] = {
        "bare Pycairo": lambda: bare(plan),
        "`render`, 1 thread": lambda: render(plan, threads=1),
        "`render`, 2 threads": lambda: render(plan, threads=2),
    }
    costs: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for _ in range(REPEATS):  # in turn, so that whatever else the machine does meets all
        for name, paint in ways.items():
            wall, cpu = time.perf_counter(), time.process_time()
            paint()
            costs[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    error = np.abs(render(plan).astype(int) - bare(plan))
    least = {name: tuple(map(min, zip(*times, strict=True))) for name, times in costs.items()}
    wall, cpu = least["bare Pycairo"]
    rows = [f"| {name} | {a:.2f} | {a / wall:.2f} | {b:.2f} | {b / cpu:.2f} |" for name, (a, b) in least.items()]
    print("\n".join(rows), file=sys.stderr)
    return [
        f"{STROKES:,} round strokes, 30 to 2 pixels wide and 36 long, on {WIDTH} × {HEIGHT}; least of {REPEATS} runs, "
        f"in turn. The pictures differ by {error.mean():.4f} of 255 on average (tiles: Cairo's clipping).",
        "",
        "| | wall, s | × bare | CPU, s | × bare |",
        "|---|---:|---:|---:|---:|",
        *rows,
    ]


def tiff_table() -> list[str]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        sparse = Path(folder) / "sparse.json"
        random_strokes(60, 600, 400, (8.0, 2.0), 15.0).save(sparse)
        for plan, brush in ((SAMPLES / "coffee.svgz", "round"), (sparse, "bristle")):
            path = Path(folder) / "out.tif"
            cost = run(*STROKEPLAN, "render", str(plan), "-o", str(path), "--width", str(TIFF_WIDTH), "--brush", brush)
            rows.append(tiff_row(plan, brush, path, cost))
            print(rows[-1], file=sys.stderr)
    return [
        f"`strokeplan render PLAN -o out.tif --width {TIFF_WIDTH}`, {TIFF_WIDTH:,} × {TIFF_HEIGHT:,} pixels (7.2 GB): "
        "the whole process, its peak memory by the system's account. Then tifffile reads the strips of a region back, "
        "which are compared, byte for byte, with what `--region` paints.",
        "",
        "| plan | strokes | brush | peak, MB | wall, s | CPU, s | file, MB | region |",
        "|---|---:|---|---:|---:|---:|---:|---|",
        *rows,
    ]


def tiff_row(plan: Path, brush: str, path: Path, cost: Cost) -> str:
    strokes = load(plan)
    x, y = np.clip(strokes.stroke(len(strokes) // 2)[0], (5, 5), (595, 395)).tolist()
    region = (x - 0.5 * REGION_WIDTH, y - 0.5 * REGION_HEIGHT, REGION_WIDTH, REGION_HEIGHT)
    wanted = render(strokes, scale=TIFF_WIDTH / strokes.width, region=region, brush=brush)
    left, top = (round(TIFF_WIDTH / strokes.width * value) for value in region[:2])
    tall, wide = wanted.shape[:2]
    found = read_back(path, left, top, wide, tall)
    same = "the same" if np.array_equal(wanted, found) else "DIFFERS"
    if len(np.unique(found)) < 3:
        raise SystemExit(f"{plan}: the region shows nothing")
    return (
        f"| {plan.name} | {len(strokes):,} | `{brush}` | {cost.peak_mb:.0f} | {cost.wall_s:.0f} | {cost.cpu_s:.0f} "
        f"| {path.stat().st_size / 1e6:.0f} | {same} |"
    )


def read_back(path: Path, left: int, top: int, wide: int, tall: int) -> NDArray[np.uint8]:
    """A part of a TIFF, by the strips that hold it."""
    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        if (page.imagewidth, page.imagelength) != (TIFF_WIDTH, TIFF_HEIGHT):
            raise SystemExit(f"{path} has {page.imagewidth} × {page.imagelength} pixels")
        strips = []
        for index in range(top // page.rowsperstrip, (top + tall - 1) // page.rowsperstrip + 1):
            file.filehandle.seek(page.dataoffsets[index])
            strip, _, _ = page.decode(file.filehandle.read(page.databytecounts[index]), index)
            strips.append(strip[0])
        first = top // page.rowsperstrip * page.rowsperstrip
        return np.concatenate(strips)[top - first : top - first + tall, left : left + wide]


def page() -> str:
    lines = [
        "# What painting costs", "", "Made by `python benchmarks/render.py --write`.", "",
        *strokes_table(), "", *tiff_table(), "",
    ]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    text = page()
    print(text)
    if "--write" in sys.argv[1:]:
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
