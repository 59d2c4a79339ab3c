"""strokeplan inkscape install | path."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from strokeplan.cli.console import echo_written

app = typer.Typer(help="Install the extension for Inkscape, or show where it goes.", no_args_is_help=True)


@app.command()
def install(
    folder: Annotated[
        Path | None, typer.Option("--folder", metavar="DIR", help="By default the one that Inkscape names.")
    ] = None,
) -> None:
    """Put the extension into the user's folder: Extensions > Images > Paint with Strokes."""
    from strokeplan import inkscape

    echo_written(*inkscape.install(folder or inkscape.extensions_folder()))
    typer.echo("restart Inkscape, select a photo, then: Extensions > Images > Paint with Strokes")


@app.command()
def path() -> None:
    """Print the folder that Inkscape takes this user's extensions from."""
    from strokeplan.inkscape import extensions_folder

    typer.echo(extensions_folder())
