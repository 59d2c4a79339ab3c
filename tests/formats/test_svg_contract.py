"""What the SVG writer writes, with every option, is what the reader reads: any plan, up to the file's rounding."""

from __future__ import annotations

import warnings
from dataclasses import replace
from math import ceil, log10
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from plans import TINY, plans
from test_svg_reader import cleaned

import strokeplan
from strokeplan import ExportOptions, Page, StrokePlan, StrokeplanWarning
from strokeplan.formats import compress
from strokeplan.formats.svg import encode
from strokeplan.grouping import regroup
from strokeplan.planner import plan as make_plan
from strokeplan.strokes import Layer

A4 = Page(210, 297, 10)
OPTIONS = [
    ExportOptions(),
    ExportOptions(classes=True),
    ExportOptions(outline=True),
    ExportOptions(units="mm", precision=4),
    ExportOptions(page=A4),
    ExportOptions(page=A4, clip=True, outline=True, classes=True),
    ExportOptions(group_by="colour", clip=True),
    ExportOptions(group_by="pen", outline=True),
    ExportOptions(group_by="colour", classes=True, page=A4, precision=1),
]
ALONG = 1.01e-4
"""Pressures and angles are written to four decimals, cut."""


def modest(plan: StrokePlan) -> StrokePlan:
    """A plan of a size that a page holds."""
    width, height = (float(np.clip(side, 1, 3000)) for side in (plan.width, plan.height))
    points = np.clip(plan.points, -5000, 5000)
    return replace(plan, width=width, height=height, points=points, widths=np.clip(plan.widths, 0.01, 5000))


def expected(plan: StrokePlan, options: ExportOptions) -> tuple[StrokePlan, float]:
    """What is read back, exact, and the step of the file's grid."""
    plan = cleaned(regroup(plan, options.group_by))
    scale, shift, size = 1.0, (0.0, 0.0), None
    if options.page is not None:
        size = (210.0, 297.0)
        scale = min(190 / plan.width, 277 / plan.height)
        shift = ((210 - scale * plan.width) / 2, (297 - scale * plan.height) / 2)
    elif options.units == "mm":
        scale = 25.4 / 96
    width, height = size or (scale * plan.width, scale * plan.height)
    decimals = 2 if scale == 1 and size is None else 3
    decimals = max(decimals, 5 - ceil(log10(max(width, height))))
    step = 10.0 ** -(decimals if options.precision is None else options.precision)
    points, widths = plan.points * scale + shift, plan.widths * scale
    return replace(plan, points=points, widths=widths, width=width, height=height), step


def assert_close(again: StrokePlan, plan: StrokePlan, step: float) -> None:
    """Fail unless a plan is another: positions to half a step, pressures and angles to four decimals."""
    np.testing.assert_array_equal(again.starts, plan.starts)
    slack = 0.501 * step + 1e-8 * max(plan.width, plan.height, 5000)
    assert np.abs(again.points - plan.points).max(initial=0) <= slack
    for name in ("width", "height", "widths"):
        np.testing.assert_allclose(getattr(again, name), getattr(plan, name), rtol=1e-8, err_msg=name)
    for name in ("pressures", "angles"):
        assert_column(getattr(again, name), getattr(plan, name), name)
    np.testing.assert_array_equal(again.colors, plan.colors)
    for name in ("layers", "background", "source", "pens"):
        assert getattr(again, name) == getattr(plan, name), name
    assert {key: value for key, value in again.settings.items() if key != "page_mm"} == plan.settings


def assert_column(found: NDArray[np.float64] | None, own: NDArray[np.float64] | None, name: str) -> None:
    if found is None or own is None:
        assert found is own, name
    else:
        np.testing.assert_allclose(found, own, atol=ALONG, rtol=0, err_msg=name)


def read_back(plan: StrokePlan, options: ExportOptions, path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with warnings.catch_warnings():
        if options.clip and options.page is not None:  # the reader does not cut, and says so
            warnings.simplefilter("ignore", StrokeplanWarning)
        again = strokeplan.load(path)
    assert_close(again, *expected(plan, options))


@settings(max_examples=40, phases=(Phase.generate,))
@given(plans().map(modest), st.sampled_from(OPTIONS), st.booleans())
def test_what_is_written_is_what_is_read(
    tmp_path_factory: pytest.TempPathFactory, plan: StrokePlan, options: ExportOptions, packed: bool
) -> None:
    if options.group_by == "pen" and plan.pens is None:
        options = replace(options, group_by="layer")
    data = encode(plan, options)
    path = tmp_path_factory.getbasetemp() / ("contract.svgz" if packed else "contract.svg")
    read_back(plan, options, path, compress(data) if packed else data)


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_a_plan_by_hand_and_a_planned_one_are_read_back(
    options: ExportOptions, small_plan: StrokePlan, tmp_path: Path
) -> None:
    pens = tuple("fine" if i % 2 else "broad" for i in range(len(small_plan)))
    nameless = replace(TINY, layers=(Layer("", 0, 2), replace(TINY.layers[1], name=" ")))
    for plan in (nameless, replace(small_plan, pens=pens)):
        read_back(plan, options, tmp_path / "a.svg", encode(plan, options))


def test_reading_back_is_compared_in_every_field() -> None:
    other = {
        "points": TINY.points + 0.1, "widths": TINY.widths * 2, "background": (0, 0, 0), "pens": None, "source": None,
        "pressures": None, "angles": TINY.angles + 0.01, "colors": TINY.colors[::-1], "settings": {}, "layers":
        (Layer("", 0, 3),), "width": 21.0,
    }  # fmt: skip
    for name, value in other.items():
        with pytest.raises(AssertionError):
            assert_close(replace(TINY, **{name: value}), TINY, 0.01)


def test_the_size_on_paper_does_not_change_the_plan_made_again(
    small_picture: NDArray[np.uint8], tmp_path: Path
) -> None:
    """The reader notes it in the settings, which stay a recipe."""
    first, copy = tmp_path / "first.svg", tmp_path / "copy.json"
    plan = make_plan(small_picture, "paper", seed=3)
    strokeplan.save(plan, first, ExportOptions(page=A4))
    again = strokeplan.load(first)
    assert again.settings == {**plan.settings, "page_mm": [210, 297]}
    strokeplan.save(again, copy)
    made = make_plan(small_picture, copy)
    assert (made.settings, encode(made)) == (plan.settings, encode(plan))
