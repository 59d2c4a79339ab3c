"""Drawings that the tests of machines share, in millimetres of a page."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from readers import cubic

from strokeplan.strokes import Layer, StrokePlan


def drawing(
    chains: list[NDArray[np.float64]],
    size: tuple[float, float] = (100.0, 80.0),
    pens: tuple[str | None, ...] | None = None,
    **changes: object,
) -> StrokePlan:
    """A plan of chains of cubics on a page of true size."""
    n = len(chains)
    fields: dict[str, object] = {
        "width": size[0],
        "height": size[1],
        "points": np.concatenate(chains) if chains else np.empty((0, 2)),
        "starts": np.cumsum([0, *map(len, chains)], dtype=np.int64),
        "widths": np.full(n, 0.5),
        "colors": np.tile(np.arange(n, dtype=np.uint8)[:, None], 3),
        "layers": (Layer("ink", 0, n, "ink"),),
        "settings": {"page_mm": list(size)},
        "pens": pens,
    }
    return StrokePlan(**{**fields, **changes})  # type: ignore[arg-type]


def curve(*numbers: float) -> NDArray[np.float64]:
    """A chain of cubics from its numbers."""
    return np.array(numbers, float).reshape(-1, 2)


SWAN = curve(10, 10, 40, 0, 60, 40, 90, 10)
EYE = curve(20, 50, 20, 61, 40, 61, 40, 50, 40, 39, 20, 39, 20, 50)
BAR = curve(50, 70, 60, 70, 70, 70, 80, 70)
THREE = drawing([SWAN, EYE, BAR])


def drawn(plan: StrokePlan) -> list[NDArray[np.float64]]:
    """The plan's strokes as dense polylines, by Bernstein's polynomials."""
    lines = []
    for chain in plan:
        pieces = [cubic(chain[k : k + 4].tolist(), 240) for k in range(0, len(chain) - 1, 3)]
        lines.append(np.concatenate([chain[:1], *pieces]))
    return lines


coordinates = st.integers(0, 800).map(lambda value: value / 8)


@st.composite
def drawings(draw: st.DrawFn) -> StrokePlan:
    """Any drawing of a few strokes on 100 × 100 mm: kinks, cusps, points, strokes on top of each other."""
    chains = []
    for _ in range(draw(st.integers(1, 5))):
        points = st.lists(st.tuples(coordinates, coordinates), min_size=4, max_size=4)
        chain = draw(points)
        for _ in range(draw(st.integers(0, 2))):
            chain += draw(points)[1:]
        chains.append(np.array(chain, float))
    return drawing(chains, (100.0, 100.0))
