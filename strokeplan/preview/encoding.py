"""The strokes of a plan as the page keeps them: a header (JSON values) and compact columns of bytes.

Coordinates are rounded to a grid of GRID steps along the longer side of the canvas. Of a cubic, the way from
its start to its end is kept, and by how much its inner control points miss the thirds of that way: small
numbers, because strokes are nearly straight. Numbers are zigzag varints (seven bits a byte, lowest first, the
eighth set where more follow), column after column, so that deflate finds like beside like. The columns, in
order, of n strokes with c cubics in all:

    cubics      n        varint, cubics of each stroke
    x, y        n each   zigzag, where a stroke starts, from where the one before it does
    dx, dy      c each   zigzag, from the start of a cubic to its end
    x1, y1      c each   zigzag, first control point beyond start + ⌊d / 3⌋, in double steps
    x2, y2      c each   zigzag, second control point beyond end − ⌊d / 3⌋, in double steps
    width       n        varint, index into the header's "widths"
    g, r, b     n each   one byte, green, red − green, blue − green (modulo 256)
    pressed     n        one byte, 1 for a stroke with pressure         only if the header's "pressure" is true
    pressure    q        zigzag of 0…255 at every on-curve point of those strokes, from the point before; likewise
    pen         n        varint, 0 for none, else 1 + index into the header's "pens"; only if there are any
    done        n        varint, hundredths of a second until a line is drawn, from the one before; only of a plot

Known limits: widths keep four digits; a coordinate further from the origin than REACH steps is moved there;
the direction of a flat brush is left out.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from strokeplan.strokes import StrokePlan, rgb_to_hex

if TYPE_CHECKING:
    from strokeplan.preview.plotting import Plot

VERSION = 1
GRID = 2**14
"""Steps along the longer side of the canvas: 1/16 of a pixel of a photo of 1024."""
REACH = 2**26
"""Differences of two coordinates stay within 32 bits, as zigzag too."""

Ints = NDArray[np.int64]


def encode(plan: StrokePlan, plot: Plot | None = None) -> tuple[dict[str, Any], bytes]:
    """Header and zlib-compressed columns; the same plan gives the same bytes."""
    widths, width_index = _width_table(plan)
    pens = sorted({pen for pen in plan.pens or () if pen is not None})
    step = max(plan.width, plan.height) / GRID
    columns = [varint(plan.counts // 3), *_geometry(plan, step), varint(width_index), *_colors(plan)]
    pressures = plan.pressures if plan.has_pressure.any() else None
    if pressures is not None:
        columns += _pressures(plan, pressures)
    if pens:
        index: dict[str | None, int] = {None: 0, **{pen: i for i, pen in enumerate(pens, start=1)}}
        columns.append(varint(np.array([index[pen] for pen in plan.pens or ()])))
    if plot is not None:
        done = np.rint(100 * plot.done_s).astype(np.int64)
        columns.append(varint(np.diff(done, prepend=np.int64(0))))
    header = {
        "version": VERSION,
        "title": plot.title if plot else plan.source.name if plan.source else "strokeplan",
        "width": plan.width,
        "height": plan.height,
        "unit": "px" if plot is None else "mm",
        "step": step,
        "background": rgb_to_hex(plan.background),
        "strokes": len(plan),
        "cubics": plan.cubics,
        "layers": [
            {"name": layer.name, "first": layer.first, "last": layer.last, "medium": layer.medium, "cap": layer.cap}
            for layer in plan.layers
        ],
        "widths": widths,
        "pressure": pressures is not None,
        "pens": pens,
        "plot": None if plot is None else plot.header(),
    }
    return header, zlib.compress(b"".join(columns), 9)


def varint(values: Ints) -> bytes:
    """Values of 0 … 2³² − 1, seven bits a byte, lowest first, the eighth bit set where more follow."""
    sizes = 1 + np.searchsorted(1 << np.array([7, 14, 21, 28]), values, side="right")
    at = np.cumsum(sizes) - sizes
    out = np.empty(int(np.sum(sizes)), np.uint8)
    for k in range(5):
        more = sizes > k
        out[at[more] + k] = (values[more] >> 7 * k & 127) | (sizes[more] > k + 1) << 7
    return out.tobytes()


def zigzag(values: Ints) -> bytes:
    """Signed values as varints: 0, −1, 1, −2, … become 0, 1, 2, 3, …"""
    return varint(np.where(values < 0, -2 * values - 1, 2 * values))


def _geometry(plan: StrokePlan, step: float) -> list[bytes]:
    grid = np.clip(np.rint(plan.points / step), -REACH, REACH).astype(np.int64)
    begins = grid[plan.starts[:-1]]
    starts = np.delete(np.arange(len(grid)), plan.starts[1:] - 1).reshape(-1, 3)[:, 0]  # the rows 3k, but for ends
    start, end = grid[starts], grid[starts + 3]
    third = (end - start) // 3
    tables = (
        np.diff(begins, axis=0, prepend=np.zeros((1, 2), np.int64)),
        end - start,
        (grid[starts + 1] - start - third + 1) // 2,
        (grid[starts + 2] - end + third + 1) // 2,
    )
    return [zigzag(table[:, axis]) for table in tables for axis in (0, 1)]


def _width_table(plan: StrokePlan) -> tuple[list[float], Ints]:
    exact, index = np.unique(plan.widths, return_inverse=True)
    rounded, merged = np.unique([float(f"{width:.4g}") for width in exact.tolist()], return_inverse=True)
    return rounded.tolist(), merged[index].astype(np.int64)


def _colors(plan: StrokePlan) -> list[bytes]:
    red, green, blue = plan.colors.T
    return [green.tobytes(), (red - green).tobytes(), (blue - green).tobytes()]  # uint8 wraps


def _pressures(plan: StrokePlan, pressures: NDArray[np.float64]) -> list[bytes]:
    pressed = plan.has_pressure
    along = np.repeat(pressed, plan.knots)
    values = np.rint(255 * pressures[along]).astype(np.int64)
    return [pressed.astype(np.uint8).tobytes(), zigzag(np.diff(values, prepend=0))]
