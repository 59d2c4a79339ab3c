"""What simulated machines draw of files that strokeplan writes is what was to be drawn."""

from __future__ import annotations

from itertools import pairwise

import msgspec
import numpy as np
import pytest
from drawings import THREE
from hosts import Host, play
from readers import distance

from strokeplan.page import Page
from strokeplan.plotter.files import encode
from strokeplan.plotter.layout import LayoutOptions
from strokeplan.plotter.profile import Gcode, load_profile
from strokeplan.plotter.program import PlotOptions, Program, program
from strokeplan.plotter.simulating.drawing import as_plan
from strokeplan.plotter.tools import AngleServo

MACHINES = [
    ("grbl_servo", None), ("grbl_z", None), ("grblhal", None), ("fluidnc", None), ("idraw_2", None), ("ender3", None),
    ("axidraw_v3", "ebb-2.5"), ("axidraw_v3", "ebb-2.8"), ("nextdraw_2234", "ebb-3.0"), ("hp7475a", None),
    ("hp7470a", None), ("roland_dxy", None), ("uarm_swift_pro", None), ("dexarm", None),
]  # fmt: skip


def lines(job: Program) -> list[np.ndarray]:
    points, starts = job.polylines
    return [points[a:b] for a, b in pairwise(starts.tolist())]


@pytest.mark.parametrize(("name", "variant"), MACHINES)
def test_it_draws_what_the_file_says(name: str, variant: str | None) -> None:
    profile = load_profile(name)
    page = Page(297, 210, 40) if profile.papers else None
    job = program(THREE, profile, PlotOptions(LayoutOptions(page=page)))
    host = Host(profile, variant=variant)
    play(host, encode(job))
    drawn = host.device.drawn
    assert len(drawn) == len(job)
    # the file's own tolerance, its decimals or units, and what the firmware makes of an arc
    assert distance(list(drawn.lines), lines(job)) <= 2 * profile.tolerance_mm + 0.03
    assert not host.device.pen_down
    assert not drawn.rests
    assert host.device.forbidden == ()
    assert all(np.all(np.diff(times) >= 0) for times in drawn.times)


def test_a_servo_of_marlin_and_arcs_and_cubics() -> None:
    tool = AngleServo(index=1, up_deg=90, down_deg=40, lower_s=0.15, raise_s=0.1)
    for curves in ("arcs", "cubics"):
        ender = load_profile("ender3")
        dialect = msgspec.structs.replace(ender.dialect, curves=curves)
        profile = msgspec.structs.replace(ender, tool=tool, dialect=dialect)
        assert isinstance(profile.dialect, Gcode)
        job = program(THREE, profile)
        host = Host(profile)
        play(host, encode(job))
        assert len(host.device.drawn) == 3
        assert distance(list(host.device.drawn.lines), lines(job)) <= 0.07


def test_a_servo_that_gets_no_time_draws_something_else() -> None:
    """The simulator tells a file without dwells from a right one: a servo needs its time."""
    job = program(THREE, load_profile("grbl_servo"))
    hasty = b"\n".join(line for line in encode(job).split(b"\n") if not line.startswith(b"G4"))
    host = Host("grbl_servo")
    play(host, hasty)
    assert distance(list(host.device.drawn.lines), lines(job)) > 1


@pytest.mark.parametrize("name", ["grbl_servo", "axidraw_v3", "uarm_swift_pro", "hp7475a"])
def test_what_was_drawn_as_a_plan_stands_upright(name: str) -> None:
    """Seen as the plan was, wherever the machine's axes grow: on its whole travel."""
    profile = load_profile(name)
    page = Page(297, 210, 40) if profile.papers else None
    job = program(THREE, profile, PlotOptions(LayoutOptions(page=page)))
    host = Host(profile)
    play(host, encode(job))
    plan = as_plan(host.device.drawn, profile)
    shown = [chain[::3] for chain in plan]
    back = [job.transform.points(line * 0 + line) for line in shown]  # a travel that begins at the page's corner
    assert {layer.name for layer in plan.layers} <= {"pen 1"}
    spans = [np.ptp(np.concatenate(group), axis=0) for group in (back, lines(job))]
    assert np.allclose(spans[0], spans[1], atol=0.2)
    first = max(shown, key=lambda line: np.ptp(line[:, 0]))  # SWAN is the widest, and lies above EYE and BAR
    others = np.concatenate([line for line in shown if line is not first])
    assert first[:, 1].mean() < others[:, 1].mean()
