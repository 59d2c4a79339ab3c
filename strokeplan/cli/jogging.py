"""Moving the pen by the keys of a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from strokeplan.cli.session import where

if TYPE_CHECKING:
    from strokeplan.plotter.driving.setup import Session

STEPS_MM = (0.1, 0.5, 1.0, 5.0, 10.0, 50.0)
JOG_KEYS = (
    "arrows move, 1 to 6 or + and - the step, u and d the pen, o origin here, h home, 0 to X0 Y0; Enter or q ends"
)


def jog_by_keys(session: Session) -> None:
    """Move by the arrow keys until someone presses Enter."""
    from strokeplan.cli.keys import Keys
    from strokeplan.cli.operator import single_keys
    from strokeplan.errors import InputError
    from strokeplan.plotter.driving.setup import towards

    keys, size = Keys(), STEPS_MM.index(1.0)
    typer.echo(f"keys: {JOG_KEYS}", err=True)
    with single_keys(keys.live):
        typer.echo(f"{where(session)}; step {STEPS_MM[size]:g} mm", err=True)
        while keys.live:
            session.rest(0.05)
            for key in keys.typed():
                try:
                    if key in ("\r", "\n", "q"):
                        return
                    if key in ("up", "down", "left", "right"):
                        x, y = towards(session.profile, key)
                        step = STEPS_MM[size]
                        session.go(round(session.at[0] + x * step, 3), round(session.at[1] + y * step, 3))
                    elif key in "+=-_":
                        size = min(max(size + (1 if key in "+=" else -1), 0), len(STEPS_MM) - 1)
                    elif key in "123456":
                        size = int(key) - 1
                    elif not _acted(session, key):
                        continue
                    typer.echo(f"{where(session)}; step {STEPS_MM[size]:g} mm", err=True)
                except InputError as error:
                    typer.echo(f"note: {error}", err=True)


def _acted(session: Session, key: str) -> bool:
    """Do what a letter stands for; whether it stands for something."""
    if key == "u":
        session.up()
    elif key == "d":
        session.lower()
    elif key == "0":
        session.go(0.0, 0.0)
    elif key == "h":
        _home_or_go_on(session)
    elif key == "o":
        put_corner(session)
    else:
        return False
    return True


def _home_or_go_on(session: Session) -> None:
    """Home; a machine that cannot stays where it is, if it is not locked by the attempt."""
    from strokeplan.errors import DeviceLost, DriveError

    try:
        session.home()
    except DeviceLost:
        raise
    except DriveError as error:
        typer.echo(f"note: {error}", err=True)
        session.begin()


def put_corner(session: Session) -> None:
    corner = session.profile.machine.origin.replace("-", " ")
    done = session.put_corner()
    typer.echo(f"the page's {corner} corner is here: {where(session)}; {done}")


def need_terminal(what: str) -> None:
    import sys

    from strokeplan.errors import InputError

    if not sys.stdin.isatty():
        raise InputError(f"{what} needs a terminal for its keys; give X Y, or --to X,Y")
