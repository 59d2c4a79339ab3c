"""Units: what is streamed is what a file has; pens, copies and brushes are asked for where they should be."""

from __future__ import annotations

import numpy as np
import pytest
from drawings import BAR, EYE, SWAN, drawing
from rehearsal import KNOWN, short_job

from strokeplan.errors import PlotError
from strokeplan.plotter.brush import visits
from strokeplan.plotter.driving.codecs import codec_for
from strokeplan.plotter.driving.units import choose, script
from strokeplan.plotter.files import encode
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.program import PlotOptions, Program, program

OURS = ("M0", "M2", "M400")
"""Of a file alone: whoever streams waits and ends by itself."""


def in_file(job: Program) -> list[str]:
    text = encode(job).decode("ascii")
    return [line for line in text.replace("\r", "\n").split("\n") if line and line[0] not in ";#" and line not in OURS]


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_streamed_is_what_a_file_has(name: str) -> None:
    job = short_job(name)
    work = script(job)
    phrases = work.phrases(0)
    taken = list(work.taken(job.pens[0])) if not name.startswith(("axidraw", "nextdraw")) else []
    drawn = [command for unit in work.units() for command in unit.commands]
    drawn = drawn[len(work.taken(job.pens[0])) :]
    up = () if name.startswith("hp") else phrases.up
    streamed = [*phrases.start, *up, *taken, *drawn, *work.last(), *phrases.park, *phrases.end]
    assert streamed == in_file(job)


@pytest.mark.parametrize("name", KNOWN)
def test_codecs_let_every_command_of_a_drawing_pass(name: str) -> None:
    job = short_job(name)
    work = script(job)
    codec = codec_for(job.profile, work.phrases(0))
    for unit in work.units():
        for command in unit.commands:
            codec.check(command)


def painted() -> Program:
    return program(drawing([SWAN, EYE, BAR] * 3), load_profile("robot_brush"), PlotOptions(keep_order=True))


def test_a_brush_is_filled_before_the_first_line_of_a_resumed_job() -> None:
    job = painted()
    work = script(job)
    dips = [stop.line for stop in visits(job) if stop.kind == "dip"]
    without = next(j for j in range(1, len(job)) if j not in dips)
    first, second = (list(unit.commands) for unit, _ in zip(work.units(without), range(2), strict=False))
    well = job.profile.tool.paints[0].at_mm  # type: ignore[union-attr]
    assert any(f"X{well[0]:g} Y{well[1]:g}" in command for command in first)
    plain = list(script(job).units())[without + 1]
    assert second == list(plain.commands)


def test_the_journal_is_told_how_far_the_brush_has_painted() -> None:
    job = painted()
    work = script(job, copies=2)
    distances = [work.describe(key)[3] for key in range(len(work))]
    points, starts = job.polylines
    length = np.hypot(*np.diff(points[starts[0] : starts[1]], axis=0).T).sum()
    assert distances[0] == pytest.approx(length)
    assert distances[len(job) :] == distances[: len(job)]
    assert work.describe(len(job) + 2)[:3] == (2, int(job.pen[2]), 1)


def test_pens_and_copies_are_asked_for() -> None:
    job = program(drawing([SWAN, EYE, BAR], pens=("red", "red", "blue")), load_profile("grbl_servo"))
    prompts = [unit.prompt for unit in script(job, copies=2).units()]
    assert prompts[:2] == [None, None]  # whoever begins has seen to the first
    assert prompts[2] == "put in pen 'blue' (slot 2)"
    assert prompts[3] == "copy 2 of 2: put in the next sheet; put in pen 'red' (slot 1)"
    resumed = list(script(job, copies=2).units(2))
    assert resumed[0].prompt is None
    assert resumed[0].before == ()


def test_lines_are_chosen_by_number_layer_and_pen() -> None:
    job = program(drawing([SWAN, EYE, BAR], pens=("red", "red", "blue")), load_profile("grbl_servo"))
    assert len(choose(job, first=3)) == 1
    assert len(choose(job, pens=["red"])) == 2
    np.testing.assert_array_equal(choose(job, pens=["blue"]).line(0), job.line(2))
    assert choose(job) is job
    for options, words in (
        ({"first": 4}, "strokes 1 to 3"),
        ({"pens": ["green"]}, "there are red, blue"),
        ({"layers": ["x"]}, "there are ink"),
        ({"first": 3, "pens": ["red"]}, "nothing is left"),
    ):
        with pytest.raises(PlotError, match=words):
            choose(job, **options)  # type: ignore[arg-type]


def test_a_language_without_a_port_is_refused() -> None:
    job = program(drawing([BAR]), load_profile("linuxcnc"))
    with pytest.raises(PlotError, match="linuxcnc cannot be driven"):
        codec_for(job.profile, script(job).phrases(0))
