"""How much of the paper each pen should cover so that together they look like the photo.

Inks are laid in the order of their set. A pen that covers the part a of a place leaves 1 − a of what was there; on
the rest a transparent ink multiplies the linear light by its own, an opaque one replaces it (lines of several pens
cross at random: Demichel 1924, Neugebauer 1937). For each of the photo's colours the coverages are found that
minimise the distance in CIE L*a*b*, and with it, but little, how restless the result is: lines of an ink that
stands out against its ground count GRAIN · a (1 − a) times the square of that contrast, so that light tones go to
light inks. The search goes from pen to pen over a grid that narrows, and its results are a table over sRGB.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.pens import PenSet
from strokeplan.strokes import hex_to_rgb

GRAIN = 0.004
"""Restlessness against squared distance of colours."""
GREYS, NODES = 256, 17
"""Entries of the table where paper, pens and hence the search are grey; nodes a channel where they are not."""
SWEEPS = 6
TRIALS = 17
"""Coverages tried for a pen at once."""
_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = _XYZ.sum(axis=1)
Y_WEIGHTS = _XYZ[1].astype(np.float32)


def linear(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """8-bit sRGB → linear light in 0..1 (IEC 61966-2-1)."""
    v = np.arange(256) / 255
    table = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)
    found: NDArray[np.float32] = table[rgb]
    return found


def luminance(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(…, 3) 8-bit sRGB → (…) luminance Y in 0..1."""
    light = linear(rgb)
    total: NDArray[np.float32] = light[..., 0] * Y_WEIGHTS[0]
    for channel in (1, 2):
        total += light[..., channel] * Y_WEIGHTS[channel]
    return total


def lightness(y: NDArray[np.float32]) -> NDArray[np.float32]:
    """CIE L* of luminance in 0..1."""
    found: NDArray[np.float32] = np.where(y > 216 / 24389, 116 * np.cbrt(y) - 16, y * np.float32(24389 / 27))
    return found


def lab(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """(…, 3) linear sRGB → CIE L*a*b* (D65)."""
    t = np.maximum(light @ _XYZ.T / WHITE, 0)
    f = np.where(t > 216 / 24389, np.cbrt(t), (t * 24389 / 27 + 16) / 116)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def separate(rgb: NDArray[np.uint8], pens: PenSet, most: float) -> list[NDArray[np.float32]]:
    """For each pen the part of the paper (h, w) that it should cover, at most `most`, for a (h, w, 3) photo."""
    inks = [linear(np.array(hex_to_rgb(color), np.uint8)) for color in (pens.paper, *(pen.color for pen in pens.pens))]
    if all(np.ptp(ink) == 0 for ink in inks):
        return _by_grey(rgb, pens, inks, most)
    return _by_color(rgb, pens, inks, most)


def _by_grey(
    rgb: NDArray[np.uint8], pens: PenSet, inks: list[NDArray[np.float32]], most: float
) -> list[NDArray[np.float32]]:
    nodes = np.linspace(0, 1, GREYS)
    table = _solve(np.repeat(nodes[:, None] ** 3, 3, axis=1), pens, inks, most)  # even in L*, nearly
    y = np.cbrt(luminance(rgb))
    return [np.interp(y, nodes, table[:, pen]).astype(np.float32) for pen in range(len(pens.pens))]


def _by_color(
    rgb: NDArray[np.uint8], pens: PenSet, inks: list[NDArray[np.float32]], most: float
) -> list[NDArray[np.float32]]:
    from scipy.ndimage import map_coordinates

    nodes = np.rint(np.linspace(0, 255, NODES)).astype(np.uint8)
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    table = _solve(linear(grid).astype(np.float64), pens, inks, most).reshape(NODES, NODES, NODES, -1)
    places = np.moveaxis(rgb, -1, 0).astype(np.float32) * np.float32((NODES - 1) / 255)
    return [
        map_coordinates(table[..., pen].astype(np.float32), places, order=1, mode="nearest")
        for pen in range(len(pens.pens))
    ]


def _solve(
    wanted: NDArray[np.float64], pens: PenSet, inks: list[NDArray[np.float32]], most: float
) -> NDArray[np.float64]:
    """(n, pens) coverages that come nearest to the (n, 3) linear colours."""
    target, n = lab(wanted), len(pens.pens)
    paper = inks[0].astype(np.float64)
    laid = np.stack([_over(paper, inks[k + 1], pens.pens[k].ink) for k in range(n)])
    contrast = ((lab(laid) - lab(paper)) ** 2).sum(axis=1)
    grain = GRAIN if n > 1 else 0.0  # a single pen has no choice, and would only come out too light
    found = np.zeros((len(wanted), n))
    for sweep in range(SWEEPS):
        span = most / 2.0**sweep
        for k in range(n):
            low = np.clip(found[:, k] - span, 0, most)[:, None]
            high = np.clip(found[:, k] + span, 0, most)[:, None]
            trials = np.concatenate([low + (high - low) * np.linspace(0, 1, TRIALS), found[:, k : k + 1]], axis=1)
            every = np.repeat(found[:, None, :], trials.shape[1], axis=1)
            every[..., k] = trials
            cost = ((lab(composite(every, pens, inks)) - target[:, None]) ** 2).sum(axis=-1)
            cost += grain * (every * (1 - every) * contrast).sum(axis=-1)
            found[:, k] = np.take_along_axis(trials, cost.argmin(axis=1)[:, None], axis=1)[:, 0]
    return found


def composite(coverages: NDArray[np.float64], pens: PenSet, inks: list[NDArray[np.float32]]) -> NDArray[np.float64]:
    """(…, 3) linear light of paper of which the pens cover the parts `coverages` (…, pens)."""
    light = np.broadcast_to(inks[0].astype(np.float64), (*coverages.shape[:-1], 3))
    for k, pen in enumerate(pens.pens):
        part = coverages[..., k : k + 1]
        light = light * (1 - part) + _over(light, inks[k + 1], pen.ink) * part
    return light


def _over(light: NDArray[np.float64], ink: NDArray[np.float32], kind: str) -> NDArray[np.float64]:
    """Linear light of ink laid on something."""
    return light * ink if kind == "transparent" else np.broadcast_to(ink.astype(np.float64), light.shape)
