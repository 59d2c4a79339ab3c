"""Commands that look at what the method sees and makes: inspect, montage, evaluate."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from strokeplan.cli.console import compile_kernels, echo_written, planning_bar
from strokeplan.cli.options import ImageArgument, PresetOption, QuietOption, SeedOption, SetOption

if TYPE_CHECKING:
    from strokeplan.evaluate import PlanFigures
    from strokeplan.presets import Preset


def inspect(
    image: ImageArgument,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the figures; made if missing.")
    ],
    preset: PresetOption = "fine",
    seed: SeedOption = 0,
    settings: SetOption = None,
    layer: Annotated[int, typer.Option("--layer", help="Layer whose scale is shown, from 1.")] = 2,
    point: Annotated[
        str | None,
        typer.Option("--point", metavar="X,Y", help="Seed of the tract, in pixels; by default a clear place."),
    ] = None,
    spacing: Annotated[
        float | None, typer.Option("--spacing", help="Pixels between arrows; by default by size.")
    ] = None,
    wander: Annotated[
        float | None, typer.Option("--wander", help="How far tracts stray, 0 to 1; by default as the preset says.")
    ] = None,
    count: Annotated[
        int | None, typer.Option("--count", help="Also so many tracts that wander from the one seed.")
    ] = None,
    compare: Annotated[bool, typer.Option("--compare", help="Also gradient beside tensor strokes (Figure 3).")] = False,
    suffix: Annotated[
        str, typer.Option("--format", metavar="SUFFIX", help="Of the figures: png, tif, jpg or webp.")
    ] = "png",
) -> None:
    """Draw orientation, coherence and tracts of a photo, as the paper's Figures 2 and 3."""
    from strokeplan import figures, formats, presets, rendering
    from strokeplan.errors import FormatError
    from strokeplan.image import load_photo
    from strokeplan.layer_fields import layer_field, layer_spread, layer_tract
    from strokeplan.planner import plan

    rendering.require_cairo()
    formats.check_folder(output)
    suffix = "." + suffix.removeprefix(".")
    if suffix not in formats.PICTURES:
        raise FormatError(f"--format {suffix} is no picture's; known are {', '.join(formats.PICTURES)}")
    style = presets.style(preset, settings)
    if wander is not None:
        style = style.override({"wander": wander})
    photo = load_photo(image)
    compile_kernels("planner", style)
    field = layer_field(photo, style, layer)
    start = figures.clearest_point(field) if point is None else _parse_point(point)
    tract = layer_tract(field, style, layer, start)
    drawn = {
        "orientation": figures.orientation_figure(photo, field, spacing=spacing),
        "coherence": figures.coherence_figure(field),
        "tract": figures.tract_figure(photo, tract, start),
    }
    if count is not None:
        spread = layer_spread(field, style, layer, start, count, seed)
        drawn["spread"] = figures.spread_figure(photo, spread, start)
    if compare:
        sides = [rendering.render(plan(photo, style, seed, orientation=kind)) for kind in ("gradient", "tensor")]
        drawn["compare"] = figures.side_by_side(sides)
    output.mkdir(parents=True, exist_ok=True)
    for name, picture in drawn.items():
        path = output / f"{name}{suffix}"
        formats.write(path, rendering.encode_picture(picture, path))
        echo_written(path)


