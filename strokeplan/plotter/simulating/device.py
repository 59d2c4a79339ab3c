"""What simulated devices have in common: a clock, a program that waits, motors, a pen, and power that may fail.

A firmware's main loop is a generator. It yields what it waits for: a time (a float), or a condition that is asked again
whenever something happened. Nothing runs but in `advance` and `receive`, and only as far as the time that is given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf

from strokeplan.plotter.profile import Profile
from strokeplan.plotter.simulating.recording import Drawn, Recorder, Spot
from strokeplan.plotter.simulating.steppers import Axes, Place, Steppers
from strokeplan.plotter.simulating.touch import Touch

Wait = float | Callable[[], bool]
Main = Iterator[Wait]
PLENTY = 1 << 20
MAX_STEPS = 100_000
"""More steps of a main loop at one moment are a fault of the simulator."""


class Device:
    """A board with motors for x, y, z; firmwares derive from it.

    profile   whose travel, speeds and tool the machine has.
    resets    the board restarts when a host opens the port (DTR), as most do.
    boot_s    from power or reset to the banner; bytes that come meanwhile are lost.
    """

    blocks = 15
    end = b"\r\n"
    """What lines of the device end with."""

    def __init__(self, profile: Profile, *, resets: bool = True, boot_s: float = 1.5, at_mm: Spot = (0.0, 0.0)) -> None:
        self.profile, self.resets, self.boot_s = profile, resets, boot_s
        self.now = 0.0
        self.touch = Touch(profile.tool)
        self.recorder = Recorder(at_mm)
        self.steppers = Steppers(_axes(profile), self.blocks)
        self.slip = (at_mm[0], at_mm[1])
        """Where the pen is, less where the firmware thinks it is."""
        self.z_slip = self.touch.rest_z
        """The pen begins up."""
        self.powered = True
        self.link = True
        self.received: list[str] = []
        """Every line that was taken for a command."""
        self.dead_stops: list[float] = []
        """When motors were stopped at speed: a pen that was down drew on for a bit."""
        self._forbidden: list[str] = []
        self._out = bytearray()
        self._main: Main | None = None
        self._wait: Wait = 0.0
        self._traced_s = 0.0
        self.power_on(0.0)

    # What ports and tests use

    def receive(self, data: bytes, at_s: float) -> None:
        """Bytes that reach the board's receiver."""
        self._run(at_s)
        if self.powered and self.link:
            self._take(data)
            self._settle()

    def advance(self, to_s: float) -> bytes:
        """Run until then; what it sent."""
        self._run(to_s)
        sent = bytes(self._out)
        self._out.clear()
        return sent if self.link else b""

    def next_event_s(self) -> float | None:
        """When it will do something by itself."""
        if self._out:
            return self.now
        due = self._due()
        return None if due == inf else due

    def room(self) -> int:
        """A UART takes what comes."""
        return PLENTY

    @property
    def drawn(self) -> Drawn:
        """What was drawn until now."""
        self._trace(self.now)
        self.recorder.settle(self.now)
        return self.recorder.drawn(self.now)

    @property
    def pen_down(self) -> bool:
        """Whether the pen is on the paper."""
        self._trace(self.now)
        self.recorder.settle(self.now)
        return self.recorder.down

    @property
    def forbidden(self) -> tuple[str, ...]:
        """Commands that change settings, firmware or files."""
        return tuple(self._forbidden)

    @property
    def place_mm(self) -> Spot:
        """Where the pen really is."""
        self._trace(self.now)
        return self.recorder.at

    @property
    def busy(self) -> bool:
        """Whether the motors turn or will."""
        return not self.steppers.idle

    def opened(self, at_s: float) -> None:
        """A host opens the port."""
        self._run(at_s)
        self.link = True
        self._out.clear()
        if not self.powered:
            self.power_on(at_s)
        elif self.resets:
            self.restart(at_s)

    def unplug(self, at_s: float) -> None:
        """The cable is pulled: nothing comes or goes; the board goes on with what it has."""
        self._run(at_s)
        self.link = False

    def power_on(self, at_s: float) -> None:
        """Power comes back: the firmware starts, the pen is where it was."""
        self.now = max(self.now, at_s)
        self.powered = True
        self._start()

    def power_cut(self, at_s: float) -> None:
        """No power: all state is lost; the pen stays as it is."""
        self._stop(at_s)
        self.recorder.freeze(at_s)
        self.powered = self.link = False
        self._main = None
        self._out.clear()

    def restart(self, at_s: float) -> None:
        """The reset line is pulled (DTR, a brown-out, the button on the board)."""
        self._stop(at_s)
        self._start()

    def by_hand(self, to_mm: Spot, at_s: float, z_mm: float | None = None) -> None:
        """Somebody moves the carriage, and a pen on z to a height; the firmware does not know.

        A pen on z counts as lifted until the firmware moves it.
        """
        self._run(at_s)
        self._trace(at_s)
        if self.touch.by_height:
            self.recorder.lift(at_s)
        self.recorder.carry(to_mm, at_s)
        x, y, z = self.steppers.place(at_s)
        self.slip = to_mm[0] - x, to_mm[1] - y
        if z_mm is not None:
            self.z_slip = z_mm - z

    def press(self, at_s: float) -> None:
        """The machine's own button, where it has one."""
        self._run(at_s)

    def alarm(self, code: int, at_s: float) -> None:
        """Something is wrong with the machine (a limit switch, a hot motor)."""
        self._run(at_s)

    def fail(self, code: int) -> None:
        """The next command is refused."""

    # What firmwares write

    def boot(self) -> Main:
        """The firmware from its start on."""
        raise NotImplementedError

    def _take(self, data: bytes) -> None:
        """Bytes at the receiver, now."""
        raise NotImplementedError

    def _lose(self) -> None:
        """What the memory held is gone: a reset."""

    def _moved(self, speed: float = 0.0) -> None:
        """A block was finished at that speed (mm/s); the next one may begin."""
        self.steppers.begin(self.now, speed)

    def _runs(self) -> bool:
        """Whether the main loop may go on."""
        return True

    def say(self, text: str) -> None:
        """Send a line."""
        self._out += text.encode("latin-1") + self.end

    def forbid(self, line: str) -> None:
        """Note a command that changes what stays."""
        self._forbidden.append(line)

    # The machinery

    def _start(self) -> None:
        self.steppers.reset((0.0, 0.0, 0.0))
        self.slip = self.recorder.at
        self._lose()
        self._main, self._wait = self.boot(), self.now

    def _stop(self, at_s: float) -> None:
        """The motors stop dead."""
        self._run(at_s)
        self._trace(at_s)
        before = self.steppers.place(at_s)
        x, y = self.steppers.kill(at_s)
        self._overrun(before, x, y)
        self.z_slip += before[2]

    def _overrun(self, before: Place, x: float, y: float) -> None:
        """Motors stopped at speed run on by what they would have needed to brake; the count does not know."""
        if x or y:
            self.slip = self.slip[0] + x, self.slip[1] + y
            self.recorder.move(self.now, self.now, self._real(before))
            self.dead_stops.append(self.now)

    def _run(self, to_s: float) -> None:
        while True:
            self._settle()
            due = self._due()
            if due > to_s:
                break
            self.now = max(due, self.now)
            self._happen()
        self.now = max(self.now, to_s)

    def _due(self) -> float:
        if not self.powered:
            return inf
        run = self.steppers.run
        due = run.end_s if run else inf
        if not callable(self._wait) and self._main is not None and self._runs():
            due = min(due, self._wait)
        return due

    def _happen(self) -> None:
        run = self.steppers.run
        if run is not None and run.end_s <= self.now:
            self._trace(run.end_s)
            done = self.steppers.finish()
            if not done.braked:
                self._moved(done.v1)
            else:
                self._rested()

    def _rested(self) -> None:
        """A feed hold is complete."""

    def _settle(self) -> None:
        """The main loop goes on as far as it can now."""
        if not self.powered:
            return
        for _ in range(MAX_STEPS):
            if self._main is None or not self._runs() or not self._met():
                return
            main = self._main
            try:
                wait: Wait = next(main)
            except StopIteration:
                self._main = None
            else:
                if self._main is main:  # it may have reset the board
                    self._wait = wait
        raise RuntimeError(f"{type(self).__name__} does not come to rest at {self.now} s")

    def _met(self) -> bool:
        return self._wait() if callable(self._wait) else self._wait <= self.now

    def _real(self, place: Place) -> Spot:
        return place[0] + self.slip[0], place[1] + self.slip[1]

    def _trace(self, to_s: float) -> None:
        """Tell the recorder how the block that runs has moved until then."""
        run = self.steppers.run
        if run is None:
            self._traced_s = to_s
            return
        begin_s, end_s = max(self._traced_s, run.begin_s), min(to_s, run.end_s)
        if end_s < begin_s or (end_s == begin_s and run.end_s > end_s):
            return
        a, b = run.at(begin_s), run.at(end_s)
        if a[2] != b[2]:
            part = self.touch.crossing(a[2] + self.z_slip, b[2] + self.z_slip)
            if part is not None:
                down = self.touch.low(b[2] + self.z_slip)
                self.recorder.settle(begin_s)
                self.recorder.pen(begin_s + part * (end_s - begin_s), down=down)
        self.recorder.move(begin_s, end_s, self._real(b))
        self.recorder.settle(end_s)
        self._traced_s = end_s


def _axes(profile: Profile) -> Axes:
    speeds, z = profile.speeds, getattr(profile.tool, "rate_mm_min", 1000.0)
    rate, acceleration = speeds.rate_mm_min, speeds.acceleration_mm_s2
    return Axes(
        (rate[0] / 60, rate[1] / 60, max(z, 60.0) / 60),
        (acceleration[0], acceleration[1], max(acceleration)),
        speeds.junction_deviation_mm,
    )
