"""The command line: thin commands that parse, call and report. No algorithm here.

Nothing heavy is imported before a command runs, so that `strokeplan --help` answers at once.
"""

from __future__ import annotations

import gc
import os
import sys
import warnings
from contextlib import suppress
from typing import Annotated

import typer

from strokeplan.cli import (
    convert,
    driving,
    inkscape,
    inspection,
    pen,
    planning,
    presets,
    preview,
    profiles,
    rendering,
    setup,
    simulating,
)
from strokeplan.errors import StrokeplanError
from strokeplan.version import __version__

INTERRUPTED = 130

app = typer.Typer(
    name="strokeplan",
    help="Turn a photograph into brush or pen strokes and keep them as vectors.",
    epilog="Start with: strokeplan plan photo.jpg -o photo.svg",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_debug = False


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"strokeplan {__version__}")
        raise typer.Exit


@app.callback()
def root(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    global _debug
    _debug = debug


app.command("plan")(planning.plan)
app.command("render")(rendering.render)
app.command("export")(convert.export)
app.command("info")(convert.info)
app.command("evaluate")(inspection.evaluate)
app.command("brushes")(rendering.brushes)
app.command("inspect")(inspection.inspect)
app.command("montage")(inspection.montage)
app.command("preview")(preview.preview)
app.command("plot")(driving.plot)
app.command("resume")(driving.resume)
app.add_typer(driving.jobs_app, name="jobs")
app.command("ports")(setup.ports)
app.command("jog", context_settings={"ignore_unknown_options": True})(setup.jog)
app.command("home")(setup.home)
app.command("frame")(setup.frame)
app.command("origin")(setup.origin)
app.add_typer(pen.app, name="pen")
app.command("simulate")(simulating.simulate)
app.add_typer(presets.app, name="presets")
app.add_typer(profiles.app, name="profiles")
app.add_typer(inkscape.app, name="inkscape")


def run() -> None:
    """The command line as a process of its own: `main`, and then the end at once.

    Python would first free every object there is, one by one, which costs 0.1 s once Numba has been imported.
    """
    try:
        main()
    except SystemExit as ended:
        code = ended.code or 0
        if isinstance(code, str):
            raise  # Python prints it
        with suppress(OSError, ValueError):  # nobody listens any more: Python has its own way to say so
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        raise


def main() -> None:
    """Run the command line; errors are one line on stderr, and the exit code says what kind."""
    # No command does linear algebra; the threads that NumPy's library would start for it cost 0.2 s of CPU.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Importing Numba makes 200,000 objects that stay: to look for garbage among them again and again costs 0.07 s.
    gc.set_threshold(1_000_000)
    warnings.showwarning = lambda message, *_: typer.echo(f"note: {message}", err=True)
    try:
        app(prog_name="strokeplan")  # ends in SystemExit; Typer itself reports errors of usage, with exit code 2
    except StrokeplanError as error:
        _fail(str(error), error.exit_code)
    except MemoryError:
        _fail("out of memory; try a smaller picture", 1)
    except SystemExit as ended:
        if ended.code != INTERRUPTED:  # what Typer makes of Ctrl-C
            raise
        typer.echo("error: interrupted; no file was left half written", err=True)
        sys.stderr.flush()
        os._exit(INTERRUPTED)  # at once: an ordinary end waits for threads, which may be deep in the compiler


def _fail(message: str, code: int) -> None:
    if _debug:
        raise
    typer.echo(f"error: {message}", err=True)
    sys.exit(code)
