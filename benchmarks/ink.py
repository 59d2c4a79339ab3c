"""How true the tone of pen drawings is, beside other programs' at the same length of line.

    python benchmarks/ink.py PHOTOS… [--preset NAME] [--peers FOLDER]

A drawing is painted by Pycairo at 300 dots an inch and compared with its photo as an eye sees both: blurred in linear
light, the photo cut to what the pen reaches (coverage 0.92). σ is given as an angle at 40 cm: σ_mm = 400 · tan(angle).
At 1′ every line of a 0.3 mm pen is seen for itself and no drawing has tone; 5.3′ (0.62 mm, two widths of the pen) is
where lines merge: half of the contrast of 2.1 cycles a degree is left. The first figure of a table is measured there.
`--peers` is a folder of NAME.PROGRAM.svg of the photos NAME, drawn by other programs on the same sheet (A4, a margin of
15 mm): each is compared with a drawing of ours that has as much line.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from math import radians, tan
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

import strokeplan
from strokeplan.image import Photo, photo_files
from strokeplan.ink_budget import length_mm
from strokeplan.rendering import paint
from strokeplan.separation import lightness, luminance
from strokeplan.sheet import PAGE, turned

DOTS_A_MM = 300 / 25.4
VIEWED_MM = 400.0
ARC_MINUTES = (5.3, 3.0, 1.0)
REACH = 0.92
PEN_MM = 0.3
BANDS = ((0, 50), (50, 70), (70, 101))


def sigma_mm(minutes: float) -> float:
    return VIEWED_MM * tan(radians(minutes / 60))


def pictures(plan: strokeplan.StrokePlan, photo: Photo) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Linear light of the drawing and of the photo, where the photo lies on the sheet."""
    page = strokeplan.Page(plan.width, plan.height, PAGE.margin_mm)
    place = page.fit(photo.width, photo.height)
    # Black on white: what is left of a pixel's 255 is the part of it that no ink covers, and that is its light.
    drawn = paint(plan, round(plan.width * DOTS_A_MM), round(plan.height * DOTS_A_MM))[..., 1] / np.float32(255)
    left, top = round(place.x * DOTS_A_MM), round(place.y * DOTS_A_MM)
    columns, rows = round(photo.width * place.scale * DOTS_A_MM), round(photo.height * place.scale * DOTS_A_MM)
    shown = Image.fromarray(photo.rgb).resize((columns, rows), Image.Resampling.BICUBIC)
    wanted = np.maximum(luminance(np.asarray(shown)), np.float32(1 - REACH))
    return drawn[top : top + rows, left : left + columns], wanted


def figures(plan: strokeplan.StrokePlan, photo: Photo) -> dict[str, float]:
    """Mean |ΔL*| at each σ; at the first also the bias, that in bands of the photo's tone, and SSIM."""
    from skimage.metrics import structural_similarity

    drawn, wanted = pictures(plan, photo)
    found: dict[str, float] = {}
    for minutes in ARC_MINUTES:
        ours, theirs = (
            lightness(gaussian_filter(light, sigma_mm(minutes) * DOTS_A_MM, mode="nearest"))
            for light in (drawn, wanted)
        )
        found[f"dL {minutes:g}'"] = float(np.abs(ours - theirs).mean())
        if minutes == ARC_MINUTES[0]:
            found["bias"] = float((ours - theirs).mean())
            for low, high in BANDS:
                band = (theirs >= low) & (theirs < high)
                found[f"{low}-{min(high, 100)}"] = (
                    float((ours - theirs)[band].mean()) if band.mean() > 0.001 else np.nan
                )
            found["SSIM"] = float(structural_similarity(theirs[::4, ::4], ours[::4, ::4], data_range=100))
    return found | {"m": length_mm(plan) / 1000, "strokes": len(plan)}


def peer(path: Path, photo: Photo) -> strokeplan.StrokePlan:
    """Another program's drawing, with a pen and on a sheet as ours."""
    plan, sheet = strokeplan.load(path), turned(PAGE, photo.width, photo.height)
    scale = sheet.width_mm / plan.width
    black = np.zeros_like(plan.colors)
    return replace(
        plan,
        width=sheet.width_mm,
        height=plan.height * scale,
        points=plan.points * scale,
        widths=np.full(len(plan), PEN_MM),
        colors=black,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", nargs="+", type=Path)
    parser.add_argument("--preset", default="engraving")
    parser.add_argument("--peers", type=Path)
    options = parser.parse_args()
    rows: dict[str, list[dict[str, float]]] = {}
    for path in photo_files(options.photos):
        photo, began = strokeplan.load_photo(path), process_time()
        if not options.peers:
            plan = strokeplan.plan(photo, options.preset)
            report(rows, path.stem, options.preset, figures(plan, photo) | {"CPU s": process_time() - began})
        for drawn in sorted(options.peers.glob(f"{path.stem}.*.svg")) if options.peers else ():
            theirs = peer(drawn, photo)
            name = drawn.suffixes[-2].removeprefix(".")
            report(rows, path.stem, name, figures(theirs, photo))
            same = strokeplan.plan(photo, options.preset, max_length_mm=length_mm(theirs))
            report(rows, path.stem, f"{options.preset} as long as {name}", figures(same, photo))
    for who, found in rows.items():
        means = {key: float(np.nanmean([row[key] for row in found])) for key in found[0]}
        sys.stdout.write(line("mean", who, means))


def report(rows: dict[str, list[dict[str, float]]], photo: str, who: str, found: dict[str, float]) -> None:
    if not rows:
        sys.stdout.write(f"| photo | drawing | {' | '.join(found)} |\n|{'---|' * (len(found) + 2)}\n")
    rows.setdefault(who, []).append(found)
    sys.stdout.write(line(photo, who, found))
    sys.stdout.flush()


def line(photo: str, who: str, found: dict[str, float]) -> str:
    values = (f"{value:.3g}" if value < 1000 else f"{value:.0f}" for value in found.values())
    return f"| {photo} | {who} | {' | '.join(values)} |\n"


if __name__ == "__main__":
    main()
