"""Commands that set a machine up before it draws: ports, jog, home, frame, origin."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Annotated

import typer

from strokeplan.cli.jogging import jog_by_keys, need_terminal, put_corner
from strokeplan.cli.machines import plot_options
from strokeplan.cli.options import HomeOption, LayoutGroup, LinesGroup, MachineOption, PlanArgument, PortGroup, grouped
from strokeplan.cli.session import at_machine, where

if TYPE_CHECKING:
    from strokeplan.plotter.driving.setup import Session
    from strokeplan.plotter.profile import Point, Profile

AtOption = Annotated[
    str | None,
    typer.Option("--at", metavar="X,Y", help="Where the pen stands now, in mm, for a machine that does not know."),
]


def ports(
    ask: Annotated[
        bool,
        typer.Option("--ask", help="Open each port and ask who is there; boards of the Arduino kind start anew by it."),
    ] = False,
) -> None:
    """List what is plugged in: ports, recognised by their USB ids."""
    from strokeplan.errors import DriveError
    from strokeplan.plotter.driving.ports import ask as asked
    from strokeplan.plotter.driving.ports import plugged_in
    from strokeplan.plotter.driving.transport import open_port

    found = plugged_in()
    if not found:
        typer.echo("no serial port is there; is the machine plugged in and switched on?", err=True)
    for port in found:
        said = ""
        if ask:
            try:
                answer = asked(lambda baud, device=port.device: open_port(device, baud))  # type: ignore[misc]
                said = f"; answers as {answer[0]}: {answer[1]}" if answer else "; says nothing that is known"
            except DriveError as error:
                said = f"; {error}"
        typer.echo(f"{port.device:<14} {port.describe()}{said}")


@grouped
def jog(
    profile: MachineOption,
    by: Annotated[
        list[str] | None,
        typer.Argument(metavar="X Y", help="By how much, in mm of the machine; none: with the arrow keys."),
    ] = None,
    to: Annotated[str | None, typer.Option("--to", metavar="X,Y", help="To a place instead, in mm.")] = None,
    home: HomeOption = False,
    at: AtOption = None,
    *,
    reached: PortGroup,
) -> None:
    """Move the pen, up, within the travel of the profile."""
    from strokeplan.errors import InputError
    from strokeplan.plotter.driving.setup import check_reach
    from strokeplan.plotter.profile import load_profile

    machine = load_profile(profile)
    if by and to is not None:
        raise InputError("give X Y, or --to X,Y, not both")
    step = _numbers("X Y", ",".join(by)) if by else None
    place = None if to is None else _numbers("--to", to)
    start = _place(machine, at)
    if place is not None:
        check_reach(machine, place)
    if step is not None:
        _check_step(machine, start, step)
    if step is None and place is None:
        need_terminal("jog without X Y")
    with at_machine(machine, reached, home=home, at=start) as session:
        if step is not None:
            place = session.at[0] + step[0], session.at[1] + step[1]
        if place is not None:
            session.go(*place)
        else:
            jog_by_keys(session)
        typer.echo(where(session))


@grouped
def home(profile: MachineOption, *, reached: PortGroup) -> None:
    """Have the machine look for its switches, after which it knows where it is."""
    from strokeplan.plotter.profile import load_profile

    with at_machine(load_profile(profile), reached, home=True) as session:
        typer.echo(f"home; {where(session)}")


@grouped
def origin(
    profile: MachineOption,
    home: HomeOption = False,
    save: Annotated[
        bool,
        typer.Option("--save", help="Write the place into your own profile instead, for a machine that knows places."),
    ] = False,
    *,
    reached: PortGroup,
) -> None:
    """Let the page's origin corner be where the pen stands; nothing is written into the machine."""
    from strokeplan.plotter.driving.setup import check_corner
    from strokeplan.plotter.profile import load_profile

    machine = load_profile(profile)
    check_corner(machine)
    with at_machine(machine, reached, home=home) as session:
        if save:
            _save_corner(session, profile)
        else:
            put_corner(session)


@grouped
def frame(
    plan: PlanArgument,
    profile: MachineOption,
    times: Annotated[int, typer.Option("--times", min=1, max=99, help="Go around so often.")] = 1,
    home: HomeOption = False,
    *,
    reached: PortGroup,
    layout: LayoutGroup,
) -> None:
    """Walk around the drawing, pen up, as `plot` would lay it on the sheet; and back."""
    from strokeplan import formats
    from strokeplan.plotter.driving.setup import corners
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program

    machine = load_profile(profile)
    drawing = program(formats.load(plan), machine, plot_options(layout, LinesGroup(keep_order=True)))
    way = corners(drawing)
    (left, low), (right, high) = way[0], way[2]
    typer.echo(f"{'page':<11} {drawing.transform.describe()}")
    typer.echo(f"{'drawing':<11} X {left:.2f}..{right:.2f}, Y {low:.2f}..{high:.2f} mm")
    with at_machine(machine, reached, home=home) as session:
        for _ in range(times):
            session.walk(way)
        typer.echo(where(session))


def _save_corner(session: Session, name: str) -> None:
    """Write where the pen stands as the page's corner into the user's profile. Raises InputError."""
    from strokeplan.errors import InputError
    from strokeplan.plotter.driving.tuning import saved

    if not session.sure:
        raise InputError(f"--save: {session.profile.name} does not know where it stands; home it first (--home)")
    path, begun = saved(name, "machine", "offset_mm", [round(at, 2) for at in session.at])
    new = ", a copy that goes before the one that ships" if begun else ""
    typer.echo(f"wrote offset_mm = [{session.at[0]:.2f}, {session.at[1]:.2f}] to {path}{new}")


def _numbers(what: str, text: str) -> Point:
    """Two numbers with a comma between. Raises InputError."""
    from strokeplan.errors import InputError

    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"{what} {text!r} is not two numbers, like 10,-5") from None
    if not (isfinite(x) and isfinite(y)):
        raise InputError(f"{what} {text!r} is not two numbers, like 10,-5")
    return x, y


def _place(machine: Profile, at: str | None) -> Point | None:
    """What --at says. Raises InputError, PlotError."""
    from strokeplan.plotter.driving.setup import check_reach

    if at is None:
        return None
    place = _numbers("--at", at)
    check_reach(machine, place)
    return place


def _check_step(machine: Profile, start: Point | None, step: Point) -> None:
    """Raise PlotError for a step that is too far wherever the machine stands, before a port is opened."""
    from strokeplan.errors import PlotError
    from strokeplan.plotter.driving.setup import check_reach

    if start is not None:
        check_reach(machine, (start[0] + step[0], start[1] + step[1]))
    spans = machine.machine.x_mm, machine.machine.y_mm
    for axis, by, (low, high) in zip("XY", step, spans, strict=True):
        if abs(by) > high - low:
            raise PlotError(f"{axis} by {by:g} mm is more than the travel of {machine.name}, {high - low:g} mm")
