"""Strokes kept for what they improve: matching pursuit with brush strokes.

A stroke is tried where the picture is wrong. Of the tract through the seed it takes the stretch that
improves the picture most, in the colour that suits its footprint best, and it is kept if that lowers the
squared error by enough: greedy matching pursuit (S. Mallat, Z. Zhang 1993) over strokes, where the paper
lays one in every cell that differs. What a stroke gains is exact for the pixels of its footprint:

    gain = Σ w·(old error) − Σ w·|photo − colour|²,   colour = Σ w·photo / Σ w

with w the importance of a pixel. After every layer each stroke takes the mean colour of the pixels where
it is still seen; at the end strokes that nobody sees, or would miss less than others cost, are dropped.
A stroke may also be kept for no more than that its cell differs, as in the paper (`Rules.by_gain` off).

The picture is worked in strips along its longer side, wider than a stroke reaches on both sides: every
second strip at the same time, then the others. What a strip gets does not depend on who works it, or when.

    colours ▶ scene ▶ cells ▶ seeding ─┐   which pixel is tried next
                  └─▶ trying ──────────┴─▶ strips    the strokes of one layer
    colours ▶ picture ▶ pruning, closely ▶ finishing, and strips: what changes the picture as a whole
"""

from __future__ import annotations

from strokeplan.pursuit import closely, finishing, pruning, strips
from strokeplan.pursuit.picture import Picture
from strokeplan.pursuit.strips import compiled

__all__ = ["Pursuit", "compiled"]


class Pursuit(Picture):
    """A picture in work, with the stages that change it, each a function of the module that it names."""

    __slots__ = ()

    paint_layer = strips.paint_layer
    prune = pruning.prune
    thin = pruning.thin
    merge = pruning.merge
    limit = pruning.limit
    look_closely = closely.look_closely
    finish = finishing.finish
