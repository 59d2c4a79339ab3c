"""The EiBotBoard, firmware 2.x and 3.x: commands over USB, two motors, a pen's servo, a FIFO of moves.

Replies are as irregular as the board's own: some end in CR LF, some in LF CR, some have an OK behind them. A motion
command is answered once it is in the FIFO; while that is full the parser stands still, and so does USB after 64 bytes:
nothing gets in any more, not even ES. With "future syntax" (CU,10,1) each reply begins with its command's name and
ends in LF; it stays on until the board restarts, for every program that opens the port.

Source: EBB command set, legacy (evil-mad.github.io/EggBot/ebb2.html) and current (ebb.html); EBB release notes.
Known limits: rates of SM and LM are not checked against 25 kHz; the servo keeps its place without power; the form of
QU's replies in legacy syntax is taken from a client.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from math import hypot, inf, sqrt

from strokeplan.plotter.profile import Ebb as Dialect
from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.device import Device, Main
from strokeplan.plotter.simulating.recording import Spot
from strokeplan.plotter.simulating.steppers import Block, Run
from strokeplan.plotter.tools import EbbBrush, EbbServo

USB_BYTES = 64
"""What the board takes while its parser stands still."""
PARSE_S = 0.0005  # [assumed]
ISR_HZ = 25_000
FULL = 1 << 31
SERVO_OFF_S = 60.0
VOLTS_OK, VOLTS_LOST = 300, 8
"""QC's second number with 9 V, and without the motors' supply."""
STIFF = 10.0
"""A motor brakes this much harder than it is asked to before it loses steps …"""
SPRING_MM = 0.4
"""… and springs back from this far: two full steps."""
SETTERS = ["EM", "SC", "CS", "R", "RB", "SR", "ST", "SE", "SN", "SL", "CK", "AC", "C", "PD", "PO", "O", "NI", "CN"]
FORBIDDEN = ("ST", "BL", "MW", "CW", "SL,")


@dataclass(frozen=True, slots=True)
class Move:
    """Steps of motors 1 and 2 in a time."""

    steps: tuple[int, int]
    seconds: float


@dataclass(frozen=True, slots=True)
class Servo:
    """A pulse for the pen's servo, then a wait."""

    pulse: int
    seconds: float


class EbbError(Exception):
    """A command that the board refuses."""


