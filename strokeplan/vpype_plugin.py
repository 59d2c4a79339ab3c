"""A command for vpype: `vpype strokeplan photo.jpg --preset sketch linesort write out.svg`.

vpype knows layers of polylines, each with one colour, one pen width and a name, in CSS pixels (96 an inch).
A plan has more: strokes of many colours and widths in a layer, curves, pressure. Curves are flattened to
within a tolerance on the page. Strokes are parted by layer, pen, colour and width if that makes at most
MAX_EXACT layers, so that nothing is lost; if not, by all but width, of which each layer has the median; if
that makes too many as well, there is one vpype layer for each of the plan's, with the mean colour of its
strokes. A note says what was lost.

Known limits: vpype has no width that varies along a line, so a stroke with pressure has its mean width; and
no paper, so the background is left out. Only vpype imports this module.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import vpype as vp
import vpype_cli

from strokeplan.errors import InputError, StrokeplanError, StrokeplanWarning

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from strokeplan.strokes import StrokePlan

MAX_EXACT = 64
"""Most layers that nothing is lost for: more pens than anybody changes."""
WAYS = ("exact", "layer", "color", "pen")
_EXACT = (("layer", "pen", "color", "width"), ("layer", "pen", "color"), ("layer",))
"""What strokes are parted by: the first of these that makes no more layers than that, or the last."""
_NOTES = {
    _EXACT[1]: "every pen width would take more than %d layers: each layer has the median of its strokes",
    _EXACT[
        2
    ]: "every colour would take more than %d layers: here is one for each layer of the plan, in its mean colour; "
    "try --palette 6, or --layer-by color",
}
_WIDTH_STEP = 1e-3
"""Widths nearer than this are one pen."""
_LUMA = (299, 587, 114)
_log = logging.getLogger("strokeplan")


class _Command(click.Command):
    """A command that takes options after its file too: vpype's own take them before it only."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        before, rest = _leading_options(args)
        after, rest[1:] = _leading_options(rest[1:])
        parsed: list[str] = super().parse_args(ctx, [*before, *after, *rest])
        return parsed


def _leading_options(words: list[str]) -> tuple[list[str], list[str]]:
    """The options that `words` begin with, each with its value, and what follows."""
    at = 0
    while at < len(words) and words[at].startswith("-") and words[at] not in ("-", "--"):
        has_value = "=" in words[at] if words[at].startswith("--") else len(words[at]) > 2
        at += 1 if has_value or words[at] == "--help" else 2
    return words[:at], words[at:]


