"""What holds the pen: how it goes up and down, in the units of the machine, and how long that takes."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

Height = Annotated[float, Meta(ge=-1000, le=1000)]
Rate = Annotated[float, Meta(gt=0, le=1e6)]
Seconds = Annotated[float, Meta(ge=0, le=60)]
Length = Annotated[float, Meta(ge=0, le=1000)]
Name = Annotated[str, Meta(pattern=r"^[ -~]{1,80}\Z")]


class _Tool(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    lower_s: Seconds = 0.0
    """How long the machine waits for the pen to come down."""
    raise_s: Seconds = 0.0


class PwmServo(_Tool, frozen=True, kw_only=True, tag="servo"):
    """A servo on the spindle's output: M3 S… down, M5 (or another S) up."""

    down_pwm: Annotated[float, Meta(ge=0, le=1e5)]
    up_pwm: Annotated[float, Meta(ge=0, le=1e5)] | None = None
    """None: M5, the output off."""


class AngleServo(_Tool, frozen=True, kw_only=True, tag="angle-servo"):
    """A servo that Marlin turns: M280 P… S…."""

    index: Annotated[int, Meta(ge=0, le=9)] = 0
    up_deg: Annotated[float, Meta(ge=0, le=360)]
    down_deg: Annotated[float, Meta(ge=0, le=360)]


class ZPen(_Tool, frozen=True, kw_only=True, tag="z"):
    """A pen on the z axis."""

    up_mm: Height
    down_mm: Height
    rate_mm_min: Rate

    def __post_init__(self) -> None:
        if self.up_mm == self.down_mm:
            raise ValueError(f"up_mm = {self.up_mm:g} is where the pen is down, too")


class Carousel(_Tool, frozen=True, kw_only=True, tag="carousel"):
    """A pen plotter of old: PU and PD, and pens that it fetches itself."""

    pens: Annotated[int, Meta(ge=1, le=16)]


class EbbServo(_Tool, frozen=True, kw_only=True, tag="ebb-servo"):
    """The servo of an EiBotBoard; positions in per cent between the two limits, in 83.3 ns of pulse."""

    up_percent: Annotated[float, Meta(ge=0, le=100)]
    down_percent: Annotated[float, Meta(ge=0, le=100)]
    low: Annotated[int, Meta(ge=1, le=65535)]
    high: Annotated[int, Meta(ge=1, le=65535)]
    raise_rate: Annotated[int, Meta(ge=0, le=65535)]
    """Steps of pulse in 24 ms (SC,11)."""
    lower_rate: Annotated[int, Meta(ge=0, le=65535)]
    """SC,12."""
    pin: Annotated[int, Meta(ge=0, le=24)] | None = None
    """The RP pin of a lift that is not on the board's own servo output (S2 rather than SP)."""


class Well(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A pot: of paint, if it has a colour's or a pen's name; of water; or a cloth."""

    at_mm: tuple[Height, Height]
    bottom_mm: Height
    """How deep the brush goes."""
    name: Name | None = None
    stir_mm: Length = 3.0
    """The brush moves to and fro by this."""
    times: Annotated[int, Meta(ge=1, le=50)] = 2


class Brush(_Tool, frozen=True, kw_only=True, tag="brush"):
    """A brush on a z axis: pressed by as much as the stroke is wide, dipped and washed."""

    safe_mm: Height
    """Height at which it travels."""
    touch_mm: Height
    """Height at which its tip touches the paper: a line of `touch_width_mm`."""
    press_mm: Height
    """Height at which it makes a line of `press_width_mm`, and never lower."""
    touch_width_mm: Length
    press_width_mm: Length
    approach_mm: Length = 3.0
    """It comes down along this much of the stroke's beginning, and lifts off along as much of its end."""
    rate_mm_min: Rate
    """Of the height alone, in the air."""
    angle_axis: Annotated[str, Meta(pattern=r"^[ABC]\Z")] | None = None
    """The axis that turns the brush, in degrees."""
    refill_mm: Annotated[float, Meta(gt=0, le=1e6)] | None = None
    """What it paints with one dip; None: it is never dipped."""
    paints: Annotated[tuple[Well, ...], Meta(max_length=99)] = ()
    water: Annotated[tuple[Well, ...], Meta(max_length=9)] = ()
    cloth: Well | None = None
    wash_layers: bool = False
    """Water before every layer, even of the same paint."""

    def __post_init__(self) -> None:
        sign = 1 if self.safe_mm > self.touch_mm else -1
        if self.safe_mm == self.touch_mm or sign * (self.touch_mm - self.press_mm) <= 0:
            raise ValueError(
                f"safe_mm, touch_mm, press_mm = {self.safe_mm:g}, {self.touch_mm:g}, {self.press_mm:g} must go one way"
            )
        if self.touch_width_mm >= self.press_width_mm:
            raise ValueError(f"press_width_mm = {self.press_width_mm:g} must be above touch_width_mm")
        if self.refill_mm is not None and not self.paints:
            raise ValueError("refill_mm needs wells: [[tool.paints]]")

    @property
    def wells(self) -> list[Well]:
        """All pots and the cloth."""
        return [*self.paints, *self.water, *([self.cloth] if self.cloth else [])]

    def check_reach(self, spans: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Raise ValueError for a well that lies outside of the travel of x and y."""
        for well in self.wells:
            for at, (low, high) in zip(well.at_mm, spans, strict=True):
                if not low + well.stir_mm <= at <= high - well.stir_mm:
                    raise ValueError(f"the well at {list(well.at_mm)} with its stir is outside of the machine's travel")


Tool = PwmServo | AngleServo | ZPen | Carousel | EbbServo | Brush
