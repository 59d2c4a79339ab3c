"""Nearness of the main presets to sets of photos: python benchmarks/fidelity.py FOLDER… [--write]

Plans every photo of each folder (such as NPRgeneral and NPRportrait level 1, which are not ours to ship), has its
SVG painted by rsvg-convert, which is not ours, and compares that with the photo. Prints docs/fidelity.md, and with
--write puts it there.
"""

from __future__ import annotations

import io
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

import strokeplan
from strokeplan.formats.svg import encode
from strokeplan.image import photo_files
from strokeplan.planner import warm_up

PAGE = Path(__file__).parent.parent / "docs" / "fidelity.md"
PRESETS = ("fine", "paper", "paper-published")
PUBLISHED = {"NPRgeneral": ("17.4 dB", "0.498", "33.6"), "NPRportrait1": ("21.0 dB", "0.699", "16.9")}
"""The paper author's published pictures of these sets, measured in the same way against the photos."""


class Row(NamedTuple):
    """One photo with one preset."""

    psnr_db: float
    ssim: float
    rgb: float
    strokes: int
    cubics: int
    svg_kb: float
    cpu_s: float
    """Planning alone, on one thread."""


def measure(path: Path, preset: str) -> Row:
    photo = strokeplan.load_photo(path)
    began = time.process_time()
    plan = strokeplan.plan(photo, preset, threads=1)
    spent = time.process_time() - began
    svg = encode(plan)
    png = subprocess.run(["rsvg-convert"], input=svg, stdout=subprocess.PIPE, check=True).stdout
    picture = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
    distance = np.sqrt(((picture.astype(np.float64) - photo.rgb) ** 2).sum(axis=2)).mean()
    return Row(
        peak_signal_noise_ratio(photo.rgb, picture),
        structural_similarity(photo.rgb, picture, channel_axis=2),
        distance,
        len(plan),
        plan.cubics,
        len(svg) / 1e3,
        spent,
    )


def line(name: str, row: Row) -> str:
    return (
        f"| {name} | {row.psnr_db:.2f} dB | {row.ssim:.3f} | {row.rgb:.1f} | {row.strokes:,.0f} | {row.cubics:,.0f} "
        f"| {row.svg_kb:,.0f} kB | {row.cpu_s:.2f} s |"
    )


def main(folders: list[Path]) -> str:
    head = "| | PSNR | SSIM | RGB distance | strokes | cubics | SVG | planning, CPU |\n|" + " --- |" * 8
    parts = [
        "# Fidelity of the presets\n",
        "Made by `python benchmarks/fidelity.py FOLDER… --write`: every photo planned with seed 0, its SVG painted",
        "at its own size by librsvg and compared with the photo. PSNR and SSIM (over the channels) are scikit-",
        "image's, RGB distance is the mean Euclidean distance in 8-bit RGB. The published row is the paper",
        "author's own pictures, measured in the same way (19 portraits; here all 20). `paper-published` and the",
        "numbers in `fine` were set with these very sets in sight (docs/decisions.md): expect a little less on",
        "others. `paper` follows the text alone.\n",
    ]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn"), initializer=warm_up) as pool:
        for folder in folders:
            paths = photo_files([folder])
            rows = {preset: list(pool.map(measure, paths, [preset] * len(paths))) for preset in PRESETS}
            parts += [f"## {folder.name}: means over {len(paths)} photos\n", head]
            if folder.name in PUBLISHED:
                parts.append("| published pictures | " + " | ".join(PUBLISHED[folder.name]) + " | | | | |")
            parts += [line(f"`{preset}`", Row(*np.mean(rows[preset], axis=0))) for preset in PRESETS]
            for preset in PRESETS:
                parts += [f"\n### {folder.name}, `{preset}`\n", head]
                parts += [line(path.stem, row) for path, row in zip(paths, rows[preset], strict=True)]
            parts.append("")
    return "\n".join(parts)


if __name__ == "__main__":
    arguments = [Path(argument) for argument in sys.argv[1:] if argument != "--write"]
    if not arguments:
        sys.exit(__doc__)
    page = main(arguments)
    print(page)
    if "--write" in sys.argv:
        PAGE.write_text(page)
