"""Measurements of the benchmarks are kept: a run that was stopped goes on, and nothing is measured twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, need_program

sys.path.insert(0, str(ROOT / "benchmarks"))

import results

Job = tuple[Path, dict[str, Any]]


def logged(path: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """A measurement that leaves a trace beside the photo; slow or broken if it is asked to be."""
    with (path.parent / "log").open("a") as log:
        log.write(f"{path.name} {asked['value']}\n")
    time.sleep(asked.get("seconds", 0))
    if asked["value"] == "broken":
        raise ValueError("this one cannot be measured")
    return {"size": path.stat().st_size, "value": asked["value"]}


def photos(folder: Path, count: int) -> list[Path]:
    paths = [folder / f"{k}.jpg" for k in range(count)]
    for k, path in enumerate(paths):
        path.write_bytes(b"photo" * (k + 1))
    return paths


def log(folder: Path) -> list[str]:
    return sorted((folder / "log").read_text().splitlines())


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    return tmp_path / "kept"


def test_what_was_measured_is_not_measured_again(tmp_path: Path, kept: Path) -> None:
    first, second = photos(tmp_path, 2)
    jobs: list[Job] = [(second, {"value": 1}), (first, {"value": 1}), (second, {"value": 1})]
    told = results.measured(logged, jobs, kept)
    assert told == [{"size": 10, "value": 1}, {"size": 5, "value": 1}, {"size": 10, "value": 1}]
    assert log(tmp_path) == ["0.jpg 1", "1.jpg 1"]
    assert [len(file.read_text().splitlines()) for file in kept.iterdir()] == [1, 1]

    more: list[Job] = [*jobs, (first, {"value": 2})]
    assert results.measured(logged, more, kept) == [*told, {"size": 5, "value": 2}]
    assert log(tmp_path) == ["0.jpg 1", "0.jpg 2", "1.jpg 1"]


def test_a_failure_leaves_what_was_measured(tmp_path: Path, kept: Path) -> None:
    (path,) = photos(tmp_path, 1)
    sound: list[Job] = [(path, {"value": value}) for value in (1, 2)]
    with pytest.raises(ValueError, match="cannot be measured"):
        results.measured(logged, [*sound, (path, {"value": "broken", "seconds": 1})], kept)
    results.measured(logged, sound, kept)
    assert log(tmp_path) == ["0.jpg 1", "0.jpg 2", "0.jpg broken"]


RUN = """
import sys
sys.path[:0] = [{tests!r}, {benchmarks!r}]
from pathlib import Path
import results, test_results_bench as bench
if __name__ == "__main__":
    path = Path({photo!r})
    jobs = [(path, dict(value=k, seconds=0 if k < 2 else 60)) for k in range(6)]
    results.run(lambda: results.measured(bench.logged, jobs, Path({kept!r})))
"""


def test_a_killed_run_goes_on_where_it_was(tmp_path: Path, kept: Path) -> None:
    """And its workers do not outlive it."""
    (path,) = photos(tmp_path, 1)
    script = tmp_path / "script.py"
    names = {"tests": str(ROOT / "tests"), "benchmarks": str(ROOT / "benchmarks")}
    script.write_text(RUN.format(photo=str(path), kept=str(kept), **names))
    with subprocess.Popen([sys.executable, script], stderr=subprocess.DEVNULL, start_new_session=True) as run:
        try:
            wait_for(lambda: (tmp_path / "log").exists() and len(log(tmp_path)) == 4)
            wait_for(lambda: len(list(kept.glob("*.json"))) == 2)
            run.kill()
            run.wait(timeout=10)
            wait_for(lambda: not alive(run.pid))
        finally:
            if alive(run.pid):
                os.killpg(run.pid, signal.SIGKILL)
    jobs: list[Job] = [(path, {"value": k, "seconds": 0}) for k in range(2)]
    assert [result["value"] for result in results.measured(logged, jobs, kept)] == [0, 1]
    assert len(log(tmp_path)) == 4  # nothing was measured again


def wait_for(done: Any) -> None:
    for _ in range(600):
        if done():
            return
        time.sleep(0.1)
    pytest.fail("waited for a minute")


def alive(session: int) -> bool:
    """Whether a process of a session is left that does anything (a zombie does not)."""
    command = [need_program("ps"), "-o", "stat=", "-s", str(session)]
    states = subprocess.run(command, capture_output=True, text=True).stdout.split()
    return any(not state.startswith("Z") for state in states)


def test_sources_are_the_package_s_modules(tmp_path: Path) -> None:
    def digest(**files: str) -> str:
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        (folder / "inner").mkdir(parents=True)
        for name, text in files.items():
            (folder / name.replace("_", "/").replace("-", ".")).write_text(text)
        return results.sources_digest(folder)

    sources = {"a-py": "1", "inner_b-py": "2"}
    assert digest(**sources) == digest(**sources, **{"paper-toml": "x"})
    assert len({digest(**sources), digest(**{**sources, "inner_b-py": "3"}), digest(**{"a-py": "1"})}) == 3
