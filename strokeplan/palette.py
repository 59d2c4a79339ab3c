"""The colours of strokes: palettes, and departures from the photo (Hertzmann 1998, section 3.1: style parameters).

    --palette ──parse_palette──▶ ColorStyle ──plan_palette──▶ palette
    colours of a layer ──shift──▶ ──vary──▶ ──nearest──▶ colours of its strokes   (choose_colors)

Lightness, chroma and hue are those of CIE L*a*b* (D65), in which equal steps look about equal. Colours are
(n, 3) uint8 sRGB before and after every function.
"""

from __future__ import annotations

import os
import re
import reprlib
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from strokeplan.color_settings import MAX_COLORS, ColorStyle, LayerColors
from strokeplan.errors import InputError
from strokeplan.strokes import hex_to_rgb, rgb_to_hex

MAX_GPL_BYTES = 1_000_000
"""A .gpl file of 256 named colours has some 10 kB."""
MAX_PIXELS = 1 << 20
"""Pixels whose colours are counted; of more, as many at random."""
BIN_BITS = 5
"""Rarity is measured in bins of 8 levels a channel, far wider than noise."""
SAMPLES = 8192
"""Colours that k-means looks at."""
ITERATIONS = 20
STARTS = 5
"""Runs of k-means, of which the best counts: one alone may leave two clusters in the sky and none in the grass."""
STARTED_CLUSTERS = 64
"""No more runs than begin with this many clusters in all: they take long for large palettes, and matter less."""
CANDIDATES = 32
"""A larger palette is compared in part. One colour in some hundreds then misses its nearest, by less than 3 units."""
COMPARE_BLOCK = 8192
"""Colours compared with a palette at once: 2 MB for each of some twenty terms."""
GAMUT_TOLERANCE = 0.02
"""A colour is in sRGB's gamut if going there and back moves it by less than this in L*a*b*; 1 is barely seen."""
GAMUT_HALVINGS = 10
"""Chroma at the gamut's edge is found to this many bits."""

Colors = NDArray[np.uint8]
Lab = NDArray[np.float64]


def parse_palette(text: str) -> ColorStyle:
    """What --palette takes: a number of colours ("12"), a list ("#aabbcc,teal,#f00") or a GIMP palette ("my.gpl").

    Raises InputError.
    """
    text = text.strip()
    if not text:
        raise InputError("the palette is empty; give a number of colours, a list like #aabbcc,teal or a .gpl file")
    if re.fullmatch(r"[+-]?[0-9]+", text):
        size = int(text[:9])  # more digits are too many whatever they are
        if not 1 <= size <= MAX_COLORS:
            raise InputError(
                f"palette {reprlib.repr(text)}: the number of colours must lie in 1..{MAX_COLORS};"
                " a colour begins with #"
            )
        return ColorStyle(palette_size=size)
    if text.lower().endswith(".gpl"):
        return ColorStyle(palette=read_gpl(text))
    colors = [_listed_color(part.strip(), number) for number, part in enumerate(text.split(","), start=1)]
    return ColorStyle(palette=_distinct(colors, "palette"))


def read_gpl(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """The distinct colours ("#rrggbb") of a GIMP palette, in its order. Raises InputError.

    The format: https://developer.gimp.org/core/standards/gpl. After the header come fields ("Name: …"),
    comments (#) and colours: three numbers in 0..255 and a name, one a line. Files from Windows are read as well.
    """
    where = f"palette {path}"
    header, *lines = _read_bounded(path, where).removeprefix(b"\xef\xbb\xbf").splitlines() or [b""]
    if header.rstrip() != b"GIMP Palette":
        raise InputError(f"{where}: is no GIMP palette; its first line must be 'GIMP Palette'")
    colors = [
        _gpl_color(line, f"{where}, line {number}")
        for number, line in enumerate(lines, start=2)
        if line.strip() and not re.match(rb"#|\w+:", line)
    ]
    if not colors:
        raise InputError(f"{where}: holds no colours; one is a line like '170 187 204 mist'")
    return _distinct(colors, where)


def plan_palette(style: ColorStyle, rgb: NDArray[np.uint8], seed: int) -> Colors | None:
    """The (k, 3) palette that a style asks for on an (h, w, 3) photo; None if every colour is welcome."""
    if style.palette:
        return np.array([hex_to_rgb(color) for color in style.palette], np.uint8)
    return photo_palette(rgb, style.palette_size, seed) if style.palette_size else None


def photo_palette(rgb: NDArray[np.uint8], k: int, seed: int) -> Colors:
    """At most k colours that stand for those of an (…, 3) uint8 photo: (k', 3), dark to light.

    k-means in L*a*b*, in which a colour counts by the square root of how common it is, so that a few red berries
    get a cluster beside a wide sky; the colour of a cluster is the mean of its pixels, so that black stays black.
    A photo of no more than k colours gives those. Of a large photo MAX_PIXELS are looked at.
    """
    rng = np.random.default_rng(seed)
    colors, counts = _count_colors(rgb.reshape(-1, 3), rng)
    if len(colors) > k:
        sample, weights = _sample_by_rarity(colors, counts)
        colors = np.unique(_to_rgb(_cluster_means(_to_lab(sample), weights, k, rng)), axis=0)
    lightness = _to_lab(colors)[:, 0]
    return colors[np.argsort(lightness, kind="stable")]


def nearest(colors: Colors, palette: Colors) -> Colors:
    """For each of (n, 3) colours the nearest of a (k, 3) palette, the first of those equally near: (n, 3).

    By CIEDE2000, among the CANDIDATES nearest in L*a*b*. Straight distance in L*a*b* alone counts too much by
    chroma: if a palette has vivid colours only, it takes black for a dull blue and white for skin.
    """
    from scipy.spatial import KDTree
    from skimage.color import deltaE_ciede2000

    lab = _to_lab(palette)
    tree, ranks = KDTree(lab), range(1, min(len(palette), CANDIDATES) + 1)
    choice = np.empty(len(colors), np.intp)
    for at in range(0, len(colors), COMPARE_BLOCK):
        block = _to_lab(colors[at : at + COMPARE_BLOCK])
        candidates = np.sort(tree.query(block, ranks)[1], axis=1)  # in the palette's order, for the ties
        best = deltaE_ciede2000(block[:, None], lab[candidates]).argmin(axis=1)
        choice[at : at + len(block)] = np.take_along_axis(candidates, best[:, None], axis=1)[:, 0]
    return palette[choice]


def color_table(palette: Colors) -> Colors:
    """The nearest of a palette for every colour in steps of 8: (32³, 3), by red, green and blue."""
    steps = np.arange(4, 256, 8, dtype=np.uint8)
    return nearest(np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3), palette)


