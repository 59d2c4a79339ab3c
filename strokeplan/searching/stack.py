"""The strokes of a search in their order, and the picture that they make: which stroke each pixel shows, and how far
that is from the photo. Every stroke is one cubic, painted opaque, and has the mean colour of the pixels that show it:
the best that it can have.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, footprint, pack, paint_chain, unpack
from strokeplan.jit import inlined, leaf


class Photo(NamedTuple):
    """What is to be painted."""

    pixels: Packed
    weight: NDArray[np.float32]
    """(h, w) above 0: how much a pixel's error counts."""
    squares: float
    """Σ weight · |colour|² of all pixels."""


class Stack(NamedTuple):
    """At most m strokes, bottom to top."""

    points: NDArray[np.float64]
    """(4m, 2): four points of each."""
    widths: NDArray[np.float64]
    colours: NDArray[np.float64]
    """(m + 1, 3): red, green and blue of each, and of the bare canvas."""
    worth: NDArray[np.float64]
    """What the error would grow by without each."""
    sums: NDArray[np.float64]
    """(m + 1, 4): weight, and weighted red, green and blue of the pixels that show each, or the bare canvas."""
    shown: NDArray[np.uint32]
    """(h, w): the stroke that each pixel shows, or m."""
    below: NDArray[np.uint32]
    """(h, w): what it would show without that one."""
    ground: int
    """Strokes at the bottom (0 or 1) that cover the canvas and stay as they are."""
    round_cap: bool


class Room(NamedTuple):
    """To find the pixels of a stroke."""

    stamp: NDArray[np.int32]
    spans: NDArray[np.int32]
    pixels: NDArray[np.int32]
    mark: NDArray[np.int64]
    """(1,): the last on the stamp."""


def room_for(shape: tuple[int, ...]) -> Room:
    rows, columns = shape
    return Room(
        np.zeros(shape, np.int32), np.zeros((rows, 3), np.int32), np.empty((rows * columns, 2), np.int32),
        np.zeros(1, np.int64),
    )  # fmt: skip


def photo_of(pixels: Packed, weight: NDArray[np.float32]) -> Photo:
    return Photo(pixels, weight, _squares(pixels, weight))


def halved(photo: Photo) -> Photo:
    """At half the size: means of 2 × 2 pixels by weight."""
    weight = _by_twos(photo.weight[..., None].astype(np.float64))
    pixels = _by_twos(unpack(photo.pixels).astype(np.float64) * photo.weight[..., None]) / weight
    return photo_of(pack(np.rint(pixels).astype(np.uint8)), weight[..., 0].astype(np.float32))


