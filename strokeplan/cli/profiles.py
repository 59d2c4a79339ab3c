"""strokeplan profiles [show NAME | check FILE | new NAME]."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from strokeplan.cli.console import echo_written

if TYPE_CHECKING:
    from strokeplan.plotter.profile import Profile

app = typer.Typer(
    help="List the machines; show a profile; check or begin one of your own.", invoke_without_command=True
)


@app.callback()
def listing(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        from strokeplan.errors import ProfileError
        from strokeplan.plotter.profile import load_profile, names

        for name in names():
            try:
                typer.echo(f"{name:<17} {load_profile(name).description}")
            except ProfileError as error:  # one of the user's; the others are still there
                typer.echo(f"{name:<17} broken: {error}")


@app.command()
def show(name: Annotated[str, typer.Argument(metavar="NAME", help="A profile that ships, or one of yours.")]) -> None:
    """Print a profile with its comments: a start for one of your own."""
    from strokeplan.plotter.profile import source

    typer.echo(source(name), nl=False)


@app.command()
def check(file: Annotated[str, typer.Argument(metavar="NAME|FILE", help="A profile, or a file, .toml.")]) -> None:
    """Check a profile and say what it holds."""
    from strokeplan.plotter.profile import load_profile

    typer.echo(f"{file}: sound; {_summary(load_profile(file))}")


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What your machine shall be called.")],
    like: Annotated[str, typer.Option("--like", metavar="NAME", help="The profile to begin with.")] = "grbl_servo",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="By default in your own folder of profiles.")
    ] = None,
) -> None:
    """Begin a profile of your own from another one; a file that is there is left alone."""
    from strokeplan.plotter.profile import begin

    echo_written(begin(name, like, output))


def _summary(profile: Profile) -> str:
    machine, speeds = profile.machine, profile.speeds
    across, along = machine.x_mm[1] - machine.x_mm[0], machine.y_mm[1] - machine.y_mm[0]
    return (
        f"{profile.description}; travel {across:g} × {along:g} mm, "
        f"drawing at {speeds.draw_mm_min:g}, travelling at {speeds.travel_mm_min:g} mm/min"
    )
