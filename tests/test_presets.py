"""Presets: the shipped ones, the rule for lengths, what may be set, and what is refused in which words."""

from __future__ import annotations

import datetime
import math
import re
from functools import partial
from math import sqrt
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import strokeplan
from strokeplan.color_settings import LayerColors
from strokeplan.errors import PresetError
from strokeplan.presets import LEAST_LENGTHS, LayerPreset, Preset, load_preset, names, parse_assignments, source

# Lengths by the words of the documentation, not by the lists that the code keeps.
LENGTHS = {"derivative_sigma", "integration_sigma", "max_integration_sigma", "step_tolerance", "max_step"}
PURE_NUMBERS = {"gain", "separation", "importance_strength", "thin", "merge", "pressure"}
LAYER_LENGTHS = {"sigma", "length", "width", "min_length", "simplify_tolerance", "fit_tolerance"}

ONE_LAYER = "[[layers]]\nsigma = 1\nlength = 10\nwidth = 5\ncolor_threshold = 50\n"


def refused(call: Any, *words: str) -> None:
    """The call ends in a PresetError of one line that has all the words in it."""
    with pytest.raises(PresetError, match=r"^[^\n]+$") as raised:
        call()
    for word in words:
        assert word in str(raised.value)


def refused_file(path: Path, content: str | bytes, *words: str) -> None:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refused(lambda: load_preset(path), str(path), *words)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "mine.toml"


# Shipped presets


def test_the_shipped_presets_are_listed() -> None:
    assert {"paper", "paper-published"} <= set(names())
    assert names() == sorted(names())


@pytest.mark.parametrize("name", names())
def test_shipped_presets_load_and_say_what_they_are(name: str) -> None:
    preset = load_preset(name)
    assert preset.name == name
    assert preset.description.endswith(".")
    assert load_preset(preset) is preset


@pytest.mark.parametrize("name", names())
def test_the_source_of_a_shipped_preset_makes_the_same_preset(file: Path, name: str) -> None:
    file.write_text(source(name), encoding="utf-8")
    assert msgspec.structs.replace(load_preset(file), name=name) == load_preset(name)


@pytest.mark.parametrize("name", names())
def test_shipped_presets_plan_a_small_picture(small_picture: NDArray[np.uint8], name: str) -> None:
    plan = strokeplan.plan(small_picture, name)
    assert len(plan) > 0
    assert plan.settings["preset"]["name"] == name


def test_descriptions_fit_a_line_of_the_list() -> None:
    assert max(len(load_preset(name).description) for name in names()) <= 100


def test_preset_paper_is_table_1() -> None:
    paper = load_preset("paper")
    assert [layer.sigma for layer in paper.layers] == [10, 5, 1, 0.5]
    assert [layer.length for layer in paper.layers] == [1000, 500, 100, 100]
    assert [layer.width for layer in paper.layers] == [50, 25, 5, 2.5]
    assert [layer.color_threshold for layer in paper.layers] == [100, 100, 50, 50]
    assert paper.coherence == 0.5
    assert paper.derivative_sigma == paper.integration_sigma == 1
    assert paper.lengths == "pixels"
    assert paper.orientation == "tensor"
    assert paper.background == "#ffffff"


# Files


def test_a_file_of_the_users_is_a_preset(file: Path) -> None:
    file.write_text(ONE_LAYER, encoding="utf-8")
    preset = load_preset(str(file))
    assert preset.name == "mine"
    assert preset.layers == (LayerPreset(sigma=1, length=10, width=5, color_threshold=50),)


def test_a_file_may_name_its_preset(file: Path) -> None:
    file.write_text("name = 'Böcklin'\n" + ONE_LAYER, encoding="utf-8")
    assert load_preset(file).name == "Böcklin"


def test_as_many_as_32_layers_are_taken(file: Path) -> None:
    file.write_text(32 * ONE_LAYER, encoding="utf-8")
    assert len(load_preset(file).layers) == 32


@pytest.mark.parametrize("name", ["papre", "PAPER", "", "paper.yaml", "../presets/paper"])
def test_an_unknown_name_is_refused_and_the_known_are_told(name: str) -> None:
    refused(lambda: load_preset(name), repr(name), ", ".join(names()), ".toml")
    refused(lambda: source(name), repr(name), ", ".join(names()))


def test_a_missing_file_is_named(file: Path) -> None:
    refused(lambda: load_preset(file), str(file), "No such file")


