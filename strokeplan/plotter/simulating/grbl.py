"""GRBL 1.1h, and what grblHAL, FluidNC and DrawCore do otherwise.

Bytes come into a ring of 128; what finds it full is lost, without a word. Real-time bytes are picked out before it. The
main loop takes lines of at most 79 characters, answers each with one `ok` or `error:n`, and stands still while the
planner's 15 blocks are taken, while it waits for the motors (M3, G4, M0), and in every hold.

Sources: GRBL 1.1 wiki (Interface, Commands, Configuration); behaviour of gnea/grbl's protocol.c, system.c, serial.c.
Known limits: no probe, no laser mode, arcs in the plane XY only, $32 = 0; a hold stops within the block that runs.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from typing import Literal

from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.device import Device, Main
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
from strokeplan.plotter.simulating.recording import Spot
from strokeplan.plotter.simulating.steppers import Place

LINE = 80
PARSE_S = 0.0005  # [assumed] from a line's end to its answer
EEPROM_S = 0.02  # [assumed] five bytes of 3.4 ms
ALARM_S = 0.5
"""GRBL stands still for as long after it has said ALARM."""
HOMING_S = 5.0  # [assumed]
DOOR_S = 4.0
"""The spindle's time to come back after the safety door."""
STATES = {"Hold": "Hold:0"}
MESSAGES = {
    "locked": "'$H'|'$X' to unlock", "critical": "Reset to continue", "unlocked": "Caution: Unlocked",
    "door": "Check Door",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Build:
    """What one of the kin is built with."""

    banner: str
    info: tuple[str, ...]
    rx: int = 128
    blocks: int = 15
    eeprom: bool = True
    """Settings are written with interrupts off."""
    arcs: bool = True
    resets: bool = True
    tool: Literal["line", "kept", "none"] = "line"
    """What T is in $G: GRBL forgets it with the next line, others keep it, or show none without M6."""
    report: int = 1
    """$10."""


BUILDS = {
    "grbl": Build("Grbl 1.1h ['$' for help]", ("[VER:1.1h.20190825:]", "[OPT:V,15,128]")),
    "grblhal": Build(
        "GrblHAL 1.1f ['$' or '$HELP' for help]",
        ("[VER:1.1f.20240812:]", "[OPT:VNMSL,35,1024,3,0]", "[NEWOPT:ENUMS,RT+,SED]", "[FIRMWARE:grblHAL]"),
        rx=1024, blocks=35, eeprom=False, resets=False, tool="none", report=511,
    ),
    "fluidnc": Build(
        "Grbl 3.7 [FluidNC v3.7.12 (wifi) '$' for help]",
        ("[VER:3.7 FluidNC v3.7.12:]", "[OPT:MPHS]"),
        rx=256, eeprom=False, tool="kept",
    ),
    "drawcore": Build("Grbl 1.1h ['$' for help]", ("[VER:1.1h.20190825:]", "[OPT:V,15,128]"), arcs=False),
}  # fmt: skip


class Grbl(Device):
    """A board with GRBL.

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
        self.settings = _settings(profile, self.build, homing=homing, soft_limits=soft_limits)
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
            fields.append(f"MPos:{_xyz(place)}")
        else:
            fields.append(f"WPos:{_xyz((place[0] - offset[0], place[1] - offset[1], place[2] - offset[2]))}")
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
            fields.append(f"WCO:{_xyz(offset)}")
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
            yield f"[{name}:{_xyz(at)}]"
        yield "[TLO:0.000]"
        yield "[PRB:0.000,0.000,0.000:0]"

    def _message(self, text: str) -> None:
        self.say(f"[MSG:{text}]")


def _settings(profile: Profile, build: Build, *, homing: bool, soft_limits: bool) -> dict[str, str]:
    speeds, machine = profile.speeds, profile.machine
    steps, z = speeds.steps_mm or 250.0, getattr(profile.tool, "rate_mm_min", 500.0)
    values: dict[str, float | int] = {
        "0": 10, "1": 25, "2": 0, "3": 0, "4": 0, "5": 0, "6": 0, "10": build.report,
        "11": speeds.junction_deviation_mm,
        "12": 0.002, "13": 0, "20": int(soft_limits), "21": 0, "22": int(homing), "23": 3, "24": 25.0, "25": 500.0,
        "26": 250, "27": 1.0, "30": 1000, "31": 0, "32": 0, "100": steps, "101": steps, "102": steps,
        "110": speeds.rate_mm_min[0], "111": speeds.rate_mm_min[1], "112": z,
        "120": speeds.acceleration_mm_s2[0], "121": speeds.acceleration_mm_s2[1], "122": speeds.acceleration_mm_s2[0],
        "130": machine.x_mm[1] - machine.x_mm[0], "131": machine.y_mm[1] - machine.y_mm[0], "132": 200.0,
    }  # fmt: skip
    return {key: str(value) if isinstance(value, int) else f"{value:.3f}" for key, value in values.items()}


def _xyz(place: Place) -> str:
    return ",".join(f"{at:.3f}" for at in place)
