"""Commands that set a machine up before it draws: ports, jog, home, frame, origin, pen."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from strokeplan.cli.driving import BaudOption, MachineOption, TraceOption
from strokeplan.cli.machines import plot_options
from strokeplan.cli.options import (
    ClipOption,
    LandscapeOption,
    MarginOption,
    MirrorOption,
    PageOption,
    PlanArgument,
    RotateOption,
    ScaleOption,
    WithinOption,
)

if TYPE_CHECKING:
    from strokeplan.plotter.driving.setup import Session
    from strokeplan.plotter.profile import Point, Profile

SetupPortOption = Annotated[
    str, typer.Option("--port", metavar="PORT|URL", help="As for plot; auto: the only one that fits the machine.")
]
HomeFirstOption = Annotated[bool, typer.Option("--home", help="Have the machine look for its switches first.")]
AtOption = Annotated[
    str | None,
    typer.Option("--at", metavar="X,Y", help="Where the pen stands now, in mm, for a machine that does not know."),
]
HeightOption = Annotated[float | None, typer.Option("--height", metavar="MM", help="Of a pen on an axis.")]
PercentOption = Annotated[float | None, typer.Option("--percent", metavar="0..100", help="Of an EiBotBoard's servo.")]
PwmOption = Annotated[float | None, typer.Option("--pwm", metavar="S", help="Of a servo on the spindle's output.")]
DegOption = Annotated[float | None, typer.Option("--deg", metavar="DEGREES", help="Of a servo that Marlin turns.")]
NamedPenOption = Annotated[
    str | None, typer.Option("--pen", metavar="NAME", help="A pen that the profile says something of.")
]
SaveOption = Annotated[bool, typer.Option("--save", help="Write the value into your own profile.")]
STEPS_MM = (0.1, 0.5, 1.0, 5.0, 10.0, 50.0)
JOG_KEYS = (
    "arrows move, 1 to 6 or + and - the step, u and d the pen, o origin here, h home, 0 to X0 Y0; Enter or q ends"
)
PEN_KEYS = "+ and - change the height, s saves it; Enter or q raises the pen"

pen_app = typer.Typer(help="Raise and lower the pen, and find its heights.", no_args_is_help=True)


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


def jog(
    profile: MachineOption,
    by: Annotated[
        list[str] | None,
        typer.Argument(metavar="X Y", help="By how much, in mm of the machine; none: with the arrow keys."),
    ] = None,
    to: Annotated[str | None, typer.Option("--to", metavar="X,Y", help="To a place instead, in mm.")] = None,
    port: SetupPortOption = "auto",
    baud: BaudOption = None,
    home: HomeFirstOption = False,
    at: AtOption = None,
    trace: TraceOption = None,
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
        _need_terminal("jog without X Y")
    with _machine(machine, port, baud, trace, home=home, at=start) as session:
        if step is not None:
            place = session.at[0] + step[0], session.at[1] + step[1]
        if place is not None:
            session.go(*place)
        else:
            _jog_by_keys(session)
        typer.echo(_where(session))


def home(
    profile: MachineOption, port: SetupPortOption = "auto", baud: BaudOption = None, trace: TraceOption = None
) -> None:
    """Have the machine look for its switches, after which it knows where it is."""
    from strokeplan.plotter.profile import load_profile

    with _machine(load_profile(profile), port, baud, trace, home=True) as session:
        typer.echo(f"home; {_where(session)}")


def origin(
    profile: MachineOption,
    port: SetupPortOption = "auto",
    baud: BaudOption = None,
    home: HomeFirstOption = False,
    save: Annotated[
        bool,
        typer.Option("--save", help="Write the place into your own profile instead, for a machine that knows places."),
    ] = False,
    trace: TraceOption = None,
) -> None:
    """Let the page's origin corner be where the pen stands; nothing is written into the machine."""
    from strokeplan.plotter.driving.setup import check_corner
    from strokeplan.plotter.profile import load_profile

    machine = load_profile(profile)
    check_corner(machine)
    with _machine(machine, port, baud, trace, home=home) as session:
        if save:
            _save_corner(session, profile)
        else:
            _put_corner(session)


