"""GRBL 1.1h, and what grblHAL, FluidNC and DrawCore do otherwise.

Bytes come into a ring of 128; what finds it full is lost, without a word. Real-time bytes are picked out before it. The
main loop takes lines of at most 79 characters, answers each with one `ok` or `error:n`, and stands still while the
planner's 15 blocks are taken, while it waits for the motors (M3, G4, M0), and in every hold.

Sources: GRBL 1.1 wiki (Interface, Commands, Configuration); behaviour of gnea/grbl's protocol.c, system.c, serial.c.
Known limits: no probe, no laser mode, arcs in the plane XY only, $32 = 0; a hold stops within the block that runs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from strokeplan.plotter.simulating.device import Main
from strokeplan.plotter.simulating.grbl_board import MESSAGES, PARSE_S, Board, xyz
from strokeplan.plotter.simulating.grbl_gcode import (
    Action,
    Dwell,
    End,
    GcodeError,
    Modes,
    Move,
    Pause,
    Spindle,
    Store,
    execute,
    seconds_up,
)  # fmt: skip
from strokeplan.plotter.simulating.steppers import Place

LINE = 80
EEPROM_S = 0.02  # [assumed] five bytes of 3.4 ms
HOMING_S = 5.0  # [assumed]


class Grbl(Board):
    """A board whose main loop takes lines: G-code and $ commands."""

    # The main loop

    def _lines(self) -> Main:
        line, comment, over = "", "", False
        while True:
            if not self.rx:
                self._start_cycle()
                if self._asked:
                    self._answer()
                yield lambda: bool(self.rx)
            char = chr(self.rx.popleft())
            if char in "\r\n":
                yield self.now + PARSE_S
                self._answer()
                yield from self._line(line, over=over)
                line, comment, over = "", "", False
            elif over or comment == ";":
                continue
            elif comment:
                comment = "" if char == ")" else comment
            elif char <= " " or char == "/":
                continue
            elif char in "(;":
                comment = char
            elif len(line) >= LINE - 1:
                over = True
            else:
                line += char.upper()

    def _line(self, line: str, *, over: bool) -> Main:
        code = 11 if over else 0
        try:
            if self._fails and line:
                raise GcodeError(self._fails.popleft())
            if not code and line:
                self.received.append(line)
                if line.startswith("$"):
                    yield from self._system(line)
                elif self.state in ("Alarm", "Jog"):
                    raise GcodeError(9)
                else:
                    new, actions = execute(line, self.modes, arcs=self.build.arcs)
                    yield from self._perform(line, new, actions)
        except GcodeError as error:
            code = error.code
        self.say(f"error:{code}" if code else "ok")

    def _perform(self, line: str, new: Modes, actions: list[Action]) -> Main:
        if self.state == "Check":
            self.modes = replace(new, position=new.position)
            return
        if any(isinstance(action, Store) for action in actions):
            self.forbid(line)
        if new.offset != self.modes.offset:
            self._wco = 0
        if self.build.tool != "line":
            new = replace(new, tool=0 if self.build.tool == "none" else new.tool or self.modes.tool)
        self.modes = new
        for action in actions:
            yield from self._act(action)

    def _act(self, action: Action) -> Main:
        if isinstance(action, Move):
            yield from self._move(action)
        elif isinstance(action, Store):
            self._stored = self.modes
            yield from self._write()
        else:
            yield from self._still()
            if isinstance(action, Spindle):
                self._pulse(action.pulse)
            elif isinstance(action, Dwell):
                self._dwelling = True
                yield self.now + seconds_up(action.seconds)
                self._dwelling = False
            elif isinstance(action, Pause):
                self._feed_hold("hold")
                yield lambda: True
            elif isinstance(action, End):
                self.feed_percent = self.rapid_percent = self.spindle_percent = 100
                self._message("Pgm End")

    def _move(self, move: Move) -> Main:
        if self.soft_limits and self._outside(move.to):
            yield from self._soft_limit()
        if self.steppers.full:
            self._start_cycle()
            yield lambda: not self.steppers.full
        percent = self.rapid_percent if move.feed is None else self.feed_percent
        speed = (max(self.steppers.axes.rate) if move.feed is None else move.feed / 60) * percent / 100
        self.steppers.add(move.to, speed)
        if self.steppers.run is not None and self.state == "Idle":
            self.state = "Run"

    def _still(self) -> Main:
        self._start_cycle()
        yield lambda: self.steppers.idle

    def _write(self) -> Main:
        if self.build.eeprom:
            self._deaf_until = self.now + EEPROM_S
        yield self.now + EEPROM_S

    def _outside(self, to: Place) -> bool:
        spans = self.profile.machine.x_mm, self.profile.machine.y_mm
        return any(not low - 1e-6 <= at <= high + 1e-6 for at, (low, high) in zip(to, spans, strict=False))

    def _soft_limit(self) -> Main:
        """Hold, then ALARM:2, then nothing until a reset; the place is kept."""
        self._start_cycle()
        self.steppers.brake(self.now)
        yield lambda: self.steppers.run is None
        self.steppers.reset(self.steppers.count)
        self._alarmed(2)
        yield lambda: False

    # $ commands

    def _system(self, line: str) -> Main:
        if line in ("$$", "$G", "$C", "$X", "$"):
            yield from self._small(line)
            return
        if line.startswith("$J"):
            yield from self._jogging(line)
            return
        if self.state not in ("Idle", "Alarm") or self.busy:
            raise GcodeError(8)
        if line == "$I":
            for text in self.build.info:
                self.say(text)
        elif line == "$#":
            for text in self._parameters():
                self.say(text)
        elif line == "$H":
            yield from self._home()
        elif line == "$SLP":
            self.state = "Sleep"
            self._pulse(0.0)
        elif line == "$N":
            self.say("$N0=")
            self.say("$N1=")
        else:
            yield from self._setting(line)

    def _small(self, line: str) -> Main:
        yield self.now
        if line == "$$":
            if self.state in ("Run", "Hold"):
                raise GcodeError(8)
            for key, value in self.settings.items():
                self.say(f"${key}={value}")
        elif line == "$G":
            self.say(self.modes.report())
        elif line == "$":
            self.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]")
        elif line == "$X":
            if self.state == "Alarm":
                self._message(MESSAGES["unlocked"])
                self.state = "Idle"
        elif self.state == "Check":
            self._message("Disabled")
            self._soft_reset()
            yield lambda: False
        elif self.state != "Idle":
            raise GcodeError(8)
        else:
            self.state = "Check"
            self._message("Enabled")

    def _jogging(self, line: str) -> Main:
        if self.state not in ("Idle", "Jog"):
            raise GcodeError(8)
        if not line.startswith("$J="):
            raise GcodeError(3)
        new, actions = execute(line[3:], self.modes, jog=True)
        if self.soft_limits and self._outside(new.position):
            raise GcodeError(15)
        self.modes = new
        for action in actions:
            yield from self._act(action)
        if not self.steppers.idle:
            self.state = "Jog"
            self.steppers.begin(self.now)

    def _home(self) -> Main:
        if not self.homing:
            raise GcodeError(5)
        self.state = "Home"
        yield self.now + HOMING_S
        self.recorder.carry((0.0, 0.0), self.now) if not self.recorder.down else self.recorder.move(
            self.now - HOMING_S, self.now, (0.0, 0.0)
        )
        self.steppers.reset((0.0, 0.0, self.steppers.count[2]))
        self.slip = (0.0, 0.0)
        self.modes = replace(self.modes, position=self.steppers.count)
        self.state = "Idle"

    def _setting(self, line: str) -> Main:
        found = re.fullmatch(r"\$(\d+)=(-?\d+\.?\d*)", line)
        if found:
            self.forbid(line)
            if found[1] not in self.settings:
                raise GcodeError(3)
            self.settings[found[1]] = found[2]
            yield from self._write()
        elif re.match(r"\$(RST=|I=|N\d=)", line) or (not self.build.eeprom and re.match(r"\$[A-Z]{2,}", line)):
            self.forbid(line)
            yield from self._write()
        else:
            raise GcodeError(3 if re.match(r"\$\d+$", line) else 2)

    def _parameters(self) -> Iterator[str]:
        for name, at in (*self.modes.systems.items(), *self.modes.homes.items(), ("G92", self.modes.g92)):
            yield f"[{name}:{xyz(at)}]"
        yield "[TLO:0.000]"
        yield "[PRB:0.000,0.000,0.000:0]"