def shift(colors: Colors, *, hue: float = 0.0, chroma: float = 1.0, lightness: float = 0.0) -> Colors:
    """(n, 3) colours turned by `hue` degrees, their chroma times `chroma`, `lightness` added to L*.

    What leaves sRGB's gamut loses chroma, and keeps hue and lightness. No shift gives the same bytes.
    """
    if (hue, chroma, lightness) == (0, 1, 0):
        return colors.copy()
    lch = _to_lch(colors)
    return _from_lch(lch[:, 0] + lightness, lch[:, 1] * chroma, lch[:, 2] + np.radians(hue))


def vary(
    colors: Colors, *, hue: float = 0.0, chroma: float = 0.0, lightness: float = 0.0, rng: np.random.Generator
) -> Colors:
    """(n, 3) colours, each with a normal deviation of its own; standard deviations as in LayerColors.

    Three numbers are drawn for each colour, so that one that is asked for does not change with the others.
    What leaves sRGB's gamut loses chroma. No deviation draws nothing and gives the same bytes.
    """
    if hue == chroma == lightness == 0:
        return colors.copy()
    deviations = rng.standard_normal((len(colors), 3)) * (lightness, chroma, np.radians(hue))
    lch = _to_lch(colors)
    return _from_lch(lch[:, 0] + deviations[:, 0], lch[:, 1] * (1 + deviations[:, 1]), lch[:, 2] + deviations[:, 2])


def choose_colors(colors: Colors, settings: LayerColors, palette: Colors | None, rng: np.random.Generator) -> Colors:
    """The (n, 3) colours in which the strokes of a layer are painted, from those of the photo beneath them.

    Shifted, then varied, then the nearest of the palette: every colour is then of the palette, and where the photo
    lies between two of them the variation mixes both.
    """
    shifted = shift(colors, hue=settings.hue_shift, chroma=settings.chroma_shift, lightness=settings.lightness_shift)
    varied = vary(
        shifted,
        hue=settings.hue_jitter,
        chroma=settings.chroma_jitter,
        lightness=settings.lightness_jitter,
        rng=rng,
    )
    return varied if palette is None else nearest(varied, palette)


def _listed_color(text: str, number: int) -> str:
    if not re.fullmatch(r"#([0-9a-fA-F]{3}|[0-9a-fA-F]{6})", text) and text.lower() not in ImageColor.colormap:
        raise InputError(
            f"palette: {reprlib.repr(text)} (number {number}) is no colour;"
            " give #rrggbb, #rgb or a CSS name, or a file that ends in .gpl"
        )
    red, green, blue = ImageColor.getrgb(text)[:3]
    return rgb_to_hex((red, green, blue))


def _distinct(colors: list[str], where: str) -> tuple[str, ...]:
    distinct = tuple(dict.fromkeys(colors))
    if len(distinct) > MAX_COLORS:
        raise InputError(f"{where}: {len(distinct)} colours are too many; the most is {MAX_COLORS}")
    return distinct


