"""Options that several commands share: one by one, or as a group, which is a dataclass that a command takes whole."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, fields, is_dataclass
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, ClassVar, get_args, get_type_hints

import typer

_BY_NAME = inspect.Parameter.KEYWORD_ONLY


class Orientation(StrEnum):
    tensor = "tensor"
    gradient = "gradient"


class Units(StrEnum):
    px = "px"
    mm = "mm"


class GroupBy(StrEnum):
    layer = "layer"
    colour = "colour"
    pen = "pen"


class Strokes(StrEnum):
    centre = "centre"
    bundle = "bundle"


class Hidden(StrEnum):
    keep = "keep"
    remove = "remove"


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
    str,
    typer.Option(
        "--preset",
        "-p",
        metavar="NAME|FILE",
        help="Style; `strokeplan presets` lists them. Or a .toml file, or a plan (.svg, .json), with its seed.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of all chance; the same seed gives the same bytes.")]
PlanSeedOption = Annotated[
    int | None,
    typer.Option("--seed", help="Seed of all chance; the same gives the same bytes. By default 0, or the plan's own."),
]
OrientationOption = Annotated[
    Orientation | None, typer.Option("--orientation", help="Where direction comes from; by default as the preset says.")
]
StrokesOption = Annotated[
    int | None, typer.Option("--strokes", "--max-strokes", metavar="N", help="The best picture with at most N strokes.")
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
PenOption = Annotated[
    str | None, typer.Option("--pen", metavar="WIDTH", help="Ink: the width of all pens: 0.3 (mm), 0.3mm, 0.01in.")
]
PensOption = Annotated[
    str | None,
    typer.Option("--pens", metavar="NAME|FILE", help="Ink: black, greys, cmyk, sepia-white, or a .toml file."),
]
MaxLengthOption = Annotated[
    str | None,
    typer.Option("--max-length", metavar="LENGTH", help="Ink: the best drawing with lines of that length: 120m, 80cm."),
]
MaxTimeOption = Annotated[
    str | None,
    typer.Option("--max-time", metavar="TIME", help="Ink: the best that --profile draws in 90min, 1h30m, 1.5h."),
]
InkProfileOption = Annotated[
    str | None,
    typer.Option("--profile", metavar="NAME|FILE", help="Ink: a machine, for its page, pens and time."),
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

ExportsOption = Annotated[
    list[Path],
    typer.Option(
        "--output",
        "-o",
        metavar="OUT",
        help="Where to write: .svg, .svgz, .pdf, .eps, .ps, .dxf, .json, .json.gz or .png; may be repeated.",
    ),
]
PageOption = Annotated[
    str | None, typer.Option("--page", metavar="NAME|WxHmm", help="Centred on a sheet: A0..A6, letter, 200x300mm.")
]
LandscapeOption = Annotated[bool, typer.Option("--landscape", help="The sheet's longer side across.")]
MarginOption = Annotated[
    str | None, typer.Option("--margin", metavar="LENGTH", help="Bare border of the sheet: 10 (mm), 1cm, 0.5in.")
]
UnitsOption = Annotated[
    Units | None, typer.Option("--units", help="Of coordinates in the file; on a page mm, else px of 1/96 inch.")
]
PrecisionOption = Annotated[
    int | None,
    typer.Option("--precision", metavar="0..6", help="Decimals of coordinates; by default 2 of px, 3 of mm."),
]
GroupOption = Annotated[
    GroupBy, typer.Option("--group-by", help="What makes a layer; paint keeps its order, so a colour may have several.")
]
ClassesOption = Annotated[
    bool, typer.Option("--classes", help="Strokes of one colour share it through a class: change one, change all.")
]
OutlineOption = Annotated[
    bool, typer.Option("--outline", help="Every stroke as a filled outline, for cutters and the like.")
]
ClipOption = Annotated[bool, typer.Option("--clip", help="Nothing shows outside of the canvas.")]
ProfileOption = Annotated[
    str | None,
    typer.Option(
        "--profile",
        metavar="NAME|FILE",
        help="For a machine: .gcode, .nc, .hpgl, .plt or .ebb. `strokeplan profiles` lists them.",
    ),
]
RotateOption = Annotated[int, typer.Option("--rotate", metavar="0|90|180|270", help="Turn the picture clockwise.")]
MirrorOption = Annotated[bool, typer.Option("--mirror", help="Exchange left and right.")]
ScaleOption = Annotated[
    float | None, typer.Option("--scale", help="Of the true size, for plans that have one; else as large as fits.")
]
WithinOption = Annotated[
    Path | None, typer.Option("--within", metavar="SVG", help="Cut to the closed shapes of an SVG, in mm of the page.")
]
KeepOrderOption = Annotated[bool, typer.Option("--keep-order", help="Draw strokes as they come: paint that is wet.")]
SlotsOption = Annotated[
    list[str] | None, typer.Option("--pen", metavar="NAME=SLOT", help="Where a pen is in the machine; may be repeated.")
]
PenFilesOption = Annotated[bool, typer.Option("--file-per-pen", help="A file for every pen, named after it.")]
DateOption = Annotated[
    str | None, typer.Option("--date", metavar="YYYY-MM-DD", help="For the header; by default SOURCE_DATE_EPOCH's.")
]
StrokeLinesOption = Annotated[
    Strokes | None,
    typer.Option("--strokes", help="Of paint: its middle (default), or a bundle of passes that inks its area."),
]
HiddenOption = Annotated[
    Hidden | None, typer.Option("--hidden", help="What later strokes of paint cover; removed by default from bundles.")
]
NearestPensOption = Annotated[
    str | None,
    typer.Option(
        "--pens",
        "--pen-set",
        metavar="SET|FILE|K|profile",
        help="Colours become the nearest pen's: cmyk …, .toml, K pens.",
    ),
]
PenSetOption = Annotated[
    str | None,
    typer.Option("--pen-set", metavar="SET|FILE|K|profile", help="Colours become the nearest pen's: --pens of export."),
]
PenWidthOption = Annotated[
    str | None, typer.Option("--pen-width", metavar="LENGTH", help="Of all pens: 0.5 (mm), 0.5mm, 0.02in.")
]
DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="Say where it goes and how long it takes; write nothing.")
]


@dataclass(frozen=True)
class LayoutGroup:
    """How a drawing lies on the sheet of a machine."""

    PANEL: ClassVar = "Layout"

    page: PageOption = None
    landscape: LandscapeOption = False
    margin: MarginOption = None
    rotate: RotateOption = 0
    mirror: MirrorOption = False
    scale: ScaleOption = None
    clip: ClipOption = False
    within: WithinOption = None


@dataclass(frozen=True)
class LinesGroup:
    """What strokes become as lines of a machine's pens."""

    PANEL: ClassVar = "Lines and pens"

    group_by: GroupOption = GroupBy.layer
    keep_order: KeepOrderOption = False
    strokes: StrokeLinesOption = None
    hidden: HiddenOption = None
    pens: NearestPensOption = None
    pen_width: PenWidthOption = None
    pen: SlotsOption = None


