"""Photos: any picture file → an upright sRGB array (EXIF orientation, alpha over paper, 16 bit, ICC).

Files are not trusted. Only raster formats that decode in process are opened, and the size in the header
is checked before a pixel is decoded.
"""

from __future__ import annotations

import hashlib
import io
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageCms, ImageOps, UnidentifiedImageError
from PIL.JpegImagePlugin import JpegImageFile
from PIL.TiffImagePlugin import BITSPERSAMPLE, PHOTOMETRIC_INTERPRETATION, PLANAR_CONFIGURATION, TiffImageFile

from strokeplan.errors import ImageError, StrokeplanWarning

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM")
MAX_MEGAPIXELS = 175.0
"""Planning takes some 50 bytes a pixel: 9 GB at this size. Pillow opens no file beyond 179."""
MAX_SIDE = 1_000_000
"""Largest side of a plan's canvas."""
ORIENTATION, SIDEWAYS = 274, (5, 6, 7, 8)
"""EXIF's tag for how a picture is turned, and its values where rows are columns."""
DRAFT_MARGIN = 2
"""A JPEG is decoded at no less than so many times the size that is needed, and resampled from there."""
MIN_SIDE = 2
"""Smallest side, in pixels, on which an orientation can be measured."""
LUMA = (0.2125, 0.7154, 0.0721)
"""Weights of R, G, B in luminance (ITU-R BT.709, as scikit-image's rgb2gray)."""

NEUTRAL_CHROMA = 10.0
"""c0 of `hue`: the chroma C* at which a colour has half its hue. Where a photo is neutral, JPEG's colours stir a*
and b* by 2 to 3 (median of three photos; 5 in the worst tenth), which must not count; things have 20 or more."""
COLOUR_STRIP_ROWS = 128
"""Rows whose colours are converted at once: scikit-image's conversion holds several copies in floating point."""


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """An upright (h, w, 3) uint8 sRGB picture, with the name and SHA-256 of the file it came from."""

    rgb: NDArray[np.uint8]
    name: str = ""
    sha256: str = ""
    size: tuple[int, int] | None = None
    """Width and height of the picture in the file, where it was decoded at another size."""

    @property
    def height(self) -> int:
        """Of the picture in the file: what a plan's canvas has."""
        return self.size[1] if self.size else int(self.rgb.shape[0])

    @property
    def width(self) -> int:
        """Of the picture in the file: what a plan's canvas has."""
        return self.size[0] if self.size else int(self.rgb.shape[1])

    @property
    def decoded(self) -> tuple[int, int]:
        """Width and height of `rgb`."""
        return int(self.rgb.shape[1]), int(self.rgb.shape[0])


Needed = Callable[[int, int], tuple[int, int]]
"""What width and height are needed of a picture of so many pixels."""


def load_photo(
    path: str | os.PathLike[str], *, max_megapixels: float = MAX_MEGAPIXELS, needed: Needed | None = None
) -> Photo:
    """Decode the picture file at `path`.

    Colours are brought to sRGB by the embedded profile; transparency is laid over white paper; 16-bit
    colour is cut to 8 bits with a StrokeplanWarning. A JPEG of which `needed` says that a much smaller
    picture will do is decoded at that size; its `width` and `height` are still the file's. Raises ImageError.
    """
    path = Path(path)
    image, data, size = _decoded_file(path, max_megapixels, needed)
    rgb = np.asarray(_over_paper(image))
    # A name in another encoding than the system's cannot be written to a strokes file.
    name = os.fsencode(path.name).decode(errors="replace")
    return Photo(rgb, name, hashlib.sha256(data).hexdigest(), None if size == image.size else size)


def decode_file(path: Path, max_megapixels: float = MAX_MEGAPIXELS) -> tuple[Image.Image, bytes]:
    """The picture in a file, upright, as RGB or RGBA in sRGB, and the bytes of the file. Raises ImageError."""
    return _decoded_file(path, max_megapixels, None)[:2]


def _decoded_file(
    path: Path, max_megapixels: float, needed: Needed | None
) -> tuple[Image.Image, bytes, tuple[int, int]]:
    """`decode_file`, and the upright size of the picture in the file, of which `needed` may ask less."""
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
        image, size = _decode(data, max_megapixels, needed)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from None
    return image, data, size


