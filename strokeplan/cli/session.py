"""What commands at a machine share: a port that is closed again, a trace, a session that ends pen up."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from strokeplan.cli.options import PortGroup
    from strokeplan.plotter.driving.setup import Session
    from strokeplan.plotter.profile import Point, Profile


@contextmanager
def at_machine(
    machine: Profile,
    reached: PortGroup,
    *,
    home: bool = False,
    at: Point | None = None,
    pen: str | None = None,
    moves: bool = True,
) -> Iterator[Session]:
    """A session with a machine that was greeted, its pen up; whatever ends the block, the pen is up afterwards."""
    from strokeplan.cli.operator import signals_heard
    from strokeplan.plotter.driving.codecs import baud_of
    from strokeplan.plotter.driving.link import Link
    from strokeplan.plotter.driving.ports import chosen, keep_awake
    from strokeplan.plotter.driving.setup import Session, Watch
    from strokeplan.plotter.driving.transport import open_port

    device, watch = chosen(reached.port, machine), Watch()
    with (
        traced(reached.trace) as record,
        opened(open_port(device, reached.baud or baud_of(machine))) as transport,
        signals_heard(watch.interrupted),
    ):
        keep_awake(transport)
        session = Session(Link(transport, trace=record, emergency=watch.wanted), machine, pen)
        typer.echo(f"{'port':<11} {device}: {session.greet()}", err=True)
        with session.safely(watch):
            if home:
                session.home()
            else:
                session.begin()
            if at is not None:
                session.claim(*at)
            elif moves and not session.told:
                typer.echo("note: this machine does not say where it is; it is taken to stand at X0 Y0", err=True)
            elif moves and not session.sure:
                place = f"X{session.at[0] + 0.0:g} Y{session.at[1] + 0.0:g}"
                typer.echo(f"note: opening the port started the machine anew: {place} is where it stands now", err=True)
            yield session


def where(session: Session) -> str:
    """ "at X1.00 Y2.00, pen up"."""
    pen = "down" if session.down else "up"
    return f"at X{session.at[0] + 0.0:.2f} Y{session.at[1] + 0.0:.2f}, pen {pen}"


@contextmanager
def opened(transport: Any) -> Iterator[Any]:
    try:
        yield transport
    finally:
        transport.close()


@contextmanager
def traced(path: Path | None) -> Iterator[IO[str] | None]:
    from strokeplan.errors import OutputError
    from strokeplan.files import check_writable

    if path is None:
        yield None
        return
    check_writable(path)
    try:
        with path.open("w", encoding="ascii") as stream:
            yield stream
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from None