def frame(
    plan: PlanArgument,
    profile: MachineOption,
    port: SetupPortOption = "auto",
    baud: BaudOption = None,
    page: PageOption = None,
    landscape: LandscapeOption = False,
    margin: MarginOption = None,
    rotate: RotateOption = 0,
    mirror: MirrorOption = False,
    scale: ScaleOption = None,
    clip: ClipOption = False,
    within: WithinOption = None,
    times: Annotated[int, typer.Option("--times", min=1, max=99, help="Go around so often.")] = 1,
    home: HomeFirstOption = False,
    trace: TraceOption = None,
) -> None:
    """Walk around the drawing, pen up, as `plot` would lay it on the sheet; and back."""
    from strokeplan import formats
    from strokeplan.plotter.driving.setup import bounds
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program

    machine = load_profile(profile)
    options = plot_options(
        page, margin, landscape=landscape, rotate=rotate, mirror=mirror, scale=scale, clip=clip, within=within,
        keep_order=True,
    )  # fmt: skip
    drawing = program(formats.load(plan), machine, options)
    corners = bounds(drawing)
    (left, low), (right, high) = corners[0], corners[2]
    typer.echo(f"{'page':<11} {drawing.transform.describe()}")
    typer.echo(f"{'drawing':<11} X {left:.2f}..{right:.2f}, Y {low:.2f}..{high:.2f} mm")
    with _machine(machine, port, baud, trace, home=home) as session:
        for _ in range(times):
            session.walk(corners)
        typer.echo(_where(session))


@pen_app.command("up")
def pen_up(
    profile: MachineOption,
    port: SetupPortOption = "auto",
    baud: BaudOption = None,
    height: HeightOption = None,
    percent: PercentOption = None,
    pwm: PwmOption = None,
    deg: DegOption = None,
    save: SaveOption = False,
    trace: TraceOption = None,
) -> None:
    """Raise the pen; with a value, to that height."""
    from strokeplan.plotter.profile import load_profile

    tuned = _Tuned(profile, load_profile(profile), (height, percent, pwm, deg), down=False)
    tuned.check(save)
    with _machine(tuned.machine, port, baud, trace, moves=False):
        typer.echo(f"the pen is up{tuned.text}")
    if save:
        tuned.save()


@pen_app.command("down")
def pen_down(
    profile: MachineOption,
    port: SetupPortOption = "auto",
    baud: BaudOption = None,
    height: HeightOption = None,
    percent: PercentOption = None,
    pwm: PwmOption = None,
    deg: DegOption = None,
    pen: NamedPenOption = None,
    seconds: Annotated[
        float, typer.Option("--seconds", min=0, max=3600, help="It is raised again after this, or by Enter.")
    ] = 30.0,
    stay: Annotated[bool, typer.Option("--stay", help="Leave it down.")] = False,
    save: SaveOption = False,
    trace: TraceOption = None,
) -> None:
    """Lower the pen, with a value to that height, and raise it again; at a terminal + and - change the height."""
    from strokeplan.plotter.profile import load_profile

    tuned = _Tuned(profile, load_profile(profile), (height, percent, pwm, deg), down=True, pen=pen)
    tuned.check(save)
    with _machine(tuned.machine, port, baud, trace, pen=pen, moves=False) as session:
        session.lower()
        if stay:
            session.down = session.taken = False
            typer.echo(f"the pen is down{tuned.text}, and stays down: strokeplan pen up raises it")
        else:
            _hold_down(session, tuned, seconds)
    if not stay:
        typer.echo(f"the pen is up; it was down{tuned.text}")
    if save:
        tuned.save()


