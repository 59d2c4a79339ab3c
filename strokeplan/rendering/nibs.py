"""Brushes without texture, painted by Cairo: the round tip and the flat nib.

Round: a stroke is one stroked path, or with pressure one filled outline. Flat: a stroke is what a rectangle
sweeps that keeps its angle on the page. Between neighbouring points of the flattened curve that is the convex
hull of the two rectangles; all hulls turn the same way, and filled together by the nonzero rule they leave
neither seam nor hole.
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from strokeplan import outlines
from strokeplan.curves import point, subdivisions
from strokeplan.jit import is_cached, kernel
from strokeplan.outlines import FINEST
from strokeplan.rendering.surface import require_cairo
from strokeplan.rendering.tile import Tile
from strokeplan.strokes import StrokePlan

TOLERANCE_PX = 0.05
"""By this much, in pixels of the picture, a painted outline may differ from its stroke; Cairo flattens to 0.1."""
HULL = 8
"""Most corners of the hull of two rectangles."""


class Round(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A round tip: an even line, and with pressure a swelling one."""

    @property
    def reach(self) -> float:
        return 1.0

    @property
    def detail(self) -> float:
        return 1.0

    def compiled(self, plan: StrokePlan) -> bool:
        return plan.pressures is None or outlines.compiled()

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        cairo = require_cairo()
        context = tile.context()
        context.save()  # strokes may be painted on a tile bit by bit
        # A picture may be stretched. Units of the plan, as Cairo takes a stretch that keeps areas for none.
        context.scale(tile.scale_x, tile.scale_y)
        context.set_line_join(cairo.LINE_JOIN_ROUND)
        for layer in plan.layers:
            first, last = np.searchsorted(strokes, (layer.first, layer.last))
            context.set_line_cap(cairo.LINE_CAP_BUTT if layer.cap == "butt" else cairo.LINE_CAP_ROUND)
            _stroke(context, tile, plan, strokes[first:last], round_caps=layer.cap == "round")
        context.restore()


