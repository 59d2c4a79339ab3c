"""Likeness for a budget of strokes, beside peers: python benchmarks/budget.py [FOLDER…]

Every photo of each folder (of samples/ if none is given) with at most N strokes, for every N of BUDGETS, beside
vtracer, a mosaic of N mean-colour squares and, on the photos where they are known, published figures of
fogleman/primitive. Vector pictures, ours too, are rasterised by resvg, and nobody's by the tool that made it. Writes
docs/budget.md and its chart. Can be stopped at any time: the same command goes on (benchmarks/results.py).
Needs the extra `peers`.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import resvg_py
from numpy.typing import NDArray
from PIL import Image
from results import ROOT, SAMPLES, Job, Result, measured, run, save_chart, table
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

import strokeplan
from strokeplan.formats.svg import encode
from strokeplan.image import Photo, photo_files
from strokeplan.planner import warm_up

STYLE = "fine"
BUDGETS = (100, 1_000, 2_000, 10_000, 50_000)
COMPACT = {"color_precision": 8, "path_precision": 2}
"""All bits of a colour, and coordinates to 1/100 of a pixel as ours: nearer and smaller than vtracer's default."""
VTRACER: dict[str, dict[str, Any]] = {
    "default": {},
    "photo": {"filter_speckle": 10, "color_precision": 8, "layer_difference": 48, "corner_threshold": 180},
    **{f"speckle {size}": {**COMPACT, "filter_speckle": size} for size in (64, 32, 16, 8, 4, 2)},
    "speckle 1, layers of 4": {**COMPACT, "filter_speckle": 1, "layer_difference": 4},
    "speckle 0, layers of 0": {**COMPACT, "filter_speckle": 0, "layer_difference": 0},
}
"""Its default, its preset for photos, and settings from a poster to nearly the photo; the rest is its default."""


class Known(NamedTuple):
    """A published figure; sizes that were not published are None."""

    shapes: str
    elements: int
    svg_bytes: int | None
    psnr_db: float
    ssim: float
    cpu_s: float


PRIMITIVE = {
    "cat1024": (
        Known("triangles", 100, None, 17.6, 0.289, 12),
        Known("rotated ellipses", 1_000, 170_000, 19.5, 0.360, 373),
        Known("Bézier strokes", 1_000, None, 16.3, 0.148, 177),
    ),
    "tomato1024": (
        Known("triangles", 100, 8_000, 20.3, 0.568, 13),
        Known("triangles", 1_000, 80_000, 23.0, 0.656, 76),
        Known("Bézier strokes", 1_000, 160_000, 17.7, 0.183, 168),
    ),
}
"""fogleman/primitive on two photos of NPRgeneral, compared in the same way."""

PAGE = ROOT / "docs" / "budget.md"
CHART = ROOT / "docs" / "budget" / "budget.svg"


class Picture(NamedTuple):
    """What a tool made of a photo: pixels (h, w, 3), elements, bytes of its SVG."""

    pixels: NDArray[np.uint8]
    elements: int
    svg_bytes: int


def strokes(photo: Photo, path: Path, asked: dict[str, Any]) -> Callable[[], Picture]:
    plan = strokeplan.plan(photo, asked["style"], strokes=asked["budget"], threads=1)
    svg = encode(plan)
    return lambda: Picture(rasterise(svg.decode(), photo), len(plan), len(svg))


def traced(photo: Photo, path: Path, asked: dict[str, Any]) -> Callable[[], Picture]:
    import vtracer

    svg = vtracer.convert_raw_image_to_svg(path.read_bytes(), img_format=path.suffix[1:], **asked["settings"])
    return lambda: Picture(rasterise(svg, photo), svg.count("<path"), len(svg.encode()))


