"""Which words of G-code a profile may add before and after a job: none that moves over the page, stores or opens.

A profile may come from anywhere, so what it can say is a list of what is known to be harmless, by flavour; there is
no way to write a `$` setting, an escape, M500 (store), M28 (write a file), M30 (Marlin: delete one) or M997 (flash).
"""

from __future__ import annotations

import re
import reprlib
from typing import Literal

Flavour = Literal["grbl", "grblhal", "fluidnc", "linuxcnc", "marlin", "drawcore", "uarm"]
MAX_LINE = 70
_ANY = {
    "G4": "PS", "G17": "", "G21": "", "G40": "", "G49": "", "G54": "", "G80": "", "G90": "",
    "M5": "", "M7": "", "M8": "", "M9": "",
}  # fmt: skip
_CNC = {**_ANY, "G61": "", "G64": "PQ", "G91.1": "", "G94": "", "M3": "S"}
_MARLIN = {
    **_ANY, "G28": "XYZ", "M17": "", "M18": "XYZE", "M82": "", "M84": "XYZES", "M106": "S", "M107": "",
    "M211": "S", "M280": "PS", "M300": "PS", "M400": "",
}  # fmt: skip
ALLOWED: dict[str, dict[str, str]] = {
    "grbl": _CNC, "grblhal": _CNC, "fluidnc": _CNC, "linuxcnc": _CNC, "marlin": _MARLIN, "drawcore": _CNC,
    "uarm": {**_ANY, "M17": ""},
}  # fmt: skip


def check_lines(key: str, lines: tuple[str, ...], flavour: str) -> None:
    """Raise ValueError for a line that is not one allowed command with its parameters."""
    for line in lines:
        found = re.fullmatch(r"([GM]\d{1,4}(?:\.\d)?)((?: [A-Z]-?\d{0,5}(?:\.\d{1,4})?)*)", line, re.ASCII)
        if not found or len(line) > MAX_LINE:
            raise ValueError(f"{key}: {reprlib.repr(line)} is not one command with its values, like 'G4 P0.5'")
        word, values = found[1], found[2].split()
        allowed = ALLOWED[flavour]
        if word not in allowed:
            raise ValueError(f"{key}: {word} is not allowed here; {flavour} may have {', '.join(allowed)}")
        for value in values:
            if value[0] not in allowed[word]:
                raise ValueError(f"{key}: {word} takes no {value[0]} here")
