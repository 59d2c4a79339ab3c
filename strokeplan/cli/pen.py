"""strokeplan pen up | down | cycle: the pen's heights, tried and kept."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from strokeplan.cli.options import MachineOption, PortGroup, grouped
from strokeplan.cli.session import at_machine

if TYPE_CHECKING:
    from strokeplan.plotter.driving.setup import Session

NamedPenOption = Annotated[
    str | None, typer.Option("--pen", metavar="NAME", help="A pen that the profile says something of.")
]
PEN_KEYS = "+ and - change the height, s saves it; Enter or q raises the pen"

app = typer.Typer(help="Raise and lower the pen, and find its heights.", no_args_is_help=True)


@dataclass(frozen=True)
class HeightGroup:
    """A height of the pen, in what the profile says it."""

    PANEL: ClassVar = "Height"

    height: Annotated[float | None, typer.Option("--height", metavar="MM", help="Of a pen on an axis.")] = None
    percent: Annotated[float | None, typer.Option("--percent", metavar="0..100", help="Of an EiBotBoard's servo.")] = (
        None
    )
    pwm: Annotated[float | None, typer.Option("--pwm", metavar="S", help="Of a servo on the spindle's output.")] = None
    deg: Annotated[float | None, typer.Option("--deg", metavar="DEGREES", help="Of a servo that Marlin turns.")] = None
    save: Annotated[bool, typer.Option("--save", help="Write the value into your own profile.")] = False


@app.command("up")
@grouped
def pen_up(profile: MachineOption, *, heights: HeightGroup, reached: PortGroup) -> None:
    """Raise the pen; with a value, to that height."""
    tuned = _Tuned(profile, heights, down=False)
    tuned.check()
    with at_machine(tuned.machine, reached, moves=False):
        typer.echo(f"the pen is up{tuned.text}")
    tuned.keep()


@app.command("down")
@grouped
def pen_down(
    profile: MachineOption,
    pen: NamedPenOption = None,
    seconds: Annotated[
        float, typer.Option("--seconds", min=0, max=3600, help="It is raised again after this, or by Enter.")
    ] = 30.0,
    stay: Annotated[bool, typer.Option("--stay", help="Leave it down.")] = False,
    *,
    heights: HeightGroup,
    reached: PortGroup,
) -> None:
    """Lower the pen, with a value to that height, and raise it again; at a terminal + and - change the height."""
    tuned = _Tuned(profile, heights, down=True, pen=pen)
    tuned.check()
    with at_machine(tuned.machine, reached, pen=pen, moves=False) as session:
        session.lower()
        if stay:
            session.down = session.taken = False
            typer.echo(f"the pen is down{tuned.text}, and stays down: strokeplan pen up raises it")
        else:
            _hold_down(session, tuned, seconds)
    if not stay:
        typer.echo(f"the pen is up; it was down{tuned.text}")
    tuned.keep()


@app.command("cycle")
@grouped
def pen_cycle(
    profile: MachineOption,
    pen: NamedPenOption = None,
    times: Annotated[int, typer.Option("--times", min=1, max=1000, help="Lower and raise it so often.")] = 3,
    rest: Annotated[float, typer.Option("--rest", min=0, max=60, help="Seconds that it rests at each end.")] = 0.5,
    *,
    heights: HeightGroup,
    reached: PortGroup,
) -> None:
    """Lower and raise the pen, again and again; with a value, down to that height."""
    tuned = _Tuned(profile, heights, down=True, pen=pen)
    tuned.check()
    with at_machine(tuned.machine, reached, pen=pen, moves=False) as session:
        session.cycle(times, rest)
    typer.echo(f"the pen is up; it was down{tuned.text} {times} times")
    tuned.keep()


class _Tuned:
    """A height that is tried: the profile with it, and how it is kept."""

    def __init__(self, name: str, heights: HeightGroup, *, down: bool, pen: str | None = None) -> None:
        from strokeplan.errors import InputError
        from strokeplan.plotter.driving import tuning
        from strokeplan.plotter.profile import load_profile

        self.name, self.machine, self.pen = name, load_profile(name), pen
        self.kept = heights.save
        self.key: str | None = None
        self.value: float | None = None
        options = {"mm": heights.height, "percent": heights.percent, "pwm": heights.pwm, "deg": heights.deg}
        wanted = {unit: value for unit, value in options.items() if value is not None}
        if pen is not None:
            tuning.pen_index(self.machine, pen)
        if wanted or type(self.machine.tool) in tuning.DOWN:
            self.key = tuning.key_of(self.machine, down=down)
            self.value = tuning.value_of(self.machine, self.key, pen)
        for unit, value in wanted.items():
            right = tuning.unit_of(self.key or "")
            if unit != right:
                raise InputError(
                    f"{tuning.UNITS[unit]} is not for {self.machine.name}, whose pen is set by {tuning.UNITS[right]}"
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

    def check(self) -> None:
        """Raise InputError for --save with nothing to save, before anything moves."""
        from strokeplan.errors import InputError

        if self.kept and self.value is None:
            raise InputError(f"--save: no height is given, and the profile {self.name} has none to begin with")

    def keep(self) -> None:
        """Save it, if that is asked for."""
        if self.kept:
            self.save()

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
