"""All strokes bettered at the same time: descent along the gradient of the squared error by their outlines.

Strokes are opaque, so the error depends on a stroke's outline only where that is seen. If a point of it moves
outwards, pixels there turn from what lies across it to the stroke's own colour. With e the weighted squared distance
of a colour from the photo, the derivative of the error by a number p that shapes the stroke is the integral

    ∂E/∂p = ∫ (e(own colour) − e(colour across)) · (velocity of the outline by p, outwards)  ds

over what is seen of the outline and borders on strokes further below. (Reynolds' transport theorem. Where what lies
across is a stroke further above, the border is that one's outline and stays where it is.) Colours are those that suit
best at all times, so the error does not change with them to first order. A stroke has nine numbers: four points, and
the logarithm of its width. The steps are Adam's (Kingma and Ba 2015): the sizes of gradients say little of how far to
go.

Known limits: a flat end's turning is left out; the integral is a sum over points of the outline, and tells pixels, of
which chords of it are painted: it finds some 5 to 10 % too little.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.jit import inlined, leaf
from strokeplan.searching.stack import Photo, Stack, distance2, show

SPACING = 1.3
"""Between points of an outline that are looked at, in pixels."""
FIRST, SECOND, SMALL = 0.7, 0.9, 1.0
"""Adam's: what is kept of the means of the gradient and of its square from step to step; and what is added to the
root of the latter, far below any gradient that matters."""
FAR, NEAR = 0.03, 0.01
"""The first and the last step of a descent, in parts of the side of a stroke's share."""
GOLDEN = 0.618034
"""From step to step the points looked at are shifted by this part of their distance, so that none is left out."""
TOLD = 8
"""Steps between which progress is told."""


class Momentum(NamedTuple):
    """Of at most m strokes: their gradients (m, 9), and the running means of these and of their squares."""

    gradient: NDArray[np.float64]
    mean: NDArray[np.float64]
    square: NDArray[np.float64]


def at_rest(most: int) -> Momentum:
    return Momentum(*(np.zeros((most, 9)) for _ in range(3)))


def descend(
    photo: Photo, stack: Stack, n: int, steps: int, side: float, finest: float, tell: Callable[[int], None]
) -> float:
    """Better the first n strokes together; return the error. They are left as they were best on the way, and shown
    as they are left.

    side    of a square that is a stroke's share of the canvas, in pixels: steps are in parts of it.
    finest  least width of a stroke.
    tell    is called with the steps done.
    """
    momentum = at_rest(n)
    best = show(photo, stack, n)
    points, widths = stack.points[: 4 * n].copy(), stack.widths[:n].copy()
    for number in range(1, steps + 1):
        if number % TOLD == 0:
            tell(number)
        phase = (0.5 + GOLDEN * (number - 1)) % 1.0
        find_gradient(photo, stack, n, phase, momentum.gradient)
        far = side * FAR * (NEAR / FAR) ** ((number - 1) / steps)
        _step(stack, n, momentum, number, far, finest)
        error = show(photo, stack, n)
        if error < best:
            best = error
            points[:], widths[:] = stack.points[: 4 * n], stack.widths[:n]
    stack.points[: 4 * n], stack.widths[:n] = points, widths
    return show(photo, stack, n)


@leaf
def find_gradient(photo: Photo, stack: Stack, n: int, phase: float, gradient: NDArray[np.float64]) -> None:
    """The derivatives (n, 9) of the error of the picture as it was last shown: by x and y of a stroke's four points,
    and by the logarithm of its width.

    phase  in 0..1: where between the borders of its stretch of the outline each point lies that is looked at.
    """
    for k in range(n):
        for p in range(9):
            gradient[k, p] = 0.0
        if k >= stack.ground:
            radius = 0.5 * stack.widths[k]
            _add_sides(photo, stack, k, radius, phase, gradient)
            for end in range(2):
                if stack.round_cap:
                    _add_round_end(photo, stack, k, radius, end, phase, gradient)
                else:
                    _add_flat_end(photo, stack, k, radius, end, phase, gradient)


