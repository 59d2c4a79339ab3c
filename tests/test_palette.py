"""Palettes and colour settings: what is read, what is refused in which words, and the arithmetic in L*C*h."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image
from scipy.cluster.vq import kmeans2
from skimage.color import deltaE_ciede2000, rgb2lab

from strokeplan.color_settings import ColorStyle, LayerColors
from strokeplan.errors import InputError
from strokeplan.palette import (
    MAX_GPL_BYTES,
    choose_colors,
    nearest,
    parse_palette,
    photo_palette,
    plan_palette,
    read_gpl,
    shift,
    vary,
)

Colors = NDArray[np.uint8]
colors = st.integers(0, 40).flatmap(lambda n: arrays(np.uint8, (n, 3)))
palettes = st.integers(1, 50).flatmap(lambda k: arrays(np.uint8, (k, 3)))
CUBE: Colors = (
    np.stack(np.meshgrid(*3 * [np.arange(0, 256, 17)], indexing="ij"), axis=-1).reshape(-1, 3).astype(np.uint8)
)


def lch(rgb: Colors) -> tuple[NDArray[np.float64], ...]:
    """L*, C* and h in degrees of (n, 3) sRGB, by the formulas of CIE 15 and IEC 61966-2-1."""
    v = rgb / 255
    linear = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    t = linear @ to_xyz.T / (0.9505, 1, 1.089)
    x, y, z = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29).T
    a, b = 500 * (x - y), 200 * (y - z)
    return 116 * y - 16, np.hypot(a, b), np.degrees(np.arctan2(b, a))


def turned(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees from one hue to another, −180..180."""
    return (after - before + 180) % 360 - 180


def refused(call: Callable[[], Any], *words: str) -> None:
    """The call ends in an InputError of one line that has all the words in it."""
    with pytest.raises(InputError, match=r"^[^\n]+$") as raised:
        call()
    for word in words:
        assert word in str(raised.value)


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


# What --palette takes


@pytest.mark.parametrize(("text", "size"), [("12", 12), (" 1 ", 1), ("256", 256), ("+8", 8), ("008", 8)])
def test_a_number_asks_for_colours_of_the_photo(text: str, size: int) -> None:
    assert parse_palette(text) == ColorStyle(palette_size=size)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("#aabbcc", ("#aabbcc",)),
        ("#AABBCC,#dDeEfF", ("#aabbcc", "#ddeeff")),
        (" #abc , teal ", ("#aabbcc", "#008080")),
        ("RebeccaPurple,navy", ("#663399", "#000080")),
        ("#123456,#000,#123456,black", ("#123456", "#000000")),
        ("#123", ("#112233",)),
    ],
)
def test_a_list_of_colours(text: str, expected: tuple[str, ...]) -> None:
    assert parse_palette(text) == ColorStyle(palette=expected)


@given(st.lists(st.tuples(*3 * [st.integers(0, 255)]), min_size=1, max_size=256, unique=True))
def test_any_distinct_colours_are_listed_in_their_order(triples: list[tuple[int, int, int]]) -> None:
    listed = ["#{:02x}{:02x}{:02x}".format(*triple) for triple in triples]
    style = parse_palette(",".join(listed))
    assert style.palette == tuple(listed)
    palette = plan_palette(style, np.zeros((2, 2, 3), np.uint8), 0)
    assert palette is not None
    assert palette.tolist() == [list(triple) for triple in triples]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("empty", ".gpl")),
        ("  ", ("empty",)),
        ("0", ("'0'", "1..256")),
        ("-3", ("'-3'", "1..256")),
        ("257", ("'257'", "1..256")),
        ("123456", ("'123456'", "begins with #")),
        ("9" * 6000, ("1..256",)),
        ("1.5", ("'1.5'", "no colour")),
        ("#12", ("'#12'", "#rrggbb")),
        ("#1234", ("'#1234'", "#rrggbb")),
        ("#12345678", ("'#12345678'",)),
        ("#ggg", ("'#ggg'",)),
        ("red,,blue", ("''", "number 2")),
        ("red,blue,", ("''", "number 3")),
        ("red,reddish", ("'reddish'", "number 2", "CSS name")),
        ("hsl(0", ("'hsl(0'",)),
        ("mine.txt", ("'mine.txt'", ".gpl")),
        ("red\nblue", (r"'red\nblue'",)),
        (",".join(f"#{value:06x}" for value in range(257)), ("257", "256")),
        ("nowhere/at_all.gpl", ("nowhere/at_all.gpl", "no such file")),
        ("zero\0.gpl", ("cannot be read",)),
    ],
    ids=lambda value: repr(value)[:20],
)
def test_what_is_no_palette_is_refused(text: str, words: tuple[str, ...]) -> None:
    refused(lambda: parse_palette(text), "palette", *words)


