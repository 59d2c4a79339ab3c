"""The benchmarks of likeness: results have names of their own, variants and peers are what they say."""

from __future__ import annotations

import math
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from conftest import ROOT

import strokeplan
from strokeplan import layering
from strokeplan.formats.svg import encode
from strokeplan.image import Photo
from strokeplan.presets import Preset, load_preset
from strokeplan.rendering import paint
from strokeplan.strokes import StrokePlan

sys.path.insert(0, str(ROOT / "benchmarks"))

import budget
import evaluation
import results


def asked(path: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """Another measurement than the benchmark's."""
    return asked


def test_a_result_is_named_by_all_it_depends_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = tmp_path / "1.jpg", tmp_path / "2.jpg"
    first.write_bytes(b"one")
    second.write_bytes(b"two")

    def name(photo: Path = first, measure: Any = evaluation.measure, **change: Any) -> str:
        return results.digest(measure, photo, evaluation.variant("paper", change))

    names = [name(), name(second), name(measure=asked), name(coherence=0.4), name(**{"layers.2.width": 9})]
    monkeypatch.setattr(evaluation, "SEED", 1)
    names.append(name())
    monkeypatch.undo()
    assert name(coherence=0.5) == names[0]  # what it is anyway
    (tmp_path / "copy.jpg").write_bytes(first.read_bytes())
    assert name(tmp_path / "copy.jpg") == names[0]
    monkeypatch.setattr(results, "sources_digest", lambda: "changed")
    names.append(name())
    assert len(set(names)) == len(names) == 7


def test_a_variant_is_its_base_with_values_replaced() -> None:
    def variant(change: dict[str, Any]) -> Preset:
        return msgspec.convert(evaluation.variant("paper", change)["preset"], Preset)

    base = load_preset("paper")
    made = variant({"layers.*.sigma": "×0.5", "layers.2.width": "×2", "coherence": 0.1})
    assert [layer.sigma for layer in made.layers] == [layer.sigma / 2 for layer in base.layers]
    assert [layer.width for layer in made.layers] == [50, 50, 5, 2.5]
    assert made.coherence == 0.1
    assert variant({}) == base
    assert variant({"integration_sigma": "×3"}).integration_sigma == 3
    assert variant({"layers": "2-3"}).layers == base.layers[1:3]


@pytest.mark.parametrize("base", evaluation.ABLATION)
def test_every_variant_is_another(base: str) -> None:
    """All are valid, and none is the base or another one under a second name."""
    made = [*evaluation.variants(base).values(), evaluation.variant(base, {})]
    assert len({msgspec.json.encode(asked) for asked in made}) == len(made) > 30


def test_constants_of_modules_are_there_and_are_changed_for_one_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    changes = [
        change
        for chapters in evaluation.ABLATION.values()
        for chapter in chapters.values()
        for change in chapter.values()
    ]
    parts = {key for change in changes for key in change if key.split(".")[0] in evaluation.PARTS}
    assert len(parts) >= 3
    seen = []

    def plan(*_: Any, **__: Any) -> None:
        seen.append(layering.PRUNE)
        raise InterruptedError

    monkeypatch.setattr(strokeplan, "plan", plan)
    before = layering.PRUNE
    for key in sorted(parts):
        module, name = key.rsplit(".", 1)
        assert hasattr(import_module(f"strokeplan.{module}"), name)
    with pytest.raises(InterruptedError):
        evaluation.measure(ROOT / "samples" / "coffee.jpg", evaluation.variant("fine", {"layering.PRUNE": 0.125}))
    assert (seen, layering.PRUNE) == ([0.125], before)


def test_differences_are_taken_photo_by_photo() -> None:
    base: list[dict[str, Any]] = [{"psnr_db": 20.0, "strokes": 10}, {"psnr_db": 30.0, "strokes": 30}]
    other: list[dict[str, Any]] = [{"psnr_db": 21.0, "strokes": 10}, {"psnr_db": 33.0, "strokes": 70}]
    mean, half = evaluation.difference("psnr_db", base, other)
    assert mean == pytest.approx(2)
    assert half == pytest.approx(12.7062)  # t(0.975, 1) · s / √2, s = √2
    assert evaluation.ratio("strokes", base, other) == 2


def test_an_interval_is_student_s() -> None:
    """The textbook's t for 9 degrees of freedom is 2.262; one value says nothing of its spread."""
    values = np.arange(10.0)
    mean, half = results.mean_interval(list(values))
    assert (mean, half) == (4.5, pytest.approx(2.262 * values.std(ddof=1) / math.sqrt(10), rel=1e-3))
    assert results.mean_interval([3.0]) == (3.0, math.inf)


# Budgets


@pytest.mark.parametrize("count", [1, 6, 50, 24, 10_000])
def test_a_mosaic_has_the_mean_colour_of_every_square(count: int) -> None:
    rgb = np.random.default_rng(1).integers(0, 256, (12, 18, 3), dtype=np.uint8)
    picture = budget.mosaic(Photo(rgb), Path(), {"budget": count})()
    assert picture.elements <= count
    assert picture.pixels.shape == rgb.shape
    if count == 1:
        assert np.array_equal(picture.pixels[0, 0], np.rint(rgb.mean(axis=(0, 1))))
        assert picture.svg_bytes == len(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 18 12">'
            '<rect x="0" y="0" width="18" height="12" fill="#000000"/></svg>'
        )
    if count == 6:  # 3 × 2 squares of 6 pixels
        assert picture.elements == 6
        assert np.array_equal(picture.pixels[6:, 12:], np.broadcast_to(np.rint(rgb[6:, 12:].mean((0, 1))), (6, 6, 3)))
    if count == 10_000:
        assert np.array_equal(picture.pixels, rgb)


def test_a_picture_is_rasterised_at_the_photo_s_size(small_plan: StrokePlan) -> None:
    theirs = budget.rasterise(encode(small_plan).decode(), Photo(np.zeros((64, 96, 3), np.uint8)))
    assert np.abs(theirs.astype(int) - paint(small_plan, 96, 64)).mean() < 4
    with pytest.raises(ValueError, match="rasterised to"):
        budget.rasterise(encode(small_plan).decode(), Photo(np.zeros((64, 97, 3), np.uint8)))


def test_a_peer_is_read_between_its_settings() -> None:
    """10 dB for every tenfold size; a setting that is larger and worse is left out."""
    known: list[dict[str, Any]] = [
        {"elements": size, "psnr_db": psnr} for size, psnr in ((10_000, 40.0), (100, 20.0), (500, 15.0), (1_000, 30.0))
    ]
    assert budget.psnr_at(known, "elements", 10**2.5) == pytest.approx(25)
    assert budget.size_at(known, "elements", 35) == pytest.approx(10**3.5)
    assert math.isnan(budget.psnr_at(known, "elements", 99))
    assert math.isnan(budget.size_at(known, "elements", 41))
    assert budget.averaged([1.0, math.nan, 2.0], "{:.1f} dB") == "1.5 dB (2)"
    assert budget.averaged([math.nan], "{:.1f} dB") == "–"


def test_published_figures_name_photos_and_need_no_size() -> None:
    (row,) = [budget.known_row(known) for known in budget.PRIMITIVE["tomato1024"] if known.elements == 100]
    assert row[:4] == ["primitive, triangles", "100", "8,000", "20.30 dB"]
    (row,) = [budget.known_row(known) for known in budget.PRIMITIVE["cat1024"] if known.elements == 100]
    assert (row[2], row[-1]) == ("–", "–")
