"""From photo to pen drawing: strokes of true width on paper of true size, spaced by tone.

What each pen should cover comes from the photo's colours (separation.py). Its lines follow the photo's structure,
layer over layer of other directions as it gets darker, evenly spaced (hatching.py); what a layer has covered is
measured, blurred as an eye blurs it, and corrects first its own spacing and then what the next layer has to add.
Lights too pale for lines get dashes (dashes.py), and where lines leave gaps short strokes fill them (mending.py).

A budget is met by asking for less ink: λ is taken from every demand, which for a given sum of ink leaves the least
sum of squared differences, so the lightest tones are the first to stay paper; λ is found by bisection.

The plan's unit is the millimetre: its canvas is the page.

Known limit: pens do not know of each other's lines beyond the average that the separation counts on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import pi, sqrt
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from strokeplan import dashes, hatching, mending
from strokeplan.coverage import cover
from strokeplan.dashes import dash
from strokeplan.errors import InputError
from strokeplan.field import OrientationField, orientation_field
from strokeplan.hatching import hatch
from strokeplan.image import Photo, grey
from strokeplan.ink_presets import InkPreset, InkRecipe, find_ink
from strokeplan.linework import NO_LINES, Lines, chains, joined
from strokeplan.mending import mend
from strokeplan.page import Page, Placement
from strokeplan.pens import Pen, PenSet, load_pens
from strokeplan.separation import separate
from strokeplan.strokes import Layer, Source, StrokePlan, hex_to_rgb
from strokeplan.version import __version__

PAGE = Page(210.0, 297.0, 15.0)
"""Without a page: A4, turned as the photo is."""
PIXELS_A_PEN = 3.0
"""Coverage is measured on pixels so many times finer than the finest pen …"""
MAX_PIXELS = 16e6
"""… or of such a number of pixels."""
COARSE = 3
"""Blurred things are worked on with blocks of so many pixels."""
FIELD_MM = 0.25
"""Side of the pixels on which the direction is measured."""
SHARP = 0.5
"""σ of the blur of what a pen should cover, in its widths: lines show nothing finer."""
EYE_WIDTHS, FEEDBACK_WIDTHS, MEND_WIDTHS = 1.7, 2.7, 1.5
"""σ of the blur, in widths of the pen, of what is covered so far; of the correction of the spacing; of mending."""
MEND_LIGHT = 1.07
"""Mending aims at so many times the light: it can add ink and take none away, and would leave a drawing too dark."""
ROUNDS = 3
"""How often a layer is drawn to find its spacing."""
CORRECTION = (1.0, 0.6)
"""Power of the measured excess that goes into the spacing after the first round, and after later ones."""
PEN_TURN = pi / 6
"""Pens after the first are turned by this against each other, so that their lines do not beat."""
TOLERANCE_MM = 0.04
"""Curves stray no further from the lines that were measured."""
DECIMALS = 3
"""Coordinates are multiples of a micrometre, as files have them."""
MOST_OF_A_LAYER = 0.95
WOBBLE_MM = 2.5
"""σ of the noise by which a hand strays."""
SEARCHES = 9
"""Drawings made to find the one for a budget."""
NEAR_ENOUGH = 0.985
"""A drawing that uses this part of a budget is the one."""

Budget = tuple[Callable[[StrokePlan], float], float]
"""What a plan costs, and the most that it may."""
Raster = NDArray[np.float32]


class _Sheet(NamedTuple):
    """The picture on its page: everything in millimetres from its upper left corner."""

    placement: Placement
    width_mm: float
    height_mm: float
    pixel_mm: float


def draw(photo: Photo, recipe: InkRecipe, *, budgets: Sequence[Budget] = ()) -> StrokePlan:
    """The pen drawing of a photo, in millimetres of its page.

    Beside the recipe's own (strokes, length) `budgets` may hold others, each a cost of a plan and its limit.
    Raises InputError.
    """
    pens = load_pens(recipe.preset.pens) if recipe.pens is None else recipe.pens
    page = recipe.page or _turned(PAGE, photo)
    recipe = recipe._replace(pens=pens, page=page)
    sheet = _sheet(photo, page, min(pen.width_mm for pen in pens.pens))
    demands = _demands(photo, recipe.preset, pens, sheet)
    directions = _directions(photo, recipe, sheet)
    limits = [*budgets, *_own_budgets(recipe)]

    def with_less(less: float) -> StrokePlan:
        drawn = [
            _drawn(np.maximum(demand - np.float32(less), 0), directions, recipe, pen, number, sheet)
            for number, (demand, pen) in enumerate(zip(demands, pens.pens, strict=True))
        ]
        return _assemble(drawn, photo, recipe, pens, page, sheet)

    return _within(with_less, limits)


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first drawing compiles them."""
    return hatching.compiled() and dashes.compiled() and mending.compiled()


def warm_up() -> None:
    """Compile every kernel, or load it if it is cached, by the drawing of a few pixels."""
    shades = np.linspace(0, 255, 48, dtype=np.uint8)
    picture = np.repeat(np.tile(shades, (48, 1))[..., None], 3, axis=2)
    recipe = find_ink("engraving")
    assert recipe is not None  # noqa: S101 (it ships)
    draw(Photo(picture), recipe._replace(page=Page(30.0, 30.0, 2.0)))


