"""Machine profiles: what a plotter can reach and do, and in which language it is told; data and not code.

A profile is a TOML file: shipped (plotter_profiles/*.toml), the user's ($XDG_CONFIG_HOME/strokeplan/profiles/*.toml,
which goes before a shipped one of the same name), or any path. It is decoded into frozen structs; unknown keys,
impossible values and parts that do not belong together are refused. Units are in the names of keys.

Known limits: no templates. A profile may add lines before and after a job, of words that neither move, store nor read
files (dialects/words.py); everything else is written by the dialect itself.
"""

from __future__ import annotations

import os
import re
import reprlib
from importlib.resources import files
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta

from strokeplan.color_settings import HexColor
from strokeplan.errors import InputError, ProfileError
from strokeplan.files import atomic_write
from strokeplan.page import Page, parse_page
from strokeplan.pens import MAX_WIDTH_MM, MIN_WIDTH_MM
from strokeplan.plotter.dialects.words import Flavour, check_lines
from strokeplan.plotter.tools import AngleServo, Brush, Carousel, EbbBrush, EbbServo, PwmServo, Tool, ZBrush, ZPen

MAX_BYTES = 1_000_000
"""No profile is as long as this."""
Coordinate = Annotated[float, Meta(ge=-1e4, le=1e4)]
Point = tuple[Coordinate, Coordinate]
Rate = Annotated[float, Meta(gt=0, le=1e6)]
Seconds = Annotated[float, Meta(ge=0, le=600)]
Direction = Literal["right", "left", "up", "down"]
Corner = Literal["upper-left", "upper-right", "lower-left", "lower-right"]
ACROSS = ("right", "left")
_NAME = r"[A-Za-z0-9_][A-Za-z0-9_-]*"


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class Machine(_Table, frozen=True, kw_only=True):
    """Where the pen can be, in the machine's own coordinates, and how the page lies in them."""

    x_mm: Point
    """Travel of the first axis, from … to."""
    y_mm: Point
    axes: tuple[Direction, Direction] = ("right", "up")
    """Where x and y grow, as one looks at the page."""
    origin: Corner = "lower-left"
    """The page's corner that lies at `offset_mm`."""
    offset_mm: Point = (0.0, 0.0)
    """Machine coordinates of that corner, after any flip."""
    kinematics: Literal["cartesian", "corexy"] = "cartesian"
    draw_x_mm: Point | None = None
    """Where along the first axis it may draw; None: on all of its travel. Wells stand in the rest."""
    draw_y_mm: Point | None = None

    def __post_init__(self) -> None:
        for name, span in (("x_mm", self.x_mm), ("y_mm", self.y_mm)):
            if span[0] >= span[1]:
                raise ValueError(f"{name} = {list(span)} must rise: from where to where the axis travels")
            drawn: Point = getattr(self, f"draw_{name}") or span
            if not span[0] <= drawn[0] < drawn[1] <= span[1]:
                raise ValueError(f"draw_{name} = {list(drawn)} must rise, and lie within {name} = {list(span)}")
        if (self.axes[0] in ACROSS) == (self.axes[1] in ACROSS):
            raise ValueError(f"axes = {list(self.axes)} must be one across (right, left) and one along (up, down)")

    @property
    def draw_spans(self) -> tuple[Point, Point]:
        """Where it may draw, along both axes."""
        return self.draw_x_mm or self.x_mm, self.draw_y_mm or self.y_mm


class Speeds(_Table, frozen=True, kw_only=True):
    """How fast the pen moves, and what the machine's own planner makes of it (motion.Limits)."""

    draw_mm_min: Rate
    travel_mm_min: Rate
    rate_mm_min: tuple[Rate, Rate]
    """What each axis (corexy: motor) can do."""
    acceleration_mm_s2: tuple[Rate, Rate]
    junction_deviation_mm: Annotated[float, Meta(ge=0, le=10)] = 0.01
    lookahead_blocks: Annotated[int, Meta(ge=1, le=1000)] = 15
    steps_mm: Annotated[float, Meta(gt=0, le=1e5)] | None = None
    segment_ms: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """How long a segment takes at least, where the tolerance allows it: no more of them arrive in time."""


class Gcode(_Table, frozen=True, kw_only=True, tag="gcode"):
    """G-code, in one of its flavours."""

    flavour: Flavour
    curves: Literal["lines", "arcs", "cubics"] = "lines"
    """What a stroke becomes: G1 only, G2 and G3 too, or G5 (cubic Béziers as they are)."""
    prologue: Annotated[tuple[str, ...], Meta(max_length=32)] = ()
    epilogue: Annotated[tuple[str, ...], Meta(max_length=32)] = ()

    def __post_init__(self) -> None:
        check_lines("prologue", self.prologue, self.flavour)
        check_lines("epilogue", self.epilogue, self.flavour)
        if self.curves == "cubics" and self.flavour not in ("linuxcnc", "marlin"):
            raise ValueError(f"curves = 'cubics': {self.flavour} knows no G5; take 'arcs' or 'lines'")
        if self.curves == "arcs" and self.flavour == "drawcore":
            raise ValueError("curves = 'arcs': drawcore knows no G2 and G3; take 'lines'")


