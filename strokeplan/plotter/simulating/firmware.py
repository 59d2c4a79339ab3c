"""The simulated device for a profile, and what every one of them can do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol, TypeVar

from strokeplan.errors import InputError
from strokeplan.plotter.profile import Ebb as EbbDialect
from strokeplan.plotter.profile import Gcode, Profile
from strokeplan.plotter.profile import Hpgl as HpglDialect
from strokeplan.plotter.simulating.device import Device
from strokeplan.plotter.simulating.faults import NONE, Faults, Faulty
from strokeplan.plotter.simulating.recording import Drawn, Spot

T = TypeVar("T")


class Firmware(Protocol):
    """A device as a state machine in time: bytes in, bytes out. Times never go back."""

    def receive(self, data: bytes, at_s: float) -> None:
        """Bytes that reach the device's receiver at that time."""

    def advance(self, to_s: float) -> bytes:
        """Run until then; the bytes it sent, in order."""

    def next_event_s(self) -> float | None:
        """When it will do something by itself; None: never."""

    def room(self) -> int:
        """Bytes that the link takes now: USB makes the host wait, a UART does not."""

    def opened(self, at_s: float) -> None:
        """A host opens the port; boards that DTR resets start anew."""

    @property
    def link(self) -> bool:
        """Whether the cable is in and the port is there."""

    @property
    def drawn(self) -> Drawn:
        """What was drawn until now."""

    @property
    def pen_down(self) -> bool:
        """Whether the pen is on the paper."""

    @property
    def forbidden(self) -> tuple[str, ...]:
        """Commands received that change settings, firmware or files."""

    @property
    def place_mm(self) -> Spot:
        """Where the pen really is."""


def firmware(profile: Profile, *, faults: Faults = NONE, variant: str | None = None) -> Firmware:
    """The device that a profile speaks to; `variant` picks one of its kinds. Raises InputError."""
    device = _device(profile, variant)
    return Faulty(device, faults) if faults else device


def _device(profile: Profile, variant: str | None) -> Device:
    from strokeplan.plotter.simulating.grbl import Grbl
    from strokeplan.plotter.simulating.grbl_builds import BUILDS

    dialect = profile.dialect
    if isinstance(dialect, Gcode) and dialect.flavour in BUILDS:
        kinds: dict[str, Callable[..., Device]] = {
            dialect.flavour: Grbl,
            f"{dialect.flavour}-homing": partial(Grbl, homing=True, soft_limits=True),
            f"{dialect.flavour}-no-reset": partial(Grbl, resets=False),
        }
        return _pick(kinds, variant or dialect.flavour, profile)(profile, dialect.flavour)
    if isinstance(dialect, Gcode) and dialect.flavour == "marlin":
        return _marlin(profile, variant)
    if isinstance(dialect, Gcode) and dialect.flavour == "uarm":
        from strokeplan.plotter.simulating.uarm import UArm

        return _pick({"uarm": UArm}, variant or "uarm", profile)(profile)
    if isinstance(dialect, HpglDialect):
        from strokeplan.plotter.simulating.hpgl import Hpgl

        models: dict[str, Callable[..., Device]] = {
            "7475A": Hpgl,
            "7470A": partial(Hpgl, model="7470A"),
            "DXY": partial(Hpgl, model="DXY-1200"),
        }
        usual = "7470A" if dialect.buffer_bytes < 1024 else "DXY" if "roland" in profile.name else "7475A"
        return _pick(models, variant or usual, profile)(profile)
    if isinstance(dialect, EbbDialect):
        from strokeplan.plotter.simulating.ebb import Ebb

        boards: dict[str, Callable[..., Device]] = {
            "ebb-2.8": Ebb,
            "ebb-2.5": partial(Ebb, version=(2, 5, 3)),
            "ebb-3.0": partial(Ebb, version=(3, 0, 3)),
            "ebb-3.0-future": partial(Ebb, version=(3, 0, 3), future=True),
        }
        return _pick(boards, variant or "ebb-2.8", profile)(profile)
    raise InputError(f"profile {profile.name}: there is no simulator of its firmware")


def _marlin(profile: Profile, variant: str | None) -> Device:
    from strokeplan.plotter.simulating.marlin import Build, Marlin

    curves = profile.dialect.curves if isinstance(profile.dialect, Gcode) else "lines"
    builds = {
        "marlin": Build(arcs=curves == "arcs", cubics=curves == "cubics"),
        "marlin-no-ok-after-resend": Build(ok_after_resend=False, arcs=curves == "arcs"),
        "marlin-emergency-parser": Build(emergency_parser=True, advanced_ok=True, arcs=curves == "arcs"),
    }
    return Marlin(profile, _pick(builds, variant or "marlin", profile))


def _pick(kinds: Mapping[str, T], variant: str, profile: Profile) -> T:
    if variant not in kinds:
        raise InputError(f"variant {variant!r} is none of {profile.name}; there are {', '.join(kinds)}")
    return kinds[variant]


def usual_baud(profile: Profile) -> int:
    """The speed of the wire; USB boards have none, and take this for it."""
    return 9600 if isinstance(profile.dialect, HpglDialect) else 115200
