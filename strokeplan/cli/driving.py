"""Commands that drive a machine: plot, resume, jobs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from strokeplan.cli.machines import echo_report, plot_options
from strokeplan.cli.options import (
    DrivingGroup,
    JobsOption,
    LayoutGroup,
    LinesGroup,
    MachineOption,
    PlanArgument,
    PlotLinesGroup,
    grouped,
)
from strokeplan.cli.session import opened, traced

if TYPE_CHECKING:
    from strokeplan.plotter.driving.codec import Codec
    from strokeplan.plotter.driving.jobs import Job, Order
    from strokeplan.plotter.driving.link import Link
    from strokeplan.plotter.driving.streamer import Ending
    from strokeplan.plotter.driving.units import Script
    from strokeplan.plotter.profile import Profile
    from strokeplan.plotter.program import Program

DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="Say where the drawing lies and how long it takes; open no port.")
]
FirstOption = Annotated[int, typer.Option("--from-stroke", metavar="N", help="Begin with this one, counted from 1.")]
LayersOption = Annotated[
    list[str] | None, typer.Option("--layers", metavar="NAME", help="Only these; may be repeated.")
]
OnlyPensOption = Annotated[
    list[str] | None, typer.Option("--pens", metavar="NAME", help="Only these; may be repeated.")
]
CopiesOption = Annotated[int, typer.Option("--copies", min=1, max=999, help="Draw it so many times, a sheet each.")]
JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="Its name, the beginning of it, or last.")]

jobs_app = typer.Typer(help="List the jobs that were begun; remove one.", invoke_without_command=True)


@grouped
def plot(
    plan: PlanArgument,
    profile: MachineOption,
    dry_run: DryRunOption = False,
    from_stroke: FirstOption = 1,
    layers: LayersOption = None,
    only: OnlyPensOption = None,
    copies: CopiesOption = 1,
    *,
    driving: DrivingGroup,
    layout: LayoutGroup,
    lines: PlotLinesGroup,
) -> None:
    """Draw a strokes file with a machine, stroke by stroke, so that whatever happens it can be resumed."""
    from strokeplan import formats
    from strokeplan.errors import InputError
    from strokeplan.plotter.driving.codecs import codec_for
    from strokeplan.plotter.driving.units import choose, script
    from strokeplan.plotter.profile import load_profile
    from strokeplan.plotter.program import program

    if driving.port is None and not dry_run:
        raise InputError("no port is given; give --port, or --dry-run to see what would be drawn")
    machine = load_profile(profile)
    whole = program(formats.load(plan), machine, plot_options(layout, lines))
    chosen = choose(whole, first=from_stroke, layers=layers or (), pens=only or ())
    work = script(chosen, copies)
    codec = codec_for(machine, work.phrases(int(chosen.pen[0])))
    if not driving.quiet or dry_run:
        echo_report(chosen)
    if dry_run:
        return
    import msgspec

    files, order = _order(plan, profile, layout, lines, chosen, work)
    order = msgspec.structs.replace(
        order,
        first=from_stroke,
        layers=tuple(layers or ()),
        pens=tuple(only or ()),
        port=driving.port,
        baud=driving.baud,
    )

    def begin() -> Job:
        from strokeplan.plotter.driving.jobs import create, jobs_folder

        return create(jobs_folder(driving.jobs), order, files)

    _drive(driving, codec, work, begin, 0)


@grouped
def resume(job: JobArgument, *, driving: DrivingGroup) -> None:
    """Continue a job at the first stroke that is not proven drawn: after a stop, a crash, a pulled cable."""
    from strokeplan.errors import InputError
    from strokeplan.plotter.driving.codecs import codec_for
    from strokeplan.plotter.driving.jobs import find, jobs_folder

    found = find(jobs_folder(driving.jobs), job)
    order = found.order
    if found.finished:
        raise InputError(f"job {found.name} is finished; remove it: strokeplan jobs remove {found.name}")
    work = _rebuilt(found)
    program = work.program
    codec = codec_for(program.profile, work.phrases(int(program.pen[found.done % len(program)])))
    driving = replace(driving, port=driving.port or order.port, baud=driving.baud or order.baud)
    _drive(driving, codec, work, lambda: found, found.done)


def _order(
    plan: Path, profile: str, layout: LayoutGroup, lines: LinesGroup, chosen: Program, work: Script
) -> tuple[dict[str, bytes], Order]:
    """The files of a job, and what was asked for."""
    import hashlib
    from datetime import UTC, datetime

    from strokeplan.plotter.driving.jobs import PROFILE, Order, digest
    from strokeplan.plotter.profile import source
    from strokeplan.version import __version__

    data = plan.read_bytes()
    suffixes = "".join(plan.suffixes[-2:]) if plan.suffix == ".gz" else plan.suffix
    text = Path(profile).read_bytes() if profile.endswith(".toml") else source(profile)
    files = {f"plan{suffixes}": data, PROFILE: text}
    if layout.within is not None:
        files["within.svg"] = layout.within.read_bytes()
    if lines.pens is not None and lines.pens.endswith(".toml"):
        files["pens.toml"] = Path(lines.pens).read_bytes()
    order = Order(
        plan=f"plan{suffixes}",
        plan_sha256=hashlib.sha256(data).hexdigest(),
        profile=chosen.profile.name,
        layout=vars(replace(layout, within=None)),
        lines=vars(lines),
        within="within.svg" if "within.svg" in files else None,
        pen_set="pens.toml" if "pens.toml" in files else None,
        copies=work.copies,
        port="",
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        title=plan.name,
        units=len(work),
        drawing_sha256=digest(chosen),
        version=__version__,
    )
    return files, order


def _rebuilt(job: Job) -> Script:
    """The script of a job's drawing, as it was."""
    import msgspec

    from strokeplan import formats
    from strokeplan.plotter.driving.jobs import PROFILE, check_drawing, check_plan, content
    from strokeplan.plotter.driving.units import choose, script
    from strokeplan.plotter.profile import parse
    from strokeplan.plotter.program import program

    order = job.order
    text = content(job, PROFILE)
    machine = parse(text.read_bytes(), str(text), order.profile)
    layout, lines = msgspec.convert((order.layout, order.lines), tuple[LayoutGroup, LinesGroup])
    if order.within is not None:
        layout = replace(layout, within=content(job, order.within))
    if order.pen_set is not None:
        lines = replace(lines, pens=str(content(job, order.pen_set)))
    whole = program(formats.load(check_plan(job)), machine, plot_options(layout, lines))
    chosen = choose(whole, first=order.first, layers=order.layers, pens=order.pens)
    check_drawing(job, chosen)
    return script(chosen, order.copies)


