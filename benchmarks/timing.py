"""Whole-process figures as the operating system accounts for them, and the photo they are taken on."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import Image

SAMPLES = Path(__file__).parent.parent / "samples"
Result = TypeVar("Result")
STROKEPLAN = (sys.executable, "-m", "strokeplan")


@dataclass(frozen=True)
class Cost:
    """What one finished process took."""

    wall_s: float
    cpu_s: float
    peak_mb: float


def run(*command: str, environment: dict[str, str] | None = None) -> Cost:
    """Run a command to its end; raise if it fails."""
    began = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env={**os.environ, **(environment or {})}
    )
    message = process.stderr.read() if process.stderr else b""
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - began
    if process.returncode:
        raise RuntimeError(f"{command} failed: {message.decode()}")
    return Cost(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


def median(costs: list[Cost]) -> Cost:
    return Cost(
        *(statistics.median(column) for column in zip(*((c.wall_s, c.cpu_s, c.peak_mb) for c in costs), strict=True))
    )


def repeated(count: int, *command: str) -> Cost:
    """The median of `count` runs after one that is not counted."""
    run(*command)
    return median([run(*command) for _ in range(count)])


def apart(work: Callable[..., Result], *arguments: object) -> Result:
    """The result of `work` in a process of its own: what this one has ever held counts in the peak of all it starts."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def tiled_photo(path: Path, width: int, height: int) -> Path:
    """A photo of any size with the detail of real ones: the samples side by side, mirrored, at their own scale."""
    tiles = [np.asarray(Image.open(SAMPLES / f"{name}.jpg"))[:300, :450] for name in ("coffee", "chelsea", "astronaut")]
    row = np.concatenate(tiles, axis=1)
    block = np.concatenate([np.concatenate([row, row[:, ::-1]], 1), np.concatenate([row[::-1], row[::-1, ::-1]], 1)])
    repeats = (-(-height // block.shape[0]), -(-width // block.shape[1]), 1)
    Image.fromarray(np.tile(block, repeats)[:height, :width]).save(path, quality=92)
    return path
