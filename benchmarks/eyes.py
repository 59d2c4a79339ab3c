"""Whether eyes survive: python benchmarks/eyes.py FOLDER… [--write]

The author names lost eyes as a weakness of the method. OpenCV's cascade (haarcascade_eye.xml), which is not ours
and knows nothing of strokes, looks for the eyes of every portrait, then for the same eyes in what each preset makes
of it. Prints a section of docs/fidelity.md; with --write puts it into its place there. Needs the extra `peers`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from fidelity import PAGE
from numpy.typing import NDArray
from results import table
from skimage.metrics import structural_similarity

import strokeplan
from strokeplan.image import photo_files
from strokeplan.importance import faces
from strokeplan.planner import warm_up
from strokeplan.presets import load_preset

STYLES: dict[str, tuple[str, int | None, dict[str, Any]]] = {
    "`paper-published`": ("paper-published", None, {}),
    "`paper`": ("paper", None, {}),
    "`fine`": ("fine", None, {}),
    "`fine`, 2,000 strokes": ("fine", 2_000, {}),
    '`fine`, 2,000 strokes, `importance = ["faces"]`': ("fine", 2_000, {"importance": ["faces"]}),
    "`fine`, 1,000 strokes": ("fine", 1_000, {}),
    '`fine`, 1,000 strokes, `importance = ["faces"]`': ("fine", 1_000, {"importance": ["faces"]}),
}
"""Name → preset, most strokes, values of the preset replaced."""
EYE = 0.95
"""Importance of a face's eyes (and mouth) in the map of faces: above that of the face around them."""
SAME = 0.3
"""Intersection over union from which two windows show the same eye."""
HEADING = "## Eyes\n"

Windows = NDArray[np.float64]


def eyes(rgb: NDArray[np.uint8]) -> Windows:
    """Rows left, top, width, height of the eyes that OpenCV finds."""
    import cv2

    cascade = cv2.CascadeClassifier(cv2.data.haarcascades + "haarcascade_eye.xml")
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    return np.array(cascade.detectMultiScale(grey, 1.05, 4), np.float64).reshape(-1, 4)


def survive(before: Windows, after: Windows) -> int:
    """How many of the first windows are among the second."""
    return sum(bool(np.any(_common_part(window, after) > SAME)) for window in before)


def _common_part(window: NDArray[np.float64], windows: Windows) -> NDArray[np.float64]:
    low = np.maximum(window[:2], windows[:, :2])
    high = np.minimum(window[:2] + window[2:], windows[:, :2] + windows[:, 2:])
    shared = np.maximum(high - low, 0).prod(axis=1)
    part: NDArray[np.float64] = shared / (window[2:].prod() + windows[:, 2:].prod(axis=1) - shared)
    return part


def measure(path: Path) -> tuple[int, list[tuple[int, float, int]]] | None:
    """Eyes in the photo; and for every style how many are left, SSIM there, and strokes. None for a photo without."""
    photo = strokeplan.load_photo(path)
    where = faces(photo.rgb) > EYE
    windows = eyes(photo.rgb)
    windows = np.array([w for w in windows if where[int(w[1] + w[3] / 2), int(w[0] + w[2] / 2)]]).reshape(-1, 4)
    if not len(windows):
        return None
    rows = []
    for preset, strokes, change in STYLES.values():
        plan = strokeplan.plan(photo, load_preset(preset).override(change), strokes=strokes, threads=1)
        picture = strokeplan.render(plan)
        ssim = structural_similarity(photo.rgb, picture, channel_axis=2, full=True)[1]
        rows.append((survive(windows, eyes(picture)), float(ssim[where].mean()), len(plan)))
    return len(windows), rows


def section(folders: Sequence[Path]) -> str:
    paths = photo_files(folders)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn"), initializer=warm_up) as pool:
        results = [result for result in pool.map(measure, paths) if result is not None]
    total = sum(found for found, _ in results)
    rows = []
    for number, name in enumerate(STYLES):
        left, ssim, strokes = zip(*(rows[number] for _, rows in results), strict=True)
        rows.append([name, f"{sum(left)} of {total}", f"{np.mean(ssim):.3f}", f"{np.mean(strokes):,.0f}"])
    names = ", ".join(folder.name for folder in folders)
    return (
        f"{HEADING}\nMade by `python benchmarks/eyes.py FOLDER… --write`. The author names lost eyes as a weakness of "
        f"the method. OpenCV's cascade for eyes finds {total} of them in the faces of {len(results)} of the "
        f"{len(paths)} photos of {names}; it looks for the same ones in the painted pictures. SSIM is that of eyes "
        "and mouths.\n\n" + table(("", "eyes found again", "SSIM of eyes and mouth", "strokes"), rows)
    )


if __name__ == "__main__":
    arguments = [Path(argument) for argument in sys.argv[1:] if argument != "--write"]
    if not arguments:
        sys.exit(__doc__)
    text = section(arguments)
    print(text)
    if "--write" in sys.argv:
        PAGE.write_text(PAGE.read_text().split(HEADING)[0].rstrip("\n") + "\n\n" + text)
