"""DXF, read back by ezdxf's own reader and auditor: the plan's curves, colours and layers in millimetres."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plans import TINY
from shapely import Polygon

from strokeplan import ExportOptions, Page
from strokeplan.curves import flatten
from strokeplan.formats.dxf import encode
from strokeplan.strokes import Layer, StrokePlan

ezdxf = pytest.importorskip("ezdxf")


def read(data: bytes) -> object:
    document = ezdxf.read(io.StringIO(data.decode()))
    auditor = document.audit()
    assert not auditor.has_errors
    assert not auditor.has_fixes
    return document


def test_splines_are_the_plan_s_curves(small_plan: StrokePlan) -> None:
    document = read(encode(small_plan))
    splines = document.modelspace().query("SPLINE")
    assert (document.units, len(splines)) == (ezdxf.units.MM, len(small_plan))
    mm = 25.4 / 96
    for i in range(0, len(splines), 17):
        curve = splines[i].construction_tool()
        pieces = len(small_plan.stroke(i)) // 3
        for k in range(pieces):
            p = small_plan.stroke(i)[3 * k : 3 * k + 4]
            for t in (0.0, 0.3, 0.8):
                on = np.array([(1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3]) @ p
                x, y, _ = curve.point(k + t)
                np.testing.assert_allclose((x, y), (on[0] * mm, (small_plan.height - on[1]) * mm), atol=1e-6)
        assert bytes(splines[i].rgb) == bytes(small_plan.colors[i])


def test_layers_have_their_names_and_widths_the_nearest_weight() -> None:
    document = read(encode(replace(TINY, layers=(Layer('a/b:"*?', 0, 1), Layer("a_b____", 1, 2), Layer("", 2, 3)))))
    splines = document.modelspace().query("SPLINE")
    assert [spline.dxf.layer for spline in splines] == ["a_b____", "a_b____ (2)", "layer 3"]
    assert [spline.dxf.lineweight for spline in splines] == [106, 70, 13]  # 1.06, 0.66 and 0.13 mm


def test_outlines_are_closed_and_enclose_the_stroke() -> None:
    options = ExportOptions(outline=True, page=Page(200, 100))
    (first, *_) = read(encode(TINY, options)).modelspace().query("SPLINE")
    chain = np.array(first.control_points)[:, :2]
    np.testing.assert_allclose(chain[0], chain[-1], atol=1e-9)
    assert Polygon(flatten(chain, 0.001)).area == pytest.approx(160 * 40 + np.pi * 20**2, rel=0.005)


def test_the_same_plan_gives_the_same_bytes_in_any_process() -> None:
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); from plans import TINY;"
        "from strokeplan.formats.dxf import encode; sys.stdout.buffer.write(encode(TINY))"
    )
    command = [sys.executable, "-c", script, str(Path(__file__).parent)]
    runs = [
        subprocess.run(command, capture_output=True, check=True, env={**os.environ, "PYTHONHASHSEED": seed})
        for seed in ("1", "2")
    ]
    assert runs[0].stdout == runs[1].stdout == encode(TINY)