def _read_bounded(path: str | os.PathLike[str], where: str) -> bytes:
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(MAX_GPL_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{where}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise InputError(f"{where}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if len(data) > MAX_GPL_BYTES:
        raise InputError(f"{where}: has more than {MAX_GPL_BYTES:,} bytes, the most for a palette")
    return data


def _gpl_color(line: bytes, where: str) -> str:
    values = line.split(maxsplit=3)[:3]
    if len(values) < 3 or not all(re.fullmatch(rb"[0-9]{1,3}", value) and int(value) <= 255 for value in values):
        shown = reprlib.repr(line.decode(errors="replace").strip())
        raise InputError(f"{where}: {shown} must begin with red, green and blue, whole numbers in 0..255")
    red, green, blue = map(int, values)
    return rgb_to_hex((red, green, blue))


def _count_colors(pixels: Colors, rng: np.random.Generator) -> tuple[Colors, NDArray[np.int64]]:
    """The (m, 3) distinct colours among (p, 3) pixels, and of how many pixels each is the colour."""
    if len(pixels) > MAX_PIXELS:
        pixels = pixels[rng.integers(len(pixels), size=MAX_PIXELS)]
    red, green, blue = pixels.T.astype(np.uint32)
    packed, counts = np.unique(red << 16 | green << 8 | blue, return_counts=True)
    colors = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=-1)
    return colors.astype(np.uint8), counts


def _sample_by_rarity(colors: Colors, counts: NDArray[np.int64]) -> tuple[Colors, NDArray[np.float64]]:
    """SAMPLES colours, those of a bin as often as the square root of its pixels, and a weight that undoes that."""
    red, green, blue = (colors >> (8 - BIN_BITS)).T.astype(np.intp)
    bins = (red << BIN_BITS | green) << BIN_BITS | blue
    root = np.sqrt(np.bincount(bins, weights=counts))[bins]
    # At even steps instead of at random: nothing is left to chance, and nothing common is missed.
    steps = np.cumsum(counts / root)
    chosen = np.searchsorted(steps, (np.arange(SAMPLES) + 0.5) / SAMPLES * steps[-1])
    return colors[chosen], root[chosen]


def _cluster_means(lab: Lab, weights: NDArray[np.float64], k: int, rng: np.random.Generator) -> Lab:
    """Weighted means of the at most k clusters of the best of some runs of k-means."""
    from scipy.cluster.vq import kmeans2

    k = min(k, len(np.unique(lab, axis=0)))
    least, labels = np.inf, np.zeros(len(lab), np.intp)
    for _ in range(min(STARTS, max(1, STARTED_CLUSTERS // k))):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a cluster that has lost its last colour: left out below
            centers, found = kmeans2(lab, k, iter=ITERATIONS, minit="++", seed=rng)
        error = float(((lab - centers[found]) ** 2).sum())
        if error < least:
            least, labels = error, found
    total = np.bincount(labels, weights=weights, minlength=k)
    sums = np.stack([np.bincount(labels, weights=weights * channel, minlength=k) for channel in lab.T], axis=-1)
    return np.asarray(sums[total > 0] / total[total > 0, None])


def _to_lab(colors: Colors) -> Lab:
    """(n, 3) uint8 sRGB → (n, 3) L*a*b*."""
    from skimage.color import rgb2lab

    return np.asarray(rgb2lab(colors[:, None]))[:, 0]


def _to_rgb(lab: Lab) -> Colors:
    """(n, 3) L*a*b* → (n, 3) uint8 sRGB, each channel cut to its range."""
    from skimage.color import lab2rgb

    rgb: NDArray[np.float64] = lab2rgb(lab[:, None])[:, 0]
    return np.rint(rgb * 255).astype(np.uint8)


def _to_lch(colors: Colors) -> Lab:
    """(n, 3) uint8 sRGB → (n, 3) lightness, chroma, hue in radians."""
    from skimage.color import lab2lch

    return np.asarray(lab2lch(_to_lab(colors)))


def _from_lch(lightness: NDArray[np.float64], chroma: NDArray[np.float64], hue: NDArray[np.float64]) -> Colors:
    """(n,) each, hue in radians → (n, 3) uint8 sRGB of that lightness and hue, and as much of the chroma as fits."""
    lightness = np.clip(lightness, 0, 100)
    # Where b* > 200 (L* + 16) / 116, Z is negative and scikit-image warns; sRGB ends well before.
    chroma = np.clip(chroma, 0, 199 * (lightness + 16) / 116 / np.maximum(np.sin(hue), 1e-3))
    lab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=-1)
    out = np.flatnonzero(~_in_gamut(lab))
    kept, step = np.zeros((len(out), 1)), 1.0
    for _ in range(GAMUT_HALVINGS):
        step /= 2
        tried = lab[out]
        tried[:, 1:] *= kept + step
        kept[_in_gamut(tried)] += step
    lab[out, 1:] *= kept
    return _to_rgb(lab)


def _in_gamut(lab: Lab) -> NDArray[np.bool_]:
    """(n, 3) → (n,): whether sRGB has the colour."""
    from skimage.color import lab2rgb, rgb2lab

    back = np.asarray(rgb2lab(lab2rgb(lab[:, None])))[:, 0]
    inside: NDArray[np.bool_] = np.all(np.abs(back - lab) < GAMUT_TOLERANCE, axis=1)
    return inside
