"""What a machine would do with a program, in words and figures: for info, for exports, and for a dry run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strokeplan.plotter.estimate import estimate
from strokeplan.plotter.program import Program

OFF_PAGE_MM = 0.05
"""Rounding, and the tolerance of lines, are no reason to speak of."""


def bounds(program: Program) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and largest x and y (2,) that the lines reach, in mm of the machine, within its tolerance."""
    points, _ = program.polylines
    return points.min(axis=0), points.max(axis=0)


def report(program: Program) -> list[tuple[str, str]]:
    """The machine, how the page lies in it, where the pen goes, how long it takes: (name, text) rows for people."""
    least, most = bounds(program)
    (left, low), (right, high) = least, most
    beyond = _beyond(program, least, most)
    pens = [f"{pen.name} in {pen.slot}" for pen in program.pens]
    shown = [*pens[:12], f"{len(pens) - 12} more"] if len(pens) > 12 else pens
    return [
        ("machine", program.profile.description),
        ("page", program.transform.describe()),
        ("bounds", f"the pen draws within X {left:.2f}..{right:.2f}, Y {low:.2f}..{high:.2f} mm{beyond}"),
        *([("pens", ", ".join(shown))] if len(pens) > 1 else []),
        *estimate(program).rows(),
    ]


def _beyond(program: Program, least: NDArray[np.float64], most: NDArray[np.float64]) -> str:
    """By how much the drawing, which reaches from `least` to `most`, leaves its sheet, if it does."""
    page = program.transform.page
    corners = program.transform.points(np.array([[0.0, 0.0], [page.width_mm, page.height_mm]]))
    beyond = float(np.maximum(corners.min(axis=0) - least, most - corners.max(axis=0)).max())
    return f": {beyond:.2f} mm beyond the page; --clip cuts it" if beyond > OFF_PAGE_MM else ""