@leaf
def _add_sides(photo: Photo, stack: Stack, k: int, radius: float, phase: float, gradient: NDArray[np.float64]) -> None:
    """Both sides: curves at the distance of the radius from the cubic."""
    p, a = stack.points, 4 * k
    x0, y0, x1, y1 = p[a, 0], p[a, 1], p[a + 1, 0], p[a + 1, 1]
    x2, y2, x3, y3 = p[a + 2, 0], p[a + 2, 1], p[a + 3, 0], p[a + 3, 1]
    ux, uy, vx, vy, wx, wy = x1 - x0, y1 - y0, x2 - x1, y2 - y1, x3 - x2, y3 - y2
    length = np.sqrt(ux * ux + uy * uy) + np.sqrt(vx * vx + vy * vy) + np.sqrt(wx * wx + wy * wy)
    pieces = int(np.ceil(length / SPACING))
    gx0 = gy0 = gx1 = gy1 = gx2 = gy2 = gx3 = gy3 = wider = 0.0
    for piece in range(pieces):
        t = (piece + phase) / pieces
        s = 1.0 - t
        b0, b1, b2, b3 = s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t
        dx, dy = 3.0 * (s * s * ux + t * t * wx) + 6.0 * s * t * vx, 3.0 * (s * s * uy + t * t * wy) + 6.0 * s * t * vy
        speed2 = dx * dx + dy * dy
        if speed2 < 1e-9:
            continue
        x, y = b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3, b0 * y0 + b1 * y1 + b2 * y2 + b3 * y3
        ddx, ddy = 6.0 * (s * (vx - ux) + t * (wx - vx)), 6.0 * (s * (vy - uy) + t * (wy - vy))
        turning = (dx * ddy - dy * ddx) / speed2  # radians by t
        speed = np.sqrt(speed2)
        for side in (-1.0, 1.0):
            nx, ny = side * dy / speed, -side * dx / speed
            # What is on the inner side of a bend narrower than the stroke is no outline.
            ds = (speed + side * turning * radius) / pieces
            if ds > 0.0:
                g = ds * _border(photo, stack, k, x + radius * nx, y + radius * ny, nx, ny)
                gx, gy = g * nx, g * ny
                gx0, gy0, gx1, gy1 = gx0 + b0 * gx, gy0 + b0 * gy, gx1 + b1 * gx, gy1 + b1 * gy
                gx2, gy2, gx3, gy3 = gx2 + b2 * gx, gy2 + b2 * gy, gx3 + b3 * gx, gy3 + b3 * gy
                wider += g
    for q, g in enumerate((gx0, gy0, gx1, gy1, gx2, gy2, gx3, gy3, wider * radius)):
        gradient[k, q] += g


@leaf
def _add_round_end(
    photo: Photo, stack: Stack, k: int, radius: float, end: int, phase: float, gradient: NDArray[np.float64]
) -> None:
    """Half a circle around the first or the last point."""
    x, y, ox, oy = _outwards(stack.points, 4 * k, end)
    pieces = int(np.ceil(np.pi * radius / SPACING))
    angle = np.pi / pieces
    cos, sin = np.cos(angle), np.sin(angle)
    # From a right angle to the way out, half a piece on, to the other.
    begin = 0.5 * np.pi - phase * angle
    half_cos, half_sin = np.cos(begin), np.sin(begin)
    nx, ny = half_cos * ox + half_sin * oy, half_cos * oy - half_sin * ox
    gx = gy = wider = 0.0
    for _ in range(pieces):
        g = radius * angle * _border(photo, stack, k, x + radius * nx, y + radius * ny, nx, ny)
        gx, gy, wider = gx + g * nx, gy + g * ny, wider + g
        nx, ny = cos * nx - sin * ny, sin * nx + cos * ny
    gradient[k, 6 * end] += gx
    gradient[k, 6 * end + 1] += gy
    gradient[k, 8] += wider * radius


