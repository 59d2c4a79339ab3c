"""All lines of one pen: layer over layer, dashes in the lights, and what mends them.

Lines follow the photo's structure, layer over layer of other directions as it gets darker, evenly spaced
(hatching.py); what a layer has covered is measured, blurred as an eye blurs it, and corrects first its own spacing
and then what the next layer has to add. Lights too pale for lines get dashes (dashes.py), and where lines leave gaps
short strokes fill them (mending.py).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from strokeplan import dashes, hatching, mending
from strokeplan.coverage import cover
from strokeplan.dashes import dash
from strokeplan.hatching import hatch
from strokeplan.ink_presets import InkPreset
from strokeplan.linework import NO_LINES, Lines, joined
from strokeplan.mending import mend
from strokeplan.pens import Pen
from strokeplan.sheet import COARSE, Raster, Sheet, blocks, blurred, rotated, seen

SHARP = 0.5
"""σ of the blur of what a pen should cover, in its widths: lines show nothing finer."""
EYE_WIDTHS, FEEDBACK_WIDTHS, MEND_WIDTHS = 1.7, 2.7, 1.5
"""σ of the blur, in widths of the pen, of what is covered so far; of the correction of the spacing; of mending."""
ROUNDS = 3
"""How often a layer is drawn to find its spacing."""
CORRECTION = (1.0, 0.6)
"""Power of the measured excess that goes into the spacing after the first round, and after later ones."""
MOST_OF_A_LAYER = 0.95

Step = Callable[[], None]
"""Told after each step of the work; `steps` says how many there are."""


def steps(preset: InkPreset) -> int:
    """How many steps the lines of one pen take."""
    return ROUNDS * len(preset.layers) + 2


def compiled() -> bool:
    """Whether the kernels are in Numba's cache."""
    return hatching.compiled() and dashes.compiled() and mending.compiled()


class Job(NamedTuple):
    """What the lines of one pen are drawn with."""

    samples: Raster
    """(h, w, 3) unit vectors that lines follow, one every …"""
    spacing: float
    """… so many millimetres."""
    preset: InkPreset
    seed: int
    pen: Pen
    sheet: Sheet

    def pixels(self, widths: float) -> float:
        """So many widths of the pen, in pixels of the sheet."""
        return widths * self.pen.width_mm / self.sheet.pixel_mm


def lines_of(demand: Raster, job: Job, step: Step) -> Lines:
    """All lines of a pen that should cover the part `demand` of each pixel of the sheet."""
    sharp = blurred(demand, job.pixels(SHARP))
    covered = np.zeros_like(demand)
    parts: list[Lines] = []
    before = 0.0
    for layer in job.preset.layers:
        turned = job._replace(samples=rotated(job.samples, np.radians(layer.angle)))
        parts.append(_layer(sharp, covered, before, layer.reach, turned, step))
        _cover(parts[-1], job, covered)
        before = layer.reach
    parts.append(_dashes(sharp, covered, job))
    step()
    lines = joined(parts)
    lines = _mended(lines, demand, job)
    step()
    return lines


def _cover(lines: Lines, job: Job, covered: Raster) -> None:
    cover(lines, job.pen.width_mm, job.sheet.pixel_mm, covered, every=2)


def _layer(sharp: Raster, covered: Raster, before: float, reach: float, job: Job, step: Step) -> Lines:
    """Lines of one direction that bring what is covered up to the demand, or to the layer's reach."""
    preset, width = job.preset, job.pen.width_mm
    so_far = seen(covered, job.pixels(EYE_WIDTHS))
    # Tones that would ask too little of the next layer are left to this one.
    aim = np.where(sharp > reach + preset.lines_from * (1 - reach), np.float32(reach), sharp)
    wanted = np.clip((aim - so_far) / (1 - so_far), 0, MOST_OF_A_LAYER)
    here = (wanted > preset.lines_from) & (sharp > before)
    asked = seen(np.where(here, aim - so_far, 0), job.pixels(FEEDBACK_WIDTHS))
    separation = np.where(here, width / np.maximum(wanted, 0.01), 0).astype(np.float32)
    lines = NO_LINES
    if not here.any():
        for _ in range(ROUNDS):
            step()
        return lines
    for attempt in range(ROUNDS):
        lines = hatch(
            job.samples, job.spacing, separation, job.sheet.pixel_mm,
            min_length_mm=preset.min_length_mm, max_length_mm=preset.max_length_mm, min_radius_mm=preset.min_radius_mm,
        )  # fmt: skip
        step()
        if attempt == ROUNDS - 1:
            break
        after = covered.copy()
        _cover(lines, job, after)
        got = seen(np.where(here, after - covered, 0), job.pixels(FEEDBACK_WIDTHS))
        excess = np.clip(got / np.maximum(asked, 1e-3), 0.7, 1.4)
        separation *= excess ** np.float32(CORRECTION[min(attempt, 1)])
    return lines


def _dashes(sharp: Raster, covered: Raster, job: Job) -> Lines:
    """Strokes for tones too light for lines."""
    preset, so_far = job.preset, seen(covered, job.pixels(EYE_WIDTHS))
    lacking = np.where(sharp < preset.lines_from, np.clip((sharp - so_far) / (1 - so_far), 0, 1), 0)
    return dash(
        job.samples, job.spacing, blocks(lacking), COARSE * job.sheet.pixel_mm, job.sheet.size_mm, job.pen.width_mm,
        shortest_mm=preset.dash_mm[0], longest_mm=preset.dash_mm[1], full=preset.lines_from, seed=job.seed,
    )  # fmt: skip


def _mended(lines: Lines, demand: Raster, job: Job) -> Lines:
    """The lines, and what makes them look as dark as they should."""
    return mend(
        lines, job.samples, job.spacing, blocks(1 - demand), (demand.shape[0], demand.shape[1]),
        job.sheet.pixel_mm, job.sheet.size_mm, job.pen.width_mm,
        sigma_mm=MEND_WIDTHS * job.pen.width_mm, lengths_mm=job.preset.mend_mm, least_mm=job.preset.min_length_mm,
        seed=job.seed,
    )  # fmt: skip
