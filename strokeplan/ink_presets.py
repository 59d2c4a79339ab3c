"""Presets of ink: named styles of pen drawing, data and not code (ink_styles/*.toml, or a file of the user's).

A file of an ink preset says `medium = "ink"`. All lengths are millimetres of the paper; angles are degrees.
"""

from __future__ import annotations

from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta, Struct

from strokeplan.errors import PresetError
from strokeplan.page import Page
from strokeplan.pens import PenSet, load_pens

Millimetres = Annotated[float, Meta(ge=0.05, le=1000)]
Part = Annotated[float, Meta(ge=0, le=1)]


BUDGETS = ("strokes", "max_length_mm", "max_time_s", "profile")
"""What of a recipe limits a drawing, by the names under which a plan's settings hold it."""


class InkLayer(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Lines of one direction, over those of the layers before."""

    angle: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    """Turned against the direction that the drawing follows."""
    reach: Annotated[float, Meta(gt=0, le=0.97)]
    """Part of the paper that is covered once this layer is drawn; darker places need the next."""


class InkPreset(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A style of pen drawing."""

    medium: Literal["ink"]
    layers: Annotated[tuple[InkLayer, ...], Meta(min_length=1, max_length=8)]
    name: str = ""
    description: str = ""
    pens: str = "black"
    """The set of pens, if no other is given."""
    direction: Literal["structure", "fixed"] = "structure"
    """What lines follow: the photo's structure, or nothing but their own angle."""
    detail_mm: Millimetres = 0.5
    """σ of the blur at which the direction is measured."""
    integration_mm: Millimetres = 1.5
    """ρ of the tensor's averaging …"""
    max_integration_mm: Millimetres = 20.0
    """… and how far it may grow where the photo says little."""
    wobble: Annotated[float, Meta(ge=0, le=45)] = 0.0
    """How far the hand strays from the direction, degrees (standard deviation)."""
    min_length_mm: Millimetres = 2.0
    """Shortest line."""
    max_length_mm: Millimetres = 80.0
    """Longest line."""
    min_radius_mm: Millimetres = 1.0
    """Lines end where they would bend more sharply."""
    lines_from: Annotated[float, Meta(ge=0.05, le=0.9)] = 0.2
    """Part of the paper to be covered from which there are lines; lighter tones have dashes."""
    dash_mm: Annotated[tuple[Millimetres, ...], Meta(min_length=2, max_length=2)] = (0.3, 2.0)
    """Length of dashes, in the lightest tones and where lines begin."""
    mend_mm: Annotated[tuple[Millimetres, ...], Meta(max_length=8)] = (3.0, 1.5, 0.6)
    """Lengths of strokes that fill what lines leave too light; none: nothing is added."""
    strength: Annotated[float, Meta(gt=0, le=1)] = 1.0
    """Part of the ink that the photo's tone asks for."""
    bare: Annotated[float, Meta(ge=0, le=0.9)] = 0.0
    """Tones that ask for less ink than this stay paper."""


class InkRecipe(NamedTuple):
    """What an ink drawing was made with; with the photo it makes the same drawing again."""

    preset: InkPreset
    seed: int = 0
    pens: PenSet | None = None
    page: Page | None = None
    strokes: int | None = None
    max_length_mm: float | None = None
    max_time_s: float | None = None
    profile: str | None = None
    """Of the machine that the time is of: a name, or a .toml file."""

    def changed(
        self,
        *,
        seed: int | None = None,
        strokes: int | None = None,
        page: Page | None = None,
        pens: str | PathLike[str] | PenSet | None = None,
        max_length_mm: float | None = None,
        max_time_s: float | None = None,
        profile: str | PathLike[str] | None = None,
    ) -> InkRecipe:
        """This recipe with what is given in place of its own. Raises InputError."""
        return self._replace(
            seed=self.seed if seed is None else seed,
            strokes=self.strokes if strokes is None else strokes,
            page=page or self.page,
            pens=self.pens if pens is None else load_pens(pens),
            max_length_mm=self.max_length_mm if max_length_mm is None else max_length_mm,
            max_time_s=self.max_time_s if max_time_s is None else max_time_s,
            profile=self.profile if profile is None else str(profile),
        )


def ink_names() -> list[str]:
    """The ink presets that ship with strokeplan."""
    return sorted(entry.name.removesuffix(".toml") for entry in _folder().iterdir() if entry.name.endswith(".toml"))


def ink_source(name: str) -> str:
    """The text of a shipped ink preset, comments and all."""
    text: str = (_folder() / f"{name}.toml").read_text(encoding="utf-8")
    return text


def find_ink(preset: object) -> InkRecipe | None:
    """The recipe if `preset` is one of ink (a name, a .toml file, a plan's file, an InkPreset), else None.

    Raises PresetError, FormatError.
    """
    if isinstance(preset, InkRecipe | InkPreset):
        return preset if isinstance(preset, InkRecipe) else InkRecipe(preset)
    if not isinstance(preset, str | PathLike):
        return None
    if str(preset) in ink_names():
        return InkRecipe(_from_builtins(msgspec.toml.decode(ink_source(str(preset))), str(preset), str(preset)))
    path = Path(preset)
    if str(preset).lower().endswith((".json", ".json.gz", ".svg", ".svgz")):
        return _recorded(path)
    if path.suffix != ".toml":
        return None
    try:
        raw = msgspec.toml.decode(path.read_bytes())
    except (OSError, msgspec.DecodeError, ValueError, RecursionError):
        return None  # whoever reads presets of paint says what is wrong
    return InkRecipe(_from_builtins(raw, str(path), path.stem)) if raw.get("medium") == "ink" else None


def override_ink(preset: InkPreset, settings: dict[str, Any]) -> InkPreset:
    """A copy with values replaced by dotted key, as `Preset.override` does. Raises PresetError."""
    from strokeplan.presets import assign

    raw = msgspec.json.decode(msgspec.json.encode(preset))
    for key, value in settings.items():
        assign(raw, key, value)
    return _from_builtins(raw, preset.name or "preset", preset.name)


def _folder() -> Any:
    return files("strokeplan") / "ink_styles"


def _from_builtins(raw: Any, where: str, name: str) -> InkPreset:
    try:
        return msgspec.convert({"name": name} | raw, InkPreset)
    except msgspec.ValidationError as error:
        raise PresetError(f"preset {where}: {error}") from None


class _Recorded(Struct):
    """What the settings of an ink drawing hold."""

    ink: InkPreset
    pens: PenSet
    page: Page
    seed: Annotated[int, Meta(ge=0)] = 0
    strokes: int | None = None
    max_length_mm: float | None = None
    max_time_s: float | None = None
    profile: str | None = None


def _recorded(path: Path) -> InkRecipe | None:
    from strokeplan.formats import read_settings

    settings = read_settings(path)
    if "ink" not in settings:
        return None
    try:
        found = msgspec.convert(settings, _Recorded)
    except msgspec.ValidationError as error:
        raise PresetError(f"preset {path}: its settings are damaged ({error})") from None
    budgets = {key: getattr(found, key) for key in BUDGETS}
    return InkRecipe(found.ink, found.seed, found.pens, found.page, **budgets)