def mosaic(photo: Photo, path: Path, asked: dict[str, Any]) -> Callable[[], Picture]:
    """At most N squares, as nearly as whole pixels allow, each of the mean colour under it."""
    side = (photo.width * photo.height / asked["budget"]) ** 0.5
    columns = min(max(int(photo.width / side), 1), photo.width)
    rows = min(max(asked["budget"] // columns, 1), photo.height)
    x, y = (np.arange(n + 1) * size // n for n, size in ((columns, photo.width), (rows, photo.height)))
    sums = np.add.reduceat(np.add.reduceat(photo.rgb.astype(float), y[:-1], axis=0), x[:-1], axis=1)
    colours = np.rint(sums / np.multiply.outer(np.diff(y), np.diff(x))[..., None]).astype(np.uint8)
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {photo.width} {photo.height}">' + "".join(
        f'<rect x="{x[j]}" y="{y[i]}" width="{x[j + 1] - x[j]}" height="{y[i + 1] - y[i]}" '
        f'fill="#{colours[i, j].tobytes().hex()}"/>'
        for i in range(rows)
        for j in range(columns)
    )
    pixels = colours.repeat(np.diff(y), axis=0).repeat(np.diff(x), axis=1)
    return lambda: Picture(pixels, rows * columns, len(svg) + len("</svg>"))


def rasterise(svg: str, photo: Photo) -> NDArray[np.uint8]:
    """An SVG of the photo's size in pixels, by resvg, on white."""
    png = resvg_py.svg_to_bytes(svg_string=svg, background="#ffffff", skip_system_fonts=True)
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    if pixels.shape != photo.rgb.shape:
        raise ValueError(f"{photo.name}: rasterised to {pixels.shape}, the photo is {photo.rgb.shape}")
    return pixels


TOOLS = {"strokeplan": strokes, "vtracer": traced, "mosaic": mosaic}


def measure(path: Path, asked: dict[str, Any]) -> Result:
    """One photo by one tool; CPU seconds are those from the photo in memory (vtracer: from its file) to the SVG."""
    warm_up()  # loading the kernels is not planning
    photo = strokeplan.load_photo(path)
    began = time.process_time()
    finish = TOOLS[asked["tool"]](photo, path, asked)
    spent = time.process_time() - began
    picture = finish()
    return {
        "elements": picture.elements,
        "svg_bytes": picture.svg_bytes,
        "psnr_db": float(peak_signal_noise_ratio(photo.rgb, picture.pixels)),
        "ssim": float(structural_similarity(photo.rgb, picture.pixels, channel_axis=2)),
        "cpu_s": spent,
    }


def jobs(paths: Sequence[Path]) -> list[Job]:
    """Every photo with every tool and budget, or settings."""
    asked: list[dict[str, Any]] = [{"tool": "strokeplan", "style": STYLE, "budget": n} for n in BUDGETS]
    asked += [{"tool": "mosaic", "budget": n} for n in BUDGETS]
    asked += [
        {"tool": "vtracer", "name": name, "settings": settings, "version": version("vtracer")}
        for name, settings in VTRACER.items()
    ]
    return [(path, one) for path in paths for one in asked]


def main() -> None:
    paths = photo_files([Path(argument) for argument in sys.argv[1:]] or [SAMPLES])
    warm_up()
    wanted = jobs(paths)
    by_photo: dict[Path, list[tuple[dict[str, Any], Result]]] = {path: [] for path in paths}
    for (path, asked), result in zip(wanted, measured(measure, wanted), strict=True):
        by_photo[path].append((asked, result))
    chart(by_photo)
    PAGE.write_text(page(by_photo))
    print(f"wrote {PAGE.relative_to(ROOT)}", file=sys.stderr)


def page(by_photo: dict[Path, list[tuple[dict[str, Any], Result]]]) -> str:
    parts = [
        "# Likeness for a budget of strokes\n\nMade by `python benchmarks/budget.py FOLDER…`, means over "
        f"{len(by_photo)} photos. Style `{STYLE}` with at most N strokes; vtracer {version('vtracer')} by default, for "
        "photos, and from coarse to fine; a mosaic of N squares of their mean colour, one `<rect>` each. An element is "
        "a stroke, a square, or a path of vtracer, which may have thousands of points: bytes compare what they take. "
        "Vector pictures are rasterised by resvg at the photo's size. CPU seconds are of one thread, from the photo to "
        "the SVG.\n\n![PSNR against elements and against bytes](budget/budget.svg)\n",
        table(HEADER, [mean_row(name, results) for name, results in by_tool(by_photo).items()]),
        "## At equal budgets\n\nPSNR of ours less the peer's where it has as many elements, or as many bytes, as ours "
        "(interpolated between its settings, linear in the logarithm), and how many times our elements and bytes it "
        "takes for the PSNR of ours. Mean over the photos (geometric for factors) on which the peer gets there: their "
        "number in brackets; – where on none.\n",
        table(EQUAL_HEADER, equal_rows(by_photo)),
    ]
    parts += [
        f"## {path.stem}, beside fogleman/primitive\n\nIts published figures; – where a size is not known.\n\n"
        + table(HEADER, [known_row(known) for known in PRIMITIVE[path.stem]] + photo_rows(by_photo[path]))
        for path in by_photo
        if path.stem in PRIMITIVE
    ]
    return "\n".join(parts)


HEADER = ("", "elements", "SVG bytes", "PSNR", "SSIM", "CPU", "PSNR per 1,000 elements", "PSNR per 100 kB")
EQUAL_HEADER = (
    "strokeplan",
    "peer",
    "PSNR at equal elements",
    "PSNR at equal bytes",
    "elements for ours",
    "bytes for ours",
)


def label(asked: dict[str, Any]) -> str:
    return f"vtracer, {asked['name']}" if asked["tool"] == "vtracer" else f"{asked['tool']}, N = {asked['budget']:,}"


def by_tool(by_photo: dict[Path, list[tuple[dict[str, Any], Result]]]) -> dict[str, list[Result]]:
    grouped: dict[str, list[Result]] = {}
    for measurements in by_photo.values():
        for asked, result in measurements:
            grouped.setdefault(label(asked), []).append(result)
    return grouped


def mean_row(name: str, results: Sequence[Result]) -> list[str]:
    return result_row(name, **{key: float(np.mean([result[key] for result in results])) for key in results[0]})


def photo_rows(measurements: Sequence[tuple[dict[str, Any], Result]]) -> list[list[str]]:
    return [result_row(label(asked), **result) for asked, result in measurements]


def known_row(known: Known) -> list[str]:
    _, *figures = known
    return result_row(f"primitive, {known.shapes}", *figures)


def result_row(
    name: str, elements: float, svg_bytes: float | None, psnr_db: float, ssim: float, cpu_s: float
) -> list[str]:
    size, per_size = ("–", "–") if svg_bytes is None else (f"{svg_bytes:,.0f}", f"{psnr_db / svg_bytes * 1e5:.2f} dB")
    return [
        name, f"{elements:,.0f}", size, f"{psnr_db:.2f} dB", f"{ssim:.3f}", f"{cpu_s:.2f} s",
        f"{psnr_db / elements * 1000:.2f} dB", per_size,
    ]  # fmt: skip


def equal_rows(by_photo: dict[Path, list[tuple[dict[str, Any], Result]]]) -> list[list[str]]:
    """Ours at every budget against every peer, photo by photo."""
    rows = []
    for budget in BUDGETS:
        for peer in ("vtracer", "mosaic"):
            pairs = []
            for measurements in by_photo.values():
                ours = next(r for a, r in measurements if a["tool"] == "strokeplan" and a["budget"] == budget)
                pairs.append((ours, [r for a, r in measurements if a["tool"] == peer]))
            cells = []
            for size in ("elements", "svg_bytes"):
                gains = [ours["psnr_db"] - psnr_at(theirs, size, ours[size]) for ours, theirs in pairs]
                cells.append(averaged(gains, "{:+.2f} dB"))
            for size in ("elements", "svg_bytes"):
                factors = [np.log(size_at(theirs, size, ours["psnr_db"]) / ours[size]) for ours, theirs in pairs]
                cells.append(averaged(factors, "× {:.2f}", np.exp))
            rows.append([f"N = {budget:,}", peer, *cells])
    return rows


def psnr_at(results: Sequence[Result], size: str, value: float) -> float:
    """PSNR of a tool at a size, between its measured ones; NaN outside them."""
    sizes, psnr = front(results, size)
    return float(np.interp(np.log(value), np.log(sizes), psnr, left=np.nan, right=np.nan))


def size_at(results: Sequence[Result], size: str, psnr_db: float) -> float:
    """The size at which a tool has a PSNR; NaN outside those it was measured at."""
    sizes, psnr = front(results, size)
    return float(np.exp(np.interp(psnr_db, psnr, np.log(sizes), left=np.nan, right=np.nan)))


def front(results: Sequence[Result], size: str) -> tuple[list[float], list[float]]:
    """Sizes and PSNR of a tool's results, both rising: without those that a smaller one surpasses."""
    sizes: list[float] = []
    psnr: list[float] = []
    for result in sorted(results, key=lambda result: (result[size], -result["psnr_db"])):
        if not psnr or result["psnr_db"] > psnr[-1]:
            sizes.append(result[size])
            psnr.append(result["psnr_db"])
    return sizes, psnr


def averaged(values: Sequence[float], form: str, back: Callable[[float], float] = float) -> str:
    known = [value for value in values if not np.isnan(value)]
    return f"{form.format(back(np.mean(known)))} ({len(known)})" if known else "–"


def chart(by_photo: dict[Path, list[tuple[dict[str, Any], Result]]]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4))
    panels = figure.subplots(1, 2, sharey=True)
    grouped = by_tool(by_photo)
    for panel, size, title in zip(panels, ("elements", "svg_bytes"), ("elements", "SVG bytes"), strict=True):
        for tool in TOOLS:
            chosen = [results for name, results in grouped.items() if name.startswith(tool)]
            x, y = (np.array([[r[key] for r in results] for results in chosen]) for key in (size, "psnr_db"))
            # Sizes are averaged as they are drawn: by their logarithms. Points, because settings are no sequence.
            panel.plot(np.exp(np.log(x).mean(axis=1)), y.mean(axis=1), "o", ms=4, label=tool)
        panel.set_xscale("log")
        panel.set_xlabel(title)
        panel.grid(visible=True, lw=0.4)
    panels[0].set_ylabel("PSNR, dB")
    panels[0].legend()
    figure.tight_layout()
    save_chart(figure, CHART)


if __name__ == "__main__":
    run(main)
