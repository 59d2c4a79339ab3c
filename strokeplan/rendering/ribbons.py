"""Textured brushes: bristle, dry, wet and line. A stroke is a ribbon, and paint is a function of the place on it.

For every pixel near a stroke the nearest point of its flattened curve gives a place: arc length along the
curve, offset across it. From these, in units of the stroke's half width, and the stroke's number, each brush
derives how much paint lies there, and how much lighter or darker than the stroke's colour. Detail finer than
a pixel is averaged over samples within it, so that small pictures look as large ones from afar.

With an angle (the plan's, or set) the brush is narrower where it moves along its long axis, and its ends slant.

Known limits: inside a bend tighter than the brush, hairs meet at the bend's axis instead of crossing; a stroke
that crosses itself shows at each place the nearest of its passes.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from strokeplan.jit import is_cached, kernel, leaf
from strokeplan.rendering.nibs import flattened, half_widths, nib_angles
from strokeplan.rendering.noise import chance, noise, smooth
from strokeplan.rendering.tile import Tile, blend
from strokeplan.strokes import StrokePlan
from strokeplan.tractography import splitmix64

FLATNESS_PX = 0.1
"""Distance of the flattened curve from the curve, in pixels."""
NARROWEST = 0.2
"""Width of a brush that moves along its long axis, as a part of the length of that."""
MAX_SAMPLES = 8
"""Samples across a pixel."""
FRAY = 0.5
"""How far hairs and lines begin and end from each other, in half widths."""
CLUMP = 5.0
"""Hairs that stick together."""
GRAIN = 7.0
"""Grains of a dry brush in a half width, across; along the stroke there is a sixth as many."""
RIM = 0.13
"""Where a wet edge has lost most of its darkness, in half widths from it."""
DARKER, LIGHTER = 0.34, 0.28
"""Parts of the way to black and to white that a full tone goes."""
BRISTLE, DRY, WET, LINE = 0, 1, 2, 3

Angle = Annotated[
    Annotated[float, Meta(ge=-360, le=360)] | None,
    Meta(description="of the long axis, degrees from the x axis, clockwise; – as the plan says, or else across"),
]


class _Ribbon(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    @property
    def reach(self) -> float:
        return 1.0 + FRAY

    @property
    def detail(self) -> float:
        return 1.0

    def compiled(self, plan: StrokePlan) -> bool:
        return is_cached(_ribbons)

    def _laid(
        self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64], kind: int, angle: float | None, *values: float
    ) -> None:
        pixels, channels = tile.pixels()
        radii, knots = half_widths(plan, strokes, tile.scale)
        angles = nib_angles(plan, strokes, angle, np.nan)
        butt = np.zeros(len(plan), np.bool_)
        for layer in plan.layers:
            butt[layer.first : layer.last] = layer.cap == "butt"
        _ribbons(
            pixels, channels, tile.left, tile.top, tile.whole_points(plan, strokes), knots, radii, angles,
            0.5 * tile.scale * plan.widths[strokes], plan.colors[strokes], strokes, butt[strokes], kind,
            np.array(values, float),
        )  # fmt: skip
        tile.surface.touched()


class Bristle(_Ribbon, frozen=True, forbid_unknown_fields=True):
    """A brush of hairs, each with its own load: streaks of paint that break up where hairs run dry."""

    hairs: Annotated[int, Meta(ge=2, le=400, description="across the brush")] = 24
    load: Annotated[float, Meta(ge=0, le=1, description="paint in the hairs; 1 never runs dry")] = 0.75
    tone: Annotated[float, Meta(ge=0, le=1, description="how much lighter or darker hairs are than the stroke")] = 0.5
    angle: Angle = None

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        self._laid(tile, plan, strokes, BRISTLE, self.angle, self.hairs, self.load, self.tone)


class Dry(_Ribbon, frozen=True, forbid_unknown_fields=True):
    """A dry brush: paint on the grain of the ground only, less towards the edges and the end."""

    dryness: Annotated[float, Meta(ge=0, le=1, description="how little paint there is")] = 0.5
    tone: Annotated[float, Meta(ge=0, le=1, description="how uneven the colour is")] = 0.3
    angle: Angle = None

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        self._laid(tile, plan, strokes, DRY, self.angle, GRAIN, self.dryness, self.tone)


class Wet(_Ribbon, frozen=True, forbid_unknown_fields=True):
    """A wet brush: a translucent wash that dries dark at its edge."""

    opacity: Annotated[float, Meta(ge=0.05, le=1, description="of the wash inside")] = 0.7
    edge: Annotated[float, Meta(ge=0, le=1, description="how dark the edge dries")] = 0.6
    angle: Angle = None

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        self._laid(tile, plan, strokes, WET, self.angle, 2.0, self.opacity, self.edge)


class Line(_Ribbon, frozen=True, forbid_unknown_fields=True):
    """A bundle of parallel lines, which pressure draws together."""

    lines: Annotated[int, Meta(ge=1, le=200, description="across the brush")] = 5
    fill: Annotated[float, Meta(ge=0.02, le=1, description="width of a line, as a part of their distance")] = 0.45
    jitter: Annotated[float, Meta(ge=0, le=1, description="how unevenly lines lie, begin and end")] = 0.5
    angle: Angle = None

    @property
    def detail(self) -> float:
        return 2.0 / self.lines * min(self.fill, 1.0 - 0.5 * self.fill)

    def paint(self, tile: Tile, plan: StrokePlan, strokes: NDArray[np.int64]) -> None:
        self._laid(tile, plan, strokes, LINE, self.angle, self.lines, self.fill, self.jitter)


@kernel
def _ribbons(
    pixels: NDArray[np.uint8],
    channels: NDArray[np.int64],
    left: int,
    top: int,
    points: NDArray[np.float64],
    knots: NDArray[np.int64],
    radii: NDArray[np.float64],
    angles: NDArray[np.float64],
    sizes: NDArray[np.float64],
    colors: NDArray[np.uint8],
    numbers: NDArray[np.int64],
    butt: NDArray[np.bool_],
    kind: int,
    values: NDArray[np.float64],
) -> None:
    """Paint strokes one after the other into a tile."""
    # Per pixel: squared distance from the curve, arc length, offset, half width there.
    places = np.empty((pixels.shape[0], pixels.shape[1], 4), np.float32)
    color = np.empty(3)
    for i in range(len(sizes)):
        span = slice(knots[i], knots[i + 1])
        first = 3 * knots[i] - 2 * i
        path = flattened(points[first : first + 3 * (knots[i + 1] - knots[i]) - 2], radii[span], angles[span],
                         FLATNESS_PX)  # fmt: skip
        along = np.zeros(len(path))
        for k in range(1, len(path)):
            along[k] = along[k - 1] + np.hypot(path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1])
        ends = (1.0 + FRAY) * sizes[i] + 1.0
        box = _box(path, ends, left, top, pixels.shape[1], pixels.shape[0])
        if box[0] >= box[2] or box[1] >= box[3]:
            continue
        for y in range(box[1], box[3]):
            for x in range(box[0], box[2]):
                places[y, x, 0] = np.inf
        for k in range(len(path) - 1):
            _splat(path, along, k, ends, left, top, box, places)
        for c in range(3):
            color[c] = colors[i, c]
        key = splitmix64(np.uint64(0x5EED), np.uint64(numbers[i]))
        for y in range(box[1], box[3]):
            for x in range(box[0], box[2]):
                if places[y, x, 0] < np.inf:
                    _lay(pixels[y, x], channels, places[y, x], color, key, sizes[i], along[-1], butt[i], kind, values)


@leaf
def _box(
    path: NDArray[np.float64], margin: float, left: int, top: int, columns: int, rows: int
) -> tuple[int, int, int, int]:
    """Pixels of a tile that a path comes near to: first column and row, and those after the last."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for k in range(len(path)):
        low_x, high_x = min(low_x, path[k, 0]), max(high_x, path[k, 0])
        low_y, high_y = min(low_y, path[k, 1]), max(high_y, path[k, 1])
    return (
        int(min(max(np.floor(low_x - margin - left), 0.0), columns)),
        int(min(max(np.floor(low_y - margin - top), 0.0), rows)),
        int(max(min(np.ceil(high_x + margin - left), columns), 0.0)),
        int(max(min(np.ceil(high_y + margin - top), rows), 0.0)),
    )