class Ebb(Device):
    """A board with the firmware of a version; `future` leaves another program's future syntax on."""

    blocks = 1

    def __init__(
        self, profile: Profile, version: tuple[int, int, int] = (2, 8, 1), *, future: bool = False,
        at_mm: Spot = (0.0, 0.0),
    ) -> None:  # fmt: skip
        dialect, tool = profile.dialect, profile.tool
        if not (isinstance(dialect, Dialect) and isinstance(tool, EbbServo | EbbBrush)):
            raise TypeError("a profile of another dialect")
        self.version, self.steps_mm, self.tool = version, dialect.steps_mm, tool
        self.corexy = profile.machine.kinematics == "corexy"
        self.future = future
        self.rx: deque[int] = deque()
        self.supply = True
        """Whether the motors have power."""
        self._fails = 0
        self._left_on = future
        super().__init__(profile, resets=False, boot_s=0.5, at_mm=at_mm)

    def _lose(self) -> None:
        self.rx.clear()
        self.fifo: deque[Move | Servo] = deque()
        self.depth = 1
        self.future = self._left_on
        self._left_on = False
        self.motors = [0, 0]
        self.zero = [0, 0]
        self.enabled = False
        self.pulses = {4: 22565, 5: 15302}
        self.pen_up = True
        self.button = False
        self._moving: Move | Servo | None = None
        self._servo_s = -inf
        self._line = bytearray()
        self._name = ""

    # The world

    def press(self, at_s: float) -> None:
        """The PRG button."""
        super().press(at_s)
        self.button = True

    def alarm(self, code: int, at_s: float) -> None:
        """The motors' supply is unplugged; 0: it comes back."""
        super().alarm(code, at_s)
        self._trace(at_s)
        self.supply = code == 0

    def restart(self, at_s: float) -> None:
        """The processor starts anew, and with it its USB: the host's port is gone."""
        super().restart(at_s)
        self.link = False

    def fail(self, code: int) -> None:
        """The next command is taken for an unknown one."""
        self._fails += 1

    # Bytes

    def room(self) -> int:
        """USB waits."""
        if not self.powered:
            return 0
        return max(USB_BYTES - len(self.rx), 0)

    def _take(self, data: bytes) -> None:
        self.rx.extend(data)

    def boot(self) -> Main:
        yield self.now + self.boot_s
        while True:
            yield lambda: bool(self.rx)
            byte = self.rx.popleft()
            if byte not in b"\r\n":
                if len(self._line) < 256:
                    self._line.append(byte)
                continue
            text, self._line = self._line.decode("latin-1").strip().upper(), bytearray()
            if not text:
                continue
            yield self.now + PARSE_S
            self.received.append(text)
            if text.startswith(FORBIDDEN):
                self.forbid(text)
            self._name = text.split(",")[0]
            try:
                if self._fails:
                    self._fails -= 1
                    raise EbbError(_unknown(self._name))
                yield from self._command(self._name, text.split(",")[1:])
            except EbbError as error:
                self._refuse(str(error))

    # Replies

    def _ok(self) -> None:
        self._reply(self._name if self.future else "OK", b"\r\n")

    def _answer(self, text: str, end: bytes = b"\r\n", *, ok: bool = True) -> None:
        """A query's answer, as legacy or future syntax has it."""
        if self.future:
            self._reply(f"{self._name},{text}" if text else self._name, b"\n")
            return
        self._reply(text, end)
        if ok:
            self._reply("OK", b"\r\n")

    def _refuse(self, text: str) -> None:
        self._reply(f"{self._name},{text}" if self.future else text, b"\r\n")

    def _reply(self, text: str, end: bytes) -> None:
        self._out += text.encode("latin-1") + (b"\n" if self.future else end)

    # Commands

    def _command(self, name: str, given: list[str]) -> Main:
        if name in ("SM", "XM", "LM", "SP", "TP", "S2"):
            yield from self._queue(name, given)
        elif name == "HM":
            yield from self._home(_numbers(given, 1, 3))
        elif name.startswith("Q") or name in ("V", "ES", "CU", "PI"):
            self._query(name, given)
        elif name in SETTERS:
            self._set(name, given)
        else:
            raise EbbError(_unknown(name))

    def _queue(self, name: str, given: list[str]) -> Main:
        if name == "SP" and self.version >= (3, 0, 1) and given[:1] in (["2"], ["3"]):
            self._pen_now(given[0])
            return
        item = self._item(name, given)
        if len(self.fifo) >= self.depth and self._moving is not None:
            yield lambda: len(self.fifo) < self.depth
        self.fifo.append(item)
        if isinstance(item, Servo):
            self._servo_s = self.now
        if self._moving is None:
            self._next()
        self._ok()

    def _item(self, name: str, given: list[str]) -> Move | Servo:
        if name == "SM":
            ms, one, *two = _numbers(given, 2, 4)
            return Move((one, two[0] if two else 0), _duration(ms))
        if name == "XM":
            ms, a, b = _numbers(given, 3, 4)[:3]
            return Move((a + b, a - b), _duration(ms))
        if name == "LM":
            v = _numbers(given, 6, 7)
            return Move((v[1], v[4]), max(_lm_seconds(v[0], v[1], v[2]), _lm_seconds(v[3], v[4], v[5])))
        if name == "S2":
            pulse, pin, *rest = _numbers(given, 2, 4)
            return Servo(pulse if pin == self.tool.servo_pin else -1, (rest[1] if len(rest) > 1 else 0) / 1000)
        values = _numbers(given, 1, 3) if name == "SP" else [int(not self.pen_up), *_numbers(given, 0, 1)]
        up, ms = values[0], values[1] if len(values) > 1 else 0
        if up not in (0, 1):
            raise EbbError("!6 Err: Invalid parameter value")
        self.pen_up = bool(up)
        return Servo(self.pulses[4] if up else self.pulses[5], ms / 1000)

    def _pen_now(self, kind: str) -> None:
        self.pen_up = True
        self._servo(self.pulses[4])
        if kind == "3":  # and none that is queued will lower it
            self.fifo = deque(
                Servo(self.pulses[4], item.seconds) if isinstance(item, Servo) else item for item in self.fifo
            )
        self._ok()

    def _home(self, values: list[int]) -> Main:
        yield lambda: self._moving is None and not self.fifo
        target = values[1:] if len(values) == 3 else [0, 0]
        steps = target[0] + self.zero[0] - self.motors[0], target[1] + self.zero[1] - self.motors[1]
        self.fifo.append(Move(steps, max(abs(steps[0]), abs(steps[1])) / max(values[0], 1)))
        self._next()
        self._ok()

    def _query(self, name: str, given: list[str]) -> None:
        version = ".".join(map(str, self.version))
        if name == "V":
            self._answer(f"EBBv13_and_above EB Firmware Version {version}", ok=False)
        elif name == "PI":
            self._reply("PI,0", b"\r\n")
        elif name == "QB":
            self._answer(str(int(self.button)))
            self.button = False
        elif name == "QC":
            self._answer(f"0394,{VOLTS_OK if self.supply else VOLTS_LOST:04d}")
        elif name == "QE":
            self._answer("1,1" if self.enabled else "0,0", b"\n\r")
        elif name == "QG":
            if self.version < (2, 6, 2):
                raise EbbError(_unknown(name))
            self._answer(f"{self._general():02X}", ok=False)
            self.button = False
        elif name == "QM":
            move = self._moving if isinstance(self._moving, Move) else None
            one, two = (int(bool(step)) for step in (move.steps if move else (0, 0)))
            text = f"{int(self._moving is not None)},{one},{two},{int(bool(self.fifo))}"
            if self.future:
                self._answer(text)
            else:
                self._reply(f"QM,{text}", b"\n\r")
        elif name == "QP":
            self._answer(str(int(self.pen_up)), b"\n\r")
        elif name == "QR":
            self._answer(str(int(self.now - self._servo_s < SERVO_OFF_S)), b"\n\r")
        elif name == "QS":
            one, two = self._steps_now()
            self._answer(f"{one - self.zero[0]},{two - self.zero[1]}", b"\n\r")
        elif name == "QT":
            self._answer("")
        elif name in ("QL", "QN"):
            self._answer("0")
        elif name == "QU" and self.version >= (3, 0, 0):
            value = {"2": 32, "6": len(self.fifo)}.get(given[0] if given else "", 0)
            self._answer(f"{given[0]},{value}" if self.future else f"QU,{given[0]},{value}")
        elif name == "ES":
            self._stop_now()
        elif name == "CU":
            self._configure(_numbers(given, 2, 2))
        else:
            raise EbbError(_unknown(name))

    def _general(self) -> int:
        move = self._moving if isinstance(self._moving, Move) else None
        bits = (
            self.version >= (3, 0, 0) and not self.supply, self.button, self.pen_up, self._moving is not None,
            bool(move and move.steps[0]), bool(move and move.steps[1]), bool(self.fifo),
        )  # fmt: skip
        return sum(1 << (6 - k) for k, bit in enumerate(bits) if bit)

    def _configure(self, values: list[int]) -> None:
        option, value = values
        if option == 10 and self.version >= (3, 0, 0):
            self.future = bool(value)
        elif option == 4 and self.version >= (3, 0, 0):
            self.depth = min(max(value, 1), 32)
        self._ok()

    def _set(self, name: str, given: list[str]) -> None:
        if name == "EM":
            values = _numbers(given, 1, 2)
            self.enabled = any(values)
            self.zero = self._steps_now()
        elif name == "SC":
            key, value = _numbers(given, 2, 2)
            self.pulses[key] = value
        elif name == "CS":
            self.zero = self._steps_now()
        elif name == "R":
            self.pulses = {4: 22565, 5: 15302}
            self.enabled = False
        elif name == "RB":
            self.link = False  # it comes back as another port
        self._ok()

    def _stop_now(self) -> None:
        self._trace(self.now)
        move, run = self._moving, self.steppers.run
        was = isinstance(move, Move) and run is not None
        queued = [item.steps for item in self.fifo if isinstance(item, Move)]
        left = [0, 0]
        if isinstance(move, Move) and run is not None:
            here = self._steps_now()
            end = self.motors[0] + move.steps[0], self.motors[1] + move.steps[1]
            left = [abs(end[0] - here[0]), abs(end[1] - here[1])]
            self.motors = here
            self._dead_stop(run)
        self.fifo.clear()
        self._moving = None
        self.steppers.reset(self.steppers.count)
        fifo = [sum(abs(steps[k]) for steps in queued) for k in range(2)]
        self._answer(f"{int(was)},{fifo[0]},{fifo[1]},{left[0]},{left[1]}", b"\n\r")

    def _dead_stop(self, run: Run) -> None:
        """Motors stopped at speed spring back, or lose steps if they would have run on too far."""
        v = run.speed(self.now)
        over = v * v / (2 * STIFF * self.profile.speeds.acceleration_mm_s2[0])
        self.steppers.count = (*self._mm(*self.motors), 0.0)
        if over > SPRING_MM:
            self._overrun(self.steppers.count, over * run.block.unit[0], over * run.block.unit[1])

    # Motion

    def _runs(self) -> bool:
        return True

    def _moved(self, speed: float = 0.0) -> None:
        if isinstance(self._moving, Move):
            self.motors[0] += self._moving.steps[0]
            self.motors[1] += self._moving.steps[1]
        self._moving = None
        self._next()

    def _next(self) -> None:
        """The next of the FIFO begins."""
        while self.fifo and self._moving is None:
            item = self.fifo.popleft()
            if isinstance(item, Servo):
                self._servo(item.pulse)
                if item.seconds <= 0:
                    continue
            self._moving = item
            steps = item.steps if isinstance(item, Move) and self.supply else (0, 0)
            start = self.steppers.count
            x, y = self._mm(*steps)
            length = hypot(x, y)
            seconds = max(item.seconds, 1e-6)
            unit = (x / length, y / length, 0.0) if length else (0.0, 0.0, 0.0)
            acceleration = self.profile.speeds.acceleration_mm_s2[0]
            end = start[0] + x, start[1] + y, 0.0
            block = Block(start, end, length, unit, length / seconds, acceleration, 0.0)
            self.steppers.run = Run(block, self.now, block.speed, block.speed, block.speed, 0.0, seconds, 0.0)
            self._traced_s = self.now

    def _mm(self, one: int, two: int) -> Spot:
        if self.corexy:
            return (one + two) / 2 / self.steps_mm, (one - two) / 2 / self.steps_mm
        return one / self.steps_mm, two / self.steps_mm

    def _steps_now(self) -> list[int]:
        """Where the motors' counts are, the move that runs included."""
        run, move = self.steppers.run, self._moving
        if run is None or not isinstance(move, Move):
            return list(self.motors)
        part = min((self.now - run.begin_s) / (run.end_s - run.begin_s), 1.0)
        return [self.motors[k] + round(part * move.steps[k]) for k in range(2)]

    def _servo(self, pulse: int) -> None:
        if pulse < 0:
            return
        low = self.touch.sweep(pulse)
        self.recorder.settle(self.now)
        self.recorder.pen(self.now + self.touch.late(low), down=low)


