"""How a vector file is to be written: one value that goes from whoever asks to whoever writes."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from strokeplan.errors import InputError
from strokeplan.page import Page

MAX_PRECISION = 6
GroupBy = Literal["layer", "colour", "pen"]


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What a writer may be asked for; each at its default is what `plan` writes. Raises InputError.

    precision  decimals of coordinates; None: 2 of a pixel or 3 of a millimetre, more where the canvas is small.
    units      of the coordinates; None: millimetres on a page, else pixels. A pixel is 1/96 of an inch.
    page       the sheet that the picture is centred on; None: the canvas alone.
    group_by   what makes a layer of the file (see grouping.py).
    classes    strokes of a colour share it through a class, rather than each naming it.
    outline    every stroke as its filled outline, not only those of varying width.
    clip       nothing shows outside of the canvas.
    """

    precision: int | None = None
    units: Literal["px", "mm"] | None = None
    page: Page | None = None
    group_by: GroupBy = "layer"
    classes: bool = False
    outline: bool = False
    clip: bool = False

    def __post_init__(self) -> None:
        if self.precision is not None and not 0 <= self.precision <= MAX_PRECISION:
            raise InputError(f"precision {self.precision} is outside 0..{MAX_PRECISION} decimals")
        if self.page is not None and self.units == "px":
            raise InputError("units px on a page: a page is measured in mm; leave out one of the two")

    @property
    def asked(self) -> list[str]:
        """The names of the options that are not at their defaults."""
        return [field.name for field in fields(self) if getattr(self, field.name) != field.default]


DEFAULTS = ExportOptions()
