"""What the kin of GRBL are built with, and the settings that they print.

Banners and build lines: GRBL 1.1 wiki; those of grblHAL and FluidNC from their documents, not from boards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from strokeplan.plotter.profile import Profile


@dataclass(frozen=True, slots=True)
class Build:
    """What one of the kin is built with."""

    banner: str
    info: tuple[str, ...]
    rx: int = 128
    blocks: int = 15
    eeprom: bool = True
    """Settings are written with interrupts off."""
    arcs: bool = True
    resets: bool = True
    tool: Literal["line", "kept", "none"] = "line"
    """What T is in $G: GRBL forgets it with the next line, others keep it, or show none without M6."""
    report: int = 1
    """$10."""


BUILDS = {
    "grbl": Build("Grbl 1.1h ['$' for help]", ("[VER:1.1h.20190825:]", "[OPT:V,15,128]")),
    "grblhal": Build(
        "GrblHAL 1.1f ['$' or '$HELP' for help]",
        ("[VER:1.1f.20240812:]", "[OPT:VNMSL,35,1024,3,0]", "[NEWOPT:ENUMS,RT+,SED]", "[FIRMWARE:grblHAL]"),
        rx=1024, blocks=35, eeprom=False, resets=False, tool="none", report=511,
    ),
    "fluidnc": Build(
        "Grbl 3.7 [FluidNC v3.7.12 (wifi) '$' for help]",
        ("[VER:3.7 FluidNC v3.7.12:]", "[OPT:MPHS]"),
        rx=256, eeprom=False, tool="kept",
    ),
    "drawcore": Build("Grbl 1.1h ['$' for help]", ("[VER:1.1h.20190825:]", "[OPT:V,15,128]"), arcs=False),
}  # fmt: skip


def default_settings(profile: Profile, build: Build, *, homing: bool, soft_limits: bool) -> dict[str, str]:
    speeds, machine = profile.speeds, profile.machine
    steps, z = speeds.steps_mm or 250.0, getattr(profile.tool, "rate_mm_min", 500.0)
    values: dict[str, float | int] = {
        "0": 10, "1": 25, "2": 0, "3": 0, "4": 0, "5": 0, "6": 0, "10": build.report,
        "11": speeds.junction_deviation_mm,
        "12": 0.002, "13": 0, "20": int(soft_limits), "21": 0, "22": int(homing), "23": 3, "24": 25.0, "25": 500.0,
        "26": 250, "27": 1.0, "30": 1000, "31": 0, "32": 0, "100": steps, "101": steps, "102": steps,
        "110": speeds.rate_mm_min[0], "111": speeds.rate_mm_min[1], "112": z,
        "120": speeds.acceleration_mm_s2[0], "121": speeds.acceleration_mm_s2[1], "122": speeds.acceleration_mm_s2[0],
        "130": machine.x_mm[1] - machine.x_mm[0], "131": machine.y_mm[1] - machine.y_mm[0], "132": 200.0,
    }  # fmt: skip
    return {key: str(value) if isinstance(value, int) else f"{value:.3f}" for key, value in values.items()}
