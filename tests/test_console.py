"""Work that the command line begins while it does something else."""

from __future__ import annotations

import subprocess
import sys
from threading import Event, current_thread

import pytest

from strokeplan.cli.console import begin
from strokeplan.errors import ImageError


def test_work_goes_on_beside_its_caller() -> None:
    waiting = Event()
    future = begin(lambda seconds: (waiting.wait(seconds), current_thread().name), 30.0)
    assert not future.done()
    waiting.set()
    answered, thread = future.result()
    assert answered
    assert thread != current_thread().name


def test_its_error_is_raised_where_its_result_is_asked_for() -> None:
    def fail(name: str) -> None:
        raise ImageError(f"{name}: no such file")

    future = begin(fail, "photo.jpg")
    with pytest.raises(ImageError, match=r"^photo\.jpg: no such file$"):
        future.result()


def test_the_program_ends_without_it() -> None:
    code = (
        "import time; from strokeplan.cli.console import begin; future = begin(time.sleep, 600); print(future.done())"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (ended.stdout, ended.stderr, ended.returncode) == ("False\n", "", 0)