@leaf
def _splat(
    path: NDArray[np.float64],
    along: NDArray[np.float64],
    k: int,
    ends: float,
    left: int,
    top: int,
    box: tuple[int, int, int, int],
    places: NDArray[np.float32],
) -> None:
    """Give the pixels for which segment k of the path is the nearest so far their place on it."""
    ax, ay, bx, by = path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1]
    length = along[k + 1] - along[k]
    if length == 0.0:
        return
    tx, ty = (bx - ax) / length, (by - ay) / length
    widest = max(path[k, 2], path[k + 1, 2]) + 1.5
    margin = ends if k == 0 or k == len(path) - 2 else widest
    first_x = max(int(np.floor(min(ax, bx) - margin)) - left, box[0])
    last_x = min(int(np.ceil(max(ax, bx) + margin)) - left, box[2])
    first_y = max(int(np.floor(min(ay, by) - margin)) - top, box[1])
    last_y = min(int(np.ceil(max(ay, by) + margin)) - top, box[3])
    for y in range(first_y, last_y):
        dy = y + top + 0.5 - ay
        for x in range(first_x, last_x):
            dx = x + left + 0.5 - ax
            s, offset = dx * tx + dy * ty, dy * tx - dx * ty
            t = min(max(s / length, 0.0), 1.0)
            beyond = s - t * length
            distance2 = beyond * beyond + offset * offset
            if distance2 >= places[y, x, 0]:
                continue
            ending = (beyond < 0.0 and k == 0) or (beyond > 0.0 and k == len(path) - 2)
            if not ending:
                # At a joint all of the distance counts across.
                s, offset = t * length, np.copysign(np.sqrt(distance2), offset)
            half = (1.0 - t) * path[k, 2] + t * path[k + 1, 2]
            angle = (1.0 - t) * path[k, 3] + t * path[k + 1, 3]
            if not np.isnan(angle):
                across, forth = tx * np.sin(angle) - ty * np.cos(angle), tx * np.cos(angle) + ty * np.sin(angle)
                narrow = max(abs(across), NARROWEST)
                s -= offset * forth / np.copysign(narrow, across)
                half *= narrow
            places[y, x, 0], places[y, x, 1] = distance2, along[k] + s
            places[y, x, 2], places[y, x, 3] = offset, half


