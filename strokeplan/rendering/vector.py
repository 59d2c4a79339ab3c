"""PDF, PostScript and EPS on Pycairo's vector surfaces: strokes stay strokes, outlines stay curves.

A document is as large as its SVG: a pixel is 1/96 of an inch, or the page has its millimetres. Nothing in
it tells when it was written, so the same plan gives the same bytes.

Known limits: Cairo keeps coordinates to 1/256 of a point (0.0014 mm) and has no layers; a PostScript title
is ASCII.
"""

from __future__ import annotations

import io
import re
from itertools import islice
from typing import Any, Literal

import numpy as np

from strokeplan.formats.layout import Layout, lay_out
from strokeplan.formats.options import DEFAULTS, ExportOptions
from strokeplan.page import MM_PER_INCH, PX_PER_INCH
from strokeplan.pens import transparent_layers
from strokeplan.rendering.surface import require_cairo
from strokeplan.strokes import StrokePlan

POINTS_PER_INCH = 72.0
TOLERANCE_PT = 0.05
"""By this much an outline may differ from its stroke."""
FARTHEST_PT = 4e6
"""Cairo's coordinates wrap around at 2²³ points; what lies beyond half of that is cut."""
Kind = Literal["pdf", "ps", "eps"]


def encode_vector(plan: StrokePlan, kind: Kind, options: ExportOptions = DEFAULTS) -> bytes:
    """The plan as a PDF, PostScript or EPS document of one page.

    Of the options `page`, `outline` and `clip` count. Raises InputError, MissingExtraError without Pycairo.
    """
    cairo = require_cairo()
    layout = lay_out(plan, options)
    scale = POINTS_PER_INCH / (MM_PER_INCH if layout.mm else PX_PER_INCH)
    stream = io.BytesIO()
    title = (plan.source.name if plan.source else "").replace("\0", "\ufffd") or "strokeplan"
    surface = _surface(cairo, stream, kind, (layout.width * scale, layout.height * scale), title)
    context = cairo.Context(surface)
    context.scale(scale, scale)
    context.rectangle(*layout.canvas)
    context.set_source_rgb(*(value / 255 for value in plan.background))
    if options.clip:
        context.clip_preserve()
    context.fill()
    _draw(context, layout, scale, options, kind)
    surface.finish()
    # PostScript is dated by Cairo, PDF only if asked.
    return (
        re.sub(rb"(?m)^%%CreationDate: .*\n", b"", stream.getvalue(), count=1) if kind != "pdf" else stream.getvalue()
    )


def _surface(cairo: Any, stream: io.BytesIO, kind: Kind, size: tuple[float, float], title: str) -> Any:
    """An empty document of a size in points."""
    if kind == "pdf":
        surface = cairo.PDFSurface(stream, *size)
        surface.set_metadata(cairo.PDFMetadata.TITLE, title)
        surface.set_metadata(cairo.PDFMetadata.CREATOR, "strokeplan")
        surface.set_metadata(cairo.PDFMetadata.CREATE_DATE, "")  # none, rather than now
        return surface
    surface = cairo.PSSurface(stream, *size)
    surface.set_eps(kind == "eps")
    surface.dsc_comment("%%Title: " + re.sub("[^ -~]", "?", title)[:200])
    return surface


def _draw(context: Any, layout: Layout, scale: float, options: ExportOptions, kind: Kind) -> None:
    """Lay every stroke, in order."""
    cairo, plan = require_cairo(), layout.plan
    chains, ends, filled = layout.outlined(TOLERANCE_PT / scale, every=options.outline)
    points = np.clip(chains, -FARTHEST_PT / scale, FARTHEST_PT / scale).tolist()
    starts, colors, widths = ends.tolist(), (plan.colors / 255).tolist(), layout.widths.tolist()
    closed = filled.tolist()
    context.set_line_join(cairo.LINE_JOIN_ROUND)
    filtering = transparent_layers(plan) if kind == "pdf" else [False] * len(plan.layers)  # PostScript cannot
    for layer, filters in zip(plan.layers, filtering, strict=True):
        if filters:
            context.push_group()
        context.set_line_cap(cairo.LINE_CAP_BUTT if layer.cap == "butt" else cairo.LINE_CAP_ROUND)
        strokes = range(layer.first, layer.last)
        for i, first, last in zip(
            strokes, islice(starts, layer.first, None), starts[layer.first + 1 : layer.last + 1], strict=False
        ):
            context.set_source_rgb(*colors[i])
            context.move_to(*points[first])
            for k in range(first + 1, last, 3):
                context.curve_to(*points[k], *points[k + 1], *points[k + 2])
            if closed[i]:
                context.close_path()
                context.fill()
            else:
                context.set_line_width(widths[i])
                context.stroke()
        if filters:
            context.pop_group_to_source()
            context.set_operator(cairo.OPERATOR_MULTIPLY)
            context.paint()
            context.set_operator(cairo.OPERATOR_OVER)
