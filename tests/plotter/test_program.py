"""What is drawn where, in which order and with which pen; and what is refused."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from drawings import BAR, EYE, SWAN, THREE, curve, drawing, drawn
from hypothesis import given
from hypothesis import strategies as st
from readers import distance, read_gcode

from strokeplan.errors import InputError, PlotError
from strokeplan.page import Page
from strokeplan.plotter.estimate import clock, estimate
from strokeplan.plotter.files import encode, outputs, parse_date
from strokeplan.plotter.layout import LayoutOptions, lay_out, read_area
from strokeplan.plotter.machine import page_transform
from strokeplan.plotter.profile import Change, Machine, PenSettings, Profile, load_profile
from strokeplan.plotter.program import PlotOptions, program
from strokeplan.strokes import Layer, StrokePlan

GRBL = load_profile("grbl_servo")
DIRECTIONS = {"right": (1, 0), "left": (-1, 0), "up": (0, -1), "down": (0, 1)}


def having(profile: Profile = GRBL, **fields: object) -> Profile:
    return msgspec.structs.replace(profile, **fields)


@given(
    across=st.sampled_from(["right", "left"]),
    along=st.sampled_from(["up", "down"]),
    swapped=st.booleans(),
    origin=st.sampled_from(["upper-left", "upper-right", "lower-left", "lower-right"]),
    offset=st.tuples(st.integers(-50, 50), st.integers(-50, 50)),
    portrait=st.booleans(),
)
def test_the_page_lies_where_the_profile_says(
    across: str, along: str, swapped: bool, origin: str, offset: tuple[int, int], portrait: bool
) -> None:
    """The origin corner is at the offset; a step on the page is a step of the same length on the named axis."""
    axes = (along, across) if swapped else (across, along)
    machine = Machine(x_mm=(-500, 500), y_mm=(-500, 500), axes=axes, origin=origin, offset_mm=offset)  # type: ignore[arg-type]
    page = Page(100, 150) if portrait else Page(150, 100)
    transform = page_transform(page, having(machine=machine))
    corner = (page.width_mm if "right" in origin else 0, page.height_mm if "lower" in origin else 0)
    assert transform.points(np.array([corner], float))[0] == pytest.approx(offset)
    for k in (0, 1):
        moved = transform.points(np.array([corner, np.add(corner, np.multiply(7, DIRECTIONS[axes[k]]))], float))
        step = np.zeros(2)
        step[k] = 7
        assert moved[1] - moved[0] == pytest.approx(step)


def test_a_page_that_fits_only_turned_is_turned_and_not_mirrored() -> None:
    profile = having(machine=Machine(x_mm=(0, 300), y_mm=(0, 220)))
    transform = page_transform(Page(210, 297), profile)
    assert transform.turned
    corners = transform.points(np.array([[0, 0], [210, 0], [0, 297]], float))
    assert not transform.outside(corners).any()
    u, v = corners[1:] - corners[0]
    assert u[0] * v[1] - u[1] * v[0] < 0  # y of the page is down, of the machine up: as unturned
    with pytest.raises(PlotError, match=r"page of 420 × 297 mm is larger than what grbl_servo reaches, 300 × 220 mm"):
        page_transform(Page(420, 297), profile)


def test_papers_are_those_that_the_plotter_knows() -> None:
    with pytest.raises(PlotError, match="no paper of hp7475a; it takes A4, A3"):
        page_transform(Page(200, 200), load_profile("hp7475a"))


def bounds(plan: StrokePlan) -> list[float]:
    points = np.concatenate(drawn(plan))
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


def test_turn_mirror_and_scale() -> None:
    plan = drawing([curve(10, 10, 20, 10, 30, 10, 40, 10)], (100.0, 80.0))

    def place(**options: object) -> list[float]:
        laid, _ = lay_out(plan, LayoutOptions(**options), 0.01)  # type: ignore[arg-type]
        return bounds(laid)

    assert place() == pytest.approx([10, 10, 40, 10])
    assert place(mirror=True) == pytest.approx([60, 10, 90, 10])
    assert place(rotate=90) == pytest.approx([70, 10, 70, 40])
    assert place(rotate=180) == pytest.approx([60, 70, 90, 70])
    assert place(rotate=270) == pytest.approx([10, 60, 10, 90])
    assert place(page=Page(200, 200, 0)) == pytest.approx([20, 40, 80, 40])
    assert place(page=Page(200, 200), scale=1.0) == pytest.approx([60, 70, 90, 70])
    assert place(page=Page(200, 200), scale=0.5) == pytest.approx([80, 85, 95, 85])


def test_clipping_cuts_at_the_canvas_and_keeps_curves_within() -> None:
    plan = drawing([SWAN, curve(-20, 40, 40, 40, 80, 40, 120, 40), curve(-9, -9, -8, -9, -7, -9, -6, -9)])
    laid, _ = lay_out(plan, LayoutOptions(clip=True), 0.01)
    assert len(laid) == 2
    assert laid.stroke(0) == pytest.approx(SWAN)
    assert bounds(laid)[::2] == pytest.approx([0, 100], abs=0.01)
    with pytest.raises(PlotError, match="nothing of the drawing"):
        lay_out(drawing([curve(-9, -9, -8, -9, -7, -9, -6, -9)]), LayoutOptions(clip=True), 0.01)


def test_within_a_shape(tmp_path: Path) -> None:
    """A circle of 20 mm about (50, 40) leaves 40 mm of a line through its middle; pressure stays."""
    svg = tmp_path / "disc.svg"
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="80mm" viewBox="0 0 200 160">'
    svg.write_text(f'{head}<circle cx="100" cy="80" r="40"/></svg>')
    long, short = curve(0, 40, 30, 40, 60, 40, 100, 40), curve(45, 45, 46, 45, 48, 45, 50, 45)
    plan = drawing([long, short], pressures=np.array([0.2, 0.4, 0.5, 1.0]))
    laid, _ = lay_out(plan, LayoutOptions(within=read_area(svg)), 0.01)
    assert bounds(laid) == pytest.approx([30, 40, 70, 45], abs=0.06)
    assert laid.pressures is not None
    assert laid.pressures[[0, -2, -1]] == pytest.approx([0.3, 0.5, 1.0])
    svg.write_text(f'{head}<path d="M0 0L50 50" stroke="#000"/></svg>')
    with pytest.raises(PlotError, match="no closed shape"):
        read_area(svg)


def test_strokes_that_meet_are_one_line() -> None:
    """Two halves of a line, the second backwards and 0.05 mm apart: one lift, and a bridge between them."""
    halves = [curve(10, 10, 20, 10, 30, 10, 40, 10), curve(70, 10, 60, 10, 50, 10, 40.05, 10)]
    job = program(drawing(halves), GRBL)
    assert len(job) == 1
    assert job.strokes == 2
    (line,) = read_gcode(encode(job))
    assert np.sort(line[[0, -1], 0]) == pytest.approx([10, 70])
    assert len(program(drawing(halves), having(join_mm=0.01))) == 2


def test_order_is_kept_where_it_matters() -> None:
    scattered = [BAR - (0, k) for k in (60, 5, 40, 20, 50)]
    kept = program(drawing(scattered), GRBL, PlotOptions(keep_order=True))
    assert [float(kept.line(j)[0, 1]) for j in range(5)] == [80 - 70 + k for k in (60, 5, 40, 20, 50)]
    free = program(drawing(scattered), GRBL)
    assert estimate(free).travelled_m < estimate(kept).travelled_m
    assert distance(read_gcode(encode(free)), read_gcode(encode(kept))) < 1e-6


def test_a_pen_draws_all_its_layers_before_the_next() -> None:
    pens = ("red", "blue", "blue", "red")
    layers = (Layer("a", 0, 2, "ink"), Layer("b", 2, 4, "ink"))
    job = program(drawing([BAR - (0, 10 * k) for k in range(4)], pens=pens, layers=layers), GRBL)
    assert [job.pens[k].name for k in job.pen] == ["red", "red", "blue", "blue"]
    assert job.layer.tolist() == [0, 1, 0, 1]
    assert estimate(job).pen_changes == 1
    red, blue = (job.only(k) for k in (0, 1))
    assert distance(read_gcode(encode(red)) + read_gcode(encode(blue)), read_gcode(encode(job))) < 1e-6
    names = [path.name for path, _ in outputs(job, "x.gcode", by_pen=True)]
    assert names == ["x-red.gcode", "x-blue.gcode"]


def test_colours_become_pens_when_asked() -> None:
    assert len(program(THREE, GRBL).pens) == 1
    assert [pen.name for pen in program(THREE, GRBL, PlotOptions(by_colour=True)).pens] == [
        "#000000",
        "#010101",
        "#020202",
    ]


@pytest.mark.parametrize(
    ("plan", "options", "profile", "message"),
    [
        (drawing([]), PlotOptions(), GRBL, "no stroke"),
        (drawing([BAR], settings={}), PlotOptions(), GRBL, "no size in millimetres; give a page"),
        (drawing([BAR], settings={"page_mm": ["a", None]}), PlotOptions(), GRBL, "no size in millimetres"),
        (drawing([BAR], settings={"page_mm": [-1, float(0)]}), PlotOptions(), GRBL, "page"),
        (drawing([BAR]), PlotOptions(slots=(("red", 1),)), GRBL, "pen 'red' is used by no stroke"),
        (drawing([BAR, EYE], pens=("a", "b")), PlotOptions(slots=(("a", 1), ("b", 1))), GRBL, "slot 1 is given to two"),
        (
            drawing([BAR, EYE, SWAN], pens=("a", "b", "c")),
            PlotOptions(LayoutOptions(Page(297, 210, 20))),
            load_profile("hp7470a"),
            "holds 2",
        ),
        (drawing([BAR], settings={}), PlotOptions(LayoutOptions(Page(100, 100), scale=2.0)), GRBL, "true size"),
    ],
)
def test_what_cannot_be_plotted_is_refused(
    plan: StrokePlan, options: PlotOptions, profile: Profile, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        encode(program(plan, profile, options))
    assert "\n" not in str(caught.value)


def test_options_that_are_none_are_refused() -> None:
    for wrong in ({"rotate": 45}, {"scale": float("nan")}, {"scale": 0.0}):
        with pytest.raises(PlotError, match=r"rotate|scale"):
            LayoutOptions(**wrong)  # type: ignore[arg-type]


def test_segments_take_the_time_that_the_machine_needs() -> None:
    """400 cubics of 0.1 mm: as many lines, or lines of 20 ms if asked: 0.83 mm at 2500 mm/min."""
    way = np.linspace(20, 60, 1201)
    plan = drawing([np.column_stack([way, 40 + np.sin(way / 3) / 4])])
    lengths = []
    for ms in (0.0, 20.0):
        speeds = msgspec.structs.replace(GRBL.speeds, segment_ms=ms)
        points, _ = program(plan, having(speeds=speeds)).polylines
        lengths.append(np.median(np.hypot(*np.diff(points, axis=0).T)))
        assert distance([points], [np.column_stack([way, 40 - np.sin(way / 3) / 4])]) <= GRBL.tolerance_mm + 0.002
    assert lengths[0] < 0.2
    assert lengths[1] > 0.8


def test_the_estimate_is_that_of_a_trapezoid() -> None:
    """100 mm right from the origin at 2500 mm/min and 500 mm/s², and home at 6000: l/v + v/a, and the pen's moves.

    GRBL waits in steps of 50 ms: 0.17 s are 0.2 s.
    """
    plan = drawing([curve(0, 80, 30, 80, 60, 80, 100, 80)])
    v, w = 2500 / 60, 100
    slow = having(tool=msgspec.structs.replace(GRBL.tool, lower_s=0.17, raise_s=0.3))
    figures = estimate(program(plan, slow))
    assert figures.total_s == pytest.approx(100 / v + v / 500 + 100 / w + w / 500 + 0.2 + 0.3, rel=1e-3)
    assert (figures.lifts, figures.drawn_m, figures.travelled_m) == (1, pytest.approx(0.1), pytest.approx(0.1))


def test_changes_of_pens_and_their_own_delays_are_in_the_estimate() -> None:
    """Two pens with and without a park: the way there and back, and the wait."""
    plan = drawing([BAR, np.add(BAR, (0, -20))], pens=("a", "b"))
    here = estimate(program(plan, having(change=Change(wait_s=30))))
    away = estimate(program(plan, having(change=Change(wait_s=30, park_mm=(0, 0)))))
    pens = (PenSettings(name="b", lower_s=1.2),)
    slow = estimate(program(plan, having(change=Change(wait_s=30), pens=pens)))
    assert here.total_s == pytest.approx(30 + sum(s for _, s in here.pens_s))
    assert away.travelled_m - here.travelled_m > 0.1
    assert slow.total_s - here.total_s == pytest.approx(1.0)
    assert clock(7384) == "2:03:04"


def test_dates_are_only_what_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    assert parse_date(None) is None
    assert parse_date("2026-01-02") == "2026-01-02"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert parse_date(None) == "1970-01-02"
    for wrong in ("tomorrow", "2026-13-01", "2026-01-02\nM3"):
        with pytest.raises(PlotError, match=r"give YYYY-MM-DD"):
            parse_date(wrong)
