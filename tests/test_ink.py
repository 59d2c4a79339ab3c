"""Pen drawings: true size, true tone, pens, budgets, and that a drawing's file makes it again."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

import strokeplan
from strokeplan.cli import app
from strokeplan.drawing import check_reach, draw, page_for
from strokeplan.errors import InputError, PresetError
from strokeplan.image import Photo
from strokeplan.ink import Progress
from strokeplan.ink_budget import grant, length_mm, parse_time
from strokeplan.ink_presets import find_ink, ink_names, ink_source, override_ink
from strokeplan.page import Page
from strokeplan.pens import load_pens
from strokeplan.plotter.estimate import estimate
from strokeplan.plotter.profile import load_profile, names, source
from strokeplan.plotter.program import program
from strokeplan.rendering import paint
from strokeplan.separation import lightness, luminance

CARD = Page(60, 50, 5)


def bare(plan: strokeplan.StrokePlan, columns: int, rows: int) -> NDArray[np.float32]:
    """The part of each pixel that black strokes leave white, as Pycairo sees it."""
    part: NDArray[np.float32] = paint(plan, columns, rows)[..., 0] / np.float32(255)
    return part


@pytest.fixture(scope="session")
def drawing(small_picture: NDArray[np.uint8]) -> strokeplan.StrokePlan:
    return strokeplan.plan(small_picture, "engraving", page=CARD)


def test_a_drawing_has_the_size_of_its_page_and_pen(drawing: strokeplan.StrokePlan) -> None:
    assert (drawing.width, drawing.height) == (60, 50)
    assert drawing.settings["page_mm"] == [60, 50]
    assert set(drawing.widths.tolist()) == {0.3}
    assert drawing.pens == ("black",) * len(drawing)
    assert [layer.medium for layer in drawing.layers] == ["ink"]
    # 96 × 64 on 50 × 40 mm: 50 × 33.3, in the middle.
    ends = drawing.points[drawing.starts[:-1]]
    assert 4.9 <= ends[:, 0].min() < 5.6
    assert 54.4 < ends[:, 0].max() <= 55.1
    assert 8.2 <= ends[:, 1].min() < 9
    assert 41 < ends[:, 1].max() <= 41.8


def seen(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """L* of 20 pixels a millimetre, as an eye sees them from 40 cm: σ = 0.62 mm (5.3 arc minutes)."""
    return lightness(gaussian_filter(light, 0.62 * 20))


@pytest.mark.parametrize("name", ["engraving", "crosshatch", "contour"])
@pytest.mark.parametrize("grey", [40, 110, 170, 220])
def test_a_flat_tone_is_the_photos_and_even(name: str, grey: int) -> None:
    plan = strokeplan.plan(np.full((30, 36, 3), grey, np.uint8), name, page=Page(36, 30))
    found = seen(bare(plan, 720, 600))[80:-80, 80:-80]
    reached = max(float(luminance(np.full((1, 1, 3), grey, np.uint8))[0, 0]), 0.08)
    assert float(found.mean()) == pytest.approx(float(lightness(np.array([reached]))[0]), abs=1)
    assert found.std() < 2.5


@pytest.mark.parametrize("name", ["engraving", "contour"])
def test_a_ramp_is_drawn_without_a_bias_for_any_tone(name: str) -> None:
    ramp = np.repeat(np.tile(np.linspace(255, 0, 240).astype(np.uint8), (120, 1))[..., None], 3, axis=2)
    plan = strokeplan.plan(ramp, name, page=Page(72, 36))
    rows = slice(60, -60)
    found = seen(bare(plan, 1440, 720))[rows]
    wanted = np.maximum(luminance(np.asarray(Image.fromarray(ramp).resize((1440, 720)))), 0.08)
    differences = found - seen(wanted)[rows]
    assert np.abs(differences).mean() < 1.6
    bands = differences.reshape(600, 12, 120).mean(axis=(0, 2))
    assert np.abs(bands).max() < 1.5
    assert np.all(np.diff(found.reshape(600, 12, 120).mean(axis=(0, 2))) < 1)


@pytest.mark.parametrize("name", ink_names())
def test_every_preset_draws_darker_what_is_darker(name: str) -> None:
    recipe = find_ink(name)
    assert recipe is not None
    assert recipe.preset.name == name
    assert recipe.preset.description.endswith(".")
    ramp = np.repeat(np.tile(np.linspace(255, 0, 60).astype(np.uint8), (30, 1))[..., None], 3, axis=2)
    plan = strokeplan.plan(ramp, name, page=Page(60, 30))
    columns = bare(plan, 600, 300).reshape(300, 6, 100).mean(axis=(0, 2))
    assert np.all(np.diff(columns) < 0.02)  # shadows of the sketch are all as open
    assert columns[0] > 0.8
    assert columns[-1] < 0.35


def test_the_same_seed_gives_the_same_strokes(small_picture: NDArray[np.uint8]) -> None:
    once, again, other = (strokeplan.plan(small_picture, "pen-sketch", seed, page=CARD) for seed in (1, 1, 2))
    assert once.points.tobytes() == again.points.tobytes() != other.points.tobytes()


def test_pens_are_layers_in_their_order(small_picture: NDArray[np.uint8]) -> None:
    plan = strokeplan.plan(small_picture, "engraving", page=CARD, pens=load_pens("cmyk").with_width(0.5))
    assert [layer.name for layer in plan.layers] == ["yellow", "magenta", "cyan", "black"]
    assert all(layer.last > layer.first for layer in plan.layers)
    assert set(plan.widths.tolist()) == {0.5}


def test_transparent_inks_mix_and_opaque_ones_hide() -> None:
    lines = np.array([[0, 5.0], [4, 5], [6, 5], [10, 5], [5, 0], [5, 4], [5, 6], [5, 10]])
    for kind, middle in (("transparent", (0, 255, 0)), ("opaque", (0, 255, 255))):
        pens = [{"name": name, "color": color, "ink": kind} for name, color in (("y", "#ffff00"), ("c", "#00ffff"))]
        plan = strokeplan.StrokePlan(
            width=10, height=10, points=lines, starts=np.array([0, 4, 8]), widths=np.full(2, 3.0),
            colors=np.array([[255, 255, 0], [0, 255, 255]], np.uint8),
            layers=(strokeplan.Layer("y", 0, 1, "ink"), strokeplan.Layer("c", 1, 2, "ink")),
            settings={"pens": {"pens": pens}},
        )  # fmt: skip
        assert tuple(paint(plan, 100, 100)[50, 50]) == middle


def test_a_budget_is_kept_and_used(small_picture: NDArray[np.uint8], drawing: strokeplan.StrokePlan) -> None:
    limit = 0.6 * length_mm(drawing)
    short = strokeplan.plan(small_picture, "engraving", page=CARD, max_length_mm=limit)
    assert 0.9 * limit < length_mm(short) <= limit
    few = strokeplan.plan(small_picture, "engraving", page=CARD, strokes=len(drawing) // 2)
    assert 0.7 * len(drawing) / 2 < len(few) <= len(drawing) // 2
    ample = strokeplan.plan(small_picture, "engraving", page=CARD, max_length_mm=10 * limit)
    assert ample.points.tobytes() == drawing.points.tobytes()


@given(st.lists(st.integers(0, 400), min_size=2, max_size=40), st.floats(1, 3000), st.integers(0, 2**32))
def test_no_other_way_to_spend_the_ink_that_is_granted_differs_less(asked: list[int], price: float, seed: int) -> None:
    demand = np.array(asked, np.float32)[None] / 400
    granted = grant(demand, price)
    assert np.all(granted <= demand)
    assert np.all(np.diff(granted[0][np.argsort(demand[0])]) >= 0)
    assert np.all(grant(demand, 1.5 * price) <= granted)

    def differing(tones: NDArray[np.float32]) -> float:
        seen = lightness(1 - tones.astype(np.float32)) - lightness(1 - demand)
        return float((0.5 * seen**2 + 0.5 * (100 * (tones - demand)) ** 2).sum())

    rng = np.random.default_rng(seed)
    for _ in range(20):  # as much of one demand less as of another more
        i, j = rng.integers(0, demand.size, 2)
        other = granted.copy()
        moved = rng.integers(0, 1 + round(400 * min(float(other[0, i]), float(demand[0, j] - other[0, j])))) / 400
        other[0, i] -= moved
        other[0, j] += moved
        assert differing(granted) <= differing(other) + 1e-2


def test_all_is_granted_where_ink_is_free() -> None:
    demand = np.random.default_rng(0).random((7, 9)).astype(np.float32)
    assert grant(demand, 0.0) is demand
    assert not grant(demand, 1e5).any()


def test_a_time_is_that_of_the_machine(small_picture: NDArray[np.uint8], tmp_path: Path) -> None:
    profile = load_profile("axidraw_v3")
    whole = strokeplan.plan(small_picture, "engraving", profile="axidraw_v3", page=CARD)
    limit = 0.5 * estimate(program(whole, profile)).total_s
    quick = strokeplan.plan(small_picture, "engraving", profile="axidraw_v3", page=CARD, max_time_s=limit)
    quick.save(tmp_path / "quick.svg")
    loaded = strokeplan.load(tmp_path / "quick.svg")
    assert 0.93 * limit <= estimate(program(loaded, profile)).total_s <= limit
    again = strokeplan.plan(small_picture, tmp_path / "quick.svg")
    assert again.points.tobytes() == quick.points.tobytes()


def test_a_profile_gives_its_page_and_pens(small_picture: NDArray[np.uint8], tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    text = source("axidraw_minikit").decode()
    own.write_text(text + '\n[[pens]]\nname = "black"\nwidth_mm = 0.8\n')
    plan = strokeplan.plan(small_picture, "contour", profile=own)
    assert (plan.width, plan.height) == (160, 101.6)  # the travel, turned as the photo is
    assert set(plan.widths.tolist()) == {0.8}
    # A thicker pen of that name, if it is asked for.
    thick = strokeplan.plan(small_picture, "contour", profile=own, pens=load_pens("black").with_width(1.5), page=CARD)
    assert set(thick.widths.tolist()) == {1.5}
    assert (thick.width, thick.height) == (60, 50)


@pytest.mark.parametrize("name", names())
def test_every_machine_reaches_the_picture_on_its_own_page(name: str) -> None:
    profile = load_profile(name)
    for size in ((40, 60), (60, 40)):
        photo = Photo(np.zeros((*size, 3), np.uint8))
        page = page_for(photo, profile)
        check_reach(photo, page, profile)
        assert (page.width_mm > page.height_mm) == (size[1] > size[0]) or page.width_mm == page.height_mm


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"max_time_s": 60}, "give its --profile"),
        ({"max_time_s": 0, "profile": "axidraw_v3"}, "max-time 0 s is none"),
        ({"max_time_s": float("nan"), "profile": "axidraw_v3"}, "max-time nan s is none"),
        ({"max_time_s": 0.1, "profile": "axidraw_v3", "page": CARD}, "no stroke fits the budget, of which the whole"),
        ({"profile": "axidraw_v3", "page": Page(900, 900)}, "is larger than what axidraw_v3 reaches"),
        ({"profile": "hp7470a", "page": Page(210, 297)}, "beyond the travel of hp7470a"),
        ({"max_length_mm": float("nan")}, "length nan mm is none"),
        ({"strokes": 0}, "strokes 0 is below 1"),
        ({"seed": -1}, "seed -1 is negative"),
        ({"threads": 0}, "threads 0 is below 1"),
    ],
)
def test_budgets_that_are_none_are_refused(
    small_picture: NDArray[np.uint8], options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        strokeplan.plan(small_picture, "engraving", **({"page": CARD} | options))


@pytest.mark.parametrize(
    ("text", "seconds"), [("90min", 5400), ("1h30m", 5400), ("1.5h", 5400), ("5400s", 5400), (" 1 H 2 min 3s", 3723)]
)
def test_times_are_read_with_their_units(text: str, seconds: float) -> None:
    assert parse_time(text) == seconds


@pytest.mark.parametrize("text", ["", "90", "1h30", "30m1h", "1h1h", "-5min", "5 days", "1e3s", "h"])
def test_times_without_a_unit_or_sense_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="is no time; give one like 90min"):
        parse_time(text)


def test_threads_change_no_byte(small_picture: NDArray[np.uint8]) -> None:
    one, three = (
        strokeplan.plan(small_picture, "engraving", page=CARD, pens="cmyk", threads=threads) for threads in (1, 3)
    )
    assert one.points.tobytes() == three.points.tobytes()


def test_progress_counts_every_step_of_every_drawing(
    small_picture: NDArray[np.uint8], drawing: strokeplan.StrokePlan
) -> None:
    recipe = find_ink("engraving")
    assert recipe is not None
    told: list[Progress] = []
    limit = 0.5 * length_mm(drawing)
    draw(Photo(small_picture), recipe._replace(page=CARD, max_length_mm=limit), progress=told.append)
    drawings = told[-1].drawing
    assert drawings > 1
    assert told == [Progress(k, done, 14) for k in range(1, drawings + 1) for done in range(15)]


def test_length_is_that_of_the_lines() -> None:
    points = np.array([[0, 0], [1, 0], [2, 0], [3, 0], [0, 0], [0, 1.0], [0, 2], [0, 4]])
    plan = strokeplan.StrokePlan(
        width=10, height=10, points=points, starts=np.array([0, 4, 8]), widths=np.ones(2),
        colors=np.zeros((2, 3), np.uint8), layers=(strokeplan.Layer("1", 0, 2),),
    )  # fmt: skip
    assert length_mm(plan) == pytest.approx(7)


def test_an_svg_of_true_size_makes_the_drawing_again(
    small_picture: NDArray[np.uint8], drawing: strokeplan.StrokePlan, tmp_path: Path
) -> None:
    file = tmp_path / "drawing.svg"
    drawing.save(file)
    head = file.read_text()[:400]
    assert 'width="60mm"' in head
    assert 'viewBox="0 0 60 50"' in head
    loaded = strokeplan.load(file)
    assert np.abs(loaded.points - drawing.points).max() < 1e-3
    again = strokeplan.plan(small_picture, file)
    assert again.points.tobytes() == drawing.points.tobytes()
    assert again.settings == drawing.settings


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"layers.1.reach": 2}, "reach"), ({"wooble": 1}, "wooble"), ({"layers.9.angle": 1}, "layer '9'")],
)
def test_settings_that_are_none_are_refused(settings: dict[str, Any], words: str) -> None:
    recipe = find_ink("engraving")
    assert recipe is not None
    with pytest.raises(PresetError, match=words):
        override_ink(recipe.preset, settings)


def test_options_of_the_other_medium_are_refused(small_picture: NDArray[np.uint8]) -> None:
    with pytest.raises(InputError, match="page is not for a preset of paint"):
        strokeplan.plan(small_picture, "fine", page=CARD)
    with pytest.raises(InputError, match="detail is not for a preset of ink"):
        strokeplan.plan(small_picture, "engraving", detail=0.2)
    with pytest.raises(InputError, match="too small for a pen"):
        strokeplan.plan(small_picture, "engraving", page=Page(1, 1), pens=load_pens("black").with_width(2))


def test_the_command_line_draws_in_ink(tmp_path: Path, sample_photo: Path) -> None:
    out = tmp_path / "out.svg"
    words = ["--preset", "engraving", "--page", "60x50mm", "--margin", "4", "--pen", "0.5mm", "--max-length", "2m"]
    ended = CliRunner().invoke(app, ["plan", str(sample_photo), *words, "-o", str(out)])
    assert ended.exit_code == 0, ended.output
    plan = strokeplan.load(out)
    assert set(plan.widths.tolist()) == {0.5}
    assert length_mm(plan) <= 2000
    words = ["--preset", "contour", "--profile", "axidraw_minikit", "--margin", "40", "--max-time", "2min"]
    ended = CliRunner().invoke(app, ["plan", str(sample_photo), *words, "-o", str(out)])
    assert ended.exit_code == 0, ended.output
    assert re.search(r"0:0(1:5\d|2:00) with axidraw_minikit", ended.output)
    plan = strokeplan.load(out)
    assert sorted((plan.width, plan.height)) == [101.6, 160]
    assert plan.points.min() >= 40
    mine = tmp_path / "mine.toml"
    mine.write_text(ink_source("contour"))
    assert "sound; ink" in CliRunner().invoke(app, ["presets", "check", str(mine)]).output
    assert "engraving" in CliRunner().invoke(app, ["presets"]).output
    refused = CliRunner().invoke(app, ["plan", str(sample_photo), "--pens", "cmyk", "-o", str(out)])
    assert isinstance(refused.exception, InputError | SystemExit)


def test_a_page_has_a_name_in_python_too(small_picture: NDArray[np.uint8]) -> None:
    named, made = (strokeplan.plan(small_picture, "contour", page=page) for page in ("74x105mm", Page(74, 105, 15)))
    assert (named.width, named.height) == (74, 105)
    assert np.array_equal(named.points, made.points)
    with pytest.raises(strokeplan.InputError, match="A99"):
        strokeplan.plan(small_picture, "contour", page="A99")
