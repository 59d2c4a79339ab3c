"""The benchmarks' machinery: what is measured is kept and not measured again, and variants are what they say."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from conftest import ROOT, need_program

from strokeplan.presets import load_preset

sys.path.insert(0, str(ROOT / "benchmarks"))

import evaluation
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
import results, test_evaluation_bench as bench
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
    states = subprocess.run(
        [need_program("ps"), "-o", "stat=", "-s", str(session)], capture_output=True, text=True
    ).stdout.split()
    return any(not state.startswith("Z") for state in states)


def test_a_result_is_named_by_all_it_depends_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = photos(tmp_path, 2)
    paper = load_preset("paper")

    def name(photo: Path = first, measure: Any = logged, **asked: Any) -> str:
        return results.digest(measure, *evaluation.job(photo, paper.override(asked)))

    names = [name(), name(second), name(measure=evaluation.measure), name(coherence=0.4), name(**{"layers.2.width": 9})]
    monkeypatch.setattr(evaluation, "SEED", 1)
    names.append(name())
    monkeypatch.undo()
    assert name(coherence=0.5) == names[0]  # what it is anyway
    (tmp_path / "copy.jpg").write_bytes(first.read_bytes())
    assert name(tmp_path / "copy.jpg") == names[0]
    monkeypatch.setattr(results, "sources_digest", lambda: "changed")
    names.append(name())
    assert len(set(names)) == len(names) == 7


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


def test_a_variant_is_its_base_with_values_replaced() -> None:
    base = load_preset("paper")
    made = evaluation.variant("paper", {"layers.*.sigma": "×0.5", "layers.2.width": "×2", "coherence": 0.1})
    assert [layer.sigma for layer in made.layers] == [layer.sigma / 2 for layer in base.layers]
    assert [layer.width for layer in made.layers] == [50, 50, 5, 2.5]
    assert made.coherence == 0.1
    assert evaluation.variant("paper", {}) == base
    assert evaluation.variant("paper", {"integration_sigma": "×3"}).integration_sigma == 3


def test_every_variant_is_another_preset() -> None:
    """All are valid, and none is the base or another one under a second name."""
    changes = [change for chapter in evaluation.ABLATION.values() for change in chapter.values()]
    made = [evaluation.variant(evaluation.BASE, change) for change in changes]
    made.append(load_preset(evaluation.BASE))
    assert len({msgspec.json.encode(preset) for preset in made}) == len(made) > 30


def test_differences_are_taken_photo_by_photo() -> None:
    base: list[dict[str, Any]] = [{"psnr_db": 20.0, "strokes": 10}, {"psnr_db": 30.0, "strokes": 30}]
    other: list[dict[str, Any]] = [{"psnr_db": 21.0, "strokes": 10}, {"psnr_db": 33.0, "strokes": 70}]
    mean, half = evaluation.difference("psnr_db", base, other)
    assert mean == pytest.approx(2)
    assert half == pytest.approx(12.7062)  # t(0.975, 1) · s / √2, s = √2
    assert evaluation.ratio("strokes", base, other) == 2


def test_an_interval_is_student_s() -> None:
    """The textbook's t for 9 degrees of freedom is 2.262; one value says nothing of its spread."""
    values = np.arange(10.0)
    mean, half = results.mean_interval(list(values))
    assert (mean, half) == (4.5, pytest.approx(2.262 * values.std(ddof=1) / math.sqrt(10), rel=1e-3))
    assert results.mean_interval([3.0]) == (3.0, math.inf)
