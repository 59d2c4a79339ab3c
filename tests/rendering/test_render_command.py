"""`strokeplan render` cut short by Ctrl-C or a full disk: one line, nothing half written, the old picture untouched."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import heard

from strokeplan.errors import OutputError
from strokeplan.strokes import StrokePlan

CALL = "from strokeplan.cli import main; main()"
# Python ignores Ctrl-C where its parent does, as shells have it for jobs in the background.
LISTENING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
LIMITED = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0})); "
AT_ONCE_S = 60
"""A machine that has other things to do may take so long; the picture would take minutes, the compiler as well."""


@pytest.fixture
def folder(small_plan: StrokePlan, tmp_path: Path) -> Path:
    """A plan, and the old picture that a new one shall replace."""
    small_plan.save(tmp_path / "plan.json")
    (tmp_path / "out.tif").write_bytes(b"old")
    return tmp_path


def untouched(folder: Path) -> bool:
    return (folder / "out.tif").read_bytes() == b"old" and {path.name for path in folder.iterdir()} == {
        "plan.json",
        "out.tif",
    }


@pytest.mark.parametrize(
    ("brush", "sign", "cold"),
    [("round", "painting", False), ("bristle", "painting", False), ("flat", "compiling the brush", True)],
)
def test_ctrl_c_leaves_the_old_picture(
    brush: str, sign: str, cold: bool, folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """At a terminal, with the progress bar under way; and while the brush is compiled for the first time."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("cache"))} if cold else None
    ours, theirs = pty.openpty()
    start = [sys.executable, "-c", LISTENING + CALL, "render", "plan.json", "-o", "out.tif", "--brush", brush]
    with subprocess.Popen(
        [*start, "--width", "150000"], cwd=folder, stdout=subprocess.PIPE, stderr=theirs, env=environment
    ) as run:
        try:
            os.close(theirs)
            shown = b""
            while sign.encode() not in shown:
                said = heard(ours)
                assert said, f"the command ended: {shown.decode()}"
                shown += said
            time.sleep(1)
            assert run.poll() is None
            run.send_signal(signal.SIGINT)
            code = run.wait(timeout=AT_ONCE_S)
            while more := heard(ours):
                shown += more
            out, _ = run.communicate()
        finally:
            run.kill()
            os.close(ours)
    assert (code, out) == (130, b"")
    assert shown.decode().splitlines()[-1].endswith("error: interrupted; no file was left half written")
    assert b"Traceback" not in shown
    assert untouched(folder)


def test_a_disk_that_is_full_half_way_leaves_the_old_picture(folder: Path) -> None:
    """The system itself refuses bytes beyond a limit, while a TIFF is written strip by strip."""
    render = ["render", "plan.json", "-o", "out.tif", "--width", "3000", "--quiet"]
    start = [sys.executable, "-c", LIMITED.format(60_000) + CALL, *render]
    run = subprocess.run(start, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert (run.returncode, run.stdout) == (OutputError.exit_code, "")
    assert run.stderr.splitlines() == ["error: out.tif: cannot be written (File too large)"]
    assert untouched(folder)
    start[2] = LIMITED.format(60_000_000) + CALL
    assert subprocess.run(start, cwd=folder, capture_output=True, timeout=120, check=False).returncode == 0
    assert (folder / "out.tif").stat().st_size > 60_000
