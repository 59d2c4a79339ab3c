"""Pens, sets of pens, and what each should cover."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage.color import rgb2lab

from strokeplan.errors import InputError
from strokeplan.pens import Pen, PenSet, load_pens, pen_sets
from strokeplan.separation import composite, lab, lightness, linear, luminance, separate
from strokeplan.strokes import hex_to_rgb

COLOURS = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)


def test_the_sets_that_ship() -> None:
    assert {"black", "cmyk", "greys", "sepia-white"} <= set(pen_sets())
    for name in pen_sets():
        pens = load_pens(name)
        assert pens.name == name
        assert pens.description.endswith(".")


def test_a_set_of_the_users(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('paper = "#ffeedd"\n[[pens]]\nname = "blue"\ncolor = "#0000ff"\nwidth_mm = 0.5\nink = "opaque"\n')
    pens = load_pens(file)
    assert pens == PenSet(
        name="mine", paper="#ffeedd", pens=(Pen(name="blue", color="#0000ff", width_mm=0.5, ink="opaque"),)
    )
    assert [pen.width_mm for pen in pens.with_width(0.7).pens] == [0.7]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pens = []", ("pens",)),
        ('[[pens]]\nname = "a"\ncolor = "blue"', ("color",)),
        ('[[pens]]\nname = "a"\ncolor = "#000000"\nwidth_mm = 0', ("width_mm",)),
        ('[[pens]]\nname = "a"\ncolor = "#000000"\nink = "wet"', ("wet",)),
        (2 * '[[pens]]\nname = "a"\ncolor = "#000000"\n', ("two pens 'a'",)),
        ("[[pens]", ("TOML",)),
    ],
)
def test_what_is_no_set_is_refused_in_a_line(tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=r"^[^\n]+$") as raised:
        load_pens(file)
    assert all(word in str(raised.value) for word in (str(file), *words))


def test_unknown_sets_and_widths_are_refused() -> None:
    with pytest.raises(InputError, match="black, cmyk"):
        load_pens("inky")
    with pytest.raises(InputError, match=r"pen 50 mm is outside 0\.05\.\.20 mm"):
        load_pens("black").with_width(50)


def test_colours_are_those_of_scikit_image() -> None:
    ours, theirs = lab(linear(COLOURS).astype(np.float64)), rgb2lab(COLOURS)
    assert np.abs(ours - theirs).max() < 0.05
    assert np.abs(lightness(luminance(COLOURS)) - theirs[..., 0]).max() < 0.05


def test_one_black_pen_covers_what_the_light_leaves() -> None:
    (demand,) = separate(COLOURS, load_pens("black"), 0.92)
    grey = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    (ramp,) = separate(grey, load_pens("black"), 0.92)
    assert np.abs(ramp - np.minimum(1 - luminance(grey), 0.92)).max() < 0.01
    assert np.abs(demand - np.minimum(1 - luminance(COLOURS), 0.92)).max() < 0.02


@pytest.mark.parametrize(("name", "part"), [("cmyk", 0.3), ("greys", 0.8), ("sepia-white", 0.9)])
def test_pens_together_come_nearer_to_the_photo_than_bare_paper(name: str, part: float) -> None:
    """As near as their inks can: random colours are more saturated than photos."""
    pens = load_pens(name)
    demands = separate(COLOURS, pens, 0.92)
    inks = [linear(np.array(hex_to_rgb(color), np.uint8)) for color in (pens.paper, *(pen.color for pen in pens.pens))]
    wanted = rgb2lab(COLOURS)

    def distance(coverages: NDArray[np.float64]) -> float:
        return float(np.linalg.norm(lab(composite(coverages, pens, inks)) - wanted, axis=-1).mean())

    drawn = np.stack(demands, axis=-1).astype(np.float64)
    assert distance(drawn) < part * distance(np.zeros_like(drawn))
    assert all(demand.min() >= 0 and demand.max() <= 0.92 for demand in demands)


def test_light_tones_go_to_light_greys_and_dark_ones_to_black() -> None:
    tones = np.repeat(np.array([[235, 20]], np.uint8)[..., None], 3, axis=2)
    light, _, _, black = (demand[0] for demand in separate(tones, load_pens("greys"), 0.92))
    assert light[0] > 0.1 > 0.02 > black[0]
    assert black[1] > 0.5