def montage(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE", help="Photos, or folders of photos.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", help="The sheet to write: .png, .tif, .jpg or .webp.")
    ],
    preset: PresetOption = "paper-published",
    seed: SeedOption = 0,
    settings: SetOption = None,
    columns: Annotated[int, typer.Option("--columns", help="Pictures in a row.")] = 5,
    tile: Annotated[int, typer.Option("--tile", help="Longer side of a picture on the sheet, in pixels.")] = 512,
    originals: Annotated[bool, typer.Option("--originals", help="Show the photos themselves.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Plan many photos and show them on one sheet, as the paper shows its datasets."""
    from strokeplan import figures, formats, presets, rendering
    from strokeplan.image import load_photo, photo_files
    from strokeplan.planner import plan

    paths = photo_files(images)
    formats.check_picture(output, *paths)
    style = presets.style(preset, settings)
    figures.check_montage(columns, tile)
    compile_kernels("planner", style)
    pictures = []
    for path in paths:
        photo = load_photo(path)
        scale = tile / max(photo.width, photo.height)
        if originals:
            pictures.append(figures.shrink(photo.rgb, scale))
            continue
        with planning_bar(quiet) as progress:
            strokes = plan(photo, style, seed, progress=progress)
        # Painted at full size, then reduced: strokes below a pixel keep their weight.
        pictures.append(figures.shrink(rendering.render(strokes), scale))
        if not quiet:
            typer.echo(f"{path.name}: {len(strokes):,} strokes", err=True)
    formats.write(output, rendering.encode_picture(figures.montage(pictures, columns=columns), output))
    echo_written(output)


def evaluate(
    plan: Annotated[
        Path | None,
        typer.Argument(
            metavar="PLAN", help="A strokes file (.json, .json.gz) or an SVG (.svg, .svgz).", show_default=False
        ),
    ] = None,
    image: Annotated[Path | None, typer.Argument(metavar="IMAGE", help="Its photo.", show_default=False)] = None,
    folder: Annotated[
        Path | None, typer.Option("--set", metavar="DIR", help="Plan every photo of a folder and compare these.")
    ] = None,
    preset: Annotated[
        list[str] | None,
        typer.Option(
            "--preset", "-p", metavar="NAME|FILE.toml", help="With --set: a style, may be repeated; by default all."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Compare a strokes file with its photo, or styles on a set of photos: fidelity, edges, bare canvas, size."""
    from strokeplan import rendering
    from strokeplan.errors import InputError

    if folder is not None and plan is not None:
        raise InputError(f"give PLAN and IMAGE or --set DIR, not both: {plan}, --set {folder}")
    rendering.require_cairo()
    if folder is not None:
        _evaluate_set(folder, preset, as_json)
    elif plan is None or image is None:
        raise InputError("nothing to compare; give PLAN and IMAGE, or --set DIR")
    elif preset:
        raise InputError(f"--preset {preset[0]} has nothing to plan; it goes with --set DIR")
    else:
        _evaluate_plan(plan, image, as_json)


def _evaluate_plan(plan: Path, image: Path, as_json: bool) -> None:
    import json
    from dataclasses import asdict

    from strokeplan import formats
    from strokeplan.evaluate import COLUMNS, cells, evaluate, json_figures
    from strokeplan.image import load_photo

    strokes, photo = formats.load(plan), load_photo(image)
    figures = asdict(evaluate(strokes, photo))
    if strokes.source is not None and strokes.source.sha256 not in ("", photo.sha256):
        typer.echo(f"note: {plan} was planned from another file, {strokes.source.name}", err=True)
    if as_json:
        typer.echo(json.dumps(json_figures(figures), indent=2))
        return
    for (heading, _), cell in zip(COLUMNS.values(), cells(figures), strict=True):
        typer.echo(f"{heading:<13} {cell}")


def _evaluate_set(folder: Path, presets: list[str] | None, as_json: bool) -> None:
    import json
    from dataclasses import asdict

    from strokeplan.evaluate import COLUMNS, cells, json_figures, means
    from strokeplan.presets import load_preset, names

    styles = {name: load_preset(name) for name in presets or names()}
    results = list(_evaluated(folder, styles))
    mean = {name: means([figures for _, style, figures in results if style == name]) for name in styles}
    if as_json:
        photos = [{"photo": photo, "preset": name} | json_figures(asdict(figures)) for photo, name, figures in results]
        mean_figures = {name: json_figures(figures) for name, figures in mean.items()}
        typer.echo(json.dumps({"photos": photos, "means": mean_figures}, indent=2))
        return
    rows = [["photo", "preset", *(heading for heading, _ in COLUMNS.values())]]
    rows += [[photo, name, *cells(asdict(figures))] for photo, name, figures in results]
    rows += [["mean", name, *cells(figures)] for name, figures in mean.items()]
    typer.echo("\n".join(_aligned(rows)))


def _evaluated(folder: Path, styles: dict[str, Preset]) -> Iterator[tuple[str, str, PlanFigures]]:
    """Every photo of a folder planned in every style: (photo, style, figures), told on stderr as they come."""
    from strokeplan.errors import ImageError
    from strokeplan.evaluate import evaluate
    from strokeplan.image import load_photo, photo_files
    from strokeplan.planner import plan

    if not folder.is_dir():
        raise ImageError(f"--set {folder}: is no folder")
    paths = photo_files([folder])
    for style in styles.values():
        compile_kernels("planner", style)
    for path in paths:
        photo = load_photo(path)
        for name, style in styles.items():
            with planning_bar(quiet=False) as progress:
                strokes = plan(photo, style, progress=progress)
            figures = evaluate(strokes, photo)
            typer.echo(f"{photo.name}, {name}: {figures.psnr_db:.2f} dB, {len(strokes):,} strokes", err=True)
            yield photo.name, name, figures


def _aligned(rows: list[list[str]]) -> Iterator[str]:
    """Rows of cells as lines: two names to the left, figures to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        padded = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
        padded[:2] = [cell.ljust(width) for cell, width in zip(row[:2], widths[:2], strict=True)]
        yield "  ".join(padded)


def _parse_point(text: str) -> tuple[float, float]:
    from strokeplan.errors import InputError

    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--point {text!r} is not X,Y; try 120,80") from None
    return x, y