@leaf
def _add_flat_end(
    photo: Photo, stack: Stack, k: int, radius: float, end: int, phase: float, gradient: NDArray[np.float64]
) -> None:
    """A straight line through the first or the last point, across the way out."""
    x, y, ox, oy = _outwards(stack.points, 4 * k, end)
    pieces = int(np.ceil(2.0 * radius / SPACING))
    for piece in range(pieces):
        across = radius * (2.0 * (piece + phase) / pieces - 1.0)
        g = 2.0 * radius / pieces * _border(photo, stack, k, x - across * oy, y + across * ox, ox, oy)
        gradient[k, 6 * end] += g * ox
        gradient[k, 6 * end + 1] += g * oy


@inlined
def _outwards(points: NDArray[np.float64], a: int, end: int) -> tuple[float, float, float, float]:
    """The first or last point of a cubic, and the unit vector with which the curve leaves it to the outside."""
    at, step = (a, 1) if end == 0 else (a + 3, -1)
    x, y = points[at, 0], points[at, 1]
    for q in range(1, 4):
        dx, dy = x - points[at + q * step, 0], y - points[at + q * step, 1]
        length = np.hypot(dx, dy)
        if length > 1e-9:
            return x, y, dx / length, dy / length
    return x, y, (1.0 if end == 1 else -1.0), 0.0


@inlined
def _border(photo: Photo, stack: Stack, k: int, x: float, y: float, nx: float, ny: float) -> float:
    """What the error grows by, a unit of area, where stroke k grows at a point of its outline with this normal."""
    rows, columns = stack.shown.shape
    # Half a pixel in and out, as seen by the normal: the pixels' centres are then on the two sides of the border. (What
    # is painted are chords, so some are missed in bends. To reach further misses more where strokes are thin.)
    reach = 0.5 * (abs(nx) + abs(ny))
    inner_x, inner_y, outer_x, outer_y = x - reach * nx, y - reach * ny, x + reach * nx, y + reach * ny
    if not (0.0 <= inner_x < columns and 0.0 <= inner_y < rows):
        return 0.0
    if stack.shown[np.uint32(inner_y), np.uint32(inner_x)] != k:
        return 0.0
    if not (0.0 <= outer_x < columns and 0.0 <= outer_y < rows):
        return 0.0
    across = stack.shown[np.uint32(outer_y), np.uint32(outer_x)]
    if across >= k and across != np.uint32(len(stack.widths)):
        return 0.0
    return _difference(photo, stack.colours, k, across, int(y), int(x))


@leaf
def _difference(photo: Photo, colours: NDArray[np.float64], k: int, other: int, i: int, j: int) -> float:
    """How much further colour k is from the photo at a pixel than another."""
    value = np.int64(photo.pixels[i, j])
    return float(photo.weight[i, j]) * (distance2(colours, k, value) - distance2(colours, other, value))


@leaf
def _step(stack: Stack, n: int, momentum: Momentum, number: int, far: float, finest: float) -> None:
    """Move all strokes against their gradients, for the time `number` (1 …): every point and every border by about
    `far` pixels at most."""
    gradient, mean, square = momentum.gradient, momentum.mean, momentum.square
    first, second = 1.0 / (1.0 - FIRST**number), 1.0 / (1.0 - SECOND**number)
    for k in range(stack.ground, n):
        for p in range(9):
            g = gradient[k, p]
            mean[k, p] = FIRST * mean[k, p] + (1.0 - FIRST) * g
            square[k, p] = SECOND * square[k, p] + (1.0 - SECOND) * g * g
            move = far * first * mean[k, p] / (np.sqrt(second * square[k, p]) + SMALL)
            if p < 8:
                stack.points[4 * k + p // 2, p % 2] -= move
            else:
                width = stack.widths[k]
                stack.widths[k] = max(width * np.exp(-min(max(move / width, -0.5), 0.5)), finest)
