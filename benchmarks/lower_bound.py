"""What nobody does without: the orientation fields by scipy once, and Pycairo painting the finished plan once.

    python benchmarks/lower_bound.py PHOTO PLAN

Written plainly on purpose: full resolution, one step after the other. Run as a whole process, as the
command that it is compared with.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cairo
import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter


def fields(grey: np.ndarray, sigmas: list[float]) -> None:
    for sigma in sigmas:
        blurred = gaussian_filter(grey, sigma)
        ix, iy = gaussian_filter(blurred, 1, order=(0, 1)), gaussian_filter(blurred, 1, order=(1, 0))
        jxx, jxy, jyy = (gaussian_filter(product, 1) for product in (ix * ix, ix * iy, iy * iy))
        radius = np.sqrt((jxx - jyy) ** 2 + 4 * jxy**2)
        np.divide(radius, jxx + jyy + 1e-12) ** 2
        np.arctan2(2 * jxy, jxx - jyy)


def paint(document: dict) -> None:
    canvas = document["canvas"]
    surface = cairo.ImageSurface(cairo.FORMAT_RGB24, int(canvas["width"]), int(canvas["height"]))
    context = cairo.Context(surface)
    context.set_source_rgb(1, 1, 1)
    context.paint()
    context.set_line_cap(cairo.LINE_CAP_ROUND)
    context.set_line_join(cairo.LINE_JOIN_ROUND)
    for layer in document["layers"]:
        for stroke in layer["strokes"]:
            d = stroke["d"]
            context.set_source_rgb(*(int(stroke["color"][k : k + 2], 16) / 255 for k in (1, 3, 5)))
            context.set_line_width(stroke["width"])
            context.move_to(d[0], d[1])
            for k in range(2, len(d), 6):
                context.curve_to(*d[k : k + 6])
            context.stroke()


def main(photo: str, plan: str) -> None:
    grey = np.asarray(Image.open(photo).convert("L"), np.float32) / 255
    document = json.loads(Path(plan).read_bytes())
    fields(grey, [layer["sigma"] for layer in document["settings"]["resolved"]["layers"]])
    paint(document)


if __name__ == "__main__":
    main(*sys.argv[1:])
