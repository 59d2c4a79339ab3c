"""What a machine draws, in its own coordinates and order: lines between two moves of the pen, and its pens.

A plan is laid on its page, its strokes are put in order within each layer and pen (or stay as they are: wet paint),
strokes that meet become one line, closed by a straight bridge where a small gap is left. A Program holds these lines
as columns; dialects write them, `estimate` says how long they take. Everything is checked here, before a byte
is written: that the page fits, that every line stays within the travel, that there is a place for every pen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from strokeplan.curves import flatten_all, simplify
from strokeplan.errors import PlotError
from strokeplan.formats.json import hex_colors
from strokeplan.plotter.layout import FIT, LayoutOptions, lay_out
from strokeplan.plotter.machine import PageTransform, page_transform
from strokeplan.plotter.motion import Limits
from strokeplan.plotter.order import Tour, keep_order, merge, order
from strokeplan.plotter.profile import PenSettings, Profile
from strokeplan.plotter.tools import Brush, Carousel, ZPen
from strokeplan.strokes import StrokePlan

LIFT_MM = 20.0
"""What lifting and lowering the pen counts as, in mm of travel, when strokes are put in order."""
ONE_PEN = "pen"


@dataclass(frozen=True, slots=True)
class PlotOptions:
    """What is asked of a program.

    layout      where the picture lies on its page.
    by_colour   a pen for every colour of the plan, where it names no pens itself.
    keep_order  strokes are drawn as they come.
    slots       where pens are in the machine, by name; all pens named must be used.
    """

    layout: LayoutOptions = FIT
    by_colour: bool = False
    keep_order: bool = False
    slots: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True)
class JobPen:
    """A pen that a program draws with; `settings` are the profile's for it."""

    name: str
    slot: int
    settings: PenSettings


