"""Hosts as simple as can be: they share nothing with the streamer."""

from __future__ import annotations

from collections import deque

from strokeplan.plotter.profile import Ebb, Hpgl, Profile, load_profile
from strokeplan.plotter.simulating.device import Device
from strokeplan.plotter.simulating.firmware import firmware, usual_baud
from strokeplan.plotter.simulating.port import SimulatedPort


class Host:
    """A device on a port, and somebody who types."""

    def __init__(self, profile: str | Profile, device: Device | None = None, **options: object) -> None:
        self.profile = load_profile(profile) if isinstance(profile, str) else profile
        self.device = device or firmware(self.profile, **options)  # type: ignore[arg-type]
        self.port = SimulatedPort(self.device, usual_baud(self.profile))
        self.greeting = self.hear(4.0)

    def hear(self, seconds: float) -> str:
        """All that comes in that time."""
        end, came = self.port.now() + seconds, bytearray()
        while self.port.now() < end:
            came += self.port.read(end - self.port.now())
        return came.decode("latin-1")

    def ask(self, data: bytes | str, seconds: float = 1.0) -> str:
        """Send, and say what came back."""
        data = data.encode("latin-1") if isinstance(data, str) else data
        while data:
            data = data[self.port.write(data) :]
            if data:
                self.port.wait(0.01)
        return self.hear(seconds)

    def lines(self, data: bytes | str, seconds: float = 1.0) -> list[str]:
        """Its lines that are not empty."""
        return [line for line in self.ask(data, seconds).replace("\r", "\n").split("\n") if line]


def play(host: Host, data: bytes) -> None:
    """Send a file as its machine wants it: a line at a time, or as the buffer has room."""
    dialect = host.profile.dialect
    if isinstance(dialect, Hpgl):
        _play_hpgl(host, data)
        return
    end = b"\r" if isinstance(dialect, Ebb) else b"\n"
    lines = [line for line in data.split(end) if line and line[:1] not in b"#;"]
    for line in lines:
        host.port.write(line + end)
        reply, patience = b"", 0
        while b"ok" not in reply.lower():
            came = host.port.read(60.0)
            reply += came
            assert b"error" not in reply.lower(), (line, reply)
            assert b"Err" not in reply, (line, reply)
            patience += not came
            assert patience < 30, (line, reply)
    host.hear(60.0)


def _play_hpgl(host: Host, data: bytes) -> None:
    waiting = deque(data[k : k + 60] for k in range(0, len(data), 60))
    while waiting:
        if int(host.ask(b"\x1b.B", 0.1)) > 100:
            host.ask(waiting.popleft(), 0.1)
    host.port.write(b"OA;")
    while not host.port.read(100.0):
        pass