@vpype_cli.cli.command("strokeplan", cls=_Command, group="Input")
@click.argument("file", metavar="PHOTO|PLAN", type=vpype_cli.PathType(exists=True, dir_okay=False))
@click.option("-p", "--preset", metavar="NAME|FILE.toml", type=vpype_cli.TextType(), help="Style (default: fine).")
@click.option("-s", "--seed", type=vpype_cli.IntegerType(), help="Seed of all chance (default: 0).")
@click.option(
    "-n", "--strokes", metavar="N", type=vpype_cli.IntegerType(), help="The best picture with at most N strokes."
)
@click.option(
    "-d", "--detail", metavar="0..1", type=vpype_cli.FloatType(), help="From bold (0) to minute (1); 0.5 as the preset."
)
@click.option(
    "--palette",
    metavar="K|COLOURS|FILE.gpl",
    type=vpype_cli.TextType(),
    help="Only K colours of the photo, a list like #aabbcc,teal, or a file's.",
)
@click.option(
    "--mask",
    type=vpype_cli.PathType(exists=True, dir_okay=False),
    help="Where detail matters: white most, black least.",
)
@click.option("--orientation", type=vpype_cli.ChoiceType(["tensor", "gradient"]), help="Where direction comes from.")
@click.option(
    "--set",
    "settings",
    metavar="KEY=VALUE",
    multiple=True,
    type=vpype_cli.TextType(),
    help="Change one value of the preset; may be repeated.",
)
@click.option("-w", "--width", type=vpype_cli.LengthType(), help="Width of the picture (default: a pixel is 1px).")
@click.option("-h", "--height", type=vpype_cli.LengthType(), help="Height of the picture; with --width, fits both.")
@click.option(
    "-t", "--tolerance", type=vpype_cli.LengthType(), default="0.05mm", help="How far lines may stray from the curves."
)
@click.option(
    "-b", "--layer-by", type=vpype_cli.ChoiceType(WAYS), default="exact", help="What makes a layer (default: exact)."
)
@click.option(
    "-l", "--layer", type=vpype_cli.LayerType(accept_new=True), help="One layer for everything: its number, or 'new'."
)
@vpype_cli.global_processor
def strokeplan(document: vp.Document, file: str, **options: Any) -> vp.Document:
    """Plan the strokes of a photo, or read a strokes file.

    PHOTO is a JPEG, PNG, TIFF, WebP, BMP, GIF or PPM; PLAN is what `strokeplan plan` wrote, a .json or .json.gz.
    `strokeplan presets` lists the styles. The page becomes the picture's, unless there is a larger one.

    With --layer-by exact a layer has one colour and one pen width, layer after layer, light colours first. If
    that would take more than 64 layers, widths are not told apart; and if that still does (most presets have a
    colour for every stroke; try --palette 6), there is one for each layer of the plan, in its mean colour. A
    layer's pen width is the median of its strokes. --layer-by layer, color or pen asks for these alone.

    Examples:

        vpype strokeplan photo.jpg --preset woodcut --width 18cm linesort write out.svg

        vpype strokeplan photo.jpg --preset sketch --palette 6 linemerge linesort write out.svg
    """
    style = {key: options.pop(key) for key in ("preset", "seed", "strokes", "detail", "palette", "mask", "orientation")}
    style["settings"] = list(options.pop("settings"))
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always", StrokeplanWarning)
        try:
            plan = _plan(Path(file), {key: value for key, value in style.items() if value not in (None, [])})
            target = options.pop("layer")
            number = None if target is None else vpype_cli.single_to_layer_id(target, document, must_exist=False)
            add_plan(document, plan, layer=number, **options)
        except StrokeplanError as error:
            failure = click.ClickException(str(error))
            failure.exit_code = error.exit_code
            raise failure from error
    for note in notes:
        _log.warning("%s", note.message)
    document.add_to_sources(file)
    return document


def _plan(file: Path, style: dict[str, Any]) -> StrokePlan:
    """The plan in a strokes file, or of a photo."""
    from strokeplan import formats

    if file.name.lower().endswith(formats.READABLE):
        if style:
            raise InputError(
                f"--{next(iter(style)).replace('settings', 'set')} plans a photo; {file} is planned already"
            )
        return formats.load(file)
    import msgspec

    from strokeplan import planner, presets
    from strokeplan.cli.console import compile_kernels, planning_bar
    from strokeplan.palette import parse_palette

    preset = presets.style(style.pop("preset", "fine"), style.pop("settings", None))
    if "palette" in style:
        preset = preset.override(msgspec.to_builtins(parse_palette(style.pop("palette"))))
    compile_kernels("planner", preset, style.get("strokes"), style.get("detail"), bool(style.get("mask")))
    with planning_bar(quiet=False) as progress:
        return planner.plan(file, preset, style.pop("seed", 0), progress=progress, **style)


def add_plan(
    document: vp.Document,
    plan: StrokePlan,
    *,
    width: float | None = None,
    height: float | None = None,
    tolerance: float = 0.189,
    layer_by: str = "exact",
    layer: int | None = None,
) -> None:
    """Add the strokes of `plan` to a document, as layers after those that are there.

    width, height, tolerance  in CSS pixels; without a size a unit of the plan is 1 px.
    layer_by                  one of WAYS (see the module).
    layer                     one layer for all strokes, by its number.

    Raises InputError.
    """
    import numpy as np

    from strokeplan.curves import flatten_all

    scale = _scale(plan, width, height)
    if not tolerance > 0:
        raise InputError(f"--tolerance {tolerance:g} is not above 0; try 0.05mm")
    vertices, begins = flatten_all(plan.points * scale, plan.starts, tolerance)
    lines = np.split(vertices.copy().view(np.complex128).ravel(), begins[1:-1])
    widths = scale * _mean_widths(plan)
    parts = [_Part("", np.arange(len(plan)))] if layer is not None else list(_parts(plan, widths, layer_by))
    first = layer if layer is not None else max(document.layers, default=0) + 1
    for number, part in enumerate(parts, start=first):
        if len(part.strokes) == 0:
            continue
        document.add([lines[i] for i in part.strokes.tolist()], number)
        made = document.layers[number]
        red, green, blue = np.rint(plan.colors[part.strokes].mean(axis=0)).astype(int).tolist()
        made.set_property(vp.METADATA_FIELD_COLOR, vp.Color(red, green, blue))
        made.set_property(vp.METADATA_FIELD_PEN_WIDTH, float(np.median(widths[part.strokes])))
        made.set_property(vp.METADATA_FIELD_NAME, part.label(number))
    document.extend_page_size((plan.width * scale, plan.height * scale))


