"""Where detail matters in a photo, and regions that tracts need not cross (paper, "Discussion", future work).

An importance map is (h, w) float32 in 0..1, and 0.5 is neutral: what stands above it asks for more detail
than the preset gives, what stands below for less. A user's mask is taken as it is; without one the map is
made of cues that the photo itself gives: faces, and what catches the eye.

Cues and regions are found on a copy of bounded size, so that their time does not grow with the photo.

Known limits: the cascade sees faces from the front, upright, and no smaller than 1/13 of the photo's longer
side. It finds all 20 of NPRportrait1; of the 5 large faces in NPRgeneral 2 (a statue's is one), and misses the
half hidden, the bearded and the turned. It sees no face in the photos without one, cats included.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from functools import cache
from heapq import heapify, heappop, heappush
from math import sqrt
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from strokeplan.errors import InputError
from strokeplan.field import structure_tensor
from strokeplan.image import decode_file, grey

Map = NDArray[np.float32]
Cue = Literal["faces", "saliency"]
CUES: tuple[Cue, ...] = get_args(Cue)

NEUTRAL = 0.5
WORKING_SIDE = 400
"""Longer side of the copy that saliency and regions are found on: an eye in a portrait is 20 pixels wide."""

FACE_SIDE = 320
"""Longer side of the copy that faces are looked for in; the cascade's smallest window is 24 pixels wide."""
FACE_VOTES = 4
"""Windows that must agree on a face. In 43 photos, the faces found had 5 to 43, anything else 3 at most."""
SAME_FACE = 0.5
"""Windows that share this part of their union see one face."""
FACE = (0.5, 0.5, 0.42, 0.56, 0.6)
"""Centre x, y and half axes of the ellipse of a face in its window, whose side is 1; and its weight."""
FEATURES = ((0.3, 0.39, 0.17, 0.11, 1.0), (0.7, 0.39, 0.17, 0.11, 1.0), (0.5, 0.77, 0.22, 0.11, 1.0))
"""The same of both eyes, with their brows, and the mouth."""

# Differences below these are no reason to send detail anywhere, however even the rest of the photo is.
CONTRAST_FLOOR = 10.0  # ΔE, standard deviation in CIELAB
EDGE_FLOOR = 0.02  # grey 0..1 per pixel
RARITY_FLOOR = 2.0  # nats
LAB_BIN = 6.0
"""Side of a bin of the histogram of CIELAB colours, and the standard deviation of its smoothing."""

REGION_SCALE = 50.0
"""Felzenszwalb and Huttenlocher's k, with colours in hundredths of CIELAB's unit: small parts, to be merged."""
REGION_PART = 30
"""Smallest part in pixels of the working copy, where no more regions are asked for than such parts would fill."""


def load_mask(path: str | os.PathLike[str]) -> Map:
    """A mask from a picture file: (h, w) float32 in 0..1, white (or opaque) is where detail matters most.

    A picture with transparency is its opacity, whatever its colours: what is painted on an empty layer is
    what matters. Any other picture is its luma (ITU-R BT.709), so that mid grey is neutral. The file is read
    as photos are: upright by EXIF, bounded in size. Raises ImageError.
    """
    image, _ = decode_file(Path(path))
    pixels = np.asarray(image)
    opacity = pixels[..., 3:]
    if opacity.size and opacity.min() < 255:
        return opacity[..., 0] * np.float32(1 / 255)
    return _clipped(grey(pixels[..., :3]))


def fit_mask(mask: NDArray[Any], rgb: NDArray[np.uint8]) -> Map:
    """A mask (h, w) in 0..1 at the size of the photo (h, w, 3); means of its pixels where it is larger.

    Raises InputError, see `check_mask`.
    """
    check_mask(mask, rgb.shape[1], rgb.shape[0])
    return _resized(mask.astype(np.float32), rgb.shape[:2])


def check_mask(mask: NDArray[Any], width: int, height: int) -> None:
    """Raise InputError for a mask of another aspect ratio (a pixel of rounding is allowed), shape or range."""
    if mask.ndim != 2 or not mask.size:
        raise InputError(f"a mask of shape {mask.shape} is not understood; give (height, width)")
    if not np.all((mask >= 0) & (mask <= 1)):
        raise InputError("a mask must lie in 0..1; divide 8-bit values by 255")
    high, wide = mask.shape
    if abs(wide * height - high * width) > max(wide + high, width + height):
        raise InputError(
            f"the mask is {wide} × {high}, the photo {width} × {height}: give a mask of the photo's proportions"
        )


