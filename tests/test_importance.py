"""Importance: masks, faces, saliency and regions, against pictures whose answer is known beforehand."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from strokeplan import importance
from strokeplan.errors import ImageError, InputError
from strokeplan.image import LUMA, load_photo
from strokeplan.importance import (
    NEUTRAL,
    WORKING_SIDE,
    faces,
    fit_mask,
    importance_map,
    load_mask,
    saliency,
    segments,
)

Pixels = NDArray[np.uint8]
EYES, MOUTH = ((203, 101), (246, 103)), (224, 146)
"""Where they are in the portrait of the astronaut (x, y), read off the photo."""
GREEN, RED, BLUE = (60, 140, 60), (200, 40, 40), (40, 60, 200)


def plain(height: int, width: int, color: tuple[int, int, int] = GREEN) -> Pixels:
    return np.full((height, width, 3), color, np.uint8)


def spotted(height: int = 90, width: int = 120) -> Pixels:
    """A red spot in the middle of a green picture."""
    photo = plain(height, width)
    photo[height * 4 // 9 : height * 5 // 9, width * 4 // 9 : width * 5 // 9] = RED
    return photo


def noise(height: int, width: int) -> Pixels:
    return np.random.default_rng(3).integers(0, 256, (height, width, 3), np.uint8)


def saved(folder: Path, pixels: NDArray[Any], **options: Any) -> Path:
    path = folder / "mask.png"
    Image.fromarray(pixels).save(path, **options)
    return path


@pytest.fixture(scope="module")
def astronaut() -> Pixels:
    return load_photo(ROOT / "samples" / "astronaut.jpg").rgb


@pytest.fixture(scope="module")
def cat(sample_photo: Path) -> Pixels:
    return load_photo(sample_photo).rgb


tiny = pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 2), (8, 8), (3, 40), (700, 1), (25, 24)], ids=str)
flat = pytest.mark.parametrize("color", [(0, 0, 0), (255, 255, 255), (128, 128, 128), (9, 200, 77)], ids=str)


# Masks


def test_a_grey_mask_is_its_values(tmp_path: Path) -> None:
    values = np.arange(256, dtype=np.uint8).reshape(8, 32)
    mask = load_mask(saved(tmp_path, values))
    assert mask.dtype == np.float32
    np.testing.assert_allclose(mask, values / 255, atol=1e-6)
    assert (mask.min(), mask.max()) == (0, 1)


def test_a_mask_in_colour_is_its_luma(tmp_path: Path) -> None:
    colours = noise(5, 6)
    np.testing.assert_allclose(load_mask(saved(tmp_path, colours)), colours @ np.array(LUMA) / 255, atol=1e-5)


@pytest.mark.parametrize("paint", [(0, 0, 0), (255, 255, 255), RED], ids=str)
def test_what_is_painted_on_an_empty_layer_matters_in_any_colour(tmp_path: Path, paint: tuple[int, int, int]) -> None:
    opacity = np.arange(30, dtype=np.uint8).reshape(5, 6) * 8
    layer = np.dstack([plain(5, 6, paint), opacity])
    np.testing.assert_allclose(load_mask(saved(tmp_path, layer)), opacity / 255, atol=1e-6)


def test_an_opaque_layer_is_its_luma(tmp_path: Path) -> None:
    colours = noise(5, 6)
    layer = np.dstack([colours, np.full((5, 6), 255, np.uint8)])
    np.testing.assert_allclose(load_mask(saved(tmp_path, layer)), colours @ np.array(LUMA) / 255, atol=1e-5)


def test_a_mask_is_turned_upright(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # stored rows run down the right side
    values = np.array([[0, 50, 100], [150, 200, 250]], np.uint8)
    mask = load_mask(saved(tmp_path, values, exif=exif))
    np.testing.assert_allclose(mask * 255, [[150, 0], [200, 50], [250, 100]], atol=1e-4)


def test_a_missing_mask_is_named(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"nothing\.png: no such file$"):
        load_mask(tmp_path / "nothing.png")


def test_a_mask_that_is_no_picture_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mask.png"
    path.write_text("white here, please")
    with pytest.raises(ImageError, match=r"mask\.png: is not a picture that can be read"):
        load_mask(path)


def test_a_mask_of_one_pixel_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"mask\.png: 1 × 1 pixels are too few"):
        load_mask(saved(tmp_path, np.zeros((1, 1), np.uint8)))


def test_a_mask_of_the_photo_s_size_stays_as_it_is() -> None:
    mask = np.random.default_rng(1).random((9, 7), np.float32)
    np.testing.assert_array_equal(fit_mask(mask, plain(9, 7)), mask)


@pytest.mark.parametrize("kind", [bool, np.float64, np.int64])
def test_a_mask_may_be_of_any_kind_of_number(kind: Any) -> None:
    mask = np.eye(6).astype(kind)
    fitted = fit_mask(mask, plain(6, 6))
    assert fitted.dtype == np.float32
    np.testing.assert_array_equal(fitted, np.eye(6))


@pytest.mark.parametrize("factor", [1 / 3, 4])
def test_a_ramp_stays_a_ramp_at_another_size(factor: float) -> None:
    width, height = round(240 * factor), round(60 * factor)
    ramp = np.repeat(((np.arange(240, dtype=np.float32) + 0.5) / 240)[None], 60, axis=0)
    fitted = fit_mask(ramp, plain(height, width))
    middle = slice(width // 10, -width // 10)  # at the edge there is no neighbour to go on from
    expected = (np.arange(width) + 0.5) / width
    np.testing.assert_allclose(fitted[:, middle], np.tile(expected[middle], (height, 1)), atol=1e-5)


def test_a_larger_mask_is_averaged() -> None:
    """A fine chessboard has no single pixel that stands for it."""
    board = (np.indices((400, 600)).sum(axis=0) % 2).astype(np.float32)
    np.testing.assert_allclose(fit_mask(board, plain(20, 30)), 0.5, atol=0.01)


@given(st.integers(2, 300), st.integers(2, 300), st.floats(0.01, 1))
def test_a_mask_of_the_photo_s_proportions_fits_whatever_its_rounding(height: int, width: int, scale: float) -> None:
    photo = plain(height, width)
    rounded = tuple(max(round(side * scale), 1) for side in (height, width))
    cut = tuple(max(int(side * scale), 1) for side in (height, width))
    for shape in (rounded, cut):
        assert fit_mask(np.ones(shape, bool), photo).shape == (height, width)


@pytest.mark.parametrize("shape", [(90, 120), (120, 90), (300, 410), (600, 300)])
def test_a_mask_of_other_proportions_is_refused_with_both_sizes(shape: tuple[int, int]) -> None:
    photo = plain(300, 450)
    with pytest.raises(InputError, match=rf"^the mask is {shape[1]} × {shape[0]}, the photo 450 × 300: [^\n]+$"):
        fit_mask(np.zeros(shape, np.float32), photo)


@pytest.mark.parametrize("value", [-0.01, 1.01, 255, np.nan, np.inf])
def test_a_mask_outside_0_to_1_is_refused(value: float) -> None:
    mask = np.zeros((4, 4))
    mask[2, 1] = value
    with pytest.raises(InputError, match=r"must lie in 0\.\.1"):
        fit_mask(mask, plain(4, 4))


@pytest.mark.parametrize("shape", [(4,), (4, 4, 3), (0, 4), ()])
def test_a_mask_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="give \\(height, width\\)"):
        fit_mask(np.zeros(shape), plain(4, 4))


# The map


def test_a_mask_decides_alone(astronaut: Pixels) -> None:
    mask = np.zeros((64, 64), np.float32)
    np.testing.assert_array_equal(importance_map(astronaut, mask=mask), np.zeros((512, 512)))


def test_no_cue_is_neutral(astronaut: Pixels) -> None:
    np.testing.assert_array_equal(importance_map(astronaut, use=()), np.full((512, 512), NEUTRAL))


def test_faces_alone_raise_what_is_beneath_them(astronaut: Pixels) -> None:
    expected = NEUTRAL + (1 - NEUTRAL) * faces(astronaut)
    np.testing.assert_allclose(importance_map(astronaut, use=["faces"]), expected, atol=1e-6)


def test_saliency_alone_moves_detail_about(cat: Pixels) -> None:
    moved = importance_map(cat, use=["saliency"])
    assert moved.min() < 0.25
    assert moved.max() > 0.9
    assert moved.mean() == pytest.approx(NEUTRAL, abs=0.02)


def test_faces_and_saliency_together(astronaut: Pixels) -> None:
    both, face = importance_map(astronaut), faces(astronaut)
    without = importance_map(astronaut, use=["saliency"])
    np.testing.assert_allclose(both[face == 0], without[face == 0], atol=1e-6)
    assert np.all(both >= without - 1e-6)
    for x, y in (*EYES, MOUTH):
        assert both[y, x] > 0.95


def test_an_unknown_cue_is_refused_with_those_known(cat: Pixels) -> None:
    with pytest.raises(InputError, match=r'^importance "hands" is not known; known are faces, saliency$'):
        importance_map(cat, use=["faces", "hands"])  # type: ignore[list-item]


@flat
@pytest.mark.parametrize("size", [(2, 2), (8, 8), (301, 450)], ids=str)
def test_a_photo_of_one_colour_is_neutral(size: tuple[int, int], color: tuple[int, int, int]) -> None:
    np.testing.assert_array_equal(importance_map(plain(*size, color)), np.full(size, NEUTRAL))


def test_the_noise_of_an_even_photo_hardly_matters() -> None:
    photo = (128 + np.random.default_rng(2).integers(-1, 2, (300, 400, 3))).astype(np.uint8)
    np.testing.assert_allclose(importance_map(photo), NEUTRAL, atol=0.15)


@tiny
def test_tiny_photos_have_maps(shape: tuple[int, int]) -> None:
    for photo in (noise(*shape), plain(*shape)):
        for picture in (faces(photo), saliency(photo), importance_map(photo)):
            assert (picture.shape, picture.dtype) == (shape, np.float32)
            assert picture.min() >= 0
            assert picture.max() <= 1


def test_maps_are_repeatable_and_may_be_written_to(cat: Pixels) -> None:
    for function in (faces, saliency, importance_map):
        first, second = function(cat), function(cat)
        assert first.tobytes() == second.tobytes()
        assert first.flags.writeable
        assert first.flags.c_contiguous


# Faces


def test_eyes_and_mouth_weigh_most(astronaut: Pixels) -> None:
    weights = faces(astronaut)
    for x, y in (*EYES, MOUTH):
        assert weights[y, x] == pytest.approx(1, abs=0.02)
    forehead, cheek = weights[85, 224], weights[122, 200]
    assert forehead == pytest.approx(0.6, abs=0.05)
    assert cheek == pytest.approx(0.6, abs=0.05)
    rows, columns = np.nonzero(weights)
    assert 40 < rows.min() < rows.max() < 195
    assert 160 < columns.min() < columns.max() < 300


def test_a_cat_has_no_human_face(cat: Pixels) -> None:
    assert not faces(cat).any()


def test_two_people_have_two_faces(astronaut: Pixels) -> None:
    head = astronaut[20:220, 120:320]
    pair = np.concatenate([head, head[:, ::-1]], axis=1)
    weights = faces(pair)
    for x, y in EYES:
        assert weights[y - 20, x - 120] > 0.9
        assert weights[y - 20, 399 - (x - 120)] > 0.9


def test_a_large_photo_shows_the_same_faces(astronaut: Pixels) -> None:
    large = np.asarray(Image.fromarray(astronaut).resize((1536, 1536), Image.Resampling.BICUBIC))
    expected = np.kron(faces(astronaut), np.ones((3, 3)))
    assert np.abs(faces(large) - expected).mean() < 0.005


@given(arrays(np.int64, (6, 3), elements=st.integers(1, 9)))
def test_the_common_part_of_windows_is_counted(windows: NDArray[np.int64]) -> None:
    """Against pixels: how many both cover, of those that either covers."""
    x, y = np.meshgrid(np.arange(20), np.arange(20))
    covered = [(x >= a) & (x < a + side) & (y >= b) & (y < b + side) for a, b, side in windows.tolist()]
    expected = [np.sum(covered[0] & other) / np.sum(covered[0] | other) for other in covered]
    floats = windows.astype(float)
    np.testing.assert_allclose(importance._common_part(floats[0], floats), expected)


@pytest.mark.parametrize("order", [1, -1])
def test_windows_are_voted_on_whatever_their_order(monkeypatch: pytest.MonkeyPatch, order: int) -> None:
    """Threads of the cascade find windows in any order: five agree, four lie within, three are too few."""
    agreed = [(100, 60, 80), (104, 60, 80), (102, 62, 80), (100, 64, 80), (104, 64, 80)]
    within = [(130, 90, 24), (131, 90, 24), (130, 91, 24), (131, 91, 24)]
    few = [(10, 10, 40), (12, 10, 40), (10, 12, 40)]

    class Found:
        def detect_multi_scale(self, *_: Any) -> list[dict[str, int]]:
            return [{"c": x, "r": y, "width": side} for x, y, side in (within + agreed + few)[::order]]

    monkeypatch.setattr(importance, "_cascade", Found)
    np.testing.assert_allclose(importance._face_windows(plain(640, 640)), [[204, 124, 160]])


# Saliency


def test_what_is_unlike_the_rest_stands_out() -> None:
    photo = spotted()
    weights = saliency(photo)
    assert weights[45, 60] > 0.9
    assert weights[:20].max() < 0.1
    assert np.unravel_index(weights.argmax(), weights.shape) == pytest.approx((45, 60), abs=9)


def test_the_rare_colour_stands_out_whichever_it_is() -> None:
    photo = plain(100, 200)
    photo[:, 160:] = RED
    rest, rare = saliency(photo)[50, [60, 190]]
    assert rare > rest + 0.2
    rare, rest = saliency(np.where(photo == GREEN, RED, GREEN).astype(np.uint8))[50, [190, 60]]
    assert rare > rest + 0.2


def test_detail_stands_out_from_blur() -> None:
    stripes = plain(120, 240, (128, 128, 128))
    stripes[30:90, 150:210] = np.where(np.arange(60) // 4 % 2, 60, 200)[None, :, None]
    weights = saliency(stripes)
    assert weights[45:75, 165:195].min() > 0.5
    assert weights[:, :120].max() < 0.1


def test_the_eyes_of_a_cat_stand_out(cat: Pixels) -> None:
    weights = saliency(cat)
    for x, y in ((171, 115), (318, 135)):
        assert weights[y - 15 : y + 15, x - 15 : x + 15].mean() > 2 * weights.mean()


@flat
def test_nothing_stands_out_of_one_colour(color: tuple[int, int, int]) -> None:
    assert not saliency(plain(50, 70, color)).any()


def test_saliency_is_that_of_the_picture_not_of_its_size() -> None:
    photo = spotted(180, 240)
    large = np.kron(photo, np.ones((4, 4, 1), np.uint8))
    np.testing.assert_allclose(saliency(large)[2::4, 2::4], saliency(photo), atol=0.15)


def test_rarity_is_the_information_of_the_colour() -> None:
    """Colours far apart in the histogram share no bin: rarities differ by the logarithm of their frequencies' ratio."""
    lab = np.zeros((10, 10, 3), np.float32)
    lab[0, :4] = 60.0, 48.0, -48.0
    rarity = importance._rarity(lab)
    assert rarity[0, 0] - rarity[5, 5] == pytest.approx(np.log(96 / 4), abs=0.05)