def photo_files(paths: Sequence[Path]) -> list[Path]:
    """The files among `paths`, and the pictures (by suffix, sorted) in the folders among them."""
    suffixes = {suffix for suffix, name in Image.registered_extensions().items() if name in FORMATS}
    found: list[Path] = []
    for path in paths:
        try:
            inside = path.iterdir() if path.is_dir() else None
        except OSError as error:
            raise ImageError(f"{path}: cannot be read ({error.strerror})") from None
        found += [path] if inside is None else sorted(p for p in inside if p.suffix.lower() in suffixes)
    if not found:
        raise ImageError(f"{', '.join(map(str, paths))}: no pictures there")
    return found


def as_photo(image: ArrayLike) -> Photo:
    """A photo from an array: (h, w) grey, (h, w, 3) or (h, w, 4); uint8, uint16, or float in 0..1."""
    pixels = np.asarray(image)
    if np.issubdtype(pixels.dtype, np.uint16):
        pixels = _cut_16_bits(pixels)
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


def lab(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 3) uint8 sRGB → (h, w, 3) float32: CIE L*a*b* (D65) over 100, so that L* spans 0..1 as grey does."""
    from skimage.color import rgb2lab

    out = np.empty(rgb.shape, np.float32)
    for top in range(0, len(rgb), COLOUR_STRIP_ROWS):
        strip = slice(top, top + COLOUR_STRIP_ROWS)
        out[strip] = rgb2lab(rgb[strip].astype(np.float32) / 255) / 100
    return out


def hue(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 3) uint8 sRGB → (h, w, 2) float32: the hue vector (a*, b*) / (C* + c0) of CIE L*a*b*.

    Of unit length where there is colour; it fades to 0 where there is none. A vector, because an angle
    would have an edge where red meets itself.
    """
    out = np.empty((*rgb.shape[:2], 2), np.float32)
    for top in range(0, len(rgb), COLOUR_STRIP_ROWS):
        strip = slice(top, top + COLOUR_STRIP_ROWS)
        ab = lab(rgb[strip])[..., 1:]
        out[strip] = ab / (np.hypot(ab[..., :1], ab[..., 1:]) + np.float32(NEUTRAL_CHROMA / 100))
    return out


def _decode(data: bytes, max_megapixels: float, needed: Needed | None) -> tuple[Image.Image, tuple[int, int]]:
    with warnings.catch_warnings():
        # Pillow's own bomb check warns at half of its limit; its other warnings are about metadata.
        warnings.simplefilter("ignore")
        try:
            opened = Image.open(io.BytesIO(data), formats=FORMATS)
        except Image.DecompressionBombError as error:
            raise ImageError(f"has too many pixels, the limit is {max_megapixels:g} megapixels ({error})") from None
        except UnidentifiedImageError:
            raise ImageError(f"is not a picture that can be read; known are {', '.join(FORMATS)}") from None
        except Exception as error:
            # Decoders raise whatever their parser stumbles on.
            raise ImageError(f"is not a picture that can be read ({_first_line(error)})") from None
        _check_size(*opened.size, max_megapixels)
        _check_tiff(opened)
        deep = any(_is_deep(opened.format, tile[3]) for tile in opened.tile)
        try:
            turned = opened.getexif().get(ORIENTATION) in SIDEWAYS
            image: Image.Image = opened
            size = opened.size[::-1] if turned else opened.size
            if needed is not None:
                wanted = needed(*size)
                image = _draft(opened, wanted[::-1] if turned else wanted)
            image = ImageOps.exif_transpose(image)
            image.load()
        except Exception as error:
            raise ImageError(f"is damaged or cut short ({_first_line(error)})") from None
    if deep and image.mode in ("RGB", "RGBA"):
        warnings.warn("16-bit colour is cut to 8 bits a channel", StrokeplanWarning, stacklevel=2)
    return _to_srgb(image), size


