"""Thousands of schedules of faults: every job is drawn to its end, resumed as often as it takes.

    python benchmarks/faults.py [--count 10000] [--first 0] [--machine NAME …] [--threads N]

Each schedule comes from its number alone, so that one that fails can be run again: --first NUMBER --count 1. What is
checked stands in tests/plotter/driving (rehearsal.py, schedules.py): everything is drawn, nothing that was proven is
drawn again, nothing lies elsewhere, the pen is up at every stop that the machine could be told of, no settings were
sent. Prints what failed, with the smallest part of its schedule that still fails, and exits 1 if anything did.
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

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "plotter"), str(ROOT / "tests" / "plotter" / "driving")]

from rehearsal import short_job  # noqa: E402
from schedules import MACHINES, Wishes, draw_it, numbered  # noqa: E402

from strokeplan.plotter.simulating.faults import Faults  # noqa: E402

LIMIT_S = 60
"""Of real time, for a schedule that takes a tenth of a second as a rule."""


def outcome(machine: str, variant: str, faults: Faults, wishes: Wishes) -> tuple[str, int]:
    """What went wrong, "" for nothing, and how many runs it took."""
    signal.signal(signal.SIGALRM, _hangs)
    signal.alarm(LIMIT_S)
    with tempfile.TemporaryDirectory() as folder:
        try:
            return "", draw_it(machine, variant, faults, wishes, Path(folder))
        except AssertionError as error:
            return " ".join(str(error).split())[:300] or "assertion", 0
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            return f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})", 0
        finally:
            signal.alarm(0)


def _hangs(*_: object) -> None:
    raise TimeoutError(f"hangs: more than {LIMIT_S} s for one schedule")


def smallest(machine: str, variant: str, faults: Faults, wishes: Wishes) -> tuple[Faults, Wishes]:
    """The schedule without all that it fails without as well."""
    kept = list(faults.faults)
    for fault in faults.faults:
        less = [one for one in kept if one is not fault]
        if outcome(machine, variant, Faults(tuple(less)), wishes)[0]:
            kept = less
    if wishes and outcome(machine, variant, Faults(tuple(kept)), [])[0]:
        wishes = []
    return Faults(tuple(kept)), wishes


def one(number: int, machines: tuple[str, ...]) -> tuple[str, int, str]:
    """Machine, runs, and a report of what failed."""
    machine = machines[number % len(machines)]
    variant, faults, wishes = numbered(number, machine)
    wrong, runs = outcome(machine, variant, faults, wishes)
    if not wrong:
        return machine, runs, ""
    faults, wishes = smallest(machine, variant, faults, wishes)
    wrong = outcome(machine, variant, faults, wishes)[0]
    lines = [f"{number} {machine} {variant}: {wrong}", *(f"    {fault}" for fault in faults.faults)]
    lines += [f"    {wish} at {at} s" for at, wish in wishes]
    return machine, 0, "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--machine", action="append", choices=list(MACHINES))
    parser.add_argument("--threads", type=int, default=2)
    asked = parser.parse_args()
    begin, failed, runs, each = time.perf_counter(), 0, Counter[int](), Counter[str]()
    numbers = range(asked.first, asked.first + asked.count)
    work = partial(one, machines=tuple(asked.machine or MACHINES))
    warm_up = partial(short_job, next(iter(MACHINES)))  # kernels are compiled outside of the limit
    with ProcessPoolExecutor(asked.threads, get_context("spawn"), warm_up) as pool:
        for machine, took, report in pool.map(work, numbers, chunksize=20):
            each[machine] += 1
            runs[took] += 1
            if report:
                failed += 1
                print(report, flush=True)
    print(f"{asked.count:,} schedules in {time.perf_counter() - begin:.0f} s, {failed} failed")
    print("by machine:", ", ".join(f"{name} {count}" for name, count in sorted(each.items())))
    print("runs each took:", ", ".join(f"{took}: {count}" for took, count in sorted(runs.items()) if took))
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
