"""The gradient of the error by outlines, against finite differences of a repaint, and what descent makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from strokeplan.canvas import pack
from strokeplan.searching.descent import descend, find_gradient
from strokeplan.searching.stack import Photo, Stack, empty_stack, halved, photo_of, room_for, show, weigh

SHAPE = (300, 400)


@pytest.fixture(scope="module")
def photo() -> Photo:
    """Smooth coloured noise, and weights that are not even."""
    rng = np.random.default_rng(3)
    smooth = gaussian_filter(rng.normal(size=(*SHAPE, 3)), (25, 25, 0), mode="wrap")
    picture = np.clip(128 + 2000 * smooth, 0, 255).astype(np.uint8)
    return photo_of(pack(picture), np.linspace(0.5, 2, SHAPE[1], dtype=np.float32) * np.ones(SHAPE, np.float32))


def stack_of(n: int, seed: int, ground: int = 1, round_cap: bool = True) -> Stack:
    """Bent strokes across the picture, over and under each other, some of them partly beside it."""
    rng = np.random.default_rng(seed)
    stack = empty_stack(n + 5, SHAPE, ground, 0x808080, round_cap)
    starts, angles = rng.uniform(0, SHAPE[::-1], (n, 2)), rng.uniform(0, 2 * np.pi, n)
    along = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    bend = rng.uniform(-30, 30, (n, 1)) * np.stack([-along[:, 1], along[:, 0]], axis=-1)
    chains = starts[:, None] + np.stack([0 * along, 40 * along + bend, 80 * along + bend, 120 * along], axis=1)
    stack.points[: 4 * n], stack.widths[:n] = chains.reshape(-1, 2), rng.uniform(25, 60, n)
    if ground:
        stack.widths[0] = 1000
    return stack


def gradient_of(photo: Photo, stack: Stack, n: int) -> NDArray[np.float64]:
    found = np.empty((n, 9))
    show(photo, stack, n)
    find_gradient(photo, stack, n, 0.5, found)
    return found


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("ground", [0, 1])
def test_the_gradient_is_that_of_the_error_of_a_repaint(photo: Photo, seed: int, ground: int) -> None:
    """With colours that suit best before and after. Borders jump from pixel to pixel, hence differences over four, and
    are chords, of which the gradient misses some points."""
    n = 9
    stack = stack_of(n, seed, ground)
    found = gradient_of(photo, stack, n)
    expected = np.zeros_like(found)
    for k in range(ground, n):
        for p in range(9):
            errors = []
            for step in (-2.0, 2.0):
                moved = stack_of(n, seed, ground)
                if p < 8:
                    moved.points[4 * k + p // 2, p % 2] += step
                else:
                    moved.widths[k] *= np.exp(step / moved.widths[k])
                errors.append(show(photo, moved, n))
            expected[k, p] = (errors[1] - errors[0]) / (4 if p < 8 else 4 / stack.widths[k])
    # The logarithm of the width counts as the border's way.
    for each in (found, expected):
        each[:, 8] /= stack.widths[:n]
    assert np.linalg.norm(expected) > 0
    assert np.linalg.norm(found - expected) < 0.15 * np.linalg.norm(expected)
    assert (found * expected).sum() > 0.985 * np.linalg.norm(found) * np.linalg.norm(expected)


def test_the_gradient_of_a_disc_is_known() -> None:
    """A white one, half over a step of the photo from black to white: across its border the error grows by 3 · 255²
    a pixel on the black side, and falls by as much on the white; of the ground that is the other way round."""
    picture = np.zeros((*SHAPE, 3), np.uint8)
    picture[:, 200:] = 255
    photo, radius = photo_of(pack(picture), np.ones(SHAPE, np.float32)), 50.0
    stack = empty_stack(1, SHAPE, 0, 0x000000, True)
    stack.points[:4], stack.widths[0] = (200.0, 150.0), 2 * radius
    found = gradient_of(photo, stack, 1)[0]
    grey = float(stack.colours[0, 0])
    assert grey == pytest.approx(127.5, abs=2)
    black, white = 3 * grey**2, 3 * ((255 - grey) ** 2 - 255**2)
    # Each end has half of the circle, on its own side: ∫ cos over it is two radii.
    assert found[0] == pytest.approx(black * -2 * radius, rel=0.02)
    assert found[6] == pytest.approx(white * 2 * radius, rel=0.02)
    assert found[8] == pytest.approx((black + white) * np.pi * radius * radius, rel=0.02)
    assert np.abs(found[[1, 2, 3, 4, 5, 7]]).max() < 0.02 * abs(found[0])


def test_what_is_hidden_has_no_gradient(photo: Photo) -> None:
    stack = stack_of(3, 1)
    stack.points[4:8] = np.array([[100.0, 100], [110, 100], [120, 100], [130, 100]])
    stack.points[8:12], stack.widths[1:3] = stack.points[4:8], (20, 40)
    found = gradient_of(photo, stack, 3)
    assert (found[:2] == 0).all()
    assert (found[2, [0, 1, 6, 7, 8]] != 0).all()


@pytest.mark.parametrize("round_cap", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_descent_betters_a_picture_and_leaves_it_shown(photo: Photo, seed: int, round_cap: bool) -> None:
    stack = stack_of(12, seed, round_cap=round_cap)
    before, ground = show(photo, stack, 12), stack.points[:4].copy()
    told: list[int] = []
    after = descend(photo, stack, 12, 25, 80.0, 10.0, told.append)
    assert after < 0.9 * before
    assert after == show(photo, stack, 12)
    assert (stack.points[:4] == ground).all()
    assert stack.widths[:12].min() >= 10
    assert told == [8, 16, 24]


def test_descent_that_finds_nothing_better_changes_nothing(photo: Photo) -> None:
    """Of a picture that the strokes themselves have painted."""
    stack = stack_of(6, 2)
    show(photo, stack, 6)
    painted = np.rint(stack.colours[stack.shown]).astype(np.uint8)
    same = photo_of(pack(painted), np.ones(SHAPE, np.float32))
    points, widths = stack.points.copy(), stack.widths.copy()
    assert descend(same, stack, 6, 10, 80.0, 1.0, lambda _: None) == pytest.approx(0, abs=1)
    assert (stack.points == points).all()
    assert (stack.widths == widths).all()


def test_a_stroke_is_worth_what_the_error_grows_by_without_it(photo: Photo) -> None:
    """But for the colours of the others, which `weigh` leaves as they are."""
    stack = stack_of(8, 5)
    before = show(photo, stack, 8)
    weigh(photo, stack, 8, room_for(SHAPE))
    worth, colours = stack.worth.copy(), stack.colours.copy()
    assert worth[0] == np.inf
    for k in range(1, 8):
        less = stack_of(8, 5)
        less.points[4 * k : 4 * k + 4] = -1000
        show(photo, less, 8)
        values = np.stack([photo.pixels >> shift & 255 for shift in (16, 8, 0)], axis=-1)
        without = (photo.weight * ((colours[less.shown] - values) ** 2).sum(axis=-1)).sum()
        assert worth[k] == pytest.approx(without - before, rel=1e-6, abs=1e-3 * before)


def test_half_the_size_has_the_means_of_the_pixels_by_weight() -> None:
    pixels = np.array([[[10], [20], [200]], [[30], [40], [100]], [[7], [9], [250]]], np.uint8).repeat(3, axis=2)
    weight = np.array([[1, 1, 1], [1, 5, 3], [1, 1, 2]], np.float32)
    half = halved(photo_of(pack(pixels), weight))
    assert half.weight.tolist() == [[8, 4], [2, 2]]
    assert (half.pixels & 255).tolist() == [[32, 125], [8, 250]]  # (10 + 20 + 30 + 5 · 40) / 8 = 32.5, to even
    assert half.squares == pytest.approx(3 * (8 * 32**2 + 4 * 125**2 + 2 * 8**2 + 2 * 250**2))