@given(st.text(alphabet="0123456789abcf#,+-. \t\n", max_size=30) | st.text(max_size=30))
def test_any_text_is_a_palette_or_refused(text: str) -> None:
    try:
        style = parse_palette(text)
    except InputError:
        return
    assert bool(style.palette) != bool(style.palette_size)


# GIMP palettes

GPL = """\
GIMP Palette
Name: Evening at the sea
Columns: 3
# made by hand

  0   0   0\tBlack
 31 119 180\tdeep sea, 2 o'clock
# 1 2 3 no colour
255 127  14
 255 255 255   White with spaces
"""
GPL_COLORS = ("#000000", "#1f77b4", "#ff7f0e", "#ffffff")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "my palette.gpl"


@pytest.mark.parametrize(
    "data",
    [
        GPL.encode(),
        GPL.replace("\n", "\r\n").encode(),
        GPL.replace("\n", "\r").encode(),
        GPL.encode("utf-8-sig"),
        GPL.removesuffix("\n").encode(),
        GPL.replace("Name: Evening at the sea\nColumns: 3\n", "").encode(),
        GPL.replace("Evening", "Été").encode("latin-1"),
        GPL.replace("Black", "\u2028\x0b\x1c").encode(),
        GPL.replace("made by hand", "Channels").encode(),
        GPL.replace("255 255 255 ", "255 255 255\tWhite\n255 255 255 ").encode(),
    ],
    ids=["LF", "CRLF", "CR", "BOM", "no last newline", "old", "Latin-1", "odd separators", "comment", "twice"],
)
def test_gimp_palettes_are_read(file: Path, data: bytes) -> None:
    file.write_bytes(data)
    assert read_gpl(file) == GPL_COLORS
    assert parse_palette(f" {file} ") == ColorStyle(palette=GPL_COLORS)


def test_the_suffix_may_be_in_capitals(file: Path) -> None:
    file = file.with_suffix(".GPL")
    file.write_text(GPL)
    assert parse_palette(str(file)).palette == GPL_COLORS


names = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r\n"), max_size=20)


