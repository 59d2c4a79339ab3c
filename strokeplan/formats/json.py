"""The strokes file, version 1 (docs/strokes-file.md; JSON Schema beside this module).

`d` is a chain of cubics: 2 + 6k numbers. Fields that are not in the schema are refused, except inside
`settings`, whose content is kept as it is; a file of a newer version is refused by name.
"""

from __future__ import annotations

import gc
import gzip
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain, islice
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, Struct, UnsetType
from numpy.typing import NDArray

from strokeplan.errors import FormatError
from strokeplan.strokes import (
    MAX_COORDINATE,
    MAX_SIZE,
    MIN_SIZE,
    Cap,
    Layer,
    Medium,
    Source,
    StrokePlan,
    hex_to_rgb,
    rgb_to_hex,
)

FORMAT, VERSION = "strokeplan", 1
MAX_BYTES = 1 << 30
"""Largest strokes file read, unpacked: some 4 million strokes; a gzip bomb stops here."""

Color = Annotated[str, Meta(pattern="^#[0-9a-fA-F]{6}$", max_length=7)]  # "$" alone would let a newline follow
Coordinate = Annotated[float, Meta(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Extent = Annotated[float, Meta(ge=MIN_SIZE, le=MAX_SIZE)]
Pressure = Annotated[float, Meta(ge=0, le=1)]
Angle = Annotated[float, Meta(ge=0, lt=pi)]
Pixels = Annotated[int, Meta(ge=1, le=10**6)]


class StrokeFile(Struct, forbid_unknown_fields=True, omit_defaults=True, gc=False):
    """One stroke."""

    d: Annotated[list[Coordinate], Meta(min_length=8, description="x0, y0, then six numbers a cubic")]
    width: Annotated[float, Meta(gt=0, le=MAX_SIZE, description="in the unit of the coordinates")]
    color: Color
    pressure: Annotated[list[Pressure], Meta(description="one value per on-curve point")] | UnsetType = UNSET
    angle: Annotated[list[Angle], Meta(description="radians, one value per on-curve point")] | UnsetType = UNSET
    pen: str | UnsetType = UNSET


class LayerFile(Struct, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """A run of strokes, painted in file order."""

    name: str
    medium: Medium = "paint"
    cap: Cap = "round"
    strokes: list[StrokeFile]


class CanvasFile(Struct, forbid_unknown_fields=True):
    width: Extent
    height: Extent
    background: Color = "#ffffff"


class SourceFile(Struct, forbid_unknown_fields=True):
    name: str
    sha256: str
    width: Pixels
    height: Pixels


class PlanFile(Struct, forbid_unknown_fields=True, kw_only=True):
    """A strokes file."""

    format: Literal["strokeplan"]
    version: Literal[1]
    canvas: CanvasFile
    source: SourceFile | None = None
    settings: dict[str, Any] = {}
    layers: list[LayerFile]


class _Head(Struct):
    """Enough of a strokes file to know whether the rest can be understood."""

    format: str = ""
    version: int = 0


def schema() -> dict[str, Any]:
    """The JSON Schema of a strokes file."""
    made = msgspec.json.schema(PlanFile)
    made["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    made["title"] = "strokeplan strokes file, version 1"
    return made


@contextmanager
def paused_gc() -> Iterator[None]:
    """No garbage collection while millions of small objects without cycles are made: it takes half the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def encode(plan: StrokePlan) -> bytes:
    """The strokes file of a plan; the same plan gives the same bytes."""
    with paused_gc():
        return msgspec.json.encode(_to_file(plan)) + b"\n"


def _to_file(plan: StrokePlan) -> PlanFile:
    flat = plan.points.ravel().tolist()
    ends = (2 * plan.starts).tolist()
    widths = plan.widths.tolist()
    colors = hex_colors(plan.colors)
    strokes = [
        StrokeFile(flat[first:last], width, color)
        for first, last, width, color in zip(ends, islice(ends, 1, None), widths, colors, strict=False)
    ]
    for stroke, values in _along(plan, plan.pressures, strokes):
        stroke.pressure = values
    for stroke, values in _along(plan, plan.angles, strokes):
        stroke.angle = values
    if plan.pens is not None:
        for stroke, pen in zip(strokes, plan.pens, strict=True):
            stroke.pen = UNSET if pen is None else pen
    source = plan.source
    return PlanFile(
        format="strokeplan",
        version=1,
        canvas=CanvasFile(float(plan.width), float(plan.height), rgb_to_hex(plan.background)),
        source=None if source is None else SourceFile(source.name, source.sha256, source.width, source.height),
        settings=plan.settings,
        layers=[
            LayerFile(name=y.name, medium=y.medium, cap=y.cap, strokes=strokes[y.first : y.last]) for y in plan.layers
        ],
    )


def read(path: str | os.PathLike[str], limit: int | None = None) -> bytes:
    """The bytes of a strokes file, unpacked if its name ends in .gz or .svgz. Raises FormatError.

    `limit` is the largest that is read (by default MAX_BYTES).
    """
    limit = MAX_BYTES if limit is None else limit
    opener = gzip.open if Path(path).name.lower().endswith((".gz", ".svgz")) else open
    try:
        with opener(path, "rb") as stream:
            data: bytes = stream.read(limit + 1)
    except FileNotFoundError:
        raise FormatError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise FormatError(f"{path}: is a folder; give a strokes file") from None
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise FormatError(f"{path}: is not a whole gzip file ({error})") from None
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror})") from None
    if len(data) > limit:
        raise FormatError(f"{path}: holds more than {limit >> 20} MB; that is no strokes file")
    return data


def decode(data: bytes, where: str = "strokes file") -> StrokePlan:
    """The plan in a strokes file; `where` names it in errors. Raises FormatError with the JSON path of a fault."""
    try:
        _check_head(data)
        with paused_gc():
            return _to_plan(_DECODER.decode(data))
    except (msgspec.DecodeError, FormatError) as error:
        raise FormatError(f"{where}: {error}") from None
    except UnicodeDecodeError:
        raise FormatError(f"{where}: is not UTF-8 (byte {_not_utf8(data)})") from None
    except RecursionError:
        raise FormatError(f"{where}: is nested too deeply") from None


def _check_head(data: bytes) -> None:
    # The head is read by itself only if the whole does not decode as version 1 would: reading it twice costs.
    if data[:40].lstrip().startswith(b'{"format":"strokeplan","version":1,'):
        return
    head = _HEAD_DECODER.decode(data)
    if head.format != FORMAT:
        raise FormatError(f'is not a strokes file: "format" is {head.format!r}, not {FORMAT!r}')
    if head.version > VERSION:
        raise FormatError(f"is of version {head.version}; this strokeplan reads up to version {VERSION}: update it")


def _not_utf8(data: bytes) -> int:
    """Where the first byte stands that UTF-8 cannot have there."""
    try:
        data.decode()
    except UnicodeDecodeError as error:
        return error.start
    return len(data)


def _to_plan(document: PlanFile) -> StrokePlan:
    strokes = list(chain.from_iterable(layer.strokes for layer in document.layers))
    lengths = np.fromiter((len(stroke.d) for stroke in strokes), np.int64, len(strokes))
    _refuse(document, (lengths - 2) % 6 != 0, "d", lambda s: f"has {len(s.d)} numbers; a chain of cubics has 2 + 6k")
    flat = np.fromiter(chain.from_iterable(stroke.d for stroke in strokes), np.float64, int(lengths.sum()))
    ends = np.cumsum([len(layer.strokes) for layer in document.layers], dtype=np.int64)
    source = document.source
    return StrokePlan(
        width=document.canvas.width,
        height=document.canvas.height,
        points=flat.reshape(-1, 2),
        starts=np.concatenate([[0], np.cumsum(lengths // 2)]),
        widths=np.fromiter((stroke.width for stroke in strokes), np.float64, len(strokes)),
        colors=_parse_colors([stroke.color for stroke in strokes]),
        layers=tuple(
            Layer(y.name, int(end) - len(y.strokes), int(end), y.medium, y.cap)
            for y, end in zip(document.layers, ends, strict=True)
        ),
        background=hex_to_rgb(document.canvas.background),
        settings=document.settings,
        source=None if source is None else Source(source.name, source.sha256, source.width, source.height),
        pressures=_column(document, "pressure", [stroke.pressure for stroke in strokes], lengths // 6 + 1),
        angles=_column(document, "angle", [stroke.angle for stroke in strokes], lengths // 6 + 1),
        pens=_pens(strokes),
    )


def _refuse(document: PlanFile, bad: NDArray[np.bool_], key: str, reason: Any) -> None:
    """Raise FormatError for the first stroke that is marked bad, with its JSON path."""
    if not bad.any():
        return
    index = int(np.argmax(bad))
    for number, layer in enumerate(document.layers):
        if index < len(layer.strokes):
            path = f"$.layers[{number}].strokes[{index}].{key}"
            raise FormatError(f"{reason(layer.strokes[index])} - at `{path}`")
        index -= len(layer.strokes)


def _along(
    plan: StrokePlan, column: NDArray[np.float64] | None, strokes: list[StrokeFile]
) -> Iterator[tuple[StrokeFile, list[float]]]:
    """The strokes that have values in a column of on-curve points, with these values."""
    if column is None:
        return
    parts = np.split(column, np.cumsum(plan.knots))  # and nothing after the last stroke
    for stroke, values in zip(strokes, parts, strict=False):
        if not np.isnan(values[0]):
            yield stroke, values.tolist()


def _column(
    document: PlanFile, key: str, given: list[list[float] | UnsetType], knots: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """The values of all strokes at their on-curve points, NaN for a stroke that has none; None if none has."""
    if all(values is UNSET for values in given):
        return None
    lists = [None if isinstance(values, UnsetType) else values for values in given]
    bad = np.array([values is not None and len(values) != n for values, n in zip(lists, knots, strict=True)])
    _refuse(document, bad, key, lambda s: f"has {len(getattr(s, key))} values; one per on-curve point is wanted")
    return np.concatenate(
        [np.full(n, np.nan) if values is None else values for values, n in zip(lists, knots, strict=True)]
    )


def _pens(strokes: list[StrokeFile]) -> tuple[str | None, ...] | None:
    if all(stroke.pen is UNSET for stroke in strokes):
        return None
    return tuple(None if isinstance(stroke.pen, UnsetType) else stroke.pen for stroke in strokes)


def hex_colors(colors: NDArray[np.uint8]) -> list[str]:
    """(n, 3) uint8 → n strings "#rrggbb"."""
    text = np.ascontiguousarray(colors).tobytes().hex()
    return ["#" + text[i : i + 6] for i in range(0, len(text), 6)]


def _parse_colors(colors: list[str]) -> NDArray[np.uint8]:
    packed = bytes.fromhex("".join(color[1:] for color in colors))
    return np.frombuffer(packed, np.uint8).reshape(-1, 3).copy()


_DECODER = msgspec.json.Decoder(PlanFile)
_HEAD_DECODER = msgspec.json.Decoder(_Head)