def importance_map(rgb: NDArray[np.uint8], *, mask: NDArray[Any] | None = None, use: Collection[Cue] = CUES) -> Map:
    """Where detail matters in a photo (h, w, 3): (h, w) float32 in 0..1, 0.5 is neutral.

    A mask decides alone, see `fit_mask`. Otherwise `use` names the cues: saliency moves detail from where
    it is low to where it is high, around its mean, which is neutral; faces raise what is beneath them
    towards 1. A photo that shows nothing of the kind is neutral all over. Raises InputError.
    """
    if mask is not None:
        return fit_mask(mask, rgb)
    for cue in use:
        if cue not in CUES:
            raise InputError(f'importance "{cue}" is not known; known are {", ".join(CUES)}')
    shape = _working_shape(rgb, WORKING_SIDE)
    importance = np.full(shape, NEUTRAL, np.float32)
    if "saliency" in use:
        seen = _saliency(_working_copy(rgb, WORKING_SIDE))
        importance = _clipped(NEUTRAL + seen - seen.mean())
    if "faces" in use:
        importance += (1 - importance) * _face_map(rgb, shape)
    return _resized(importance, rgb.shape[:2])


def faces(rgb: NDArray[np.uint8]) -> Map:
    """Faces in a photo (h, w, 3): (h, w) float32, 0.6 on a face, 1 on its eyes and mouth, 0 elsewhere.

    Found by scikit-image's cascade of local binary patterns (Liao et al. 2007); eyes and mouth are put where
    a face in the cascade's window has them.
    """
    return _resized(_face_map(rgb, _working_shape(rgb, WORKING_SIDE)), rgb.shape[:2])


def saliency(rgb: NDArray[np.uint8]) -> Map:
    """What catches the eye in a photo (h, w, 3): (h, w) float32, 0 what does not, 1 what does most.

    The mean of local contrast, coherent edges and rarity of the colour, each between its percentiles 5
    and 98, smoothed over 1.5 % of √(w·h). A photo of one colour is 0.
    """
    return _resized(_saliency(_working_copy(rgb, WORKING_SIDE)), rgb.shape[:2])


