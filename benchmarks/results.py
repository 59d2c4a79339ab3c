"""Measurements that are kept: what was measured once is not measured again until what it depends on changes.

Every result is a file of one JSON line, named by a digest of all that it depends on: the photo's bytes, what was
asked (a preset with all its values, a seed, a peer's settings), the function that measures, and strokeplan's sources.
A run that is stopped, even killed, goes on where it was; nothing has to be thrown away by hand.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import math
import os
import signal
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

import strokeplan
from strokeplan.formats import write

ROOT = Path(__file__).parent.parent
SAMPLES = ROOT / "samples"
CACHE = ROOT / ".cache" / "results"
PROCESSES = 2

Job = tuple[Path, dict[str, Any]]
"""A photo, and what to do with it (JSON values)."""
Result = dict[str, Any]
Measure = Callable[[Path, dict[str, Any]], Result]


def measured(measure: Measure, jobs: Sequence[Job], cache_folder: Path = CACHE) -> list[Result]:
    """measure(*job) of every job, in their order; from the cache where it has been measured before.

    Measured in processes of their own, each of which keeps its result at once. Progress on stderr.
    """
    cache_folder.mkdir(parents=True, exist_ok=True)
    files = [cache_folder / f"{digest(measure, *job)}.json" for job in jobs]
    waiting = {file: job for file, job in zip(files, jobs, strict=True) if not file.exists()}
    print(f"{len(set(files))} results, {len(waiting)} to measure", file=sys.stderr)
    pool = ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn"), initializer=_begin)
    try:
        futures = {pool.submit(_keep, measure, job, file): job for file, job in waiting.items()}
        for done, future in enumerate(as_completed(futures), start=1):
            future.result()
            print(f"{done} of {len(waiting)}: {futures[future][0].name}", file=sys.stderr)
    finally:
        pool.shutdown(cancel_futures=True)  # what is being measured is kept, what waits is dropped
    return [json.loads(file.read_text()) for file in files]


def digest(measure: Measure, photo: Path, asked: dict[str, Any]) -> str:
    """The name of a result."""
    parts = (file_digest(photo), json.dumps(asked, sort_keys=True), inspect.getsource(measure), sources_digest())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@cache
def file_digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def sources_digest(package: Path = Path(strokeplan.__file__).parent) -> str:
    """Of all Python sources of the package. Presets are data, and part of what is asked."""
    sources = sorted(package.rglob("*.py"))
    return hashlib.sha256("".join(f"{p.relative_to(package)} {file_digest(p)}\n" for p in sources).encode()).hexdigest()


def _begin() -> None:
    """A worker leaves Ctrl-C to its parent, and does not outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def follow() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=follow, daemon=True).start()


def _keep(measure: Measure, job: Job, file: Path) -> None:
    write(file, json.dumps(measure(*job)).encode() + b"\n")


def run(main: Callable[[], None]) -> None:
    """A benchmark's main, which Ctrl-C ends in one line."""
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("interrupted; the same command goes on from here")


# Pages


def mean_interval(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and half of its 95 % confidence interval by Student's t; infinite for a single value."""
    from scipy.stats import t as student

    n = len(values)
    half = student.ppf(0.975, n - 1) * np.std(values, ddof=1) / math.sqrt(n) if n > 1 else math.inf
    return float(np.mean(values)), float(half)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(row) + " |" for row in (header, ["---"] * len(header), *rows)]
    return "\n".join(lines) + "\n"


def save_chart(figure: Any, path: Path) -> None:
    """A Matplotlib figure as SVG; the same figure gives the same bytes."""
    import matplotlib as mpl

    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "strokeplan"}):
        figure.savefig(path, metadata={"Date": None}, bbox_inches="tight")
