"""From photo to pen drawing: strokes of true width on paper of true size, spaced by tone.

What each pen should cover comes from the photo's colours (separation.py), what its lines follow from the photo's
structure (field.py); each pen then draws its lines (inking.py), as many as a budget allows for (ink_budget.py).

The plan's unit is the millimetre: its canvas is the page.

Known limit: pens do not know of each other's lines beyond the average that the separation counts on.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from math import pi
from threading import Lock
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from strokeplan import inking
from strokeplan.errors import InputError
from strokeplan.field import OrientationField, orientation_field
from strokeplan.image import Photo, grey
from strokeplan.ink_budget import Budget, grant, own_budgets, within
from strokeplan.ink_presets import BUDGETS, InkPreset, InkRecipe, find_ink
from strokeplan.inking import Job, lines_of
from strokeplan.linework import Lines, chains, joined
from strokeplan.page import Page
from strokeplan.pens import PenSet, load_pens
from strokeplan.separation import separate
from strokeplan.sheet import PAGE, Raster, Sheet, rotated, sheet_of, turned
from strokeplan.strokes import Layer, Source, StrokePlan, hex_to_rgb
from strokeplan.version import __version__

FIELD_MM = 0.25
"""Side of the pixels on which the direction is measured."""
PEN_TURN = pi / 6
"""Pens after the first are turned by this against each other, so that their lines do not beat."""
TOLERANCE_MM = 0.04
"""Curves stray no further from the lines that were measured."""
DECIMALS = 3
"""Coordinates are multiples of a micrometre, as files have them."""
WOBBLE_MM = 2.5
"""σ of the noise by which a hand strays."""


class Progress(NamedTuple):
    """How far the work is: a budget takes several drawings, each of `total` steps."""

    drawing: int
    done: int
    total: int


def draw(
    photo: Photo,
    recipe: InkRecipe,
    *,
    page: Page = PAGE,
    budgets: Sequence[Budget] = (),
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> StrokePlan:
    """The pen drawing of a photo, in millimetres of its page.

    page      where the recipe has none, this, turned as the photo is.
    budgets   beside the recipe's own (strokes, length): each a cost of a plan and its limit.
    threads   for the pens of a set; the drawing is the same.
    progress  is called after every step of the work.

    Raises InputError.
    """
    if recipe.seed < 0:
        raise InputError(f"seed {recipe.seed} is negative; give 0 or more")
    if threads is not None and threads < 1:
        raise InputError(f"threads {threads} is below 1")
    limits = [*budgets, *own_budgets(recipe)]
    pens = load_pens(recipe.preset.pens) if recipe.pens is None else recipe.pens
    page = recipe.page or turned(page, photo.width, photo.height)
    sheet = sheet_of(photo.width, photo.height, page, min(pen.width_mm for pen in pens.pens))
    demands = _demands(photo, recipe.preset, pens, sheet)
    field = _directions(photo, recipe, sheet)
    jobs = [
        Job(rotated(field.samples, k * PEN_TURN), field.scale, recipe.preset, recipe.seed, pen, sheet)
        for k, pen in enumerate(pens.pens)
    ]
    told = _Told(progress, len(jobs) * inking.steps(recipe.preset))

    def at_price(price: float) -> StrokePlan:
        told.begin()
        parts = [grant(demand, price) for demand in demands]
        drawn = _at_once(lambda pen: lines_of(parts[pen], jobs[pen], told.step), len(jobs), threads)
        return _assemble(drawn, photo, recipe, pens, page, sheet)

    return within(at_price, demands, limits)


class _Told:
    """Counts the steps of a drawing, whichever thread takes them, and tells of them."""

    def __init__(self, progress: Callable[[Progress], None] | None, total: int) -> None:
        self._progress, self._lock = progress, Lock()
        self._at = Progress(0, 0, total)

    def begin(self) -> None:
        """Another drawing begins."""
        self._tell(Progress(self._at.drawing + 1, 0, self._at.total))

    def step(self) -> None:
        with self._lock:
            self._tell(self._at._replace(done=self._at.done + 1))

    def _tell(self, at: Progress) -> None:
        self._at = at
        if self._progress is not None:
            self._progress(at)


def _at_once(work: Callable[[int], Lines], count: int, threads: int | None) -> list[Lines]:
    """`work` of 0 … count − 1, in so many threads. Nobody waits for them if this one is interrupted."""
    pool = ThreadPoolExecutor(threads or os.cpu_count())
    try:
        return list(pool.map(work, range(count)))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first drawing compiles them."""
    return inking.compiled()


