"""One stroke tried: the stretch of the tract through a seed that gains most, fitted, measured, and kept or not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import footprint
from strokeplan.curves import Scratch, fit, rdp, scratch
from strokeplan.jit import inlined, leaf
from strokeplan.painting import BEND_WIDTHS, Brush
from strokeplan.pursuit.cells import Strip
from strokeplan.pursuit.colours import pixel
from strokeplan.pursuit.scene import EVEN, LANE, NEAR, Kept, Rules, Scene, Tally, gain_of, lay
from strokeplan.tractography import Course, depart, splitmix64, tract_capacity, travel

SECTIONS = 12
"""Stretches of a tract begin and end at this many of its points at most; all pairs are compared."""
ACROSS = 8
"""Pixels sampled across a tract to choose a stretch, at most: wide brushes are sampled coarsely."""
FIRST_LOOK = 0.3
"""Part of a stroke's length that is followed at first: most seeds are given up then, or found to need no more."""
HOPE = 0.3
"""Part of the gain asked for that the first look must promise, to be followed further."""
ESTIMATE = 0.8
"""Stretches whose sampled gain falls below this part of what is asked for are not fitted and measured."""
NARROWEST, WIDEST = 0.5, 2.0
"""Bounds of a stroke's width in widths of its brush, where importance varies it."""
TEST_DISTANCE = 0.5
"""Evenly spaced tracts end this near to another, in separations (Jobard and Lefer's d_test)."""


class Easel(NamedTuple):
    """Room to work on one stroke."""

    tract: NDArray[np.float64]
    vertices: NDArray[np.float64]
    chain: NDArray[np.float64]
    sums: NDArray[np.float64]
    pixels: NDArray[np.int32]
    spans: NDArray[np.int32]
    room: Scratch


def widest(brush: Brush, rules: Rules) -> float:
    """Width of the widest stroke of a brush."""
    return brush.width * (WIDEST if rules.vary_width else 1.0)


def set_up(scene: Scene, brush: Brush, rules: Rules) -> Easel:
    """Room for the longest and widest stroke of a brush."""
    capacity = tract_capacity(brush.length)
    width = widest(brush, rules)
    room = int((2 * brush.length + 2 * width + 64) * (max(width, 2 * rules.separation) + 4))
    return Easel(
        np.empty((capacity, 2)), np.empty((capacity, 2)), np.empty((3 * capacity + 1, 2)), np.zeros((capacity + 1, 6)),
        np.empty((room, 2), np.int32), np.full((len(scene.photo), 3), -1, np.int32), scratch(capacity),
    )  # fmt: skip


@leaf
def try_stroke(
    scene: Scene,
    brush: Brush,
    rules: Rules,
    strip: Strip,
    easel: Easel,
    kept: Kept,
    tally: Tally,
    i: int,
    j: int,
    dab: bool,
) -> None:
    """Keep the stroke through pixel (i, j) if it is worth it; `dab`: the shortest there is, whatever it is worth."""
    rows, columns = scene.photo.shape
    tract, chain = easel.tract, easel.chain
    mark = strip.first_mark + 3 * tally.tries[0]
    tally.tries[0] += 1
    width = brush.width
    if rules.vary_width:
        width *= min(max(1.0 / np.sqrt(scene.weight[i, j]), NARROWEST), WIDEST)
    thick = _thinner(width, rules.spare) if rules.cover else width
    if dab:
        tract[0, 0], tract[0, 1] = j + 0.5 - 0.1 * width, i + 0.5
        tract[1, 0], tract[1, 1] = j + 0.5 + 0.1 * width, i + 0.5
        first, last = 0, 2
    else:
        first, last = 0, 0
        course = Course(
            scene.samples, scene.scale, columns, rows, brush.coherence, brush.step_tolerance, brush.max_step,
            brush.aligned, brush.wander, BEND_WIDTHS * brush.width,
            splitmix64(scene.key, np.uint64(i * columns + j)),
        )  # fmt: skip
        reach = brush.length * (0.5 if brush.both_ways else 1.0)
        ahead, back = depart(course, j + 0.5, i + 0.5, brush.both_ways, tract)
        for look in range(2) if rules.by_gain else range(1, 2):
            part = FIRST_LOOK if look == 0 else 1.0
            first, last, ahead, back = travel(course, ahead, back, part * reach, tract)
            first, last = _within_bounds(scene, rules, tract, first, last)
            if rules.by_gain and last - first > 1:
                begin, end = first, last
                first, last, estimate = _best_stretch(scene, tract, first, last, thick, easel.sums)
                ends_inside = begin < first and last < end
                if estimate < rules.gain * (ESTIMATE if look == 1 or ends_inside else HOPE):
                    return
                if ends_inside:
                    break
        if _length(tract, first, last) < brush.min_length:
            return
    n = rdp(tract, first, last, brush.simplify_tolerance, easel.vertices, easel.room) if last - first > 1 else 0
    if n < (2 if dab else brush.min_vertices):
        return
    pieces = fit(easel.vertices, n, brush.fit_tolerance, brush.bounded, chain, 0, easel.room)
    covered = footprint(scene.stamp, mark, easel.spans, chain, 0, pieces, thick, brush.round_cap, easel.pixels)
    gain, colour = gain_of(scene, easel.pixels, covered)
    if covered == 0 or (rules.by_gain and not dab and gain < rules.gain):
        return
    lay(scene, easel.pixels, covered, strip.first_id + tally.strokes[0], colour)
    if rules.seeding == EVEN:
        for k, lane, distance in ((1, NEAR, TEST_DISTANCE * rules.separation), (2, LANE, rules.separation)):
            marked = footprint(scene.stamp, mark + k, easel.spans, chain, 0, pieces, 2.0 * distance, True, easel.pixels)
            for p in range(marked):
                scene.lanes[easel.pixels[p, 0], easel.pixels[p, 1]] |= lane
    n, used = tally.strokes[0], tally.points[0]
    for k in range(3 * pieces + 1):
        kept.points[used + k, 0], kept.points[used + k, 1] = chain[k, 0], chain[k, 1]
    kept.counts[n], kept.widths[n], kept.colours[n] = 3 * pieces + 1, width, colour
    tally.strokes[0] += 1
    tally.points[0] += 3 * pieces + 1


