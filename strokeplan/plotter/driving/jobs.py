"""Jobs on disk: a folder each, with everything that continues one, whatever has become of the plan's own file.

They live in $XDG_STATE_HOME/strokeplan/jobs (else ~/.local/state/strokeplan/jobs). A folder appears whole or not
at all. The drawing is made anew from the plan and the options, and must come out the same (its digest says so).
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from strokeplan.errors import InputError, OutputError
from strokeplan.plotter.driving.journal import Journal, passed
from strokeplan.plotter.driving.units import Script
from strokeplan.plotter.program import Program

ORDER, PROFILE, LOG = "job.json", "profile.toml", "progress.log"
MAX_BYTES = 1_000_000


class Order(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What was asked for."""

    plan: str
    """Name of the plan's copy in the folder."""
    plan_sha256: str
    profile: str
    """Its name; its text is in the folder."""
    layout: dict[str, Any]
    lines: dict[str, Any]
    """Options of the program, as the command line names them."""
    within: str | None = None
    """Name of the copy of an area's SVG."""
    pen_set: str | None = None
    """Name of the copy of a set of pens."""
    first: int = 1
    layers: tuple[str, ...] = ()
    pens: tuple[str, ...] = ()
    copies: int = 1
    port: str
    baud: int | None = None
    created: str
    title: str
    units: int
    """How many there are, all copies together."""
    drawing_sha256: str
    version: str


@dataclass(frozen=True, slots=True)
class Job:
    """A job's folder, and how far it is."""

    folder: Path
    order: Order
    done: int

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def finished(self) -> bool:
        return self.done >= self.order.units


def jobs_folder(given: Path | None = None) -> Path:
    """Where jobs live."""
    if given is not None:
        return given
    home = os.environ.get("XDG_STATE_HOME") or ""
    return (Path(home) if Path(home).is_absolute() else Path.home() / ".local" / "state") / "strokeplan" / "jobs"


def digest(program: Program) -> str:
    """SHA-256 of what a program draws, and in which order."""
    found = hashlib.sha256()
    for column in (program.points, program.starts, program.pen, program.layer, program.radii):
        found.update(np.ascontiguousarray(column).tobytes())
    return found.hexdigest()


def create(folder: Path, order: Order, copies: dict[str, bytes]) -> Job:
    """A new job, on the disk before it returns. Raises OutputError: then nothing has been made."""
    stem = re.sub(r"[^A-Za-z0-9]+", "-", Path(order.title).stem).strip("-").lower()[:30] or "drawing"
    name = f"{re.sub(r'[^0-9]', '', order.created)[:14]}-{stem}"
    made: Path | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=".new-", dir=folder))
        for file, data in {ORDER: msgspec.json.encode(order), LOG: b"", **copies}.items():
            _write(made / file, data)
        _sync_folder(made)
        for k in range(1, 1000):
            target = folder / (name if k == 1 else f"{name}-{k}")
            if not target.exists():
                break
        made.rename(target)
        _sync_folder(folder)
    except OSError as error:
        if made is not None:
            shutil.rmtree(made, ignore_errors=True)
        raise OutputError(
            f"{folder}: the job cannot be written down ({error.strerror}), and without that nothing is drawn; "
            "give another place: --jobs DIR"
        ) from None
    return Job(target, order, 0)


def _write(path: Path, data: bytes) -> None:
    with path.open("xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def _sync_folder(path: Path) -> None:
    with suppress(OSError):  # not every system can
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def find(folder: Path, name: str) -> Job:
    """The job of a name, or of the beginning of one; "last" is the newest. Raises InputError."""
    known = [path.name for path in _folders(folder)]
    fitting = known[-1:] if name == "last" else [one for one in known if one == name]
    fitting = fitting or [one for one in known if one.startswith(name)]
    if len(fitting) != 1:
        few = ", ".join(known[-8:]) or "none"
        raise InputError(f"job {name!r} is {'not there' if not fitting else 'not the only one'}; there are {few}")
    return read(folder / fitting[0])


def listed(folder: Path) -> list[Job | InputError]:
    """All jobs, the oldest first; the error of one that cannot be read stands in its place."""
    found: list[Job | InputError] = []
    for path in _folders(folder):
        try:
            found.append(read(path))
        except InputError as error:
            found.append(error)
    return found


def _folders(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except FileNotFoundError:
        return []
    except OSError as error:
        raise InputError(f"{folder}: cannot be looked into ({error.strerror})") from None


def read(folder: Path) -> Job:
    """The job of a folder. Raises InputError for one that is damaged."""
    try:
        order = msgspec.json.decode(_bytes(folder / ORDER), type=Order)
    except msgspec.DecodeError as error:
        raise InputError(f"{folder / ORDER}: is no job ({error})") from None
    log = folder / LOG
    return Job(folder, order, passed(_bytes(log, None))[0] if log.exists() else 0)


def content(job: Job, name: str) -> Path:
    """A file of a job, which must be within its folder. Raises InputError."""
    if Path(name).name != name or not (job.folder / name).is_file():
        raise InputError(f"{job.folder}: its file {name!r} is missing")
    return job.folder / name


def check_plan(job: Job) -> Path:
    """The plan of a job, unchanged. Raises InputError."""
    path = content(job, job.order.plan)
    if hashlib.sha256(_bytes(path, None)).hexdigest() != job.order.plan_sha256:
        raise InputError(f"{path}: is not the plan that the job began with")
    return path


def check_drawing(job: Job, program: Program) -> None:
    """Raise InputError if the plan does not come out as it did."""
    if digest(program) != job.order.drawing_sha256:
        raise InputError(
            f"job {job.name}: strokeplan {job.order.version}, which began it, makes another order of these strokes; "
            f"continue with that version, or plot anew with --from-stroke {job.done + 1}"
        )


def journal(job: Job, script: Script) -> Journal:
    """The log of a job, for this process alone. Raises OutputError."""
    return Journal(job.folder / LOG, script.describe)


def remove(job: Job) -> None:
    """Forget a job. Raises OutputError."""
    try:
        shutil.rmtree(job.folder)
    except OSError as error:
        raise OutputError(f"{job.folder}: cannot be removed ({error.strerror})") from None


def _bytes(path: Path, most: int | None = MAX_BYTES) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(-1 if most is None else most)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
