"""What commands show while they work: a progress bar, notes, a summary. Bars and notes go to stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Literal, TypeVar

import typer

if TYPE_CHECKING:
    from concurrent.futures import Future

    from strokeplan.ink import Progress as Drawing
    from strokeplan.layering import Progress

Result = TypeVar("Result")


@contextmanager
def planning_bar(quiet: bool) -> Iterator[Callable[[Progress], None] | None]:
    """A progress callback for the planner that shows layer, strokes and error; None where nobody looks."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[figures]}"),
    )
    with Bar(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading", total=1.0, figures="")

        def show(step: Progress) -> None:
            bar.update(
                task,
                description=f"layer {step.layer} of {step.layers}",
                completed=(step.layer - 1 + step.done / step.total) / step.layers,
                figures=f"{step.strokes:,} strokes, error {step.error:.1f}",
            )

        yield show


def begin(work: Callable[..., Result], *arguments: object) -> Future[Result]:
    """Begin `work` in a thread of its own, which nobody waits for when the program ends.

    Its result, or its error, is the future's.
    """
    from concurrent.futures import Future

    future: Future[Result] = Future()

    def settle() -> None:
        try:
            future.set_result(work(*arguments))
        except BaseException as error:
            future.set_exception(error)

    Thread(target=settle, daemon=True).start()
    return future


@contextmanager
def painting_bar(quiet: bool, what: str = "painting") -> Iterator[Callable[..., None] | None]:
    """A progress callback (how much is done, and of how much if not of 1) for a picture; None where nobody looks."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what)
        yield lambda done, total=1.0, **said: bar.update(task, completed=done, total=total, **said)


@contextmanager
def drawing_bar(quiet: bool) -> Iterator[Callable[[Drawing], None] | None]:
    """A progress callback for drawing in ink; a budget takes several drawings. None where nobody looks."""
    with painting_bar(quiet, "drawing") as show:
        if show is None:
            yield None
            return

        def tell(step: Drawing) -> None:
            what = "drawing" if step.drawing == 1 else f"drawing {step.drawing}, for the budget"
            show(step.done, step.total, description=what)

        yield tell


def compile_kernels(stage: Literal["planner", "ink"], *arguments: object) -> None:
    """Compile the kernels of painting or drawing so, and say so, unless that has been done on this machine.

    arguments  those of the stage's own `compiled` and `warm_up`.
    """
    module = import_module(f"strokeplan.{stage}")
    if not module.compiled(*arguments):
        typer.echo("compiling the kernels for this machine, once: about half a minute", err=True)
        # In a thread, because the compiler hears no Ctrl-C for seconds, and waiting does.
        compiler = Thread(target=module.warm_up, args=arguments, daemon=True)
        compiler.start()
        compiler.join()


def echo_written(*paths: Path) -> None:
    """Say which files there are now, and how large."""
    typer.echo("wrote " + ", ".join(map(file_line, paths)))


def file_line(path: Path) -> str:
    """ "photo.svg (1.2 MB)"."""
    return f"{path} ({size_text(path.stat().st_size)})"


def size_text(size: int) -> str:
    """1234567 → "1.2 MB"."""
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