@leaf
def _lay(
    pixel: NDArray[np.uint8],
    channels: NDArray[np.int64],
    place: NDArray[np.float32],
    color: NDArray[np.float64],
    key: np.uint64,
    size: float,
    length: float,
    butt: bool,
    kind: int,
    values: NDArray[np.float64],
) -> None:
    """Blend the paint of one stroke over one pixel (colours premultiplied)."""
    s, offset, half = float(place[1]), float(place[2]), float(place[3])
    if abs(offset) > half + 1.0 or half <= 0.0:
        return
    # As many samples as see hairs, lines or grains that are thinner than a pixel.
    across = min(max(int(np.ceil((3.0 if kind == LINE else 1.5) * values[0] / half)), 1), MAX_SAMPLES)
    down = min(max(int(np.ceil(2.0 / size)), 1), 3)
    laid, tone = 0.0, 0.0
    for k in range(across):
        u = offset + (k + 0.5) / across - 0.5
        inside = min(max((half - u) * across + 0.5, 0.0), 1.0) - min(max((-half - u) * across + 0.5, 0.0), 1.0)
        if inside <= 0.0:
            continue
        for j in range(down):
            part, shade = _paint(
                key, s + (j + 0.5) / down - 0.5, u, np.sqrt(place[0]), half, size, length, butt, kind, values,
                1.0 / across,
            )  # fmt: skip
            laid += inside * part
            tone += inside * part * shade
    if laid <= 0.0:
        return
    tone /= laid
    laid /= across * down
    to = 255.0 if tone > 0.0 else 0.0
    share = LIGHTER * tone if tone > 0.0 else -DARKER * tone
    blend(pixel, channels, color, to, share, laid)


@leaf
def _paint(
    key: np.uint64,
    s: float,
    u: float,
    distance: float,
    half: float,
    size: float,
    length: float,
    butt: bool,
    kind: int,
    values: NDArray[np.float64],
    step: float,
) -> tuple[float, float]:
    """How much paint lies at a place, 0 to 1, and its tone, −1 to 1."""
    v = min(max(u / half, -1.0), 1.0)
    a, whole = s / size, length / size
    cap = 0.0 if butt else np.sqrt(max(1.0 - v * v, 0.0)) * half / size
    if kind == BRISTLE:
        return _hair(key, a, v, cap, whole, size, values[0], values[1], values[2])
    if kind == DRY:
        return _grain(key, a, v, cap, whole, size, values[1], values[2])
    if kind == WET:
        return _wash(key, a, u, distance, half, whole, size, butt, values[1], values[2])
    return _line(key, a, v, cap, whole, size, half, values[0], values[1], values[2], step)


