"""Presets: named styles, data and not code (presets/*.toml, or a file of the user's).

The one rule for lengths: `lengths = "pixels"` gives them in pixels of the photo; `lengths = "relative"`
in thousandths of √(width × height) of the photo. `Preset.for_photo` applies it; whatever comes after
sees pixels.
"""

from __future__ import annotations

import re
import reprlib
import warnings
from importlib.resources import files
from math import sqrt
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

import msgspec
from msgspec import Meta

from strokeplan.color_settings import ColorStyle, HexColor, LayerColors
from strokeplan.errors import PresetError, StrokeplanWarning
from strokeplan.version import __version__

MAX_LENGTH = 1e5
MAX_FILTER = 1e3
"""These two filters run at the scale of the layer, which may be the photo's: time grows with them."""
MAX_LAYERS = 32
LEAST_LENGTHS = {"width": 0.1, "fit_tolerance": 0.01, "step_tolerance": 1e-6}
"""No length in pixels may be less, so that the smallest photo has its plan too."""
Length = Annotated[float, Meta(ge=0, le=MAX_LENGTH)]
PositiveLength = Annotated[float, Meta(gt=0, le=MAX_LENGTH)]


class LayerPreset(LayerColors, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One layer of strokes, and how its colours depart from the photo's."""

    sigma: Length
    """Standard deviation of the blur at which the orientation is measured (Table 1: scale factor σ)."""
    length: PositiveLength
    """Longest tract (Table 1)."""
    width: Annotated[float, Meta(ge=LEAST_LENGTHS["width"], le=MAX_LENGTH)]
    """Width of the brush, and side of the grid's cells (Table 1)."""
    color_threshold: Annotated[float, Meta(ge=0, le=442)] = 0.0
    """A cell is tried when the mean RGB distance of photo and canvas exceeds this (Table 1), if not by gain."""
    gain: Annotated[float, Meta(ge=1e-3, le=1e3)] = 1.0
    """What a stroke of this layer must gain to be kept, in parts of what the preset asks for."""
    min_length: Length = 0.0
    """Tracts shorter than this are dropped."""
    simplify_tolerance: Length = 0.25
    """Furthest that Ramer–Douglas–Peucker may move the tract; by gain, a part of the width if that is more."""
    fit_tolerance: Annotated[float, Meta(ge=LEAST_LENGTHS["fit_tolerance"], le=MAX_LENGTH)] = 0.75
    """Furthest that a fitted curve may stray from the simplified tract; by gain, likewise."""


LAYER_LENGTHS = ("sigma", "length", "width", "min_length", "simplify_tolerance", "fit_tolerance")


class Preset(ColorStyle, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A style: everything the planner needs beside the photo and the seed."""

    layers: Annotated[tuple[LayerPreset, ...], Meta(min_length=1, max_length=MAX_LAYERS)]
    name: str = ""
    description: str = ""
    lengths: Literal["pixels", "relative"] = "pixels"
    background: HexColor = "#ffffff"
    """Colour of the bare canvas."""
    grey: Literal["luma", "mean"] = "luma"
    """How the photo becomes grey: BT.709 luminance, or the mean of the channels."""
    channels: Literal["grey", "lab", "hue"] = "grey"
    """What the orientation is measured on: that grey; CIE L*a*b*, which sees edges between colours of one grey too;
    or hue alone, blind to light and shade."""
    orientation: Literal["tensor", "gradient"] = "tensor"
    derivative_sigma: Annotated[float, Meta(gt=0, le=MAX_FILTER)] = 1.0
    """σ_d of the derivative of Gaussian."""
    integration_sigma: Annotated[float, Meta(ge=0, le=MAX_FILTER)] = 1.0
    """ρ of the tensor's averaging."""
    max_integration_sigma: Annotated[float, Meta(ge=0, le=MAX_FILTER)] = 0.0
    """How far the averaging may grow where the tensor is incoherent or weak, so that flat areas follow their
    surroundings; 0: never."""
    coherence: Annotated[float, Meta(ge=0, le=1)] = 0.5
    """A tract ends where the coherence falls below this."""
    step_tolerance: Annotated[float, Meta(ge=LEAST_LENGTHS["step_tolerance"], le=MAX_LENGTH)] = 0.05
    """Largest estimated error of one Runge–Kutta step."""
    max_step: PositiveLength = 2.0
    """Longest Runge–Kutta step: a tract cannot leap across a wider band of incoherence."""
    wander: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """How far tracts stray from the orientation, as a part of its uncertainty; 0: not at all."""

    keep: Literal["threshold", "gain"] = "threshold"
    """A stroke is kept where its cell differs from the photo by more than the layer's threshold; or for what it
    improves, in the stretch of its tract that improves most."""
    gain: Annotated[float, Meta(ge=0.01, le=1e6)] = 30.0
    """Least part of the picture's error, in millionths, that a stroke must take away to be kept by gain."""
    cover: bool = False
    """The first layer covers every pixel of the canvas."""
    seeding: Literal["grid", "worst-first", "error", "even"] = "grid"
    """Where strokes are tried: at the centres of cells in random order; at the worst pixels of the worst cells
    first; at random, with a probability proportional to the present error; evenly spaced."""
    separation: Annotated[float, Meta(ge=0.1, le=100)] = 1.0
    """Distance of evenly spaced strokes, in widths of their brush."""
    importance: tuple[Literal["faces", "saliency"], ...] = ()
    """What says where detail matters, if no mask does."""
    importance_strength: Annotated[float, Meta(ge=0, le=1)] = 0.5
    """How much more it matters there: at 1 error counts four times as much as on neutral ground, and brushes are
    half as wide; where detail matters least, the other way round."""
    regions: Annotated[int, Meta(ge=0, le=10_000)] = 0
    """Regions of similar colour whose borders no tract crosses; 0: tracts cross everything."""
    thin: Annotated[float, Meta(ge=0, le=442)] = 0.0
    """Strokes that differ from what lies below them by less than this mean RGB distance are left out."""
    merge: Annotated[float, Meta(ge=0, le=442)] = 0.0
    """Strokes of a layer that meet, in nearly the same direction and in colours nearer than this RGB distance, become
    one stroke; 0: never. Not in a first layer that covers the canvas."""
    pressure: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """How much the pressure of the brush varies along a stroke; 0: not at all."""

    # Where the author's published pictures leave the text, the second value reproduces them.
    color_test: Literal["rgb", "unscaled"] = "rgb"
    """Photo and canvas compared in 0..255, or the photo in 0..1 against the canvas in 0..255."""
    grid: Literal["cells", "nodes"] = "cells"
    """Cells tile the photo, seeds at their centres; or cells of ⌊width⌋ centred on nodes that far
    apart, seeds at their far corners, cells that reach over the first row or column left out."""
    directions: Literal["both", "forward"] = "both"
    """Followed both ways from the seed, or one way."""
    interpolation: Literal["aligned", "signed"] = "aligned"
    """Eigenvectors turned to agree before they are interpolated, or taken with the sign they have."""
    min_vertices: Annotated[int, Meta(ge=2, le=16)] = 2
    """Tracts with fewer vertices after simplification are dropped."""
    fit: Literal["bounded", "published"] = "bounded"
    """Fitted curves held to the tolerance everywhere; or as the published code fits them: the two handles of a
    piece exchanged, the last one turned round, nothing measured between the vertices, no second attempt."""
    color: Literal["middle", "handle"] = "middle"
    """One colour a stroke from the middle of its tract, or one a cubic from its second handle."""
    cap: Literal["round", "butt"] = "round"

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.max_integration_sigma < self.integration_sigma:
            raise ValueError(
                f"max_integration_sigma = {self.max_integration_sigma:g} is below integration_sigma = "
                f"{self.integration_sigma:g}; give at least that, or 0 for an averaging that never grows"
            )

    def for_photo(self, width: int, height: int) -> Preset:
        """This preset with every length in pixels of a photo of that size, or the least that a preset may give."""
        if self.lengths == "pixels":
            return self
        unit = sqrt(width * height) / 1000

        def scaled_lengths(table: Preset | LayerPreset, names: tuple[str, ...]) -> dict[str, float]:
            return {name: max(getattr(table, name) * unit, LEAST_LENGTHS.get(name, 0.0)) for name in names}

        layers = tuple(msgspec.structs.replace(layer, **scaled_lengths(layer, LAYER_LENGTHS)) for layer in self.layers)
        scaled = msgspec.structs.replace(self, lengths="pixels", layers=layers, **scaled_lengths(self, PRESET_LENGTHS))
        return _from_builtins(msgspec.to_builtins(scaled), f"{self.name} on {width} × {height} pixels")

    def override(self, settings: dict[str, Any]) -> Preset:
        """A copy with values replaced by dotted key; layers count from 1: {"layers.2.width": 8}."""
        raw = msgspec.json.decode(msgspec.json.encode(self))  # not to_builtins: its tuples cannot be assigned to
        for key, value in settings.items():
            assign(raw, key, value)
        return _from_builtins(raw, self.name or "preset")


PRESET_LENGTHS = ("derivative_sigma", "integration_sigma", "max_integration_sigma", "step_tolerance", "max_step")


PLANS = (".json", ".json.gz", ".svg", ".svgz")
"""Files whose settings hold the preset of a plan."""


def names() -> list[str]:
    """The presets that ship with strokeplan."""
    return sorted(entry.name.removesuffix(".toml") for entry in _folder().iterdir() if entry.name.endswith(".toml"))


class Recipe(NamedTuple):
    """What a plan was made with; with the photo (and the mask, if there was one) it makes the same plan again."""

    preset: Preset
    seed: int = 0
    strokes: int | None = None
    mask: str | None = None


def load_recipe(preset: str | PathLike[str] | Preset | Recipe) -> Recipe:
    """A preset as `load_preset` finds it, with the seed and the budget of the plan that it was read from, if any.

    Raises PresetError, FormatError. Warns if that plan is another version's.
    """
    if isinstance(preset, Recipe):
        return preset
    if isinstance(preset, Preset) or not str(preset).lower().endswith(PLANS):
        return Recipe(load_preset(preset))
    from strokeplan.formats import read_settings

    recorded = read_settings(preset)
    if "preset" not in recorded:
        raise PresetError(f"preset {preset}: no preset is recorded in this file; give one that strokeplan planned")
    try:
        version, seed, strokes, mask = msgspec.convert(
            tuple(recorded.get(key) for key in ("strokeplan", "seed", "strokes", "mask")),
            tuple[str | None, Annotated[int, Meta(ge=0)] | None, int | None, str | None],
        )
    except msgspec.ValidationError as error:
        raise PresetError(f"preset {preset}: its settings are damaged ({error})") from None
    if version != __version__:
        warnings.warn(
            f"{preset} was planned by strokeplan {version}; this is {__version__}, which may plan otherwise",
            StrokeplanWarning,
            stacklevel=2,
        )
    return Recipe(_from_builtins(recorded["preset"], str(preset)), seed or 0, strokes, mask)


def load_preset(preset: str | PathLike[str] | Preset) -> Preset:
    """A shipped preset by name, one from a .toml file, or that of a plan (.json, .json.gz, .svg, .svgz).

    Raises PresetError, FormatError.
    """
    if isinstance(preset, Preset):
        return preset
    if str(preset).lower().endswith(PLANS):
        return load_recipe(preset).preset
    if str(preset) in names():
        return _parse((_folder() / f"{preset}.toml").read_bytes(), str(preset), str(preset))
    path = Path(preset)
    if path.suffix != ".toml":
        raise PresetError(f"unknown preset {str(preset)!r}; known are {', '.join(names())}, or give a .toml file")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise PresetError(f"preset {path}: cannot be read ({error.strerror})") from None
    return _parse(data, str(path), path.stem)


def source(name: str) -> str:
    """The text of a shipped preset, comments and all."""
    if name not in names():
        raise PresetError(f"unknown preset {name!r}; known are {', '.join(names())}")
    text: str = (_folder() / f"{name}.toml").read_text(encoding="utf-8")
    return text


def parse_assignments(assignments: list[str]) -> dict[str, Any]:
    """["layers.2.width=8", "cap=butt"] → {"layers.2.width": 8, "cap": "butt"}."""
    settings: dict[str, Any] = {}
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        if not equals or not key.strip():
            raise PresetError(f"{assignment!r} is not KEY=VALUE; try layers.2.width=8")
        try:
            value = msgspec.toml.decode(f"value = {text.strip()}")["value"]
        except _NOT_TOML:
            value = text.strip()
        settings[key.strip()] = value
    return settings


def style(preset: str | PathLike[str] | Preset, assignments: list[str] | None) -> Preset:
    """A preset as the command line gives it: by name or file, with KEY=VALUE changes."""
    return load_preset(preset).override(parse_assignments(assignments or []))


_NOT_TOML = (msgspec.DecodeError, ValueError, RecursionError)
"""What the parser raises; the latter two for bytes that are not UTF-8, endless numbers, endless nesting."""


def _folder() -> Any:
    return files("strokeplan") / "presets"


def _parse(data: bytes, where: str, name: str) -> Preset:
    try:
        raw = msgspec.toml.decode(data)
    except _NOT_TOML as error:
        raise PresetError(f"preset {where}: is not TOML ({error})") from None
    raw.setdefault("name", name)
    return _from_builtins(raw, where)


def _from_builtins(raw: Any, where: str) -> Preset:
    try:
        preset = msgspec.convert(raw, Preset)
    except msgspec.ValidationError as error:
        raise PresetError(f"preset {where}: {_readable(str(error), raw)}") from None
    return preset


def assign(raw: dict[str, Any], key: str, value: Any) -> None:
    """Set one value of nested tables and lists by its dotted key; items of lists count from 1. Raises PresetError."""
    *parents, last = key.split(".")
    node: Any = raw
    for label in parents:
        node = node[_index(node, label, key)]
    node[_index(node, last, key)] = value


def _index(node: Any, label: str, key: str) -> str | int:
    """What one part of a dotted key stands for in the list or table that it leads into."""
    if isinstance(node, list):
        if not label.isdecimal() or not 1 <= int(label) <= len(node):
            raise PresetError(f"{key}: there is no layer {label!r}; layers are numbered 1 to {len(node)}")
        return int(label) - 1
    if not isinstance(node, dict):
        raise PresetError(f"{key}: a value has no parts")
    if label not in node:
        raise PresetError(f"{key}: unknown key {label!r}; known are {', '.join(node)}")
    return label


def _readable(message: str, raw: Any) -> str:
    """msgspec's "Expected … - at `$.layers[1].width`" as "layers.2.width = -8: Expected …", and what is known there."""
    text, _, path = message.partition(" - at `$")
    steps = re.findall(r"\w+", path)
    value = raw
    for step in steps:
        value = value[int(step) if step.isdecimal() else step]
    place = ".".join(str(int(step) + 1) if step.isdecimal() else step for step in steps)
    known = {field.name: field.type for field in msgspec.structs.fields(LayerPreset if "layers" in steps else Preset)}
    if "unknown field" in text:
        text += f"; known are {', '.join(known)}"
    elif text.startswith("Invalid enum"):
        field = next(step for step in reversed(steps) if not step.isdecimal())
        kinds = get_args(known[field])
        text = f"Expected one of {', '.join(get_args(kinds[0]) or kinds)}"  # of a tuple: what its items may be
    if not isinstance(value, dict | list | tuple):
        place += f" = {reprlib.repr(value)}"
    return f"{place}: {text}" if place else text
