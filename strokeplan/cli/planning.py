"""strokeplan plan."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING

import typer

from strokeplan.cli.console import begin, compile_kernels, echo_written, planning_bar
from strokeplan.cli.options import (
    DetailOption,
    ImageArgument,
    MaskOption,
    OrientationOption,
    OutputsOption,
    PaletteOption,
    PlanSeedOption,
    PresetOption,
    QuietOption,
    SetOption,
    StrokesOption,
    ThreadsOption,
)

if TYPE_CHECKING:
    from strokeplan.planner import Report
    from strokeplan.strokes import StrokePlan


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
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> None:
    """Plan the strokes of a photo and write them in one or more formats."""
    began = perf_counter()
    import msgspec

    from strokeplan import budget, formats, presets
    from strokeplan.palette import parse_palette
    from strokeplan.resolution import load_for

    for path in output:
        formats.check_target(path, image)
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
    begin(formats.prepare, output)  # while kernels run
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
            report=reports.append,
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


def _summary(plan: StrokePlan, error: float, seconds: dict[str, float]) -> str:
    laid = " + ".join(f"{layer.last - layer.first:,}" for layer in plan.layers)
    return "\n".join(
        (
            f"{len(plan):,} strokes ({laid}), {plan.cubics:,} cubics, mean RGB error {error:.1f}",
            " · ".join(f"{stage} {spent:.2f} s" for stage, spent in seconds.items()),
        )
    )