@dataclass(frozen=True)
class PlotLinesGroup(LinesGroup):
    """The same where --pens says which pens draw."""

    pens: PenSetOption = None


MachineOption = Annotated[
    str, typer.Option("--profile", metavar="NAME|FILE", help="The machine; `strokeplan profiles` lists them.")
]
PortOption = Annotated[
    str,
    typer.Option("--port", metavar="PORT|URL", help="As of plot: /dev/ttyUSB0, COM3 …; auto: the only one that fits."),
]
DrivingPortOption = Annotated[
    str | None,
    typer.Option("--port", metavar="PORT|URL", help="/dev/ttyUSB0, COM3, socket://host:port, rfc2217://…, or auto."),
]
BaudOption = Annotated[int | None, typer.Option("--baud", help="Of the port; by default what such machines have.")]
TraceOption = Annotated[
    Path | None, typer.Option("--trace", metavar="FILE", help="Record every byte, both ways, with its time.")
]
HomeOption = Annotated[bool, typer.Option("--home", help="Have the machine look for its switches first.")]
YesOption = Annotated[
    bool,
    typer.Option("--yes", "-y", help="Pen and paper are in place; changes of pen are still asked for."),
]
JobsOption = Annotated[
    Path | None,
    typer.Option("--jobs", metavar="DIR", help="Where jobs are kept; by default in the user's state folder."),
]


@dataclass(frozen=True)
class PortGroup:
    """How a machine is reached."""

    PANEL: ClassVar = "Port"

    port: PortOption = "auto"
    baud: BaudOption = None
    trace: TraceOption = None


@dataclass(frozen=True)
class DrivingGroup:
    """How a machine is driven."""

    PANEL: ClassVar = "Driving"

    port: DrivingPortOption = None
    baud: BaudOption = None
    home: HomeOption = False
    yes: YesOption = False
    jobs: JobsOption = None
    trace: TraceOption = None
    quiet: QuietOption = False


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the options of its groups in their place, as Typer wants them; --help has a panel for each."""
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    shown: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(command).parameters.items():
        shown += (
            _options(groups[name]) if name in groups else [parameter.replace(annotation=hints[name], kind=_BY_NAME)]
        )

    @wraps(command)
    def ungrouped(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        command(**given)

    ungrouped.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]
    return ungrouped


def _options(group: Any) -> Iterator[inspect.Parameter]:
    """The options of a group as parameters of a command."""
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        kind, option = get_args(hints[field.name])
        option = copy(option)
        option.rich_help_panel = group.PANEL
        yield inspect.Parameter(field.name, _BY_NAME, default=field.default, annotation=Annotated[kind, option])
