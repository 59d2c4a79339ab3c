"""Keys of a terminal, as they are pressed: letters, and arrows by name."""

from __future__ import annotations

import os
import re
import select
import sys
from contextlib import suppress

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_KEY = re.compile(r"\x1b(?:[\[O](?:[\d;]*[A-Za-z~]|$)|$)|[\s\S]")


class Keys:
    """What is typed; `live` ends with the terminal. The terminal itself is made ready by operator.single_keys."""

    def __init__(self) -> None:
        self.live = sys.stdin.isatty()
        self._tail = ""

    def typed(self) -> list[str]:
        """The keys since the last look: "up", "down", "right", "left", else what they write."""
        if not self.live:
            return []
        with suppress(OSError):
            if not select.select([sys.stdin], [], [], 0)[0]:
                return []
            data = os.read(sys.stdin.fileno(), 64)
            self.live = bool(data)
            return self._parsed(data.decode("latin-1"))
        self.live = False
        return []

    def _parsed(self, text: str) -> list[str]:
        found = _KEY.findall(self._tail + text)
        self._tail = found.pop() if found and found[-1] in ("\x1b", "\x1b[", "\x1bO") else ""
        return [_ARROWS.get(key[-1], "") if key.startswith("\x1b") else key for key in found]
