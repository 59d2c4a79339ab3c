"""strokeplan render and strokeplan brushes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from strokeplan.cli.console import file_line, painting_bar
from strokeplan.cli.options import PlanArgument, QuietOption

SIZES = "in pixels, or on paper: 297mm, 29.7cm, 11.7in with --dpi; the other side follows."


def render(
    plan: PlanArgument,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", help="The picture to write: .png, .tif, .jpg or .webp.")
    ],
    width: Annotated[str | None, typer.Option("--width", metavar="SIZE", help=f"Width {SIZES}")] = None,
    height: Annotated[str | None, typer.Option("--height", metavar="SIZE", help=f"Height {SIZES}")] = None,
    scale: Annotated[float | None, typer.Option("--scale", help="Pixels per unit of the plan; by default 1.")] = None,
    dpi: Annotated[float | None, typer.Option("--dpi", help="Pixels per inch on paper; the file says so too.")] = None,
    brush: Annotated[
        str,
        typer.Option(
            "--brush",
            "-b",
            metavar="NAME[:KEY=VALUE,…]",
            help="What paints: bristle, or bristle:hairs=40,load=0.6; `strokeplan brushes` lists all.",
        ),
    ] = "round",
    region: Annotated[
        str | None,
        typer.Option(
            "--region", metavar="X,Y,W,H", help="Only this, in units of the plan or percent: 25%,25%,50%,50%."
        ),
    ] = None,
    background: Annotated[
        str | None,
        typer.Option(
            "--background", metavar="COLOUR|IMAGE", help="#faf0e6, teal, transparent, or a picture file under it all."
        ),
    ] = None,
    layers: Annotated[
        str | None, typer.Option("--layers", metavar="1,3-5,NAME", help="Only these layers, by number or name.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option("--threads", help="Threads to use, by default all; the picture is the same.")
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Paint a strokes file as a picture of any size, with any brush."""
    from strokeplan import formats
    from strokeplan.files import atomic_write
    from strokeplan.rendering import pictures, raster, view

    pictures.picture_format(output)
    formats.check_target(output, plan)
    if dpi is not None:
        view.check_dpi(dpi)
    strokes = formats.load(plan)
    shown = view.view(
        strokes,
        width=None if width is None else view.parse_side(width, dpi, "--width"),
        height=None if height is None else view.parse_side(height, dpi, "--height"),
        scale=scale,
        region=None if region is None else view.parse_region(region, strokes),
    )
    work = raster.job(
        strokes, shown, brush=brush, background=background, layers=None if layers is None else view.parse_layers(layers)
    )
    pictures.check_picture(output, shown, work.channels)
    if not work.compiled:
        typer.echo("compiling the brush for this machine, once: some ten seconds", err=True)
    with atomic_write(output) as stream, painting_bar(quiet) as progress:
        pictures.write_picture(stream, output, work, dpi=dpi, threads=threads, progress=progress)
    if not quiet:
        typer.echo(f"wrote {file_line(output)}, {shown.width} × {shown.height} pixels")


def brushes() -> None:
    """List the brushes and what can be set on them."""
    from strokeplan.rendering.brushes import described

    for name, what, settings in described():
        typer.echo(f"{name:<9} {what}")
        for key, default, meaning in settings:
            typer.echo(f"    {f'{key}={default}':<16} {meaning}")
