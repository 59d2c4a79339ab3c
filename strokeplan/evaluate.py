"""Figures of a plan against its photo, as the literature on image quality and on edges has them.

The picture compared is the plan painted by Pycairo at the photo's size. Whatever has a formula in
scikit-image is scikit-image's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import hypot, isfinite, nan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.formats import compress
from strokeplan.formats.svg import encode
from strokeplan.image import Photo, grey
from strokeplan.rendering import paint
from strokeplan.strokes import StrokePlan

EDGE_SCALE = 0.002
"""σ of the blur before edges are sought, as a part of the diagonal; a pixel at least."""
EDGE_CONTRAST = 0.2
"""A step of this much luminance (0..1) is an edge; a weaker one, down to half of it, where it continues one."""
EDGE_TOLERANCE = 0.0025
"""How far an edge may lie from its match, as a part of the diagonal; a pixel at least.

A third of what Martin et al. allow people who draw outlines: machine edges are denser, and at theirs a photo turned
upside down agrees with itself to 0.5 (cat, tomato and city of NPRgeneral); at this it does to 0.25.
"""
STRIP_PIXELS = 1 << 20
"""CIEDE2000 takes some 300 bytes a pixel on its way: large pictures are compared in strips."""


@dataclass(frozen=True, slots=True)
class Figures:
    """How close a picture is to its photo.

    psnr_db     peak signal-to-noise ratio;
    ssim        structural similarity over the colour channels (Wang et al. 2004), -1..1;
    rgb_8bit    mean Euclidean distance per pixel in 8-bit RGB, 0..442;
    ciede2000   mean colour difference ΔE00 per pixel (Sharma et al. 2005); about 1 is just noticeable;
    edge_f1     agreement of the edges, 0..1: see `edge_agreement`.

    The same picture twice has a PSNR of infinity; one with a side below 3 pixels has no SSIM: NaN.
    """

    psnr_db: float
    ssim: float
    rgb_8bit: float
    ciede2000: float
    edge_f1: float


@dataclass(frozen=True, slots=True)
class PlanFigures(Figures):
    """How close a plan comes to its photo, and what it spends on that.

    uncovered_percent     pixels of the photo whose centre no stroke covers;
    strokes, cubics       their numbers;
    svg_bytes, svgz_bytes the plan as .svg and as .svgz.
    """

    uncovered_percent: float
    strokes: int
    cubics: int
    svg_bytes: int
    svgz_bytes: int


COLUMNS = {
    "psnr_db": ("PSNR", "{:.2f} dB"),
    "ssim": ("SSIM", "{:.3f}"),
    "rgb_8bit": ("RGB distance", "{:.1f}"),
    "ciede2000": ("CIEDE2000", "{:.2f}"),
    "edge_f1": ("edges F1", "{:.3f}"),
    "uncovered_percent": ("uncovered", "{:.2f} %"),
    "strokes": ("strokes", "{:,.0f}"),
    "cubics": ("cubics", "{:,.0f}"),
    "svg_bytes": ("SVG bytes", "{:,.0f}"),
    "svgz_bytes": ("SVGZ bytes", "{:,.0f}"),
}
"""How the fields of PlanFigures are headed and written for people."""


def evaluate(plan: StrokePlan, photo: Photo) -> PlanFigures:
    """Paint `plan` at the photo's size and compare. Raises InputError if the shapes differ."""
    if abs(plan.width * photo.height - plan.height * photo.width) > plan.height + plan.width:
        raise InputError(
            f"the plan is {plan.width:g} × {plan.height:g}, the photo {photo.width} × {photo.height}: another picture?"
        )
    likeness = compare(paint(plan, photo.width, photo.height), photo.rgb)
    svg = encode(plan)
    return PlanFigures(
        **asdict(likeness),
        uncovered_percent=uncovered_percent(plan, photo.width, photo.height),
        strokes=len(plan),
        cubics=plan.cubics,
        svg_bytes=len(svg),
        svgz_bytes=len(compress(svg)),
    )