def test_a_folder_is_no_preset(file: Path) -> None:
    file.mkdir()
    refused(lambda: load_preset(file), str(file), "cannot be read")


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("layers = [", "is not TOML"),
        ("coherence 0.5\n" + ONE_LAYER, "line 1"),
        ("coherence = 0.5\ncoherence = 0.6\n" + ONE_LAYER, "line 2"),
        (b"name = '\xff'\n" + ONE_LAYER.encode(), "utf-8"),
        (b"\x00\x01\x02", "is not TOML"),
        ("name = " + "[" * 20_000, "is not TOML"),
        ("coherence = " + "1" * 5_000, "is not TOML"),
    ],
    ids=["no end", "no equals sign", "twice", "not UTF-8", "binary", "nested deeply", "endless number"],
)
def test_what_is_not_toml_is_refused(file: Path, content: str | bytes, word: str) -> None:
    refused_file(file, content, word)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("coherense = 0.5\n" + ONE_LAYER, ("`coherense`", "known are", "coherence")),
        (ONE_LAYER.replace("width", "widht"), ("layers.1", "`widht`", "known are", "width")),
        (ONE_LAYER + ONE_LAYER.replace("sigma = 1\n", ""), ("layers.2", "missing", "`sigma`")),
        ("", ("missing", "`layers`")),
        ("layers = []", ("layers", "length >= 1")),
        ("layers = 5", ("layers = 5", "Expected `array`")),
        (33 * ONE_LAYER, ("layers", "length <= 32")),
        (ONE_LAYER.replace("width = 5", "width = nan"), ("layers.1.width = nan", ">= 0.1")),
        (ONE_LAYER.replace("width = 5", "width = inf"), ("layers.1.width = inf", "<= 100000")),
        (ONE_LAYER.replace("width = 5", "width = 1" + "0" * 400), ("layers.1.width = 1000",)),
        (ONE_LAYER.replace("width = 5", "width = '5'"), ("layers.1.width = '5'", "Expected `float`, got `str`")),
        (ONE_LAYER.replace("width = 5", "width = 1979-01-01"), ("layers.1.width", "1979", "Expected `float`")),
        (ONE_LAYER + ONE_LAYER.replace("50", "500"), ("layers.2.color_threshold = 500", "<= 442")),
        ("name = 5\n" + ONE_LAYER, ("name = 5", "Expected `str`")),
        ("lengths = 'metres'\n" + ONE_LAYER, ("lengths = 'metres'", "one of pixels, relative")),
    ],
    ids=lambda value: re.sub(r"\s+", " ", value)[-40:] if isinstance(value, str) else "",
)
def test_a_wrong_value_in_a_file_is_named_with_its_place(file: Path, content: str, words: tuple[str, ...]) -> None:
    refused_file(file, content, *words)


# Overriding


def test_values_are_set_by_dotted_key_with_layers_from_1() -> None:
    paper = load_preset("paper")
    changed = paper.override({"layers.2.width": 8, "coherence": 0.25, "cap": "butt", "layers.4.sigma": 0.75})
    assert [layer.width for layer in changed.layers] == [50, 8, 5, 2.5]
    assert [layer.sigma for layer in changed.layers] == [10, 5, 1, 0.75]
    assert (changed.coherence, changed.cap) == (0.25, "butt")
    assert changed.override({"layers.2.width": 25, "coherence": 0.5, "cap": "round", "layers.4.sigma": 0.5}) == paper
    assert paper == load_preset("paper")


def test_a_whole_layer_can_be_set() -> None:
    layer = {"sigma": 1, "length": 2, "width": 3, "color_threshold": 4}
    changed = load_preset("paper").override({"layers.3": layer})
    assert changed.layers[2] == LayerPreset(sigma=1, length=2, width=3, color_threshold=4)
    assert load_preset("paper").override({"layers": [layer]}).layers == (changed.layers[2],)


def test_setting_nothing_changes_nothing() -> None:
    assert load_preset("paper").override({}) == load_preset("paper")


@pytest.mark.parametrize("layer", ["0", "5", "9", "-1", "x", "²", ""])
def test_a_layer_that_does_not_exist_is_refused(layer: str) -> None:
    key = f"layers.{layer}.width"
    refused(lambda: load_preset("paper").override({key: 8}), f"{key}: there is no layer", "numbered 1 to 4")


