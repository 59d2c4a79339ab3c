"""Wire traces played back: a transport that says what a machine once said, and insists on what the host said then."""

from __future__ import annotations

import ast
from pathlib import Path

from strokeplan.plotter.driving.transport import Transport


class Replay:
    """A transport out of a trace (`strokeplan plot --trace`). What has not been told yet comes when its turn has."""

    def __init__(self, path: Path) -> None:
        self.records: list[tuple[float, str, bytes]] = []
        for line in path.read_text().splitlines():
            if not line.startswith("#"):
                at_s, way, data = line.split(" ", 2)
                self.records.append((float(at_s), way, ast.literal_eval(data)))
        self.k, self.time = 0, 0.0

    def write(self, data: bytes) -> int:
        if not data:
            return 0
        at_s, way, told = self.records[self.k]
        expected = f"record {self.k + 1} at {at_s} s: {way} {told!r}"
        assert way == ">", f"{expected}; the host says {data!r}"
        assert told.startswith(data) or data.startswith(told), f"{expected}; the host says {data!r}"
        taken = min(len(told), len(data))
        self.records[self.k] = (at_s, way, told[taken:])
        if len(told) == taken:
            self._next()
        return taken

    def read(self, timeout_s: float) -> bytes:
        if self.over:
            self.time += timeout_s
            return b""
        at_s, way, data = self.records[self.k]
        if way == ">" or at_s > self.time + timeout_s:
            self.time += timeout_s
            return b""
        self._next()
        return data

    def now(self) -> float:
        return self.time

    def close(self) -> None:
        pass

    @property
    def over(self) -> bool:
        return self.k == len(self.records)

    def _next(self) -> None:
        self.time = max(self.time, self.records[self.k][0])
        self.k += 1


class WholeLines:
    """A transport that gives whole lines, so that traces are short."""

    def __init__(self, port: Transport, end: bytes) -> None:
        self.port, self.end = port, end

    def read(self, timeout_s: float) -> bytes:
        until, data = self.port.now() + timeout_s, b""
        while (left := until - self.port.now()) > 0:
            data += self.port.read(left)
            if data.endswith(self.end):
                break
        return data

    def write(self, data: bytes) -> int:
        return self.port.write(data)

    def now(self) -> float:
        return self.port.now()

    def close(self) -> None:
        self.port.close()
