"""The picture in work: which stroke each pixel shows, and how far it is from the photo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from strokeplan.canvas import Packed, mean_distance
from strokeplan.jit import leaf
from strokeplan.painting import LayerStrokes
from strokeplan.pursuit.colours import add_flat, add_shown, mean_colours, squared_distance
from strokeplan.workers import Workers

Result = TypeVar("Result")

BANDS = 8
"""Parts of a picture that several threads measure, one each at a time."""


@dataclass(slots=True)
class Picture:
    """A picture in work: its error and which stroke each pixel shows.

    weight   (h, w) float32 above 0: how much a pixel's error counts.
    regions  (h, w) int32 labels that tracts do not cross, or (1, 1) for none.
    choice   colours that may be used, by `choices`; empty for all.
    """

    photo: Packed
    weight: NDArray[np.float32]
    regions: NDArray[np.int32]
    choice: NDArray[np.uint32]
    background: int
    round_cap: bool
    error: NDArray[np.float32]
    ids: NDArray[np.int32]
    below: NDArray[np.int32]
    stamp: NDArray[np.int32]
    layers: list[LayerStrokes]
    workers: Workers
    marks: int = 0
    near: list[NDArray[np.uint32]] | None = None
    """What `look_closely` saw in every band, while the strokes that were there then still are what they were."""
    near_strokes: int = 0

    @classmethod
    def begin(
        cls,
        photo: Packed,
        weight: NDArray[np.float32],
        background: int,
        round_cap: bool = True,
        regions: NDArray[np.int32] | None = None,
        choice: NDArray[np.uint32] | None = None,
        workers: Workers | None = None,
    ) -> Self:
        """A bare canvas of one colour 0xRRGGBB."""
        nobody = np.full(photo.shape, -1, np.int32)
        picture = cls(
            photo,
            weight,
            np.zeros((1, 1), np.int32) if regions is None else regions,
            np.empty(0, np.uint32) if choice is None else choice,
            background,
            round_cap,
            error=np.empty(photo.shape, np.float32),
            ids=nobody,
            below=nobody.copy(),
            stamp=nobody.copy(),
            layers=[],
            workers=workers or Workers(),
        )
        picture.measure()
        return picture

    @property
    def strokes(self) -> int:
        """How many there are."""
        return sum(len(layer.counts) for layer in self.layers)

    @property
    def colours(self) -> NDArray[np.uint32]:
        """(n,) packed colours of all strokes."""
        return np.concatenate([np.empty(0, np.uint32), *(layer.colours for layer in self.layers)])

    def total_error(self) -> float:
        """Weighted squared error of the picture as it is."""
        return float(self.error.sum(dtype=np.float64))

    def error_to_beat(self) -> float:
        """`total_error`, but of a bare canvas that of one in the photo's mean colour: nothing is owed to paper."""
        if self.layers:
            return self.total_error()
        sums = np.zeros((len(self.bands()), 5))
        self.by_bands(lambda k, rows: add_flat(self.photo[rows], self.weight[rows], sums[k]))
        total, squares = sums.sum(axis=0)[:4], float(sums[:, 4].sum())
        colour = mean_colours(total[None], np.zeros(1, np.uint32), np.empty(0, np.uint32))[0]
        r, g, b = int(colour >> 16), int(colour >> 8 & 255), int(colour & 255)
        return squares - 2 * float(total[1:] @ (r, g, b)) + (r * r + g * g + b * b) * float(total[0])

    def mean_distance(self) -> float:
        """Mean RGB distance of photo and picture, of a sample of the pixels."""
        return mean_distance(self.photo, self.canvas(), 0, self.photo.shape[0], 0, self.photo.shape[1], 8, 1.0)

    def canvas(self) -> Packed:
        """The picture as it is."""
        return self.with_background()[self.ids]  # a bare pixel's −1 is the last

    def refit(self) -> None:
        """Every stroke takes the mean colour of what it shows; the error follows."""
        sums = np.zeros((len(self.bands()), self.strokes, 4))
        self.by_bands(lambda k, rows: add_shown(self.photo[rows], self.weight[rows], self.ids[rows], sums[k]))
        self.recolour(mean_colours(sums.sum(axis=0), self.colours, self.choice))
        self.measure()

    def bands(self) -> list[slice]:
        """The rows of every band."""
        height = len(self.photo)
        return [slice(height * k // BANDS, height * (k + 1) // BANDS) for k in range(BANDS)]

    def by_bands(self, work: Callable[[int, slice], Result]) -> list[Result]:
        """`work` of the number and the rows of every band, several at a time; what each does depends on no other."""
        return self.workers.run(lambda band: work(*band), list(enumerate(self.bands())))

    def with_background(self) -> NDArray[np.uint32]:
        """(n + 1,) packed colours of all strokes, and of the canvas."""
        return np.append(self.colours, np.uint32(self.background))

    def outlines(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """Points, counts and widths of all strokes."""
        return (
            np.concatenate([layer.points for layer in self.layers]),
            np.concatenate([layer.counts for layer in self.layers]),
            np.concatenate([layer.widths for layer in self.layers]),
        )

    def largest_footprint(
        self, points: NDArray[np.float64], counts: NDArray[np.int64], widths: NDArray[np.float64]
    ) -> NDArray[np.int32]:
        """Room for the pixels of any one of these strokes."""
        if len(counts) == 0:
            return np.empty((0, 2), np.int32)
        # No curve is longer than its control polygon.
        steps = np.append(np.hypot(*np.diff(points, axis=0).T), 0.0)
        steps[np.cumsum(counts) - 1] = 0.0
        lengths = np.add.reduceat(steps, np.cumsum(counts) - counts)
        largest = float(np.max((lengths + widths + 4) * (widths + 4)))
        return np.empty((min(ceil(largest), self.stamp.size), 2), np.int32)

    def leave_out(self, drop: NDArray[np.bool_]) -> None:
        """Take strokes off the layers; what the pixels show is not touched."""
        self.near = None
        for layer, dropped in zip(self.layers, self._by_layer(drop), strict=True):
            layer.points = layer.points[np.repeat(~dropped, layer.counts)]
            layer.counts, layer.widths, layer.colours = (
                column[~dropped] for column in (layer.counts, layer.widths, layer.colours)
            )

    def recolour(self, colours: NDArray[np.uint32]) -> None:
        """Give all strokes these (n,) packed colours; the error is not touched."""
        for layer, own in zip(self.layers, self._by_layer(colours), strict=True):
            layer.colours = own

    def _by_layer(self, column: NDArray[Any]) -> list[NDArray[Any]]:
        return np.split(column, np.cumsum([len(layer.counts) for layer in self.layers])[:-1])

    def measure(self) -> None:
        """Find the error of every pixel anew."""
        colours, background = self.colours, np.uint32(self.background)

        def measure(_: int, rows: slice) -> None:
            _measure_error(self.photo[rows], self.weight[rows], self.ids[rows], colours, background, self.error[rows])

        self.by_bands(measure)


@leaf
def _measure_error(
    photo: Packed,
    weight: NDArray[np.float32],
    ids: NDArray[np.int32],
    colours: NDArray[np.uint32],
    background: np.uint32,
    error: NDArray[np.float32],
) -> None:
    rows, columns = ids.shape
    for i in range(rows):
        for j in range(columns):
            colour = colours[ids[i, j]] if ids[i, j] >= 0 else background
            error[i, j] = weight[i, j] * squared_distance(photo[i, j], colour)
