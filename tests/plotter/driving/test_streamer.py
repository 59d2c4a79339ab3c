"""The streamer and people: pauses, stops, questions, a disk that is full."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drawings import BAR, EYE, SWAN, drawing
from rehearsal import Person, Rehearsal, check, lines_of, missing, rehearse, short_job

from strokeplan.errors import OutputError
from strokeplan.plotter.driving.codecs import baud_of, codec_for
from strokeplan.plotter.driving.link import Link
from strokeplan.plotter.driving.streamer import Ending, Keeper, Streamer, Wish
from strokeplan.plotter.driving.units import script
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.program import Program, program
from strokeplan.plotter.simulating.faults import Fault, Faults
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort

ONE_EACH = ("grbl_servo", "grbl_z", "ender3", "axidraw_v3", "hp7475a", "uarm_swift_pro")


class Memory:
    """A keeper that keeps nothing, or fails at a unit."""

    def __init__(self, full_at: int | None = None) -> None:
        self.full_at, self.keys = full_at, list[int]()

    def advance(self, key: int, now: float) -> None:
        if key == self.full_at:
            raise OutputError("progress cannot be written down (No space left on device)")
        self.keys.append(key)

    def settle(self) -> None:
        pass


class Timed(Person):
    """Notes when it is asked."""

    def ask(self, text: str) -> bool:
        self.moments.append((self.port.now(), self.port.device.pen_down))
        self.places.append(self.port.device.place_mm)
        self.port.wait(30.0)
        return super().ask(text)


def drive(
    job: Program, keeper: Keeper, wishes: list[tuple[float, Wish]] | None = None, copies: int = 1
) -> tuple[Ending, Timed]:
    port = SimulatedPort(firmware(job.profile), baud_of(job.profile))
    person = Timed(port, list(wishes or ()))
    person.moments, person.places = [], []
    work = script(job, copies)
    codec = codec_for(job.profile, work.phrases(0))
    link = Link(port, emergency=person.emergency)
    codec.greet(link)
    return Streamer(link, codec, work, person, keeper).run(), person


@pytest.mark.parametrize("name", ONE_EACH)
def test_while_a_job_is_paused_the_pen_is_up_and_nothing_rests_on_the_paper(name: str, tmp_path: Path) -> None:
    job = short_job(name)
    plain = rehearse(job, tmp_path)
    half = plain.port.now() / 2
    wishes = [(half, Wish.PAUSE), (half + 30, Wish.PAUSE)]
    result = rehearse(job, tmp_path, wishes=wishes)
    check(result)
    assert len(result.runs) == 1
    assert result.port.now() > plain.port.now() + 20
    assert result.port.device.drawn.rests == ()


@pytest.mark.parametrize("name", ONE_EACH)
def test_a_stop_lifts_the_pen_parks_and_is_resumed(name: str, tmp_path: Path) -> None:
    job = short_job(name)
    half = rehearse(job, tmp_path).port.now() * (0.75 if name == "hp7475a" else 0.6)
    result: Rehearsal = rehearse(job, tmp_path, wishes=[(half, Wish.STOP)])
    check(result)
    stopped = result.runs[0]
    assert stopped.ending == Ending(stopped.ending.done, False, "stopped", True, True)
    assert 0 < stopped.ending.done < len(job)
    assert not stopped.pen_down


@pytest.mark.parametrize("name", ["grbl_servo", "axidraw_v3"])
def test_the_pen_goes_up_and_down_while_a_job_is_paused(name: str) -> None:
    job = short_job(name)
    wishes = [(4.0, Wish.PAUSE), (14.0, Wish.DOWN), (18.0, Wish.UP), (22.0, Wish.PAUSE)]
    ending, person = drive(job, Memory(), wishes)
    assert ending.finished
    rests = person.port.device.drawn.rests
    assert len(rests) == 1
    assert rests[0][1] - rests[0][0] == pytest.approx(4.0, abs=1.0)


def test_a_change_of_pen_waits_parked_with_the_pen_up() -> None:
    job = program(drawing([SWAN, EYE, BAR], pens=("red", "red", "blue")), load_profile("grbl_servo"))
    keeper = Memory()
    ending, person = drive(job, keeper, copies=2)
    assert ending.finished
    assert ending.done == 6
    assert [text.split(":")[0] for text in person.asked] == [
        "put in pen 'blue' (slot 2)",
        "copy 2 of 2",
        "put in pen 'blue' (slot 2)",
    ]
    assert not any(down for _, down in person.moments)
    assert keeper.keys[-1] == 5
    assert person.port.device.drawn.rests == ()


def test_an_ebb_goes_home_for_a_change_of_pen() -> None:
    job = program(drawing([SWAN, EYE, BAR], pens=("red", "red", "blue")), load_profile("axidraw_v3"))
    ending, person = drive(job, Memory())
    assert ending.finished
    assert person.places[0] == pytest.approx((0.0, 0.0), abs=0.02)
    assert not missing(job, person.port.device.drawn)


def test_a_person_who_says_no_stops_the_job(tmp_path: Path) -> None:
    job = program(drawing([SWAN, BAR], pens=("red", "blue")), load_profile("grbl_servo"))
    port = SimulatedPort(firmware(job.profile))
    person = Person(port)
    person.ask = lambda text: "blue" not in text  # type: ignore[method-assign]
    work = script(job)
    codec = codec_for(job.profile, work.phrases(0))
    codec.greet(Link(port))
    ending = Streamer(Link(port), codec, work, person, Memory()).run()
    assert (ending.done, ending.finished, ending.pen_up) == (1, False, True)


@pytest.mark.parametrize("name", ONE_EACH)
def test_a_disk_that_is_full_stops_the_machine_pen_up(name: str) -> None:
    job = short_job(name)
    ending, person = drive(job, Memory(full_at=2))
    assert not ending.finished
    assert "No space left" in ending.reason
    assert ending.done == 2
    assert ending.pen_up
    assert not person.port.device.pen_down


def test_a_command_that_is_none_of_drawing_stops_the_job(monkeypatch: pytest.MonkeyPatch) -> None:
    job = short_job("grbl_servo")
    monkeypatch.setattr("strokeplan.plotter.driving.scripts.GcodeScript.line", lambda *_: iter(["$100=1"]))
    ending, person = drive(job, Memory())
    assert "'$100=1' is no command of drawing" in ending.reason
    assert person.port.device.forbidden == ()
    assert "$100=1" not in person.port.device.received  # type: ignore[attr-defined]


def test_a_brush_on_a_servo_paints_to_its_end_and_goes_on_with_a_full_one(tmp_path: Path) -> None:
    """Pans and water lie left of the paper; power fails in the second half."""
    plan = drawing(
        [SWAN, EYE, BAR, BAR - 20], widths=np.array([1.0, 3.0, 6.0, 4.0]), pens=("red", "red", "blue", "blue")
    )
    job = program(plan, load_profile("watercolorbot"))
    result = rehearse(job, tmp_path)
    assert [run.ending.finished for run in result.runs] == [True]
    assert not result.port.device.pen_down
    assert missing(job, result.port.device.drawn) == []
    pots = [line for line in result.port.device.drawn.lines if line[:, 0].max() < 70]
    assert [round(float(line[0, 1]), 1) for line in pots] == [40.9, 8.6, 94.5, 171.7, 143.2, 8.6, 94.5, 171.7]
    paper = [line for line in result.port.device.drawn.lines if line[:, 0].max() >= 70]
    assert sum(np.hypot(*np.diff(line, axis=0).T).sum() for line in paper) == pytest.approx(
        sum(np.hypot(*np.diff(line, axis=0).T).sum() for line in lines_of(job)), rel=0.01
    )
    half = 0.75 * result.runs[0].end_s
    again = rehearse(job, tmp_path, faults=Faults((Fault("power-cut", half, "s"),)))
    assert again.finished
    assert missing(job, again.port.device.drawn) == []
    second = again.runs[1]
    assert second.first > 0
    times = [t[0] for line, t in zip(again.port.device.drawn.lines, again.port.device.drawn.times, strict=True)]
    resumed = next(k for k, at in enumerate(times) if at > second.begin_s)
    assert again.port.device.drawn.lines[resumed][0, 0] < 70, "it begins at a pan"


def test_a_marlin_that_was_halted_is_to_be_reset() -> None:
    """It holds the pen where it was, and hears nothing before somebody has pressed its button."""
    ending, person = drive(short_job("ender3"), Memory(), [(5.0, Wish.EMERGENCY)])
    assert "reset the board or switch it off and on" in ending.reason
    assert not ending.pen_up
    person.port.write(b"M115\n")
    person.port.wait(5.0)
    assert b"FIRMWARE_NAME" not in person.port.read(0.0)


def test_an_emergency_stops_at_once() -> None:
    job = short_job("grbl_servo")
    ending, person = drive(job, Memory(), [(5.0, Wish.EMERGENCY)])
    assert (ending.finished, ending.reason) == (False, "emergency stop")
    assert person.port.now() < 5.2
    person.port.wait(0.01)  # two bytes on the wire
    drawn = person.port.device.drawn
    person.port.wait(10.0)
    assert person.port.device.drawn.length_mm == pytest.approx(drawn.length_mm)
    assert not person.port.device.pen_down
    assert np.isfinite(drawn.length_mm)
