"""What a brush is, which there are, and how a user names one: "bristle", "bristle:hairs=40,load=0.6".

A brush paints some strokes of a plan on a tile of the enlarged canvas. Its texture is a function of the place
in the stroke (arc length, offset from the curve, number of the stroke in the plan), never of the tile or of
output pixels, so that a picture is the same at every size and whichever part of it is painted.
"""

from __future__ import annotations

from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.rendering.nibs import Flat, Round
from strokeplan.rendering.ribbons import Bristle, Dry, Line, Wet
from strokeplan.rendering.stamps import Stamp
from strokeplan.rendering.tile import Tile
from strokeplan.strokes import StrokePlan


class Brush(Protocol):
    """Anything that paints strokes. Every brush obeys pressure (how wide) and, unless it is round, angle.

    One that has kernels may also say `compiled(plan)`: whether they are in Numba's cache.
    """

    @property
    def reach(self) -> float:
        """How far from a stroke's curve its paint may lie, in half widths."""

    @property
    def detail(self) -> float:
        """Size, in half widths, of the finest detail that must not be blurred into a tint: 1 if there is none."""

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        """Paint the strokes of these numbers, in this order. Several threads may do so on tiles of their own."""


BRUSHES: dict[str, Any] = {
    "round": Round,
    "flat": Flat,
    "bristle": Bristle,
    "dry": Dry,
    "wet": Wet,
    "line": Line,
    "stamp": Stamp,
}


def as_brush(brush: str | Brush) -> Brush:
    """The brush that a text like "bristle:hairs=40,load=0.6" names. Raises InputError for a wrong name or value."""
    if not isinstance(brush, str):
        return brush
    name, _, rest = brush.partition(":")
    if name not in BRUSHES:
        raise InputError(f"no brush {name!r}; there are {', '.join(BRUSHES)}")
    values = dict(_setting(brush, part) for part in rest.split(",")) if rest else {}
    kind = BRUSHES[name]
    for key in values:
        if key not in kind.__struct_fields__:
            raise InputError(
                f"brush {name} has no {key!r}; it has {', '.join(kind.__struct_fields__) or 'no settings'}"
            )
    try:
        made: Brush = msgspec.convert(values, kind, strict=False)
    except msgspec.ValidationError as error:
        problem, _, place = str(error).partition(" - at `$.")
        key = place.rstrip("`")
        raise InputError(f"brush {name}: {key}={values.get(key, '')}: {problem}") from None
    if isinstance(made, Stamp):
        made.check()
    return made


def _setting(brush: str, part: str) -> tuple[str, str]:
    key, equals, value = part.partition("=")
    if not (equals and key.strip() and value.strip()):
        raise InputError(f"brush {brush!r}: {part!r} is not KEY=VALUE; try bristle:hairs=40,load=0.6")
    return key.strip(), value.strip()


def described() -> list[tuple[str, str, list[tuple[str, str, str]]]]:
    """Every brush for people: its name, what it is, and its settings as (name, default, meaning)."""
    return [(name, _first_line(kind), _settings(kind)) for name, kind in BRUSHES.items()]


def _settings(kind: Any) -> list[tuple[str, str, str]]:
    info = msgspec.inspect.type_info(kind)
    assert isinstance(info, msgspec.inspect.StructType)  # noqa: S101 - what BRUSHES holds
    return [(field.name, _text(field.default), _meaning(field.type)) for field in info.fields]


def _meaning(annotated: msgspec.inspect.Type) -> str:
    schema = annotated.extra_json_schema if isinstance(annotated, msgspec.inspect.Metadata) else None
    return str((schema or {}).get("description", ""))


def _text(default: Any) -> str:
    return "–" if default is None else str(default)


def _first_line(kind: Any) -> str:
    return str(kind.__doc__).partition("\n")[0]
