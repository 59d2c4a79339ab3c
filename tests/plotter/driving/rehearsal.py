"""Jobs against simulated machines: run, fail, resume, until all is drawn; then what is on the paper is looked at.

Between runs the person does what the message says: power on, carriage to the origin by hand, pen lifted.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from itertools import count
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))
from drawings import drawing

from strokeplan.errors import StrokeplanError
from strokeplan.plotter.cutting import straight
from strokeplan.plotter.driving.codecs import baud_of, codec_for
from strokeplan.plotter.driving.journal import Journal
from strokeplan.plotter.driving.link import Emergency, Link
from strokeplan.plotter.driving.streamer import Ending, Streamer, Wish
from strokeplan.plotter.driving.units import script
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.program import PlotOptions, Program, program
from strokeplan.plotter.simulating.faults import Faults
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort
from strokeplan.plotter.simulating.recording import Drawn

MOST_RUNS = 25
PATIENCE_S = 40.0
NEAR_MM = 0.12
"""A point this near to a line lies on it: tolerance, steps, and what a hold leaves."""
KNOWN = ("grbl_servo", "grbl_z", "fluidnc", "grblhal", "idraw_2", "ender3", "axidraw_v3", "nextdraw_2234", "hp7475a",
         "uarm_swift_pro", "watercolorbot")  # fmt: skip
_paths = count()


def short_job(name: str, lines: int = 6) -> Program:
    """Zigzags beside each other, of 2 to 5 segments: what is drawn tells which of them it belongs to."""
    profile = load_profile(name)
    chains = []
    across = 20.0 if profile.papers else 0.0
    for k in range(lines):
        n = 3 + (k * 2) % 4
        x = np.linspace(8, 34, n) + across
        y = 8 + across + 9 * k + np.where(np.arange(n) % 2 == 0, 0.0, 3.0)
        chains.append(straight(np.column_stack([x, y]), np.array([len(x)])))
    page = (297.0, 210.0) if profile.papers else (80.0, 75.0)
    return program(drawing(chains, page), profile, PlotOptions(keep_order=True))


@dataclass
class Person:
    """Who sits at the machine: wishes at times of the simulation."""

    port: SimulatedPort
    wishes: list[tuple[float, Wish]] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    alarmed: bool = False
    paused_s: float | None = None

    def wish(self) -> Wish | None:
        if self.alarmed:
            return Wish.EMERGENCY
        if self.wishes and self.port.now() >= self.wishes[0][0]:
            wish = self.wishes.pop(0)[1]
            self.alarmed = wish is Wish.EMERGENCY
            return wish
        if self.paused_s is not None and self.port.now() > self.paused_s + PATIENCE_S:
            self.paused_s = None
            return Wish.PAUSE  # a button of the machine was pressed, and nothing happens
        return None

    def emergency(self) -> bool:
        if self.wishes and self.wishes[0][1] is Wish.EMERGENCY and self.port.now() >= self.wishes[0][0]:
            self.alarmed = True
        return self.alarmed

    def ask(self, text: str) -> bool:
        self.asked.append(text)
        return True

    def note(self, text: str) -> None:
        self.notes.append(text)
        device = getattr(self.port.device, "device", self.port.device)
        if getattr(device, "paused", False):
            device.press(self.port.now())
        if getattr(device, "lever", False):
            device.alarm(0, self.port.now())

    def progress(self, done: int, paused: bool) -> None:
        if not paused:
            self.paused_s = None
        elif self.paused_s is None:
            self.paused_s = self.port.now()


@dataclass
class Run:
    """One run: from which unit, how it ended, when, and whether the pen was up."""

    first: int
    ending: Ending
    begin_s: float
    end_s: float
    pen_down: bool
    reachable: bool


@dataclass
class Rehearsal:
    """All runs of a job, and the machine."""

    job: Program
    port: SimulatedPort
    runs: list[Run]

    @property
    def finished(self) -> bool:
        return bool(self.runs) and self.runs[-1].ending.finished


def rehearse(
    job: Program,
    folder: Path,
    *,
    faults: Faults | None = None,
    variant: str | None = None,
    wishes: list[tuple[float, Wish]] | None = None,
    most: int = MOST_RUNS,
) -> Rehearsal:
    """Draw a job to its end, resuming it as often as it takes."""
    device = firmware(job.profile, faults=faults or Faults(), variant=variant)
    port = SimulatedPort(device, baud_of(job.profile))
    log = folder / f"{next(_paths)}.log"
    result = Rehearsal(job, port, [])
    left = list(wishes or ())
    for _ in range(most):
        run = run_once(job, port, log, left)
        result.runs.append(run)
        if run.ending.finished:
            break
        left = [one for one in left if one[0] > port.now()]
        set_right(port, job)
        port = result.port = port.reopen(1.0)
    return result


class Killed(BaseException):
    """The host's process is gone."""