@leaf
def _thinner(width: float, spare: float) -> float:
    """The width at which a stroke counts as covering, see Rules.spare."""
    return max(width - spare, 0.5 * width)


@leaf
def _within_bounds(scene: Scene, rules: Rules, tract: NDArray[np.float64], first: int, last: int) -> tuple[int, int]:
    """The stretch of tract[first:last] around its seed that stays in one region and clear of evenly spaced strokes."""
    if scene.regions.size == 1 and rules.seeding != EVEN:
        return first, last
    seed = len(tract) // 2
    region = _label(scene, tract, seed)
    begin = end = seed
    while begin > first and _label(scene, tract, begin - 1) == region:
        begin -= 1
    while end + 1 < last and _label(scene, tract, end + 1) == region:
        end += 1
    return begin, end + 1


@leaf
def _label(scene: Scene, tract: NDArray[np.float64], k: int) -> int:
    """The region of a point of a tract; −1 if it is too near to a stroke that it must not approach."""
    rows, columns = scene.photo.shape
    i = min(max(int(tract[k, 1]), 0), rows - 1)
    j = min(max(int(tract[k, 0]), 0), columns - 1)
    if scene.lanes.size > 1 and scene.lanes[i, j] & NEAR:
        return -1
    return int(scene.regions[i, j]) if scene.regions.size > 1 else 0


@leaf
def _length(points: NDArray[np.float64], first: int, last: int) -> float:
    """Of the polyline points[first:last]."""
    length = 0.0
    for k in range(first + 1, last):
        length += np.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
    return length


@inlined
def _best_stretch(
    scene: Scene, tract: NDArray[np.float64], first: int, last: int, width: float, sums: NDArray[np.float64]
) -> tuple[int, int, float]:
    """The stretch of tract[first:last] whose stroke would gain most, as (first, last), and what it would gain.

    Sections across the tract are sampled once; their running sums give the gain of any stretch at once
    (round ends, and limits to the choice of colour, left out).
    """
    photo, weight, error = scene.photo, scene.weight, scene.error
    rows, columns = photo.shape
    n = last - first
    spacing = max(1.0, width / ACROSS)
    samples = max(round(width / spacing), 1)
    for k in range(n):
        before, after = first + max(k - 1, 0), first + min(k + 1, n - 1)
        dx, dy = tract[after, 0] - tract[before, 0], tract[after, 1] - tract[before, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        nx, ny = (-dy / distance, dx / distance) if distance > 0.0 else (0.0, 0.0)
        area = 0.5 * distance * spacing
        old = weights = red = green = blue = squares = 0.0
        for s in range(samples):
            across = (s + 0.5 - 0.5 * samples) * spacing
            j = int(np.floor(tract[first + k, 0] + across * nx))
            i = int(np.floor(tract[first + k, 1] + across * ny))
            if 0 <= i < rows and 0 <= j < columns:
                w, r, g, b = pixel(photo, weight, i, j)
                old += error[i, j]
                weights += w
                red += w * r
                green += w * g
                blue += w * b
                squares += w * (r * r + g * g + b * b)
        sums[k + 1, 0] = sums[k, 0] + area * old
        sums[k + 1, 1] = sums[k, 1] + area * weights
        sums[k + 1, 2] = sums[k, 2] + area * red
        sums[k + 1, 3] = sums[k, 3] + area * green
        sums[k + 1, 4] = sums[k, 4] + area * blue
        sums[k + 1, 5] = sums[k, 5] + area * squares
    stride = max((n - 1) // SECTIONS, 1)
    rounding = 1e-9 * sums[n, 5]
    best, best_a, best_b = -np.inf, 0, n - 1
    for a in range(0, n - 1, stride):
        b = a
        while b < n - 1:
            b = min(b + stride, n - 1)
            weights, old = sums[b + 1, 1] - sums[a, 1], sums[b + 1, 0] - sums[a, 0]
            if weights > 0.0 and old > best - rounding:  # it gains no more than all there is
                red, green, blue = sums[b + 1, 2] - sums[a, 2], sums[b + 1, 3] - sums[a, 3], sums[b + 1, 4] - sums[a, 4]
                left = sums[b + 1, 5] - sums[a, 5] - (red * red + green * green + blue * blue) / weights
                gain = old - left
                if gain > best:
                    best, best_a, best_b = gain, a, b
    return first + best_a, first + best_b + 1, best
