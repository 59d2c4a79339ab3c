"""What holds the pen: how it goes up and down, in the units of the machine, and how long that takes."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec
from msgspec import Meta

Height = Annotated[float, Meta(ge=-1000, le=1000)]
Rate = Annotated[float, Meta(gt=0, le=1e6)]
Seconds = Annotated[float, Meta(ge=0, le=60)]
Length = Annotated[float, Meta(ge=0, le=1000)]
Percent = Annotated[float, Meta(ge=0, le=100)]
Pulse = Annotated[int, Meta(ge=1, le=65535)]
PulseRate = Annotated[int, Meta(ge=0, le=65535)]
Pin = Annotated[int, Meta(ge=0, le=24)]
Name = Annotated[str, Meta(pattern=r"^[ -~]{1,80}\Z")]
EBB_PIN = 4
"""Where an EiBotBoard's own servo output is among the pins of S2: RP4 is RB1."""
PERIOD_S = 0.024
"""An EiBotBoard's servo gets a pulse in this time, and each is longer than the last by the rate at most."""


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


class _Pulses:
    """Positions of an EiBotBoard's servo as its pulses."""

    __slots__ = ()
    low: int
    high: int
    pin: int | None

    def pulse(self, percent: float) -> int:
        """Its length, in 83.3 ns."""
        return round(self.low + (self.high - self.low) * percent / 100)

    @property
    def servo_pin(self) -> int:
        """The RP pin that it leaves the board by."""
        return EBB_PIN if self.pin is None else self.pin


class EbbServo(_Pulses, _Tool, frozen=True, kw_only=True, tag="ebb-servo"):
    """The servo of an EiBotBoard; positions in per cent between the two limits, in 83.3 ns of pulse."""

    up_percent: Percent
    down_percent: Percent
    low: Pulse
    high: Pulse
    raise_rate: PulseRate
    """Steps of pulse in 24 ms (SC,11)."""
    lower_rate: PulseRate
    """SC,12."""
    pin: Pin | None = None
    """The RP pin of a lift that is not on the board's own servo output (S2 rather than SP)."""


