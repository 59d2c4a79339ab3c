"""When a tool touches the paper: by its height, by a servo's angle or pulse, and how long it takes to get there."""

from __future__ import annotations

from strokeplan.plotter.tools import AngleServo, EbbBrush, EbbServo, PwmServo, Tool, ZBrush, ZPen

LATE = 0.8
"""The part of the profile's waiting time that a servo needs."""
ABOVE = 0.2
"""A pen on z writes below this part of its way up."""


class Touch:
    """How the tool of a profile meets the paper."""

    def __init__(self, tool: Tool) -> None:
        self.tool = tool
        self.lower_s, self.raise_s = LATE * tool.lower_s, LATE * tool.raise_s
        self._up, self._down = 0.0, 0.0
        if isinstance(tool, ZPen):
            self._up, self._down = tool.up_mm, tool.down_mm
        if isinstance(tool, EbbBrush):  # its waits are beside the sweep
            self.lower_s += LATE * tool.way_s(tool.safe_percent, tool.touch_percent)
            self.raise_s += LATE * tool.way_s(tool.touch_percent, tool.safe_percent)
        if isinstance(tool, ZBrush):
            self._up, self._down = tool.safe_mm, tool.touch_mm
        self._edge = self._down + ABOVE * (self._up - self._down)

    @property
    def by_height(self) -> bool:
        """Whether the z axis carries the pen."""
        return isinstance(self.tool, ZPen | ZBrush)

    @property
    def rest_z(self) -> float:
        """How high the pen is over the firmware's zero when the machine is set up: it is zeroed on the paper."""
        return 0.0

    def low(self, z: float) -> bool:
        """Whether a pen at that height writes."""
        if not self.by_height:
            return False
        return z < self._edge if self._up > self._down else z > self._edge

    def crossing(self, a: float, b: float) -> float | None:
        """The part of a way from height a to b at which the pen begins or ends to write."""
        if not self.by_height or self.low(a) == self.low(b):
            return None
        return (self._edge - a) / (b - a)

    def pulse(self, s: float) -> bool:
        """Whether a servo at that pulse has the pen down; 0 is no pulse."""
        tool = self.tool
        if not isinstance(tool, PwmServo):
            return False
        up = tool.up_pwm or 0.0
        return abs(s - tool.down_pwm) < abs(s - up)

    def sweep(self, pulse: int) -> bool:
        """Whether an EiBotBoard's servo at that pulse has the pen, or the tip of the brush, on the paper."""
        tool = self.tool
        if isinstance(tool, EbbBrush):
            safe, touch = tool.pulse(tool.safe_percent), tool.pulse(tool.touch_percent)
            return pulse <= touch if touch < safe else pulse >= touch
        if not isinstance(tool, EbbServo):
            return False
        return abs(pulse - tool.pulse(tool.down_percent)) < abs(pulse - tool.pulse(tool.up_percent))

    def angle(self, index: int, degrees: float) -> bool | None:
        """Whether a servo at that angle has the pen down; None if it is another servo."""
        tool = self.tool
        if not isinstance(tool, AngleServo) or index != tool.index:
            return None
        return abs(degrees - tool.down_deg) < abs(degrees - tool.up_deg)

    def late(self, down: bool) -> float:
        """Seconds until an order takes effect."""
        return self.lower_s if down else self.raise_s
