"""Files are written whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from strokeplan.errors import OutputError
from strokeplan.files import atomic_write, check_writable

OLD = b"what stood there before"


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """A file with old content, alone in its folder."""
    path = tmp_path / "plan.svg"
    path.write_bytes(OLD)
    return path


@pytest.fixture
def umask() -> Iterator[int]:
    mask = 0o027
    before = os.umask(mask)
    yield mask
    os.umask(before)


def permissions(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def untouched(target: Path) -> bool:
    """Whether the old content stands, and nothing is beside it."""
    return target.read_bytes() == OLD and list(target.parent.iterdir()) == [target]


def fail_half_way(path: Path, error: BaseException) -> None:
    with atomic_write(path) as stream:
        stream.write(b"half")
        stream.flush()
        raise error


def test_a_new_file_holds_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "new.svg"
    with atomic_write(path) as stream:
        stream.write(b"one ")
        stream.write(b"two")
    assert path.read_bytes() == b"one two"
    assert list(tmp_path.iterdir()) == [path]


def test_an_old_file_is_replaced_at_the_end_of_the_block(target: Path) -> None:
    with atomic_write(str(target)) as stream:
        stream.write(b"new")
        stream.flush()
        assert target.read_bytes() == OLD
    assert target.read_bytes() == b"new"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("kind", [ValueError, MemoryError, KeyboardInterrupt, SystemExit, GeneratorExit, RuntimeError])
def test_an_exception_in_the_block_comes_through_and_changes_nothing(target: Path, kind: type[BaseException]) -> None:
    with pytest.raises(kind, match="half way"):
        fail_half_way(target, kind("half way"))
    assert untouched(target)


def test_a_full_disk_is_an_output_error_and_changes_nothing(target: Path) -> None:
    message = re.escape(f"{target}: cannot be written (No space left on device)")
    with pytest.raises(OutputError, match=f"^{message}$"):
        fail_half_way(target, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    assert untouched(target)


def test_an_interrupt_leaves_no_new_file(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        fail_half_way(tmp_path / "new.svg", KeyboardInterrupt())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("step", ["replace", "chmod"])
def test_a_failure_at_the_last_step_changes_nothing(target: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    def fail(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(Path, step, fail)
    with pytest.raises(OutputError, match=r"cannot be written \(Input/output error\)"), atomic_write(target) as stream:
        stream.write(b"new")
    assert untouched(target)


@pytest.mark.parametrize("mode", [0o600, 0o644, 0o755])
def test_permissions_of_the_old_file_are_kept(target: Path, mode: int) -> None:
    target.chmod(mode)
    with atomic_write(target) as stream:
        stream.write(b"new")
    assert permissions(target) == mode


def test_a_new_file_has_the_permissions_that_the_umask_leaves(tmp_path: Path, umask: int) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    with atomic_write(tmp_path / "new.svg") as stream:
        stream.write(b"new")
    assert permissions(tmp_path / "new.svg") == permissions(plain) == 0o666 & ~umask


def test_the_umask_itself_stays(tmp_path: Path, umask: int) -> None:
    with atomic_write(tmp_path / "new.svg"):
        pass
    now = os.umask(umask)
    assert now == umask


def test_the_longest_name_that_the_file_system_takes_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 251 + ".svg")
    with atomic_write(path) as stream:
        stream.write(b"new")
    assert path.read_bytes() == b"new"


def test_a_link_stays_a_link(target: Path, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(target)
    with atomic_write(link) as stream:
        stream.write(b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


def test_a_folder_is_no_target(tmp_path: Path) -> None:
    for refuse in (check_writable, lambda path: atomic_write(path).__enter__()):
        with pytest.raises(OutputError, match=r"is a folder; give a file name in it$"):
            refuse(tmp_path)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    path = tmp_path / "nowhere" / "plan.svg"
    message = re.escape(f"{path}: the folder {path.parent} does not exist")
    for refuse in (check_writable, lambda path: atomic_write(path).__enter__()):
        with pytest.raises(OutputError, match=f"^{message}$"):
            refuse(path)


def test_a_file_is_no_folder(target: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"):
        check_writable(target / "plan.svg")


def test_a_name_that_is_too_long_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"cannot be written \(.+\)$"):
        check_writable(tmp_path / ("x" * 300 + ".svg"))


@pytest.mark.parametrize("locked", ["folder", "file"])
def test_what_may_not_be_written_is_refused_before_the_work(
    target: Path, monkeypatch: pytest.MonkeyPatch, locked: str
) -> None:
    """Simulated: root may write everywhere."""
    refused = target.parent if locked == "folder" else target
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != refused)
    with pytest.raises(OutputError, match=r"plan\.svg: no permission to write there$"):
        check_writable(target)
    assert untouched(target)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_write_permission_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o555)
    with pytest.raises(OutputError, match=r"no permission to write there$"):
        check_writable(folder / "plan.svg")
    assert list(folder.iterdir()) == []


def test_checking_creates_nothing(tmp_path: Path) -> None:
    check_writable(tmp_path / "plan.svg")
    assert list(tmp_path.iterdir()) == []
