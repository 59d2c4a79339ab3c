"""Picture files: one table of what each suffix can hold, and how it is written.

All carry an sRGB tag, the resolution if there is one, the plan's title and strokeplan's version. A TIFF is
written as it is painted, a few rows at a time, and becomes a BigTIFF where it has to; the others are held in
memory whole. The same picture gives the same bytes: no file has a date in it.
"""

from __future__ import annotations

import io
import os
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import FormatError, InputError
from strokeplan.rendering.raster import Job, Progress, check_memory, job, processors
from strokeplan.rendering.view import MAX_SIDE, View, view
from strokeplan.strokes import StrokePlan
from strokeplan.version import __version__

STRIP_ROWS = 16
"""Rows of a TIFF's strip: readers take one at a time."""
DEFLATE_LEVEL = 6
JPEG_QUALITY, WEBP_QUALITY = 92, 90
BIG_TIFF_BYTES = 2**32 - 2**25
"""Pixels beyond this leave no room for the rest of a TIFF of 32-bit offsets."""
SOFTWARE = f"strokeplan {__version__}"
EXIF_DESCRIPTION, EXIF_X_DPI, EXIF_Y_DPI, EXIF_UNIT, EXIF_SOFTWARE = 270, 282, 283, 296, 305
INCH = 2


@dataclass(frozen=True, slots=True)
class Tags:
    """What a file says about its picture: its title, and pixels per inch if it has a size on paper."""

    title: str = ""
    dpi: float | None = None


class Painting(Protocol):
    """A picture that is there, or is painted when a file asks for it: a raster.Job, or pixels that are done."""

    @property
    def view(self) -> View: ...

    @property
    def channels(self) -> int: ...

    def picture(self, threads: int | None = None, progress: Progress | None = None) -> NDArray[np.uint8]:
        """All of it."""

    def bands(self, threads: int | None = None) -> Iterator[NDArray[np.uint8]]:
        """Its rows, some at a time from the top."""


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """A (h, w, 3) or (h, w, 4) uint8 picture that is there."""

    pixels: NDArray[np.uint8]

    @property
    def view(self) -> View:
        rows, columns = self.pixels.shape[:2]
        return View(columns, rows, 0, 0, columns, rows)

    @property
    def channels(self) -> int:
        return int(self.pixels.shape[2])

    def picture(self, threads: int | None = None, progress: Progress | None = None) -> NDArray[np.uint8]:
        return self.pixels

    def bands(self, threads: int | None = None) -> Iterator[NDArray[np.uint8]]:
        yield self.pixels


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """What a kind of picture file can hold."""

    name: str
    alpha: bool
    max_side: int
    write: Callable[[IO[bytes], Painting, Tags, int | None, Progress | None], None]


def picture_format(path: str | os.PathLike[str]) -> PictureFormat:
    """The format that the suffix of a path means. Raises FormatError for one that is no picture's."""
    for suffix, kind in FORMATS.items():
        if Path(path).name.lower().endswith(suffix):
            return kind
    raise FormatError(f"{path}: unknown suffix {Path(path).suffix!r} for a picture; known are {', '.join(FORMATS)}")


def check_picture(path: str | os.PathLike[str], shown: View, channels: int) -> None:
    """Raise InputError for a picture that a file of this suffix, or memory, cannot hold."""
    kind = picture_format(path)
    if max(shown.width, shown.height) > kind.max_side:
        raise InputError(
            f"{path}: a {kind.name} may have {kind.max_side} pixels a side, not {shown.width} × {shown.height}; "
            "write a .tif"
        )
    if channels == 4 and not kind.alpha:
        raise InputError(f"{path}: a {kind.name} cannot be transparent; write .png, .tif or .webp")
    if kind.write is not _write_tiff:
        check_memory(shown, channels)