@leaf
def _within(a: float, first: float, last: float, size: float, soft: float) -> float:
    """1 between two places along the stroke, 0 outside, soft over `soft` half widths or a pixel."""
    width = max(soft * size, 1.0)
    begun = min(max((a - first) * size / width + 0.5, 0.0), 1.0)
    over = min(max((a - last) * size / width + 0.5, 0.0), 1.0)
    return max(begun - over, 0.0)


@leaf
def _hair(
    key: np.uint64, a: float, v: float, cap: float, whole: float, size: float, hairs: float, load: float, tone: float
) -> tuple[float, float]:
    q = 0.5 * (v + 1.0) * hairs
    own, clump = noise(key, q, 0.0), noise(key, q / CLUMP + 71.0, 0.15 * a)
    fray = FRAY * (0.6 * own + 0.4 * clump)
    first, last = fray - cap, whole + cap - fray
    t = min(max(a / max(whole, 1e-9), 0.0), 1.0)
    # The paint that is left, against a grain drawn out along the hair.
    left = 1.2 - (1.0 - load) * (0.2 + 1.3 * t * t) * (0.2 + 2.0 * (0.5 * own + 0.5 * clump))
    grain = noise(key, q + 1009.0, 0.45 * a) * 0.6 + noise(key, q / CLUMP + 2003.0, 0.2 * a) * 0.4
    paint = smooth(left, grain - 0.1, grain + 0.1) * _within(a, first, last, size, 0.08)
    ridge = noise(key, q + 3001.0, 0.08 * a) * 0.6 + clump * 0.4 - 0.5
    return paint, 2.0 * tone * ridge


@leaf
def _grain(
    key: np.uint64, a: float, v: float, cap: float, whole: float, size: float, dryness: float, tone: float
) -> tuple[float, float]:
    coarse = noise(key, 0.5 * GRAIN * v, 0.25 * a)
    fine = noise(key, GRAIN * v + 501.0, GRAIN / 6.0 * a)
    t = min(max(a / max(whole, 1e-9), 0.0), 1.0)
    left = 1.15 - dryness * (0.35 + 0.75 * t + 0.45 * v * v)
    grain = 0.5 * coarse + 0.5 * fine
    fray = FRAY * coarse
    paint = smooth(left, grain - 0.08, grain + 0.08) * _within(a, fray - cap, whole + cap - fray, size, 0.15)
    return paint, 2.0 * tone * (coarse - 0.5)


@leaf
def _wash(
    key: np.uint64, a: float, u: float, distance: float, half: float, whole: float, size: float, butt: bool,
    opacity: float, edge: float,
) -> tuple[float, float]:  # fmt: skip
    side = 11.0 if u < 0.0 else 47.0
    reach = half * (1.0 - 0.14 * noise(key, 1.3 * a, side))
    if butt:
        inwards = min(reach - abs(u), a * size, (whole - a) * size)
    else:
        inwards = reach - (abs(u) if 0.0 <= a <= whole else np.hypot(u, max(-a, a - whole) * size))
    inside = min(max(inwards + 0.5, 0.0), 1.0) if reach > 0.5 else min(max(2.0 * inwards, 0.0), 1.0)
    rim = 1.0 - smooth(inwards / size, 0.0, 2.0 * RIM)
    pool = noise(key, 0.9 * u / size + 5.0, 0.35 * a)
    paint = opacity * (0.8 + 0.4 * (pool - 0.5)) + (1.0 - opacity) * edge * rim
    return min(paint, 1.0) * inside, 0.25 * (0.5 - pool) - 0.9 * edge * rim


@leaf
def _line(
    key: np.uint64, a: float, v: float, cap: float, whole: float, size: float, half: float, lines: float, fill: float,
    jitter: float, step: float,
) -> tuple[float, float]:  # fmt: skip
    q = 0.5 * (v + 1.0) * lines
    number = min(int(q), int(lines) - 1)
    shift = jitter * (1.0 - fill) * (noise(key, number + 31.0, 0.12 * a) - 0.5)
    off = abs(q - number - 0.5 - shift) * 2.0 * half / lines
    thick = fill * half / lines
    paint = min(max((thick - off) / step + 0.5, 0.0), 1.0) - min(max((-thick - off) / step + 0.5, 0.0), 1.0)
    first = jitter * FRAY * chance(key, number, 7) - cap
    last = whole + cap - jitter * FRAY * chance(key, number, 8)
    return paint * _within(a, first, last, size, 0.0), 0.0