def _drive(driving: DrivingGroup, codec: Codec, work: Script, begin: Callable[[], Job], first: int) -> None:
    """Greet the machine, make sure of pen and paper, draw, say how it ended."""
    from strokeplan.cli.operator import at_the_machine
    from strokeplan.errors import DriveError
    from strokeplan.plotter.driving.codecs import baud_of
    from strokeplan.plotter.driving.jobs import journal
    from strokeplan.plotter.driving.link import Link
    from strokeplan.plotter.driving.ports import chosen, keep_awake
    from strokeplan.plotter.driving.streamer import Streamer
    from strokeplan.plotter.driving.timetable import timetable
    from strokeplan.plotter.driving.transport import open_port

    table, machine = timetable(work.program, work.copies), work.program.profile
    port = chosen(driving.port or "auto", machine)
    with (
        traced(driving.trace) as record,
        opened(open_port(port, driving.baud or baud_of(machine))) as transport,
        at_the_machine(table, yes=driving.yes, quiet=driving.quiet) as operator,
    ):
        keep_awake(transport, awake=False)
        link = Link(transport, trace=record, emergency=operator.emergency)
        said = _met(link, codec, home=driving.home)
        typer.echo(f"{'port':<11} {port}: {said}", err=True)
        where = _where(machine, known=codec.kept or driving.home)
        if not operator.place(f"{_in_place(work, first)}; {where}{_believed(link, codec, work)}"):
            raise DriveError("stopped before the first stroke; nothing was drawn")
        job = begin()
        log = journal(job, work)
        typer.echo(f"{'job':<11} {job.name}", err=True)
        try:
            operator.progress(first, paused=False)
            ending = Streamer(link, codec, work, operator, log).run(first)
        finally:
            log.close()
    _report(job, work, ending)


