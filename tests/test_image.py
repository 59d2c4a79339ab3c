"""Photos: every kind of file against the array it was made from, and what is refused."""

from __future__ import annotations

import hashlib
import io
import re
import resource
import struct
import subprocess
import sys
import warnings
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageFile
from skimage.color import rgb2lab

from strokeplan import image
from strokeplan.errors import ImageError, StrokeplanWarning
from strokeplan.image import LUMA, MAX_MEGAPIXELS, as_photo, grey, load_photo, photo_files

Pixels = NDArray[np.uint8]
GREY, RGB, PALETTE, GREY_ALPHA, RGBA = 0, 2, 3, 4, 6
"""Colour types of PNG."""
CUT = "16-bit colour is cut to 8 bits"


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(
    pixels: NDArray[Any], colour_type: int, extra: Iterable[bytes] = (), size: tuple[int, int] | None = None
) -> bytes:
    """A PNG by its specification: rows without filter; `extra` chunks; a header that may claim another size."""
    height, width = pixels.shape[:2]
    depth = 8 * pixels.dtype.itemsize
    rows = b"".join(b"\0" + row.astype(f">u{pixels.dtype.itemsize}").tobytes() for row in pixels)
    header = struct.pack(">IIBBBBB", *(size or (width, height)), depth, colour_type, 0, 0, 0)
    chunks = [chunk(b"IHDR", header), *extra, chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def random_pixels(*shape: int, dtype: type[np.unsignedinteger[Any]] = np.uint8) -> NDArray[Any]:
    return np.random.default_rng(1).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def over_white(colour: NDArray[Any], alpha: NDArray[Any], largest: int = 255) -> NDArray[np.float64]:
    """What the definition of "over" gives on white paper."""
    opacity = alpha.astype(float) / largest
    return np.asarray(colour * opacity + largest * (1 - opacity)) * 255 / largest


def encoded(pixels: Pixels, kind: str, mode: str | None = None, **options: Any) -> bytes:
    stream = io.BytesIO()
    image = Image.fromarray(pixels)
    (image.convert(mode) if mode else image).save(stream, kind, **options)
    return stream.getvalue()


Load = Callable[[bytes], Pixels]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Write the bytes to a file and load it as a photo."""

    def load_bytes(data: bytes) -> Pixels:
        path = tmp_path / "photo.bin"
        path.write_bytes(data)
        return load_photo(path).rgb

    return load_bytes


def refuse(load: Load, data: bytes, *words: str) -> None:
    """Loading ends in an ImageError of one line that names the file and has `words` in it."""
    with pytest.raises(ImageError, match=r"^\S*photo\.bin: [^\n]+$") as raised:
        load(data)
    for word in words:
        assert word in str(raised.value)


# Plain pictures


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "BMP", "PPM"])
def test_lossless_files_keep_every_pixel(load: Load, kind: str) -> None:
    pixels = random_pixels(7, 5, 3)
    np.testing.assert_array_equal(load(encoded(pixels, kind)), pixels)


def test_lossless_webp_keeps_every_pixel(load: Load) -> None:
    pixels = random_pixels(7, 5, 3)
    np.testing.assert_array_equal(load(encoded(pixels, "WEBP", lossless=True)), pixels)


def test_png_by_its_specification(load: Load) -> None:
    pixels = random_pixels(7, 5, 3)
    np.testing.assert_array_equal(load(png(pixels, RGB)), pixels)


def test_ppm_by_its_specification(load: Load) -> None:
    pixels = random_pixels(7, 5, 3)
    np.testing.assert_array_equal(load(b"P6\n5 7\n255\n" + pixels.tobytes()), pixels)


@pytest.mark.parametrize("kind", ["JPEG", "WEBP"])
def test_lossy_files_stay_close(load: Load, small_picture: Pixels, kind: str) -> None:
    options = {"subsampling": 0} if kind == "JPEG" else {}
    loaded = load(encoded(small_picture, kind, quality=95, **options)).astype(float)
    assert np.sqrt(np.mean((loaded - small_picture) ** 2)) < 4


def test_gif_keeps_the_colours_of_its_palette(load: Load) -> None:
    pixels = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 0], [9, 99, 199]], np.uint8)[random_pixels(6, 5) % 4]
    image = Image.fromarray(pixels).quantize(4)
    stream = io.BytesIO()
    image.save(stream, "GIF")
    np.testing.assert_array_equal(load(stream.getvalue()), pixels)


def test_an_animation_is_its_first_frame(load: Load) -> None:
    first, second = np.full((4, 4, 3), 255, np.uint8), np.zeros((4, 4, 3), np.uint8)
    data = encoded(first, "GIF", save_all=True, append_images=[Image.fromarray(second)])
    np.testing.assert_array_equal(load(data), first)


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "BMP", "PPM", "GIF"])
def test_grey_becomes_three_equal_channels(load: Load, kind: str) -> None:
    pixels = random_pixels(7, 5)
    np.testing.assert_array_equal(load(encoded(pixels, kind)), np.stack([pixels] * 3, axis=-1))


def test_black_and_white(load: Load) -> None:
    pixels = (random_pixels(7, 5) // 128 * 255).astype(np.uint8)
    np.testing.assert_array_equal(load(encoded(pixels, "PNG", mode="1")), np.stack([pixels] * 3, axis=-1))


def test_grey_jpeg(load: Load, small_picture: Pixels) -> None:
    pixels = small_picture[..., 0]
    loaded = load(encoded(pixels, "JPEG", quality=95)).astype(int)
    assert np.abs(loaded - pixels[..., None]).max() < 12


def test_cmyk_jpeg_has_the_right_polarity(load: Load) -> None:
    """Photoshop stores CMYK inverted and says so in an Adobe marker; ink is R = 255 − C − K without a profile."""
    cmyk = np.zeros((16, 32, 4), np.uint8)
    cmyk[:, :16] = (255, 55, 0, 0)
    cmyk[:, 16:] = (0, 0, 0, 205)
    stream = io.BytesIO()
    Image.frombytes("CMYK", (32, 16), cmyk.tobytes()).save(stream, "JPEG", quality=100)
    loaded = load(stream.getvalue()).astype(int)
    assert np.abs(loaded[4, 4] - (0, 200, 255)).max() <= 3
    assert np.abs(loaded[4, 24] - (50, 50, 50)).max() <= 3


def test_palette(load: Load) -> None:
    palette = random_pixels(4, 3)
    indices = random_pixels(6, 5) % 4
    data = png(indices, PALETTE, [chunk(b"PLTE", palette.tobytes())])
    np.testing.assert_array_equal(load(data), palette[indices])


# Transparency


def test_transparent_palette_lies_over_white(load: Load) -> None:
    palette, alpha = random_pixels(4, 3), np.array([0, 255, 100, 255], np.uint8)
    indices = random_pixels(6, 5) % 4
    data = png(indices, PALETTE, [chunk(b"PLTE", palette.tobytes()), chunk(b"tRNS", alpha.tobytes())])
    np.testing.assert_allclose(load(data), over_white(palette[indices], alpha[indices][..., None]), atol=1)


def test_rgba_lies_over_white(load: Load) -> None:
    pixels = random_pixels(9, 8, 4)
    pixels[0, :2, 3] = 0, 255
    loaded = load(png(pixels, RGBA))
    np.testing.assert_allclose(loaded, over_white(pixels[..., :3], pixels[..., 3:]), atol=1)
    np.testing.assert_array_equal(loaded[0, 0], (255, 255, 255))
    np.testing.assert_array_equal(loaded[0, 1], pixels[0, 1, :3])


def test_grey_with_alpha_lies_over_white(load: Load) -> None:
    pixels = random_pixels(9, 8, 2)
    expected = np.repeat(over_white(pixels[..., :1], pixels[..., 1:]), 3, axis=2)
    np.testing.assert_allclose(load(png(pixels, GREY_ALPHA)), expected, atol=1)


def test_a_transparent_colour_becomes_white(load: Load) -> None:
    pixels = np.array([[[1, 2, 3], [4, 5, 6]], [[1, 2, 4], [7, 8, 9]]], np.uint8)
    expected = pixels.copy()
    expected[0, 0] = 255
    np.testing.assert_array_equal(load(png(pixels, RGB, [chunk(b"tRNS", struct.pack(">3H", 1, 2, 3))])), expected)


def test_a_transparent_grey_becomes_white(load: Load) -> None:
    pixels = np.array([[1, 2], [3, 4]], np.uint8)
    loaded = load(png(pixels, GREY, [chunk(b"tRNS", struct.pack(">H", 2))]))
    np.testing.assert_array_equal(loaded[..., 0], [[1, 255], [3, 4]])


# 16 bits

DEEP = np.array([[0, 128, 129, 257], [1000, 32767, 32768, 40000], [65278, 65279, 65534, 65535]], np.uint16)
"""Grey values around the steps of 8 bits."""


def test_grey_of_16_bits_is_scaled_and_rounded(load: Load) -> None:
    loaded = load(png(DEEP, GREY))
    np.testing.assert_array_equal(loaded, np.stack([np.rint(DEEP / 257)] * 3, axis=-1))


def test_grey_pgm_of_16_bits_is_scaled_and_rounded(load: Load) -> None:
    loaded = load(b"P5\n4 3\n65535\n" + DEEP.astype(">u2").tobytes())
    np.testing.assert_array_equal(loaded[..., 0], np.rint(DEEP / 257))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_grey_tiff_of_16_bits_is_scaled_and_rounded(load: Load, order: Any, compression: str | None) -> None:
    stream = io.BytesIO()
    tifffile.imwrite(stream, DEEP, photometric="minisblack", byteorder=order, compression=compression)
    np.testing.assert_array_equal(load(stream.getvalue())[..., 0], np.rint(DEEP / 257))


def test_rgb_png_of_16_bits_is_cut_with_a_warning(load: Load) -> None:
    pixels = random_pixels(6, 5, 3, dtype=np.uint16)
    with pytest.warns(StrokeplanWarning, match=CUT):
        loaded = load(png(pixels, RGB))
    np.testing.assert_allclose(loaded, pixels / 257, atol=1)


def test_rgba_png_of_16_bits_is_cut_with_a_warning(load: Load) -> None:
    pixels = random_pixels(6, 5, 4, dtype=np.uint16)
    with pytest.warns(StrokeplanWarning, match=CUT):
        loaded = load(png(pixels, RGBA))
    np.testing.assert_allclose(loaded, over_white(pixels[..., :3], pixels[..., 3:], 65535), atol=2)


def test_grey_alpha_png_of_16_bits_is_cut_with_a_warning(load: Load) -> None:
    pixels = random_pixels(6, 5, 2, dtype=np.uint16)
    with pytest.warns(StrokeplanWarning, match=CUT):
        loaded = load(png(pixels, GREY_ALPHA))
    np.testing.assert_allclose(loaded[..., 0], over_white(pixels[..., 0], pixels[..., 1], 65535), atol=2)


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}, {"byteorder": ">"}, {"tile": (16, 16)}], ids=str)
def test_rgb_tiff_of_16_bits_is_cut_with_a_warning(load: Load, options: dict[str, Any]) -> None:
    pixels = random_pixels(6, 5, 3, dtype=np.uint16)
    stream = io.BytesIO()
    tifffile.imwrite(stream, pixels, photometric="rgb", **options)
    with pytest.warns(StrokeplanWarning, match=CUT):
        loaded = load(stream.getvalue())
    np.testing.assert_allclose(loaded, pixels / 257, atol=1)


def test_rgb_ppm_of_16_bits_is_cut_with_a_warning(load: Load) -> None:
    pixels = random_pixels(7, 5, 3, dtype=np.uint16)
    with pytest.warns(StrokeplanWarning, match=CUT):
        loaded = load(b"P6\n5 7\n65535\n" + pixels.astype(">u2").tobytes())
    np.testing.assert_allclose(loaded, pixels / 257, atol=1)


def tiff(pixels: NDArray[Any], **options: Any) -> bytes:
    stream = io.BytesIO()
    tifffile.imwrite(stream, pixels, **options)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (tiff(DEEP.astype(np.uint32) * 65537, photometric="minisblack"), "32-bit"),
        (tiff(DEEP.astype(np.int16), photometric="minisblack"), "signed"),
        (tiff((DEEP / 65535).astype(np.float32), photometric="minisblack"), "floating-point"),
        (tiff(DEEP, photometric="miniswhite"), "zero is white"),
        (tiff(np.stack([DEEP] * 3), photometric="rgb", planarconfig="separate"), "planes"),
    ],
    ids=["32 bits", "signed", "float", "white is zero", "planes"],
)
def test_tiffs_that_pillow_would_misread_are_refused(load: Load, data: bytes, word: str) -> None:
    refuse(load, data, word)


def test_planes_of_8_bits_are_read(load: Load) -> None:
    pixels = random_pixels(6, 5, 3)
    data = tiff(np.moveaxis(pixels, -1, 0), photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(load(data), pixels)


# Orientation: what is stored for an upright array, by the table of the EXIF specification (row 0 is the
# visual … side, column 0 the visual … side).
STORED: dict[int, Callable[[Pixels], Pixels]] = {
    1: lambda upright: upright,  # top, left
    2: lambda upright: upright[:, ::-1],  # top, right
    3: lambda upright: upright[::-1, ::-1],  # bottom, right
    4: lambda upright: upright[::-1],  # bottom, left
    5: lambda upright: upright.transpose(1, 0, 2),  # left, top
    6: lambda upright: upright[:, ::-1].transpose(1, 0, 2),  # right, top
    7: lambda upright: upright[::-1, ::-1].transpose(1, 0, 2),  # right, bottom
    8: lambda upright: upright[::-1].transpose(1, 0, 2),  # left, bottom
}


def exif(orientation: int) -> bytes:
    data = Image.Exif()
    data[0x0112] = orientation
    return data.tobytes()


@pytest.mark.parametrize("orientation", STORED)
def test_exif_turns_a_jpeg_upright(load: Load, small_picture: Pixels, orientation: int) -> None:
    stored = np.ascontiguousarray(STORED[orientation](small_picture))
    loaded = load(encoded(stored, "JPEG", quality=95, subsampling=0, exif=exif(orientation)))
    assert loaded.shape == small_picture.shape
    assert np.abs(loaded.astype(int) - small_picture).mean() < 3


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
@pytest.mark.parametrize("orientation", STORED)
def test_exif_turns_lossless_files_upright(load: Load, orientation: int, kind: str) -> None:
    upright = random_pixels(4, 7, 3)
    stored = np.ascontiguousarray(STORED[orientation](upright))
    np.testing.assert_array_equal(load(encoded(stored, kind, exif=exif(orientation))), upright)


@pytest.mark.parametrize(
    "block", [b"Exif\0\0garbage garbage", b"Exif\0\0II*\0\xff\xff\xff\xff", b"Exif\0\0II*\0\x08\0\0\0\xff\xff"]
)
def test_a_broken_exif_block_does_not_cost_the_photo(load: Load, small_picture: Pixels, block: bytes) -> None:
    assert load(encoded(small_picture, "JPEG", exif=block)).shape == small_picture.shape


# Colour profiles


def swapped_profile() -> bytes:
    """sRGB with the primaries of red and blue exchanged: in it, the channels stand in the order B, G, R."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    count = struct.unpack(">I", profile[128:132])[0]
    table, rest = profile[132 : 132 + 12 * count], profile[132 + 12 * count :]
    other = {b"rXYZ": b"bXYZ", b"bXYZ": b"rXYZ", b"rTRC": b"bTRC", b"bTRC": b"rTRC"}
    entries = [table[k : k + 12] for k in range(0, len(table), 12)]
    return profile[:132] + b"".join(other.get(entry[:4], entry[:4]) + entry[4:] for entry in entries) + rest


def linear_grey_profile() -> bytes:
    """A profile of one channel that is proportional to light, by the ICC specification (version 2)."""
    tags = {
        b"desc": b"desc" + bytes(4) + struct.pack(">I", 5) + b"grey\0" + bytes(78),
        b"wtpt": b"XYZ " + bytes(4) + struct.pack(">3i", 63190, 65536, 54061),
        b"kTRC": b"curv" + bytes(4) + struct.pack(">I", 0),
    }
    table, body, start = b"", b"", 132 + 12 * len(tags)
    for name, data in tags.items():
        table += name + struct.pack(">II", start + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = bytes(4) + struct.pack(">I", 0x02100000) + b"mntrGRAYXYZ " + bytes(12) + b"acsp" + bytes(28)
    head += struct.pack(">3i", 63190, 65536, 54061) + bytes(48)
    return struct.pack(">I", 4 + len(head) + 4 + len(table) + len(body)) + head + struct.pack(">I", 3) + table + body


def srgb_curve(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """IEC 61966-2-1, 0..1 → 0..255."""
    return np.asarray(255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055))


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_colours_are_brought_to_srgb_by_the_profile(load: Load, kind: str) -> None:
    pixels = random_pixels(9, 8, 3)
    loaded = load(encoded(pixels, kind, icc_profile=swapped_profile()))
    np.testing.assert_allclose(loaded, pixels[..., ::-1], atol=1)


def test_colours_of_a_jpeg_are_brought_to_srgb_by_the_profile(load: Load, small_picture: Pixels) -> None:
    loaded = load(encoded(small_picture, "JPEG", quality=95, subsampling=0, icc_profile=swapped_profile()))
    assert np.abs(loaded.astype(int) - small_picture[..., ::-1]).mean() < 3


def test_a_profile_holds_under_transparency(load: Load) -> None:
    pixels = random_pixels(9, 8, 4)
    loaded = load(encoded(pixels, "PNG", icc_profile=swapped_profile()))
    np.testing.assert_allclose(loaded, over_white(pixels[..., 2::-1], pixels[..., 3:]), atol=2)


def test_a_profile_holds_for_a_palette(load: Load) -> None:
    palette, indices = random_pixels(4, 3), random_pixels(6, 5) % 4
    profile = chunk(b"iCCP", b"swapped\0\0" + zlib.compress(swapped_profile()))
    loaded = load(png(indices, PALETTE, [profile, chunk(b"PLTE", palette.tobytes())]))
    np.testing.assert_allclose(loaded, palette[indices][..., ::-1], atol=1)


@pytest.mark.parametrize("colour_type", [GREY, GREY_ALPHA])
def test_a_profile_holds_for_grey(load: Load, colour_type: int) -> None:
    values = np.arange(256, dtype=np.uint8).reshape(16, 16)
    pixels = values if colour_type == GREY else np.stack([values, np.full_like(values, 255)], axis=-1)
    loaded = load(png(pixels, colour_type, [chunk(b"iCCP", b"linear\0\0" + zlib.compress(linear_grey_profile()))]))
    # The first rows are left out: near black, one step of light is 13 of sRGB, and Little CMS interpolates.
    np.testing.assert_allclose(loaded[2:], np.stack([srgb_curve(values[2:] / 255)] * 3, axis=-1), atol=2)


def test_a_profile_holds_for_grey_of_16_bits(load: Load) -> None:
    loaded = load(png(DEEP, GREY, [chunk(b"iCCP", b"linear\0\0" + zlib.compress(linear_grey_profile()))]))
    bright = DEEP > 8192
    np.testing.assert_allclose(loaded[bright][:, 0], srgb_curve(DEEP[bright] / 65535), atol=2)


def test_the_srgb_profile_changes_nothing(load: Load) -> None:
    pixels = random_pixels(9, 8, 3)
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    np.testing.assert_array_equal(load(encoded(pixels, "PNG", icc_profile=profile)), pixels)


@pytest.mark.parametrize(
    "profile",
    [b"garbage", swapped_profile()[:300], linear_grey_profile()],
    ids=["garbage", "cut short", "of other channels"],
)
def test_a_profile_that_cannot_be_used_is_ignored_with_a_warning(load: Load, profile: bytes) -> None:
    pixels = random_pixels(9, 8, 3)
    with pytest.warns(StrokeplanWarning, match=r"^the colour profile is ignored \(.+\)$"):
        loaded = load(encoded(pixels, "PNG", icc_profile=profile))
    np.testing.assert_array_equal(loaded, pixels)


# What is refused


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"nothing\.jpg: no such file$"):
        load_photo(tmp_path / "nothing.jpg")


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"is a folder; give a picture file$"):
        load_photo(tmp_path)


