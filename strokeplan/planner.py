"""From photo to plan: layer after layer, wide to fine (paper, "Image Stylization Filter").

For every layer the orientation field at its scale is computed (layer_fields.py) and its strokes are painted on one
canvas (layering.py). Fields of later layers are computed in threads while a layer is painted; the plan is the same for
any number of threads.

A preset whose lengths are relative is planned at the resolution that its finest brush needs (resolution.py), whatever
the photo's, so that the same photo at any size becomes the same strokes.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from strokeplan import budget, drawing, painting, pursuit, searching
from strokeplan.assembling import assemble, on_canvas
from strokeplan.canvas import unpack
from strokeplan.errors import InputError, StrokeplanWarning
from strokeplan.field import Orientation
from strokeplan.image import Photo, as_photo, load_photo
from strokeplan.importance import check_mask, load_mask
from strokeplan.ink_presets import InkPreset, InkRecipe, find_ink
from strokeplan.layer_fields import submit_fields
from strokeplan.layering import Job, Progress, canvas_error, paint_layers
from strokeplan.page import Page, parse_page
from strokeplan.palette import choose_colors
from strokeplan.pens import PenSet
from strokeplan.presets import Preset, Recipe, load_preset, load_recipe
from strokeplan.pressure import add_pressure
from strokeplan.resolution import load_for, working_copy, working_preset
from strokeplan.sheet import PAGE
from strokeplan.strokes import StrokePlan
from strokeplan.version import __version__
from strokeplan.workers import at_work

_COLOR = 2
"""What tells the chance in the colours of a layer from that in its cells."""


@dataclass(frozen=True, slots=True)
class Report:
    """What a finished plan cost, for whoever asks by `report=`."""

    seconds: dict[str, float]
    """Wall time by stage: "fields" (time waited for them) and "strokes"."""
    error: float
    """Mean RGB distance of photo and planning canvas."""
    canvas: NDArray[np.uint8]
    """The planning canvas, (h, w, 3)."""


def plan(
    image: str | os.PathLike[str] | ArrayLike | Photo,
    preset: str | os.PathLike[str] | Preset | Recipe | InkPreset | InkRecipe = "fine",
    seed: int | None = None,
    *,
    orientation: Orientation | None = None,
    strokes: int | None = None,
    detail: float | None = None,
    mask: str | os.PathLike[str] | ArrayLike | None = None,
    page: Page | str | None = None,
    pens: str | os.PathLike[str] | PenSet | None = None,
    max_length_mm: float | None = None,
    max_time_s: float | None = None,
    profile: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    report: Callable[[Report], None] | None = None,
) -> StrokePlan:
    """Plan the strokes of a photo (a path, an array, or a Photo) in the style of a preset.

    preset   a name, a .toml file, a Preset; or a plan's file, which gives its seed and budget of strokes too.
    seed     of all chance; by default that of the plan that the preset came from, else 0.
    strokes  at most so many: the best picture for that budget; strokes are then kept by what they gain.
    detail   0 (bold) to 1 (minute); 0.5 is the preset as it stands.
    mask     where detail matters: a picture file or an (h, w) array in 0..1 of the photo's proportions;
             1 matters most, 0.5 is neutral. It takes the place of the preset's own importance.

    A preset of ink makes a pen drawing in millimetres (see ink.py), for which there are
    page           the sheet and its margin, or its name ("A5", "200x300mm") with one of 15 mm; by default A4, turned
                   as the photo;
    pens           a set of pens (a name, a .toml file, a PenSet); by default the preset's;
    max_length_mm  how far the pens may draw: the best drawing for that much ink;
    max_time_s     how long the machine of `profile` may draw;
    profile        a machine (a name, a .toml file), whose page and pens are taken where none are given;
    and neither orientation, detail, mask, progress nor report.

    The same image, preset, options, seed and version give the same plan, whatever `threads` (default: one
    for each processor this process may use). `progress` is called now and then, `report` once at the end.
    Raises ImageError, PresetError, InputError.
    """
    if (inked := find_ink(preset)) is not None:
        _refuse("a preset of ink", orientation=orientation, detail=detail, mask=mask)
        inked = inked.changed(
            seed=seed,
            strokes=strokes,
            page=parse_page(page, f"{PAGE.margin_mm}mm") if isinstance(page, str) else page,
            pens=pens,
            max_length_mm=max_length_mm,
            max_time_s=max_time_s,
            profile=profile,
        )
        return drawing.draw(_photo(image), inked, threads=threads)
    given = {"max_length_mm": max_length_mm, "max_time_s": max_time_s, "profile": profile}
    _refuse("a preset of paint", page=page, pens=pens, **given)
    assert not isinstance(preset, InkPreset | InkRecipe)  # noqa: S101 (for the type checker: find_ink takes them)
    recipe = load_recipe(preset)
    seed = recipe.seed if seed is None else seed
    if seed < 0:
        raise InputError(f"seed {seed} is negative; give 0 or more")
    if threads is not None and threads < 1:
        raise InputError(f"threads {threads} is below 1")
    if recipe.mask is not None and mask is None:
        warnings.warn(
            f"the plan that the preset came from had a mask, {recipe.mask}; without it this one is another",
            StrokeplanWarning,
            stacklevel=2,
        )
    style, strokes = budget.within(recipe, strokes, detail)
    if orientation is not None:
        style = style.override({"orientation": orientation})
    photo = _photo(image, style)
    work = working_copy(photo, style)
    spare = max(work.width / photo.width, 1.0)
    job = Job(work, working_preset(style, work, spare), spare, seed, _mask(mask, photo), progress)
    with at_work(threads) as workers:
        layers, canvas = paint_layers(job, style, strokes, workers)
        if report is not None:
            report(Report(job.seconds, canvas_error(job.pixels, canvas, 1), unpack(canvas)))
        colours = [
            choose_colors(unpack(layer.colours), settings, job.palette, np.random.default_rng((seed, number, _COLOR)))
            for number, (layer, settings) in enumerate(zip(layers, job.preset.layers, strict=True), start=1)
        ]
        painted = assemble(work, job.preset, layers, colours)
        if style.pressure > 0:
            painted = add_pressure(
                painted, (field() for field in submit_fields(work, job.preset, workers)), style.pressure
            )
    settings = {
        "strokeplan": __version__,
        "seed": seed,
        "preset": msgspec.to_builtins(style),
        "resolved": msgspec.to_builtins(style.for_photo(photo.width, photo.height)),
    }
    if strokes is not None:
        settings["strokes"] = strokes
    if mask is not None:
        settings["mask"] = Path(mask).name if isinstance(mask, str | os.PathLike) else "an array"
    return on_canvas(painted, photo, settings)


def compiled() -> bool:
    """Whether the kernels are in Numba's cache; if not, the first plan compiles them."""
    return painting.compiled() and pursuit.compiled() and searching.compiled()


