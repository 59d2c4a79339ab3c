"""Budgets: as many strokes as were asked for, the better picture for more of them, and detail by degrees."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import strokeplan
from strokeplan.budget import MAX_STROKES, SEARCHED, for_detail, for_strokes, searched
from strokeplan.formats import json as strokes_json
from strokeplan.planner import Report
from strokeplan.presets import MAX_LAYERS, Preset, load_preset

Picture = NDArray[np.uint8]


@pytest.fixture(scope="module")
def picture() -> Picture:
    """Smooth coloured noise: contours of every kind."""
    smooth = gaussian_filter(np.random.default_rng(1).normal(size=(80, 110, 3)), (5, 5, 0), mode="wrap")
    return np.clip(128 + 500 * smooth, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def coarse() -> Preset:
    """The default preset without its finest brushes: planned at a resolution of some 360 × 360."""
    fine = load_preset("fine")
    return fine.override({"layers": msgspec.to_builtins(fine)["layers"][:3]})


def planned(picture: Picture, preset: Preset, **options: object) -> tuple[strokeplan.StrokePlan, float]:
    """A plan, and the mean squared error of its planning canvas against the photo enlarged to it."""
    from PIL import Image

    reports: list[Report] = []
    plan = strokeplan.plan(picture, preset, report=reports.append, **options)  # type: ignore[arg-type]
    canvas = reports[0].canvas
    photo = Image.fromarray(picture).resize(canvas.shape[1::-1], Image.Resampling.LANCZOS)
    return plan, float(((canvas.astype(float) - np.asarray(photo)) ** 2).sum(axis=-1).mean())


def test_more_strokes_are_a_better_picture(picture: Picture, coarse: Preset) -> None:
    errors = []
    for most in (1, 2, 10, 100, 1000):
        plan, error = planned(picture, coarse, strokes=most)
        assert 1 <= len(plan) <= most
        assert len(plan) >= 0.5 * most
        assert plan.settings["strokes"] == most
        errors.append(error)
    assert (np.diff(errors) < 0).all()
    assert errors[-1] < 0.1 * errors[0]
    # A single stroke can do no better than the mean colour.
    assert errors[0] == pytest.approx(picture.reshape(-1, 3).var(axis=0).sum(), rel=0.1)


def test_a_budget_beyond_need_is_not_spent(coarse: Preset) -> None:
    flat = np.full((40, 60, 3), 90, np.uint8)
    for most, needed in ((5000, 1000), (500, 1)):
        plan, error = planned(flat, coarse, strokes=most)
        assert len(plan) <= needed
        assert error == 0


def test_a_plan_within_a_budget_is_made_again_from_its_settings(picture: Picture, coarse: Preset) -> None:
    assert_made_again(picture, coarse, 60)
    assert_made_again(picture, coarse, SEARCHED + 1)


def assert_made_again(picture: Picture, coarse: Preset, most: int) -> None:
    plan = strokeplan.plan(picture, coarse, 3, strokes=most, threads=1)
    preset = msgspec.convert(plan.settings["preset"], Preset)
    again = strokeplan.plan(picture, preset, plan.settings["seed"], strokes=plan.settings["strokes"])
    assert strokes_json.encode(again) == strokes_json.encode(plan)


@pytest.mark.parametrize("name", ["fine", "paper"])
def test_detail_is_monotone_in_strokes(picture: Picture, coarse: Preset, name: str) -> None:
    preset = coarse if name == "fine" else load_preset("paper")
    # Below that, thresholds leave out the paper's wide brushes altogether, and more strokes are laid by the fine ones.
    details = (0, 0.25, 0.5, 0.75, 1) if name == "fine" else (0.25, 0.5, 0.75, 1)
    counts = [len(strokeplan.plan(picture, preset, detail=detail)) for detail in details]
    assert counts == sorted(counts)
    assert counts[-1] > 1.5 * counts[0]
    assert counts[-3] == len(strokeplan.plan(picture, preset))


def test_detail_half_is_the_preset_as_it_stands() -> None:
    for name in ("fine", "paper"):
        preset = load_preset(name)
        assert for_detail(preset, 0.5) == preset
        assert for_detail(preset, None) is preset
        assert for_strokes(preset, None) is preset
    assert for_detail(load_preset("fine"), 1).gain == pytest.approx(load_preset("fine").gain / 16)
    assert for_detail(load_preset("paper"), 0).layers[0].color_threshold == pytest.approx(400)


@pytest.mark.parametrize("width", [0.5, 3, 40, 400])
@pytest.mark.parametrize("own", [1, 20, 32])
@pytest.mark.parametrize("strokes", [1, 30, SEARCHED + 1, 10_000])
def test_a_preset_for_few_strokes_is_sound(width: float, own: int, strokes: int) -> None:
    """However many layers and however fine a brush it begins with; and asked for again it is the same."""
    layer = {"sigma": 1, "length": 50, "width": width}
    preset = for_strokes(load_preset("fine").override({"layers": [layer] * own}), strokes)
    assert msgspec.convert(msgspec.to_builtins(preset), Preset) == preset
    assert for_strokes(preset, strokes) == preset
    if searched(preset, strokes):
        assert len(preset.layers) == 1
    else:
        assert own <= len(preset.layers) <= MAX_LAYERS
        own_layers = load_preset("fine").override({"layers": [layer] * own}).layers
        assert preset.layers[len(preset.layers) - own :] == own_layers


@pytest.mark.parametrize(
    "asked", [{"palette_size": 4}, {"regions": 9}, {"thin": 5}, {"merge": 9}, {"wander": 0.5}, {"seeding": "even"}]
)
def test_strokes_are_not_searched_for_where_a_preset_asks_for_more_than_nearness(asked: dict[str, object]) -> None:
    fine = load_preset("fine")
    assert searched(fine, SEARCHED)
    assert not searched(fine, SEARCHED + 1)
    assert not searched(fine.override(asked), 10)
    assert len(for_strokes(fine.override(asked), 10).layers) > 1


def test_a_picture_of_few_strokes_is_far_ahead_of_as_many_squares(picture: Picture, coarse: Preset) -> None:
    plan = strokeplan.plan(picture, coarse, strokes=77)
    shown = strokeplan.render(plan).astype(float)
    squares = picture.reshape(8, 10, 10, 11, 3).mean(axis=(1, 3), keepdims=True)
    by_squares = ((picture.reshape(8, 10, 10, 11, 3) - squares) ** 2).mean()
    assert len(plan) <= 77
    assert plan.cubics == len(plan)
    assert ((shown - picture) ** 2).mean() < 0.5 * by_squares


def test_strokes_of_the_paper_s_preset_can_be_limited_too(picture: Picture) -> None:
    plan = strokeplan.plan(picture, "paper", strokes=50)
    assert len(plan) <= 50
    assert plan.settings["preset"]["keep"] == "gain"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"strokes": 0}, ("strokes 0", f"1..{MAX_STROKES}")),
        ({"strokes": -5}, ("strokes -5",)),
        ({"strokes": MAX_STROKES + 1}, (f"strokes {MAX_STROKES + 1}",)),
        ({"detail": -0.1}, ("detail -0.1", "0..1")),
        ({"detail": 1.5}, ("detail 1.5", "0..1")),
        ({"detail": float("nan")}, ("detail nan",)),
        ({"strokes": 100, "detail": 0.5}, ("strokes 100", "detail 0.5", "one of them")),
    ],
)
def test_a_budget_that_is_none_is_refused(picture: Picture, options: dict[str, float], words: tuple[str, ...]) -> None:
    with pytest.raises(strokeplan.InputError) as raised:
        strokeplan.plan(picture, **options)  # type: ignore[arg-type]
    assert "\n" not in str(raised.value)
    for word in words:
        assert word in str(raised.value)