@given(st.lists(st.tuples(*3 * [st.integers(0, 255)], names), min_size=1, max_size=256, unique_by=lambda c: c[:3]))
def test_whatever_the_names_the_colours_are_read(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, int, int, str]]
) -> None:
    file = tmp_path_factory.mktemp("gpl") / "any.gpl"
    lines = ["GIMP Palette", "Name: any", "#", *(f"{r:3d} {g:3d} {b:3d}\t{name}" for r, g, b, name in rows)]
    file.write_bytes("\n".join(lines).encode())
    assert read_gpl(file) == tuple(f"#{r:02x}{g:02x}{b:02x}" for r, g, b, _ in rows)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", ("no GIMP palette", "'GIMP Palette'")),
        (b"\n" + GPL.encode(), ("no GIMP palette",)),
        (b"JASC-PAL\n0100\n1\n0 0 0\n", ("no GIMP palette",)),
        (b"GIMP Palettes\n0 0 0\n", ("no GIMP palette",)),
        (GPL.encode("utf-16"), ("no GIMP palette",)),
        (b"GIMP Palette\n", ("no colours",)),
        (b"GIMP Palette\nName: x\nColumns: 1\n# 1 2 3\n", ("no colours",)),
        (GPL.replace("127", "256").encode(), ("line 9", "'255 256  14'", "0..255")),
        (GPL.replace("127", "-1").encode(), ("line 9", "0..255")),
        (GPL.replace("127", "12.7").encode(), ("line 9", "whole numbers")),
        (GPL.replace("127", "१२").encode(), ("line 9",)),
        (GPL.replace("127", "9" * 5000).encode(), ("line 9",)),
        (GPL.replace("255 127  14", "255 127").encode(), ("line 9", "'255 127'", "red, green and blue")),
        (GPL.replace("255 127  14", "orange").encode(), ("line 9", "'orange'")),
        (GPL.replace("\n", "\r\n").replace("127", "300").encode(), ("line 9",)),
        (GPL.replace("127", "\xff").encode("latin-1"), ("line 9",)),
        (b"GIMP Palette\n" + b"".join(b"%d %d 0\n" % divmod(n, 256) for n in range(257)), ("257", "256")),
        (GPL.encode() + b"#" * MAX_GPL_BYTES, ("1,000,000 bytes",)),
    ],
    ids=lambda value: repr(value)[-30:] if isinstance(value, bytes) else "",
)
def test_broken_gimp_palettes_are_refused_by_line(file: Path, data: bytes, words: tuple[str, ...]) -> None:
    file.write_bytes(data)
    refused(lambda: parse_palette(str(file)), str(file), *words)


def test_a_large_palette_is_read_as_long_as_its_colours_are_few(file: Path) -> None:
    file.write_bytes((GPL + "7 7 7 again\n" * 1000).encode().ljust(MAX_GPL_BYTES, b"\n"))
    assert read_gpl(file) == (*GPL_COLORS, "#070707")


def test_a_folder_is_no_palette(file: Path) -> None:
    file.mkdir()
    refused(lambda: parse_palette(str(file)), str(file), "cannot be read", "directory")


def test_gimp_palettes_of_another_reader(file: Path) -> None:
    """Pillow's own reader, as far as it goes, finds the same colours."""
    from PIL.GimpPaletteFile import GimpPaletteFile

    lines = [line for line in GPL.encode().splitlines(keepends=True) if line.strip()]  # it trips over empty ones
    file.write_bytes(b"".join(lines))
    with file.open("rb") as stream:
        palette, mode = GimpPaletteFile(stream).getpalette()
    assert mode == "RGB"
    assert [f"#{palette[at : at + 3].hex()}" for at in range(0, 12, 3)] == list(read_gpl(file))


# Settings


@pytest.mark.parametrize(
    "style", [ColorStyle(), ColorStyle(palette=("#aabbcc",)), ColorStyle(palette_size=7)], ids=["none", "list", "size"]
)
def test_a_style_survives_being_written_and_read(style: ColorStyle) -> None:
    assert msgspec.json.decode(msgspec.json.encode(style), type=ColorStyle) == style


@pytest.mark.parametrize(
    "raw",
    [
        {"palette": ["red"]},
        {"palette": ["#aabbcc\n"]},
        {"palette": ["#aabbcc"], "palette_size": 3},
        {"palette": ["#aabbcc"] * 257},
        {"palette_size": -1},
        {"palette_size": 257},
        {"palete": []},
    ],
    ids=str,
)
def test_a_wrong_style_is_refused(raw: dict[str, Any]) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(raw, ColorStyle)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("hue_shift", 361),
        ("chroma_shift", -0.1),
        ("chroma_shift", 11),
        ("lightness_shift", -101),
        ("hue_jitter", -1),
        ("hue_jitter", 181),
        ("chroma_jitter", 1.1),
        ("lightness_jitter", -1),
        ("lightness_jitter", float("nan")),
        ("hue_shift", float("inf")),
        ("hue", 1),
    ],
)
def test_wrong_layer_colours_are_refused(name: str, value: float) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({name: value}, LayerColors)


