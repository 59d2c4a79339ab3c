"""Commands that draw what the method sees: inspect, montage."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from strokeplan.cli.console import compile_kernels, echo_written, planning_bar
from strokeplan.cli.options import ImageArgument, PresetOption, QuietOption, SeedOption, SetOption


def inspect(
    image: ImageArgument,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the figures; made if missing.")
    ],
    preset: PresetOption = "paper",
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
) -> None:
    """Draw orientation, coherence and tracts of a photo, as the paper's Figures 2 and 3."""
    from strokeplan import figures, formats, presets, rendering
    from strokeplan.image import load_photo
    from strokeplan.planner import layer_field, layer_spread, layer_tract, plan

    rendering.require_cairo()
    formats.check_folder(output)
    style = presets.style(preset, settings)
    if wander is not None:
        style = style.override({"wander": wander})
    photo = load_photo(image)
    compile_kernels()
    field = layer_field(photo, style, layer)
    start = figures.clearest_point(field) if point is None else _parse_point(point)
    tract = layer_tract(field, style, layer, start)
    pictures = {
        "orientation.png": figures.orientation_figure(photo, field, spacing=spacing),
        "coherence.png": figures.coherence_figure(field),
        "tract.png": figures.tract_figure(photo, tract, start),
    }
    if count is not None:
        spread = layer_spread(field, style, layer, start, count, seed)
        pictures["spread.png"] = figures.spread_figure(photo, spread, start)
    if compare:
        sides = [rendering.render(plan(photo, style, seed, orientation=kind)) for kind in ("gradient", "tensor")]
        pictures["compare.png"] = figures.side_by_side(sides)
    output.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        formats.write(output / name, rendering.encode_png(picture))
        echo_written(output / name)


def montage(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE", help="Photos, or folders of photos.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT", help="The sheet to write: .png.")],
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
    compile_kernels()
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
    formats.write(output, rendering.encode_png(figures.montage(pictures, columns=columns)))
    echo_written(output)


def _parse_point(text: str) -> tuple[float, float]:
    from strokeplan.errors import InputError

    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--point {text!r} is not X,Y; try 120,80") from None
    return x, y
