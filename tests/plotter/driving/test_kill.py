"""The real program on a real terminal, killed where it stands: what it has left behind continues the job.

The machine is simulated in a thread, at twenty times its speed. Nobody is told of a `kill -9`: the journal must do.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from rehearsal import missing

from strokeplan.formats import save
from strokeplan.plotter.cutting import straight
from strokeplan.plotter.driving import jobs
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.program import PlotOptions, Program, program
from strokeplan.plotter.simulating.firmware import Firmware, firmware
from strokeplan.plotter.simulating.serving import PtyServer, serve
from strokeplan.strokes import StrokePlan

pytest.importorskip("serial")
SPEED = 20.0
ROUNDS = int(os.environ.get("STROKEPLAN_KILLS", "2"))


class _OverError(Exception):
    pass


@dataclass
class Bench:
    """A machine behind a terminal, whose carriage somebody puts to its origin each time that the port is closed."""

    device: Firmware
    url: str
    lengths: list[float] = field(default_factory=list)


@contextmanager
def bench(name: str) -> Iterator[Bench]:
    server, device = PtyServer(), firmware(load_profile(name))
    table, over = Bench(device, server.url), threading.Event()
    begin = time.monotonic()

    def clock() -> float:
        if over.is_set():
            raise _OverError
        return (time.monotonic() - begin) * SPEED

    def told(what: str) -> None:
        if what == "closed":
            device.advance(clock() + 20.0)
            table.lengths.append(device.drawn.length_mm)
            device.by_hand((0.0, 0.0), clock() + 20.0, 0.0)  # type: ignore[attr-defined]

    def work() -> None:
        with suppress(_OverError):
            serve(device, server, 10_000_000, told=told, clock=clock)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield table
    finally:
        over.set()
        thread.join()
        server.close()


def plan_of(lines: int) -> StrokePlan:
    sys.path.insert(0, str(Path(__file__).parent.parent))
    from drawings import drawing

    rows = [straight(np.array([[5.0, 5.0 + 2 * k], [75.0, 5.0 + 2 * k]]), np.array([2])) for k in range(lines)]
    return drawing(rows, (80.0, 75.0))


def start(*words: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "strokeplan", *map(str, words)]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def wait_for(ready: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + 60
    while not ready():
        if process.poll() is not None:
            assert process.stdout is not None
            pytest.fail(f"it has ended: {process.stdout.read().decode()}")
        if time.monotonic() > until:
            process.kill()
            pytest.fail(f"nothing happens: {ended(process)}")
        time.sleep(0.01)


def ended(process: subprocess.Popen[bytes]) -> str:
    out, _ = process.communicate(timeout=120)
    return out.decode()


def job_of(plan: Path) -> Program:
    from strokeplan.formats import load

    return program(load(plan), load_profile("grbl_servo"), PlotOptions(keep_order=True))


@pytest.mark.slow
def test_what_is_killed_is_resumed_and_nothing_is_missing(tmp_path: Path) -> None:
    plan, folder = tmp_path / "plan.json", tmp_path / "jobs"
    save(plan_of(30), plan)
    rng = np.random.default_rng(7)

    def done() -> int:
        found = [job for job in jobs.listed(folder) if isinstance(job, jobs.Job)]
        return found[0].done if found else 0

    with bench("grbl_servo") as table:
        words: tuple[object, ...] = ("plot", plan, "--profile", "grbl_servo", "--port", table.url, "--keep-order")
        for _ in range(ROUNDS):
            before, more = done(), int(rng.integers(1, 24 // ROUNDS))
            process = start(*words, "--yes", "--jobs", folder)
            wait_for(lambda target=before + more: done() >= target, process)  # type: ignore[misc]
            process.kill()
            ended(process)
            assert before < done() <= 30
            words = ("resume", "last")
        said = ended(start(*words, "--yes", "--jobs", folder))
        assert "all 30 strokes" in said
    assert not missing(job_of(plan), table.device.drawn)
    twice = table.device.drawn.length_mm - 30 * 70.0
    assert twice <= ROUNDS * 5 * 70.0, "more was drawn again than was under way"
    assert table.device.forbidden == ()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_stop_safely_and_say_how_to_go_on(number: signal.Signals, tmp_path: Path) -> None:
    plan, folder = tmp_path / "plan.json", tmp_path / "jobs"
    save(plan_of(30), plan)
    with bench("grbl_servo") as table:
        process = start("plot", plan, "--profile", "grbl_servo", "--port", table.url, "--yes", "--jobs", folder)
        wait_for(lambda: any(isinstance(job, jobs.Job) and job.done > 1 for job in jobs.listed(folder)), process)
        process.send_signal(number)
        said = ended(process)
    assert process.returncode == 1
    assert "error: stopped; " in said
    assert "the pen is up" in said
    name = next(folder.iterdir()).name
    assert said.strip().endswith(f"continue with: strokeplan resume {name}")
    assert not table.device.pen_down


@pytest.mark.slow
def test_keys_pause_and_stop(tmp_path: Path) -> None:
    """On a terminal: Enter says that all is in place, p pauses, p goes on, s stops."""
    plan, folder = tmp_path / "plan.json", tmp_path / "jobs"
    save(plan_of(30), plan)
    screen, keys = os.openpty()

    def done() -> int:
        return max((job.done for job in jobs.listed(folder) if isinstance(job, jobs.Job)), default=-1)

    with bench("grbl_servo") as table:
        words = ["plot", plan, "--profile", "grbl_servo", "--port", table.url, "--jobs", folder, "-q"]
        command = [sys.executable, "-m", "strokeplan", *map(str, words)]
        process = subprocess.Popen(command, stdin=keys, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        wait_for(lambda: bool(os.write(screen, b"\n")) and done() >= 0, process)  # what is typed before it asks is lost
        wait_for(lambda: done() > 2, process)
        os.write(screen, b"p")
        time.sleep(0.5)  # ten seconds of the machine: what it has is drawn by then
        paused = done()
        time.sleep(0.3)
        assert done() == paused
        os.write(screen, b"p")
        wait_for(lambda: done() > paused, process)
        os.write(screen, b"s")
        said = ended(process)
    os.close(screen)
    os.close(keys)
    assert process.returncode == 1
    assert "the paper is in place; the pen stands at the origin, up; then Enter, or s to stop" in said
    assert "error: stopped; " in said
    assert not table.device.pen_down
