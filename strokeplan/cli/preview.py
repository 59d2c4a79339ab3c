"""strokeplan preview."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from strokeplan.cli.console import echo_written, painting_bar
from strokeplan.cli.machines import FOR_MACHINES, plot_options, refuse
from strokeplan.cli.options import LayoutGroup, LinesGroup, PlanArgument, ProfileOption, QuietOption, grouped

if TYPE_CHECKING:
    from strokeplan.plotter.options import PlotOptions
    from strokeplan.preview.plotting import Plot
    from strokeplan.strokes import StrokePlan


@grouped
def preview(
    plan: PlanArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="OUT.html", help="The page to write, one file for all.")
    ] = None,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    video: Annotated[
        Path | None, typer.Option("--video", metavar="OUT.gif|.webp", help="Also, or only, the time lapse.")
    ] = None,
    seconds: Annotated[float, typer.Option("--seconds", help="How long the time lapse paints.")] = 10.0,
    fps: Annotated[float, typer.Option("--fps", help="Its frames a second, at most 50.")] = 20.0,
    width: Annotated[int | None, typer.Option("--width", help="Its width in pixels; by default up to 800.")] = None,
    quiet: QuietOption = False,
    profile: ProfileOption = None,
    *,
    layout: LayoutGroup,
    lines: LinesGroup,
) -> None:
    """Watch a strokes file being painted, or with --profile plotted: a page that plays it, a time lapse."""
    _check_targets(plan, output, video, open_page)
    from strokeplan import formats
    from strokeplan.preview import save_page, save_time_lapse

    strokes, plot = formats.load(plan), None
    if profile is None:
        refuse(layout, FOR_MACHINES)
        refuse(lines, FOR_MACHINES)
    else:
        strokes, plot = _plotted(strokes, profile, plot_options(layout, lines))
    if video is not None:
        with painting_bar(quiet, "time lapse") as progress:
            save_time_lapse(strokes, video, seconds=seconds, fps=fps, width=width, progress=progress)
    if output is not None:
        save_page(strokes, output, plot)
    if not quiet:
        echo_written(*(path for path in (output, video) if path is not None))
    if output is not None and open_page:
        _open(output)


def _plotted(plan: StrokePlan, profile: str, options: PlotOptions) -> tuple[StrokePlan, Plot]:
    """The lines that the machine of a profile draws, and what the page shows beside them."""
    from strokeplan.pens import PenSet
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program
    from strokeplan.preview.plotting import plot_of
    from strokeplan.strokes import hex_to_rgb

    ink = any(layer.medium == "ink" for layer in plan.layers)
    paper = plan.background if ink else (255, 255, 255)
    if isinstance(options.pens, PenSet):
        paper = hex_to_rgb(options.pens.paper)
    return plot_of(program(plan, load_profile(profile), options), paper)


def _check_targets(plan: Path, output: Path | None, video: Path | None, open_page: bool) -> None:
    """Raise now what writing would raise later."""
    from strokeplan.errors import InputError
    from strokeplan.files import check_writable
    from strokeplan.preview import check_page, check_time_lapse
    from strokeplan.rendering import require_cairo

    if output is None and video is None:
        raise InputError("nothing to write; give -o OUT.html for the page or --video OUT.gif for the time lapse")
    if output is None and open_page:
        raise InputError("--open has no page to open; give -o OUT.html")
    if output is not None:
        check_page(output)
    if video is not None:
        require_cairo()
        check_time_lapse(video)
    for path in filter(None, (output, video)):
        check_writable(path, plan)


def _open(page: Path) -> None:
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        typer.echo(f"note: no browser was found; open {page} in one", err=True)