def _in_place(work: Script, first: int) -> str:
    """What must be in place before unit `first`, for the person who puts it there."""
    copy, line = divmod(first, len(work.program))
    sheet = (
        "the same sheet lies where it lay"
        if line
        else "the next sheet is in place"
        if copy
        else "the paper is in place"
    )
    pens, pen = work.program.pens, work.program.pens[work.program.pen[line]]
    return sheet if len(pens) == 1 or work.by_itself else f"{sheet}, pen {pen.name!r} (slot {pen.slot}) is in"


def _where(machine: Profile, *, known: bool) -> str:
    """Where the pen must stand before a machine that takes its place for zero, all axes, as it starts."""
    from strokeplan.plotter.tools import ZBrush, ZPen

    if known:
        return "the machine knows its place: it was not moved by hand"
    tool = machine.tool
    if not isinstance(tool, ZPen | ZBrush):
        return "the pen stands at the origin, up"
    paper = tool.down_mm if isinstance(tool, ZPen) else tool.touch_mm
    return f"the pen stands at the origin, its tip where Z is 0 (it touches the paper at Z{paper:g})"


def _met(link: Link, codec: Codec, *, home: bool) -> str:
    from strokeplan.errors import DriveError
    from strokeplan.plotter.driving.link import Emergency

    try:
        said = codec.greet(link)
        if home:
            codec.home(link)
    except Emergency:
        raise DriveError("stopped before the first stroke; nothing was drawn") from None
    return said


def _believed(link: Link, codec: Codec, work: Script) -> str:
    """What the machine says of its place, where that is not its zero: what it says goes."""
    from strokeplan.plotter.driving.codec import Locator

    at = codec.place(link) if isinstance(codec, Locator) else None
    if at is None or max(map(abs, at)) * work.unit_mm < 0.05:
        return ""
    return (
        f" (the machine says that it is at X{at[0] * work.unit_mm:.2f} Y{at[1] * work.unit_mm:.2f}: that is believed)"
    )


def _report(job: Job, work: Script, ending: Ending) -> None:
    """One line on how it ended. Raises DriveError for what is not finished, which says how to go on."""
    from strokeplan.errors import DriveError

    if ending.finished:
        typer.echo(f"{'drawn':<11} all {len(work):,} strokes; the journal stays: strokeplan jobs remove {job.name}")
        return
    pen = "the pen is up" if ending.pen_up else "see to the pen, which may be down"
    place = "" if ending.position_known else "; its position is lost: home it, or set its origin"
    raise DriveError(
        f"{ending.reason}; {ending.done:,} of {len(work):,} strokes are drawn; {pen}{place}; "
        f"continue with: strokeplan resume {job.name}"
    )


@jobs_app.callback()
def listing(context: typer.Context, jobs: JobsOption = None) -> None:
    from strokeplan.plotter.driving.jobs import Job, jobs_folder, listed

    context.obj = jobs
    if context.invoked_subcommand is None:
        for job in listed(jobs_folder(jobs)):
            if isinstance(job, Job):
                state = "finished" if job.finished else f"{100 * job.done / job.order.units:.0f} %"
                typer.echo(
                    f"{job.name:<34} {state:<9} {job.done:,} of {job.order.units:,} strokes, "
                    f"{job.order.profile} at {job.order.port}"
                )
            else:
                typer.echo(f"broken: {job}")


@jobs_app.command("remove")
def remove(context: typer.Context, job: JobArgument) -> None:
    """Forget a job: its plan, its progress."""
    from strokeplan.plotter.driving import jobs as known

    found = known.find(known.jobs_folder(context.obj), job)
    known.remove(found)
    typer.echo(f"removed {found.name}")
