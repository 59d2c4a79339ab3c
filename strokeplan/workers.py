"""Threads beside the one that plans; no plan depends on their number."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Workers:
    """Threads beside the one that paints; without an executor there are none."""

    executor: Executor | None = None
    count: int = 0

    def run(self, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """`work` of every item; this thread does what no other has begun."""
        if self.executor is None:
            return [work(item) for item in items]
        futures = [self.executor.submit(work, item) for item in items]
        results: dict[int, Result] = {}
        for k in reversed(range(len(items))):  # the threads begin at the front
            if futures[k].cancel():
                results[k] = work(items[k])
        return [results[k] if k in results else future.result() for k, future in enumerate(futures)]


@contextmanager
def at_work(threads: int | None) -> Iterator[Workers]:
    """Threads beside this one; what they have not begun when the block ends is dropped."""
    count = (threads or _processors()) - 1
    if count == 0:
        yield Workers()
        return
    executor = ThreadPoolExecutor(count)
    try:
        yield Workers(executor, count)
    finally:
        # All is done if all went well; if not, nobody waits for a thread that is still at it.
        executor.shutdown(wait=False, cancel_futures=True)


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
