"""Formal evaluation of the styles and of their parts: python benchmarks/evaluation.py [FOLDER…] [--every N]

Plans every photo (or every Nth) of each folder (of samples/ if none is given) in every shipped style, with the
gradient in the tensor's place, and some of them in every variant of ABLATION; writes docs/evaluation.md with charts
and sheets. Can be stopped at any time: the same command goes on where it was (benchmarks/results.py).
Needs the extra `evaluation`.
"""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgspec
import numpy as np
from PIL import Image
from results import ROOT, SAMPLES, Result, mean_interval, measured, run, save_chart, table

import strokeplan
from strokeplan.evaluate import COLUMNS, cells, evaluate
from strokeplan.figures import montage, shrink
from strokeplan.image import photo_files
from strokeplan.planner import warm_up
from strokeplan.presets import Preset, load_preset, names

Change = dict[str, Any]
"""Values of a preset replaced: "×2" multiplies, layers.* are all layers, `layers = "1-4"` keeps only those, and
layering.PRUNE is a constant of that module."""
SCALES: dict[str, dict[str, Change]] = {
    "Scale σ": {f"σ {factor}": {"layers.*.sigma": factor} for factor in ("×0.25", "×0.5", "×2", "×4")},
    "Derivative σ_d": {f"σ_d = {value}": {"derivative_sigma": value} for value in (0.5, 2)},
    "Integration ρ, of which 0 is the gradient": {
        f"ρ = {value}": {"integration_sigma": value} for value in (0.5, 3, 6)
    },
    "Coherence": {f"coherence {value}": {"coherence": value} for value in (0.1, 0.25, 0.75)},
    "Longest tract": {f"length {factor}": {"layers.*.length": factor} for factor in ("×0.1", "×0.25", "×0.5", "×2")},
    "Width": {f"width {factor}": {"layers.*.width": factor} for factor in ("×0.5", "×0.7", "×1.4", "×2")},
    "Tolerances": {
        "RDP ×4": {"layers.*.simplify_tolerance": "×4"},
        "fit ×4": {"layers.*.fit_tolerance": "×4"},
    },
}
METHOD: dict[str, Change] = {
    "gradient, not tensor": {"orientation": "gradient"},
    "followed one way": {"directions": "forward"},
    "eigenvectors not aligned": {"interpolation": "signed"},
    "butt caps": {"cap": "butt"},
}
ABLATION: dict[str, dict[str, dict[str, Change]]] = {
    "fine": {
        "The planner": {
            "kept by a threshold": {"keep": "threshold", "layers.*.color_threshold": 30},
            "seeds on a grid": {"seeding": "grid"},
            "seeds drawn by error": {"seeding": "error"},
            "seeds evenly spaced": {"seeding": "even"},
            "canvas not covered first": {"cover": False},
            "finest layer once": {"layers": "1-4"},
            "no widest layer": {"layers": "2-5"},
            "no pruning": {"layering.PRUNE": 0.0},
            "colours not solved": {"pursuit.finishing.DAMPING": 0.0},
            "gain regardless of contrast": {"layering.UNSEEN": 0.0},
        },
        "The method": METHOD,
        "The paper's future work, as options": {
            "tensor of Lab": {"channels": "lab"},
            "tensor of hue": {"channels": "hue"},
            "adaptive ρ up to 4": {"max_integration_sigma": 4},
            "wander 0.5": {"wander": 0.5},
            "importance: faces": {"importance": ["faces"]},
            "importance: saliency": {"importance": ["saliency"]},
            "200 regions": {"regions": 200},
            "thin 10": {"thin": 10},
            "merge 20": {"merge": 20},
            "pressure 0.5": {"pressure": 0.5},
            "palette of 16": {"palette_size": 16},
        },
        "Gain asked for": {f"gain {factor}": {"gain": factor} for factor in ("×0.25", "×0.5", "×2", "×4")},
        **SCALES,
    },
    "paper": {
        "The method": METHOD
        | {
            "steps unbounded": {"max_step": 500, "step_tolerance": 0.5},
            "fit as published": {"fit": "published"},
            "a colour a cubic": {"color": "handle"},
            "colour test as published": {"color_test": "unscaled"},
            "grid as published": {"grid": "nodes"},
            "4 vertices at least": {"min_vertices": 4},
            "grey as the mean": {"grey": "mean"},
        },
        "Colour threshold": {f"threshold {factor}": {"layers.*.color_threshold": factor} for factor in ("×0.5", "×2")},
        **SCALES,
    },
}
"""Preset → chapter → variant → what is changed."""
PARTS = ("layering", "pursuit")
"""Modules of strokeplan with constants that are varied."""
BASE = "fine"
"""The preset whose directions are compared photo by photo."""
DIRECTIONS: dict[str, dict[str, Any]] = {
    "tensor": {"orientation": "tensor"},
    "tensor, no coherence asked": {"orientation": "tensor", "coherence": 0},
    "gradient": {"orientation": "gradient"},
}
"""Where direction comes from; the gradient's coherence is 1 wherever there is a gradient, so that it stops no tract."""
ABLATION_PHOTOS = 5
"""Variants are dozens, and compared photo by photo: about so many photos, evenly taken from the sets, will do."""
PUBLISHED = {
    "NPRgeneral": {"psnr_db": "17.4 dB", "ssim": "0.498", "rgb_8bit": "33.6"},
    "NPRportrait1": {"psnr_db": "21.0 dB", "ssim": "0.699", "rgb_8bit": "16.9"},
}
"""The paper author's published pictures of these sets, measured in the same way against the photos."""
SEED = 0

