"""Commands that start from a strokes file: export, info."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from strokeplan.formats.options import ExportOptions

from strokeplan.cli.console import echo_written
from strokeplan.cli.machines import echo_rows, export_machine, machine_rows, plot_options, refuse
from strokeplan.cli.options import (
    ClassesOption,
    ClipOption,
    DateOption,
    DryRunOption,
    ExportsOption,
    GroupBy,
    GroupOption,
    HiddenOption,
    KeepOrderOption,
    LandscapeOption,
    MarginOption,
    MirrorOption,
    NearestPensOption,
    OutlineOption,
    PageOption,
    PenFilesOption,
    PenWidthOption,
    PlanArgument,
    PrecisionOption,
    ProfileOption,
    RotateOption,
    ScaleOption,
    SlotsOption,
    StrokeLinesOption,
    UnitsOption,
    WithinOption,
)


def export(
    plan: PlanArgument,
    output: ExportsOption,
    page: PageOption = None,
    landscape: LandscapeOption = False,
    margin: MarginOption = None,
    units: UnitsOption = None,
    precision: PrecisionOption = None,
    group_by: GroupOption = GroupBy.layer,
    classes: ClassesOption = False,
    outline: OutlineOption = False,
    clip: ClipOption = False,
    profile: ProfileOption = None,
    rotate: RotateOption = 0,
    mirror: MirrorOption = False,
    scale: ScaleOption = None,
    within: WithinOption = None,
    keep_order: KeepOrderOption = False,
    strokes: StrokeLinesOption = None,
    hidden: HiddenOption = None,
    pens: NearestPensOption = None,
    pen_width: PenWidthOption = None,
    pen: SlotsOption = None,
    file_per_pen: PenFilesOption = False,
    date: DateOption = None,
    dry_run: DryRunOption = False,
) -> None:
    """Write a strokes file in other formats, or for a machine; an option must be one that every output knows."""
    drawing = {"units": units, "precision": precision, "classes": classes, "outline": outline}
    machine = {
        "rotate": rotate,
        "mirror": mirror,
        "scale": scale,
        "within": within,
        "keep-order": keep_order,
        "strokes": strokes,
        "hidden": hidden,
        "pens": pens,
        "pen-width": pen_width,
        "pen": pen,
        "file-per-pen": file_per_pen,
        "date": date,
        "dry-run": dry_run,
    }
    if profile is not None:
        refuse(drawing, "a file for a machine has no option {0}; leave out --{0}")
        options = plot_options(
            page,
            margin,
            landscape=landscape,
            rotate=rotate,
            mirror=mirror,
            scale=scale,
            clip=clip,
            within=within,
            by_colour=group_by is GroupBy.colour,
            keep_order=keep_order,
            slots=pen,
            strokes=strokes.value if strokes else None,
            hidden=hidden.value if hidden else None,
            pens=pens,
            pen_width=pen_width,
        )
        export_machine(plan, output, profile, options, by_pen=file_per_pen, date=date, dry_run=dry_run)
        return
    refuse(machine, "{0} is for machines: give --profile")
    from strokeplan.formats.options import ExportOptions
    from strokeplan.page import parse_page

    _write(
        plan,
        output,
        ExportOptions(
            precision=precision,
            units=units.value if units else None,
            page=parse_page(page, margin, landscape=landscape),
            group_by=group_by.value,
            classes=classes,
            outline=outline,
            clip=clip,
        ),
    )


def _write(plan: Path, output: Sequence[Path], options: ExportOptions) -> None:
    from strokeplan import formats

    for path in output:
        formats.check_options(path, options)
        formats.check_target(path)
    formats.save_all(formats.load(plan), output, options)
    echo_written(*output)


def info(
    plan: PlanArgument,
    profile: ProfileOption = None,
    page: PageOption = None,
    landscape: LandscapeOption = False,
    margin: MarginOption = None,
    group_by: GroupOption = GroupBy.layer,
    keep_order: KeepOrderOption = False,
    strokes: StrokeLinesOption = None,
    hidden: HiddenOption = None,
    pens: NearestPensOption = None,
    pen_width: PenWidthOption = None,
) -> None:
    """Say what is in a strokes file, and what a machine would make of it: how long, how far, how many lifts."""
    from strokeplan import formats
    from strokeplan.strokes import describe

    if profile is None:
        machine = {
            "page": page,
            "margin": margin,
            "landscape": landscape,
            "keep-order": keep_order,
            "strokes": strokes,
            "hidden": hidden,
            "pens": pens,
            "pen-width": pen_width,
        }
        refuse(machine, "{0} is for machines: give --profile")
    loaded = formats.load(plan)
    rows = describe(loaded)
    if profile is not None:
        options = plot_options(
            page,
            margin,
            landscape=landscape,
            by_colour=group_by is GroupBy.colour,
            keep_order=keep_order,
            strokes=strokes.value if strokes else None,
            hidden=hidden.value if hidden else None,
            pens=pens,
            pen_width=pen_width,
        )
        rows += machine_rows(loaded, profile, options)
    echo_rows(rows)
