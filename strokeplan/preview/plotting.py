"""What the page of a plot shows beside its lines: where the pen travels, the margin, and when each line is done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strokeplan.plotter.drawn import drawn, home
from strokeplan.plotter.program import Program
from strokeplan.plotter.route import route_of
from strokeplan.strokes import StrokePlan


@dataclass(frozen=True, eq=False)
class Plot:
    """A plot of n lines, for the page. Lengths in mm of the page.

    done_s   (n,) seconds from the start at which each line is drawn; total_s when the machine is back.
    home     where the machine begins.
    stops    (line, x, y): where it goes before a line, or at the end, beside the lines.
    margin   the bare border; title what is drawn.
    """

    done_s: NDArray[np.float64]
    total_s: float
    home: tuple[float, float]
    stops: tuple[tuple[int, float, float], ...]
    margin: float
    title: str

    def header(self) -> dict[str, object]:
        """What the page's header holds of it; times are a column."""
        return {
            "total": round(self.total_s, 2),
            "home": [round(value, 3) for value in self.home],
            "stops": [[line, round(x, 3), round(y, 3)] for line, x, y in self.stops],
            "margin": self.margin,
        }


def plot_of(program: Program, background: tuple[int, int, int]) -> tuple[StrokePlan, Plot]:
    """The lines of a program as a plan on its page, and what the page shows beside them."""
    route = route_of(program)
    at = np.array([stop.at for stop in route.stops], np.float64).reshape(-1, 2)
    places = program.transform.page_points(at).tolist()
    x, y = home(program).tolist()
    done = np.cumsum(route.took_s)
    plot = Plot(
        done[route.line >= 0],
        float(done[-1]),
        (x, y),
        tuple((stop.line, px, py) for stop, (px, py) in zip(route.stops, places, strict=True)),
        program.transform.page.margin_mm,
        program.title,
    )
    return drawn(program, background), plot
