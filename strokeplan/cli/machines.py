"""What `export` and `info` do for a machine: parse, call, report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from strokeplan.plotter.program import PlotOptions, Program
    from strokeplan.strokes import StrokePlan


def plot_options(
    page: str | None,
    margin: str | None,
    *,
    landscape: bool = False,
    rotate: int = 0,
    mirror: bool = False,
    scale: float | None = None,
    clip: bool = False,
    within: Path | None = None,
    by_colour: bool = False,
    keep_order: bool = False,
    slots: Sequence[str] | None = None,
) -> PlotOptions:
    """The options of a program, as the command line gives them."""
    from strokeplan.page import parse_page
    from strokeplan.plotter.layout import LayoutOptions, read_area
    from strokeplan.plotter.program import PlotOptions

    sheet = parse_page(page, margin, landscape=landscape)
    layout = LayoutOptions(sheet, rotate, mirror, scale, clip, None if within is None else read_area(within))
    return PlotOptions(layout, by_colour, keep_order, tuple(_slot(text) for text in slots or ()))


def _slot(text: str) -> tuple[str, int]:
    from strokeplan.errors import PlotError

    name, _, slot = text.rpartition("=")
    if not name or not slot.isdecimal() or not 1 <= int(slot) <= 99:
        raise PlotError(f"pen {text!r} is not NAME=SLOT; try black=1")
    return name, int(slot)


def export_machine(
    plan: Path, output: Sequence[Path], profile: str, options: PlotOptions, *, by_pen: bool, date: str | None
) -> list[Path]:
    """Write files for a machine, all or none, and say what it will do; what was written."""
    from strokeplan import formats
    from strokeplan.files import check_writable
    from strokeplan.plotter.files import check_suffix, outputs, parse_date
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program

    machine, day = load_profile(profile), parse_date(date)
    for path in output:
        check_suffix(path, machine)
        check_writable(path)
    job = program(formats.load(plan), machine, options)
    files = [file for path in output for file in outputs(job, path, by_pen=by_pen, date=day)]
    for path, _ in files:
        check_writable(path)
    for path, data in files:
        formats.write(path, data)
    typer.echo("\n".join(f"{name:<11} {value}" for name, value in program_rows(job)))
    return [path for path, _ in files]


def machine_rows(plan: StrokePlan, profile: str, options: PlotOptions) -> list[tuple[str, str]]:
    """What the machine of a profile would do with a plan, as (name, text)."""
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program

    return program_rows(program(plan, load_profile(profile), options))


def program_rows(job: Program) -> list[tuple[str, str]]:
    """What a machine does with a program, as (name, text)."""
    from strokeplan.plotter.estimate import estimate

    return [("machine", job.profile.description), ("page", job.transform.describe()), *estimate(job).rows()]
