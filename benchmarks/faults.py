"""Thousands of schedules of faults: every job is drawn to its end, resumed as often as it takes.

    python benchmarks/faults.py [--count 10000] [--first 0] [--machine NAME ...] [--threads N] [--quiet]

Each schedule comes from its number alone, so that one that fails can be run again: --first NUMBER --count 1. What is
checked stands in tests/plotter/driving/rehearsal.py: everything is drawn, nothing that was proven is drawn again, the
pen is up at every stop that the machine could be told of, no settings were sent. Prints what failed, with the smallest
part of its schedule that still fails, and exits 1 if anything did.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "plotter"), str(ROOT / "tests" / "plotter" / "driving")]

from rehearsal import NEAR_MM, Rehearsal, check, lines_of, rehearse, short_job  # noqa: E402

from strokeplan.plotter.driving.streamer import Wish  # noqa: E402
from strokeplan.plotter.simulating.faults import Fault, Faults  # noqa: E402

MACHINES = {
    "grbl_servo": ("grbl", "grbl-no-reset"), "grbl_z": ("grbl",), "grblhal": ("grblhal",),
    "fluidnc": ("fluidnc",), "idraw_2": ("drawcore",),
    "ender3": ("marlin", "marlin-no-ok-after-resend", "marlin-emergency-parser"),
    "axidraw_v3": ("ebb-2.8", "ebb-2.5", "ebb-3.0", "ebb-3.0-future"), "nextdraw_2234": ("ebb-3.0",),
    "hp7475a": ("7475A",), "roland_dxy": ("DXY",), "uarm_swift_pro": ("uarm",),
}  # fmt: skip
CLEAN = ("drop-reply", "duplicate-reply", "delay-reply", "noise", "silence", "slow", "reset", "alarm", "refuse",
         "unplug", "power-cut", "button", "partial", "corrupt-reply")  # fmt: skip
"""Faults after which nothing wrong may be on the paper."""
DIRTY = ("drop-bytes", "corrupt-bytes")
"""Faults that a protocol without checksums cannot see: a coordinate may be another one."""
SAFE = ("ender3",)
"""Machines whose protocol has checksums: nothing wrong there, either."""
BLIND = {
    **dict.fromkeys(("grbl_servo", "grbl_z", "grblhal", "fluidnc", "idraw_2", "hp7475a", "roland_dxy"), "refuse"),
    **dict.fromkeys(("axidraw_v3", "nextdraw_2234"), "alarm"),
}  # fmt: skip
"""A fault that is only found when more has been drawn: what lies in GRBL's ring or a plotter's buffer is carried out
behind a refused command; an EBB counts on when its motors have lost their supply. All must be drawn all the same."""
LEVERS = ("hp7475a", "roland_dxy")
LONG = {"silence": 8.0, "slow": 0.4, "delay-reply": 6.0}
OVERRUN_MM = 5.0
LIMIT_S = 20
"""Of real time, for a schedule that takes a tenth of a second as a rule."""
WISHES = (Wish.PAUSE, Wish.STOP, Wish.EMERGENCY)


def schedule(number: int, machine: str) -> tuple[str, Faults, list[tuple[float, Wish]]]:
    """Variant, faults and a person's wishes of a number."""
    rng = np.random.default_rng([number, len(machine), *machine.encode()])
    variants = MACHINES[machine]
    kinds = CLEAN + (DIRTY if rng.random() < 0.3 else ())
    faults = []
    for _ in range(int(rng.integers(1, 5))):
        kind = str(rng.choice(kinds))
        unit = str(rng.choice(["s", "bytes", "lines"]))
        most = {"s": 60.0, "bytes": 2500.0, "lines": 250.0}[unit]
        at = round(float(rng.uniform(0, most)), 2 if unit == "s" else 0)
        amount = round(float(rng.uniform(0, LONG[kind])), 2) if kind in LONG else int(rng.integers(1, 4))
        faults.append(Fault(kind, at, unit, amount, bytes(rng.integers(0, 256, 4, np.uint8))))  # type: ignore[arg-type]
    if machine in LEVERS:  # somebody lowers it again
        faults.append(Fault("alarm", 90.0, "s", 0))
    wishes = [(round(float(rng.uniform(3, 60)), 2), WISHES[int(rng.integers(3))])] if rng.random() < 0.3 else []
    return str(rng.choice(variants)), Faults(tuple(faults)), wishes