def _scale(plan: StrokePlan, width: float | None, height: float | None) -> float:
    """CSS pixels to a unit of the plan."""
    for name, length in (("width", width), ("height", height)):
        if length is not None and not 0 < length < float("inf"):
            raise InputError(f"--{name} {length:g} is not above 0; try 180mm")
    sizes = [given / own for given, own in ((width, plan.width), (height, plan.height)) if given is not None]
    return min(sizes, default=1.0)


def _mean_widths(plan: StrokePlan) -> NDArray[np.float64]:
    """(n,) the mean width of each stroke, in units of the plan."""
    import numpy as np

    if plan.pressures is None:
        return plan.widths
    pressures = np.where(np.isnan(plan.pressures), 1.0, plan.pressures)
    return plan.widths * np.add.reduceat(pressures, plan.first_knots[:-1]) / plan.knots


@dataclass(frozen=True)
class _Part:
    """Strokes that share a layer of vpype, in the order in which they are painted."""

    name: str
    strokes: NDArray[np.int64]

    def label(self, number: int) -> str:
        """The name that the layer gets: with its number first, by which vpype and AxiDraw find it again in a file."""
        return self.name if self.name == str(number) else f"{number} {self.name}".rstrip()


def _parts(plan: StrokePlan, widths: NDArray[np.float64], way: str) -> Iterator[_Part]:
    """The strokes of a plan, parted."""
    import numpy as np

    from strokeplan.strokes import rgb_to_hex

    keys = _keys(plan, widths)
    if way == "pen" and plan.pens is None:
        raise InputError("--layer-by pen: no stroke of this plan names a pen; try --layer-by color")
    for columns in _EXACT if way == "exact" else ((way,),):
        table = np.stack([keys[name] for name in columns], axis=1)
        inverse = np.unique(table, axis=0, return_inverse=True)[1].ravel()
        count = int(inverse.max(initial=-1)) + 1
        if count <= MAX_EXACT:
            break
    if way == "exact" and columns != _EXACT[0]:
        _log.warning(_NOTES[columns], MAX_EXACT)
    order = np.argsort(inverse, kind="stable")
    for strokes in np.split(order, np.cumsum(np.bincount(inverse, minlength=count))[:-1]):
        if len(strokes):
            stroke = int(strokes[0])
            layer = plan.layers[int(keys["layer"][stroke])].name
            names = {
                "layer": f"layer {layer}" if layer.isdecimal() and len(columns) > 1 else layer,
                "pen": (plan.pens and plan.pens[stroke]) or "",
                "color": rgb_to_hex(tuple(plan.colors[stroke].tolist())),
            }
            yield _Part(" ".join(filter(None, (names.get(column) for column in columns))), strokes)


def _keys(plan: StrokePlan, widths: NDArray[np.float64]) -> dict[str, NDArray[np.int64]]:
    """What strokes may be parted by, as numbers whose order is that of the layers: light colours first, as one
    changes pens."""
    import numpy as np

    colors = plan.colors.astype(np.int64)
    pens = np.unique([pen or "" for pen in plan.pens or [None] * len(plan)], return_inverse=True)[1]
    return {
        "layer": np.repeat(np.arange(len(plan.layers)), [layer.last - layer.first for layer in plan.layers]),
        "color": ((255_000 - colors @ np.array(_LUMA)) << 24) + colors @ np.array([65536, 256, 1]),
        "width": np.rint(widths / _WIDTH_STEP).astype(np.int64),
        "pen": pens.astype(np.int64),
    }
