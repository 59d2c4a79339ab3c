"""DXF (R2010) for CAD and laser programs, by ezdxf: a spline for every stroke, in millimetres, y upwards.

A chain of k cubics is one clamped B-spline of degree 3 whose inner knots are triple: the same curve, exactly.
Layers carry the plan's names; every spline has its true colour and the nearest line weight DXF knows. With
`outline` a stroke is the closed spline around it.

Known limits: line weights end at 2.11 mm, so that pictures of broad brushes need outlines; there is no paint
in DXF, so that neither order nor background shows.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from strokeplan.errors import MissingExtraError
from strokeplan.formats.layout import Layout, lay_out
from strokeplan.formats.options import DEFAULTS, ExportOptions
from strokeplan.grouping import regroup
from strokeplan.page import MM_PER_INCH, PX_PER_INCH
from strokeplan.strokes import Layer, StrokePlan

TOLERANCE_MM = 0.02
"""By this much an outline may differ from its stroke."""
MAX_NAME = 200
_NOT_IN_NAMES = re.compile(r'[\x00-\x1f<>/\\":;?*=`,|\ufffe\uffff]')


def require_ezdxf() -> Any:
    """The ezdxf module, or a MissingExtraError that says how to get it."""
    try:
        import ezdxf
    except ImportError:
        raise MissingExtraError("DXF needs ezdxf: pip install 'strokeplan[dxf]'") from None
    return ezdxf


def encode(plan: StrokePlan, options: ExportOptions = DEFAULTS) -> bytes:
    """The DXF document of a plan; the same plan and options give the same bytes.

    Of the options `page`, `group_by` and `outline` count. Raises InputError, MissingExtraError without ezdxf.
    """
    ezdxf = require_ezdxf()
    layout = lay_out(regroup(plan, options.group_by), options)
    unit = 1.0 if layout.mm else MM_PER_INCH / PX_PER_INCH
    with _undated(ezdxf.options):
        document = ezdxf.new("R2010", units=ezdxf.units.MM)
        names = [_add_layer(document, layer, number) for number, layer in enumerate(layout.plan.layers, start=1)]
        _add_splines(document.modelspace(), layout, unit, names, options)
        for kind in sorted(document.entitydb.dxf_types_in_use()):  # ezdxf itself adds them in the order of hashes
            document.classes.add_class(kind)
        text = io.StringIO()
        document.write(text)
    data: bytes = document.encode(text.getvalue())
    return data


@contextmanager
def _undated(settings: Any) -> Iterator[None]:
    """Documents made here do not tell when, and are not named at random."""
    before, settings.write_fixed_meta_data_for_testing = settings.write_fixed_meta_data_for_testing, True
    try:
        yield
    finally:
        settings.write_fixed_meta_data_for_testing = before


def _add_layer(document: Any, layer: Layer, number: int) -> str:
    """A new layer with the name of a planner's, as far as DXF allows; the name it has now."""
    name = _NOT_IN_NAMES.sub("_", layer.name)[:MAX_NAME].strip() or f"layer {number}"
    if name in document.layers:
        name = f"{name} ({number})"
    document.layers.add(name)
    return name


def _add_splines(space: Any, layout: Layout, unit: float, names: list[str], options: ExportOptions) -> None:
    from ezdxf.lldxf.const import VALID_DXF_LINEWEIGHTS

    plan = layout.plan
    chains, starts, _ = layout.outlined(TOLERANCE_MM / unit, every=True) if options.outline else _plain(layout)
    points = np.column_stack([chains[:, 0], layout.height - chains[:, 1], np.zeros(len(chains))]) * unit
    weights = np.array(VALID_DXF_LINEWEIGHTS)
    nearest = weights[np.abs(layout.widths[:, None] * unit * 100 - weights).argmin(axis=1)].tolist()
    colors = (plan.colors.astype(np.int64) @ (1 << 16, 1 << 8, 1)).tolist()
    for name, layer in zip(names, plan.layers, strict=True):
        for i in range(layer.first, layer.last):
            chain = points[starts[i] : starts[i + 1]]
            attributes = {"layer": name, "true_color": colors[i], "lineweight": 0 if options.outline else nearest[i]}
            spline = space.add_spline(degree=3, dxfattribs=attributes)
            spline.control_points = chain.tolist()
            pieces = len(chain) // 3
            spline.knots = [0.0, *np.repeat(np.arange(pieces + 1.0), 3).tolist(), float(pieces)]


def _plain(layout: Layout) -> tuple[Any, Any, None]:
    return layout.points, layout.plan.starts, None
