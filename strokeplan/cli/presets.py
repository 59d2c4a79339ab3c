"""strokeplan presets [show NAME | check FILE]."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="List the styles; show one; check a file of your own.", invoke_without_command=True)


@app.callback()
def listing(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        from strokeplan.presets import load_preset, names

        for name in names():
            typer.echo(f"{name:<17} {load_preset(name).description}")


@app.command()
def show(name: Annotated[str, typer.Argument(metavar="NAME", help="A preset that ships with strokeplan.")]) -> None:
    """Print a shipped preset: a start for one of your own."""
    from strokeplan.presets import source

    typer.echo(source(name), nl=False)


@app.command()
def check(file: Annotated[Path, typer.Argument(metavar="FILE", help="A preset file, .toml.")]) -> None:
    """Check a preset file and say what it holds."""
    from strokeplan.presets import load_preset

    preset = load_preset(file)
    widths = ", ".join(f"{layer.width:g}" for layer in preset.layers)
    typer.echo(f"{file}: sound; {len(preset.layers)} layers of width {widths}, lengths in {preset.lengths}")
