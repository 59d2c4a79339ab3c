"""Files for machines: a plan and a profile become bytes, one file or one for each pen.

The suffix must be the profile's dialect's: .gcode, .nc, .ngc, .tap; .hpgl, .plt; .ebb. The header says what is drawn,
with what, how long it takes and how far it goes; when, only if told.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from strokeplan.errors import PlotError
from strokeplan.plotter.estimate import clock, estimate
from strokeplan.plotter.profile import Ebb, Gcode, Hpgl, Profile
from strokeplan.plotter.program import Program
from strokeplan.version import __version__

SUFFIXES: dict[str, type] = {
    ".gcode": Gcode, ".nc": Gcode, ".ngc": Gcode, ".tap": Gcode, ".hpgl": Hpgl, ".plt": Hpgl, ".ebb": Ebb,
}  # fmt: skip


def check_suffix(path: str | os.PathLike[str], profile: Profile) -> None:
    """Raise PlotError for a suffix that is not one of the profile's language."""
    fitting = [suffix for suffix, kind in SUFFIXES.items() if isinstance(profile.dialect, kind)]
    if Path(path).suffix.lower() not in fitting:
        raise PlotError(f"{path}: {profile.name} takes {', '.join(fitting)} files")


def header(program: Program, date: str | None = None) -> list[str]:
    """What stands at the beginning of a file, line by line; the same program gives the same."""
    figures = estimate(program)
    lines = [
        f"strokeplan {__version__}: {program.title}",
        f"profile {program.profile.name}: {program.profile.description}",
        *re.split(r"; ", program.transform.describe()),
        f"{figures.strokes} strokes in {figures.lifts} lines, pens: {', '.join(pen.name for pen in program.pens)}",
        f"drawn {figures.drawn_m:.2f} m, travelled {figures.travelled_m:.2f} m, takes {clock(figures.total_s)}",
    ]
    return [*lines, f"date {date}"] if date else lines


def encode(program: Program, date: str | None = None) -> bytes:
    """The file of a program in its profile's language."""
    from strokeplan.plotter.dialects import ebb, gcode, hpgl

    dialect = program.profile.dialect
    if isinstance(dialect, Gcode):
        return gcode.encode(program, header(program, date))
    if isinstance(dialect, Hpgl):
        return hpgl.encode(program)
    return ebb.encode(program, header(program, date))


def outputs(
    program: Program, path: str | os.PathLike[str], *, by_pen: bool = False, date: str | None = None
) -> list[tuple[Path, bytes]]:
    """The files of a program: `path`, or one beside it for each pen, with the pen's name before the suffix."""
    path = Path(path)
    check_suffix(path, program.profile)
    if not by_pen:
        return [(path, encode(program, date))]
    made = [program.only(k) for k in range(len(program.pens))]
    names = _names([one.pens[0].name for one in made])
    return [(path.with_stem(f"{path.stem}-{name}"), encode(one, date)) for name, one in zip(names, made, strict=True)]


def _names(pens: Sequence[str]) -> list[str]:
    """Pens as parts of file names: letters, digits and dashes, no two the same."""
    plain = [re.sub(r"[^\w]+", "-", pen, flags=re.ASCII).strip("-")[:60] or "pen" for pen in pens]
    return [f"{k}-{name}" if plain.count(name) > 1 else name for k, name in enumerate(plain, start=1)]


def parse_date(given: str | None) -> str | None:
    """A date for the header: as given, or from SOURCE_DATE_EPOCH (UTC). Raises PlotError for what is none."""
    from datetime import UTC, date, datetime

    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    try:
        if given is not None:
            return date.fromisoformat(given).isoformat()
        return None if not epoch else datetime.fromtimestamp(int(epoch), UTC).date().isoformat()
    except (ValueError, OverflowError, OSError):
        raise PlotError(f"date {given or epoch!r} is none; give YYYY-MM-DD (or seconds in SOURCE_DATE_EPOCH)") from None
