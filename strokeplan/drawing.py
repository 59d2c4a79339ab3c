"""A pen drawing for a machine: its page, its pens, and what it can draw in a time.

A profile (plotter/profile.py) says how far the machine reaches, how wide its pens are and how it moves. A time is
that of the program that the machine would be given: strokes in its order, joined as it joins them, with all travel,
lifts and changes of the pen (plotter/estimate.py).
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from strokeplan import ink
from strokeplan.errors import InputError, PlotError
from strokeplan.image import Photo
from strokeplan.ink_budget import Budget
from strokeplan.ink_presets import InkRecipe
from strokeplan.page import Page
from strokeplan.pens import PenSet, load_pens
from strokeplan.sheet import PAGE, turned
from strokeplan.strokes import StrokePlan

if TYPE_CHECKING:
    from strokeplan.plotter.profile import Machine, Profile


def draw(
    photo: Photo,
    recipe: InkRecipe,
    *,
    threads: int | None = None,
    progress: Callable[[ink.Progress], None] | None = None,
) -> StrokePlan:
    """The pen drawing of a photo (see ink.draw), for the machine of the recipe's profile, if it names one.

    Raises InputError; PlotError for a page that the machine does not take.
    """
    profile = machine(recipe)
    if profile is None:
        return ink.draw(photo, recipe, threads=threads, progress=progress)
    if recipe.pens is None:
        recipe = recipe._replace(pens=pens_of(profile, load_pens(recipe.preset.pens)))
    sheet = recipe.page or page_for(photo, profile)
    check_reach(photo, sheet, profile)
    budgets = [] if recipe.max_time_s is None else [_time_budget(recipe.max_time_s, profile)]
    return ink.draw(photo, recipe, page=sheet, budgets=budgets, threads=threads, progress=progress)


def machine(recipe: InkRecipe) -> Profile | None:
    """The profile that a recipe names. Raises ProfileError, and InputError for a time that is none or nobody's."""
    seconds = recipe.max_time_s
    if seconds is not None and not (isfinite(seconds) and seconds > 0):
        raise InputError(f"max-time {seconds:g} s is none; give more than 0")
    if recipe.profile is None:
        if seconds is not None:
            raise InputError("max-time is that of a machine: give its --profile; `strokeplan profiles` lists them")
        return None
    from strokeplan.plotter.profile import load_profile

    return load_profile(recipe.profile)


def page_for(photo: Photo, profile: Profile, margin_mm: float = PAGE.margin_mm) -> Page:
    """The machine's first paper, or else all that it reaches, turned as the photo is."""
    if profile.papers:
        sheet = profile.papers[0].sheet
        sides = [sheet.width_mm, sheet.height_mm]
    else:
        sides = _reach(profile.machine)
    return turned(Page(sides[0], sides[1], margin_mm), photo.width, photo.height)


def _reach(machine: Machine) -> list[float]:
    """How far the machine gets along its axes from where the page's corner lies."""
    spans = zip(machine.axes, machine.offset_mm, machine.draw_spans, strict=True)
    to_corner = machine.origin.replace("upper", "up").replace("lower", "down").split("-")
    return [at - low if axis in to_corner else high - at for axis, at, (low, high) in spans]


def pens_of(profile: Profile, pens: PenSet) -> PenSet:
    """A set of pens, each as wide as the profile's pen of that name."""
    widths = {pen.name: pen.width_mm for pen in profile.pens if pen.width_mm is not None}
    wide = tuple(msgspec.structs.replace(pen, width_mm=widths.get(pen.name, pen.width_mm)) for pen in pens.pens)
    return msgspec.structs.replace(pens, pens=wide)


def time_of(plan: StrokePlan, profile: Profile) -> float:
    """Seconds that the machine needs for a plan that has the size of its page."""
    from strokeplan.plotter.estimate import estimate
    from strokeplan.plotter.program import program

    return estimate(program(plan, profile)).total_s if len(plan) else 0.0


def _time_budget(seconds: float, profile: Profile) -> Budget:
    return (lambda plan: time_of(plan, profile)), seconds


def check_reach(photo: Photo, page: Page, profile: Profile) -> None:
    """Raise PlotError if the machine does not reach all of the picture, before it is drawn."""
    from strokeplan.plotter.machine import page_transform

    transform = page_transform(page, profile)
    size = np.array([[0, 0], [photo.width, photo.height]], np.float64)
    corners = transform.points(page.fit(photo.width, photo.height).points(size))
    beyond = float(transform.outside(corners).max())
    if beyond > 0:
        raise PlotError(
            f"the picture goes {beyond:.2f} mm beyond the travel of {profile.name}, {transform.travel}; take a wider "
            f"--margin than {page.margin_mm:g} mm, or a smaller --page"
        )