def test_a_name_that_is_too_long_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"cannot be read \(.+\)$"):
        load_photo(tmp_path / ("x" * 300 + ".jpg"))


def test_an_empty_file_is_refused(load: Load) -> None:
    refuse(load, b"", "the file is empty")


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM"])
@pytest.mark.parametrize("part", [0.02, 0.5, 0.95])
def test_a_file_cut_short_is_refused(load: Load, small_picture: Pixels, kind: str, part: float) -> None:
    data = encoded(small_picture, kind)
    refuse(load, data[: int(part * len(data))])


def test_damage_in_the_middle_is_refused(load: Load) -> None:
    data = bytearray(png(random_pixels(64, 64, 3), RGB))
    data[len(data) // 2 : len(data) // 2 + 50] = bytes(50)
    refuse(load, bytes(data), "damaged")


FOREIGN = {
    "text": b"This is no picture.\n",
    "EPS": b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n(ran) print showpage\n%%EOF\n",
    "PDF": b"%PDF-1.4\n1 0 obj<</Type/Catalog>>endobj\ntrailer<</Root 1 0 R>>\n",
    "SVG": b"<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'><script>1</script></svg>",
    "zeros": bytes(4096),
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_no_picture_is_refused_and_never_run(load: Load, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    def run(*_: Any, **__: Any) -> None:
        pytest.fail("a program was started")

    monkeypatch.setattr(subprocess, "Popen", run)
    refuse(load, FOREIGN[kind], "is not a picture that can be read; known are JPEG, PNG, TIFF, WEBP, BMP, GIF, PPM")


def test_messages_hold_no_addresses(load: Load) -> None:
    with pytest.raises(ImageError) as raised:
        load(FOREIGN["text"])
    assert not re.search(r"0x[0-9a-f]{6}", str(raised.value))


def undecoded(monkeypatch: pytest.MonkeyPatch) -> None:
    """From here on, decoding a pixel fails the test."""

    def decode(_: ImageFile.ImageFile) -> None:
        pytest.fail("the pixels were decoded")

    monkeypatch.setattr(ImageFile.ImageFile, "load", decode)


def test_a_decompression_bomb_is_refused_by_its_header(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    undecoded(monkeypatch)
    data = png(np.zeros((2, 2, 3), np.uint8), RGB, size=(60_000, 60_000))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refuse(load, data, "3600000000", f"limit is {MAX_MEGAPIXELS:g} megapixels")
    kilobytes = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / (
        1024 if sys.platform == "darwin" else 1
    )
    assert kilobytes < 100_000  # its pixels are 10.8 GB


def test_a_size_just_beyond_the_limit_is_refused_by_its_header(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    undecoded(monkeypatch)
    data = png(np.zeros((2, 2, 3), np.uint8), RGB, size=(17_501, 10_000))
    refuse(load, data, "17501 × 10000 pixels are 175 megapixels, the limit is 175")


def test_pillow_opens_every_size_up_to_the_limit() -> None:
    """Its own limit would be reported as ours otherwise."""
    assert Image.MAX_IMAGE_PIXELS is not None
    assert MAX_MEGAPIXELS * 1e6 <= 2 * Image.MAX_IMAGE_PIXELS


def test_the_limit_is_an_argument(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "photo.png"
    path.write_bytes(png(random_pixels(20, 30, 3), RGB))
    assert load_photo(path, max_megapixels=0.0006).width == 30
    undecoded(monkeypatch)
    with pytest.raises(ImageError, match=r"photo\.png: 30 × 20 pixels are 0 megapixels, the limit is 0\.0005"):
        load_photo(path, max_megapixels=0.0005)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 9), (9, 1)])
def test_a_picture_of_one_pixel_width_is_refused(load: Load, width: int, height: int) -> None:
    refuse(load, png(random_pixels(height, width, 3), RGB), f"{width} × {height} pixels are too few", "at least 2")


# What a photo knows


def test_a_photo_knows_its_file(tmp_path: Path) -> None:
    data = png(random_pixels(4, 6, 3), RGB)
    path = tmp_path / "cat.png"
    path.write_bytes(data)
    photo = load_photo(str(path))
    assert (photo.name, photo.sha256) == ("cat.png", hashlib.sha256(data).hexdigest())
    assert (photo.width, photo.height) == (6, 4)


def test_a_name_in_another_encoding_is_kept_legible(tmp_path: Path) -> None:
    """Such a name comes with surrogates, which no strokes file can hold."""
    path = tmp_path / b"caf\xe9.png".decode(errors="surrogateescape")
    try:
        path.write_bytes(png(random_pixels(4, 6, 3), RGB))
    except OSError:
        pytest.skip("this file system takes names in UTF-8 only")
    assert load_photo(path).name == "caf\ufffd.png"


# Arrays


def test_an_array_of_bytes_is_taken_as_it_is() -> None:
    pixels = random_pixels(4, 6, 3)
    photo = as_photo(pixels)
    np.testing.assert_array_equal(photo.rgb, pixels)
    assert not np.shares_memory(photo.rgb, pixels)


def test_a_grey_array_becomes_three_channels() -> None:
    pixels = random_pixels(4, 6)
    np.testing.assert_array_equal(as_photo(pixels).rgb, np.stack([pixels] * 3, axis=-1))


def test_an_array_with_alpha_lies_over_white() -> None:
    pixels = random_pixels(4, 6, 4)
    np.testing.assert_allclose(as_photo(pixels).rgb, over_white(pixels[..., :3], pixels[..., 3:]), atol=1)


@pytest.mark.parametrize("order", ["<u2", ">u2"])
def test_an_array_of_16_bits_is_scaled_and_rounded(order: str) -> None:
    np.testing.assert_array_equal(as_photo(DEEP.astype(order)).rgb[..., 0], np.rint(DEEP / 257))


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_a_float_array_is_scaled_and_rounded(dtype: type[np.floating[Any]]) -> None:
    pixels = (random_pixels(4, 6, 3) / 255).astype(dtype)
    np.testing.assert_array_equal(as_photo(pixels).rgb, np.rint(pixels.astype(float) * 255))


def test_a_view_gives_a_contiguous_photo() -> None:
    pixels = random_pixels(8, 6, 3)
    photo = as_photo(pixels[::2, ::-1])
    assert photo.rgb.flags.c_contiguous
    np.testing.assert_array_equal(photo.rgb, pixels[::2, ::-1])


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.01, 1.01, 255.0])
def test_floats_outside_0_to_1_are_refused(value: float) -> None:
    pixels = np.full((4, 4, 3), 0.5)
    pixels[1, 2, 0] = value
    with pytest.raises(ImageError, match=r"must lie in 0\.\.1; divide 8-bit values by 255"):
        as_photo(pixels)


@pytest.mark.parametrize("dtype", [np.int64, np.int8, np.uint32, np.bool_, np.complex128, object])
def test_other_types_are_refused_by_name(dtype: Any) -> None:
    with pytest.raises(ImageError, match=np.dtype(dtype).name):
        as_photo(np.zeros((4, 4, 3), dtype))


@pytest.mark.parametrize("shape", [(4,), (4, 4, 1), (4, 4, 2), (4, 4, 5), (2, 4, 4, 3), ()])
def test_other_shapes_are_refused_by_their_figures(shape: tuple[int, ...]) -> None:
    with pytest.raises(ImageError, match=re.escape(str(shape))):
        as_photo(np.zeros(shape, np.uint8))


@pytest.mark.parametrize("shape", [(0, 0, 3), (0, 5), (1, 1, 3), (1, 9)])
def test_arrays_without_room_for_an_orientation_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ImageError, match="too few"):
        as_photo(np.zeros(shape, np.uint8))


