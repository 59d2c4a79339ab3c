"""The method's figures, measured: on stripes it is known where everything must lie."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from strokeplan.errors import InputError
from strokeplan.field import OrientationField, orientation_field
from strokeplan.figures import (
    ARROW,
    FIGURE_SIDE,
    SEED,
    TRACT,
    Picture,
    check_montage,
    clearest_point,
    coherence_figure,
    montage,
    orientation_figure,
    shrink,
    side_by_side,
    spread_figure,
    tract_figure,
)
from strokeplan.image import Photo, grey
from strokeplan.tractography import track

WIDTH, HEIGHT, PERIOD = 120, 90, 8
ZOOM = FIGURE_SIDE / WIDTH
"""Pixels of a figure in a pixel of the photo."""


def stripes(width: int = WIDTH, height: int = HEIGHT) -> Photo:
    """Vertical stripes: a wave of grey from left to right."""
    wave = 128 + 100 * np.sin(2 * np.pi * (np.arange(width) + 0.5) / PERIOD)
    return Photo(np.broadcast_to(np.rint(wave).astype(np.uint8)[None, :, None], (height, width, 3)).copy())


def field_of(photo: Photo, sigma: float = 1.0) -> OrientationField:
    return orientation_field(grey(photo.rgb), sigma=sigma)


def field_with_coherence(coherence: NDArray[Any], scale: float, width: int, height: int) -> OrientationField:
    """A field of vertical orientation with given coherence."""
    samples = np.zeros((*coherence.shape, 3), np.float32)
    samples[..., 1], samples[..., 2] = 1, coherence
    return OrientationField(samples, scale, width, height)


def painted(figure: Picture, color: tuple[float, float, float]) -> NDArray[np.bool_]:
    """The pixels of a figure that have, but for antialiasing, one colour."""
    return np.abs(figure - 255 * np.array(color)).max(axis=2) < 12


def components(mask: NDArray[np.bool_]) -> list[tuple[slice, slice]]:
    """The boxes around the connected parts of a mask."""
    found: list[tuple[slice, slice]] = ndimage.find_objects(ndimage.label(mask, structure=np.ones((3, 3)))[0])
    return found


def tile(height: int, width: int, shade: int) -> Picture:
    return np.full((height, width, 3), shade, np.uint8)


# Coherence


def test_coherence_of_stripes_is_white() -> None:
    figure = coherence_figure(field_of(stripes()))
    assert figure.shape == (HEIGHT, WIDTH, 3)
    assert figure.min() >= 250


def test_coherence_of_an_even_grey_is_black() -> None:
    figure = coherence_figure(field_of(Photo(tile(HEIGHT, WIDTH, 90))))
    assert figure.max() == 0


@pytest.mark.parametrize(("scale", "width", "height"), [(1, 42, 30), (4, 42, 30), (4, 44, 32), (8, 42, 5)])
def test_coherence_is_shown_where_it_was_measured(scale: int, width: int, height: int) -> None:
    columns, rows = -(-width // scale), -(-height // scale)
    ramp = (np.arange(columns) + 0.5) * scale / 50  # x / 50 at the place of each sample
    figure = coherence_figure(field_with_coherence(np.tile(ramp, (rows, 1)), scale, width, height))
    assert figure.shape == (height, width, 3)
    x = np.arange(width) + 0.5
    inside = (x >= scale / 2) & (x <= width - scale / 2)
    assert np.abs(figure[:, inside] - (255 * x / 50)[inside, None]).max() <= 2


# Orientation


def test_arrows_lie_along_the_stripes() -> None:
    photo = stripes()
    spacing = 10
    arrows = painted(orientation_figure(photo, field_of(photo), spacing=spacing), ARROW)
    places = []
    for rows, columns in components(arrows):
        high, wide = rows.stop - rows.start, columns.stop - columns.start
        assert high == pytest.approx(0.95 * spacing * ZOOM, rel=0.05)  # 0.85 of the spacing, and the caps
        assert wide < high / 2
        places.append(((rows.start + high / 2) / ZOOM, (columns.start + wide / 2) / ZOOM))
    grid = np.mgrid[spacing / 2 : HEIGHT : spacing, spacing / 2 : WIDTH : spacing].reshape(2, -1).T
    np.testing.assert_allclose(sorted(places, key=lambda at: (round(at[0]), at[1])), grid, atol=0.3)


def test_arrows_turn_with_the_picture() -> None:
    photo = Photo(np.ascontiguousarray(stripes().rgb.transpose(1, 0, 2)))
    arrows = painted(orientation_figure(photo, field_of(photo), spacing=10), ARROW)
    for rows, columns in components(arrows):
        assert rows.stop - rows.start < (columns.stop - columns.start) / 2


def test_arrows_are_as_long_as_the_coherence_is_high() -> None:
    photo = Photo(tile(HEIGHT, WIDTH, 128))
    halves = np.where(np.arange(WIDTH) < WIDTH / 2, 0.4, 0.8) * np.ones((HEIGHT, 1))
    arrows = painted(orientation_figure(photo, field_with_coherence(halves, 1, WIDTH, HEIGHT), spacing=30), ARROW)
    lengths = {(rows.stop - rows.start, columns.start > 600) for rows, columns in components(arrows)}
    line = 3 * ZOOM  # the width of the line, of which half stands out at each end
    for length, right in lengths:
        assert length - line == pytest.approx(0.85 * 30 * ZOOM * (0.8 if right else 0.4), rel=0.05)


def test_no_arrow_where_there_is_no_orientation() -> None:
    photo = Photo(tile(HEIGHT, WIDTH, 90))
    figure = orientation_figure(photo, field_of(photo))
    assert figure.shape == (FIGURE_SIDE * HEIGHT // WIDTH, FIGURE_SIDE, 3)
    assert len(np.unique(figure.reshape(-1, 3), axis=0)) == 1  # the photo to its very edge, and nothing else


def test_default_spacing_is_a_48th_of_the_longer_side() -> None:
    photo = stripes(width=480, height=40)
    arrows = painted(orientation_figure(photo, field_of(photo)), ARROW)
    assert len(components(arrows)) == 48 * 4


def test_default_spacing_suits_a_photo_of_any_size() -> None:
    assert orientation_figure(stripes(16, 12), field_of(stripes(16, 12))).shape == (900, 1200, 3)


@pytest.mark.parametrize("spacing", [0.5, 0, -3, float("nan"), float("inf")])
def test_a_spacing_that_is_none_is_refused(spacing: float) -> None:
    photo = stripes()
    with pytest.raises(InputError, match=rf"^spacing {spacing:g} is no distance between arrows"):
        orientation_figure(photo, field_of(photo), spacing=spacing)


# Tracts


def test_tract_runs_along_the_stripe_and_its_seed_is_blue() -> None:
    photo, seed = stripes(), (46.0, 31.0)
    tract = track(field_of(photo), seed, max_length=40)
    figure = tract_figure(photo, tract, seed)
    line, point = np.argwhere(painted(figure, TRACT)), np.argwhere(painted(figure, SEED))
    unit = WIDTH / 300
    np.testing.assert_allclose((point.mean(axis=0) + 0.5) / ZOOM, seed[::-1], atol=0.1)
    assert 0.7 < len(point) / (np.pi * (1.4 * unit * ZOOM) ** 2) <= 1  # all but the antialiased rim
    assert np.abs((line[:, 1] + 0.5) / ZOOM - seed[0]).max() < unit
    assert np.ptp(line[:, 0]) / ZOOM == pytest.approx(40, abs=2 * unit)


def test_a_tract_that_goes_nowhere_is_its_seed_alone() -> None:
    photo, seed = Photo(tile(HEIGHT, WIDTH, 90)), (20.0, 30.0)
    figure = tract_figure(photo, np.array([seed]), seed)
    assert not painted(figure, TRACT).any()
    assert painted(figure, SEED).any()


def test_a_spread_is_deepest_where_its_tracts_run_together() -> None:
    """Twenty tracts from one seed: two of them go up, all the others down."""
    photo, seed = Photo(tile(HEIGHT, WIDTH, 200)), (60.0, 45.0)
    down, up = np.array([seed, (60.0, 80.0)]), np.array([seed, (60.0, 10.0)])
    figure = spread_figure(photo, [down] * 18 + [up] * 2, seed).astype(int)
    below, above, bare = (figure[round(y * ZOOM), round(x * ZOOM)] for x, y in ((60, 65), (60, 25), (20, 25)))
    assert np.abs(below - 255 * np.array(TRACT)).max() < 12
    assert below[1] < above[1] - 20
    assert above[1] < bare[1] - 20
    assert painted(figure.astype(np.uint8), SEED).any()


def test_clearest_point_lies_in_the_clear_part() -> None:
    rgb = stripes().rgb.copy()
    rgb[:, : WIDTH // 2] = 128
    x, y = clearest_point(field_of(Photo(rgb)))
    assert WIDTH // 2 < x < WIDTH
    assert 0 < y < HEIGHT


def test_clearest_point_is_the_middle_of_the_clearest_block() -> None:
    coherence = np.zeros((60, 120))
    coherence[20:30, 70:80] = 1
    assert clearest_point(field_with_coherence(coherence, 2, 240, 120)) == (150, 50)


def test_clearest_point_of_a_narrow_photo_is_in_its_middle() -> None:
    assert clearest_point(field_with_coherence(np.ones((7, 600)), 1, 600, 7))[1] == 3.5
    assert clearest_point(field_with_coherence(np.ones((600, 7)), 1, 7, 600))[0] == 3.5


@pytest.mark.parametrize(("width", "height"), [(600, 3), (3, 600), (2, 2), (25, 25)])
@pytest.mark.parametrize("scale", [1, 2, 8])
def test_clearest_point_lies_in_the_photo(width: int, height: int, scale: int) -> None:
    coherence = np.ones((-(-height // scale), -(-width // scale)))
    x, y = clearest_point(field_with_coherence(coherence, scale, width, height))
    assert 0 < x <= width
    assert 0 < y <= height


# Sheets


def test_montage_puts_each_picture_in_the_middle_of_its_tile() -> None:
    pictures = [tile(10, 20, 0), tile(6, 20, 50), tile(10, 8, 100)]
    sheet = montage(pictures, columns=2, gap=4)
    wanted = np.full((10 + 4 + 10, 20 + 4 + 20, 3), 255, np.uint8)
    wanted[0:10, 0:20] = 0
    wanted[2:8, 24:44] = 50
    wanted[14:24, 6:14] = 100
    np.testing.assert_array_equal(sheet, wanted)


def test_side_by_side_is_one_row() -> None:
    row = side_by_side([tile(5, 3, 0), tile(5, 3, 50), tile(5, 3, 100)], gap=2)
    assert row[0, :, 0].tolist() == [0, 0, 0, 255, 255, 50, 50, 50, 255, 255, 100, 100, 100]
    assert np.all(row == row[0])


def test_a_single_picture_is_its_own_montage() -> None:
    picture = stripes().rgb
    np.testing.assert_array_equal(montage([picture], columns=1), picture)


def test_a_montage_of_nothing_is_refused() -> None:
    for make in (lambda: montage([], columns=3), lambda: side_by_side([])):
        with pytest.raises(InputError, match="needs at least one picture"):
            make()


@pytest.mark.parametrize("columns", [0, -1])
def test_a_montage_without_columns_is_refused(columns: int) -> None:
    with pytest.raises(InputError, match=f"^columns {columns} is below 1$"):
        montage([tile(2, 2, 0)], columns=columns)


@pytest.mark.parametrize(
    ("columns", "size", "message"), [(0, 100, "columns 0"), (1, 0, "tile 0"), (1, 4097, "tile 4097")]
)
def test_a_sheet_that_cannot_be_made_is_refused(columns: int, size: int, message: str) -> None:
    check_montage(1, 4096)
    with pytest.raises(InputError, match=f"^{message} is "):
        check_montage(columns, size)


def test_shrink_keeps_the_shape_and_the_mean() -> None:
    photo = stripes().rgb
    small = shrink(photo, 0.25)
    assert small.shape == (round(HEIGHT / 4), WIDTH // 4, 3)
    assert small.mean() == pytest.approx(photo.mean(), abs=1)


def test_shrink_leaves_at_least_a_pixel_and_never_enlarges() -> None:
    photo = stripes().rgb
    assert shrink(photo, 1e-3).shape == (1, 1, 3)
    assert shrink(photo, 2.0) is photo
