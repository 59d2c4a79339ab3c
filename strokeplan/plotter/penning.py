"""Which pen draws which stroke: as the plan says, a pen for each colour, or the nearest of the pens that there are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import PlotError
from strokeplan.formats.json import hex_colors
from strokeplan.palette import nearest, photo_palette
from strokeplan.pens import PenSet
from strokeplan.plotter.options import MAX_PENS, PlotOptions
from strokeplan.plotter.profile import PenSettings, Profile
from strokeplan.plotter.tools import Carousel
from strokeplan.strokes import StrokePlan, hex_to_rgb

ONE_PEN = "pen"


@dataclass(frozen=True, slots=True)
class JobPen:
    """A pen that a program draws with; `settings` are the profile's for it, width and colour None if nobody said."""

    name: str
    slot: int
    settings: PenSettings
    width_mm: float | None = None
    color: str | None = None


class Ink(NamedTuple):
    """A pen to choose: its name, its colour, the width of its line if it is known."""

    name: str
    color: str
    width_mm: float | None


def with_nearest(plan: StrokePlan, profile: Profile, options: PlotOptions) -> tuple[StrokePlan, NDArray[np.bool_]]:
    """The plan with the pen nearest to each stroke's colour (CIEDE2000), and (n,) which strokes no pen is to draw.

    A stroke nearer to the paper than to any pen is bare paper. Raises PlotError for a profile without pens of colours.
    """
    inks = inks_of(plan, profile, options)
    if not inks:
        return plan, np.zeros(len(plan), np.bool_)
    colors = [ink.color for ink in inks]
    paper = _paper(options)
    if paper is not None and paper not in colors:
        colors.append(paper)
    palette = np.array([hex_to_rgb(color) for color in colors], np.uint8)
    chosen = nearest(plan.colors, palette)
    which = (chosen[:, None] == palette[None]).all(axis=2).argmax(axis=1)
    names = [*(ink.name for ink in inks), ""]
    bare = which == len(inks)
    return replace(plan, colors=chosen, pens=tuple(names[k] or None for k in which.tolist())), bare


def inks_of(plan: StrokePlan, profile: Profile, options: PlotOptions) -> list[Ink]:
    """The pens to choose from; none if the options name none."""
    asked = options.pens
    if isinstance(asked, PenSet):
        return [Ink(pen.name, pen.color, pen.width_mm) for pen in asked.pens]
    if isinstance(asked, int):
        colors = photo_palette(plan.colors, asked, 0)
        return [Ink(color, color, None) for color in hex_colors(colors)]
    if asked == "profile":
        inks = [Ink(pen.name, pen.color, pen.width_mm) for pen in profile.pens if pen.color is not None]
        if not inks:
            raise PlotError(f"profile {profile.name} has no pen with a color: give its [[pens]] one, or other --pens")
        return inks
    return []


def _paper(options: PlotOptions) -> str | None:
    """The paper that a set of pens is for, or white."""
    return options.pens.paper if isinstance(options.pens, PenSet) else "#ffffff"


def pen_widths(plan: StrokePlan, profile: Profile, options: PlotOptions) -> NDArray[np.float64]:
    """(n,) mm: the width of each stroke's pen; that of the stroke where nobody said."""
    if options.pen_width_mm is not None:
        return np.full(len(plan), options.pen_width_mm)
    known = widths_by_name(plan, profile, options)
    names = plan.pens or (None,) * len(plan)
    return np.array([known.get(name or ONE_PEN, np.nan) for name in names], np.float64)


def widths_by_name(plan: StrokePlan, profile: Profile, options: PlotOptions) -> dict[str, float]:
    """The widths of pens that the options' set, or else the profile, knows."""
    known = {pen.name: pen.width_mm for pen in profile.pens if pen.width_mm is not None}
    known |= {ink.name: ink.width_mm for ink in inks_of(plan, profile, options) if ink.width_mm is not None}
    return known


def job_pens(plan: StrokePlan, profile: Profile, options: PlotOptions) -> tuple[tuple[JobPen, ...], NDArray[np.int64]]:
    """The pens in the order in which they first draw, and (n,) which of them each stroke takes. Raises PlotError."""
    if plan.pens is not None:
        names = [name or ONE_PEN for name in plan.pens]
    else:
        names = hex_colors(plan.colors) if options.by_colour else [ONE_PEN] * len(plan)
    used = list(dict.fromkeys(names))
    if len(used) > MAX_PENS:
        raise PlotError(f"{len(used):,} pens, one for each colour; {MAX_PENS} are the most: try --pens 8, or a set")
    slots = dict(options.slots)
    for name in slots:
        if name not in used:
            raise PlotError(f"pen {name!r} is used by no stroke; the plan's pens are {', '.join(used[:20])}")
        if list(slots.values()).count(slots[name]) > 1:
            raise PlotError(f"slot {slots[name]} is given to two pens; each needs its own")
    settings = {item.name: item for item in profile.pens}
    index = {name: k for k, name in enumerate(used)}
    member = np.array([index[name] for name in names], np.int64)
    colors = hex_colors(plan.colors[np.unique(member, return_index=True)[1]])
    widths = widths_by_name(plan, profile, options)
    pens: list[JobPen] = []
    for name, color in zip(used, colors, strict=True):
        found = settings.get(name, PenSettings(name=name))
        taken = set(slots.values()) | {pen.slot for pen in pens}
        slot = slots.get(name) or found.slot or next(k for k in range(1, len(used) + 100) if k not in taken)
        width = options.pen_width_mm or widths.get(name)
        pens.append(JobPen(name, slot, found, width, None if name == ONE_PEN else color))
    room = profile.tool.pens if isinstance(profile.tool, Carousel) else None
    if room is not None and max(pen.slot for pen in pens) > room:
        raise PlotError(f"{len(pens)} pens, up to slot {max(pen.slot for pen in pens)}: {profile.name} holds {room}")
    return tuple(pens), member
