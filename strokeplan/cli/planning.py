"""strokeplan plan."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING

import typer

from strokeplan.cli.console import begin, compile_kernels, echo_written, planning_bar
from strokeplan.cli.options import (
    DetailOption,
    ImageArgument,
    LandscapeOption,
    MarginOption,
    MaskOption,
    MaxLengthOption,
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

    from strokeplan.ink_presets import InkRecipe
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
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> None:
    """Plan the strokes of a photo and write them in one or more formats."""
    began = perf_counter()
    import msgspec

    from strokeplan import budget, formats, presets
    from strokeplan.ink_presets import find_ink
    from strokeplan.palette import parse_palette
    from strokeplan.resolution import load_for

    for path in output:
        formats.check_target(path, image)
    if (inked := find_ink(preset)) is not None:
        _refuse("ink", orientation=orientation, detail=detail, palette=palette, mask=mask)
        inked = _ink_recipe(inked, seed, strokes, settings, (page, margin, landscape), pen, pens, max_length)
        _draw(image, inked, output, quiet, began)
        return
    given = {"landscape": landscape or None, "max-length": max_length}
    _refuse("paint", page=page, margin=margin, pen=pen, pens=pens, **given)
    recipe = presets.load_recipe(preset)
    style = presets.style(recipe.preset, settings)
    if palette is not None:
        style = style.override(msgspec.to_builtins(parse_palette(palette)))
    recipe = recipe._replace(preset=style)
    # While this thread imports Numba.
    reading = begin(load_for, image, budget.within(recipe, strokes, detail)[0])
    from strokeplan import planner

    waiting = perf_counter()
    photo = reading.result()
    read = perf_counter() - waiting
    formats.check_canvas(output, photo.width, photo.height)
    compile_kernels()
    # While this thread runs kernels, for which no other thread of Python has to wait.
    if style.keep == "gain":
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


def _ink_recipe(
    recipe: InkRecipe,
    seed: int | None,
    strokes: int | None,
    settings: list[str] | None,
    page: tuple[str | None, str | None, bool],
    pen: str | None,
    pens: str | None,
    max_length: str | None,
) -> InkRecipe:
    """A recipe with what the command line changes in it."""
    from strokeplan.ink_presets import override_ink
    from strokeplan.page import parse_length, parse_page
    from strokeplan.pens import load_pens
    from strokeplan.presets import parse_assignments

    size, margin, landscape = page
    sheet = parse_page(size, DEFAULT_MARGIN if size and margin is None else margin, landscape=landscape)
    style = override_ink(recipe.preset, parse_assignments(settings or []))
    chosen = load_pens(pens) if pens else recipe.pens or load_pens(style.pens)
    return recipe._replace(preset=style).changed(
        seed=seed,
        strokes=strokes,
        page=sheet,
        pens=chosen.with_width(parse_length(pen, "pen")) if pen else chosen,
        max_length_mm=None if max_length is None else parse_length(max_length, "max-length"),
    )


def _draw(image: Path, recipe: InkRecipe, output: list[Path], quiet: bool, began: float) -> None:
    """Draw a photo in ink and write it."""
    from strokeplan import formats
    from strokeplan.image import load_photo

    photo = load_photo(image)
    from strokeplan import ink

    compile_kernels("ink")
    drawing = ink.draw(photo, recipe)
    formats.save_all(drawing, output)
    if not quiet:
        metres = ink.length_mm(drawing) / 1000
        typer.echo(f"{len(drawing):,} strokes, {metres:.1f} m of ink, {perf_counter() - began:.1f} s")
        echo_written(*output)


def _summary(plan: StrokePlan, error: float, seconds: dict[str, float]) -> str:
    laid = " + ".join(f"{layer.last - layer.first:,}" for layer in plan.layers)
    return "\n".join(
        (
            f"{len(plan):,} strokes ({laid}), {plan.cubics:,} cubics, mean RGB error {error:.1f}",
            " · ".join(f"{stage} {spent:.2f} s" for stage, spent in seconds.items()),
        )
    )
