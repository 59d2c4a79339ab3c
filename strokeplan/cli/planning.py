"""strokeplan plan."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING

import typer

from strokeplan.cli.console import begin, compile_kernels, drawing_bar, echo_written, planning_bar
from strokeplan.cli.options import (
    DetailOption,
    ImageArgument,
    InkProfileOption,
    LandscapeOption,
    MarginOption,
    MaskOption,
    MaxLengthOption,
    MaxTimeOption,
    OrientationOption,
    OutputsOption,
    PageOption,
    PaletteOption,
    PenOption,
    PensOption,
    PlanSeedOption,
    PresetOption,
    QuietOption,
    SetOption,
    StrokesOption,
    ThreadsOption,
)

if TYPE_CHECKING:
    from pathlib import Path

    from strokeplan.image import Photo
    from strokeplan.ink_presets import InkRecipe
    from strokeplan.page import Page
    from strokeplan.planner import Report
    from strokeplan.strokes import StrokePlan


DEFAULT_MARGIN = "15mm"
"""Of the page of a pen drawing, as ink.PAGE has it."""


def plan(
    image: ImageArgument,
    output: OutputsOption,
    preset: PresetOption = "fine",
    seed: PlanSeedOption = None,
    strokes: StrokesOption = None,
    detail: DetailOption = None,
    palette: PaletteOption = None,
    mask: MaskOption = None,
    orientation: OrientationOption = None,
    settings: SetOption = None,
    page: PageOption = None,
    landscape: LandscapeOption = False,
    margin: MarginOption = None,
    pen: PenOption = None,
    pens: PensOption = None,
    max_length: MaxLengthOption = None,
    max_time: MaxTimeOption = None,
    profile: InkProfileOption = None,
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> None:
    """Plan the strokes of a photo and write them in one or more formats."""
    began = perf_counter()
    import msgspec

    from strokeplan import budget, formats, presets
    from strokeplan.image import load_photo
    from strokeplan.ink_presets import find_ink
    from strokeplan.palette import parse_palette
    from strokeplan.resolution import load_for

    for path in output:
        formats.check_target(path, image)
    if (inked := find_ink(preset)) is not None:
        _refuse("ink", orientation=orientation, detail=detail, palette=palette, mask=mask)
        inked = _with_budgets(inked, seed, strokes, max_length, max_time, profile)
        photo = load_photo(image)
        inked = _on_paper(inked, photo, settings, (page, margin, landscape), pen, pens)
        _draw(photo, inked, output, threads, quiet, began)
        return
    given = {"landscape": landscape or None, "max-length": max_length, "max-time": max_time, "profile": profile}
    _refuse("paint", page=page, margin=margin, pen=pen, pens=pens, **given)
    recipe = presets.load_recipe(preset)
    style = presets.style(recipe.preset, settings)
    if palette is not None:
        style = style.override(msgspec.to_builtins(parse_palette(palette)))
    recipe = recipe._replace(preset=style)
    planned, most = budget.within(recipe, strokes, detail)
    # While this thread imports Numba.
    reading = begin(load_for, image, planned)
    from strokeplan import planner

    waiting = perf_counter()
    photo = reading.result()
    read = perf_counter() - waiting
    formats.check_canvas(output, photo.width, photo.height)
    compile_kernels("planner", recipe, strokes, detail, mask is not None)
    # While this thread runs kernels, for which no other thread of Python has to wait.
    if planned.keep == "gain" and not budget.searched(planned, most):
        begin(planner.load_kernels)
    begin(formats.prepare, output)
    reports: list[Report] = []
    with planning_bar(quiet) as progress:
        painted = planner.plan(
            photo,
            recipe,
            seed,
            orientation=orientation.value if orientation else None,
            strokes=strokes,
            detail=detail,
            mask=mask,
            threads=threads,
            progress=progress,
            report=None if quiet else reports.append,
        )
    writing = perf_counter()
    formats.save_all(painted, output)
    if not quiet:
        seconds = {
            "read": read,
            **reports[0].seconds,
            "write": perf_counter() - writing,
            "total": perf_counter() - began,
        }
        typer.echo(_summary(painted, reports[0].error, seconds))
        echo_written(*output)


def _refuse(medium: str, **options: object) -> None:
    """Raise InputError if an option is given that presets of that medium have no use for."""
    from strokeplan.errors import InputError

    for name, value in options.items():
        if value is not None:
            other = "paint" if medium == "ink" else "ink (engraving, for one)"
            raise InputError(f"--{name} is not for presets of {medium}; leave it out, or give a preset of {other}")


def _with_budgets(
    recipe: InkRecipe,
    seed: int | None,
    strokes: int | None,
    max_length: str | None,
    max_time: str | None,
    profile: str | None,
) -> InkRecipe:
    """A recipe with the seed and the budgets of the command line."""
    from strokeplan.ink_budget import parse_time
    from strokeplan.page import parse_length

    return recipe.changed(
        seed=seed,
        strokes=strokes,
        max_length_mm=None if max_length is None else parse_length(max_length, "max-length"),
        max_time_s=None if max_time is None else parse_time(max_time),
        profile=profile,
    )


def _on_paper(
    recipe: InkRecipe,
    photo: Photo,
    settings: list[str] | None,
    page: tuple[str | None, str | None, bool],
    pen: str | None,
    pens: str | None,
) -> InkRecipe:
    """A recipe with what the command line changes in its style, page and pens."""
    from strokeplan import drawing
    from strokeplan.ink_presets import override_ink
    from strokeplan.page import parse_length, parse_page
    from strokeplan.pens import load_pens
    from strokeplan.presets import parse_assignments

    machine = drawing.machine(recipe)
    size, margin, landscape = page
    if machine is not None and size is None and margin is not None:
        sheet: Page | None = drawing.page_for(photo, machine, parse_length(margin, "margin"))
    else:
        sheet = parse_page(size, DEFAULT_MARGIN if size and margin is None else margin, landscape=landscape)
    style = override_ink(recipe.preset, parse_assignments(settings or []))
    chosen = load_pens(pens) if pens else recipe.pens or load_pens(style.pens)
    if pen:
        chosen = chosen.with_width(parse_length(pen, "pen"))
    elif machine is not None and (pens or recipe.pens is None):
        chosen = drawing.pens_of(machine, chosen)
    return recipe._replace(preset=style).changed(page=sheet, pens=chosen)


def _draw(photo: Photo, recipe: InkRecipe, output: list[Path], threads: int | None, quiet: bool, began: float) -> None:
    """Draw a photo in ink and write it."""
    from strokeplan import drawing, formats, ink_budget
    from strokeplan.plotter.estimate import clock

    compile_kernels("ink")
    with drawing_bar(quiet) as progress:
        drawn = drawing.draw(photo, recipe, threads=threads, progress=progress)
    formats.save_all(drawn, output)
    if not quiet:
        metres = ink_budget.length_mm(drawn) / 1000
        machine = drawing.machine(recipe)
        told = [f"{len(drawn):,} strokes, {metres:.1f} m of ink"]
        if machine is not None:
            told.append(f"{clock(drawing.time_of(drawn, machine))} with {machine.name}")
        typer.echo(", ".join([*told, f"{perf_counter() - began:.1f} s"]))
        echo_written(*output)


def _summary(plan: StrokePlan, error: float, seconds: dict[str, float]) -> str:
    laid = " + ".join(f"{layer.last - layer.first:,}" for layer in plan.layers)
    return "\n".join(
        (
            f"{len(plan):,} strokes ({laid}), {plan.cubics:,} cubics, mean RGB error {error:.1f}",
            " · ".join(f"{stage} {spent:.2f} s" for stage, spent in seconds.items()),
        )
    )
