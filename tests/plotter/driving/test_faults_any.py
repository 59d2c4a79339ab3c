"""Any schedule of faults: over all resumed runs everything is drawn, nothing that was proven twice, the pen is up.

Some hundreds here; benchmarks/faults.py runs thousands. What is found is kept below by its schedule.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rehearsal import check, rehearse, short_job
from schedules import LEVERS, LOWERED, MACHINES, Wishes, draw_it, schedules, wishes

from strokeplan.plotter.driving.streamer import Wish
from strokeplan.plotter.simulating.faults import Fault, Faults

FOUND: list[tuple[str, str, tuple[Fault, ...], Wishes]] = [
    # a line of which a part had been written was cut off and became another one
    (
        "uarm_swift_pro", "uarm",
        (Fault("partial", 400, "bytes"), Fault("drop-reply", 84, "bytes")), [(19.69, Wish.STOP)],
    ),
    # the beginning of a move, left in the board when its cable was pulled, was carried out at the next greeting
    ("axidraw_v3", "ebb-3.0-future", (Fault("corrupt-reply", 692, "bytes", 2), Fault("unplug", 1463, "bytes")), []),
    # a board that started anew during a pause was not heard
    ("idraw_2", "drawcore", (Fault("reset", 11.96),), [(4.54, Wish.PAUSE)]),
    ("ender3", "marlin", (), [(6.32, Wish.EMERGENCY)]),
    ("hp7475a", "7475A", (Fault("alarm", 36, "lines"), LOWERED), []),
]  # fmt: skip


@pytest.mark.parametrize("machine", MACHINES)
@settings(max_examples=20, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_everything_is_drawn_whatever_happens(machine: str, data: st.DataObject) -> None:
    faults = data.draw(schedules) + ([LOWERED] if machine in LEVERS else [])
    variant = data.draw(st.sampled_from(MACHINES[machine]))
    with TemporaryDirectory() as folder:
        draw_it(machine, variant, Faults(tuple(faults)), data.draw(wishes), Path(folder))


@pytest.mark.parametrize(("machine", "variant", "faults", "wished"), FOUND)
def test_what_was_found(
    machine: str, variant: str, faults: tuple[Fault, ...], wished: Wishes, tmp_path: Path
) -> None:  # fmt: skip
    draw_it(machine, variant, Faults(faults), wished, tmp_path)


def test_what_is_missing_is_noticed(tmp_path: Path) -> None:
    """The judgement itself: a line that was not drawn is told, and one that was drawn again."""
    result = rehearse(short_job("grbl_servo"), tmp_path)
    recorder = result.port.device.recorder
    lost = recorder._lines[2]
    recorder._lines[2] = lost[:1]
    with pytest.raises(AssertionError, match="line 2"):
        check(result)
    recorder._lines[2] = lost
    check(result)
    result.runs[0].first = 3
    with pytest.raises(AssertionError, match="again"):
        check(result)
