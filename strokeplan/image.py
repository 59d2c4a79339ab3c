"""Photos: any picture file → an upright sRGB array (EXIF orientation, alpha over paper, 16 bit, ICC).

Files are not trusted. Only raster formats that decode in process are opened, and the size in the header
is checked before a pixel is decoded.
"""

from __future__ import annotations

import hashlib
import io
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageCms, ImageOps

from strokeplan.errors import ImageError, StrokeplanWarning

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM")
MAX_MEGAPIXELS = 200.0
"""Planning takes about 40 bytes a pixel: 8 GB at this size."""
MIN_SIDE = 2
"""Smallest side, in pixels, on which an orientation can be measured."""
LUMA = (0.2125, 0.7154, 0.0721)
"""Weights of R, G, B in luminance (ITU-R BT.709, as scikit-image's rgb2gray)."""


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """An upright (h, w, 3) uint8 sRGB picture, with the name and SHA-256 of the file it came from."""

    rgb: NDArray[np.uint8]
    name: str = ""
    sha256: str = ""

    @property
    def height(self) -> int:
        return int(self.rgb.shape[0])

    @property
    def width(self) -> int:
        return int(self.rgb.shape[1])


def load_photo(path: str | os.PathLike[str], *, max_megapixels: float = MAX_MEGAPIXELS) -> Photo:
    """Decode the picture file at `path`.

    Colours are brought to sRGB by the embedded profile; transparency is laid over white paper; 16-bit
    colour is cut to 8 bits with a StrokeplanWarning. Raises ImageError.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ImageError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise ImageError(f"{path}: is a folder; give a picture file") from None
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
    if not data:
        raise ImageError(f"{path}: the file is empty")
    try:
        rgb = _decode(data, max_megapixels)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from None
    return Photo(rgb, path.name, hashlib.sha256(data).hexdigest())


def photo_files(paths: Sequence[Path]) -> list[Path]:
    """The files among `paths`, and the pictures (by suffix, sorted) in the folders among them."""
    suffixes = {suffix for suffix, name in Image.registered_extensions().items() if name in FORMATS}
    found: list[Path] = []
    for path in paths:
        found += sorted(p for p in path.iterdir() if p.suffix.lower() in suffixes) if path.is_dir() else [path]
    if not found:
        raise ImageError(f"{', '.join(map(str, paths))}: no pictures there")
    return found


def as_photo(image: ArrayLike) -> Photo:
    """A photo from an array: (h, w) grey, (h, w, 3) or (h, w, 4); uint8, uint16, or float in 0..1."""
    pixels = np.asarray(image)
    if pixels.dtype == np.uint16:
        pixels = (pixels.astype(np.uint32) * 255 + 32767) // 65535
    elif np.issubdtype(pixels.dtype, np.floating):
        if not np.all((pixels >= 0) & (pixels <= 1)):
            raise ImageError("a float picture must lie in 0..1; divide 8-bit values by 255")
        pixels = np.rint(pixels * 255)
    elif pixels.dtype != np.uint8:
        raise ImageError(f"a picture of {pixels.dtype} is not understood; give uint8, uint16, or float in 0..1")
    pixels = pixels.astype(np.uint8)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=2)
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise ImageError(f"a picture of shape {pixels.shape} is not understood; give (h, w), (h, w, 3) or (h, w, 4)")
    _check_size(pixels.shape[1], pixels.shape[0], MAX_MEGAPIXELS)
    if pixels.shape[2] == 4:
        pixels = np.asarray(_over_paper(Image.fromarray(pixels)))
    return Photo(np.ascontiguousarray(pixels))


def grey(rgb: NDArray[np.uint8], weights: tuple[float, float, float] = LUMA) -> NDArray[np.float32]:
    """(h, w, 3) uint8 → (h, w) float32 in 0..1, the weighted sum of the channels."""
    total = rgb[..., 0] * np.float32(weights[0] / 255)
    total += rgb[..., 1] * np.float32(weights[1] / 255)
    total += rgb[..., 2] * np.float32(weights[2] / 255)
    return total


def _decode(data: bytes, max_megapixels: float) -> NDArray[np.uint8]:
    with warnings.catch_warnings():
        # Pillow's own bomb check is replaced by ours; its other warnings are about metadata.
        warnings.simplefilter("ignore")
        try:
            opened = Image.open(io.BytesIO(data), formats=FORMATS)
        except Image.DecompressionBombError:
            raise ImageError(f"has more pixels than the limit of {max_megapixels:g} megapixels") from None
        except Exception as error:
            # Decoders raise whatever their parser stumbles on.
            known = ", ".join(FORMATS)
            raise ImageError(f"is not a picture that can be read ({_first_line(error)}); known are {known}") from None
        _check_size(*opened.size, max_megapixels)
        deep = any(";16" in str(tile[3]) for tile in opened.tile)
        try:
            image = ImageOps.exif_transpose(opened)
            image.load()
        except Exception as error:
            raise ImageError(f"is damaged or cut short ({_first_line(error)})") from None
    if deep and image.mode in ("RGB", "RGBA"):
        warnings.warn("16-bit colour is cut to 8 bits a channel", StrokeplanWarning, stacklevel=2)
    return np.asarray(_over_paper(_to_srgb(image)))


def _check_size(width: int, height: int, max_megapixels: float) -> None:
    if width * height > max_megapixels * 1e6:
        raise ImageError(
            f"{width} × {height} pixels are {width * height / 1e6:.0f} megapixels, the limit is {max_megapixels:g}"
        )
    if min(width, height) < MIN_SIDE:
        raise ImageError(f"{width} × {height} pixels are too few; both sides need at least {MIN_SIDE}")


def _to_srgb(image: Image.Image) -> Image.Image:
    """RGB or RGBA in sRGB, by the embedded profile if it is sound."""
    if image.mode in ("I;16", "I;16B", "I;16L", "I"):
        values = np.asarray(image).astype(np.int64)
        image = Image.fromarray(((np.clip(values, 0, 65535) * 255 + 32767) // 65535).astype(np.uint8))
    if image.mode == "F":
        raise ImageError("holds floating-point pixels; convert it to 8 or 16 bits a channel")
    transparent = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
    profile = image.info.get("icc_profile")
    if profile and image.mode in ("RGB", "CMYK", "L", "RGBA"):
        try:
            alpha = image.getchannel("A") if image.mode == "RGBA" else None
            bare = image.convert("RGB") if alpha is not None else image
            source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
            converted = ImageCms.profileToProfile(bare, source, ImageCms.createProfile("sRGB"), outputMode="RGB")
            if converted is not None:
                if alpha is not None:
                    converted.putalpha(alpha)
                return converted
        except (ImageCms.PyCMSError, OSError, ValueError) as error:
            message = f"the colour profile is ignored ({_first_line(error)})"
            warnings.warn(message, StrokeplanWarning, stacklevel=2)
    return image.convert("RGBA" if transparent else "RGB")


def _over_paper(image: Image.Image) -> Image.Image:
    """Lay a transparent picture over white paper."""
    if image.mode != "RGBA":
        return image
    paper = Image.new("RGBA", image.size, (255, 255, 255, 255))
    return Image.alpha_composite(paper, image).convert("RGB")


def _first_line(error: Exception) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0]
