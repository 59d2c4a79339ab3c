"""Compiled kernels must never outlive the source they came from."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from strokeplan import canvas, curves, field, jit, painting, tractography
from strokeplan.jit import is_cached
from strokeplan.pursuit import cells, closely, colours, finishing, picture, pruning, scene, seeding, strips, trying

PURSUIT = (cells, closely, colours, finishing, picture, pruning, scene, seeding, strips, trying)


def kernels() -> list[object]:
    found = []
    for module in (canvas, curves, field, painting, tractography, *PURSUIT):
        found += [value for value in vars(module).values() if hasattr(value, "py_func")]
    assert len(found) > 20
    return found


def test_every_kernel_is_stamped_with_all_sources() -> None:
    """A change in one kernel must recompile those in other files that call it."""
    for kernel in kernels():
        assert kernel._cache._cache_file._source_stamp == jit._sources()  # type: ignore[attr-defined]


def test_the_stamp_changes_with_any_module_that_holds_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "one.py").write_text("@kernel\ndef f(): return 1")
    (tmp_path / "two.py").write_text("@inlined\ndef g(): return 2")
    (tmp_path / "plain.py").write_text("y = 2")
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "three.py").write_text("@kernel\ndef h(): return 3")
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "jit.py"))
    before = jit._sources.__wrapped__()
    (tmp_path / "plain.py").write_text("y = 3")
    assert jit._sources.__wrapped__() == before
    (tmp_path / "two.py").write_text("@inlined\ndef g(): return 3")
    assert (changed := jit._sources.__wrapped__()) != before
    (tmp_path / "room" / "three.py").write_text("@kernel\ndef h(): return 4")
    assert jit._sources.__wrapped__() not in (before, changed)


def test_a_kernel_of_other_sources_is_not_taken_for_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    curves.simplify(curves.np.zeros((2, 2)), 1.0)
    assert is_cached(curves.rdp)
    monkeypatch.setattr(curves.rdp._cache._cache_file, "_source_stamp", "another version")
    assert not is_cached(curves.rdp)


def test_kernels_work_where_no_cache_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(function: object) -> object:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(jit, "FunctionCache", nowhere)

    def double(x: float) -> float:
        return 2 * x

    assert jit.kernel(double)(4.0) == 8.0
    assert not is_cached(jit.kernel(double))


def private_names() -> list[tuple[str, str]]:
    return [
        ("FunctionCache", "_load_overload"),
        ("FunctionCache", "_guard_against_spurious_io_errors"),
        ("IndexDataCacheFile", "_load_index"),
        ("CPUTargetOptions", "_nrt"),
    ]


@pytest.fixture
def asked_anew() -> Iterator[None]:
    """What this Numba has is found out again, before and after."""
    jit._known.cache_clear()
    yield
    jit._known.cache_clear()


def quadruple(x: float) -> float:
    return 4 * x


@pytest.mark.parametrize(("owner", "name"), private_names())
def test_a_numba_without_its_private_names_compiles_in_its_own_way(
    owner: str, name: str, asked_anew: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    lacking = SimpleNamespace(**{n: None for o, n in private_names() if o == owner and n != name})
    monkeypatch.setattr(jit, owner, lacking)
    compiled: Any = jit.leaf(quadruple)
    assert compiled(2.0) == 8.0
    assert not isinstance(compiled._cache, jit._Cache)
    assert compiled.stats.cache_path
    assert is_cached(compiled)


def test_a_numba_without_its_modules_compiles_in_its_own_way(asked_anew: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FunctionCache", "IndexDataCacheFile", "NullCache", "CPUTargetOptions", "rtsys"):
        monkeypatch.setattr(jit, name, None)
    compiled: Any = jit.kernel(quadruple)
    assert compiled(2.0) == 8.0


def test_this_numba_has_them(asked_anew: None) -> None:
    assert jit._known()
    assert isinstance(jit.kernel(quadruple)._cache, jit._Cache)  # type: ignore[attr-defined]


def test_kernels_work_where_no_folder_can_be_written(tmp_path: Path) -> None:
    """In a process of its own: Numba reads where its cache is when it is imported. Root may write to any folder, so
    the folders are files."""
    nowhere = tmp_path / "__pycache__"
    nowhere.write_text("")
    (tmp_path / "module.py").write_text(
        "from strokeplan.jit import is_cached, kernel\n"
        "@kernel\n"
        "def double(x):\n    return 2 * x\n"
        "print(double(4.0), is_cached(double))\n"
    )
    environment = {**os.environ} | dict.fromkeys(("NUMBA_CACHE_DIR", "HOME", "XDG_CACHE_HOME"), str(nowhere))
    ended = subprocess.run([sys.executable, tmp_path / "module.py"], capture_output=True, text=True, env=environment)
    assert (ended.stdout, ended.stderr) == ("8.0 False\n", "")


def test_a_cached_kernel_is_loaded_in_the_next_process(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(
        "from strokeplan.jit import is_cached, kernel\n"
        "@kernel\n"
        "def double(x):\n    return 2 * x\n"
        "known = is_cached(double)\n"
        "print(double(4.0), known, sum(double.stats.cache_hits.values()))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, tmp_path / "module.py"]
    printed = [subprocess.run(command, capture_output=True, text=True, env=environment).stdout for _ in range(2)]
    assert printed == ["8.0 False 0\n", "8.0 True 1\n"]