class LayerStyle(LayerColors, frozen=True, forbid_unknown_fields=True, kw_only=True):
    width: float


class Style(ColorStyle, frozen=True, forbid_unknown_fields=True, kw_only=True):
    layers: tuple[LayerStyle, ...]


def test_the_settings_can_be_bases_of_a_preset() -> None:
    text = b"palette_size = 3\n[[layers]]\nwidth = 2\nhue_jitter = 5\n"
    style = msgspec.toml.decode(text, type=Style)
    assert style == Style(palette_size=3, layers=(LayerStyle(width=2, hue_jitter=5),))
    with pytest.raises(msgspec.ValidationError, match="exclude each other"):
        msgspec.toml.decode(b"palette = ['#000000']\n" + text, type=Style)


def test_no_palette_is_asked_for_by_default() -> None:
    assert plan_palette(ColorStyle(), CUBE, 0) is None


# Colours of a photo


def picture(*areas: tuple[tuple[int, int, int], int], noise: float = 0.0) -> Colors:
    """A picture of one row with so many pixels of each colour, with some noise."""
    flat = np.concatenate([np.tile(color, (count, 1)) for color, count in areas]).astype(float)
    return np.clip(np.rint(flat + rng().normal(0, noise, flat.shape)), 0, 255).astype(np.uint8)[None]


@given(st.lists(st.tuples(*3 * [st.integers(0, 255)]), min_size=1, max_size=20, unique=True), st.integers(0, 10))
def test_a_photo_of_few_colours_gives_those_from_dark_to_light(triples: list[tuple[int, int, int]], more: int) -> None:
    palette = photo_palette(picture(*((triple, 2) for triple in triples)), len(triples) + more, 0)
    assert sorted(map(tuple, palette.tolist())) == sorted(triples)
    assert np.all(np.diff(lch(palette)[0]) > -0.01)  # of another matrix


@settings(max_examples=30)  # each some k-means
@given(arrays(np.uint8, (9, 7, 3)), st.integers(1, 63), st.integers(0, 5))
def test_a_palette_has_at_most_k_distinct_colours_the_same_each_time(photo: Colors, k: int, seed: int) -> None:
    palette = photo_palette(photo, k, seed)
    assert 1 <= len(palette) <= k
    assert len(np.unique(palette, axis=0)) == len(palette)
    assert np.all(np.diff(lch(palette)[0]) > -0.01)  # of another matrix
    np.testing.assert_array_equal(palette, photo_palette(photo, k, seed))


def test_the_order_of_the_pixels_does_not_count() -> None:
    shuffled = rng().permutation(CUBE)
    np.testing.assert_array_equal(photo_palette(CUBE, 9, 0), photo_palette(shuffled.reshape(64, 64, 3), 9, 0))


def test_a_photo_gives_as_many_colours_as_asked_for() -> None:
    assert [len(photo_palette(CUBE, k, 0)) for k in (1, 2, 16, 100)] == [1, 2, 16, 100]


def test_separate_colours_are_found() -> None:
    areas = (((20, 20, 25), 9000), ((60, 90, 200), 6000), ((40, 140, 60), 3000), ((240, 240, 235), 9000))
    palette = photo_palette(picture(*areas, noise=3), 4, 0)
    assert np.abs(palette.astype(int) - [color for color, _ in areas]).max() <= 2


def test_a_small_vivid_accent_is_found_among_shades() -> None:
    """One pixel in 2000 is red in a grey ramp, which plain k-means cuts into eight greys."""
    ramp = np.repeat(np.linspace(0, 255, 40_000)[:, None], 3, axis=1)
    red = np.tile((220, 20, 30), (20, 1))
    photo = np.rint(np.concatenate([ramp, red]) + rng().normal(0, 4, (40_020, 3))).clip(0, 255).astype(np.uint8)
    palette = photo_palette(photo, 8, 0)
    assert np.abs(palette.astype(int) - (220, 20, 30)).max(axis=1).min() <= 6