def _by_twos(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(h, w, c) → sums over 2 × 2 pixels, fewer at the far sides of an odd size."""
    rows, columns = (np.arange(0, size, 2) for size in values.shape[:2])
    return np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)


def empty_stack(most: int, shape: tuple[int, ...], ground: int, background: int, round_cap: bool) -> Stack:
    """Room for so many strokes on a bare canvas of one colour 0xRRGGBB."""
    colours = np.zeros((most + 1, 3))
    colours[most] = background >> 16, background >> 8 & 255, background & 255
    return Stack(
        np.zeros((4 * most, 2)), np.zeros(most), colours, np.empty(most), np.empty((most + 1, 4)),
        np.empty(shape, np.uint32), np.empty(shape, np.uint32), ground, round_cap,
    )  # fmt: skip


@leaf
def show(photo: Photo, stack: Stack, n: int) -> float:
    """Paint the first n strokes in the colours that suit them best; return the weighted squared error."""
    nobody = len(stack.widths)
    rows, columns = stack.shown.shape
    lowest = np.uint32(nobody if stack.ground == 0 else 0)
    for i in range(rows):
        for j in range(columns):
            stack.shown[i, j] = lowest
    for k in range(stack.ground, n):
        paint_chain(stack.shown, stack.points, 4 * k, 1, stack.widths[k], stack.round_cap, np.uint32(k))
    return _suit(photo, stack, n)


@leaf
def _suit(photo: Photo, stack: Stack, n: int) -> float:
    """Give every stroke the mean colour of what shows it; one that nobody sees keeps its own."""
    nobody = len(stack.widths)
    sums, colours = stack.sums, stack.colours
    sums[:] = 0.0
    rows, columns = stack.shown.shape
    for i in range(rows):
        k = stack.shown[i, 0]
        weight = red = green = blue = 0.0
        for j in range(columns):
            w, value = float(photo.weight[i, j]), np.int64(photo.pixels[i, j])
            if stack.shown[i, j] != k:
                _add(sums, k, weight, red, green, blue)
                k = stack.shown[i, j]
                weight = red = green = blue = 0.0
            weight += w
            red += w * (value >> 16)
            green += w * ((value >> 8) & 255)
            blue += w * (value & 255)
        _add(sums, k, weight, red, green, blue)
    for k in range(n):
        if sums[k, 0] > 0.0:
            for c in range(3):
                colours[k, c] = sums[k, c + 1] / sums[k, 0]
    error = photo.squares
    for k in range(nobody + 1):
        for c in range(3):
            error += colours[k, c] * (colours[k, c] * sums[k, 0] - 2.0 * sums[k, c + 1])
    return error


@inlined
def _add(sums: NDArray[np.float64], k: int, weight: float, red: float, green: float, blue: float) -> None:
    sums[k, 0] += weight
    sums[k, 1] += red
    sums[k, 2] += green
    sums[k, 3] += blue


@leaf
def measure(photo: Photo, stack: Stack, error: NDArray[np.float32]) -> None:
    """The weighted squared error of every pixel of the picture as it was last shown."""
    rows, columns = stack.shown.shape
    for i in range(rows):
        for j in range(columns):
            w, value = float(photo.weight[i, j]), np.int64(photo.pixels[i, j])
            error[i, j] = w * distance2(stack.colours, stack.shown[i, j], value)


@leaf
def weigh(photo: Photo, stack: Stack, n: int, room: Room) -> None:
    """Find what each of the n strokes last shown is worth, in the colours that the others have: the ground infinitely
    much."""
    rows, columns = stack.shown.shape
    for i in range(rows):
        for j in range(columns):
            stack.below[i, j] = len(stack.widths)
    for k in range(n):
        covered = cover(room, stack.points, 4 * k, stack.widths[k], stack.round_cap)
        for q in range(covered):
            i, j = room.pixels[q, 0], room.pixels[q, 1]
            if stack.shown[i, j] != k:
                stack.below[i, j] = k
        stack.worth[k] = np.inf if k < stack.ground else 0.0
    for i in range(rows):
        for j in range(columns):
            k, value = stack.shown[i, j], np.int64(photo.pixels[i, j])
            if k < n:
                more = distance2(stack.colours, stack.below[i, j], value) - distance2(stack.colours, k, value)
                stack.worth[k] += photo.weight[i, j] * more


@leaf
def cover(room: Room, points: NDArray[np.float64], at: int, width: float, round_cap: bool) -> int:
    """Write the pixels of a stroke to the room; return how many."""
    room.mark[0] += 1
    return footprint(room.stamp, room.mark[0], room.spans, points, at, 1, width, round_cap, room.pixels)


@inlined
def distance2(colours: NDArray[np.float64], k: int, value: int | np.int64) -> float:
    """Squared distance of colour k from a packed colour."""
    dr, dg, db = colours[k, 0] - (value >> 16), colours[k, 1] - ((value >> 8) & 255), colours[k, 2] - (value & 255)
    return float(dr * dr + dg * dg + db * db)


@leaf
def _squares(pixels: Packed, weight: NDArray[np.float32]) -> float:
    rows, columns = pixels.shape
    total = 0.0
    for i in range(rows):
        for j in range(columns):
            value = np.int64(pixels[i, j])
            r, g, b = value >> 16, (value >> 8) & 255, value & 255
            total += weight[i, j] * float(r * r + g * g + b * b)
    return total
