"""Jobs as a machine of states: any order of faults, wishes, kills, nights and runs, looked at after every run.

Schedules (test_faults_any.py) are laid out before a job begins; here each step follows from what the last one left. No
byte to the machine is damaged but where its protocol would see that: then the journal may claim nothing that is not on
the paper.
"""

from __future__ import annotations

from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test
from rehearsal import MOST_RUNS, Rehearsal, lines_of, missing, run_once, set_right, short_job
from schedules import CLEAN, DIRTY, LONG, MACHINES, SAFE, WISHES, judge

from strokeplan.plotter.driving.codecs import baud_of
from strokeplan.plotter.driving.journal import Journal, passed
from strokeplan.plotter.driving.streamer import Wish
from strokeplan.plotter.simulating.faults import Fault, Faults, Faulty
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort

SOON = {"s": 20.0, "bytes": 800.0, "lines": 80.0}
"""A fault strikes within this of now."""
MOST_WAITING = 3
NEVER = Fault("noise", inf)
CASES = [(machine, variant) for machine, variants in MACHINES.items() for variant in variants]


class Plotting(RuleBasedStateMachine):
    """A job, its log, a machine with a person beside it; and what goes wrong."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = TemporaryDirectory()
        self.log = Path(self.folder.name) / "progress.log"
        self.wishes: list[tuple[float, Wish]] = []
        self.dies_s = inf

    @initialize(case=st.sampled_from(CASES))
    def begin(self, case: tuple[str, str]) -> None:
        self.machine, variant = case
        job = short_job(self.machine)
        device = firmware(job.profile, faults=Faults((NEVER,)), variant=variant)
        assert isinstance(device, Faulty)
        self.device = device
        self.result = Rehearsal(job, SimulatedPort(device, baud_of(job.profile)), [])

    @property
    def running(self) -> bool:
        return not self.result.finished

    @property
    def now(self) -> float:
        return self.result.port.now()

    @precondition(lambda self: self.running and len(self.device.waiting) <= MOST_WAITING)
    @rule(
        kind=st.sampled_from(CLEAN + DIRTY), unit=st.sampled_from(list(SOON)), soon=st.floats(0, 1),
        amount=st.floats(0, 1), data=st.binary(max_size=6),
    )  # fmt: skip
    def trouble(self, kind: str, unit: str, soon: float, amount: float, data: bytes) -> None:
        """Something will go wrong."""
        if kind in DIRTY and self.machine not in SAFE:
            return
        count = {"s": self.now, "bytes": self.device.bytes_in, "lines": self.device.lines_out}[unit]
        much = amount * LONG[kind] if kind in LONG else 1 + int(2 * amount)
        self.device.waiting.append(Fault(kind, count + soon * SOON[unit], unit, much, data))  # type: ignore[arg-type]

    @precondition(lambda self: self.running)
    @rule(after_s=st.floats(1, 30), wish=st.sampled_from(WISHES))
    def want(self, after_s: float, wish: Wish) -> None:
        """The person will press a key."""
        self.wishes = sorted([*self.wishes, (self.now + after_s, wish)], key=lambda one: one[0])[:2]

    @precondition(lambda self: self.running)
    @rule(after_s=st.floats(0, 30))
    def kill(self, after_s: float) -> None:
        """The next run's process will be killed."""
        self.dies_s = self.now + after_s

    @precondition(lambda self: self.result.runs)
    @rule(off=st.booleans(), seconds=st.floats(0, 100))
    def night(self, off: bool, seconds: float) -> None:
        """Time passes after a run, and perhaps the machine is switched off."""
        if off:
            self.device.device.power_cut(self.now)
        self.result.port.wait(seconds)

    @precondition(lambda self: self.running)
    @rule()
    def run(self) -> None:
        """The job is drawn on, as far as it goes; then the journal is held against the paper."""
        result = self.result
        if result.runs:
            set_right(result.port, result.job)
            result.port = result.port.reopen(1.0)
        run = run_once(result.job, result.port, self.log, self.wishes, dies_s=self.dies_s)
        result.runs.append(run)
        self.wishes = [one for one in self.wishes if one[0] > self.now]
        self.dies_s = inf
        assert not (run.pen_down and run.ending.pen_up), f"the pen is down after: {run.ending}"
        self._proven()

    def _proven(self) -> None:
        """What the journal says is drawn lies on the paper."""
        done, _ = passed(self.log.read_bytes())
        gone = {int(line.split()[1].rstrip(":")) for line in missing(self.result.job, self.device.drawn)}
        assert not {j for j in gone if j < done}, f"{gone} are missing, and the journal says that {done} are drawn"

    def teardown(self) -> None:
        try:
            if not hasattr(self, "result"):
                return
            self.device.waiting.clear()
            self.wishes.clear()
            while self.running and len(self.result.runs) < MOST_RUNS:
                self.run()
            judge(self.result, self.machine, Faults(tuple(fault for _, fault in self.device.happened)))
        finally:
            self.folder.cleanup()


TestPlotting = Plotting.TestCase
TestPlotting.settings = settings(
    max_examples=60, stateful_step_count=12, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)


def test_a_journal_that_runs_ahead_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine of states itself: a fence that proves one line too many is found."""
    honest = Journal.advance

    def ahead(self: Journal, key: int, now: float) -> None:
        honest(self, min(key + 1, len(lines_of(short_job("grbl_servo"))) - 1), now)

    monkeypatch.setattr(Journal, "advance", ahead)
    once = settings(
        max_examples=60, stateful_step_count=8, derandomize=True, database=None, phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow], report_multiple_bugs=False,
    )  # fmt: skip
    with pytest.raises(AssertionError, match="are missing"):
        run_state_machine_as_test(Plotting, settings=once)
