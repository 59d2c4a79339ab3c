"""The journal: never more than what was proven, whatever became of its file."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from strokeplan.errors import InputError, OutputError
from strokeplan.plotter.driving import jobs
from strokeplan.plotter.driving.journal import GROUP_S, Journal, passed, record


def describe(key: int) -> tuple[int, int, int, float]:
    return key % 7, 0, key // 7, 1.5


def log_of(keys: list[int]) -> bytes:
    return b"".join(record(key, *describe(key)) for key in keys)


def test_a_log_says_how_many_units_are_done() -> None:
    assert passed(b"") == (0, 0)
    data = log_of([0, 1, 4])
    assert passed(data) == (5, len(data))


@given(st.lists(st.integers(0, 5), max_size=8), st.data())
def test_a_torn_tail_counts_for_nothing(steps: list[int], data: st.DataObject) -> None:
    keys = [sum(steps[: k + 1]) + k for k in range(len(steps))]
    whole = log_of(keys)
    cut = data.draw(st.integers(0, len(whole)))
    done, sound = passed(whole[:cut])
    lines = whole[:cut].count(b"\n")
    assert done == (keys[lines - 1] + 1 if lines else 0)
    assert whole[:sound] == log_of(keys[:lines])


@given(st.lists(st.integers(0, 5), min_size=1, max_size=8), st.data())
def test_a_damaged_byte_never_proves_more(steps: list[int], data: st.DataObject) -> None:
    keys = [sum(steps[: k + 1]) + k for k in range(len(steps))]
    whole = bytearray(log_of(keys))
    at, bit = data.draw(st.integers(0, len(whole) - 1)), data.draw(st.integers(0, 7))
    whole[at] ^= 1 << bit
    before = bytes(whole[:at]).count(b"\n")
    assert passed(bytes(whole))[0] <= (keys[before - 1] + 1 if before else 0)


def test_what_was_torn_is_cut_off_before_more_is_added(tmp_path: Path) -> None:
    path = tmp_path / "progress.log"
    path.write_bytes(log_of([0, 1]) + b"F 2 2 0 0 1.5")
    log = Journal(path, describe)
    assert log.done == 2
    log.advance(2, 0.0)
    log.close()
    assert path.read_bytes() == log_of([0, 1, 2])


def test_the_disk_is_asked_twice_a_second_and_at_every_stop(tmp_path: Path) -> None:
    syncs: list[int] = []
    log = Journal(tmp_path / "x", describe, syncs.append)
    begun = len(syncs)
    for key in range(100):
        log.advance(key, key * GROUP_S / 10)
    assert len(syncs) - begun == 10
    log.settle()
    assert len(syncs) - begun == 11
    log.settle()
    assert len(syncs) - begun == 11
    log.advance(50, 99.0)  # what is known already is not written again
    assert passed((tmp_path / "x").read_bytes())[0] == 100
    log.close()


def test_a_full_disk_is_an_error_that_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = Journal(tmp_path / "x", describe)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(OutputError, match="No space left"):
        log.advance(0, 0.0)
    assert log.done == 0
    monkeypatch.undo()
    monkeypatch.setattr(os, "write", lambda *_: 3)  # a part of the record
    with pytest.raises(OutputError, match="No space left"):
        log.advance(0, 0.0)
    log.close()


def test_two_processes_cannot_draw_one_job(tmp_path: Path) -> None:
    log = Journal(tmp_path / "x", describe)
    with pytest.raises(OutputError, match="another process"):
        Journal(tmp_path / "x", describe)
    log.close()
    Journal(tmp_path / "x", describe).close()


def order(**changes: object) -> jobs.Order:
    fields: dict[str, object] = {
        "plan": "plan.json",
        "plan_sha256": "0",
        "profile": "grbl_servo",
        "layout": {},
        "lines": {},
        "port": "/dev/x",
        "created": "2026-01-02T03:04:05+00:00",
        "title": "A swan.json",
        "units": 3,
        "drawing_sha256": "0",
        "version": "1",
    }
    return jobs.Order(**{**fields, **changes})  # type: ignore[arg-type]


def test_jobs_appear_whole_and_are_found_by_a_part_of_their_name(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "jobs"
    job = jobs.create(folder, order(), {"plan.json": b"{}"})
    assert job.name == "20260102030405-a-swan"
    again = jobs.create(folder, order(), {"plan.json": b"{}"})
    assert again.name == "20260102030405-a-swan-2"
    assert sorted(path.name for path in job.folder.iterdir()) == ["job.json", "plan.json", "progress.log"]
    (job.folder / jobs.LOG).write_bytes(log_of([0, 1]))
    assert jobs.find(folder, job.name).done == 2
    assert not jobs.find(folder, job.name).finished
    assert jobs.find(folder, "last").name == again.name
    with pytest.raises(InputError, match="not the only one"):
        jobs.find(folder, "2026")
    with pytest.raises(InputError, match="not there"):
        jobs.find(folder, "1999")
    jobs.remove(again)
    assert [found.name for found in jobs.listed(folder)] == [job.name]  # type: ignore[union-attr]
    assert jobs.listed(tmp_path / "none") == []


def test_a_job_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="nothing is drawn"):
        jobs.create(tmp_path / "file" / "jobs", order(), {})
    with pytest.raises(OutputError):
        jobs.create(tmp_path / "jobs", order(), {"no/such/folder": b""})
    assert list((tmp_path / "jobs").iterdir()) == []


def test_a_damaged_job_is_named_and_the_others_are_listed(tmp_path: Path) -> None:
    job = jobs.create(tmp_path, order(), {"plan.json": b"{}"})
    other = jobs.create(tmp_path, order(title="b"), {"plan.json": b"{}"})
    (job.folder / jobs.ORDER).write_text("{")
    listed = jobs.listed(tmp_path)
    assert isinstance(listed[0], InputError)
    assert listed[1] == other
    with pytest.raises(InputError, match="is not the plan"):
        jobs.check_plan(other)
    with pytest.raises(InputError, match="missing"):
        jobs.content(other, "../secret")