def write_picture(
    stream: IO[bytes],
    path: str | os.PathLike[str],
    work: Job,
    *,
    dpi: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Paint a picture into a stream, in the format of `path`'s suffix."""
    check_picture(path, work.view, work.channels)
    picture_format(path).write(stream, work, Tags(_title(work), dpi), threads, progress)


def encode(plan: StrokePlan, path: str | os.PathLike[str]) -> bytes:
    """The file of a plan's picture at its own size, in the format of `path`'s suffix."""
    stream = io.BytesIO()
    write_picture(stream, path, job(plan, view(plan)))
    return stream.getvalue()


def encode_picture(picture: NDArray[np.uint8], path: str | os.PathLike[str]) -> bytes:
    """The file of a (h, w, 3) or (h, w, 4) uint8 picture, in the format of `path`'s suffix.

    Raises FormatError for another suffix, InputError for a picture that the format cannot hold.
    """
    done, stream = Done(picture), io.BytesIO()
    check_picture(path, done.view, done.channels)
    picture_format(path).write(stream, done, Tags(), None, None)
    return stream.getvalue()


def encode_png(picture: NDArray[np.uint8]) -> bytes:
    """A (h, w, 3) or (h, w, 4) uint8 picture as a PNG file."""
    return encode_picture(picture, ".png")


def _title(work: Job) -> str:
    title = work.plan.settings.get("title")
    return title if isinstance(title, str) else work.plan.source.name if work.plan.source else ""


def _write_png(stream: IO[bytes], work: Painting, tags: Tags, threads: int | None, progress: Progress | None) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    info.add(b"sRGB", b"\0")
    for keyword, text in (("Title", tags.title), ("Software", SOFTWARE)):
        if text:
            info.add_itxt(keyword, text)
    more = {} if tags.dpi is None else {"dpi": (tags.dpi, tags.dpi)}
    Image.fromarray(work.picture(threads, progress)).save(stream, "PNG", compress_level=6, pnginfo=info, **more)


def _write_jpeg(stream: IO[bytes], work: Painting, tags: Tags, threads: int | None, progress: Progress | None) -> None:
    from PIL import Image

    more: dict[str, Any] = {} if tags.dpi is None else {"dpi": (round(tags.dpi), round(tags.dpi))}
    Image.fromarray(work.picture(threads, progress)).save(
        stream, "JPEG", quality=JPEG_QUALITY, subsampling=0, icc_profile=srgb_profile(), exif=_exif(tags), **more
    )


def _write_webp(stream: IO[bytes], work: Painting, tags: Tags, threads: int | None, progress: Progress | None) -> None:
    from PIL import Image

    Image.fromarray(work.picture(threads, progress)).save(
        stream, "WEBP", quality=WEBP_QUALITY, method=4, icc_profile=srgb_profile(), exif=_exif(tags)
    )


def _exif(tags: Tags) -> Any:
    from PIL import Image

    exif = Image.Exif()
    exif[EXIF_SOFTWARE] = SOFTWARE
    if tags.title:
        exif[EXIF_DESCRIPTION] = tags.title.encode()  # or all but ASCII becomes ?
    if tags.dpi is not None:
        exif[EXIF_X_DPI] = exif[EXIF_Y_DPI] = tags.dpi
        exif[EXIF_UNIT] = INCH
    return exif


def _write_tiff(stream: IO[bytes], work: Painting, tags: Tags, threads: int | None, progress: Progress | None) -> None:
    import tifffile

    shape = work.view.height, work.view.width, work.channels
    size = shape[0] * shape[1] * shape[2]
    more: dict[str, Any] = {} if tags.dpi is None else {"resolution": (tags.dpi, tags.dpi), "resolutionunit": "INCH"}
    strips = _strips(_watched(work.bands(threads), work.view.height, progress))
    with tifffile.TiffWriter(stream, bigtiff=size > BIG_TIFF_BYTES) as writer:
        writer.write(
            _deflated(strips, threads or processors()), shape=shape, dtype=np.uint8, photometric="rgb",
            planarconfig="contig", extrasamples=["unassalpha"] if work.channels == 4 else None,
            rowsperstrip=STRIP_ROWS, compression="adobe_deflate", predictor=True, iccprofile=srgb_profile(),
            software=SOFTWARE, description=tags.title.encode(), metadata=None, **more,
        )  # fmt: skip


def _watched(bands: Iterable[NDArray[np.uint8]], rows: int, progress: Progress | None) -> Iterator[NDArray[np.uint8]]:
    done = 0
    for band in bands:
        yield band
        done += len(band)
        if progress is not None:
            progress(done, rows)


def _strips(bands: Iterable[NDArray[np.uint8]]) -> Iterator[NDArray[np.uint8]]:
    """The rows of the bands, STRIP_ROWS at a time; the last strip may have fewer."""
    rest: NDArray[np.uint8] | None = None
    for band in bands:
        rows = band if rest is None else np.concatenate([rest, band])
        whole = len(rows) // STRIP_ROWS * STRIP_ROWS
        for top in range(0, whole, STRIP_ROWS):
            yield rows[top : top + STRIP_ROWS]
        rest = rows[whole:].copy()
    if rest is not None and len(rest):
        yield rest


def _deflated(strips: Iterable[NDArray[np.uint8]], threads: int) -> Iterator[bytes]:
    """Strips as a TIFF holds them, packed by threads while the next are painted."""
    pending: deque[Future[bytes]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for strip in strips:
                pending.append(pool.submit(_deflate, strip))
                if len(pending) > 2 * threads:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()


def _deflate(strip: NDArray[np.uint8]) -> bytes:
    """Differences of neighbours in a row (TIFF's predictor 2), which pack better than colours, in zlib's format."""
    differences = strip.copy()
    differences[:, 1:] -= strip[:, :-1]
    return zlib.compress(differences.data, DEFLATE_LEVEL)


@cache
def srgb_profile() -> bytes:
    """An ICC profile of sRGB; without the date of today that Little CMS puts into it."""
    from PIL import ImageCms

    data = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    data[24:36] = np.array([2000, 1, 1, 0, 0, 0], ">u2").tobytes()
    return bytes(data)


FORMATS: dict[str, PictureFormat] = {
    ".png": PictureFormat("PNG", alpha=True, max_side=MAX_SIDE, write=_write_png),
    ".tif": PictureFormat("TIFF", alpha=True, max_side=MAX_SIDE, write=_write_tiff),
    ".tiff": PictureFormat("TIFF", alpha=True, max_side=MAX_SIDE, write=_write_tiff),
    ".jpg": PictureFormat("JPEG", alpha=False, max_side=65_500, write=_write_jpeg),
    ".jpeg": PictureFormat("JPEG", alpha=False, max_side=65_500, write=_write_jpeg),
    ".webp": PictureFormat("WebP", alpha=True, max_side=16_383, write=_write_webp),
}
