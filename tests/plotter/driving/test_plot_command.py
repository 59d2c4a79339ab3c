"""The command line at the machine: plot, resume, jobs; a simulated machine stands in for the port."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drawings import BAR, EYE, SWAN, THREE, drawing, drawn
from readers import distance
from rehearsal import missing
from typer.testing import CliRunner, Result

from strokeplan.cli import app
from strokeplan.errors import StrokeplanError
from strokeplan.formats import save
from strokeplan.page import parse_page
from strokeplan.pens import load_pens
from strokeplan.plotter.driving import transport
from strokeplan.plotter.layout import LayoutOptions
from strokeplan.plotter.options import PlotOptions
from strokeplan.plotter.profile import load_profile
from strokeplan.plotter.program import program
from strokeplan.plotter.simulating.faults import Fault, Faults
from strokeplan.plotter.simulating.firmware import firmware
from strokeplan.plotter.simulating.port import SimulatedPort
from strokeplan.strokes import StrokePlan


class Bench:
    """A machine on the table: every time that its port is opened, the carriage stands at its origin."""

    def __init__(self, name: str = "grbl_servo", faults: Faults | None = None) -> None:
        self.device = firmware(load_profile(name), faults=faults or Faults())
        self.port: SimulatedPort | None = None
        self.opened: list[tuple[str, int]] = []

    def open(self, url: str, baud: int, **_: object) -> SimulatedPort:
        self.opened.append((url, baud))
        if self.port is None:
            self.port = SimulatedPort(self.device, baud)
        else:
            self.port.wait(20.0)
            board = getattr(self.device, "device", self.device)
            board.by_hand((0.0, 0.0), self.port.now(), 0.0)
            self.port = self.port.reopen(1.0)
        return self.port


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return at(Bench(), monkeypatch)


def at(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr(transport, "open_port", bench.open)
    return bench


def call(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def run(*words: object) -> str:
    result = call(*words)
    if isinstance(result.exception, StrokeplanError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def saved(plan: StrokePlan, folder: Path) -> Path:
    save(plan, folder / "plan.json")
    return folder / "plan.json"


PLOT = ("--profile", "grbl_servo", "--port", "/dev/ttyUSB0", "--yes")


def test_a_plan_is_drawn_as_it_is(bench: Bench, tmp_path: Path) -> None:
    said = run("plot", saved(THREE, tmp_path), *PLOT)
    assert "all 3 strokes" in said
    assert bench.opened == [("/dev/ttyUSB0", 115200)]
    assert bench.device.forbidden == ()
    assert not bench.device.pen_down
    got = [line * [1, -1] + [0, 80] for line in bench.device.drawn.lines]
    assert distance(got, drawn(THREE)) < 0.05
    assert "finished" in run("jobs")
    name = run("jobs").split()[0]
    with pytest.raises(StrokeplanError, match="is finished"):
        run("resume", name)
    assert f"removed {name}" in run("jobs", "remove", name)
    assert run("jobs") == ""


def test_a_dry_run_opens_nothing_and_makes_nothing(bench: Bench, tmp_path: Path) -> None:
    said = run("plot", saved(THREE, tmp_path), "--profile", "grbl_servo", "--dry-run")
    assert "travel X 0..300" in said
    assert "(estimated)" in said
    assert bench.opened == []
    assert run("jobs") == ""
    with pytest.raises(StrokeplanError, match="no port is given"):
        run("plot", saved(THREE, tmp_path), "--profile", "grbl_servo")


def test_a_job_is_resumed_without_its_plan_or_profile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bench = at(Bench(faults=Faults((Fault("unplug", 6.0, "s"),))), monkeypatch)
    plan = saved(THREE, tmp_path)
    options = ("--page", "A6", "--margin", 10, "--landscape", "--jobs", tmp_path / "jobs")
    with pytest.raises(StrokeplanError, match=r"of 3 strokes are drawn; .*continue with: strokeplan resume") as caught:
        run("plot", plan, *PLOT, *options)
    plan.unlink()
    name = str(caught.value).split()[-1]
    assert " of 3 strokes, grbl_servo at /dev/ttyUSB0" in run("jobs", "--jobs", tmp_path / "jobs")
    said = run("resume", name[:14], "--yes", "--port", "/dev/ttyUSB1", "--jobs", tmp_path / "jobs")
    assert "all 3 strokes" in said
    assert bench.opened[1][0] == "/dev/ttyUSB1"
    page = PlotOptions(LayoutOptions(parse_page("A6", "10", landscape=True)))
    wanted = program(THREE, load_profile("grbl_servo"), page)
    assert not missing(wanted, bench.device.drawn)


def test_nobody_at_the_machine_is_an_error_before_anything_moves(bench: Bench, tmp_path: Path) -> None:
    with pytest.raises(StrokeplanError, match="nothing was drawn"):
        run("plot", saved(THREE, tmp_path), "--profile", "grbl_servo", "--port", "x")
    assert len(bench.device.drawn) == 0
    assert run("jobs") == ""


def test_a_journal_that_cannot_be_made_is_an_error_before_anything_moves(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StrokeplanError, match="nothing is drawn"):
        run("plot", saved(THREE, tmp_path), *PLOT, "--jobs", tmp_path / "file")
    assert len(bench.device.drawn) == 0


def test_options_choose_what_is_drawn_and_how_often(bench: Bench, tmp_path: Path) -> None:
    plan = saved(drawing([SWAN, EYE, BAR], pens=("red", "red", "blue")), tmp_path)
    with pytest.raises(StrokeplanError, match="stopped; 1 of 2 strokes are drawn"):  # nobody puts in the next sheet
        run("plot", plan, *PLOT, "--pens", "blue", "--copies", 2, "-q", "--trace", tmp_path / "wire.trace")
    run("resume", "last", "--yes")
    lines = bench.device.drawn.lines
    assert len(lines) == 2
    for line in lines:
        assert distance([line * [1, -1] + [0, 80]], drawn(drawing([BAR]))) < 0.05
    trace = (tmp_path / "wire.trace").read_text()
    assert "> b'M3 S300\\n'" in trace
    assert "< b" in trace
    with pytest.raises(StrokeplanError, match="there are red, blue"):
        run("plot", plan, *PLOT, "--pens", "green")


def test_another_machine_on_the_port_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at(Bench("axidraw_v3"), monkeypatch)
    with pytest.raises(StrokeplanError, match="answers as EBB, and the profile speaks GRBL"):
        run("plot", saved(THREE, tmp_path), *PLOT, "--jobs", tmp_path / "jobs")


def test_a_plan_that_was_changed_in_the_job_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at(Bench(faults=Faults((Fault("unplug", 6.0, "s"),))), monkeypatch)
    folder = tmp_path / "jobs"
    with pytest.raises(StrokeplanError, match="resume"):
        run("plot", saved(THREE, tmp_path), *PLOT, "--jobs", folder)
    job = next(folder.iterdir())
    with (job / "plan.json").open("a") as stream:
        stream.write(" ")
    with pytest.raises(StrokeplanError, match="is not the plan that the job began with"):
        run("resume", "last", "--yes", "--jobs", folder)


def test_a_painting_is_resumed_with_its_pens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bundles of passes in the pens of a file, which the job keeps a copy of."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bench = at(Bench(faults=Faults((Fault("unplug", 6.0, "s"),))), monkeypatch)
    pens = tmp_path / "mine.toml"
    pens.write_text('[[pens]]\nname = "ink"\ncolor = "#202020"\nwidth_mm = 1.0\n')
    options = ("--page", "A6", "--margin", 10, "--landscape", "--strokes", "bundle")
    with pytest.raises(StrokeplanError, match="continue with: strokeplan resume"):
        run("plot", saved(THREE, tmp_path), *PLOT, *options, "--pen-set", pens)
    page = LayoutOptions(parse_page("A6", "10", landscape=True))
    asked = PlotOptions(page, strokes="bundle", pens=load_pens(pens))
    wanted = program(THREE, load_profile("grbl_servo"), asked)
    pens.unlink()
    assert "strokes; the journal stays" in run("resume", "last", "--yes")
    assert not missing(wanted, bench.device.drawn)


def test_yes_does_not_change_pens(bench: Bench, tmp_path: Path) -> None:
    """Without a person the machine stops, pen up, where another pen is to be taken."""
    plan = saved(THREE, tmp_path)
    with pytest.raises(StrokeplanError, match=r"stopped; \d of 3 strokes are drawn; the pen is up"):
        run("plot", plan, *PLOT, "--page", "A6", "--pen-set", "3")
    assert not bench.device.pen_down
    assert 0 < len(bench.device.drawn) < 3


def test_a_drawing_beyond_its_page_is_told(bench: Bench, tmp_path: Path) -> None:
    far = BAR + np.array([25, 0])  # ends 5 mm right of the canvas
    for chains, told in (([SWAN, BAR], False), ([SWAN, far], True)):
        said = run("plot", saved(drawing(chains), tmp_path), "--profile", "grbl_servo", "--dry-run")
        assert ("5.00 mm beyond the page; --clip cuts it" in said) is told


@pytest.mark.parametrize(
    ("machine", "words"), [("ender3", "its tip where Z is 0 (it touches the paper at Z0)"), ("grbl_servo", "up")]
)
def test_a_pen_on_z_is_put_to_its_zero(
    machine: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A board that starts anew takes the height where its pen stands for zero, too."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    at(Bench(machine), monkeypatch)
    said = run("plot", saved(THREE, tmp_path), "--profile", machine, "--port", "x", "--yes")
    assert f"the pen stands at the origin, {words}: taken as done" in said