class Well(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A pot: of paint, if it has a colour's or a pen's name; of water; or a cloth."""

    at_mm: tuple[Height, Height]
    name: Name | None = None
    stir_mm: Length = 3.0
    """The brush moves to and fro by this …"""
    stir_axis: Literal["x", "y"] = "x"
    """… along this axis."""
    times: Annotated[int, Meta(ge=1, le=50)] = 2

    @property
    def bottom(self) -> float:
        """How deep the brush goes, as its heights are given."""
        raise NotImplementedError

    @property
    def stirs(self) -> list[tuple[float, float]]:
        """The places that the brush is moved to in it, mm, from `at_mm` on."""
        (x, y), way = self.at_mm, self.stir_mm
        ends = [(x + way, y), (x - way, y)] if self.stir_axis == "x" else [(x, y + way), (x, y - way)]
        return ends * self.times if way else []


class ZWell(Well, frozen=True, kw_only=True):
    """A pot for a brush on a z axis."""

    bottom_mm: Height

    @property
    def bottom(self) -> float:
        return self.bottom_mm


class EbbWell(Well, frozen=True, kw_only=True):
    """A pot for a brush on a servo."""

    bottom_percent: Percent

    @property
    def bottom(self) -> float:
        return self.bottom_percent


class Brush(_Tool, frozen=True, kw_only=True):
    """A brush: pressed by as much as the stroke is wide, dipped and washed. Kinds of it tell what holds it."""

    unit: ClassVar[str] = ""
    """What the names of its heights end with."""
    touch_width_mm: Length
    press_width_mm: Length
    approach_mm: Length = 3.0
    """It comes down along this much of the stroke's beginning, and lifts off along as much of its end."""
    refill_mm: Annotated[float, Meta(gt=0, le=1e6)] | None = None
    """What it paints with one dip; None: it is never dipped."""
    paints: Annotated[tuple[Well, ...], Meta(max_length=99)] = ()
    water: Annotated[tuple[Well, ...], Meta(max_length=9)] = ()
    cloth: Well | None = None
    wash_layers: bool = False
    """Water before every layer, even of the same paint."""

    def __post_init__(self) -> None:
        safe, touch, press = self.heights
        if (safe - touch) * (touch - press) <= 0:
            names = ", ".join(f"{name}_{self.unit}" for name in ("safe", "touch", "press"))
            raise ValueError(f"{names} = {safe:g}, {touch:g}, {press:g} must go one way")
        if self.touch_width_mm >= self.press_width_mm:
            raise ValueError(f"press_width_mm = {self.press_width_mm:g} must be above touch_width_mm")
        if self.refill_mm is not None and not self.paints:
            raise ValueError("refill_mm needs wells: [[tool.paints]]")

    @property
    def heights(self) -> tuple[float, float, float]:
        """Where it travels; where its tip makes a line of `touch_width_mm`; of `press_width_mm`, and never lower."""
        raise NotImplementedError

    def way_s(self, start: float, end: float) -> float:
        """Seconds from one height to another, in the air."""
        raise NotImplementedError

    @property
    def wells(self) -> list[Well]:
        """All pots and the cloth."""
        return [*self.paints, *self.water, *([self.cloth] if self.cloth else [])]

    def check_reach(self, spans: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Raise ValueError for a well that lies outside of the travel of x and y."""
        for well in self.wells:
            for place in (well.at_mm, *well.stirs):
                if not all(low <= at <= high for at, (low, high) in zip(place, spans, strict=True)):
                    raise ValueError(f"the well at {list(well.at_mm)} with its stir is outside of the machine's travel")


class ZBrush(Brush, frozen=True, kw_only=True, tag="brush"):
    """A brush on a z axis."""

    unit: ClassVar[str] = "mm"
    safe_mm: Height
    touch_mm: Height
    press_mm: Height
    rate_mm_min: Rate
    """Of the height alone, in the air."""
    angle_axis: Annotated[str, Meta(pattern=r"^[ABC]\Z")] | None = None
    """The axis that turns the brush, in degrees."""
    paints: Annotated[tuple[ZWell, ...], Meta(max_length=99)] = ()
    water: Annotated[tuple[ZWell, ...], Meta(max_length=9)] = ()
    cloth: ZWell | None = None

    @property
    def heights(self) -> tuple[float, float, float]:
        return self.safe_mm, self.touch_mm, self.press_mm

    def way_s(self, start: float, end: float) -> float:
        return abs(end - start) / self.rate_mm_min * 60


class EbbBrush(_Pulses, Brush, frozen=True, kw_only=True, tag="ebb-brush"):
    """A brush on the servo of an EiBotBoard; `lower_s` and `raise_s` are what it needs beside its sweep."""

    unit: ClassVar[str] = "percent"
    safe_percent: Percent
    touch_percent: Percent
    press_percent: Percent
    low: Pulse
    high: Pulse
    raise_rate: PulseRate
    lower_rate: PulseRate
    pin: Pin | None = None
    paints: Annotated[tuple[EbbWell, ...], Meta(max_length=99)] = ()
    water: Annotated[tuple[EbbWell, ...], Meta(max_length=9)] = ()
    cloth: EbbWell | None = None

    @property
    def heights(self) -> tuple[float, float, float]:
        return self.safe_percent, self.touch_percent, self.press_percent

    @property
    def deepest(self) -> float:
        """The height furthest from where it travels."""
        return max(
            (self.press_percent, *(well.bottom for well in self.wells)), key=lambda at: abs(at - self.safe_percent)
        )

    def lowers(self, start: float, end: float) -> bool:
        """Whether a way from one height to another is one down."""
        return abs(end - self.safe_percent) > abs(start - self.safe_percent)

    def way_s(self, start: float, end: float) -> float:
        rate = self.lower_rate if self.lowers(start, end) else self.raise_rate
        return PERIOD_S * abs(self.pulse(end) - self.pulse(start)) / rate if rate else 0.0


Tool = PwmServo | AngleServo | ZPen | Carousel | EbbServo | ZBrush | EbbBrush