def length_mm(plan: StrokePlan) -> float:
    """Length of all strokes in the unit of the plan: how far a pen draws."""
    from strokeplan.curves import flatten_all

    vertices, starts = flatten_all(plan.points, plan.starts, 0.01)
    steps = np.hypot(*np.diff(vertices, axis=0).T)
    inner = np.ones(len(steps), np.bool_)
    inner[starts[1:-1] - 1] = False
    return float(steps[inner].sum())


def _own_budgets(recipe: InkRecipe) -> list[Budget]:
    """What a recipe allows for. Raises InputError."""
    found: list[Budget] = []
    if recipe.strokes is not None:
        if recipe.strokes < 1:
            raise InputError(f"strokes {recipe.strokes} is below 1")
        found.append((len, recipe.strokes))
    if recipe.max_length_mm is not None:
        if not recipe.max_length_mm > 0:
            raise InputError(f"length {recipe.max_length_mm:g} mm is none; give more than 0")
        found.append((length_mm, recipe.max_length_mm))
    return found


def _within(drawing: Callable[[float], StrokePlan], budgets: Sequence[Budget]) -> StrokePlan:
    """The drawing of the most ink that all budgets allow for; an empty one allows for all. Raises InputError."""
    best = drawing(0.0)
    low, high = 0.0, 1.0
    share = _share(best, budgets)
    if share <= 1:
        return best
    fits: StrokePlan | None = None
    guess = 1 - sqrt(1 / share)
    for _ in range(SEARCHES):
        plan = drawing(guess)
        share = _share(plan, budgets)
        if share <= 1:
            fits, high = plan, guess
            if share >= NEAR_ENOUGH:
                break
        else:
            low = guess
        guess = 0.5 * (low + high)
    return drawing(1.0) if fits is None else fits


def _share(plan: StrokePlan, budgets: Sequence[Budget]) -> float:
    """How much of the tightest budget a plan takes."""
    return max((cost(plan) / limit for cost, limit in budgets), default=0.0)


def _turned(page: Page, photo: Photo) -> Page:
    """A page with its longer side along that of the photo."""
    short, long = sorted((page.width_mm, page.height_mm))
    return Page(*((long, short) if photo.width > photo.height else (short, long)), page.margin_mm)


def _sheet(photo: Photo, page: Page, finest_mm: float) -> _Sheet:
    place = page.fit(photo.width, photo.height)
    width, height = photo.width * place.scale, photo.height * place.scale
    pixel = max(finest_mm / PIXELS_A_PEN, sqrt(width * height / MAX_PIXELS))
    if min(width, height) < 2 * COARSE * pixel:
        raise InputError(f"a picture of {width:.3g} × {height:.3g} mm is too small for a pen of {finest_mm:g} mm")
    return _Sheet(place, width, height, pixel)


def _demands(photo: Photo, preset: InkPreset, pens: PenSet, sheet: _Sheet) -> list[Raster]:
    """What each pen should cover of each pixel of the sheet."""
    size = round(sheet.width_mm / sheet.pixel_mm), round(sheet.height_mm / sheet.pixel_mm)
    rgb = np.asarray(Image.fromarray(photo.rgb).resize(size, Image.Resampling.BICUBIC, reducing_gap=3.0))
    demands = separate(rgb, pens, max(layer.reach for layer in preset.layers))
    return [np.where(demand < preset.bare, 0, demand * np.float32(preset.strength)) for demand in demands]


def _directions(photo: Photo, recipe: InkRecipe, sheet: _Sheet) -> OrientationField:
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
        samples = _rotated(
            samples, _wobble(samples.shape[:2], preset.wobble, WOBBLE_MM / (field.scale * pixel), recipe)
        )
    return OrientationField(samples, field.scale * pixel, size[0], size[1])


def _wobble(shape: tuple[int, ...], degrees: float, sigma: float, recipe: InkRecipe) -> NDArray[np.float32]:
    """Smooth noise of angles in radians."""
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng((recipe.seed, 1)).standard_normal(shape).astype(np.float32)
    smooth = gaussian_filter(noise, sigma)
    angles: NDArray[np.float32] = smooth * np.float32(np.radians(degrees)) / max(float(smooth.std()), 1e-6)
    return angles


def _rotated(samples: Raster, angle: float | Raster) -> Raster:
    """The unit vectors of a field turned."""
    cos, sin = np.float32(1) * np.cos(angle), np.float32(1) * np.sin(angle)
    turned = samples.copy()
    turned[..., 0] = cos * samples[..., 0] - sin * samples[..., 1]
    turned[..., 1] = sin * samples[..., 0] + cos * samples[..., 1]
    return turned