def test_grey_is_the_weighted_sum() -> None:
    pixels = random_pixels(4, 6, 3)
    np.testing.assert_allclose(grey(pixels), pixels @ np.array(LUMA) / 255, atol=1e-6)
    np.testing.assert_allclose(grey(pixels, (1 / 3, 1 / 3, 1 / 3)), pixels.mean(axis=2) / 255, atol=1e-6)
    assert grey(pixels).dtype == np.float32


def test_lab_is_that_of_scikit_image_over_100(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = random_pixels(40, 6, 3)
    monkeypatch.setattr(image, "COLOUR_STRIP_ROWS", 16)
    converted = image.lab(pixels)
    assert converted.dtype == np.float32
    np.testing.assert_allclose(converted, rgb2lab(pixels) / 100, atol=1e-5)
    np.testing.assert_allclose(image.lab(np.full((1, 1, 3), 255, np.uint8))[0, 0], (1, 0, 0), atol=1e-4)


def test_hue_is_a_direction_that_fades_without_colour() -> None:
    pixels = random_pixels(40, 6, 3)
    _, a, b = np.moveaxis(rgb2lab(pixels), 2, 0)
    vector = image.hue(pixels)
    np.testing.assert_allclose(np.arctan2(vector[..., 1], vector[..., 0]), np.arctan2(b, a), atol=1e-3)
    chroma = np.hypot(a, b)
    np.testing.assert_allclose(np.hypot(vector[..., 0], vector[..., 1]), chroma / (chroma + 10), atol=1e-4)
    greys = np.repeat(np.arange(256, dtype=np.uint8)[:, None, None], 3, axis=2)
    assert np.abs(image.hue(greys)).max() < 1e-3


# Folders


def test_a_folder_gives_its_pictures_in_order(tmp_path: Path) -> None:
    for name in ("b.JPG", "a.png", "c.jpeg", "d.tif", "e.webp", "notes.txt", "f.pdf", "g.svg"):
        (tmp_path / name).touch()
    found = photo_files([tmp_path])
    assert [path.name for path in found] == ["a.png", "b.JPG", "c.jpeg", "d.tif", "e.webp"]


def test_files_that_are_named_are_taken_as_they_are(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "a.png").touch()
    named = tmp_path / "picture.dat"
    assert photo_files([named, folder]) == [named, folder / "a.png"]


def test_a_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=re.escape(f"{tmp_path}: no pictures there")):
        photo_files([tmp_path])


def test_a_folder_that_cannot_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def iterdir(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", iterdir)
    with pytest.raises(ImageError, match=r"cannot be read \(Permission denied\)"):
        photo_files([tmp_path])


def test_loading_leaves_the_warning_filters_alone(load: Load) -> None:
    before = list(warnings.filters)
    load(png(random_pixels(4, 6, 3), RGB))
    assert warnings.filters == before