@pytest.mark.parametrize(
    ("key", "unknown", "known"),
    [
        ("coherense", "coherense", "coherence"),
        ("layers.2.widht", "widht", "width"),
        ("layer.2.width", "layer", "layers"),
        ("width", "width", "layers"),
        ("", "", "layers"),
    ],
)
def test_an_unknown_key_is_refused_and_the_known_are_told(key: str, unknown: str, known: str) -> None:
    refused(lambda: load_preset("paper").override({key: 8}), f"{key}: unknown key {unknown!r}; known are", known)


def test_a_value_has_no_parts() -> None:
    refused(lambda: load_preset("paper").override({"coherence.x": 8}), "coherence.x: a value has no parts")


@pytest.mark.parametrize(
    ("key", "value", "right"),
    [
        ("layers.2.width", 0, ">= 0.1"),
        ("layers.2.width", -8, ">= 0.1"),
        ("layers.2.width", 1e6, "<= 100000"),
        ("layers.2.width", math.nan, ">= 0.1"),
        ("layers.2.width", math.inf, "<= 100000"),
        ("layers.2.sigma", -math.inf, ">= 0"),
        ("layers.2.length", 0, "> 0"),
        ("layers.2.width", 10**400, ""),  # in words of msgspec's version
        ("layers.2.width", "wide", "Expected `float`, got `str`"),
        ("layers.2.width", True, "Expected `float`, got `bool`"),
        ("layers.2.width", datetime.date(1979, 1, 1), "Expected `float`"),
        ("layers.2", 5, "Expected `object`"),
        ("layers", 5, "Expected `array`"),
        ("coherence", 1.5, "<= 1"),
        ("coherence", math.nan, ">= 0"),
        ("derivative_sigma", 0, "> 0"),
        ("min_vertices", 1, ">= 2"),
        ("min_vertices", 2.5, "Expected `int`"),
        ("background", "red", "#[0-9a-fA-F]{6}"),
        ("background", "#12345", "#[0-9a-fA-F]{6}"),
        ("cap", "square", "one of round, butt"),
        ("orientation", "sobel", "one of tensor, gradient"),
        ("channels", "rgb", "one of grey, lab, hue"),
        ("wander", 1.1, "<= 1"),
        ("wander", -0.1, ">= 0"),
        ("max_integration_sigma", 1e4, "<= 1000"),
    ],
    ids=str,
)
def test_a_wrong_value_is_refused_with_its_place_and_what_is_right(key: str, value: Any, right: str) -> None:
    shown = repr(value)[:8]
    refused(lambda: load_preset("paper").override({key: value}), "preset paper", f"{key} = {shown}", right)


def test_an_averaging_that_would_shrink_is_refused() -> None:
    refused(
        lambda: load_preset("paper").override({"max_integration_sigma": 0.5}),
        "preset paper", "max_integration_sigma = 0.5", "below integration_sigma = 1", "0 for",
    )  # fmt: skip
    for fine in (0, 1, 30):
        assert load_preset("paper").override({"max_integration_sigma": fine}).max_integration_sigma == fine


# Assignments on the command line


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("layers.2.width=8", "layers.2.width", 8),
        (" layers.2.width = 8.5 ", "layers.2.width", 8.5),
        ("cap=butt", "cap", "butt"),
        ("cap='butt'", "cap", "butt"),
        ("background=#112233", "background", "#112233"),
        ("description=a = b", "description", "a = b"),
        ("description=", "description", ""),
        ("coherence=1e-1", "coherence", 0.1),
        ("name=" + "[" * 20_000, "name", "[" * 20_000),
        ("name=" + "1" * 5_000, "name", "1" * 5_000),
    ],
    ids=lambda value: str(value)[:20],
)
def test_assignments_are_read_as_toml_or_else_as_text(text: str, key: str, value: Any) -> None:
    (read,) = parse_assignments([text]).items()
    assert read == (key, value)
    assert type(read[1]) is type(value)


def test_the_last_of_two_assignments_holds() -> None:
    assert parse_assignments(["coherence=0.1", "cap=butt", "coherence=0.2"]) == {"coherence": 0.2, "cap": "butt"}


def test_nan_is_read_and_then_refused_by_the_preset() -> None:
    settings = parse_assignments(["coherence=nan"])
    assert math.isnan(settings["coherence"])
    refused(lambda: load_preset("paper").override(settings), "coherence = nan")


@pytest.mark.parametrize("text", ["layers.2.width", "", "=8", "  = 8"])
def test_what_is_no_assignment_is_refused(text: str) -> None:
    refused(lambda: parse_assignments([text]), repr(text), "KEY=VALUE")


# Lengths


