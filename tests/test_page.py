"""Pages: named and measured sheets, and a picture in the middle of what the margin leaves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from strokeplan.errors import InputError
from strokeplan.page import MIN_PICTURE_MM, SIZES_MM, Page, Placement, parse_length, parse_page


@pytest.mark.parametrize(
    ("text", "size"),
    [("A4", (210, 297)), (" a3 ", (297, 420)), ("Letter", (215.9, 279.4)), ("200x300mm", (200, 300)),
     ("20 × 30.5 cm", (200, 305)), ("8.5x11in", (215.9, 279.4)), (".5x2in", (12.7, 50.8))],
)  # fmt: skip
def test_a_page_is_named_or_measured(text: str, size: tuple[float, float]) -> None:
    page = parse_page(text)
    assert page is not None
    assert (page.width_mm, page.height_mm, page.margin_mm) == (*map(pytest.approx, size), 0)


def test_iso_sizes_halve_the_one_before() -> None:
    for k in range(6):
        width, height = SIZES_MM[f"a{k}"]
        assert SIZES_MM[f"a{k + 1}"] == (height // 2, width)


def test_landscape_lays_the_longer_side_across() -> None:
    assert parse_page("A4", "1cm", landscape=True) == Page(297, 210, 10)
    assert parse_page("300x200mm", landscape=True) == Page(300, 200)
    assert parse_page(None) is None


@pytest.mark.parametrize(("text", "mm"), [("10", 10), ("10mm", 10), ("1 cm", 10), ("0.5in", 12.7), ("0", 0)])
def test_lengths_are_millimetres_unless_they_say_otherwise(text: str, mm: float) -> None:
    assert parse_length(text, "margin") == pytest.approx(mm)


@pytest.mark.parametrize(
    ("page", "margin", "words"),
    [
        ("A9", None, ("page 'A9'", "A4", "letter", "200x300mm")),
        ("200x300", None, ("page '200x300'", "200x300mm")),
        ("", None, ("page ''",)),
        ("-1x3mm", None, ("page '-1x3mm'",)),
        ("0x3mm", None, ("0 × 3 mm", "1 to 10000 mm")),
        ("1e9x3mm", None, ("page '1e9x3mm'",)),
        ("99999x3mm", None, ("99999 × 3 mm",)),
        ("A4", "105", ("margin 105 mm", "210 × 297 mm")),
        ("A4", "-1", ("margin '-1'", "millimetres")),
        ("A4", "ten", ("margin 'ten'",)),
        (None, "10", ("margin needs a page",)),
    ],
)
def test_what_is_no_page_is_refused_by_name(page: str | None, margin: str | None, words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as caught:
        parse_page(page, margin)
    assert all(word in str(caught.value) for word in words)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0, 0.0])
def test_a_page_of_no_size_is_refused(value: float) -> None:
    with pytest.raises(InputError, match="a page of"):
        Page(value, 100)
    if value:
        with pytest.raises(InputError, match="margin"):
            Page(100, 100, value)


sides = st.floats(1, 10_000)


@given(sides, sides, st.floats(0, 0.45), st.floats(1e-3, 1e6), st.floats(1e-3, 1e6))
def test_a_picture_fills_the_margin_one_way_and_is_in_the_middle(
    wide: float, high: float, part: float, width: float, height: float
) -> None:
    assume(min(wide, high) * (1 - 2 * part) >= 1.001)
    page = Page(wide, high, part * min(wide, high))
    assume(min(width, height) / max(width, height) * min(wide, high) > 20 * MIN_PICTURE_MM)
    place = page.fit(width, height)
    (x0, y0), (x1, y1) = place.points(np.array([(0, 0), (width, height)], float))
    slack = np.array([x0, wide - x1, y0, high - y1]) - page.margin_mm
    assert slack.min() >= -1e-6 * max(wide, high)
    np.testing.assert_allclose(slack[0::2], slack[1::2], atol=1e-6 * max(wide, high))
    assert min(slack[0], slack[2]) < 1e-6 * max(wide, high)
    np.testing.assert_allclose((x1 - x0) * height, (y1 - y0) * width, rtol=1e-6)


def test_a_picture_too_thin_for_its_page_is_refused() -> None:
    with pytest.raises(InputError, match="too thin"):
        Page(210, 297).fit(1e6, 1e-3)


def test_no_placement_is_no_change() -> None:
    points = np.array([(1.1, 2.2)])
    assert Placement().points(points) is points
