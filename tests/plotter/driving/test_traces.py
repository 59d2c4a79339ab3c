"""Recorded conversations, played back: the host says to the byte what it said then, and comes to the same end.

`python tests/plotter/driving/test_traces.py` records them anew, on the simulated machines. A trace of a real machine is
put beside them as it is, with what was drawn in its name.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TextIO

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from rehearsal import short_job
from replay import Replay, WholeLines

from strokeplan.plotter.driving.codecs import baud_of, codec_for
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.streamer import Ending, Streamer
from strokeplan.plotter.driving.transport import Transport
from strokeplan.plotter.driving.units import script
from strokeplan.plotter.simulating.faults import Fault, Faults
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort

TRACES = Path(__file__).parent / "traces"
LINES = 2
RECORDED: dict[str, tuple[str, Faults, Ending]] = {
    "grbl_servo": ("grbl_servo", Faults(), Ending(2, True)),
    "grbl_servo-lost-ok": ("grbl_servo", Faults((Fault("drop-reply", 74, "lines"),)), Ending(2, True)),
    "grbl_servo-error": (
        "grbl_servo",
        Faults((Fault("refuse", 203, "bytes"),)),
        Ending(0, False, "the machine refuses 'G1 X21 Y64 F2500' (error:20)"),
    ),
    "ender3-resend": ("ender3", Faults((Fault("corrupt-bytes", 400, "bytes"),)), Ending(2, True)),
    "axidraw_v3": ("axidraw_v3", Faults(), Ending(2, True)),
    "hp7475a": ("hp7475a", Faults(), Ending(2, True)),
    "uarm_swift_pro": ("uarm_swift_pro", Faults(), Ending(2, True)),
}


class Memory:
    def advance(self, key: int, now: float) -> None:
        pass

    def settle(self) -> None:
        pass


def drive(port: Transport, name: str, trace: TextIO | None = None) -> Ending:
    job = short_job(name, LINES)
    work = script(job)
    codec = codec_for(job.profile, work.phrases(0))
    link = Link(port, trace=trace)
    codec.greet(link)
    return Streamer(link, codec, work, Nobody(), Memory()).run()


class Nobody:
    """A control without a person."""

    def wish(self) -> None:
        return None

    def ask(self, text: str) -> bool:
        raise AssertionError(text)

    def note(self, text: str) -> None:
        pass

    def progress(self, done: int, paused: bool) -> None:
        pass


@pytest.mark.parametrize("trace", sorted(RECORDED))
def test_a_recorded_conversation_goes_as_it_went(trace: str) -> None:
    name, _, ending = RECORDED[trace]
    port = Replay(TRACES / f"{trace}.trace")
    assert drive(port, name) == ending
    assert port.over


def test_every_trace_is_played() -> None:
    assert {path.stem for path in TRACES.glob("*.trace")} == set(RECORDED)


def record() -> None:
    for trace, (name, faults, _) in RECORDED.items():
        profile = short_job(name, LINES).profile
        device = SimulatedPort(firmware(profile, faults=faults), baud_of(profile))
        port = WholeLines(device, b"\r" if name == "hp7475a" else b"\n")
        with (TRACES / f"{trace}.trace").open("w") as stream:
            print(trace, drive(port, name, stream))


if __name__ == "__main__":
    record()