class Hpgl(_Table, frozen=True, kw_only=True, tag="hpgl"):
    """HP-GL: whole units, polylines."""

    unit_mm: Annotated[float, Meta(gt=0, le=1)]
    buffer_bytes: Annotated[int, Meta(ge=40, le=1_000_000)]
    """The plotter's own buffer: no command is longer than half of it."""
    max_speed_cm_s: Annotated[float, Meta(gt=0, le=1000)] = 38.1


class Ebb(_Table, frozen=True, kw_only=True, tag="ebb"):
    """The EiBotBoard's commands: motors' steps in slices of time."""

    steps_mm: Annotated[float, Meta(gt=0, le=1e4)]
    """Sixteenths of a step for a millimetre: of motors A and B together (XM), or of x and y themselves (SM)."""
    slice_ms: Annotated[int, Meta(ge=5, le=1000)] = 25
    min_ms: Annotated[int, Meta(ge=1, le=100)] = 4
    """The shortest move that the board keeps up with."""


Dialect = Gcode | Hpgl | Ebb


class Paper(_Table, frozen=True, kw_only=True):
    """A sheet that the machine knows, and what it can reach on it; goes before what [machine] says."""

    page: str
    landscape: bool = False
    x_mm: Point
    y_mm: Point
    offset_mm: Point
    code: Annotated[int, Meta(ge=0, le=127)] | None = None
    """HP-GL's PS."""

    def __post_init__(self) -> None:
        try:
            parse_page(self.page)
        except InputError as error:
            raise ValueError(str(error)) from None

    @property
    def sheet(self) -> Page:
        """The sheet as it lies in the machine."""
        return parse_page(self.page, landscape=self.landscape) or Page(1, 1)


class PenSettings(_Table, frozen=True, kw_only=True):
    """What a pen of that name does otherwise."""

    name: str
    slot: Annotated[int, Meta(ge=1, le=99)] | None = None
    color: HexColor | None = None
    """Of its ink on white paper, for `--pens profile`."""
    width_mm: Annotated[float, Meta(ge=MIN_WIDTH_MM, le=MAX_WIDTH_MM)] | None = None
    """How wide it draws: for `--pens profile`, and what `plan --profile` takes for a pen of that name."""
    draw_mm_min: Rate | None = None
    down_mm: Coordinate | None = None
    down_pwm: Annotated[float, Meta(ge=0, le=1e5)] | None = None
    down_deg: Annotated[float, Meta(ge=0, le=360)] | None = None
    down_percent: Annotated[float, Meta(ge=0, le=100)] | None = None
    lower_s: Seconds | None = None
    raise_s: Seconds | None = None


class Change(_Table, frozen=True, kw_only=True):
    """How a pen is changed by hand: where the machine goes, and how long that takes (for the estimate)."""

    park_mm: Point | None = None
    wait_s: Annotated[float, Meta(ge=0, le=3600)] = 20.0


TOOLS: dict[type, tuple[type, ...]] = {
    Gcode: (PwmServo, AngleServo, ZPen, ZBrush),
    Hpgl: (Carousel,),
    Ebb: (EbbServo, EbbBrush),
}
HEIGHTS = {ZPen: "down_mm", PwmServo: "down_pwm", AngleServo: "down_deg", EbbServo: "down_percent"}


class Profile(_Table, frozen=True, kw_only=True):
    """A machine: everything that turns a plan on a page into a file for it."""

    description: str
    machine: Machine
    speeds: Speeds
    tool: Tool
    dialect: Dialect
    tolerance_mm: Annotated[float, Meta(ge=1e-4, le=10)] = 0.02
    """How far what is drawn may stray from the curves."""
    join_mm: Annotated[float, Meta(ge=0, le=100)] = 0.1
    """Gaps up to this are crossed without lifting the pen."""
    papers: Annotated[tuple[Paper, ...], Meta(max_length=32)] = ()
    pens: Annotated[tuple[PenSettings, ...], Meta(max_length=256)] = ()
    change: Change = Change()
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.tool, TOOLS[type(self.dialect)]):
            fitting = ", ".join(kind.__struct_config__.tag for kind in TOOLS[type(self.dialect)])  # type: ignore[attr-defined]
            raise ValueError(f"tool.type: dialect {_tag(self.dialect)} has {fitting}, no {_tag(self.tool)}")
        names = [pen.name for pen in self.pens]
        for pen in self.pens:
            if names.count(pen.name) > 1:
                raise ValueError(f"pens: {pen.name!r} stands there twice")
            for height in HEIGHTS.values():
                if getattr(pen, height) is not None and height != HEIGHTS.get(type(self.tool)):
                    raise ValueError(f"pens: {height} of {pen.name!r} is none that a {_tag(self.tool)} has")
        spans = (self.machine.x_mm, self.machine.y_mm)
        park = self.change.park_mm
        if park is not None and not all(low <= at <= high for at, (low, high) in zip(park, spans, strict=True)):
            raise ValueError(f"change.park_mm = {list(park)} is outside of the machine's travel")
        if isinstance(self.tool, Brush):
            self.tool.check_reach(spans)


