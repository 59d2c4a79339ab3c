"""Pen drawings: true size, true tone, pens, budgets, and that a drawing's file makes it again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

import strokeplan
from strokeplan.cli import app
from strokeplan.errors import InputError, PresetError
from strokeplan.ink_budget import length_mm
from strokeplan.ink_presets import find_ink, ink_names, ink_source, override_ink
from strokeplan.page import Page
from strokeplan.pens import load_pens
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


@pytest.mark.parametrize("grey", [40, 110, 170, 220])
def test_a_flat_tone_is_the_photos(grey: int) -> None:
    plan = strokeplan.plan(np.full((40, 48, 3), grey, np.uint8), "engraving", page=Page(48, 40))
    light = bare(plan, 960, 800)[200:-200, 200:-200]
    wanted = max(float(luminance(np.full((1, 1, 3), grey, np.uint8))[0, 0]), 0.08)
    assert float(lightness(light.mean()[None])[0]) == pytest.approx(float(lightness(np.array([wanted]))[0]), abs=3)
    seen = lightness(gaussian_filter(bare(plan, 960, 800), 0.62 * 20))[200:-200, 200:-200]
    assert seen.std() < 4


@pytest.mark.parametrize("name", ink_names())
def test_every_preset_draws_darker_what_is_darker(name: str) -> None:
    recipe = find_ink(name)
    assert recipe is not None
    assert recipe.preset.name == name
    assert recipe.preset.description.endswith(".")
    ramp = np.repeat(np.tile(np.linspace(255, 0, 60).astype(np.uint8), (30, 1))[..., None], 3, axis=2)
    plan = strokeplan.plan(ramp, name, page=Page(60, 30))
    columns = bare(plan, 600, 300).reshape(300, 6, 100).mean(axis=(0, 2))
    assert np.all(np.diff(columns) < 0.01)
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
    mine = tmp_path / "mine.toml"
    mine.write_text(ink_source("contour"))
    assert "sound; ink" in CliRunner().invoke(app, ["presets", "check", str(mine)]).output
    assert "engraving" in CliRunner().invoke(app, ["presets"]).output
    refused = CliRunner().invoke(app, ["plan", str(sample_photo), "--pens", "cmyk", "-o", str(out)])
    assert isinstance(refused.exception, InputError | SystemExit)