@dataclass(frozen=True, eq=False)
class Program:
    """m lines in the order of drawing, in mm of the machine.

    points   (p, 2) chains of cubics, one line after the other; starts (m + 1,).
    radii    (q,) half the width in mm at each on-curve point.
    pen      (m,) index into pens; layer (m,) index into layers, names of the plan's.
    strokes  how many strokes of the plan the lines hold.
    title    what was drawn.
    """

    profile: Profile
    transform: PageTransform
    points: NDArray[np.float64]
    starts: NDArray[np.int64]
    radii: NDArray[np.float64]
    pen: NDArray[np.int64]
    layer: NDArray[np.int64]
    pens: tuple[JobPen, ...]
    layers: tuple[str, ...]
    strokes: int
    title: str

    def __len__(self) -> int:
        return len(self.pen)

    def line(self, j: int) -> NDArray[np.float64]:
        """The (3k + 1, 2) chain of line j."""
        return self.points[self.starts[j] : self.starts[j + 1]]

    @cached_property
    def polylines(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Vertices (v, 2) and starts (m + 1,): the lines within the profile's tolerance, with few vertices."""
        half = self.profile.tolerance_mm / 2
        vertices, begins = flatten_all(self.points, self.starts, half)
        lines = [simplify(vertices[a:b], half) for a, b in zip(begins[:-1].tolist(), begins[1:].tolist(), strict=True)]
        return np.concatenate(lines), np.cumsum([0, *(len(line) for line in lines)], dtype=np.int64)

    @property
    def feeds(self) -> NDArray[np.float64]:
        """(m,) mm/min of each line."""
        usual = self.profile.speeds.draw_mm_min
        return np.array([pen.settings.draw_mm_min or usual for pen in self.pens])[self.pen]

    @property
    def changes(self) -> list[int]:
        """The lines before which another pen is taken, the first one included."""
        return [0, *(np.flatnonzero(np.diff(self.pen)) + 1).tolist()]

    def only(self, pen: int) -> Program:
        """The lines of one pen."""
        kept = self.part(np.flatnonzero(self.pen == pen))
        title = f"{self.title}, {self.pens[pen].name}"
        return replace(kept, pen=np.zeros(len(kept), np.int64), pens=(self.pens[pen],), title=title)

    def part(self, keep: NDArray[np.int64]) -> Program:
        """The lines of some indices (k,), in that order."""
        knots = (self.starts + 2 * np.arange(len(self) + 1)) // 3
        return replace(
            self,
            points=np.concatenate([self.line(j) for j in keep.tolist()]),
            starts=np.concatenate([[0], np.cumsum(np.diff(self.starts)[keep])]),
            radii=np.concatenate([self.radii[knots[j] : knots[j + 1]] for j in keep.tolist()]),
            pen=self.pen[keep],
            layer=self.layer[keep],
        )


def limits(profile: Profile) -> Limits:
    """What motion.plan needs of a profile: travels are as fast as the axes allow and the profile asks."""
    speeds = profile.speeds
    first, second = (min(rate, speeds.travel_mm_min) for rate in speeds.rate_mm_min)
    return Limits(
        rate=(first, second),
        acceleration=speeds.acceleration_mm_s2,
        junction_deviation=speeds.junction_deviation_mm,
        lookahead=speeds.lookahead_blocks,
        steps_mm=speeds.steps_mm,
        kinematics=profile.machine.kinematics,
    )


def program(plan: StrokePlan, profile: Profile, options: PlotOptions | None = None) -> Program:
    """The program that draws a plan with the machine of a profile. Raises PlotError, which names what does not fit."""
    options = options or PlotOptions()
    laid, page = lay_out(plan, options.layout, profile.tolerance_mm / 2)
    transform = page_transform(page, profile)
    chains = transform.points(laid.points)
    _check_travel(chains, laid, transform, profile)
    pens, pen = _pens(laid, profile, options)
    layer = np.repeat(np.arange(len(laid.layers)), [item.last - item.first for item in laid.layers])
    tour, lines = _order(chains, laid, np.stack([layer, pen], axis=1), profile, options)
    firsts = tour.index[lines[:-1]]
    rows, starts = _rows(laid, tour, lines)
    knots, _ = _knot_rows(laid, tour)
    return Program(
        profile=profile,
        transform=transform,
        points=_bridged(chains, rows, starts),
        starts=starts,
        radii=_radii(laid)[knots],
        pen=pen[firsts],
        layer=layer[firsts],
        pens=pens,
        layers=tuple(item.name for item in laid.layers),
        strokes=len(laid),
        title=plan.source.name if plan.source else "drawing",
    )


def _check_travel(chains: NDArray[np.float64], plan: StrokePlan, transform: PageTransform, profile: Profile) -> None:
    """Raise PlotError for the stroke that goes furthest beyond the machine's travel."""
    if not np.any(transform.outside(chains)):  # a curve lies within its control points
        return
    vertices, begins = flatten_all(chains, plan.starts, profile.tolerance_mm / 2)
    beyond = transform.outside(vertices)
    worst = int(beyond.argmax())
    if beyond[worst] > 0:
        stroke = int(np.searchsorted(begins, worst, "right")) - 1
        layer = next(item.name for item in plan.layers if item.first <= stroke < item.last)
        x, y = vertices[worst]
        count = len(np.unique(np.searchsorted(begins, np.flatnonzero(beyond), "right")))
        raise PlotError(
            f"stroke {stroke + 1} (layer {layer!r}) goes to X{x:.2f} Y{y:.2f}, {beyond[worst]:.2f} mm beyond the "
            f"travel of {profile.name}, {transform.travel}; {count:,} of {len(plan):,} strokes leave it; "
            "take a wider --margin, a smaller --page, or --clip"
        )


def _pens(plan: StrokePlan, profile: Profile, options: PlotOptions) -> tuple[tuple[JobPen, ...], NDArray[np.int64]]:
    """The pens in the order in which they first draw, and (n,) which of them each stroke takes."""
    if plan.pens is not None:
        names = [name or ONE_PEN for name in plan.pens]
    else:
        names = hex_colors(plan.colors) if options.by_colour else [ONE_PEN] * len(plan)
    used = list(dict.fromkeys(names))
    slots = dict(options.slots)
    for name in slots:
        if name not in used:
            raise PlotError(f"pen {name!r} is used by no stroke; the plan's pens are {', '.join(used[:20])}")
        if list(slots.values()).count(slots[name]) > 1:
            raise PlotError(f"slot {slots[name]} is given to two pens; each needs its own")
    settings = {item.name: item for item in profile.pens}
    pens: list[JobPen] = []
    for name in used:
        found = settings.get(name, PenSettings(name=name))
        taken = set(slots.values()) | {pen.slot for pen in pens}
        slot = slots.get(name) or found.slot or next(k for k in range(1, len(used) + 100) if k not in taken)
        pens.append(JobPen(name, slot, found))
    room = profile.tool.pens if isinstance(profile.tool, Carousel) else None
    if room is not None and max(pen.slot for pen in pens) > room:
        raise PlotError(f"{len(pens)} pens, up to slot {max(pen.slot for pen in pens)}: {profile.name} holds {room}")
    index = {name: k for k, name in enumerate(used)}
    return tuple(pens), np.array([index[name] for name in names], np.int64)


def _order(
    chains: NDArray[np.float64], plan: StrokePlan, member: NDArray[np.int64], profile: Profile, options: PlotOptions
) -> tuple[Tour, NDArray[np.int64]]:
    """The tour through all strokes, and where its lines begin. A pen draws all of its layers before the next one."""
    ends = np.stack([chains[plan.starts[:-1]], chains[plan.starts[1:] - 1]], axis=1)
    kept = options.keep_order or isinstance(profile.tool, Brush)
    if not kept:
        member = member[:, ::-1]
    _, group = np.unique(member, axis=0, return_inverse=True)
    group = group.reshape(-1)
    if kept:
        tour = keep_order(ends, tolerance=profile.join_mm, lift=LIFT_MM)
        return tour, merge(ends, tour, group, tolerance=0.0 if isinstance(profile.tool, Brush) else profile.join_mm)
    ranked = np.argsort(group, kind="stable")  # order() takes groups as they first appear
    tour = order(ends[ranked], group[ranked], tolerance=profile.join_mm, lift=LIFT_MM)
    tour = Tour(ranked[tour.index], tour.reversed)
    return tour, merge(ends, tour, group, tolerance=profile.join_mm)


def _rows(plan: StrokePlan, tour: Tour, lines: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the plan's points in the order of drawing, −1 for the two handles of a bridge; where lines begin."""
    counts = plan.counts[tour.index]
    joined = np.ones(len(counts), np.bool_)
    joined[lines[:-1]] = False
    room = counts + 2 * joined
    ends = np.cumsum(room)
    rows = np.full(int(ends[-1]), -1, np.int64)
    own = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    back = np.repeat(tour.reversed, counts)
    first = np.repeat(plan.starts[tour.index], counts)
    at = np.repeat(ends - counts, counts) + own
    rows[at] = np.where(back, first + np.repeat(counts, counts) - 1 - own, first + own)
    return rows, np.concatenate([[0], ends[lines[1:] - 1]])


def _knot_rows(plan: StrokePlan, tour: Tour) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of what the plan has at on-curve points, in the order of drawing."""
    counts = plan.knots[tour.index]
    own = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    first = np.repeat(plan.first_knots[tour.index], counts)
    back = np.repeat(tour.reversed, counts)
    return np.where(back, first + np.repeat(counts, counts) - 1 - own, first + own), counts


def _bridged(chains: NDArray[np.float64], rows: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.float64]:
    """The points of `rows`; a gap between two strokes of a line is a straight cubic."""
    points = chains[rows]
    gaps = np.flatnonzero(rows < 0)[::2]
    before, after = points[gaps - 1], points[gaps + 2]
    points[gaps], points[gaps + 1] = (2 * before + after) / 3, (before + 2 * after) / 3
    return points


def _radii(plan: StrokePlan) -> NDArray[np.float64]:
    half = np.repeat(0.5 * plan.widths, plan.knots)
    return half if plan.pressures is None else half * np.where(np.isnan(plan.pressures), 1.0, plan.pressures)


def pen_moves_s(profile: Profile) -> tuple[float, float]:
    """Seconds for which the machine stands while the pen goes down, and up."""
    tool = profile.tool
    way = 0.0
    if isinstance(tool, ZPen):
        way = abs(tool.up_mm - tool.down_mm) / tool.rate_mm_min * 60
    if isinstance(tool, Brush):
        way = abs(tool.safe_mm - tool.touch_mm) / tool.rate_mm_min * 60
    return tool.lower_s + way, tool.raise_s + way
