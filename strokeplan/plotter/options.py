"""What is asked of a program, beside its plan and its profile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from strokeplan.errors import PlotError
from strokeplan.pens import MAX_WIDTH_MM, MIN_WIDTH_MM, PenSet
from strokeplan.plotter.layout import FIT, LayoutOptions

MAX_PENS = 99
"""No machine has more slots, and nobody changes more pens."""
OwnPens = Literal["profile"]


@dataclass(frozen=True, slots=True)
class PlotOptions:
    """What is asked of a program. Raises PlotError.

    layout       where the picture lies on its page.
    by_colour    a pen for every colour of the plan, where it names no pens itself.
    keep_order   strokes are drawn as they come.
    slots        where pens are in the machine, by name; all pens named must be used.
    strokes      what a stroke of paint becomes: its middle, or as many passes as ink its area.
    hidden       whether what later strokes of paint cover is drawn; None: not if strokes are bundles.
    pens         pens to take by the nearest colour: a set, the profile's own, or so many of the plan's colours.
    pen_width_mm of all pens, whatever these say themselves.
    """

    layout: LayoutOptions = FIT
    by_colour: bool = False
    keep_order: bool = False
    slots: tuple[tuple[str, int], ...] = ()
    strokes: Literal["centre", "bundle"] = "centre"
    hidden: Literal["keep", "remove"] | None = None
    pens: PenSet | OwnPens | int | None = None
    pen_width_mm: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.pens, int) and not 1 <= self.pens <= MAX_PENS:
            raise PlotError(f"pens {self.pens}: the number of pens must lie in 1..{MAX_PENS}")
        if self.pen_width_mm is not None and not MIN_WIDTH_MM <= self.pen_width_mm <= MAX_WIDTH_MM:
            raise PlotError(f"pen width {self.pen_width_mm:g} mm is outside {MIN_WIDTH_MM:g}..{MAX_WIDTH_MM:g} mm")
        if self.by_colour and self.pens is not None:
            raise PlotError("group by colour and pens are two ways to choose pens; leave out one of them")

    @property
    def removes_hidden(self) -> bool:
        """Whether what later strokes cover is left out."""
        return self.hidden == "remove" or (self.hidden is None and self.strokes == "bundle")
