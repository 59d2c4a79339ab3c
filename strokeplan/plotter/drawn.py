"""What a machine leaves on the paper, as a plan in mm of the page: lines in their order, as wide as their pens.

program ──drawn──▶ StrokePlan ──preview, render, formats──▶ what is seen before anything is plotted
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.plotter.program import Program
from strokeplan.plotter.tools import Brush
from strokeplan.strokes import Layer, StrokePlan, hex_to_rgb

WIDEST_MM = 0.5
"""A pen of unknown width is shown as wide as its line, and no wider than this."""
BLACK = "#000000"


def drawn(program: Program, background: tuple[int, int, int] = (255, 255, 255)) -> StrokePlan:
    """The lines of a program on its page; a layer for each stretch of one pen and one layer of the plan."""
    knots = np.diff(program.starts) // 3 + 1
    firsts = np.cumsum(knots) - knots
    widths = 2 * np.maximum.reduceat(program.radii, firsts)
    pressures = None
    if isinstance(program.profile.tool, Brush):
        pressures = np.clip(2 * program.radii / np.repeat(np.maximum(widths, 1e-9), knots), 0, 1)
    else:
        known = np.array([pen.width_mm or np.nan for pen in program.pens])[program.pen]
        widths = np.where(np.isnan(known), np.minimum(widths, WIDEST_MM), known)
    palette = np.array([hex_to_rgb(pen.color or BLACK) for pen in program.pens], np.uint8)
    page = program.transform.page
    return StrokePlan(
        page.width_mm,
        page.height_mm,
        program.transform.page_points(program.points),
        program.starts.astype(np.int64),
        np.maximum(widths, 1e-6),
        palette[program.pen],
        _layers(program),
        background,
        {"page_mm": [page.width_mm, page.height_mm]},
        pressures=pressures,
        pens=tuple(program.pens[k].name for k in program.pen.tolist()),
    )


def _layers(program: Program) -> tuple[Layer, ...]:
    changes = np.flatnonzero(np.diff(program.pen) | np.diff(program.layer)) + 1
    ends: list[int] = [*changes.tolist(), len(program)]
    return tuple(
        Layer(_name(program, first), first, last, "ink") for first, last in zip([0, *ends[:-1]], ends, strict=True)
    )


def _name(program: Program, line: int) -> str:
    pen, layer = program.pens[int(program.pen[line])].name, program.layers[int(program.layer[line])]
    if len(program.pens) == 1:
        return layer
    return pen if len(program.layers) == 1 or pen == layer else f"{pen}, {layer}"


def home(program: Program) -> NDArray[np.float64]:
    """(2,) where the machine begins, in mm of the page."""
    point: NDArray[np.float64] = program.transform.page_points(np.zeros((1, 2)))[0]
    return point