@pen_app.command("cycle")
def pen_cycle(
    profile: MachineOption,
    port: SetupPortOption = "auto",
    baud: BaudOption = None,
    height: HeightOption = None,
    percent: PercentOption = None,
    pwm: PwmOption = None,
    deg: DegOption = None,
    pen: NamedPenOption = None,
    times: Annotated[int, typer.Option("--times", min=1, max=1000, help="Lower and raise it so often.")] = 3,
    rest: Annotated[float, typer.Option("--rest", min=0, max=60, help="Seconds that it rests at each end.")] = 0.5,
    save: SaveOption = False,
    trace: TraceOption = None,
) -> None:
    """Lower and raise the pen, again and again; with a value, down to that height."""
    from strokeplan.plotter.profile import load_profile

    tuned = _Tuned(profile, load_profile(profile), (height, percent, pwm, deg), down=True, pen=pen)
    tuned.check(save)
    with _machine(tuned.machine, port, baud, trace, pen=pen, moves=False) as session:
        session.cycle(times, rest)
    typer.echo(f"the pen is up; it was down{tuned.text} {times} times")
    if save:
        tuned.save()


@contextmanager
def _machine(
    machine: Profile,
    port: str,
    baud: int | None,
    trace: Path | None,
    *,
    home: bool = False,
    at: Point | None = None,
    pen: str | None = None,
    moves: bool = True,
) -> Iterator[Session]:
    """A session with a machine that was greeted, its pen up; whatever ends the block, the pen is up afterwards."""
    from strokeplan.cli.driving import opened, traced
    from strokeplan.cli.operator import signals_heard
    from strokeplan.plotter.driving.codecs import baud_of
    from strokeplan.plotter.driving.link import Link
    from strokeplan.plotter.driving.ports import chosen, keep_awake
    from strokeplan.plotter.driving.setup import Session, Watch
    from strokeplan.plotter.driving.transport import open_port

    device, watch = chosen(port, machine), Watch()
    with (
        traced(trace) as record,
        opened(open_port(device, baud or baud_of(machine))) as transport,
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
                typer.echo("note: opening the port started the machine anew: X0 Y0 is where it stands now", err=True)
            yield session


class _Tuned:
    """A height that is tried: the profile with it, and how it is kept."""

    def __init__(
        self, name: str, machine: Profile, given: tuple[float | None, ...], *, down: bool, pen: str | None = None
    ) -> None:
        from strokeplan.errors import InputError
        from strokeplan.plotter.driving import tuning

        self.name, self.machine, self.pen = name, machine, pen
        self.key: str | None = None
        self.value: float | None = None
        options = dict(zip(("mm", "percent", "pwm", "deg"), given, strict=True))
        wanted = {unit: value for unit, value in options.items() if value is not None}
        if pen is not None:
            tuning.pen_index(machine, pen)
        if wanted or type(machine.tool) in tuning.DOWN:
            self.key = tuning.key_of(machine, down=down)
            self.value = tuning.value_of(machine, self.key, pen)
        for unit, value in wanted.items():
            right = tuning.unit_of(self.key or "")
            if unit != right:
                raise InputError(
                    f"{tuning.UNITS[unit]} is not for {machine.name}, whose pen is set by {tuning.UNITS[right]}"
                )
            if not isfinite(value):
                raise InputError(f"{tuning.UNITS[unit]} {value} is no number")
            self.set(value)

    def set(self, value: float) -> None:
        """Try another height. Raises ProfileError for one that the machine cannot have."""
        from strokeplan.plotter.driving.tuning import tried

        if self.key is not None:
            self.machine, self.value = tried(self.machine, self.key, value, self.pen), value

    def step(self, times: int) -> None:
        """Change it by a step, as many times."""
        from strokeplan.plotter.driving.tuning import STEPS, unit_of

        if self.key is not None and self.value is not None:
            self.set(round(self.value + times * STEPS[unit_of(self.key)], 3))

    @property
    def text(self) -> str:
        """ " at 300 (down_pwm)"; nothing for a pen without heights."""
        return "" if self.value is None else f" at {self.value:g} ({self.key})"

    def check(self, save: bool) -> None:
        """Raise InputError for --save with nothing to save, before anything moves."""
        from strokeplan.errors import InputError

        if save and self.value is None:
            raise InputError(f"--save: no height is given, and the profile {self.name} has none to begin with")

    def save(self) -> None:
        """Write it into the user's profile, and say where."""
        from strokeplan.plotter.driving.tuning import pen_index, saved

        if self.key is None or self.value is None:
            return
        item = None if self.pen is None else pen_index(self.machine, self.pen)
        path, begun = saved(self.name, "tool" if item is None else "pens", self.key, self.value, item=item)
        new = ", a copy that goes before the one that ships" if begun else ""
        typer.echo(f"wrote {self.key} = {self.value:g} to {path}{new}")


def _hold_down(session: Session, tuned: _Tuned, seconds: float) -> None:
    """The pen down until someone presses Enter, or for as long."""
    from strokeplan.cli.keys import Keys
    from strokeplan.cli.operator import single_keys
    from strokeplan.errors import ProfileError

    keys = Keys()
    hint = f"; {PEN_KEYS}" if keys.live else ""
    typer.echo(f"the pen is down{tuned.text}, for {seconds:g} s{hint}", err=True)
    until = session.link.now() + seconds
    with single_keys(keys.live):
        while session.link.now() < until:
            session.rest(min(0.05, max(until - session.link.now(), 0.001)))
            for key in keys.typed():
                if key in "\r\nq":
                    return
                if key == "s":
                    tuned.save()
                elif key in "+=-_":
                    until = session.link.now() + seconds
                    try:
                        tuned.step(1 if key in "+=" else -1)
                        session.use(tuned.machine)
                        typer.echo(f"down{tuned.text}", err=True)
                    except ProfileError as error:
                        typer.echo(f"note: {error}", err=True)


def _jog_by_keys(session: Session) -> None:
    """Move by the arrow keys until someone presses Enter."""
    from strokeplan.cli.keys import Keys
    from strokeplan.cli.operator import single_keys
    from strokeplan.errors import InputError
    from strokeplan.plotter.driving.setup import towards

    keys, size = Keys(), STEPS_MM.index(1.0)
    typer.echo(f"keys: {JOG_KEYS}", err=True)
    with single_keys(keys.live):
        typer.echo(f"{_where(session)}; step {STEPS_MM[size]:g} mm", err=True)
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
                    typer.echo(f"{_where(session)}; step {STEPS_MM[size]:g} mm", err=True)
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
        _put_corner(session)
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


def _put_corner(session: Session) -> None:
    corner = session.profile.machine.origin.replace("-", " ")
    done = session.put_corner()
    typer.echo(f"the page's {corner} corner is here: {_where(session)}; {done}")


def _save_corner(session: Session, name: str) -> None:
    """Write where the pen stands as the page's corner into the user's profile. Raises InputError."""
    from strokeplan.errors import InputError
    from strokeplan.plotter.driving.tuning import saved

    if not session.sure:
        raise InputError(f"--save: {session.profile.name} does not know where it stands; home it first (--home)")
    path, begun = saved(name, "machine", "offset_mm", [round(at, 2) for at in session.at])
    new = ", a copy that goes before the one that ships" if begun else ""
    typer.echo(f"wrote offset_mm = [{session.at[0]:.2f}, {session.at[1]:.2f}] to {path}{new}")


def _where(session: Session) -> str:
    pen = "down" if session.down else "up"
    return f"at X{session.at[0] + 0.0:.2f} Y{session.at[1] + 0.0:.2f}, pen {pen}"


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


def _need_terminal(what: str) -> None:
    import sys

    from strokeplan.errors import InputError

    if not sys.stdin.isatty():
        raise InputError(f"{what} needs a terminal for its keys; give X Y, or --to X,Y")
