"""The simulated device for a profile, and what every one of them can do."""

from __future__ import annotations

from typing import Protocol

from strokeplan.errors import InputError
from strokeplan.plotter.profile import Gcode, Profile
from strokeplan.plotter.simulating.recording import Drawn, Spot


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


def firmware(profile: Profile, *, variant: str | None = None) -> Firmware:
    """The device that a profile speaks to; `variant` picks one of its kinds. Raises InputError."""
    from strokeplan.plotter.simulating.grbl import BUILDS, Grbl

    dialect = profile.dialect
    if isinstance(dialect, Gcode) and dialect.flavour in BUILDS:
        return Grbl(profile, dialect.flavour)
    raise InputError(f"profile {profile.name}: there is no simulator of its firmware")
