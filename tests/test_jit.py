"""Compiled kernels must never outlive the source they came from."""

from __future__ import annotations

from pathlib import Path

import pytest

from strokeplan import canvas, curves, field, jit, painting, tractography
from strokeplan.jit import is_cached


def kernels() -> list[object]:
    found = []
    for module in (canvas, curves, field, painting, tractography):
        found += [value for value in vars(module).values() if hasattr(value, "py_func")]
    assert len(found) > 20
    return found


def test_every_kernel_is_stamped_with_all_sources() -> None:
    """A change in one kernel must recompile those in other files that call it."""
    for kernel in kernels():
        assert kernel._cache._cache_file._source_stamp == jit._sources()  # type: ignore[attr-defined]


def test_the_stamp_changes_with_any_module_that_holds_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "one.py").write_text("@kernel\ndef f(): return 1")
    (tmp_path / "two.py").write_text("@kernel\ndef g(): return 2")
    (tmp_path / "plain.py").write_text("y = 2")
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "three.py").write_text("@kernel\ndef h(): return 3")
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "jit.py"))
    before = jit._sources.__wrapped__()
    (tmp_path / "plain.py").write_text("y = 3")
    assert jit._sources.__wrapped__() == before
    (tmp_path / "two.py").write_text("@kernel\ndef g(): return 3")
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
