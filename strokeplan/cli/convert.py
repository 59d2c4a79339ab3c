"""Commands that start from a strokes file: export, info."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from strokeplan.formats.options import ExportOptions

from strokeplan.cli.console import echo_written
from strokeplan.cli.machines import FOR_MACHINES, echo_rows, export_machine, machine_rows, plot_options, refuse
from strokeplan.cli.options import (
    ClassesOption,
    DateOption,
    DryRunOption,
    ExportsOption,
    LayoutGroup,
    LinesGroup,
    OutlineOption,
    PenFilesOption,
    PlanArgument,
    PrecisionOption,
    ProfileOption,
    UnitsOption,
    grouped,
)


@grouped
def export(
    plan: PlanArgument,
    output: ExportsOption,
    units: UnitsOption = None,
    precision: PrecisionOption = None,
    classes: ClassesOption = False,
    outline: OutlineOption = False,
    profile: ProfileOption = None,
    file_per_pen: PenFilesOption = False,
    date: DateOption = None,
    dry_run: DryRunOption = False,
    *,
    layout: LayoutGroup,
    lines: LinesGroup,
) -> None:
    """Write a strokes file in other formats, or for a machine; an option must be one that every output knows."""
    if profile is not None:
        drawing = {"units": units, "precision": precision, "classes": classes, "outline": outline}
        refuse(drawing, "a file for a machine has no option {0}; leave out --{0}")
        options = plot_options(layout, lines)
        export_machine(plan, output, profile, options, by_pen=file_per_pen, date=date, dry_run=dry_run)
        return
    refuse(layout, FOR_MACHINES, but=("page", "landscape", "margin", "clip"))
    refuse(lines, FOR_MACHINES, but=("group_by",))
    refuse({"file-per-pen": file_per_pen, "date": date, "dry-run": dry_run}, FOR_MACHINES)
    from strokeplan.formats.options import ExportOptions
    from strokeplan.page import parse_page

    _write(
        plan,
        output,
        ExportOptions(
            precision=precision,
            units=units.value if units else None,
            page=parse_page(layout.page, layout.margin, landscape=layout.landscape),
            group_by=lines.group_by.value,
            classes=classes,
            outline=outline,
            clip=layout.clip,
        ),
    )


def _write(plan: Path, output: Sequence[Path], options: ExportOptions) -> None:
    from strokeplan import formats

    for path in output:
        formats.check_options(path, options)
        formats.check_target(path)
    formats.save_all(formats.load(plan), output, options)
    echo_written(*output)


@grouped
def info(plan: PlanArgument, profile: ProfileOption = None, *, layout: LayoutGroup, lines: LinesGroup) -> None:
    """Say what is in a strokes file, and what a machine would make of it: how long, how far, how many lifts."""
    from strokeplan import formats
    from strokeplan.strokes import describe

    if profile is None:
        refuse(layout, FOR_MACHINES)
        refuse(lines, FOR_MACHINES)
    loaded = formats.load(plan)
    rows = describe(loaded)
    if profile is not None:
        rows += machine_rows(loaded, profile, plot_options(layout, lines))
    echo_rows(rows)
