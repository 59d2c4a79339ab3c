"""Commands that start from a strokes file: export, info."""

from __future__ import annotations

import typer

from strokeplan.cli.console import echo_written
from strokeplan.cli.options import OutputsOption, PlanArgument


def export(plan: PlanArgument, output: OutputsOption) -> None:
    """Write a strokes file in other formats."""
    from strokeplan import formats

    for path in output:
        formats.check_target(path)
    formats.save_all(formats.load(plan), output)
    echo_written(*output)


def info(plan: PlanArgument) -> None:
    """Say what is in a strokes file."""
    from strokeplan import formats
    from strokeplan.strokes import describe

    typer.echo("\n".join(f"{name:<11} {value}" for name, value in describe(formats.load(plan))))