class _Mortal:
    """A port of a process that is killed at a time: from then on nothing that it tries is done."""

    def __init__(self, port: SimulatedPort, dies_s: float) -> None:
        self.port, self.dies_s = port, dies_s

    def _alive(self) -> SimulatedPort:
        if self.port.now() >= self.dies_s:
            raise Killed
        return self.port

    def write(self, data: bytes) -> int:
        return self._alive().write(data)

    def read(self, timeout_s: float) -> bytes:
        return self._alive().read(timeout_s)

    def now(self) -> float:
        return self._alive().now()

    def close(self) -> None:
        self.port.close()


def run_once(
    job: Program, port: SimulatedPort, path: Path, wishes: list[tuple[float, Wish]], *, dies_s: float = inf
) -> Run:
    """One run of a job from where its log at `path` is, by a process that may be killed at a time."""
    work = script(job)
    person = Person(port, list(wishes))
    log = Journal(path, work.describe, sync=lambda _: None)
    first, begin_s = log.done, port.now()
    link = Link(_Mortal(port, dies_s), emergency=person.emergency)
    codec = codec_for(job.profile, work.phrases(0))
    try:
        codec.greet(link)
        ending = Streamer(link, codec, work, person, log).run(first)
    except Emergency:
        ending = Ending(first, False, "stopped while greeting", False, False)
    except StrokeplanError as error:
        ending = Ending(first, False, f"greeting: {error}", False, False)
    except Killed:
        ending = Ending(first, False, "killed", False, False)
    finally:
        log.close()
    device = port.device
    return Run(first, ending, begin_s, port.now(), device.pen_down, device.link)


def set_right(port: SimulatedPort, job: Program) -> None:
    """What a person does after a run that failed."""
    device = getattr(port.device, "device", port.device)
    port.wait(20.0)
    if not device.powered:
        device.power_on(port.now())
        port.wait(5.0)
    if hasattr(device, "lever"):
        device.lever = device.paused = False
    device.alarm(0, port.now()) if hasattr(device, "supply") else None
    if not hasattr(device, "lever"):  # pen plotters know where they are
        device.by_hand((0.0, 0.0), port.now(), 0.0)
    if device.resets is False and not hasattr(device, "supply") and not hasattr(device, "lever"):
        device.restart(port.now())
        port.wait(3.0)


def lines_of(job: Program) -> list[NDArray[np.float64]]:
    """What should be drawn, as dense points."""
    points, starts = job.polylines
    return [_dense(points[starts[j] : starts[j + 1]]) for j in range(len(job))]


def _dense(line: NDArray[np.float64], step: float = 0.2) -> NDArray[np.float64]:
    if len(line) < 2:
        return line
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    marks = np.union1d(way, np.arange(0.0, way[-1], step))
    return np.column_stack([np.interp(marks, way, line[:, k]) for k in range(2)])


def _gaps(points: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each point to the nearest of the others."""
    if not len(others):
        return np.full(len(points), np.inf)
    return np.array([np.hypot(*(others - point).T).min() for point in points])


def check(result: Rehearsal, near: float = NEAR_MM) -> None:
    """Everything is drawn; no run drew what was proven before it; nothing lies elsewhere; pens are up at stops."""
    assert result.finished, [run.ending.reason for run in result.runs]
    wanted, drawn = lines_of(result.job), result.port.device.drawn
    gone = missing(result.job, drawn, near)
    assert not gone, "; ".join(gone)
    for run in result.runs:
        if run.ending.pen_up or run.ending.finished:
            assert not run.pen_down, f"the pen is down after: {run.ending}"
        for line, times in zip(drawn.lines, drawn.times, strict=True):
            if times[0] < run.begin_s or times[0] > run.end_s:
                continue
            for point in line:
                owners = [j for j, want in enumerate(wanted) if _gaps(point[None], want)[0] <= near + 0.15]
                if np.hypot(*point) > 1.0:
                    assert not owners or max(owners) >= run.first, f"{owners} again, in a run from {run.first}"
    assert result.port.device.forbidden == ()


def missing(job: Program, drawn: Drawn, near: float = NEAR_MM) -> list[str]:
    """The lines of a job that are not drawn from end to end."""
    everything = np.concatenate([np.empty((0, 2)), *map(_dense, drawn.lines)])
    gaps = [_gaps(line, everything) > near + 0.15 for line in lines_of(job)]
    return [f"line {j}: {gap.sum()} of {len(gap)} points are missing" for j, gap in enumerate(gaps) if gap.any()]


def strays(result: Rehearsal, near: float = NEAR_MM) -> int:
    """Points that were drawn where nothing should be (the origin apart)."""
    everything = np.concatenate(lines_of(result.job))
    points = np.concatenate([_dense(line) for line in result.port.device.drawn.lines])
    far = _gaps(points, everything) > near + 0.15
    return int((far & (np.hypot(*points.T) > 1.0)).sum())
