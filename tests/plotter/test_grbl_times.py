"""Motion against GRBL 1.1's own planner and step generator: seconds that benchmarks/motion.py recorded from it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))

import motion

TIMES = json.loads((Path(__file__).parent / "grbl_times.json").read_text())
DRAWINGS = {drawing.name: drawing for drawing in motion.drawings()}


@pytest.mark.parametrize("name", DRAWINGS)
@pytest.mark.parametrize("setting", motion.SETTINGS)
def test_estimates_are_those_of_the_machine(name: str, setting: tuple[int, int, float, int]) -> None:
    theirs = TIMES[f"{name} {setting}"]
    assert motion.motion(DRAWINGS[name], setting).total_s == pytest.approx(theirs, rel=2e-3)


def test_the_comparison_sees_another_acceleration() -> None:
    x, y, deviation, feed = motion.SETTINGS[0]
    slower = motion.motion(DRAWINGS["hatches"], (x, y // 2, deviation, feed)).total_s
    assert slower > 1.01 * TIMES[f"hatches {motion.SETTINGS[0]}"]
