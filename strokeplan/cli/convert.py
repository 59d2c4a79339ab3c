"""Commands that start from a strokes file: export, info."""

from __future__ import annotations

import typer

from strokeplan.cli.console import echo_written
from strokeplan.cli.machines import export_machine, machine_rows, plot_options
from strokeplan.cli.options import (
    ClassesOption,
    ClipOption,
    DateOption,
    ExportsOption,
    GroupBy,
    GroupOption,
    KeepOrderOption,
    LandscapeOption,
    MarginOption,
    MirrorOption,
    OutlineOption,
    PageOption,
    PenFilesOption,
    PlanArgument,
    PrecisionOption,
    ProfileOption,
    RotateOption,
    ScaleOption,
    SlotsOption,
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
    pen: SlotsOption = None,
    file_per_pen: PenFilesOption = False,
    date: DateOption = None,
) -> None:
    """Write a strokes file in other formats, or for a machine; an option must be one that every output knows."""
    from strokeplan import formats
    from strokeplan.errors import InputError
    from strokeplan.formats.options import ExportOptions
    from strokeplan.page import parse_page

    if profile is not None:
        for name, given in (("units", units), ("precision", precision), ("classes", classes), ("outline", outline)):
            if given:
                raise InputError(f"a file for a machine has no option {name}; leave out --{name}")
        plot = plot_options(
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
        )
        echo_written(*export_machine(plan, output, profile, plot, by_pen=file_per_pen, date=date))
        return
    if rotate or mirror or keep_order or pen or file_per_pen or any(x is not None for x in (scale, within, date)):
        raise InputError(
            "rotate, mirror, scale, within, keep-order, pen, file-per-pen and date are for machines: give --profile"
        )

    options = ExportOptions(
        precision=precision,
        units=units.value if units else None,
        page=parse_page(page, margin, landscape=landscape),
        group_by=group_by.value,
        classes=classes,
        outline=outline,
        clip=clip,
    )
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
) -> None:
    """Say what is in a strokes file, and what a machine would make of it: how long, how far, how many lifts."""
    from strokeplan import formats
    from strokeplan.errors import InputError
    from strokeplan.strokes import describe

    if profile is None and (page is not None or margin is not None or landscape or keep_order):
        raise InputError("page, margin, landscape and keep-order are for machines: give --profile")
    loaded = formats.load(plan)
    rows = describe(loaded)
    if profile is not None:
        by_colour = group_by is GroupBy.colour
        options = plot_options(page, margin, landscape=landscape, by_colour=by_colour, keep_order=keep_order)
        rows += machine_rows(loaded, profile, options)
    typer.echo("\n".join(f"{name:<11} {value}" for name, value in rows))
