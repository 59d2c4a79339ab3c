"""strokeplan plan."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING

import typer

from strokeplan.cli.console import compile_kernels, echo_written, planning_bar
from strokeplan.cli.options import (
    ImageArgument,
    OrientationOption,
    OutputsOption,
    PresetOption,
    QuietOption,
    SeedOption,
    SetOption,
    ThreadsOption,
)

if TYPE_CHECKING:
    from strokeplan.planner import Report
    from strokeplan.strokes import StrokePlan


def plan(
    image: ImageArgument,
    output: OutputsOption,
    preset: PresetOption = "paper",
    seed: SeedOption = 0,
    orientation: OrientationOption = None,
    settings: SetOption = None,
    threads: ThreadsOption = None,
    quiet: QuietOption = False,
) -> None:
    """Plan the strokes of a photo and write them in one or more formats."""
    begin = perf_counter()
    from strokeplan import formats, planner, presets
    from strokeplan.image import load_photo

    for path in output:
        formats.check_target(path, image)
    style = presets.style(preset, settings)
    reading = perf_counter()
    photo = load_photo(image)
    read = perf_counter() - reading
    formats.check_canvas(output, photo.width, photo.height)
    compile_kernels()
    reports: list[Report] = []
    with planning_bar(quiet) as progress:
        strokes = planner.plan(
            photo,
            style,
            seed,
            orientation=orientation.value if orientation else None,
            threads=threads,
            progress=progress,
            report=reports.append,
        )
    writing = perf_counter()
    formats.save_all(strokes, output)
    if not quiet:
        seconds = {
            "read": read,
            **reports[0].seconds,
            "write": perf_counter() - writing,
            "total": perf_counter() - begin,
        }
        typer.echo(_summary(strokes, reports[0].error, seconds))
        echo_written(*output)


def _summary(plan: StrokePlan, error: float, seconds: dict[str, float]) -> str:
    laid = " + ".join(f"{layer.last - layer.first:,}" for layer in plan.layers)
    return "\n".join(
        (
            f"{len(plan):,} strokes ({laid}), {plan.cubics:,} cubics, mean RGB error {error:.1f}",
            " · ".join(f"{stage} {spent:.2f} s" for stage, spent in seconds.items()),
        )
    )
