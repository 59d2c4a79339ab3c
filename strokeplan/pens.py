"""Pens and sets of pens: data and not code (pen_sets/*.toml, or a file of the user's).

A set is the paper and the pens that draw on it, in the order in which they do. Ink that is transparent filters
what lies below it, ink that is opaque hides it.
"""

from __future__ import annotations

from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from strokeplan.color_settings import HexColor
from strokeplan.errors import InputError

if TYPE_CHECKING:
    from strokeplan.strokes import StrokePlan

MIN_WIDTH_MM, MAX_WIDTH_MM = 0.05, 20.0
MAX_PENS = 16


class Pen(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One pen: its name, the colour of its ink on white paper, and the width of its line."""

    name: Annotated[str, Meta(min_length=1, max_length=80)]
    color: HexColor
    width_mm: Annotated[float, Meta(ge=MIN_WIDTH_MM, le=MAX_WIDTH_MM)] = 0.3
    ink: Literal["transparent", "opaque"] = "transparent"


class PenSet(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Paper, and the pens that draw on it one after the other."""

    pens: Annotated[tuple[Pen, ...], Meta(min_length=1, max_length=MAX_PENS)]
    name: str = ""
    description: str = ""
    paper: HexColor = "#ffffff"

    def __post_init__(self) -> None:
        names = [pen.name for pen in self.pens]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"there are two pens {name!r}; each needs a name of its own")

    def with_width(self, width_mm: float) -> PenSet:
        """The same pens, all of one width. Raises InputError."""
        if not MIN_WIDTH_MM <= width_mm <= MAX_WIDTH_MM:
            raise InputError(f"pen {width_mm:g} mm is outside {MIN_WIDTH_MM:g}..{MAX_WIDTH_MM:g} mm")
        pens = tuple(msgspec.structs.replace(pen, width_mm=width_mm) for pen in self.pens)
        return msgspec.structs.replace(self, pens=pens)


def pen_sets() -> list[str]:
    """The sets that ship with strokeplan."""
    return sorted(entry.name.removesuffix(".toml") for entry in _folder().iterdir() if entry.name.endswith(".toml"))


def load_pens(pens: str | PathLike[str] | PenSet) -> PenSet:
    """A set that ships with strokeplan by name, or one from a .toml file. Raises InputError."""
    if isinstance(pens, PenSet):
        return pens
    if str(pens) in pen_sets():
        return _parse((_folder() / f"{pens}.toml").read_bytes(), str(pens), str(pens))
    path = Path(pens)
    if path.suffix != ".toml":
        raise InputError(f"unknown pens {str(pens)!r}; known are {', '.join(pen_sets())}, or give a .toml file")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"pens {path}: cannot be read ({error.strerror})") from None
    return _parse(data, str(path), path.stem)


def pens_from(raw: Any, where: str) -> PenSet:
    """A set from plain values, as a plan's settings hold them. Raises InputError."""
    try:
        return msgspec.convert(raw, PenSet)
    except msgspec.ValidationError as error:
        raise InputError(f"pens {where}: {error}") from None


def transparent_layers(plan: StrokePlan) -> list[bool]:
    """For each layer of a plan whether its ink filters what lies below: so say the pens that it was drawn with."""
    recorded = plan.settings.get("pens")
    try:
        pens = msgspec.convert(recorded, PenSet).pens
    except msgspec.ValidationError:
        return [False] * len(plan.layers)
    clear = {pen.name for pen in pens if pen.ink == "transparent"}
    return [len(pens) > 1 and layer.medium == "ink" and layer.name in clear for layer in plan.layers]


def _folder() -> Any:
    return files("strokeplan") / "pen_sets"


def _parse(data: bytes, where: str, name: str) -> PenSet:
    try:
        raw = msgspec.toml.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise InputError(f"pens {where}: is not TOML ({error})") from None
    raw.setdefault("name", name)
    return pens_from(raw, where)