PAGE = ROOT / "docs" / "evaluation.md"
PICTURES = ROOT / "docs" / "evaluation"
TILE = 300
JPEG_QUALITY = 78
DIFFERENCES = {"psnr_db": "{:+.2f}", "ssim": "{:+.3f}", "ciede2000": "{:+.2f}", "edge_f1": "{:+.3f}"}
"""Told as differences to the base …"""
RATIOS = ("strokes", "svg_bytes", "cpu_s")
"""… and these as ratios."""
VARIANT_HEADER = (
    "variant", "PSNR, dB", "SSIM", "CIEDE2000", "edges F1", "uncovered", "strokes", "SVG bytes", "CPU"
)  # fmt: skip


def variant(preset: str, change: Change) -> dict[str, Any]:
    """A preset with values replaced as ABLATION gives them, and the constants of modules that change with it."""
    base = load_preset(preset)
    raw = msgspec.json.decode(msgspec.json.encode(base))
    replaced: Change = {}
    parts: Change = {}
    for key, value in change.items():
        head, star, tail = key.partition("*")
        if key.split(".")[0] in PARTS:
            parts[key] = value
        elif key == "layers":
            first, last = map(int, value.split("-"))
            raw["layers"] = raw["layers"][first - 1 : last]
        else:
            for full in (f"{head}{number}{tail}" for number in range(1, len(base.layers) + 1)) if star else (key,):
                factor = value[1:] if str(value).startswith("×") else None
                replaced[full] = _value_at(raw, full) * float(factor) if factor else value
    return {
        "preset": msgspec.to_builtins(msgspec.convert(raw, Preset).override(replaced)),
        "seed": SEED,
        "parts": parts,
    }


def _value_at(raw: Any, key: str) -> float:
    for label in key.split("."):
        raw = raw[int(label) - 1] if isinstance(raw, list) else raw[label]
    return float(raw)


def measure(path: Path, asked: dict[str, Any]) -> Result:
    """Figures of one photo in one style, and the CPU seconds of planning alone."""
    warm_up()  # loading the kernels is not planning
    photo = strokeplan.load_photo(path)
    style = msgspec.convert(asked["preset"], Preset)
    with ExitStack() as changed:
        for part, value in asked["parts"].items():
            changed.enter_context(patch(f"strokeplan.{part}", value))
        began = time.process_time()
        plan = strokeplan.plan(photo, style, asked["seed"], threads=1)
        spent = time.process_time() - began
    return asdict(evaluate(plan, photo)) | {"cpu_s": spent}


def variants(base: str) -> dict[str, dict[str, Any]]:
    """All variants of a preset by name."""
    return {name: variant(base, change) for chapter in ABLATION[base].values() for name, change in chapter.items()}


