"""Files written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from strokeplan.errors import OutputError


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A binary file that takes the place of `path` when the block ends well, and vanishes when it does not.

    Raises OutputError where the file cannot be made, written or put in place; what stood there stays.
    """
    path = Path(path)
    temporary = None
    try:
        check_writable(path)
        target = path.resolve()  # through a link, to what it points to
        handle, name = tempfile.mkstemp(prefix=".strokeplan-", suffix=".part", dir=target.parent)
        os.close(handle)
        temporary = Path(name)
        with temporary.open("wb") as stream:  # by its name, which tifffile asks for
            yield stream
        temporary.chmod(_mode(target))
        temporary.replace(target)
        temporary = None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def check_writable(path: str | os.PathLike[str], *inputs: str | os.PathLike[str]) -> None:
    """Raise OutputError if `path` cannot become a file, or is one of the `inputs` that the work starts from.

    Known before the work rather than after it.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; give a file name in it")
        if not path.parent.is_dir():
            raise OutputError(f"{path}: the folder {path.parent} does not exist")
        if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
            raise OutputError(f"{path}: no permission to write there")
    except OSError as error:  # a name too long, a folder that cannot be looked into
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from None
    for source in inputs:
        with suppress(OSError):  # one of them does not exist
            if path.samefile(source):
                raise OutputError(f"{path}: is what the work starts from; give another name")


def _mode(path: Path) -> int:
    """Permissions for the new file: those of the one it replaces, else what the umask leaves."""
    try:
        return path.stat().st_mode & 0o777
    except FileNotFoundError:
        umask = os.umask(0)
        os.umask(umask)
        return 0o666 & ~umask
