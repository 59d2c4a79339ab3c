"""The board of a simulated GRBL: ring of bytes, real-time commands, status reports, holds, resets, alarms."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from math import inf

from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.device import Device, Main
from strokeplan.plotter.simulating.grbl_builds import BUILDS, default_settings
from strokeplan.plotter.simulating.grbl_gcode import Modes
from strokeplan.plotter.simulating.recording import Spot
from strokeplan.plotter.simulating.steppers import Place

PARSE_S = 0.0005  # [assumed] from a line's end to its answer
ALARM_S = 0.5
"""GRBL stands still for as long after it has said ALARM."""
DOOR_S = 4.0
"""The spindle's time to come back after the safety door."""
MESSAGES = {
    "locked": "'$H'|'$X' to unlock", "critical": "Reset to continue", "unlocked": "Caution: Unlocked",
    "door": "Check Door",
}  # fmt: skip


class Board(Device):
    """A board with GRBL: its bytes, its states, its holds and resets; lines are `Grbl`'s.

    homing       $22: limit switches at the machine's zero; it wakes up locked, and $H puts the count to 0 there.
    soft_limits  $20, of the profile's travel; needs homing.
    """

    def __init__(
        self, profile: Profile, flavour: str = "grbl", *, homing: bool = False, soft_limits: bool = False,
        resets: bool | None = None, boot_s: float = 1.5, at_mm: Spot = (0.0, 0.0),
    ) -> None:  # fmt: skip
        self.build = BUILDS[flavour]
        self.blocks = self.build.blocks
        self.homing, self.soft_limits = homing, soft_limits and homing
        self.rx: deque[int] = deque()
        self.lost = 0
        """Bytes that found the ring full, or the board deaf."""
        self.state = "Idle"
        self._deaf_until = 0.0
        self._fails: deque[int] = deque()
        self._stored = Modes()
        self.modes = Modes()
        self.settings = default_settings(profile, self.build, homing=homing, soft_limits=soft_limits)
        super().__init__(
            profile, resets=self.build.resets if resets is None else resets, boot_s=boot_s, at_mm=at_mm
        )  # fmt: skip

    # Power, resets and the world

    def _lose(self) -> None:
        self.rx.clear()
        self._deaf_until = self.now + self.boot_s
        self.state = "Alarm" if self.homing else "Idle"
        self.modes = Modes(systems=self._stored.systems, homes=self._stored.homes)
        self._clear()
        self._pulse(0.0)

    def _clear(self) -> None:
        """What a soft reset forgets."""
        self.feed_percent, self.rapid_percent, self.spindle_percent = 100, 100, 100
        self._asked = False
        self._wco, self._ov = 0, 1
        self._hold = ""
        """ "", "hold" or "door"; a held main loop does nothing."""
        self._jog = False
        self._dead = False
        self._resume_s = inf

    def boot(self) -> Main:
        yield self.now + self.boot_s
        yield from self._begin(lock=self.homing)

    def _begin(self, *, lock: bool) -> Main:
        self._out += b"\r\n"
        self.say(self.build.banner)
        if lock:
            self.state = "Alarm"
            self._message(MESSAGES["locked"])
        else:
            self.state = "Idle"
        yield from self._lines()

    def alarm(self, code: int, at_s: float) -> None:
        super().alarm(code, at_s)
        if self.powered:
            self._alarmed(code)

    def _alarmed(self, code: int) -> None:
        self._halt()
        self.state = "Alarm"
        self.say(f"ALARM:{code}")
        self._dead = code in (1, 2)
        if self._dead:
            self._message(MESSAGES["critical"])
        self._main, self._wait = self._locked(), self.now + ALARM_S

    def _locked(self) -> Main:
        yield self.now + ALARM_S
        if self._dead:
            yield lambda: not self._dead  # until a reset
        yield from self._lines()

    def press(self, at_s: float) -> None:
        """The feed hold button."""
        super().press(at_s)
        self._real_time(ord("!"))

    def fail(self, code: int) -> None:
        """The next line is answered with error:code and does nothing."""
        self._fails.append(code)

    # Bytes

    def _take(self, data: bytes) -> None:
        for byte in data:
            if self.now < self._deaf_until:
                self.lost += 1
            elif byte in b"?!~\x18" or byte > 0x7F:
                self._real_time(byte)
            elif len(self.rx) < self.build.rx:
                self.rx.append(byte)
            else:
                self.lost += 1

    def _real_time(self, byte: int) -> None:
        if byte == 0x18:
            self._soft_reset()
        elif self._dead:
            return
        elif byte == ord("?"):
            self._asked = True
            self._answer()
        elif byte == ord("!"):
            self._feed_hold("hold")
        elif byte == 0x84:
            self._feed_hold("door")
        elif byte == ord("~"):
            self._cycle_start()
        elif byte == 0x85:
            if self.state == "Jog":
                self._cancel_jog()
        else:
            self._override(byte)

    def _answer(self) -> None:
        """A status report, if the main loop is somewhere that it looks: it does not while homing or busy."""
        busy = not callable(self._wait) and self._wait > self.now and not self._dwelling
        if self._asked and not (busy and not self._hold):
            self._asked = False
            self.say(self.status())

    _dwelling = False

    def status(self) -> str:
        """A report: <state|position|…>."""
        state = self.state
        if state == "Hold":
            state = "Hold:1" if self.steppers.run else "Hold:0"
        if state == "Door":
            state = "Door:3" if self._resume_s < inf else "Door:2" if self.steppers.run else "Door:0"
        place, offset = self.steppers.place(self.now), self.modes.offset
        mask = int(self.settings["10"])
        fields = [state]
        if mask & 1:
            fields.append(f"MPos:{xyz(place)}")
        else:
            fields.append(f"WPos:{xyz((place[0] - offset[0], place[1] - offset[1], place[2] - offset[2]))}")
        if mask & 2:
            fields.append(f"Bf:{self.blocks - self.steppers.held},{self.build.rx - len(self.rx)}")
        run = self.steppers.run
        feed = run.speed(self.now) * 60 if run else 0.0
        fields.append(f"FS:{feed:.0f},{0 if self.modes.spindle == 'M5' else self.modes.pulse:.0f}")
        moving = self.state in ("Run", "Hold", "Door", "Jog", "Home")
        if self._wco > 0:
            self._wco -= 1
        else:
            self._wco = 29 if moving else 9
            self._ov = max(self._ov, 1)
            fields.append(f"WCO:{xyz(offset)}")
            return f"<{'|'.join(fields)}>"
        if self._ov > 0:
            self._ov -= 1
        if self._ov == 0:
            self._ov = 19 if moving else 9
            fields.append(f"Ov:{self.feed_percent},{self.rapid_percent},{self.spindle_percent}")
        return f"<{'|'.join(fields)}>"

    # Real-time commands

    def _soft_reset(self) -> None:
        moving = self.steppers.run is not None or self.state in ("Run", "Home", "Jog")
        code = 6 if self.state == "Home" else 3
        lock = self.state == "Alarm"
        self._halt()
        self.rx.clear()
        self._clear()
        self.modes = Modes(systems=self.modes.systems, homes=self.modes.homes, position=self.steppers.count)
        self._pulse(0.0)
        self._main, self._wait = self._restarted(code if moving else 0, lock=lock or moving), self.now

    def _restarted(self, code: int, *, lock: bool) -> Main:
        if code:
            self.state = "Alarm"
            self.say(f"ALARM:{code}")
            yield self.now + ALARM_S
            self.rx.clear()
        yield self.now + 0.001
        yield from self._begin(lock=lock)

    def _halt(self) -> None:
        """The motors stop dead; what runs on is not counted."""
        self._trace(self.now)
        before = self.steppers.place(self.now)
        x, y = self.steppers.kill(self.now)
        self._overrun(before, x, y)
        self._dwelling = False

    def _feed_hold(self, kind: str) -> None:
        if self.state in ("Alarm", "Check", "Home"):
            return
        if self.state == "Jog":
            self._cancel_jog()
            return
        if kind == "door":
            self._message(MESSAGES["door"])
        elif self._hold == "door":
            return
        self.state, self._hold = ("Door" if kind == "door" else "Hold"), kind
        self._resume_s = inf
        self._trace(self.now)
        self.steppers.brake(self.now)
        if kind == "door" and not self.steppers.run:
            self._pulse(0.0)

    def _rested(self) -> None:
        if self._jog:
            self._jog_ended()
        elif self._hold == "door":
            self._pulse(0.0)
        elif not self._hold:  # a hold that was never asked for
            self._moved()

    def _cycle_start(self) -> None:
        if not self._hold:
            self._start_cycle()
        elif self.steppers.run is None:  # in Hold:1 it is forgotten
            if self._hold == "door":
                self._resume_s = self.now + DOOR_S
                self._pulse(0.0 if self.modes.spindle == "M5" else self.modes.pulse)
            else:
                self._resume()

    def _resume(self) -> None:
        self._hold, self._resume_s = "", inf
        self.state = "Idle"
        self._start_cycle()

    def _cancel_jog(self) -> None:
        self._jog = True
        self._trace(self.now)
        self.steppers.brake(self.now)
        if self.steppers.run is None:
            self._jog_ended()

    def _jog_ended(self) -> None:
        self._jog = False
        self.steppers.reset(self.steppers.count)
        self.modes = replace(self.modes, position=self.steppers.count)
        self.state = "Idle"

    def _override(self, byte: int) -> None:
        feed = {0x91: 10, 0x92: -10, 0x93: 1, 0x94: -1}
        spindle = {0x9A: 10, 0x9B: -10, 0x9C: 1, 0x9D: -1}
        if byte == 0x90:
            self.feed_percent = 100
        elif byte in feed:
            self.feed_percent = min(max(self.feed_percent + feed[byte], 10), 200)
        elif byte in (0x95, 0x96, 0x97):
            self.rapid_percent = {0x95: 100, 0x96: 50, 0x97: 25}[byte]
        elif byte == 0x99:
            self.spindle_percent = 100
        elif byte in spindle:
            self.spindle_percent = min(max(self.spindle_percent + spindle[byte], 10), 200)
        elif byte == 0x9E and self.state == "Hold" and self.steppers.run is None:
            self._pulse(0.0)
        if 0x90 <= byte <= 0x9E:
            self._ov = 0

    # Motion

    def _runs(self) -> bool:
        return not self._hold and not self._jog

    def _due(self) -> float:
        due = super()._due()
        return min(due, self._resume_s) if self.powered else due

    def _happen(self) -> None:
        if self._resume_s <= self.now:
            self._resume()
        super()._happen()
        if self.steppers.idle and self.state in ("Run", "Jog"):
            self.state = "Idle"

    def _moved(self, speed: float = 0.0) -> None:
        if not self._hold:
            self.steppers.begin(self.now, speed)

    def _start_cycle(self) -> None:
        if not self._hold and self.steppers.run is None and self.steppers.queue:
            self.steppers.begin(self.now)
            if self.state == "Idle":
                self.state = "Run"

    def _pulse(self, pulse: float) -> None:
        down = self.touch.pulse(pulse)
        self.recorder.settle(self.now)
        self.recorder.pen(self.now + self.touch.late(down), down=down) if not self.touch.by_height else None

    def _lines(self) -> Main:
        """Take lines and answer them, for ever."""
        raise NotImplementedError

    def _message(self, text: str) -> None:
        self.say(f"[MSG:{text}]")


def xyz(place: Place) -> str:
    return ",".join(f"{at:.3f}" for at in place)