def warm_up() -> None:
    """Compile every kernel, or load it if it is cached, by the drawing of a few pixels."""
    shades = np.linspace(0, 255, 48, dtype=np.uint8)
    picture = np.repeat(np.tile(shades, (48, 1))[..., None], 3, axis=2)
    recipe = find_ink("engraving")
    assert recipe is not None  # noqa: S101 (it ships)
    draw(Photo(picture), recipe._replace(page=Page(30.0, 30.0, 2.0)))


def _demands(photo: Photo, preset: InkPreset, pens: PenSet, sheet: Sheet) -> list[Raster]:
    """What each pen should cover of each pixel of the sheet."""
    rgb = np.asarray(Image.fromarray(photo.rgb).resize(sheet.pixels, Image.Resampling.BICUBIC, reducing_gap=3.0))
    demands = separate(rgb, pens, max(layer.reach for layer in preset.layers))
    return [np.where(demand < preset.bare, 0, demand * np.float32(preset.strength)) for demand in demands]


def _directions(photo: Photo, recipe: InkRecipe, sheet: Sheet) -> OrientationField:
    """What lines follow; its scale is in millimetres."""
    preset = recipe.preset
    size = max(round(sheet.width_mm / FIELD_MM), 8), max(round(sheet.height_mm / FIELD_MM), 8)
    small = np.asarray(Image.fromarray(photo.rgb).resize(size, Image.Resampling.LANCZOS, reducing_gap=3.0))
    pixel = sheet.width_mm / size[0]
    field = orientation_field(
        grey(small),
        sigma=preset.detail_mm / pixel,
        integration_sigma=preset.integration_mm / pixel,
        max_integration_sigma=preset.max_integration_mm / pixel,
    )
    samples = field.samples
    if preset.direction == "fixed":
        samples = np.zeros_like(samples)
        samples[..., 0] = 1
    if preset.wobble > 0:
        samples = rotated(samples, _wobble(samples.shape[:2], preset.wobble, WOBBLE_MM / (field.scale * pixel), recipe))
    return OrientationField(samples, field.scale * pixel, size[0], size[1])


def _wobble(shape: tuple[int, ...], degrees: float, sigma: float, recipe: InkRecipe) -> NDArray[np.float32]:
    """Smooth noise of angles in radians."""
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng((recipe.seed, 1)).standard_normal(shape).astype(np.float32)
    smooth = gaussian_filter(noise, sigma)
    angles: NDArray[np.float32] = smooth * np.float32(np.radians(degrees)) / max(float(smooth.std()), 1e-6)
    return angles


def _assemble(
    drawn: list[Lines], photo: Photo, recipe: InkRecipe, pens: PenSet, page: Page, sheet: Sheet
) -> StrokePlan:
    """The plan, one layer a pen."""
    counts = [len(lines.starts) - 1 for lines in drawn]
    ends = np.cumsum(counts).tolist()
    points, starts = chains(joined(drawn), TOLERANCE_MM)
    settings = {
        "strokeplan": __version__,
        "seed": recipe.seed,
        "ink": msgspec.to_builtins(recipe.preset),
        "pens": msgspec.to_builtins(pens),
        "page": asdict(page),
        "page_mm": [page.width_mm, page.height_mm],
    }
    budgets = {key: getattr(recipe, key) for key in BUDGETS}
    return StrokePlan(
        width=page.width_mm,
        height=page.height_mm,
        points=np.round(points + np.array(sheet.placement[1:]), DECIMALS) + 0.0,
        starts=starts,
        widths=np.repeat([pen.width_mm for pen in pens.pens], counts),
        colors=np.repeat(np.array([hex_to_rgb(pen.color) for pen in pens.pens], np.uint8), counts, axis=0),
        layers=tuple(
            Layer(pen.name, end - count, end, "ink") for pen, count, end in zip(pens.pens, counts, ends, strict=True)
        ),
        background=hex_to_rgb(pens.paper),
        settings=settings | {key: value for key, value in budgets.items() if value is not None},
        source=Source(photo.name, photo.sha256, photo.width, photo.height),
        pens=tuple(pen.name for pen, count in zip(pens.pens, counts, strict=True) for _ in range(count)),
    )