def means(figures: Sequence[PlanFigures]) -> dict[str, float]:
    """The mean of every figure over some plans."""
    return {name: float(np.mean([getattr(one, name) for one in figures])) for name in COLUMNS}


def cells(figures: Mapping[str, float]) -> list[str]:
    """The figures by name as people read them, in the order of COLUMNS."""
    return [form.format(figures[name]) for name, (_, form) in COLUMNS.items()]


def json_figures(figures: Mapping[str, float]) -> dict[str, float | None]:
    """The figures by name as JSON may hold them: None for what is infinite or undefined."""
    return {name: figures[name] if isfinite(figures[name]) else None for name in COLUMNS}


def compare(picture: NDArray[np.uint8], photo: NDArray[np.uint8]) -> Figures:
    """Figures of one (h, w, 3) uint8 picture against another of the same shape."""
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    with np.errstate(divide="ignore"):  # the same picture twice: infinite
        psnr = peak_signal_noise_ratio(photo, picture)
    window = min(7, (min(photo.shape[:2]) - 1) // 2 * 2 + 1)  # the largest odd side that fits
    ssim = structural_similarity(photo, picture, channel_axis=2, win_size=window) if window > 1 else nan
    distance = np.sqrt(((picture.astype(np.float32) - photo) ** 2).sum(axis=2)).mean()
    return Figures(
        psnr_db=float(psnr),
        ssim=float(ssim),
        rgb_8bit=float(distance),
        ciede2000=_mean_ciede2000(picture, photo),
        edge_f1=edge_agreement(picture, photo),
    )


def edge_agreement(picture: NDArray[np.uint8], photo: NDArray[np.uint8]) -> float:
    """F1 of the edges of a (h, w, 3) uint8 picture against those of its photo, 0..1.

    Precision is the part of the picture's edge pixels that lie within EDGE_TOLERANCE of an edge of the photo,
    recall the part of the photo's that lie as near to one of the picture, F1 their harmonic mean: the measure by
    which Martin, Fowlkes and Malik (PAMI 2004) compare boundaries, without their one-to-one matching, by distances
    alone. Edges are Canny's (PAMI 1986) on luminance, at one scale and with the same absolute thresholds for both
    pictures, so that a contour painted too faint is missed. 1 if neither has an edge, 0 if only one has.
    """
    from scipy.ndimage import distance_transform_edt

    ours, theirs = _edges(picture), _edges(photo)
    if not (ours.any() and theirs.any()):
        return float(ours.any() == theirs.any())
    tolerance = max(EDGE_TOLERANCE * hypot(*photo.shape[:2]), 1.0)
    precision = float((distance_transform_edt(~theirs)[ours] <= tolerance).mean())
    recall = float((distance_transform_edt(~ours)[theirs] <= tolerance).mean())
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def uncovered_percent(plan: StrokePlan, columns: int, rows: int) -> float:
    """Pixels in percent that no stroke covers: all strokes black on white, a pixel belongs to one or does not."""
    black = replace(plan, colors=np.zeros_like(plan.colors), background=(255, 255, 255))
    return float((paint(black, columns, rows, antialias=False)[..., 0] == 255).mean() * 100)


def _edges(rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    from skimage.feature import canny

    sigma = max(EDGE_SCALE * hypot(*rgb.shape[:2]), 1.0)
    # canny measures by Sobel, which gives 8 times the slope; a blurred step of 1 is 1 / (σ √2π) steep.
    high = EDGE_CONTRAST * 8 / (sigma * sqrt(2 * pi))
    found: NDArray[np.bool_] = canny(grey(rgb), sigma, low_threshold=high / 2, high_threshold=high, mode="nearest")
    return found


def _mean_ciede2000(picture: NDArray[np.uint8], photo: NDArray[np.uint8]) -> float:
    from skimage.color import deltaE_ciede2000, rgb2lab

    rows = max(STRIP_PIXELS // photo.shape[1], 1)
    total = 0.0
    for top in range(0, len(photo), rows):
        strips = (rgb2lab(image[top : top + rows]) for image in (photo, picture))
        total += float(deltaE_ciede2000(*strips).sum())
    return total / float(photo[..., 0].size)