def _drawn(
    demand: Raster, directions: OrientationField, recipe: InkRecipe, pen: Pen, number: int, sheet: _Sheet
) -> Lines:
    """All lines of one pen."""
    preset, width, pixel = recipe.preset, pen.width_mm, sheet.pixel_mm
    samples, spacing = _rotated(directions.samples, number * PEN_TURN), directions.scale
    sharp = _blurred(demand, SHARP * width / pixel)
    covered = np.zeros_like(demand)
    parts: list[Lines] = []
    before = 0.0
    for layer in preset.layers:
        lines = _layer(
            sharp, covered, _rotated(samples, np.radians(layer.angle)), spacing, before, layer.reach, preset, pen, sheet
        )
        cover(lines, width, pixel, covered)
        parts.append(lines)
        before = layer.reach
    seen = _seen(covered, EYE_WIDTHS * width / pixel)
    lacking = np.where(sharp < preset.lines_from, np.clip((sharp - seen) / (1 - seen), 0, 1), 0)
    dashes = dash(
        samples, spacing, _blocks(lacking), COARSE * pixel, (sheet.width_mm, sheet.height_mm), width,
        shortest_mm=preset.dash_mm[0], longest_mm=preset.dash_mm[1], full=preset.lines_from, seed=recipe.seed,
    )  # fmt: skip
    cover(dashes, width, pixel, covered)
    return joined([*parts, dashes, *_mended(demand, covered, samples, spacing, recipe, pen, sheet)])


def _layer(
    sharp: Raster,
    covered: Raster,
    samples: Raster,
    spacing: float,
    before: float,
    reach: float,
    preset: InkPreset,
    pen: Pen,
    sheet: _Sheet,
) -> Lines:
    """Lines of one direction that bring what is covered up to the demand, or to the layer's reach."""
    width, pixel = pen.width_mm, sheet.pixel_mm
    seen = _seen(covered, EYE_WIDTHS * width / pixel)
    aim = np.minimum(sharp, reach)
    wanted = np.clip((aim - seen) / (1 - seen), 0, MOST_OF_A_LAYER)
    here = (wanted > preset.lines_from) & (sharp > before)
    asked = _seen(np.where(here, aim - seen, 0), FEEDBACK_WIDTHS * width / pixel)
    separation = np.where(here, width / np.maximum(wanted, 0.01), 0).astype(np.float32)
    lines = NO_LINES
    for attempt in range(ROUNDS):
        lines = hatch(
            samples, spacing, separation, pixel,
            min_length_mm=preset.min_length_mm, max_length_mm=preset.max_length_mm, min_radius_mm=preset.min_radius_mm,
        )  # fmt: skip
        if attempt == ROUNDS - 1 or not here.any():
            break
        after = covered.copy()
        cover(lines, width, pixel, after)
        got = _seen(np.where(here, after - covered, 0), FEEDBACK_WIDTHS * width / pixel)
        excess = np.clip(got / np.maximum(asked, 1e-3), 0.7, 1.4)
        separation *= excess ** np.float32(CORRECTION[min(attempt, 1)])
    return lines


def _mended(
    demand: Raster, covered: Raster, samples: Raster, spacing: float, recipe: InkRecipe, pen: Pen, sheet: _Sheet
) -> list[Lines]:
    """Strokes that fill what is left too light."""
    if not recipe.preset.mend_mm:
        return []
    sigma = MEND_WIDTHS * pen.width_mm
    blur = sigma / (sheet.pixel_mm * COARSE)
    ink, wanted = _blocks(covered), _blocks(demand)
    return [
        mend(
            samples,
            spacing,
            _blurred(1 - ink, blur),
            _blurred(1 - wanted, blur) * np.float32(MEND_LIGHT),
            ink,
            COARSE * sheet.pixel_mm,
            (sheet.width_mm, sheet.height_mm),
            pen.width_mm,
            sigma_mm=sigma,
            lengths_mm=recipe.preset.mend_mm,
            seed=recipe.seed,
        )
    ]


def _blurred(image: Raster, sigma: float) -> Raster:
    from scipy.ndimage import gaussian_filter

    blurred: Raster = gaussian_filter(image, sigma, mode="nearest")
    return blurred


def _blocks(image: Raster) -> Raster:
    """Means of COARSE × COARSE pixels; what is left over at the right and bottom is repeated."""
    rows, columns = image.shape
    padded = np.pad(image, ((0, -rows % COARSE), (0, -columns % COARSE)), mode="edge")
    means: Raster = padded.reshape(padded.shape[0] // COARSE, COARSE, -1, COARSE).mean(axis=(1, 3), dtype=np.float32)
    return means


def _seen(image: Raster, sigma: float) -> Raster:
    """A blur of `sigma` pixels, worked out on blocks, at full size."""
    rows, columns = image.shape
    small = Image.fromarray(_blurred(_blocks(image), sigma / COARSE))
    box = (0.0, 0.0, columns / COARSE, rows / COARSE)
    return np.array(small.resize((columns, rows), Image.Resampling.BILINEAR, box))


def _assemble(
    drawn: list[Lines], photo: Photo, recipe: InkRecipe, pens: PenSet, page: Page, sheet: _Sheet
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
    budgets = {"strokes": recipe.strokes, "max_length_mm": recipe.max_length_mm}
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
