"""The uArm Swift Pro: G-code with a number before it, which comes back with the answer; below it is a Marlin.

    #25 G0 X180 Y0 Z150 F5000   →   $25 ok
    #26 G99                     →   $26 E20

Source: uArm Swift Pro developer guide (protocol, error codes E20 to E25). When an answer comes (once the move is in
the planner) is [assumed], as is the length of its queue.
"""

from __future__ import annotations

import re
from collections.abc import Generator

from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.device import Main, Wait
from strokeplan.plotter.simulating.marlin import PARSE_S, Build, Marlin
from strokeplan.plotter.simulating.recording import Spot

UNKNOWN, BAD, OUTSIDE = "E20", "E21", "E22"
ANSWERS = {
    "P2200": "ok B0.00 L0.00 R0.00 H0.00", "P2201": "ok SwiftPro", "P2202": "ok V1.3.0", "P2203": "ok V3.2.0",
    "P2204": "ok V3.2.0", "P2205": "ok D43646FCDD00",
}  # fmt: skip


class UArm(Marlin):
    """An arm; it works in a plane here."""

    end = b"\n"

    def __init__(self, profile: Profile, *, at_mm: Spot = (0.0, 0.0)) -> None:
        super().__init__(profile, Build(arcs=False), boot_s=2.0, at_mm=at_mm)

    def _lose(self) -> None:
        super()._lose()
        self.steppers.reset((*self.recorder.at, self.z_slip))  # it measures its joints
        self.slip, self.z_slip = (0.0, 0.0), 0.0
        self._position = self.steppers.count

    def boot(self) -> Main:
        yield self.now + self.boot_s
        self.say("@1")
        yield from self._loop()

    def _line_done(self, line: bytes) -> None:
        self.queue.append((line.decode("latin-1").strip(), None))

    def _loop(self) -> Main:
        while True:
            self._read()
            if not self.queue:
                self.steppers.begin(self.now)
                yield lambda: bool(self.queue)
            text = self.queue[0][0]
            yield self.now + PARSE_S
            self.received.append(text)
            found = re.match(r"#(\d+)\s*(.*)", text)
            number, body = (f"${found[1]} ", found[2]) if found else ("", text)
            answer = yield from self._do(body)
            self.queue.popleft()
            self.say(number + answer)
            self._read()

    def _do(self, body: str) -> Generator[Wait, None, str]:
        """Carry out a command; its answer."""
        word = re.match(r"([GMP])(\d+)", body)
        if not word:
            return UNKNOWN
        name = f"{word[1]}{int(word[2])}"
        if self._storm:
            self._storm -= 1
            return "E23"
        if name in ANSWERS:
            return ANSWERS[name]
        if name == "P2220":
            x, y, z = self._position
            return f"ok X{x:.2f} Y{y:.2f} Z{z:.2f}"
        if name == "M2200":
            return f"ok V{int(not self.steppers.idle)}"
        if name in ("M2019", "M2400", "M2122", "M2120"):
            return "ok"
        before = len(self._out)
        yield from self._command(body)
        unknown = b"Unknown command" in self._out[before:]
        if unknown:
            del self._out[before:]
        return UNKNOWN if unknown else "ok"
