"""strokeplan presets [show NAME | check FILE]."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="List the styles; show one; check a file of your own.", invoke_without_command=True)


@app.callback()
def listing(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        from strokeplan.ink_presets import find_ink, ink_names
        from strokeplan.presets import load_preset, names

        for name in names():
            typer.echo(f"{name:<17} {load_preset(name).description}")
        for name in ink_names():
            found = find_ink(name)
            typer.echo(f"{name:<17} Ink: {found.preset.description if found else ''}")


@app.command()
def show(name: Annotated[str, typer.Argument(metavar="NAME", help="A preset that ships with strokeplan.")]) -> None:
    """Print a shipped preset: a start for one of your own."""
    from strokeplan.ink_presets import ink_names, ink_source
    from strokeplan.presets import source

    typer.echo(ink_source(name) if name in ink_names() else source(name), nl=False)


@app.command()
def check(file: Annotated[Path, typer.Argument(metavar="FILE", help="A preset file, .toml.")]) -> None:
    """Check a preset file and say what it holds."""
    from strokeplan.ink_presets import find_ink
    from strokeplan.presets import load_preset

    if (ink := find_ink(file)) is not None:
        reaches = ", ".join(f"{layer.reach:g}" for layer in ink.preset.layers)
        typer.echo(f"{file}: sound; ink in {len(ink.preset.layers)} layers that reach {reaches} of the paper")
        return
    preset = load_preset(file)
    widths = ", ".join(f"{layer.width:g}" for layer in preset.layers)
    typer.echo(f"{file}: sound; {len(preset.layers)} layers of width {widths}, lengths in {preset.lengths}")
