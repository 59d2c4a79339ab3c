"""From strokes of paint to lines of pens: the nearest pens, bundles or middles, without what later strokes cover.

    with_nearest ──▶ bundled ──▶ uncovered ──▶ without what is bare paper

Everything in millimetres of the page. Strokes of ink are lines of pens already: they stay as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import PlotError
from strokeplan.grouping import reordered
from strokeplan.plotter.cutting import regained
from strokeplan.plotter.options import PlotOptions
from strokeplan.plotter.penning import pen_widths, with_nearest
from strokeplan.plotter.profile import Profile
from strokeplan.strokes import StrokePlan

SHORTEST = 0.5
"""Pieces not longer than this part of a pen's width are left out: specks, each of which would cost a lift."""
UNDER = 0.125
"""How far passes run beneath what covers them, in widths of the pen: no paper shows along the border."""
SMOOTH = 0.05
"""How far the passes of a bundle may stray, in widths of the pen, where the profile's tolerance is finer."""


def pen_lines(plan: StrokePlan, profile: Profile, options: PlotOptions) -> tuple[StrokePlan, float]:
    """What pens draw of a plan in mm, and the gap in mm that a pen may cross without a lift. Raises PlotError."""
    join, tolerance, shortest, grown = profile.join_mm, profile.tolerance_mm / 2, 0.0, 0.0
    plan, bare = with_nearest(plan, profile, options)
    source = np.flatnonzero(~bare)
    lines = replace(reordered(plan, source), layers=regained(plan.layers, source))
    if options.strokes == "bundle" and len(lines):
        from strokeplan.plotter.bundles import bundled

        pen = _pens_mm(lines, profile, options)
        narrowest = float(pen.min())
        lines, of = bundled(lines, pen, max(tolerance, SMOOTH * narrowest))
        source, join = source[of], max(join, narrowest)
        shortest, grown = SHORTEST * narrowest, -UNDER * narrowest
    if options.removes_hidden:
        from strokeplan.plotter.covering import uncovered

        lines, source = uncovered(lines, source, plan, grown, tolerance, shortest)
    if not len(lines):
        raise PlotError("no line is left to draw: everything is bare paper, or covered by later strokes")
    return lines, join


def _pens_mm(plan: StrokePlan, profile: Profile, options: PlotOptions) -> NDArray[np.float64]:
    """(n,) how wide the pen of each stroke is; of ink, the stroke itself. Raises PlotError if nobody said."""
    widths = pen_widths(plan, profile, options)
    paint = np.repeat([k.medium == "paint" for k in plan.layers], [k.last - k.first for k in plan.layers])
    if np.isnan(widths[paint]).any():
        raise PlotError("bundles need the width of the pen: --pen-width 0.5mm, or pens that have one")
    return np.where(paint, widths, plan.widths)
