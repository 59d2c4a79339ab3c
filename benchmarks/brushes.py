"""Pictures of the brushes: python benchmarks/brushes.py

Plans a sample once and paints it with every brush: docs/brushes/NAME.jpg, the whole picture on the left and a part of
it, four times as large, on the right. docs/brushes.md shows them.
"""

from __future__ import annotations

from styles import DOCS, ROOT, jpeg

from strokeplan.figures import shrink, side_by_side
from strokeplan.formats import write
from strokeplan.planner import plan
from strokeplan.rendering import BRUSHES, render

SAMPLE, PRESET = "samples/coffee.jpg", "impressionist"
PART = (195.0, 110.0, 120.0, 80.0)
"""The cup's rim, with the proportions of the whole, in pixels of the sample."""
WIDTH = 480
MOST_BYTES = 120_000


def main() -> None:
    strokes = plan(ROOT / SAMPLE, PRESET)
    (DOCS / "brushes").mkdir(exist_ok=True)
    for brush in BRUSHES:
        whole = shrink(render(strokes, width=2 * WIDTH, brush=brush), 0.5)
        part = render(strokes, width=WIDTH, brush=brush, region=PART)
        write(DOCS / "brushes" / f"{brush}.jpg", jpeg(side_by_side([whole, part]), MOST_BYTES))


if __name__ == "__main__":
    main()
