"""Time lapses: the right pictures at the right time, nothing flickers, and an honest word where it cannot be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageSequence
from random_plans import first_strokes, random_plan

from strokeplan.errors import FormatError, InputError
from strokeplan.preview import save_time_lapse
from strokeplan.preview.timelapse import pace
from strokeplan.rendering import render
from strokeplan.strokes import StrokePlan

SUFFIXES = (".gif", ".webp")
PALETTE_PSNR_DB = 31.0
"""400 random colours and their edges in 255: 31.5 dB measured."""
WEBP_PSNR_DB = 23.0
"""At quality 80, whose colour has half the resolution: 23.8 dB measured, for nothing in it is smooth."""


@pytest.fixture(scope="module")
def plan() -> StrokePlan:
    return random_plan()


def frames(path: Path) -> list[NDArray[np.uint8]]:
    with Image.open(path) as file:
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(file)]


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    return float(10 * np.log10(255**2 / max(np.mean((a.astype(float) - b) ** 2), 1e-9)))


@pytest.mark.parametrize(("suffix", "bound"), [(".gif", PALETTE_PSNR_DB), (".webp", WEBP_PSNR_DB)])
def test_frames_are_the_plan_s_pictures(suffix: str, bound: float, plan: StrokePlan, tmp_path: Path) -> None:
    save_time_lapse(plan, tmp_path / f"out{suffix}", seconds=1, fps=10)
    shown = frames(tmp_path / f"out{suffix}")
    assert [frame.shape for frame in shown] == [(200, 300, 3)] * 10
    laid = [int(np.searchsorted(pace(plan), k / 10, side="right")) for k in range(1, 10)] + [len(plan)]
    assert 0 < laid[0] < laid[4] < len(plan)
    for picture, count in zip(shown, laid, strict=True):
        assert psnr(picture, render(first_strokes(plan, count))) > bound
    assert psnr(shown[4], render(plan)) < bound - 8


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_last_frame_stays(suffix: str, plan: StrokePlan, tmp_path: Path) -> None:
    path = tmp_path / f"out{suffix}"
    save_time_lapse(plan, path, seconds=1, fps=30, width=60)
    durations = []
    with Image.open(path) as file:
        assert file.info["loop"] == 0
        for frame in ImageSequence.Iterator(file):
            frame.load()
            durations.append(frame.info["duration"])
    assert set(durations[:-1]) <= {30, 40}
    assert sum(durations) == 1000 + 2000


def test_in_a_gif_nothing_flickers(plan: StrokePlan, tmp_path: Path) -> None:
    save_time_lapse(plan, tmp_path / "out.gif", seconds=1, fps=8)
    shown = frames(tmp_path / "out.gif")
    laid = [int(np.searchsorted(pace(plan), k / 8, side="right")) for k in range(1, 8)] + [len(plan)]
    painted = [render(first_strokes(plan, count)) for count in laid]
    for k in range(1, 8):
        untouched = np.all(painted[k] == painted[k - 1], axis=2)
        assert untouched.mean() > 0.3
        assert np.array_equal(shown[k][untouched], shown[k - 1][untouched])
    paper = np.all(painted[0] == plan.background, axis=2)
    assert paper.any()
    assert np.all(shown[0][paper] == plan.background)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_plan_gives_the_same_bytes(suffix: str, plan: StrokePlan, tmp_path: Path) -> None:
    for name in ("a", "b"):
        save_time_lapse(plan, tmp_path / f"{name}{suffix}", seconds=0.5, fps=10, width=100)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_wide_and_long_strokes_linger(plan: StrokePlan) -> None:
    times = np.diff(pace(plan), prepend=0)
    assert times.sum() == pytest.approx(1)
    assert times[:40].mean() > 2 * times[-40:].mean()
    twice = pace(replace(plan, points=2 * plan.points, widths=2 * plan.widths))
    assert twice == pytest.approx(pace(plan))


@pytest.mark.parametrize("n", [0, 1])
def test_few_strokes_are_no_obstacle(n: int, plan: StrokePlan, tmp_path: Path) -> None:
    few = first_strokes(plan, n)
    save_time_lapse(few, tmp_path / "out.gif", seconds=0.2, fps=10)
    assert psnr(frames(tmp_path / "out.gif")[-1], render(few)) > 50


def test_progress_is_told(plan: StrokePlan, tmp_path: Path) -> None:
    told: list[float] = []
    save_time_lapse(plan, tmp_path / "out.webp", seconds=0.4, fps=10, width=60, progress=told.append)
    assert told == [0.25, 0.5, 0.75, 1.0]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failure_leaves_what_was_there(suffix: str, plan: StrokePlan, tmp_path: Path) -> None:
    path = tmp_path / f"out{suffix}"
    path.write_bytes(b"before")

    def fail(done: float) -> None:
        if done > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save_time_lapse(plan, path, seconds=0.5, fps=10, width=60, progress=fail)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"width": 0}, "width 0 is no size"),
        ({"width": 9000}, "9000 × 6000 pixels is too large; a side may have 8192"),
        ({"width": 3000, "seconds": 60}, "1200 frames of 3000 × 2000 pixels are too much; give a smaller width"),
        ({"fps": 0}, "fps 0 is no frame rate"),
        ({"fps": 60}, "at most 50"),
        ({"fps": float("nan")}, "fps nan"),
        ({"seconds": -1}, "seconds -1 is no time"),
        ({"seconds": float("inf")}, "seconds inf"),
    ],
)
def test_a_size_or_time_that_cannot_be_is_refused(
    options: dict[str, float], said: str, plan: StrokePlan, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=said):
        save_time_lapse(plan, tmp_path / "out.gif", **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_another_suffix_is_refused(plan: StrokePlan, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"unknown suffix '.mp4' for a time lapse; known are .gif and .webp"):
        save_time_lapse(plan, tmp_path / "out.mp4")