def lengths_of(preset: Preset) -> dict[str, float]:
    """Every number of a preset that is a length, by dotted key."""
    own = {name: getattr(preset, name) for name in LENGTHS}
    return own | {
        f"layers.{number}.{name}": getattr(layer, name)
        for number, layer in enumerate(preset.layers, start=1)
        for name in LAYER_LENGTHS
    }


def test_lengths_in_pixels_do_not_depend_on_the_photo() -> None:
    paper = load_preset("paper")
    assert paper.for_photo(4000, 3000) == paper


def test_relative_lengths_scale_with_the_photo_and_nothing_else_does() -> None:
    relative = load_preset("paper").override({"lengths": "relative", "layers.1.min_length": 3})
    scaled = relative.for_photo(4000, 1000)  # √(4000 · 1000) / 1000 = 2
    assert lengths_of(scaled) == {key: 2 * value for key, value in lengths_of(relative).items()}
    # With the lengths put back, the rest is the same.
    assert scaled.override({**lengths_of(relative), "lengths": "relative"}) == relative
    assert scaled.lengths == "pixels"


def test_every_number_with_a_unit_is_known_to_be_a_length() -> None:
    """A field that is added must be put on one side or the other."""
    numbers = {field.name for field in msgspec.structs.fields(Preset) if isinstance(field.default, float)}
    assert numbers == LENGTHS | {"coherence", "wander"} | PURE_NUMBERS
    assert set(LayerPreset.__struct_fields__) == LAYER_LENGTHS | {"color_threshold", "gain"} | set(
        LayerColors.__struct_fields__
    )


def test_a_relative_length_that_gets_too_small_is_the_least_there_is() -> None:
    """What a preset in pixels may give: the smallest photo has its plan too."""
    tiny = load_preset("paper").override({"lengths": "relative"}).for_photo(2, 2)
    assert [layer.width for layer in tiny.layers] == [0.1] * 4
    assert [layer.fit_tolerance for layer in tiny.layers] == [0.01] * 4
    assert tiny.layers[0].length == pytest.approx(2)
    assert tiny.step_tolerance == pytest.approx(1e-4)
    for key, least in LEAST_LENGTHS.items():
        place = key if key in LENGTHS else f"layers.1.{key}"
        load_preset("paper").override({place: least})
        below = {place: 0.99 * least}
        refused(partial(load_preset("paper").override, below), place, ">=")


def test_a_relative_length_that_gets_too_large_is_refused() -> None:
    vast = load_preset("paper").override({"lengths": "relative", "layers.1.width": 1e5})
    refused(lambda: vast.for_photo(2000, 2000), "paper on 2000 × 2000 pixels", "layers.1.width = 200000", "<= 100000")


layers = st.builds(
    LayerPreset,
    sigma=st.floats(0, 100),
    length=st.floats(0.1, 1000),
    width=st.floats(1, 100),
    color_threshold=st.floats(0, 442),
    min_length=st.floats(0, 100),
    simplify_tolerance=st.floats(0, 10),
    fit_tolerance=st.floats(0.1, 10),
)
presets = st.builds(
    Preset,
    layers=st.lists(layers, min_size=1, max_size=5).map(tuple),
    lengths=st.sampled_from(["pixels", "relative"]),
    coherence=st.floats(0, 1),
    derivative_sigma=st.floats(0.1, 10),
    step_tolerance=st.floats(0.01, 1),
    orientation=st.sampled_from(["tensor", "gradient"]),
)
sides = st.integers(100, 20_000)


@given(presets, sides, sides)
def test_applying_a_preset_to_a_photo_twice_is_applying_it_once(preset: Preset, width: int, height: int) -> None:
    once = preset.for_photo(width, height)
    assert once.for_photo(width, height) == once


@given(presets, sides, sides)
def test_only_the_area_of_the_photo_counts(preset: Preset, width: int, height: int) -> None:
    assert preset.for_photo(width, height) == preset.for_photo(height, width)
    unit = sqrt(width * height) / 1000 if preset.lengths == "relative" else 1
    assert preset.for_photo(width, height).layers[0].width == pytest.approx(preset.layers[0].width * unit)


@given(presets)
def test_a_preset_survives_being_written_and_read(preset: Preset) -> None:
    assert msgspec.json.decode(msgspec.json.encode(preset), type=Preset) == preset


def test_a_name_in_a_list_that_is_not_known_is_refused_with_those_that_are() -> None:
    refused(
        lambda: load_preset("fine").override({"importance": ["noses"]}), "importance.1 = 'noses'", "faces, saliency"
    )
