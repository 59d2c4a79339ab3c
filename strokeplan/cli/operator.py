"""Who sits at the machine: keys of the terminal, signals, a progress bar, questions.

p pauses and goes on, u and d lift and lower the pen while it is paused, s and q stop. Ctrl-C stops safely, a second one
at once; SIGTERM and a closed terminal (SIGHUP) count as Ctrl-C.
"""

from __future__ import annotations

import os
import select
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from strokeplan.plotter.driving.streamer import Wish
    from strokeplan.plotter.driving.timetable import Timetable

KEYS_LINE = "keys: p pause or go on, s stop; while paused u pen up, d pen down. Ctrl-C stops safely, twice at once."
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


class Operator:
    """A streamer's Control at a terminal, or without one."""

    def __init__(self, timetable: Timetable, *, yes: bool, update: Callable[..., None] | None) -> None:
        from strokeplan.plotter.driving.streamer import Wish

        self.timetable, self.yes, self.update = timetable, yes, update
        self.keys = {"p": Wish.PAUSE, " ": Wish.PAUSE, "u": Wish.UP, "d": Wish.DOWN, "s": Wish.STOP, "q": Wish.STOP}
        self.stop, self.at_once = Wish.STOP, Wish.EMERGENCY
        self.wishes: deque[Wish] = deque()
        self.stops = 0
        self.live = sys.stdin.isatty()

    def interrupted(self, *_: object) -> None:
        """A signal: the first stops, the second stops at once."""
        self.stops += 1
        if self.stops == 1:
            self.wishes.append(self.stop)

    def emergency(self) -> bool:
        return self.stops > 1

    def wish(self) -> Wish | None:
        if self.emergency():
            return self.at_once
        self._read_keys()
        return self.wishes.popleft() if self.wishes else None

    def _read_keys(self) -> None:
        if self.live and select.select([sys.stdin], [], [], 0)[0]:
            typed = ""
            with suppress(OSError):  # the terminal is gone: SIGHUP says so, too
                typed = os.read(sys.stdin.fileno(), 64).decode("latin-1").lower()
            self.live = bool(typed)
            self.wishes += [self.keys[key] for key in typed if key in self.keys]

    def place(self, text: str) -> bool:
        """Make sure of pen and paper before the first stroke; with --yes they are taken to be in place."""
        if self.yes:
            typer.echo(f"{text}: taken as done (--yes)", err=True)
        return self.yes or self.ask(text)

    def ask(self, text: str) -> bool:
        """Wait for Enter. Nobody can change a pen or a sheet where there is no terminal: then it is a no."""
        if not self.live:
            typer.echo(f"{text}: nobody is here to do it (no terminal)", err=True)
            return False
        typer.echo(f"{text}; then Enter, or s to stop", err=True)
        while not self.stops:
            with suppress(OSError):
                if select.select([sys.stdin], [], [], 0.1)[0]:
                    typed = os.read(sys.stdin.fileno(), 64).decode("latin-1").lower()
                    if not typed or set(typed) & set("sq"):
                        return False
                    if "\n" in typed or "\r" in typed:
                        return True
        self.wishes.clear()
        return False

    def note(self, text: str) -> None:
        with suppress(OSError):
            typer.echo(f"note: {text}", err=True)

    def progress(self, done: int, paused: bool) -> None:
        if self.update is None:
            return
        with suppress(OSError):  # nobody sees it any more
            self.update(**self.timetable.shown(done, paused=paused))


@contextmanager
def at_the_machine(timetable: Timetable, *, yes: bool, quiet: bool) -> Iterator[Operator]:
    """An operator whose keys and signals are heard until the block ends."""
    with _bar(quiet) as update:
        operator = Operator(timetable, yes=yes, update=update)
        if operator.live and not quiet:
            typer.echo(KEYS_LINE, err=True)
        with single_keys(operator.live), signals_heard(operator.interrupted):
            yield operator


@contextmanager
def _bar(quiet: bool) -> Iterator[Callable[..., None] | None]:
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[figures]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("begins", total=1.0, figures="")
        yield lambda **shown: bar.update(task, **shown)


@contextmanager
def single_keys(live: bool) -> Iterator[None]:
    """Keys arrive as they are pressed, and are not shown; Ctrl-C stays a signal."""
    if not live:
        yield
        return
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield
    finally:
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


@contextmanager
def signals_heard(handler: Callable[..., None]) -> Iterator[None]:
    heard: dict[int, Any] = {}

    def call(number: int, frame: FrameType | None) -> None:
        handler(number, frame)

    for name in SIGNALS:
        with suppress(AttributeError, ValueError):  # not on this system; not in the main thread
            number = getattr(signal, name)
            heard[number] = signal.signal(number, call)
    try:
        yield
    finally:
        for number, before in heard.items():
            signal.signal(number, before)
