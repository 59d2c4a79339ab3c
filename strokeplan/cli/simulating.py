"""strokeplan simulate PROFILE: a machine that is none, to rehearse with."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from strokeplan.cli.console import echo_written

if TYPE_CHECKING:
    from strokeplan.plotter.profile import Profile
    from strokeplan.plotter.simulating.firmware import Firmware


def simulate(
    profile: Annotated[str, typer.Argument(metavar="PROFILE", help="The machine: a profile, or a .toml file.")],
    port: Annotated[
        str, typer.Option("--port", metavar="pty|tcp[:PORT]", help="Where it listens: a pseudo-terminal or a TCP port.")
    ] = "pty",
    output: Annotated[
        list[Path] | None,
        typer.Option("--output", "-o", metavar="OUT", help="What was drawn, written at the end: .svg, .json, .png …"),
    ] = None,
    variant: Annotated[
        str | None,
        typer.Option("--variant", metavar="NAME", help="Another firmware of its kind; --variant ? lists them."),
    ] = None,
    baud: Annotated[int | None, typer.Option("--baud", help="Speed of its wire; by default the machine's own.")] = None,
) -> None:
    """Simulate a machine, in real time, on a port that `plot` and other programs can open. Ctrl-C ends it."""
    from strokeplan import formats
    from strokeplan.errors import InputError
    from strokeplan.files import check_writable
    from strokeplan.formats.options import ExportOptions
    from strokeplan.page import Page
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.simulating.drawing import as_plan
    from strokeplan.plotter.simulating.firmware import firmware, usual_baud
    from strokeplan.plotter.simulating.serving import opened, serve

    machine = load_profile(profile)
    device = firmware(machine, variant=variant)
    speed = usual_baud(machine) if baud is None else baud
    if not 50 <= speed <= 4_000_000:
        raise InputError(f"--baud {speed} is outside of 50..4000000")
    for path in output or ():
        formats.writer(path)
        check_writable(path)
    formats.prepare(output or ())

    def told(what: str) -> None:
        typer.echo(f"{what}; {_summary(device, machine)}", err=True)

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with opened(port) as server:
        typer.echo(f"{machine.description}: {server.url}")
        try:
            serve(device, server, speed, told=told, by_hand=True)
        except KeyboardInterrupt:
            typer.echo(f"ended; {_summary(device, machine)}", err=True)
    if output:
        plan = as_plan(device.drawn, machine)
        page = Page(plan.width, plan.height)
        for path in output:
            on_page = "page" in formats.writer(path).options  # its unit is the millimetre
            formats.save(plan, path, ExportOptions(page=page if on_page else None))
            echo_written(path)


def _summary(device: Firmware, machine: Profile) -> str:
    """What has been drawn so far, in a line."""
    drawn = device.drawn
    pens = f", pens {', '.join(map(str, sorted(set(drawn.slots))))}" if len(set(drawn.slots)) > 1 else ""
    bad = f"; refused to drawing: {', '.join(device.forbidden[:3])}" if device.forbidden else ""
    return f"{len(drawn):,} lines, {drawn.length_mm / 1000:.2f} m{pens}, pen {'down' if device.pen_down else 'up'}{bad}"