def segments(rgb: NDArray[np.uint8], count: int) -> NDArray[np.int32]:
    """Regions of similar colour in a photo (h, w, 3): (h, w) int32 labels 0, 1, 2 …, in order of their first pixels.

    `count` regions; fewer where the photo has no more to tell apart (one colour is one region). A graph of
    pixels is cut into small parts at its edges (Felzenszwalb and Huttenlocher 2004), which are merged, the
    pair that adds least to the variance of colour first (Ward 1963): unlike superpixels, an even sky stays
    whole. Raises InputError.
    """
    from skimage.color import rgb2lab
    from skimage.segmentation import felzenszwalb

    if count < 1:
        raise InputError(f"{count} segments are below 1")
    small = _working_copy(rgb, WORKING_SIDE)
    lab = rgb2lab(small)
    smallest = min(max(lab[..., 0].size // (8 * count), 1), REGION_PART)
    parts = felzenszwalb(lab / 100, scale=REGION_SCALE, sigma=0.8, min_size=smallest)
    labels = _merge(parts, lab, count).astype(np.int32)
    size = (rgb.shape[1], rgb.shape[0])
    return np.array(Image.fromarray(labels).resize(size, Image.Resampling.NEAREST))


def _working_shape(rgb: NDArray[np.uint8], side: int) -> tuple[int, int]:
    """Height and width of the photo reduced to a longer side of at most `side`."""
    height, width = rgb.shape[:2]
    scale = min(side / max(height, width), 1)
    return max(round(height * scale), 1), max(round(width * scale), 1)


def _working_copy(rgb: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """The photo at that shape, by means of its pixels."""
    height, width = _working_shape(rgb, side)
    if (height, width) == rgb.shape[:2]:
        return rgb
    return np.asarray(Image.fromarray(rgb).resize((width, height), Image.Resampling.BOX))


def _resized(values: Map, shape: tuple[int, ...]) -> Map:
    """A map at another shape: bilinear where it grows, means of its pixels where it shrinks."""
    resized = Image.fromarray(values).resize((shape[1], shape[0]), Image.Resampling.BILINEAR)
    return _clipped(np.asarray(resized))


def _clipped(values: Map) -> Map:
    """A copy that rounding has not led out of 0..1."""
    clipped: Map = np.clip(values, 0, 1)
    return clipped


# Faces


def _face_map(rgb: NDArray[np.uint8], shape: tuple[int, ...]) -> Map:
    """`faces` at another shape."""
    weights = np.zeros(shape, np.float32)
    y, x = ((np.arange(n, dtype=np.float32) + 0.5) / n for n in shape)
    height, width = rgb.shape[:2]
    for left, top, side in _face_windows(rgb).tolist():
        across, down = (x * width - left) / side, (y * height - top) / side
        for cx, cy, a, b, weight in (FACE, *FEATURES):
            radius = np.hypot((across[None, :] - cx) / a, (down[:, None] - cy) / b)
            # Full up to 3/4 of the radius, and smoothly nothing from 5/4 on.
            inside = np.clip((1.25 - radius) / 0.5, 0, 1)
            np.maximum(weights, weight * inside * inside * (3 - 2 * inside), out=weights)
    return weights


def _face_windows(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Windows around faces: rows left, top, side in pixels of the photo, the surest first.

    The cascade's own grouping depends on the order in which its threads find windows, so it hands over all
    of them. Windows that see one face are averaged; whatever else has its centre in there is part of it.
    """
    small = _working_copy(rgb, FACE_SIDE)
    # Scales grow by 10 %, windows move by 1/16 of their width. 2.0: grouped when they share twice their area, never.
    found = _cascade().detect_multi_scale(small, 1.1, 1.5, (24, 24), small.shape[:2], 1, 2.0)
    windows = np.array(sorted((f["c"], f["r"], f["width"]) for f in found), np.float64).reshape(-1, 3)
    votes = np.array([np.count_nonzero(_common_part(w, windows) > SAME_FACE) for w in windows], np.int64)
    groups: list[NDArray[np.float64]] = []
    while votes.max(initial=0) >= FACE_VOTES:
        same = _common_part(windows[votes.argmax()], windows) > SAME_FACE
        left, top, side = group = windows[same].mean(axis=0)
        groups.append(group)
        x, y = (windows[:, :2] + windows[:, 2:] / 2).T
        votes[same | ((x > left) & (x < left + side) & (y > top) & (y < top + side))] = 0
    scale = max(rgb.shape[:2]) / max(small.shape[:2])
    scaled: NDArray[np.float64] = np.array(groups, np.float64).reshape(-1, 3) * scale
    return scaled


def _common_part(window: NDArray[np.float64], windows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Intersection over union of a square window with each of many."""
    low = np.maximum(window[:2], windows[:, :2])
    high = np.minimum(window[:2] + window[2], windows[:, :2] + windows[:, 2:])
    shared = np.maximum(high - low, 0).prod(axis=1)
    part: NDArray[np.float64] = shared / (window[2] ** 2 + windows[:, 2] ** 2 - shared)
    return part


@cache
def _cascade() -> Any:
    from skimage.data import lbp_frontal_face_cascade_filename
    from skimage.feature import Cascade

    return Cascade(lbp_frontal_face_cascade_filename())


# Saliency


def _saliency(rgb: NDArray[np.uint8]) -> Map:
    """`saliency` of a small photo, at its size."""
    from skimage.color import rgb2lab

    lab = rgb2lab(rgb).astype(np.float32)
    unit = sqrt(rgb.shape[0] * rgb.shape[1]) / 100
    cues = (
        # Root: else the outline of a person against the light outweighs the eyes.
        np.sqrt(_spread(_contrast(lab, 2 * unit), CONTRAST_FLOOR)),
        np.sqrt(_spread(_coherent_edges(grey(rgb), unit), EDGE_FLOOR)),
        _spread(_rarity(_smooth(lab, unit / 2)), RARITY_FLOOR),
    )
    return _spread(_smooth(np.mean(cues, axis=0), 1.5 * unit), 0.25)


def _contrast(lab: Map, sigma: float) -> Map:
    """Standard deviation of the colour around each pixel."""
    variance = (_smooth(lab * lab, sigma) - _smooth(lab, sigma) ** 2).sum(axis=2)
    contrast: Map = np.sqrt(np.maximum(variance, 0))
    return contrast


def _coherent_edges(intensity: Map, rho: float) -> Map:
    """Gradient (root of the tensor's energy) where it has one direction: coherence as in field.py."""
    xx, xy, yy = structure_tensor(intensity, 1.0, rho)
    energy = xx + yy
    edges: Map = np.sqrt(energy) * (((xx - yy) ** 2 + 4 * xy**2) / np.maximum(energy**2, np.float32(1e-12)))
    return edges


def _rarity(lab: Map) -> Map:
    """Self-information of each pixel's colour, −ln of its frequency in the photo (Bruce and Tsotsos 2005)."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    place = (lab / LAB_BIN).reshape(-1, 3)
    place -= np.floor(place.min(axis=0))
    bins = np.floor(place.max(axis=0)).astype(int) + 2
    counts, _ = np.histogramdd(place, bins, [(-0.5, n - 0.5) for n in bins])
    smooth = gaussian_filter(counts / len(place), 1.0, mode="constant")
    frequency = map_coordinates(smooth, place.T, order=1, mode="nearest")
    rarity: Map = -np.log(np.maximum(frequency, 1e-9)).reshape(lab.shape[:2]).astype(np.float32)
    return rarity


def _spread(values: Map, floor: float) -> Map:
    """Values with percentile 5 at 0 and percentile 98 at 1, which are taken to be at least `floor` apart."""
    low, high = np.percentile(values, [5, 98]).astype(np.float32)
    return _clipped((values - low) / np.maximum(high - low, np.float32(floor)))


def _smooth(values: Map, sigma: float) -> Map:
    from scipy.ndimage import gaussian_filter

    smooth: Map = gaussian_filter(values, sigma, mode="nearest", axes=(0, 1))
    return smooth


# Regions


def _merge(parts: NDArray[np.int64], lab: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Parts (h, w; labels 0, 1, 2 … in order of their first pixels) merged until `count` are left."""
    flat = parts.ravel()
    sizes = np.bincount(flat)
    means = np.stack([np.bincount(flat, lab[..., k].ravel()) / sizes for k in range(3)], axis=1)
    sides = np.concatenate(
        [np.stack([a.ravel(), b.ravel()], axis=1) for a, b in ((parts[1:], parts[:-1]), (parts[:, 1:], parts[:, :-1]))]
    )
    pairs = np.unique(np.sort(sides[sides[:, 0] != sides[:, 1]], axis=1), axis=0)
    merged = _ward(sizes, means, pairs, count)
    labels: NDArray[np.int64] = np.unique(merged, return_inverse=True)[1][flat].reshape(parts.shape)
    return labels


def _ward(
    sizes: NDArray[np.int64], means: NDArray[np.float64], pairs: NDArray[np.int64], count: int
) -> NDArray[np.int64]:
    """For each of n nodes the first node of its group, when only neighbours merge (pairs (m, 2), a < b in each).

    The pair that adds least to the sum of squares within groups merges first: n_a n_b / (n_a + n_b) · |Δ mean|².
    """
    nodes = [(float(n), *mean) for n, mean in zip(sizes.tolist(), means.tolist(), strict=True)]
    neighbours: list[set[int]] = [set() for _ in nodes]
    for a, b in pairs.tolist():
        neighbours[a].add(b)
        neighbours[b].add(a)
    version = [0] * len(nodes)  # counts the merges of a node; a pair is out of date if either has merged since
    group = list(range(len(nodes)))

    def entry(a: int, b: int) -> tuple[float, int, int, int, int]:
        (na, la, aa, ba), (nb, lb, ab, bb) = nodes[a], nodes[b]
        distance2 = (la - lb) ** 2 + (aa - ab) ** 2 + (ba - bb) ** 2
        return na * nb / (na + nb) * distance2, a, b, version[a], version[b]

    heap = [entry(a, b) for a, b in pairs.tolist()]
    heapify(heap)
    left = len(nodes)
    while left > count and heap:
        _, a, b, version_a, version_b = heappop(heap)
        if (version[a], version[b]) != (version_a, version_b):
            continue
        na, nb = nodes[a][0], nodes[b][0]
        nodes[a] = (na + nb, *((na * p + nb * q) / (na + nb) for p, q in zip(nodes[a][1:], nodes[b][1:], strict=True)))
        group[b] = a
        version[a] += 1
        version[b] = -1
        left -= 1
        for c in neighbours[b]:
            neighbours[c].discard(b)
            neighbours[c].add(a)
        neighbours[a] = (neighbours[a] | neighbours[b]) - {a, b}
        for c in sorted(neighbours[a]):
            heappush(heap, entry(min(a, c), max(a, c)))
    for node, parent in enumerate(group):  # parents come before their children
        group[node] = group[parent]
    return np.array(group, np.int64)