# Regions


def quarters(height: int, width: int) -> tuple[Pixels, NDArray[np.int32]]:
    """Four colours in four corners, and their labels."""
    labels = np.zeros((height, width), np.int32)
    labels[:, width // 2 :] += 1
    labels[height // 2 :] += 2
    return np.array([GREEN, RED, BLUE, (240, 230, 90)], np.uint8)[labels], labels


@pytest.mark.parametrize("size", [(60, 80), (WORKING_SIDE, 100), (2 * WORKING_SIDE, WORKING_SIDE)], ids=str)
@pytest.mark.parametrize("count", [4, 5, 30])
def test_four_colours_are_four_regions(size: tuple[int, int], count: int) -> None:
    """The graph's own blur puts a narrow seam between two colours, which may be a part of its own."""
    photo, expected = quarters(*size)
    labels = segments(photo, count)
    assert (labels.dtype, labels.shape) == (np.int32, size)
    if count == 4:
        assert np.mean(labels != expected) < 0.05
    for label in range(4):
        inner = labels[expected == label].reshape(size[0] // 2, size[1] // 2)[6:-6, 6:-6]
        assert len(np.unique(inner)) == 1


def test_the_nearest_colours_merge_first() -> None:
    photo = plain(60, 90)
    photo[:, 30:60] = RED
    photo[:, 60:] = (210, 60, 40)
    labels = segments(photo, 2)
    assert labels.max() == 1
    assert labels[30, 45] == labels[30, 75] != labels[30, 15]


@given(st.integers(1, 40))
@settings(max_examples=4)
def test_labels_have_no_gaps_and_are_no_more_than_asked_for(cat: Pixels, count: int) -> None:
    labels = segments(cat, count)
    assert labels.shape == cat.shape[:2]
    np.testing.assert_array_equal(np.unique(labels), np.arange(count))
    firsts = np.unique(labels, return_index=True)[1]
    assert all(a < b for a, b in pairwise(firsts.tolist()))


def test_more_regions_are_finer(cat: Pixels) -> None:
    """Merging goes on from where a larger count stopped: each of its regions lies in one of the smaller count's."""
    coarse, fine = segments(cat, 10), segments(cat, 40)
    assert all(len(np.unique(coarse[fine == label])) == 1 for label in range(40))


def test_an_even_sky_stays_whole() -> None:
    photo = plain(200, 300, (120, 160, 220)) + np.random.default_rng(4).integers(0, 3, (200, 300, 3), np.uint8)
    photo[120:] = noise(80, 300) // 2
    labels = segments(photo, 12)
    assert labels.max() == 11
    assert len(np.unique(labels[:112])) == 1


@flat
def test_one_colour_is_one_region(color: tuple[int, int, int]) -> None:
    assert not segments(plain(40, 50, color), 7).any()


@tiny
def test_no_more_regions_than_pixels(shape: tuple[int, int]) -> None:
    labels = segments(noise(*shape), 10**6)
    assert labels.shape == shape
    np.testing.assert_array_equal(np.unique(labels), np.arange(labels.max() + 1))


@pytest.mark.parametrize("count", [0, -3])
def test_less_than_one_region_is_refused(count: int) -> None:
    with pytest.raises(InputError, match=f"^{count} segments are below 1$"):
        segments(plain(8, 8), count)


def test_segments_are_repeatable(cat: Pixels) -> None:
    assert segments(cat, 30).tobytes() == segments(cat, 30).tobytes()


@given(st.integers(2, 7), st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_parts_merge_as_ward_would_by_hand(side: int, seed: int, count: int) -> None:
    """Against the definition: in each step, of all neighbours the two whose union adds least to the sum of squares."""
    rng = np.random.default_rng(seed)
    n = side + 2
    sizes, means = rng.integers(1, 20, n), rng.random((n, 3)) * 100
    pairs = np.array([(a, b) for a in range(n) for b in range(a + 1, n) if b == a + 1 or rng.random() < 0.3])

    groups = [{node} for node in range(n)]

    def squares(group: set[int]) -> float:
        """Sum of squared distances from the mean, up to what lies within the nodes."""
        weight, colour = sizes[list(group)][:, None], means[list(group)]
        centre = (weight * colour).sum(axis=0) / weight.sum()
        return float((weight * (colour - centre) ** 2).sum())

    def touch(g: set[int], h: set[int]) -> bool:
        return any((a in g and b in h) or (a in h and b in g) for a, b in pairs.tolist())

    while len(groups) > count:
        unions = [(squares(g | h) - squares(g) - squares(h), g, h) for g in groups for h in groups if g is not h]
        _, g, h = min((u for u in unions if touch(u[1], u[2])), key=lambda u: u[0])
        groups = [k for k in groups if k is not g and k is not h] + [g | h]
    expected = np.array([min(next(g for g in groups if node in g)) for node in range(n)])
    np.testing.assert_array_equal(importance._ward(sizes, means, pairs, count), expected)
