"""Figures of a plan against its photo (as in the literature on image quality: scikit-image's own)."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.image import Photo
from strokeplan.rendering import paint
from strokeplan.strokes import StrokePlan


@dataclass(frozen=True, slots=True)
class Figures:
    """How close a picture is to its photo.

    psnr_db  peak signal-to-noise ratio; ssim  structural similarity over the colour channels;
    rgb      mean Euclidean distance per pixel in 8-bit RGB.

    The same picture twice has a PSNR of infinity; one with a side below 3 pixels has no SSIM: NaN.
    """

    psnr_db: float
    ssim: float
    rgb: float


def evaluate(plan: StrokePlan, photo: Photo) -> Figures:
    """Paint `plan` at the photo's size and compare. Raises InputError if the shapes differ."""
    if abs(plan.width * photo.height - plan.height * photo.width) > plan.height + plan.width:
        raise InputError(
            f"the plan is {plan.width:g} × {plan.height:g}, the photo {photo.width} × {photo.height}: another picture?"
        )
    return compare(paint(plan, photo.width, photo.height), photo.rgb)


def compare(picture: NDArray[np.uint8], photo: NDArray[np.uint8]) -> Figures:
    """Figures of one (h, w, 3) uint8 picture against another of the same shape."""
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    with np.errstate(divide="ignore"):  # the same picture twice: infinite
        psnr = peak_signal_noise_ratio(photo, picture)
    window = min(7, (min(photo.shape[:2]) - 1) // 2 * 2 + 1)  # the largest odd side that fits
    ssim = structural_similarity(photo, picture, channel_axis=2, win_size=window) if window > 1 else nan
    distance = np.sqrt(((picture.astype(np.float32) - photo) ** 2).sum(axis=2)).mean()
    return Figures(float(psnr), float(ssim), float(distance))
