"""Schedules of faults, and what must be true of a job after any of them; shared by tests and benchmarks/faults.py."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))
from rehearsal import NEAR_MM, Rehearsal, check, lines_of, rehearse, short_job

from strokeplan.plotter.driving.streamer import Wish
from strokeplan.plotter.simulating.faults import Fault, Faults

MACHINES = {
    "grbl_servo": ("grbl", "grbl-no-reset"), "grbl_z": ("grbl",), "grblhal": ("grblhal",), "fluidnc": ("fluidnc",),
    "idraw_2": ("drawcore",), "ender3": ("marlin", "marlin-no-ok-after-resend", "marlin-emergency-parser"),
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
LOWERED = Fault("alarm", 90.0, "s", 0)
"""Somebody lowers the paper's lever again."""
LONG = {"silence": 8.0, "slow": 0.4, "delay-reply": 6.0}
MOST = {"s": 60.0, "bytes": 2500.0, "lines": 250.0}
WISHES = (Wish.PAUSE, Wish.STOP, Wish.EMERGENCY)
OVERRUN_MM = 5.0
Wishes = list[tuple[float, Wish]]


def numbered(number: int, machine: str) -> tuple[str, Faults, Wishes]:
    """Variant, faults and a person's wishes of a number, always the same."""
    rng = np.random.default_rng([number, len(machine), *machine.encode()])
    kinds = CLEAN + (DIRTY if rng.random() < 0.3 else ())
    faults = []
    for _ in range(int(rng.integers(1, 5))):
        kind, unit = str(rng.choice(kinds)), str(rng.choice(list(MOST)))
        at = round(float(rng.uniform(0, MOST[unit])), 2 if unit == "s" else 0)
        amount = round(float(rng.uniform(0, LONG[kind])), 2) if kind in LONG else int(rng.integers(1, 4))
        faults.append(Fault(kind, at, unit, amount, bytes(rng.integers(0, 256, 4, np.uint8))))  # type: ignore[arg-type]
    if machine in LEVERS:
        faults.append(LOWERED)
    wishes = [(round(float(rng.uniform(3, 60)), 2), WISHES[int(rng.integers(3))])] if rng.random() < 0.3 else []
    return str(rng.choice(MACHINES[machine])), Faults(tuple(faults)), wishes


@st.composite
def faults(draw: st.DrawFn) -> Fault:
    """Any fault at any moment of a short job."""
    kind = draw(st.sampled_from(CLEAN + DIRTY))
    unit = draw(st.sampled_from(list(MOST)))
    at = draw(st.integers(0, int(MOST[unit])))
    amount = draw(st.integers(1, 3)) if kind not in LONG else draw(st.integers(1, 20)) * LONG[kind] / 20
    return Fault(kind, at, unit, amount, draw(st.binary(max_size=6)))  # type: ignore[arg-type]


schedules = st.lists(faults(), min_size=1, max_size=4)
wishes = st.lists(st.tuples(st.integers(3, 60).map(float), st.sampled_from(WISHES)), max_size=1)


def draw_it(machine: str, variant: str, schedule: Faults, wished: Wishes, folder: Path) -> int:
    """Draw a short job under a schedule, to its end; how many runs it took. Raises AssertionError for what is wrong."""
    result = rehearse(short_job(machine), folder, faults=schedule, variant=variant, wishes=list(wished))
    judge(result, machine, schedule)
    return len(result.runs)


def judge(result: Rehearsal, machine: str, schedule: Faults) -> None:
    """Raise AssertionError for what is wrong on the paper, as far as these faults let it be right."""
    kinds = {fault.kind for fault in schedule.faults}
    if machine in SAFE or not kinds & set(DIRTY):
        check(result)
        wrong = 0 if BLIND.get(machine) in kinds else _strays(result)
        assert wrong == 0, f"{wrong} points lie where nothing should"
    assert result.port.device.forbidden == ()
    for run in result.runs:
        assert not (run.pen_down and run.ending.pen_up), f"the pen is down after: {run.ending}"


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
