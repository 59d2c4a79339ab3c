"""The columns of the page, decoded by a reader of its own that knows nothing but the description of the format."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from itertools import accumulate
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st
from random_plans import random_plan

from strokeplan import ExportOptions, formats
from strokeplan.preview.encoding import GRID, REACH, encode, varint, zigzag
from strokeplan.strokes import StrokePlan


def decode(header: dict[str, Any], data: bytes) -> dict[str, Any]:
    """Strokes as lists of grid points, and the other columns; fails where bytes are left over."""
    left = list(reversed(zlib.decompress(data)))

    def number() -> int:
        value = shift = 0
        while True:
            byte = left.pop()
            value += (byte % 128) * 2**shift
            shift += 7
            if byte < 128:
                return value

    def signed() -> int:
        value = number()
        return value // 2 if value % 2 == 0 else -(value + 1) // 2

    def column(count: int, take: Callable[[], int]) -> list[int]:
        return [take() for _ in range(count)]

    n, cubics = header["strokes"], header["cubics"]
    pieces = column(n, number)
    begins = [list(accumulate(column(n, signed))) for _ in "xy"]
    ways, firsts, seconds = ([column(cubics, signed) for _ in "xy"] for _ in range(3))
    strokes, c = [], 0
    for i in range(n):
        chain = [(begins[0][i], begins[1][i])]
        for _ in range(pieces[i]):
            start = chain[-1]
            end = tuple(start[a] + ways[a][c] for a in (0, 1))
            chain.append(tuple(start[a] + ways[a][c] // 3 + 2 * firsts[a][c] for a in (0, 1)))
            chain.append(tuple(end[a] - ways[a][c] // 3 + 2 * seconds[a][c] for a in (0, 1)))
            chain.append(end)
            c += 1
        strokes.append(chain)
    widths = [header["widths"][index] for index in column(n, number)]
    green, red, blue = ([left.pop() for _ in range(n)] for _ in range(3))
    colors = [((r + g) % 256, g, (b + g) % 256) for r, g, b in zip(red, green, blue, strict=True)]
    pressed = [left.pop() for _ in range(n)] if header["pressure"] else [0] * n
    pressures = list(accumulate(column(sum(k + 1 for k, p in zip(pieces, pressed, strict=True) if p), signed)))
    pens = [header["pens"][pen - 1] if pen else None for pen in column(n, number)] if header["pens"] else [None] * n
    assert left == []
    return {
        "strokes": strokes,
        "widths": widths,
        "colors": colors,
        "pressed": pressed,
        "pressures": pressures,
        "pens": pens,
    }


def check(plan: StrokePlan) -> None:
    header, data = encode(plan)
    found = decode(header, data)
    step = max(plan.width, plan.height) / GRID
    assert header["step"] == step
    points = np.array([point for chain in found["strokes"] for point in chain]) * step
    assert [len(chain) for chain in found["strokes"]] == plan.counts.tolist()
    inner = np.concatenate([np.arange(count) % 3 > 0 for count in plan.counts])
    assert np.abs(points - plan.points)[~inner].max() <= step * 0.500001
    assert np.abs(points - plan.points)[inner].max() <= step * 1.500001
    assert found["widths"] == pytest.approx(plan.widths, rel=5e-4)
    assert found["colors"] == [tuple(color) for color in plan.colors.tolist()]
    assert found["pressed"] == plan.has_pressure.tolist()
    if plan.pressures is not None:
        expected = plan.pressures[~np.isnan(plan.pressures)]
        assert np.array(found["pressures"]) / 255 == pytest.approx(expected, abs=0.5 / 255 + 1e-9)
    assert found["pens"] == list(plan.pens or [None] * len(plan))


def test_a_planned_picture_comes_back(small_plan: StrokePlan) -> None:
    check(small_plan)


def test_pressure_pens_and_layers_come_back() -> None:
    plan = formats.load(ROOT / "tests" / "formats" / "golden" / "tiny.json")
    check(plan)
    header, _ = encode(plan)
    assert header["layers"][1] == {"name": "fine & last", "first": 2, "last": 3, "medium": "ink", "cap": "butt"}
    assert (header["background"], header["title"]) == ("#fffdf0", "tiny.png")


@pytest.mark.parametrize("pressure", [True, False])
def test_random_strokes_come_back(pressure: bool) -> None:
    check(random_plan(pressure=pressure))


@given(st.lists(st.integers(0, 2**32 - 1)))
def test_varints_are_what_protocol_buffers_write(values: list[int]) -> None:
    def one(value: int) -> list[int]:
        return [value] if value < 128 else [value % 128 + 128, *one(value // 128)]

    assert list(varint(np.array(values, np.int64))) == [byte for value in values for byte in one(value)]


@given(st.lists(st.integers(-(2**31), 2**31 - 1)))
def test_zigzag_interleaves_signs(values: list[int]) -> None:
    unsigned = [2 * value if value >= 0 else -2 * value - 1 for value in values]
    assert zigzag(np.array(values, np.int64)) == varint(np.array(unsigned, np.int64))


def test_a_coordinate_far_away_stays_within_reach() -> None:
    plan = random_plan(3, pressure=False)
    far = plan.points.copy()
    far[0], far[1] = 1e7, -1e7  # a start and its control point
    found = decode(*encode(replace(plan, points=far, width=0.01, height=0.01)))
    assert found["strokes"][0][0] == (REACH, REACH)
    assert found["strokes"][0][1] == pytest.approx((-REACH, -REACH), abs=1)


def test_a_width_of_many_digits_keeps_four() -> None:
    plan = replace(random_plan(2, pressure=False), widths=np.array([1.23456, 1.23461]))
    assert encode(plan)[0]["widths"] == [1.235]


def test_a_plan_without_strokes_has_empty_columns() -> None:
    plan = random_plan(3, pressure=False)
    empty = replace(
        plan, points=plan.points[:0], starts=plan.starts[:1], widths=plan.widths[:0], colors=plan.colors[:0], layers=()
    )
    header, data = encode(empty)
    assert (header["strokes"], header["layers"], zlib.decompress(data)) == (0, [], b"")


def test_columns_are_far_smaller_than_the_strokes_file(small_plan: StrokePlan) -> None:
    _, data = encode(small_plan)
    file = formats.writer("x.json.gz").encode(small_plan, ExportOptions())
    assert len(data) < 0.75 * len(file)