def _tag(part: Any) -> str:
    return str(part.__struct_config__.tag)


def folder() -> Any:
    """The shipped profiles: within the package as installed, beside it in a checkout."""
    inside = files("strokeplan") / "plotter_profiles"
    return inside if inside.is_dir() else Path(__file__).parents[2] / "plotter_profiles"


def user_folder() -> Path:
    """Where the user's own profiles are looked for."""
    home = os.environ.get("XDG_CONFIG_HOME") or ""
    return (Path(home) if Path(home).is_absolute() else Path.home() / ".config") / "strokeplan" / "profiles"


def names() -> list[str]:
    """All profiles by name, shipped and the user's."""
    found = {entry.name for entry in folder().iterdir()}
    if user_folder().is_dir():
        found |= {entry.name for entry in user_folder().iterdir()}
    return sorted(name.removesuffix(".toml") for name in found if name.endswith(".toml"))


def source(name: str) -> bytes:
    """The TOML text of a profile by its name. Raises ProfileError."""
    if re.fullmatch(_NAME, name):
        for place in (user_folder(), folder()):
            file = place / f"{name}.toml"
            if file.is_file():
                return _read(file)
    raise ProfileError(f"profile {reprlib.repr(name)} is unknown; known are {', '.join(names())}, or give a .toml file")


def load_profile(name: str | os.PathLike[str]) -> Profile:
    """A profile by name or .toml file. Raises ProfileError, which names the key and what would be right."""
    if str(name).endswith(".toml"):
        return parse(_read(Path(name)), str(name), Path(name).stem)
    return parse(source(str(name)), str(name), str(name))


def begin(name: str, like: str, path: Path | None = None) -> Path:
    """Copy the profile `like` as the user's own of that name, or to `path`; where it is now. Raises ProfileError."""
    if not re.fullmatch(_NAME, name):
        raise ProfileError(f"{reprlib.repr(name)} is no name of a profile; take letters, digits, - and _")
    data = source(like)
    target = path or user_folder() / f"{name}.toml"
    if target.exists():
        raise ProfileError(f"{target}: is there already; it is left as it is")
    if path is None:
        user_folder().mkdir(parents=True, exist_ok=True)
    with atomic_write(target) as stream:
        stream.write(data)
    return target


def parse(data: bytes, where: str, name: str) -> Profile:
    """A profile from its TOML text; `where` stands in messages. Raises ProfileError."""
    try:
        raw = msgspec.toml.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise ProfileError(f"profile {where}: is not TOML ({error})") from None
    if not isinstance(raw, dict):
        raise ProfileError(f"profile {where}: is no table")
    raw.setdefault("name", name)
    try:
        return msgspec.convert(raw, Profile)
    except msgspec.ValidationError as error:
        raise ProfileError(f"profile {where}: {_readable(str(error), raw)}") from None


def _read(file: Any) -> bytes:
    try:
        with file.open("rb") as stream:
            data: bytes = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise ProfileError(f"profile {file}: cannot be read ({error.strerror})") from None
    if len(data) > MAX_BYTES:
        raise ProfileError(f"profile {file}: is larger than {MAX_BYTES:,} bytes, no profile is")
    return data


def _readable(message: str, raw: Any) -> str:
    """msgspec's "Expected … - at `$.machine.x_mm`" as "machine.x_mm = …: Expected …", with what is known there."""
    text, _, path = message.partition(" - at `$")
    steps = re.findall(r"\w+", path)
    value, kind = raw, Profile
    for step in steps:
        value = value[int(step) if step.isdecimal() else step]
        kind = _part(kind, step, value)
    if "unknown field" in text and hasattr(kind, "__struct_fields__"):
        text += f"; known are {', '.join(kind.__struct_fields__)}"
    place = ".".join(str(int(step) + 1) if step.isdecimal() else step for step in steps)
    if place and not isinstance(value, dict):
        place += f" = {reprlib.repr(value)}"
    text = " ".join(text.split())
    return f"{place}: {text}" if place else text


def _part(kind: Any, step: str, value: Any) -> Any:
    """The struct that a key of another leads to; a union by the tag that stands there."""
    if step.isdecimal():
        return kind
    found = (
        {field.name: field.type for field in msgspec.structs.fields(kind)} if hasattr(kind, "__struct_fields__") else {}
    )
    inner = found.get(step)
    while inner is not None and not hasattr(inner, "__struct_fields__"):
        tag = value.get("type") if isinstance(value, dict) else None
        choices = [arm for arm in get_args(inner) if isinstance(arm, type) or get_args(arm)]
        tagged = [arm for arm in choices if getattr(getattr(arm, "__struct_config__", None), "tag", inf) == tag]
        inner = (tagged or choices or [None])[0]
    return inner