def _numbers(given: list[str], least: int, most: int) -> list[int]:
    """A command's parameters. Raises EbbError."""
    if len(given) < least:
        raise EbbError("!5 Err: Need comma next, found: ''" if given else "!4 Err: Missing parameter(s)")
    if len(given) > most:
        raise EbbError(f"!7 Err: Extra characters ',{given[most]}'")
    if not all(re.fullmatch(r"[-+]?\d+", text) for text in given):
        raise EbbError("!6 Err: Invalid parameter value")
    return [int(text) for text in given]


def _duration(ms: int) -> float:
    if not 0 < ms < 1 << 24:
        raise EbbError("!6 Err: Invalid parameter value")
    return ms / 1000


def _lm_seconds(rate: int, steps: int, gain: int) -> float:
    """How long an axis of LM needs: an accumulator of 31 bits, 25,000 additions a second."""
    way = abs(steps) * FULL
    if not way:
        return 0.0
    if gain == 0:
        return way / max(abs(rate), 1) / ISR_HZ
    inner = rate * rate + 2 * gain * way
    if inner < 0:
        raise EbbError("!6 Err: Invalid parameter value")  # it never arrives
    return (-rate + sqrt(inner)) / gain / ISR_HZ


def _unknown(name: str) -> str:
    code = "".join(f"{ord(c):02X}" for c in name[:2])
    return f"!8 Err: Unknown command '{name[:2]}:{code}'"