def _draft(opened: Image.Image, wanted: tuple[int, int]) -> Image.Image:
    """A JPEG much larger than wanted, decoded at 1/2, 1/4 or 1/8 of its size and reduced from there to what is wanted;
    any other picture as it is."""
    enough = DRAFT_MARGIN * wanted[0], DRAFT_MARGIN * wanted[1]
    if not isinstance(opened, JpegImageFile) or min(opened.width // enough[0], opened.height // enough[1]) < 2:
        return opened
    drafted = opened.draft(None, enough)
    # The last blocks may reach beyond the picture, by parts of a pixel.
    return opened.resize(wanted, Image.Resampling.LANCZOS, drafted[1], reducing_gap=3.0) if drafted else opened


def _check_size(width: int, height: int, max_megapixels: float) -> None:
    if width * height > max_megapixels * 1e6:
        raise ImageError(
            f"{width} × {height} pixels are {width * height / 1e6:.0f} megapixels, the limit is {max_megapixels:g}"
        )
    if max(width, height) > MAX_SIDE:
        raise ImageError(f"{width} × {height} pixels have a side beyond {MAX_SIDE}")
    if min(width, height) < MIN_SIDE:
        raise ImageError(f"{width} × {height} pixels are too few; both sides need at least {MIN_SIDE}")


def _check_tiff(image: Image.Image) -> None:
    """Refuse the kinds of TIFF that Pillow opens and gets wrong."""
    if not isinstance(image, TiffImageFile):
        return
    tags = image.tag_v2
    if image.mode == "I":
        raise ImageError("holds signed or 32-bit pixels; convert it to 8 or 16 bits a channel")
    if max(tags.get(BITSPERSAMPLE, (1,))) > 8:
        if tags.get(PHOTOMETRIC_INTERPRETATION) == 0:
            raise ImageError("holds 16-bit grey whose zero is white; convert it to zero for black, or to 8 bits")
        if tags.get(PLANAR_CONFIGURATION) == 2 and image.tile[0][0] == "raw":
            raise ImageError("holds 16-bit colour in separate planes; convert it to interleaved, or to 8 bits")


def _is_deep(kind: str | None, arguments: Any) -> bool:
    """Whether a decoder with these arguments reads 16 bits a channel: by the raw mode, or the largest value."""
    return ";16" in str(arguments) or (kind == "PPM" and isinstance(arguments, tuple) and arguments[1] > 255)


def _to_srgb(image: Image.Image) -> Image.Image:
    """RGB or RGBA in sRGB, by the embedded profile if it is sound."""
    if image.mode == "F":
        raise ImageError("holds floating-point pixels; convert it to 8 or 16 bits a channel")
    profile = image.info.get("icc_profile")
    if image.mode.startswith("I"):
        image = Image.fromarray(_cut_16_bits(np.clip(np.asarray(image), 0, 65535)))
    transparent = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
    alpha = None
    if transparent:
        whole = image.convert("RGBA")
        alpha = whole.getchannel("A")
        image = image.convert("L") if image.mode in ("L", "LA") else whole.convert("RGB")
    elif image.mode not in ("L", "RGB", "CMYK"):
        try:
            image = image.convert("L" if image.mode == "1" else "RGB")
        except ValueError as error:
            raise ImageError(f"holds {image.mode} pixels, which cannot be converted ({error})") from None
    rgb = (_by_profile(image, profile) if profile else None) or image.convert("RGB")
    if alpha is not None:
        rgb.putalpha(alpha)
    return rgb


def _by_profile(image: Image.Image, profile: bytes) -> Image.Image | None:
    """The L, RGB or CMYK picture in sRGB; None, with a warning, for a profile that is broken or of other channels."""
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        return ImageCms.profileToProfile(image, source, ImageCms.createProfile("sRGB"), outputMode="RGB")
    except (ImageCms.PyCMSError, OSError, ValueError) as error:
        warnings.warn(f"the colour profile is ignored ({_first_line(error)})", StrokeplanWarning, stacklevel=2)
        return None


def _cut_16_bits(values: NDArray[Any]) -> NDArray[np.uint8]:
    """0..65535 → 0..255, rounded."""
    return ((values.astype(np.uint32) * 255 + 32767) // 65535).astype(np.uint8)


def _over_paper(image: Image.Image) -> Image.Image:
    """Lay a transparent picture over white paper."""
    if image.mode != "RGBA":
        return image
    paper = Image.new("RGBA", image.size, (255, 255, 255, 255))
    return Image.alpha_composite(paper, image).convert("RGB")


def _first_line(error: Exception) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0]