def warm_up() -> None:
    """Compile every kernel, or load it if it is cached, by plans of a few pixels."""
    picture = np.zeros((32, 32, 3), np.uint8)
    picture[:, 12:20] = 255
    plan(picture, "fine", threads=2)
    plan(picture, "fine", strokes=2, threads=1)
    for widest in (0, 2):  # the adaptive field has kernels of its own
        plan(picture, load_preset("paper").override({"max_integration_sigma": widest}), threads=2)


def load_kernels() -> None:
    """Load what planning by gain needs, by a plan of four pixels; quick if it is loaded already."""
    plan(np.zeros((2, 2, 3), np.uint8), "fine", threads=1)


def _refuse(what: str, **options: object) -> None:
    """Raise InputError if an option is given that `what` has no use for."""
    for name, value in options.items():
        if value is not None:
            raise InputError(
                f"{name.removesuffix('_mm').removesuffix('_s')} is not for {what}; leave it out, or give another preset"
            )


def _photo(image: str | os.PathLike[str] | ArrayLike | Photo, style: Preset | None = None) -> Photo:
    """The photo, decoded as far as a style needs it, or whole."""
    if isinstance(image, Photo):
        return image
    if not isinstance(image, str | os.PathLike):
        return as_photo(image)
    return load_photo(image) if style is None else load_for(image, style)


def _mask(mask: str | os.PathLike[str] | ArrayLike | None, photo: Photo) -> NDArray[np.float32] | None:
    """The mask as an array that fits the photo."""
    if mask is None:
        return None
    values = load_mask(mask) if isinstance(mask, str | os.PathLike) else np.asarray(mask)
    check_mask(values, photo.width, photo.height)
    return values
