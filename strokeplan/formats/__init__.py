"""File formats of a StrokePlan, one module each; the suffix picks it."""

from __future__ import annotations

import gzip
import os
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

from strokeplan.errors import FormatError, OutputError
from strokeplan.files import atomic_write, check_writable
from strokeplan.formats.options import DEFAULTS, ExportOptions
from strokeplan.strokes import StrokePlan


class Writer(NamedTuple):
    """How a format is written, which of the ExportOptions it heeds, and what raises MissingExtraError without it."""

    encode: Callable[[StrokePlan, ExportOptions], bytes]
    options: tuple[str, ...] = ()
    require: Callable[[], object] | None = None


def _json(plan: StrokePlan, _: ExportOptions) -> bytes:
    from strokeplan.formats.json import encode

    return encode(plan)


def _svg(plan: StrokePlan, options: ExportOptions) -> bytes:
    from strokeplan.formats.svg import encode

    return encode(plan, options)


def _picture(suffix: str) -> Writer:
    def encode(plan: StrokePlan, _: ExportOptions) -> bytes:
        from strokeplan.rendering.pictures import encode

        return encode(plan, suffix)

    return Writer(encode, require=_cairo)


def _vector(kind: Literal["pdf", "ps", "eps"]) -> Writer:
    def encode(plan: StrokePlan, options: ExportOptions) -> bytes:
        from strokeplan.rendering.vector import encode_vector

        return encode_vector(plan, kind, options)

    return Writer(encode, ("page", "outline", "clip"), _cairo)


def _dxf(plan: StrokePlan, options: ExportOptions) -> bytes:
    from strokeplan.formats.dxf import encode

    return encode(plan, options)


def _cairo() -> object:
    from strokeplan.rendering import require_cairo

    return require_cairo()


def _ezdxf() -> object:
    from strokeplan.formats.dxf import require_ezdxf

    return require_ezdxf()


def compress(data: bytes) -> bytes:
    """`data` as .svgz and .json.gz hold it."""
    return gzip.compress(data, compresslevel=6, mtime=0)  # no time stamp: the same plan gives the same bytes


def _gzipped(writer: Writer) -> Writer:
    return writer._replace(encode=lambda plan, options: compress(writer.encode(plan, options)))


PICTURES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".webp")
"""Suffixes of pictures; rendering.pictures knows what each holds."""
_SVG = Writer(_svg, ("precision", "units", "page", "group_by", "classes", "outline", "clip"))
WRITERS: dict[str, Writer] = {
    ".json": Writer(_json),
    ".json.gz": _gzipped(Writer(_json)),
    ".svg": _SVG,
    ".svgz": _gzipped(_SVG),
    **{suffix: _picture(suffix) for suffix in PICTURES},
    ".pdf": _vector("pdf"),
    ".eps": _vector("eps"),
    ".ps": _vector("ps"),
    ".dxf": Writer(_dxf, ("page", "group_by", "outline"), _ezdxf),
}
MACHINE_SUFFIXES = (".gcode", ".nc", ".ngc", ".tap", ".hpgl", ".plt", ".ebb")
"""Written by plotter/files.py, with a profile."""
READABLE = (".json", ".json.gz", ".svg", ".svgz")


def is_picture(path: str | os.PathLike[str]) -> bool:
    """Whether the suffix of `path` is a picture's."""
    return Path(path).name.lower().endswith(PICTURES)


def writer(path: str | os.PathLike[str]) -> Writer:
    """The writer for the suffix of `path`. Raises FormatError for one that nobody handles."""
    name = Path(path).name.lower()
    for suffix in sorted(WRITERS, key=len, reverse=True):
        if name.endswith(suffix):
            return WRITERS[suffix]
    if name.endswith(MACHINE_SUFFIXES):
        raise FormatError(f"{path}: is for a machine; say which, e.g. --profile grbl_servo (`strokeplan profiles`)")
    raise FormatError(f"{path}: unknown suffix {Path(path).suffix!r}; known are {', '.join(WRITERS)}")


