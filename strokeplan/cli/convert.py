"""Commands that start from a strokes file: render, export, info."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from strokeplan.cli.console import echo_written, file_line
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


def render(
    plan: PlanArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT", help="The picture to write: .png.")],
    width: Annotated[int | None, typer.Option("--width", help="Width in pixels; the height follows.")] = None,
    height: Annotated[int | None, typer.Option("--height", help="Height in pixels; the width follows.")] = None,
    scale: Annotated[float | None, typer.Option("--scale", help="Pixels per unit of the plan; by default 1.")] = None,
) -> None:
    """Paint a strokes file as a picture of any size."""
    from strokeplan import formats, rendering

    formats.check_picture(output)
    picture = rendering.render(formats.load(plan), width=width, height=height, scale=scale)
    formats.write(output, rendering.encode_png(picture))
    typer.echo(f"wrote {file_line(output)}, {picture.shape[1]} × {picture.shape[0]} pixels")


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
