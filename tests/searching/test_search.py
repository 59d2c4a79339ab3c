"""Strokes searched for: the error against a repaint, what a search must find, and that no round makes it worse."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

from strokeplan import searching
from strokeplan.canvas import Packed, mean_distance, pack, unpack
from strokeplan.painting import LayerStrokes, paint_strokes
from strokeplan.searching import Effort, search

Picture = NDArray[np.uint8]
EFFORT = Effort(looks=40, moves=80, steps=20, coarse_rounds=2, rounds=2)


@pytest.fixture(autouse=True)
def _less_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "effort_for", lambda _: EFFORT)


def noise(height: int = 48, width: int = 64) -> Picture:
    """Smooth coloured noise: contours of every kind."""
    smooth = gaussian_filter(np.random.default_rng(1).normal(size=(height, width, 3)), (5, 5, 0), mode="wrap")
    return np.clip(128 + 500 * smooth, 0, 255).astype(np.uint8)


def found(picture: Picture, most: int, **changes: object) -> LayerStrokes:
    options: dict[str, object] = {
        "weight": np.ones(picture.shape[:2], np.float32), "finest": 2.0, "least": 100.0, "cover": True,
        "background": 0xFFFFFF, "round_cap": True, "key": np.uint64(5), "tell": lambda *_: None,
    }  # fmt: skip
    return search(pack(picture), most=most, **(options | changes))  # type: ignore[arg-type]


def painted(strokes: LayerStrokes, picture: Picture, background: int = 0xFFFFFF) -> Packed:
    canvas = np.full(picture.shape[:2], background, np.uint32)
    paint_strokes(canvas, strokes, round_cap=True)
    return canvas


def squared_error(strokes: LayerStrokes, picture: Picture) -> NDArray[np.float64]:
    return ((unpack(painted(strokes, picture)).astype(float) - picture) ** 2).sum(axis=-1)


def test_the_error_it_works_on_is_that_of_the_strokes_painted_in_their_order() -> None:
    """However often strokes were moved below others, taken away, or laid anew."""
    told: list[tuple[int, int, int, float]] = []
    strokes = found(noise(), 30, tell=lambda *news: told.append(news))
    canvas = painted(strokes, noise())
    assert told[-1][3] == pytest.approx(mean_distance(pack(noise()), canvas, 0, 48, 0, 64, 8, 1.0), rel=0.01)
    done, total, counts, _ = zip(*told, strict=True)
    assert list(done) == sorted(done)
    assert (done[-1], counts[-1]) == (total[-1], len(strokes.counts)) == (EFFORT.work, 30)


def test_more_strokes_come_nearer_and_descent_too(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = [squared_error(found(noise(), most), noise()).mean() for most in (1, 5, 20, 80)]
    assert all(later < 0.8 * former for former, later in pairwise(errors))
    assert errors[0] == pytest.approx(noise().reshape(-1, 3).var(axis=0).sum(), rel=0.01)
    monkeypatch.setattr(searching, "effort_for", lambda _: EFFORT._replace(coarse_rounds=0, rounds=0))
    assert squared_error(found(noise(), 20), noise()).mean() > 1.2 * errors[2]


@pytest.mark.parametrize("key", range(4))
@pytest.mark.parametrize("round_cap", [True, False])
def test_no_round_makes_it_worse(monkeypatch: pytest.MonkeyPatch, key: int, round_cap: bool) -> None:
    """And there are never more strokes than asked for."""
    errors = []
    for rounds in range(4):
        effort = EFFORT._replace(coarse_rounds=0, rounds=rounds, steps=4)
        monkeypatch.setattr(searching, "effort_for", lambda _, effort=effort: effort)
        strokes = found(noise(), 25, key=np.uint64(key), round_cap=round_cap)
        canvas = np.full((48, 64), 0xFFFFFF, np.uint32)
        paint_strokes(canvas, strokes, round_cap)
        errors.append(((unpack(canvas).astype(float) - noise()) ** 2).sum(axis=-1).mean())
        assert len(strokes.counts) <= 25
    # Colours are rounded at the end, which is worth less than 1.
    assert all(later < former + 1 for former, later in pairwise(errors))
    assert errors[-1] < errors[0] - 1


def test_what_strokes_have_painted_is_found() -> None:
    """By another program: three bars with round ends, of which one lies over another.

    Twice as many strokes as that took: they are laid greedily, and two may share a bar.
    """
    image = Image.new("RGB", (80, 60), "#204080")
    draw = ImageDraw.Draw(image)
    for (ax, ay, bx, by), colour in (
        ((10, 15, 70, 15), "#e0e0e0"),
        ((20, 5, 20, 50), "#c03020"),
        ((45, 45, 70, 40), "#20c040"),
    ):
        draw.line((ax, ay, bx, by), colour, 10)
        for x, y in ((ax, ay), (bx, by)):
            draw.ellipse((x - 5, y - 5, x + 5, y + 5), colour)
    picture = np.asarray(image)
    strokes = found(picture, 8)
    spread = picture.reshape(-1, 3).var(axis=0).sum()
    assert squared_error(strokes, picture).mean() < 0.06 * spread


def test_nothing_is_laid_where_nothing_is_to_be_gained() -> None:
    flat = np.full((30, 40, 3), 90, np.uint8)
    assert len(found(flat, 50).counts) == 1
    assert len(found(flat, 50, cover=False, background=0x5A5A5A).counts) == 0
    assert len(found(noise(), 50, least=1e12).counts) == 1


@pytest.mark.parametrize("round_cap", [True, False])
@pytest.mark.parametrize("size", [(2, 2), (1, 90), (60, 9)])
def test_the_first_stroke_covers_any_canvas(size: tuple[int, int], round_cap: bool) -> None:
    picture = noise(*size)
    canvas = np.full(size, 0x123456, np.uint32)
    paint_strokes(canvas, found(picture, 1, round_cap=round_cap), round_cap)
    assert (canvas != 0x123456).all()


def test_no_stroke_is_finer_than_the_finest() -> None:
    assert found(noise(), 40).widths.min() < 5
    assert found(noise(), 40, finest=5.0).widths.min() >= 5


def test_it_comes_nearer_where_that_counts() -> None:
    weight = np.ones((48, 64), np.float32)
    weight[:, 32:] = 16
    even, uneven = (squared_error(found(noise(), 20, **how), noise()) for how in ({}, {"weight": weight}))
    assert uneven[:, 32:].mean() < 0.8 * even[:, 32:].mean()
    assert uneven[:, :32].mean() > even[:, :32].mean()


def test_it_depends_on_the_key_alone() -> None:
    one, again, other = (found(noise(), 20, key=np.uint64(key)) for key in (1, 1, 2))
    assert one.points.tobytes() == again.points.tobytes()
    assert one.points.tobytes() != other.points.tobytes()
