"""The Inkscape extension: where it is installed, and how.

Inkscape takes extensions from a folder of the user's: strokeplan_plan.inx says what the dialog shows,
strokeplan_plan.py does the work under Inkscape's own Python, and strokeplan_plan.json, written here, tells
that script how to call this strokeplan.

Known limit: an Inkscape in a sandbox (snap, Flatpak) has a folder of its own and may not start other programs.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

from strokeplan.errors import OutputError
from strokeplan.files import atomic_write

SCRIPTS = ("strokeplan_plan.inx", "strokeplan_plan.py")
COMMAND = "strokeplan_plan.json"
PATIENCE_S = 60.0
"""Inkscape answers within a second or two, more when it starts for the first time."""


def extensions_folder() -> Path:
    """The folder that Inkscape takes this user's extensions from, whether it is there yet or not."""
    inkscape = shutil.which("inkscape")
    if inkscape is not None and (said := _ask(inkscape)):
        return Path(said) / "extensions"
    if profile := os.environ.get("INKSCAPE_PROFILE_DIR"):
        return Path(profile) / "extensions"
    if sys.platform == "win32":
        return Path(os.environ.get("APPDATA", "~")).expanduser() / "inkscape" / "extensions"
    if sys.platform == "darwin":
        support = Path("~/Library/Application Support").expanduser()
        return support / "org.inkscape.Inkscape" / "config" / "inkscape" / "extensions"
    return Path(os.environ.get("XDG_CONFIG_HOME") or "~/.config").expanduser() / "inkscape" / "extensions"


def _ask(inkscape: str) -> str:
    """What Inkscape says its user's folder is; nothing if it does not run."""
    try:
        words = [inkscape, "--user-data-directory"]
        ended = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_S, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return ended.stdout.strip() if ended.returncode == 0 else ""


def install(folder: Path) -> list[Path]:
    """Copy the extension into `folder`, made if need be; the files written. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); give another by --folder") from None
    contents = {name: (files(__name__) / name).read_bytes() for name in SCRIPTS}
    contents[COMMAND] = json.dumps([sys.executable, "-m", "strokeplan"]).encode()
    for name, content in contents.items():
        with atomic_write(folder / name) as stream:
            stream.write(content)
    return [folder / name for name in contents]
