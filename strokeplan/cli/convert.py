"""Commands that start from a strokes file: export, info."""

from __future__ import annotations

import typer

from strokeplan.cli.console import echo_written
from strokeplan.cli.options import (
    ClassesOption,
    ClipOption,
    ExportsOption,
    GroupBy,
    GroupOption,
    LandscapeOption,
    MarginOption,
    OutlineOption,
    PageOption,
    PlanArgument,
    PrecisionOption,
    UnitsOption,
)


def export(
    plan: PlanArgument,
    output: ExportsOption,
    page: PageOption = None,
    landscape: LandscapeOption = False,
    margin: MarginOption = None,
    units: UnitsOption = None,
    precision: PrecisionOption = None,
    group_by: GroupOption = GroupBy.layer,
    classes: ClassesOption = False,
    outline: OutlineOption = False,
    clip: ClipOption = False,
) -> None:
    """Write a strokes file in other formats; an option must be one that every output knows."""
    from strokeplan import formats
    from strokeplan.formats.options import ExportOptions
    from strokeplan.page import parse_page

    options = ExportOptions(
        precision=precision,
        units=units.value if units else None,
        page=parse_page(page, margin, landscape=landscape),
        group_by=group_by.value,
        classes=classes,
        outline=outline,
        clip=clip,
    )
    for path in output:
        formats.check_options(path, options)
        formats.check_target(path)
    formats.save_all(formats.load(plan), output, options)
    echo_written(*output)


def info(plan: PlanArgument) -> None:
    """Say what is in a strokes file."""
    from strokeplan import formats
    from strokeplan.strokes import describe

    typer.echo("\n".join(f"{name:<11} {value}" for name, value in describe(formats.load(plan))))
