"""One value of a profile changed in its text: comments, order and everything else stay.

The line of the value is edited as text, and the text is parsed before and after: where the two differ in anything but
that value, nothing is written. A shipped profile is never touched: it is copied to the user's own folder first, where
it goes before the shipped one of the same name.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from strokeplan.errors import OutputError, ProfileError
from strokeplan.files import atomic_write
from strokeplan.plotter.profile import Profile, parse, source, user_folder
from strokeplan.plotter.tools import AngleServo, EbbBrush, EbbServo, PwmServo, ZBrush, ZPen

DOWN = {
    ZPen: "down_mm", PwmServo: "down_pwm", AngleServo: "down_deg", EbbServo: "down_percent",
    ZBrush: "touch_mm", EbbBrush: "touch_percent",
}  # fmt: skip
UP = {
    ZPen: "up_mm", PwmServo: "up_pwm", AngleServo: "up_deg", EbbServo: "up_percent",
    ZBrush: "safe_mm", EbbBrush: "safe_percent",
}  # fmt: skip
UNITS = {"mm": "--height", "pwm": "--pwm", "deg": "--deg", "percent": "--percent"}
"""The unit that a key ends with, and the option that gives such a value."""
STEPS = {"mm": 0.1, "pwm": 10.0, "deg": 1.0, "percent": 1.0}
"""What a key press changes a value of that unit by."""


def key_of(profile: Profile, *, down: bool) -> str:
    """The key of the tool's height, down or up. Raises ProfileError for a tool that has none."""
    found = (DOWN if down else UP).get(type(profile.tool))
    if found is None:
        raise ProfileError(f"{profile.name}: its pens have no height to set, they are up or down")
    return found


def unit_of(key: str) -> str:
    """ "mm" of "down_mm"."""
    return key.rpartition("_")[2]


def pen_index(profile: Profile, name: str) -> int:
    """Which of the profile's own pens has that name. Raises ProfileError."""
    names = [pen.name for pen in profile.pens]
    if name not in names:
        known = ", ".join(names) or "none"
        raise ProfileError(f"profile {profile.name} says nothing of a pen {name!r}; of its own it has {known}")
    return names.index(name)


def value_of(profile: Profile, key: str, pen: str | None = None) -> float | None:
    """What the profile says of a height, for one of its pens if that has its own; None: nothing."""
    own = None if pen is None else getattr(profile.pens[pen_index(profile, pen)], key, None)
    found = getattr(profile.tool, key) if own is None else own
    return None if found is None else float(found)


def tried(profile: Profile, key: str, value: float, pen: str | None = None) -> Profile:
    """The profile with another height, of its tool or of one of its pens. Raises ProfileError for one out of range."""
    raw: dict[str, Any] = msgspec.to_builtins(profile)
    part = raw["tool"] if pen is None else raw["pens"][pen_index(profile, pen)]
    part[key] = value
    try:
        return msgspec.convert(raw, Profile)
    except msgspec.ValidationError as error:
        text = " ".join(str(error).partition(" - at `$")[0].split())
        raise ProfileError(f"{UNITS.get(unit_of(key), key)} {value:g}: {text}") from None


def saved(
    name: str, table: str, key: str, value: float | Sequence[float], *, item: int | None = None
) -> tuple[Path, bool]:
    """Write one value into the user's own profile; where that is, and whether it was begun for it.

    name    a profile's name, or a .toml file, which is changed where it stands.
    item    which of a list of tables, from 0 ([[pens]]); None: the table itself ([tool]).

    Raises ProfileError, OutputError; nothing is written then.
    """
    if name.endswith(".toml"):
        target = Path(name)
        try:
            data = target.read_bytes()
        except OSError as error:
            raise ProfileError(f"profile {name}: cannot be read ({error.strerror})") from None
    else:
        target, data = user_folder() / f"{name}.toml", source(name)
    begun = not target.exists()
    edited = changed(data, table, key, value, item=item, where=name)
    parse(edited, name, target.stem)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{target.parent}: cannot be made ({error.strerror})") from None
    with atomic_write(target) as stream:
        stream.write(edited)
    return target, begun


def changed(
    data: bytes, table: str, key: str, value: float | Sequence[float], *, where: str, item: int | None = None
) -> bytes:
    """TOML text with one value changed, or added below its table's head. Raises ProfileError where that is not certain.

    where   the profile's name, for messages.
    """
    shown = written(value)
    place = f"[{table}]" if item is None else f"[[{table}]] number {item + 1}"
    by_hand = ProfileError(f"profile {where}: its text is not the usual one; set {key} = {shown} in {place} by hand")
    try:
        text = data.decode("utf-8")
        expected = tomllib.loads(text)
    except ValueError as error:
        raise ProfileError(f"profile {where}: is not TOML ({error})") from None
    lines = text.split("\n")
    inner = re.escape(table) if item is None else rf"\[\s*{re.escape(table)}\s*\]"
    heads = [k for k, line in enumerate(lines) if re.match(rf"\s*\[\s*{inner}\s*\]\s*(#.*)?$", line)]
    try:
        head = heads[item or 0]
        part = expected[table] if item is None else expected[table][item]
        part[key] = tomllib.loads(f"v = {shown}")["v"]
    except (LookupError, TypeError):
        raise by_hand from None
    at, found = _entry(lines, head, key)
    if found is None:
        lines.insert(at, f"{key} = {shown}" + ("\r" if lines[head].endswith("\r") else ""))
    else:
        lines[at] = found[1] + shown + found[3]
    edited = "\n".join(lines)
    try:
        sound = tomllib.loads(edited) == expected
    except ValueError:
        sound = False
    if not sound:
        raise by_hand
    return edited.encode("utf-8")


def _entry(lines: Sequence[str], head: int, key: str) -> tuple[int, re.Match[str] | None]:
    """The line of a key in the table that begins at `head`; where it may be added, and None, if there is none."""
    for at in range(head + 1, len(lines)):
        if lines[at].lstrip().startswith("["):
            break
        if found := re.match(rf"(\s*{key}\s*=\s*)(\[[^\]#]*\]|[^#\[\s]+)(\s*(?:#.*)?)$", lines[at]):
            return at, found
    return head + 1, None


def written(value: float | Sequence[float]) -> str:
    """As TOML has it, in thousandths."""
    if not isinstance(value, int | float):
        return f"[{', '.join(map(written, value))}]"
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text
