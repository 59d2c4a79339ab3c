"""What `export`, `info` and `preview` do for a machine: parse, call, report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from strokeplan.cli.console import echo_written
from strokeplan.cli.options import GroupBy

if TYPE_CHECKING:
    from strokeplan.cli.options import LayoutGroup, LinesGroup
    from strokeplan.pens import PenSet
    from strokeplan.plotter.options import OwnPens, PlotOptions
    from strokeplan.plotter.program import Program
    from strokeplan.strokes import StrokePlan

FOR_MACHINES = "{0} is for machines: give --profile"


def plot_options(layout: LayoutGroup, lines: LinesGroup) -> PlotOptions:
    """The options of a program, as the command line gives them. Raises InputError, PlotError."""
    from strokeplan.page import parse_length, parse_page
    from strokeplan.plotter.layout import LayoutOptions, read_area
    from strokeplan.plotter.options import PlotOptions

    sheet = parse_page(layout.page, layout.margin, landscape=layout.landscape)
    area = None if layout.within is None else read_area(layout.within)
    return PlotOptions(
        layout=LayoutOptions(sheet, layout.rotate, layout.mirror, layout.scale, layout.clip, area),
        by_colour=lines.group_by is GroupBy.colour,
        keep_order=lines.keep_order,
        slots=tuple(_slot(text) for text in lines.pen or ()),
        strokes=lines.strokes.value if lines.strokes else "centre",
        hidden=lines.hidden.value if lines.hidden else None,
        pens=None if lines.pens is None else _pens(lines.pens),
        pen_width_mm=None if lines.pen_width is None else parse_length(lines.pen_width, "pen width"),
    )


def _slot(text: str) -> tuple[str, int]:
    from strokeplan.errors import PlotError

    name, _, slot = text.rpartition("=")
    if not name or not slot.isdecimal() or not 1 <= int(slot) <= 99:
        raise PlotError(f"pen {text!r} is not NAME=SLOT; try black=1")
    return name, int(slot)


def _pens(text: str) -> PenSet | OwnPens | int:
    from strokeplan.errors import InputError
    from strokeplan.pens import load_pens

    if text == "profile":
        return "profile"
    try:
        return int(text[:9]) if text.isdecimal() else load_pens(text)
    except InputError as error:
        raise InputError(f"{error}, a number of pens, or 'profile'") from None


def export_machine(
    plan: Path,
    output: Sequence[Path],
    profile: str,
    options: PlotOptions,
    *,
    by_pen: bool,
    date: str | None,
    dry_run: bool,
) -> None:
    """Write files for a machine, all or none, and say what it will do; a dry run only says it."""
    from strokeplan import formats
    from strokeplan.files import check_writable
    from strokeplan.plotter.files import check_suffix, outputs, parse_date
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program

    machine, day = load_profile(profile), parse_date(date)
    for path in output:
        check_suffix(path, machine)
        check_writable(path, plan)
    job = program(formats.load(plan), machine, options)
    files = [file for path in output for file in outputs(job, path, by_pen=by_pen, date=day)]
    for path, _ in files:
        check_writable(path, plan)
    echo_report(job)
    if dry_run:
        typer.echo("dry run: nothing is written")
        return
    for path, data in files:
        formats.write(path, data)
    echo_written(*(path for path, _ in files))


def echo_report(job: Program) -> None:
    """Print the transform, bounds and estimate of a program: all that a dry run does."""
    from strokeplan.plotter.report import report

    echo_rows(report(job))


def echo_rows(rows: Sequence[tuple[str, str]]) -> None:
    typer.echo("\n".join(f"{name:<11} {value}" for name, value in rows))


def machine_rows(plan: StrokePlan, profile: str, options: PlotOptions) -> list[tuple[str, str]]:
    """What the machine of a profile would do with a plan, as (name, text)."""
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program
    from strokeplan.plotter.report import report

    return report(program(plan, load_profile(profile), options))


def refuse(given: LayoutGroup | LinesGroup | Mapping[str, object], message: str, *, but: Sequence[str] = ()) -> None:
    """Raise InputError for the first option that has no place here, `but` for some."""
    from strokeplan.errors import InputError

    for name, value in (given if isinstance(given, Mapping) else vars(given)).items():
        if name not in but and value not in (None, False, 0, GroupBy.layer):
            raise InputError(message.format(name.replace("_", "-")))
