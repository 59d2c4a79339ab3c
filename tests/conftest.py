"""Fixtures that several tests share."""

from __future__ import annotations

import os
import select
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import NDArray

import strokeplan
from strokeplan.strokes import StrokePlan

ROOT = Path(__file__).parent.parent
# The first call of a kernel compiles it, so no example has a deadline; CI tries the same examples each time.
settings.register_profile("strokeplan", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("strokeplan")

DATA = ROOT.parent / "shared" / "data"


def need_program(name: str) -> str:
    """The path of an independent program, or a skip that names it."""
    found = shutil.which(name)
    if found is None:
        if os.environ.get("CI"):
            pytest.fail(f"{name} is not installed, and CI must have it")
        pytest.skip(f"{name} is not installed")
    return found


@pytest.fixture(scope="session")
def sample_photo() -> Path:
    return ROOT / "samples" / "chelsea.jpg"


@pytest.fixture(scope="session")
def small_picture() -> NDArray[np.uint8]:
    """A 96 × 64 picture with structure: rings of colour over a gradient, no file needed."""
    y, x = np.mgrid[:64, :96].astype(float)
    rings = np.sin(np.hypot(x - 40, y - 30) / 3)
    channels = (128 + 100 * rings, 2.5 * x, 255 - 3.5 * y)
    return np.clip(np.stack(channels, axis=-1), 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def small_plan(small_picture: NDArray[np.uint8]) -> StrokePlan:
    preset = strokeplan.load_preset("paper").override(
        {"layers.1.width": 20, "layers.1.sigma": 4, "layers.2.width": 10, "layers.2.sigma": 2}
    )
    return strokeplan.plan(small_picture, preset, seed=7)


def heard(terminal: int) -> bytes:
    """What the other end of a terminal says next; nothing once it is closed."""
    assert select.select([terminal], [], [], 120)[0], "the command hangs"
    try:
        return os.read(terminal, 4096)
    except OSError:  # Linux's way to say that it is closed
        return b""