def _stroke(context: Any, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64], *, round_caps: bool) -> None:
    points, starts = tile.points(plan, strokes)
    points /= (tile.scale_x, tile.scale_y)
    tolerance = TOLERANCE_PX / max(tile.scale_x, tile.scale_y)
    flat, ends = points.ravel().tolist(), (2 * starts).tolist()
    widths = plan.widths[strokes].tolist()
    colors = (plan.colors[strokes] / 255).tolist()
    pressed = set(np.flatnonzero(plan.has_pressure[strokes]).tolist())
    move_to, curve_to = context.move_to, context.curve_to
    for i, (width, color) in enumerate(zip(widths, colors, strict=True)):
        context.set_source_rgb(*color)
        begin, end = ends[i], ends[i + 1]
        if i in pressed:
            radii = plan.radii(int(strokes[i]))
            chain = points[begin // 2 : end // 2]
            for x, y in outlines.outline(chain, radii, tolerance, round_caps=round_caps).tolist():
                context.line_to(x, y)
            context.fill()
            continue
        context.set_line_width(width)
        move_to(flat[begin], flat[begin + 1])
        for k in range(begin + 2, end, 6):
            curve_to(*flat[k : k + 6])
        context.stroke()


class Flat(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A flat nib held at one angle, as a calligraphy pen: wide across it, a hairline along it."""

    angle: Annotated[
        Annotated[float, msgspec.Meta(ge=-360, le=360)] | None,
        msgspec.Meta(description="of the nib, degrees from the x axis, clockwise; – as the plan says, or else 45"),
    ] = None
    thickness: Annotated[float, msgspec.Meta(ge=0.01, le=1, description="of the nib, as a part of its length")] = 0.15

    @property
    def reach(self) -> float:
        return float(np.hypot(1.0, self.thickness))

    @property
    def detail(self) -> float:
        return 1.0

    def compiled(self, plan: StrokePlan) -> bool:
        return is_cached(_sweep)

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        context = tile.context()
        points, starts = tile.points(plan, strokes)
        colors = (plan.colors[strokes] / 255).tolist()
        angles = nib_angles(plan, strokes, self.angle, 0.25 * np.pi)
        radii, knots = half_widths(plan, strokes, tile.scale)
        for i, color in enumerate(colors):
            chain, span = points[starts[i] : starts[i + 1]], slice(knots[i], knots[i + 1])
            corners, counts = _sweep(chain, radii[span], angles[span], self.thickness, TOLERANCE_PX)
            flat, at = corners.tolist(), 0
            for count in counts.tolist():
                context.move_to(*flat[at])
                for x, y in flat[at + 1 : at + count]:
                    context.line_to(x, y)
                context.close_path()
                at += count
            context.set_source_rgb(*color)
            context.fill()


def half_widths(
    plan: StrokePlan, strokes: NDArray[np.int64], scale: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Half widths, pressure included, at the on-curve points of some strokes, and where each stroke's start."""
    knots, places = _knots(plan, strokes)
    radii = np.repeat(0.5 * scale * plan.widths[strokes], np.diff(knots))
    if plan.pressures is not None:
        pressures = plan.pressures[places]
        radii *= np.where(np.isnan(pressures), 1.0, pressures)
    return radii, knots


def nib_angles(
    plan: StrokePlan, strokes: NDArray[np.int64], degrees: float | None, otherwise: float
) -> NDArray[np.float64]:
    """Angle of the brush at the on-curve points of some strokes: as set, or the plan's, or `otherwise`."""
    knots, places = _knots(plan, strokes)
    if degrees is not None or plan.angles is None:
        return np.full(knots[-1], otherwise if degrees is None else np.deg2rad(degrees))
    angles = plan.angles[places]
    return np.where(np.isnan(angles), otherwise, angles)


def _knots(plan: StrokePlan, strokes: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where the values of each of some strokes start, once gathered, and where the plan has them."""
    counts = plan.knots[strokes]
    knots = np.concatenate([[0], np.cumsum(counts)])
    return knots, np.repeat(plan.first_knots[:-1][strokes] - knots[:-1], counts) + np.arange(knots[-1])


@kernel
def flattened(
    chain: NDArray[np.float64], radii: NDArray[np.float64], angles: NDArray[np.float64], tolerance: float
) -> NDArray[np.float64]:
    """(n, 4): x, y, half width, angle along a chain of cubics; the angle turns the shorter way."""
    pieces = (len(chain) - 1) // 3
    extent = 0.0
    for k in range(1, len(chain)):
        extent = max(extent, abs(chain[k, 0] - chain[0, 0]), abs(chain[k, 1] - chain[0, 1]))
    tolerance = max(tolerance, FINEST * extent)
    steps = np.empty(pieces, np.int64)
    for k in range(pieces):
        turn = abs(_half_turned(angles[k + 1] - angles[k]))
        steps[k] = max(subdivisions(chain, 3 * k, tolerance), int(np.ceil(8.0 * turn)) if turn > 0.0 else 1)
    out = np.empty((1 + steps.sum(), 4))
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = chain[0, 0], chain[0, 1], radii[0], angles[0]
    n, angle = 1, angles[0]
    for k in range(pieces):
        turn = _half_turned(angles[k + 1] - angles[k])
        for step in range(1, steps[k] + 1):
            t = step / steps[k]
            out[n, 0], out[n, 1] = point(chain, 3 * k, t)
            out[n, 2] = (1.0 - t) * radii[k] + t * radii[k + 1]
            out[n, 3] = angle + t * turn
            n += 1
        angle += turn  # never back by a turn, where the plan's angle goes from π to 0
    return out


@kernel
def _half_turned(angle: float) -> float:
    """The same turn of a brush that has no head, within ±π/2."""
    turned: float = angle - np.pi * np.round(angle / np.pi)
    return turned


@kernel
def _sweep(
    chain: NDArray[np.float64], radii: NDArray[np.float64], angles: NDArray[np.float64], thickness: float,
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:  # fmt: skip
    """Corners of the hulls that a nib sweeps, one after the other, and how many each has."""
    path = flattened(chain, radii, angles, tolerance)
    n = len(path)
    corners, counts = np.empty((HULL * (n - 1), 2)), np.empty(n - 1, np.int64)
    both = np.empty((HULL, 2))
    at = 0
    for k in range(n - 1):
        _nib(path[k], thickness, both, 0)
        _nib(path[k + 1], thickness, both, 4)
        counts[k] = _hull(both, corners, at)
        at += counts[k]
    return corners[:at], counts


@kernel
def _nib(place: NDArray[np.float64], thickness: float, out: NDArray[np.float64], at: int) -> None:
    """The four corners of a nib."""
    ax, ay = place[2] * np.cos(place[3]), place[2] * np.sin(place[3])
    bx, by = -thickness * ay, thickness * ax
    for k in range(4):
        p, q = (1.0 if k in (0, 1) else -1.0), (1.0 if k in (0, 3) else -1.0)
        out[at + k, 0], out[at + k, 1] = place[0] + p * ax + q * bx, place[1] + p * ay + q * by


@kernel
def _hull(points: NDArray[np.float64], out: NDArray[np.float64], at: int) -> int:
    """Andrew's monotone chain: write the hull of a few points to out[at:], return how many corners it has."""
    n = len(points)
    for k in range(1, n):  # few enough to be sorted by insertion
        x, y = points[k, 0], points[k, 1]
        j = k
        while j > 0 and (points[j - 1, 0] > x or (points[j - 1, 0] == x and points[j - 1, 1] > y)):
            points[j] = points[j - 1]
            j -= 1
        points[j, 0], points[j, 1] = x, y
    hull = np.empty((2 * n, 2))
    m, upper = 0, 1
    for k in range(2 * n - 1):
        p = points[k] if k < n else points[2 * n - 2 - k]
        least = 1 if k < n else upper
        while (
            m > least
            and (hull[m - 1, 0] - hull[m - 2, 0]) * (p[1] - hull[m - 2, 1])
            - (hull[m - 1, 1] - hull[m - 2, 1]) * (p[0] - hull[m - 2, 0])
            <= 0.0
        ):
            m -= 1
        hull[m] = p
        m += 1
        if k == n - 1:
            upper = m
    m = max(m - 1, 1)
    for k in range(m):
        out[at + k] = hull[k]
    return m
