"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Orientation(StrEnum):
    tensor = "tensor"
    gradient = "gradient"


ImageArgument = Annotated[
    Path, typer.Argument(metavar="IMAGE", help="The photo: JPEG, PNG, TIFF, WebP, BMP, GIF, PPM.")
]
PlanArgument = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A strokes file (.json, .json.gz) or an SVG (.svg, .svgz).")
]
OutputsOption = Annotated[
    list[Path],
    typer.Option(
        "--output", "-o", metavar="OUT", help="Where to write: .json, .json.gz, .svg, .svgz or .png; may be repeated."
    ),
]
PresetOption = Annotated[
    str, typer.Option("--preset", "-p", metavar="NAME|FILE.toml", help="Style; `strokeplan presets` lists them.")
]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of all chance; the same seed gives the same bytes.")]
OrientationOption = Annotated[
    Orientation | None, typer.Option("--orientation", help="Where direction comes from; by default as the preset says.")
]
StrokesOption = Annotated[
    int | None, typer.Option("--strokes", metavar="N", help="The best picture with at most N strokes.")
]
DetailOption = Annotated[
    float | None, typer.Option("--detail", metavar="0..1", help="From bold (0) to minute (1); 0.5 is the preset's own.")
]
PaletteOption = Annotated[
    str | None,
    typer.Option(
        "--palette",
        metavar="K|COLOURS|FILE.gpl",
        help="Only K colours of the photo, a list like #aabbcc,teal, or a file's.",
    ),
]
MaskOption = Annotated[
    Path | None,
    typer.Option("--mask", metavar="IMAGE", help="Where detail matters: white most, mid grey as usual, black least."),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one value of the preset, e.g. layers.2.width=8."),
]
ThreadsOption = Annotated[
    int | None, typer.Option("--threads", help="Threads to use, by default all; the plan is the same.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar and no summary.")]
