"""What is remembered of a job on disk: everything that continues it after a crash, and how far it got.

A folder a job: `job.toml` (what was asked), the plan as it was read, `profile.toml`, and `progress.log`, to which a
line is added for every fence that was passed:

    F <key> <line> <pen> <copy> <refill_mm> <crc32>\\n

`key` is the unit's position in the job. Records are written as fences pass and brought to the disk (fsync) at most
every half second, and at every stop; never before the machine has proven them. A torn or damaged record, and all that
follows it, counts for nothing and is cut off before more is added.

Source of the idea: write-ahead logs of databases; the CRC is zlib's.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path

from strokeplan.errors import OutputError

GROUP_S = 0.5
"""At most so much progress is lost by a power cut of the host."""
MAX_RECORD = 120


def record(key: int, line: int, pen: int, copy: int, refill_mm: float) -> bytes:
    """One line of the log."""
    body = f"F {key} {line} {pen} {copy} {refill_mm:.3f}"
    return f"{body} {zlib.crc32(body.encode()):08x}\n".encode()


def passed(data: bytes) -> tuple[int, int]:
    """The units that a log proves (the number that are done), and how many of its bytes are sound."""
    done = sound = 0
    for row in data.splitlines(keepends=True):
        key = _key(row)
        if key is None or key < done:  # keys rise: what does not is no record of this job
            break
        done, sound = key + 1, sound + len(row)
    return done, sound


def _key(row: bytes) -> int | None:
    body, _, crc = row[:-1].rpartition(b" ")
    parts = body.split(b" ")
    sound = row.endswith(b"\n") and len(row) <= MAX_RECORD and len(parts) == 6 and parts[0] == b"F"
    if not sound or crc != f"{zlib.crc32(body):08x}".encode() or not parts[1].isdigit():
        return None
    return int(parts[1])


class Journal:
    """The log of a job, open for adding. Also a streamer's Keeper."""

    def __init__(
        self,
        path: Path,
        describe: Callable[[int], tuple[int, int, int, float]],
        sync: Callable[[int], None] = os.fsync,
    ) -> None:
        """`describe` tells line, pen, copy and refill distance of a unit. Raises OutputError."""
        self.path, self.describe, self.sync = path, describe, sync
        self.synced_s: float | None = None
        self.dirty = False
        try:
            self.descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            _lock(self.descriptor)
            data = path.read_bytes()
            self.done, sound = passed(data)
            if sound < len(data):
                os.ftruncate(self.descriptor, sound)
            os.lseek(self.descriptor, sound, os.SEEK_SET)
            self.sync(self.descriptor)
        except OSError as error:
            raise self._failed(error) from None
        self.length = sound

    def advance(self, key: int, now: float) -> None:
        """Unit `key` and all before it are drawn."""
        if key < self.done:
            return
        data = record(key, *self.describe(key))
        try:
            if os.write(self.descriptor, data) < len(data):
                raise OSError(28, "No space left on device")
            self.done, self.dirty = key + 1, True
            if self.synced_s is None or now - self.synced_s >= GROUP_S:
                self.sync(self.descriptor)
                self.synced_s, self.dirty = now, False
        except OSError as error:
            raise self._failed(error) from None

    def settle(self) -> None:
        """All of it is on the disk."""
        if not self.dirty:
            return
        try:
            self.sync(self.descriptor)
            self.dirty = False
        except OSError as error:
            raise self._failed(error) from None

    def close(self) -> None:
        os.close(self.descriptor)

    def _failed(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: progress cannot be written down ({error.strerror}); nothing more is drawn")


def _lock(descriptor: int) -> None:
    """Keep other processes away from the log. Raises OutputError if one has it."""
    try:
        import fcntl
    except ImportError:  # Windows: its ports have but one owner, too
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise OutputError("the job is being drawn by another process") from None
