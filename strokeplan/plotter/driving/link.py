"""A transport as conversations need it: everything is written, lines are read, every byte may be recorded.

The record is a wire trace: `> tx` and `< rx` with the time, bytes as Python writes them; `replay.py` of the tests
plays one back. While a conversation waits, an emergency stop is heard (`Emergency`).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import IO, TypeVar

from strokeplan.errors import DriveError
from strokeplan.plotter.driving.transport import Transport

Found = TypeVar("Found")
PATIENCE_S = 10.0
"""A port that takes no byte for so long is stuck."""
TICK_S = 0.0005
"""The shortest wait: clocks that add up small numbers come no nearer to a time than that."""
LOOK_S = 0.1
"""A conversation looks for an emergency stop as often as this."""
MAX_LINE = 400
"""No machine says more in a line; noise without an end is cut here."""
_REST = re.compile(rb"[^\r\n]*[\r\n]")
_NOTHING = (b"",)
_REAL_TIME = b"?!~\x18" + bytes(range(0x80, 0x100))
"""Bytes that belong to no line (GRBL)."""
_ENDS = re.compile(rb"[\r\n]+")


class Emergency(Exception):  # noqa: N818 - no error: the second Ctrl-C
    """Someone wants the machine to stop at once, whatever it is doing."""


def never() -> bool:
    return False


class Link:
    """The line to one machine, with what came of a line that is not whole yet."""

    def __init__(
        self, transport: Transport, *, trace: IO[str] | None = None, emergency: Callable[[], bool] = never
    ) -> None:
        self.transport, self.trace, self.emergency = transport, trace, emergency
        self.pending = b""
        self.stuck_since: float | None = None
        self._tail = b""
        self._whole = True
        """Whether what has been written ends with a line's end."""

    def now(self) -> float:
        return self.transport.now()

    def push(self, data: bytes = b"") -> None:
        """Hand over what the port takes now; the rest stays `pending`. Raises DriveError for a port that is stuck."""
        self.pending += data
        if not self.pending:
            return
        taken = self.transport.write(self.pending)
        if taken:
            self._record(">", self.pending[:taken])
            written = self.pending[:taken].translate(None, _REAL_TIME)
            self._whole = written.endswith((b"\n", b"\r")) if written else self._whole
            self.pending = self.pending[taken:]
            self.stuck_since = None
        elif self.stuck_since is None:
            self.stuck_since = self.now()
        elif self.now() - self.stuck_since > PATIENCE_S:
            raise DriveError(f"the port takes no bytes for {PATIENCE_S:g} s: is the machine on, and not paused?")

    def read(self, timeout_s: float) -> bytes:
        """What the machine says within the time; while bytes are pending, no longer than until some may go."""
        if self.pending:
            self.push()
            timeout_s = min(timeout_s, 0.01) if self.pending else timeout_s
        data = self.transport.read(max(timeout_s, TICK_S))
        if data:
            self._record("<", data)
        return data

    def lines(self, data: bytes) -> list[str]:
        """The lines that `data` completes, without their ends; blank ones are left out."""
        *whole, self._tail = _ENDS.split(self._tail + data)
        if len(self._tail) > MAX_LINE:
            whole, self._tail = [*whole, self._tail], b""
        return [text for line in whole if (text := line.decode("latin-1").strip())]

    def forget(self) -> None:
        """Drop what was about to be written, and half a line that was read.

        A line of which a part has been written goes to its end: cut, it would be another command (G1 X100 as X1).
        """
        rest = b"" if self._whole else (_REST.match(self.pending) or _NOTHING)[0]
        self.pending, self._tail = rest, b""

    def say(self, text: str, end: str = "\n") -> None:
        self.push((text + end).encode("ascii"))

    def hear(self, wanted: Callable[[str], Found | None], timeout_s: float) -> Found | None:
        """What `wanted` makes of the first line that it wants; None after the time. Raises Emergency, DeviceLost."""
        until = self.now() + timeout_s
        while (left := until - self.now()) > 0:
            if self.emergency():
                raise Emergency
            found = None
            for line in self.lines(self.read(min(left, LOOK_S))):
                found = wanted(line) if found is None else found  # the rest of the burst is old by then
            if found is not None:
                return found
        return None

    def drain(self, quiet_s: float, most_s: float = 5.0) -> list[str]:
        """All lines until the machine has said nothing for `quiet_s`."""
        heard: list[str] = []
        until = self.now() + most_s
        while self.now() < until:
            if self.emergency():
                raise Emergency
            data = self.read(quiet_s)
            if not data:
                break
            heard += self.lines(data)
        return heard

    def _record(self, way: str, data: bytes) -> None:
        if self.trace is not None:
            self.trace.write(f"{self.now():.4f} {way} {data!r}\n")