def outcome(machine: str, variant: str, faults: Faults, wishes: list[tuple[float, Wish]]) -> tuple[str, int]:
    """What went wrong, "" for nothing, and how many runs it took."""
    signal.signal(signal.SIGALRM, _hangs)
    signal.alarm(LIMIT_S)
    with tempfile.TemporaryDirectory() as folder:
        try:
            result = rehearse(short_job(machine), Path(folder), faults=faults, variant=variant, wishes=list(wishes))
            _judge(result, machine, faults)
        except AssertionError as error:
            return " ".join(str(error).split())[:300] or "assertion", 0
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            return f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})", 0
        finally:
            signal.alarm(0)
    return "", len(result.runs)


def _judge(result: Rehearsal, machine: str, faults: Faults) -> None:
    """Raise AssertionError for what is wrong on the paper, as far as these faults let it be right."""
    kinds = {fault.kind for fault in faults.faults}
    if machine in SAFE or not kinds & set(DIRTY):
        check(result)
        wrong = 0 if BLIND.get(machine) in kinds else _strays(result)
        if wrong:
            raise AssertionError(f"{wrong} points lie where nothing should")
    elif result.port.device.forbidden:
        raise AssertionError(f"forbidden: {result.port.device.forbidden}")
    for run in result.runs:
        if run.pen_down and run.ending.pen_up:
            raise AssertionError(f"the pen is down after: {run.ending}")


def _strays(result: Rehearsal) -> int:
    """Points where nothing should be, but for what motors that were stopped at speed drew on."""
    device = result.port.device
    stops = set(getattr(device, "device", device).dead_stops)
    drawn, everything = device.drawn, np.concatenate(lines_of(result.job))
    count = 0
    for line, times in zip(drawn.lines, drawn.times, strict=True):
        far = [np.hypot(*(everything - point).T).min() > NEAR_MM + 0.15 for point in line]
        home = np.hypot(*line.T) < 1.0
        overrun = np.zeros(len(line), bool)
        if times[-1] in stops:
            overrun = np.hypot(*(line - line[-1]).T) < OVERRUN_MM
        count += int((far & ~home & ~overrun).sum())
    return count


def _hangs(*_: object) -> None:
    raise TimeoutError(f"hangs: more than {LIMIT_S} s for one schedule")


def smallest(machine: str, variant: str, faults: Faults, wishes: list[tuple[float, Wish]]) -> tuple[Faults, list]:
    """The schedule without all that it fails without as well."""
    kept = list(faults.faults)
    for fault in faults.faults:
        less = [one for one in kept if one is not fault]
        if outcome(machine, variant, Faults(tuple(less)), wishes)[0]:
            kept = less
    if wishes and outcome(machine, variant, Faults(tuple(kept)), [])[0]:
        wishes = []
    return Faults(tuple(kept)), wishes


def one(number: int, machines: tuple[str, ...]) -> tuple[int, str, int, str]:
    """Number, machine, runs, and a report of what failed."""
    machine = machines[number % len(machines)]
    variant, faults, wishes = schedule(number, machine)
    wrong, runs = outcome(machine, variant, faults, wishes)
    if not wrong:
        return number, machine, runs, ""
    faults, wishes = smallest(machine, variant, faults, wishes)
    wrong = outcome(machine, variant, faults, wishes)[0]
    lines = [f"{number} {machine} {variant}: {wrong}", *(f"    {fault}" for fault in faults.faults)]
    lines += [f"    wish {wish} at {at} s" for at, wish in wishes]
    return number, machine, 0, "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--machine", action="append", choices=list(MACHINES))
    parser.add_argument("--threads", type=int, default=2)
    asked = parser.parse_args()
    machines = tuple(asked.machine or MACHINES)
    begin, failed, runs, each = time.perf_counter(), 0, Counter[int](), Counter[str]()
    numbers = range(asked.first, asked.first + asked.count)
    work = partial(one, machines=machines)
    with ProcessPoolExecutor(asked.threads, get_context("spawn")) as pool:
        for _, machine, took, report in pool.map(work, numbers, chunksize=20):
            each[machine] += 1
            runs[took] += 1
            if report:
                failed += 1
                print(report, flush=True)
    spent = time.perf_counter() - begin
    print(f"{asked.count:,} schedules in {spent:.0f} s, {failed} failed")
    print("by machine:", ", ".join(f"{name} {count}" for name, count in sorted(each.items())))
    print("runs each took:", ", ".join(f"{took}: {count}" for took, count in sorted(runs.items()) if took))
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