def test_wide_black_stays_black() -> None:
    """The colour of a cluster is that of most of its pixels, whatever else is in it."""
    palette = photo_palette(picture(((2, 2, 2), 50_000), ((50, 45, 60), 500), ((230, 228, 220), 9000), noise=2), 2, 0)
    assert palette[0].max() <= 5


def test_a_cluster_that_loses_its_colours_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """k-means may end with an empty cluster and warn of it: here one starts too far from every colour."""

    def from_afar(lab: NDArray[np.float64], k: int, **options: Any) -> Any:
        starts = np.concatenate([lab[:: len(lab) // (k - 1)][: k - 1], [[1e3, 1e3, 1e3]]])
        return kmeans2(lab, starts, **{**options, "minit": "matrix"})

    monkeypatch.setattr("scipy.cluster.vq.kmeans2", from_afar)
    palette = photo_palette(CUBE, 5, 0)
    assert len(palette) == 4
    assert np.all((palette > 20) & (palette < 235))  # means of many, nothing from afar


def test_of_a_large_photo_a_part_is_enough() -> None:
    large = np.tile(CUBE, (300, 1))
    few = picture(((0, 0, 0), 1_100_000), ((250, 20, 30), 100_000))
    assert len(photo_palette(large, 12, 0)) == 12
    assert photo_palette(few, 12, 0).tolist() == [[0, 0, 0], [250, 20, 30]]


def test_the_palette_comes_from_the_style() -> None:
    photo = picture(((10, 20, 30), 3), ((200, 210, 220), 3))
    palette = plan_palette(ColorStyle(palette_size=5), photo, 0)
    assert palette is not None
    assert palette.tolist() == [[10, 20, 30], [200, 210, 220]]


# Nearest


@given(colors, palettes)
def test_nearest_is_of_the_palette_and_finding_it_again_changes_nothing(some: Colors, palette: Colors) -> None:
    once = nearest(some, palette)
    assert once.shape == some.shape
    assert {*map(tuple, once.tolist())} <= {*map(tuple, palette.tolist())}
    np.testing.assert_array_equal(nearest(once, palette), once)


@given(palettes)
def test_the_colours_of_the_palette_stay(palette: Colors) -> None:
    np.testing.assert_array_equal(nearest(palette, palette), palette)


@given(st.integers(1, 32).flatmap(lambda k: arrays(np.uint8, (k, 3))))
def test_a_palette_of_no_more_than_32_is_searched_by_ciede2000(palette: Colors) -> None:
    some = CUBE[::9]
    chosen, own = rgb2lab(nearest(some, palette)[:, None]), rgb2lab(some[:, None])
    least = deltaE_ciede2000(own, rgb2lab(palette[None])).min(axis=1)
    np.testing.assert_allclose(deltaE_ciede2000(own, chosen)[:, 0], least, atol=1e-6)


def test_a_large_palette_is_searched_nearly_as_well() -> None:
    palette = rng().integers(0, 256, (256, 3), dtype=np.uint8)
    some = CUBE[::3]
    chosen, own = rgb2lab(nearest(some, palette)[:, None]), rgb2lab(some[:, None])
    loss = deltaE_ciede2000(own, chosen)[:, 0] - deltaE_ciede2000(own, rgb2lab(palette[None])).min(axis=1)
    assert np.mean(loss > 1e-6) < 0.005
    assert loss.max() < 3


def test_dull_colours_keep_their_hue() -> None:
    """A dull blue is blue rather than black, and skin no white, though both are nearer in L*a*b*."""
    palette = parse_palette("#101010,#f5f2e8,#1f2f8f,#c8922e")
    among = plan_palette(palette, CUBE, 0)
    assert among is not None
    assert nearest(np.array([[45, 60, 110], [205, 165, 130]], np.uint8), among).tolist() == [
        [0x1F, 0x2F, 0x8F],
        [0xC8, 0x92, 0x2E],
    ]


def test_many_colours_are_compared_in_blocks_without_a_seam() -> None:
    palette = CUBE[::400]
    many = np.tile(CUBE, (5, 1))  # more than two blocks
    np.testing.assert_array_equal(nearest(many, palette), np.tile(nearest(CUBE, palette), (5, 1)))


# Shift


@given(colors, st.integers(0, 2**32))
def test_no_change_gives_the_same_bytes(some: Colors, seed: int) -> None:
    np.testing.assert_array_equal(shift(some), some)
    np.testing.assert_array_equal(vary(some, rng=rng(seed)), some)
    np.testing.assert_array_equal(choose_colors(some, LayerColors(), None, rng(seed)), some)


def test_what_is_given_back_can_be_changed_without_changing_what_was_given() -> None:
    some = CUBE.copy()
    for changed in (shift(some), vary(some, rng=rng()), choose_colors(some, LayerColors(), None, rng())):
        changed += 1
    np.testing.assert_array_equal(some, CUBE)


@pytest.mark.parametrize("turn", [360, -360, 720, 1e-9])
def test_a_whole_turn_is_none(turn: float) -> None:
    assert np.abs(shift(CUBE, hue=turn).astype(int) - CUBE).max() <= 1


@given(colors, st.floats(-360, 360), st.floats(0, 10), st.floats(-100, 100))
def test_a_shift_keeps_lightness_and_hue_as_asked(some: Colors, hue: float, chroma: float, lightness: float) -> None:
    before, after = lch(some), lch(shift(some, hue=hue, chroma=chroma, lightness=lightness))
    # 8 bits are 0.3 L* apart, and half a step in each channel moves a dark colour by about 1 in a* and b*.
    assert np.all(np.abs(after[0] - np.clip(before[0] + lightness, 0, 100)) < 0.4)
    assert np.all(after[1] < before[1] * chroma + 1.2)
    across = after[1] * np.abs(np.radians(turned(before[2] + hue, after[2])))
    assert np.all(across[before[1] > 1] < 2)


@pytest.mark.parametrize("turn", [-90, 30, 180])
def test_a_colour_inside_the_gamut_keeps_its_chroma(turn: float) -> None:
    dull = np.array([[120, 100, 110], [90, 110, 120], [150, 150, 130]], np.uint8)
    before, after = lch(dull), lch(shift(dull, hue=turn))
    assert after[1] == pytest.approx(before[1], abs=0.7)
    assert turned(before[2], after[2]) == pytest.approx((turn + 180) % 360 - 180, abs=3)


def test_a_colour_outside_the_gamut_keeps_as_much_chroma_as_fits() -> None:
    """Chroma tenfold: a channel is at its end, within what half a step and the bisection leave."""
    vivid = np.array([[140, 100, 90], [90, 130, 100], [100, 100, 150]], np.uint8)
    after = shift(vivid, chroma=10)
    assert np.all((after.min(axis=1) <= 4) | (after.max(axis=1) >= 254))
    assert np.all(lch(after)[1] > 1.5 * lch(vivid)[1])


def test_no_chroma_is_grey_of_the_same_lightness() -> None:
    grey = shift(CUBE, chroma=0)
    assert np.ptp(grey.astype(int), axis=1).max() <= 1
    assert np.abs(lch(grey)[0] - lch(CUBE)[0]).max() < 0.4


def test_the_ends_of_lightness_are_black_and_white() -> None:
    assert shift(CUBE, lightness=-100).max() <= 1
    assert shift(CUBE, lightness=100).min() >= 254


# Variation

MUTED: Colors = np.tile(np.array([[140, 110, 110]], np.uint8), (20_000, 1))


@pytest.mark.parametrize(("hue", "chroma", "lightness"), [(10, 0, 0), (0, 0.2, 0), (0, 0, 6), (8, 0.15, 5)])
def test_colours_vary_by_the_standard_deviations_asked_for(hue: float, chroma: float, lightness: float) -> None:
    """Of colours well inside the gamut; rounding to 8 bits adds up to 0.15 in L*, 1.2° and 0.02 of this chroma."""
    before, after = lch(MUTED), lch(vary(MUTED, hue=hue, chroma=chroma, lightness=lightness, rng=rng()))
    for deviation, asked, rounding in (
        (turned(before[2], after[2]), hue, 1.2),
        (after[1] / before[1] - 1, chroma, 0.02),
        (after[0] - before[0], lightness, 0.15),
    ):
        assert asked * 0.97 <= deviation.std() <= np.hypot(asked * 1.03, rounding)
        assert abs(deviation.mean()) < 0.03 * asked + 0.2 * rounding


@given(colors, st.floats(0, 180), st.floats(0, 1), st.floats(0, 100), st.integers(0, 2**32))
def test_the_same_seed_gives_the_same_colours(
    some: Colors, hue: float, chroma: float, lightness: float, seed: int
) -> None:
    first, second = (vary(some, hue=hue, chroma=chroma, lightness=lightness, rng=rng(seed)) for _ in range(2))
    assert first.shape == some.shape
    np.testing.assert_array_equal(first, second)


def test_another_seed_gives_other_colours() -> None:
    assert np.any(vary(CUBE, hue=10, rng=rng(1)) != vary(CUBE, hue=10, rng=rng(2)))


def test_one_deviation_does_not_change_with_the_others() -> None:
    light = vary(MUTED, lightness=6, rng=rng())
    both = vary(MUTED, lightness=6, hue=10, rng=rng())
    assert np.abs(lch(light)[0] - lch(both)[0]).max() < 0.5
    assert np.abs(turned(lch(light)[2], lch(both)[2])).max() > 20


def test_neighbours_vary_independently() -> None:
    deviation = lch(vary(MUTED, lightness=6, rng=rng()))[0]
    assert abs(np.corrcoef(deviation[1:], deviation[:-1])[0, 1]) < 0.03


# All in order


def test_colours_are_shifted_then_varied_then_chosen() -> None:
    layer = LayerColors(hue_shift=40, chroma_shift=1.2, lightness_shift=5, hue_jitter=9, lightness_jitter=4)
    palette = CUBE[::300]
    varied = vary(shift(CUBE, hue=40, chroma=1.2, lightness=5), hue=9, lightness=4, rng=rng())
    np.testing.assert_array_equal(choose_colors(CUBE, layer, None, rng()), varied)
    np.testing.assert_array_equal(choose_colors(CUBE, layer, palette, rng()), nearest(varied, palette))


def test_variation_mixes_the_palette_between_its_colours() -> None:
    grey, palette = np.full((2000, 3), 120, np.uint8), np.array([[90, 90, 90], [150, 150, 150]], np.uint8)
    flat = choose_colors(grey, LayerColors(), palette, rng())
    mixed = choose_colors(grey, LayerColors(lightness_jitter=12), palette, rng())
    assert len(np.unique(flat, axis=0)) == 1
    assert 0.2 < np.mean(mixed[:, 0] == 90) < 0.8


def test_a_photo_painted_with_its_own_palette_stays_close(sample_photo: Path) -> None:
    with Image.open(sample_photo) as image:
        photo = np.asarray(image.convert("RGB").resize((60, 40))).reshape(-1, 3)
    differences = [
        deltaE_ciede2000(rgb2lab(photo[:, None]), rgb2lab(nearest(photo, photo_palette(photo, k, 0))[:, None])).mean()
        for k in (1, 4, 16, 64)
    ]
    assert differences == sorted(differences, reverse=True)
    assert differences[-1] < 3