def main() -> None:
    parser = ArgumentParser(description="Formal evaluation of the styles and of their parts: docs/evaluation.md")
    parser.add_argument("folders", nargs="*", type=Path, default=[SAMPLES], help="sets of photos")
    parser.add_argument("--every", type=int, default=1, help="take every Nth photo of a set only")
    asked = parser.parse_args()
    sets = {folder.resolve().name: photo_files([folder])[:: asked.every] for folder in asked.folders}
    everywhere = [path for paths in sets.values() for path in paths]
    few = everywhere[:: max(len(everywhere) // ABLATION_PHOTOS, 1)]
    styles = {name: variant(name, {}) for name in names()}
    directions = {name: variant(BASE, change) for name, change in DIRECTIONS.items()}
    studies = {base: {"": variant(base, {})} | variants(base) for base in ABLATION}

    for style in styles.values():  # each has kernels of its own, and compiling them is not planning
        strokeplan.plan(np.zeros((48, 48, 3), np.uint8), msgspec.convert(style["preset"], Preset))
    jobs = [(path, style) for style in (*styles.values(), *directions.values()) for path in everywhere]
    jobs += [(path, style) for study in studies.values() for style in study.values() for path in few]
    results = iter(measured(measure, jobs))

    def of(paths: Sequence[Path]) -> list[Result]:
        return [next(results) for _ in paths]

    by_style = {name: dict(zip(everywhere, of(everywhere), strict=True)) for name in styles}
    by_direction = {name: dict(zip(everywhere, of(everywhere), strict=True)) for name in directions}
    by_study = {base: {name: of(few) for name in study} for base, study in studies.items()}

    parts = [INTRODUCTION.format(every=f" --every {asked.every}" if asked.every > 1 else "")]
    for name, paths in sets.items():
        parts.append(style_section(name, paths, by_style))
    parts.append(gradient_section(sets, by_direction))
    for base, by_variant in by_study.items():
        parts.append(ablation_section(base, by_variant, len(few)))
    parts.append(pictures_section(styles, directions))
    parts.append("## Photo by photo\n")
    for name, paths in sets.items():
        for style in styles:
            rows = [row(f"`{path.stem}`", by_style[style][path]) for path in paths]
            parts.append(f"### {name}, `{style}`\n\n" + table(HEADER, rows))
    PAGE.write_text("\n".join(parts))
    print(f"wrote {PAGE.relative_to(ROOT)}", file=sys.stderr)


INTRODUCTION = """# Evaluation

Made by `python benchmarks/evaluation.py FOLDER…{every}`: the photos named below planned with seed 0, painted
at their own size by Pycairo and compared with the photo, by the figures of `strokeplan evaluate`:

- **PSNR** and **SSIM** (over the channels; Wang et al. 2004), as scikit-image has them: higher is nearer.
- **RGB distance**, the mean Euclidean distance in 8-bit RGB, and **CIEDE2000**, the mean difference as people see it
  (Sharma et al. 2005; about 1 is just noticeable): lower is nearer.
- **Edges F1**: Canny's edges (PAMI 1986) of picture and photo on luminance, after a blur of 0.2 % of the diagonal and
  with the same thresholds for both (a step of 0.2 of the range begins an edge, one of 0.1 continues it); F1 of
  precision and recall, an edge pixel being right within 0.25 % of the diagonal of one of the other picture (after
  Martin, Fowlkes and Malik, PAMI 2004, without their one-to-one matching). 1 is perfect; photos against themselves
  upside down have 0.2 to 0.3.
- **Uncovered**: pixels whose centre no stroke covers.
- **SVG bytes** as written, uncompressed, and as .svgz; **CPU** is planning alone, on one thread.

Means are over photos; an interval is 95 % of the mean of the differences photo by photo (Student's t).
"""
HEADER = ("", *(heading for heading, _ in COLUMNS.values()), "CPU")


def row(name: str, result: Result) -> list[str]:
    return [name, *cells(result), f"{result['cpu_s']:.2f} s"]


def style_section(name: str, paths: Sequence[Path], by_style: dict[str, dict[Path, Result]]) -> str:
    rows = []
    if name in PUBLISHED:
        rows.append(["the paper's published pictures", *(PUBLISHED[name].get(key, "") for key in COLUMNS), ""])
    for style, results in by_style.items():
        means = {key: float(np.mean([results[path][key] for path in paths])) for key in (*COLUMNS, "cpu_s")}
        rows.append(row(f"`{style}`", means))
    note = ""
    if name in PUBLISHED:
        note = (
            "\n`paper-published` was chosen by its nearness to the published figures on these very photos"
            " ([decisions](decisions.md)): expect less on others.\n"
        )
    return f"## {name}: means over {len(paths)} photos\n\n{table(HEADER, rows)}{note}"


def gradient_section(sets: dict[str, list[Path]], by_direction: dict[str, dict[Path, Result]]) -> str:
    gradient = by_direction["gradient"]
    rows = [
        difference_row(
            f"{name}, {len(paths)} photos, against {base}", [results[p] for p in paths], [gradient[p] for p in paths]
        )
        for base, results in by_direction.items()
        if base != "gradient"
        for name, paths in sets.items()
    ]
    return (
        f"## Gradient against tensor\n\nPreset `{BASE}` with the gradient in the tensor's place: difference to the "
        "tensor; ratio for strokes, bytes and CPU. The gradient's coherence is 1 wherever there is a gradient, so that "
        "no tract ends for want of it: the tensor is also compared with no coherence asked of it, which leaves "
        "direction alone.\n\n" + table(("set", *VARIANT_HEADER[1:]), rows)
    )


def ablation_section(preset: str, by_variant: dict[str, list[Result]], photos: int) -> str:
    base = by_variant[""]
    picture = PICTURES / f"ablation-{preset}.svg"
    chart(ABLATION[preset], by_variant, picture)
    parts = [
        f"## What each part of `{preset}` is worth\n\nOne thing changed in the preset, on {photos} photos taken evenly "
        "from the sets: difference to the preset as it is; ratio for strokes, bytes and CPU.\n\n"
        f"![The differences in PSNR and edges, and the size, of every variant](evaluation/{picture.name})\n"
    ]
    for chapter, changes in ABLATION[preset].items():
        rows = [difference_row(name, base, by_variant[name]) for name in changes]
        parts.append(f"### `{preset}`: {chapter[0].lower()}{chapter[1:]}\n\n" + table(VARIANT_HEADER, rows))
    return "\n".join(parts)


def difference_row(name: str, base: Sequence[Result], other: Sequence[Result]) -> list[str]:
    """Differences with their intervals, then ratios, of one variant to the base."""
    texts = []
    for key, form in DIFFERENCES.items():
        mean, half = difference(key, base, other)
        texts.append(f"{form.format(mean)} ± {form.format(half).removeprefix('+')}")
    texts.append(f"{difference('uncovered_percent', base, other)[0]:+.2f} %")
    return [name, *texts, *(f"{ratio(key, base, other):.2f}" for key in RATIOS)]


def difference(key: str, base: Sequence[Result], other: Sequence[Result]) -> tuple[float, float]:
    return mean_interval([b[key] - a[key] for a, b in zip(base, other, strict=True)])


def ratio(key: str, base: Sequence[Result], other: Sequence[Result]) -> float:
    """Of the sums: a photo counts by what it takes."""
    return sum(result[key] for result in other) / sum(result[key] for result in base)


def chart(chapters: dict[str, dict[str, Change]], by_variant: dict[str, list[Result]], path: Path) -> None:
    from matplotlib.figure import Figure

    base = by_variant[""]
    order = [name for chapter in chapters.values() for name in chapter]
    starts = np.cumsum([0] + [len(chapter) for chapter in chapters.values()])
    figure = Figure(figsize=(10, 0.22 * len(order) + 1))
    panels = figure.subplots(1, 3, sharey=True)
    for panel, key, label in zip(panels, ("psnr_db", "edge_f1"), ("PSNR, dB", "edges F1"), strict=False):
        means, halves = zip(*(difference(key, base, by_variant[name]) for name in order), strict=True)
        panel.errorbar(means, range(len(order)), xerr=np.nan_to_num(halves, posinf=0), fmt="o", ms=4, lw=1, c="#225588")
        panel.axvline(0, c="#888888", lw=0.8)
        panel.set_title(f"difference in {label}", fontsize=9)
    panels[2].scatter(
        [ratio("svg_bytes", base, by_variant[name]) for name in order], range(len(order)), s=16, c="#885522"
    )
    panels[2].axvline(1, c="#888888", lw=0.8)
    panels[2].set_xscale("log", base=2)
    panels[2].xaxis.set_major_formatter("{x:g}")
    panels[2].set_title("SVG bytes, ratio", fontsize=9)
    panels[0].set_yticks(range(len(order)), order, fontsize=8)
    panels[0].set_ylim(len(order) - 0.5, -0.5)
    for panel in panels:
        panel.tick_params(axis="x", labelsize=8)
        for start in starts[1:-1]:
            panel.axhline(start - 0.5, c="#dddddd", lw=0.6)
    figure.tight_layout()
    save_chart(figure, path)


def pictures_section(styles: dict[str, dict[str, Any]], directions: dict[str, dict[str, Any]]) -> str:
    """Sheets of the photos that may be shared."""
    for name, shown in (("styles.jpg", styles), ("directions.jpg", directions)):
        sheet(name, [msgspec.convert(style["preset"], Preset) for style in shown.values()])
    listed = ", ".join(f"`{name}`" for name in styles)
    return (
        f"## Pictures\n\nThe photo, then {listed}.\n\n![Samples in every style](evaluation/styles.jpg)\n\n"
        f"The photo, then `{BASE}` by: {'; '.join(DIRECTIONS)}.\n\n"
        "![Samples by tensor and gradient](evaluation/directions.jpg)\n"
    )


def sheet(name: str, styles: Sequence[Preset]) -> None:
    """A row for each sample: the photo, and what each style makes of it."""
    tiles = []
    for path in photo_files([SAMPLES]):
        photo = strokeplan.load_photo(path)
        painted = (strokeplan.render(strokeplan.plan(photo, style, SEED)) for style in styles)
        tiles += [shrink(picture, TILE / max(photo.width, photo.height)) for picture in (photo.rgb, *painted)]
    PICTURES.mkdir(exist_ok=True)
    picture = Image.fromarray(montage(tiles, columns=len(styles) + 1))
    picture.save(PICTURES / name, quality=JPEG_QUALITY, optimize=True)


if __name__ == "__main__":
    run(main)
