"""File formats of a StrokePlan, one module each; the suffix picks it."""

from __future__ import annotations

import gzip
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from strokeplan.errors import FormatError, OutputError
from strokeplan.files import atomic_write, check_writable
from strokeplan.strokes import StrokePlan

Encoder = Callable[[StrokePlan], bytes]


def _json(plan: StrokePlan) -> bytes:
    from strokeplan.formats.json import encode

    return encode(plan)


def _svg(plan: StrokePlan) -> bytes:
    from strokeplan.formats.svg import encode

    return encode(plan)


def _picture(suffix: str) -> Encoder:
    def encode(plan: StrokePlan) -> bytes:
        from strokeplan.rendering.pictures import encode

        return encode(plan, suffix)

    return encode


def compress(data: bytes) -> bytes:
    """`data` as .svgz and .json.gz hold it."""
    return gzip.compress(data, compresslevel=6, mtime=0)  # no time stamp: the same plan gives the same bytes


def _gzipped(encode: Encoder) -> Encoder:
    return lambda plan: compress(encode(plan))


PICTURES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".webp")
"""Suffixes of pictures; rendering.pictures knows what each holds."""
WRITERS: dict[str, Encoder] = {
    ".json": _json,
    ".json.gz": _gzipped(_json),
    ".svg": _svg,
    ".svgz": _gzipped(_svg),
    **{suffix: _picture(suffix) for suffix in PICTURES},
}
READABLE = (".json", ".json.gz")


def is_picture(path: str | os.PathLike[str]) -> bool:
    """Whether the suffix of `path` is a picture's."""
    return Path(path).name.lower().endswith(PICTURES)


def writer(path: str | os.PathLike[str]) -> Encoder:
    """The encoder for the suffix of `path`. Raises FormatError for one that nobody handles."""
    name = Path(path).name.lower()
    for suffix in sorted(WRITERS, key=len, reverse=True):
        if name.endswith(suffix):
            return WRITERS[suffix]
    raise FormatError(f"{path}: unknown suffix {Path(path).suffix!r}; known are {', '.join(WRITERS)}")


def check_target(path: str | os.PathLike[str], *inputs: str | os.PathLike[str]) -> None:
    """Raise now what `save` would raise later: unknown suffix, no Pycairo, no such folder, no permission.

    Also if `path` is one of the files that the work starts from.
    """
    writer(path)
    if is_picture(path):
        from strokeplan.rendering import require_cairo

        require_cairo()
    check_writable(path)
    for source in inputs:
        with suppress(OSError):  # one of them does not exist
            if Path(path).samefile(source):
                raise OutputError(f"{path}: is what the work starts from; give another name")


def check_canvas(paths: Sequence[str | os.PathLike[str]], width: int, height: int) -> None:
    """Raise InputError if one of `paths` is a picture, and too large for it at the canvas's own size."""
    for path in filter(is_picture, paths):
        from strokeplan.rendering import pictures
        from strokeplan.rendering.view import View, check_sides

        check_sides(width, height)
        pictures.check_picture(path, View(width, height, 0, 0, width, height), channels=3)


def check_picture(path: str | os.PathLike[str], *inputs: str | os.PathLike[str]) -> None:
    """`check_target` for a command that makes pictures only."""
    if Path(path).suffix.lower() != ".png":
        raise FormatError(f"{path}: unknown suffix {Path(path).suffix!r} for a picture; known is .png")
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


def save(plan: StrokePlan, path: str | os.PathLike[str]) -> None:
    """Write `plan` to `path`, whole or not at all. Raises FormatError, OutputError, MissingExtraError."""
    write(path, writer(path)(plan))


def save_all(plan: StrokePlan, paths: Sequence[str | os.PathLike[str]]) -> None:
    """Save `plan` to every path; nothing is written before all are encoded."""
    encoded = [writer(path)(plan) for path in paths]
    for path, data in zip(paths, encoded, strict=True):
        write(path, data)


def load(path: str | os.PathLike[str]) -> StrokePlan:
    """Read a strokes file (.json, .json.gz). Raises FormatError, which names the place of a fault."""
    from strokeplan.formats.json import decode, read

    name = Path(path).name.lower()
    if not name.endswith(READABLE):
        raise FormatError(f"{path}: not a strokes file by its suffix; readable are {', '.join(READABLE)}")
    return decode(read(path), str(path))