def prepare(paths: Sequence[str | os.PathLike[str]]) -> None:
    """Import what `save` will need for these paths, so that it need not be waited for then."""
    for path in paths:
        if writer(path).encode in (WRITERS[".svg"].encode, WRITERS[".svgz"].encode):
            import_module("strokeplan.formats.svg")


def check_options(path: str | os.PathLike[str], options: ExportOptions) -> None:
    """Raise FormatError for an option that the format of `path` has no place for."""
    for name in options.asked:
        if name not in writer(path).options:
            takers = [suffix for suffix, known in WRITERS.items() if name in known.options]
            raise FormatError(
                f"{path}: {Path(path).suffix} has no option {name.replace('_', '-')}; it is for {', '.join(takers)}"
            )


def check_target(path: str | os.PathLike[str], *inputs: str | os.PathLike[str]) -> None:
    """Raise now what `save` would raise later: unknown suffix, no Pycairo, no such folder, no permission.

    Also if `path` is one of the files that the work starts from.
    """
    require = writer(path).require
    if require is not None:
        require()
    check_writable(path, *inputs)


def check_canvas(paths: Sequence[str | os.PathLike[str]], width: int, height: int) -> None:
    """Raise InputError if one of `paths` is a picture, and too large for it at the canvas's own size."""
    for path in filter(is_picture, paths):
        from strokeplan.rendering import pictures
        from strokeplan.rendering.view import View, check_sides

        check_sides(width, height)
        pictures.check_picture(path, View(width, height, 0, 0, width, height), channels=3)


def check_picture(path: str | os.PathLike[str], *inputs: str | os.PathLike[str]) -> None:
    """`check_target` for a command that makes pictures only."""
    if not is_picture(path):
        known = ", ".join(PICTURES)
        raise FormatError(f"{path}: unknown suffix {Path(path).suffix!r} for a picture; known are {known}")
    check_target(path, *inputs)


def check_folder(path: str | os.PathLike[str]) -> None:
    """Raise OutputError if `path` is not a folder to write into and cannot become one."""
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path}: is a file; give a folder")
    check_writable(path / "figure" if path.is_dir() else path)


def write(path: str | os.PathLike[str], data: bytes) -> None:
    """Write bytes to `path`, whole or not at all. Raises OutputError."""
    with atomic_write(path) as stream:
        stream.write(data)


def save(plan: StrokePlan, path: str | os.PathLike[str], options: ExportOptions = DEFAULTS) -> None:
    """Write `plan` to `path`, whole or not at all. Raises FormatError, InputError, OutputError, MissingExtraError."""
    save_all(plan, [path], options)


def save_all(plan: StrokePlan, paths: Sequence[str | os.PathLike[str]], options: ExportOptions = DEFAULTS) -> None:
    """Save `plan` to every path; nothing is written before all are encoded."""
    for path in paths:
        check_options(path, options)
    encoded = [writer(path).encode(plan, options) for path in paths]
    for path, data in zip(paths, encoded, strict=True):
        write(path, data)


def load(path: str | os.PathLike[str]) -> StrokePlan:
    """Read a strokes file (.json, .json.gz) or an SVG (.svg, .svgz), ours or another's (docs/reading-svg.md).

    Raises FormatError, which names the place of a fault. What of an SVG is no stroke is told in a StrokeplanWarning.
    """
    from strokeplan.formats import json, svg_reader

    name = Path(path).name.lower()
    if not name.endswith(READABLE):
        raise FormatError(f"{path}: not a strokes file by its suffix; readable are {', '.join(READABLE)}")
    if name.endswith((".svg", ".svgz")):
        return svg_reader.read(path)
    return json.decode(json.read(path), str(path))


def read_settings(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What reproduces the plan in a strokes file or an SVG of ours, without its strokes. Raises FormatError."""
    if Path(path).name.lower().endswith((".svg", ".svgz")):
        from strokeplan.formats.svg import read_settings as read_svg

        return read_svg(path)
    return load(path).settings
