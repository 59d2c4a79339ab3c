"""Machines to be set up, simulated: a port that notes where the pen is, and can press Ctrl-C at a time."""

from __future__ import annotations

from typing import Any

from strokeplan.plotter.driving.codecs import baud_of
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.setup import Session, Watch
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort


class Port(SimulatedPort):
    """A simulated port that counts what is written, and follows the pen."""

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self.watch = Watch()
        self.presses: list[float] = []
        self.written = b""
        self.places: list[tuple[float, float]] = []
        self.lowered = False

    def write(self, data: bytes) -> int:
        taken = super().write(data)
        self.written += data[:taken]
        return taken

    def read(self, timeout_s: float) -> bytes:
        data = super().read(min(timeout_s, 0.02))
        x, y = self.device.place_mm[:2]
        self.places.append((float(x), float(y)))
        self.lowered |= self.device.pen_down
        while self.presses and self.now() >= self.presses[0]:
            self.presses.pop(0)
            self.watch.interrupted()
        return data


def session(name: str, variant: str | None = None) -> tuple[Session, Port]:
    """A session with a simulated machine, greeted."""
    profile = load_profile(name)
    port = Port(firmware(profile, variant=variant), baud_of(profile))
    made = Session(Link(port, emergency=port.watch.wanted), profile)
    made.greet()
    return made, port
