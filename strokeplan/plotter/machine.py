"""From the page to the machine: one object that says where a point of the paper lies in the machine's coordinates.

A page is in millimetres, x right, y down, from its upper left corner. The machine's axes grow wherever its profile
says; the page's origin corner lies at an offset, which is added last, after any flip. A page that only fits (or is
only known) the other way round is turned by a quarter, clockwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strokeplan.errors import PlotError
from strokeplan.page import Page
from strokeplan.plotter.profile import Corner, Direction, Paper, Point, Profile

TOLERANCE_MM = 1e-6
"""Rounding that is no breach of the travel."""
SAME_MM = 0.6
"""Sheets whose sides differ by less are the same sheet."""
_VECTORS = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "up": (0.0, -1.0), "down": (0.0, 1.0)}
_TURNED: dict[Direction, Direction] = {"right": "up", "up": "left", "left": "down", "down": "right"}
_TURNED_CORNER: dict[Corner, Corner] = {
    "lower-left": "lower-right", "lower-right": "upper-right", "upper-right": "upper-left", "upper-left": "lower-left",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class PageTransform:
    """Page to machine: m = (p − corner) · axes + offset, and the travel that m must stay within."""

    page: Page
    axes: tuple[Direction, Direction]
    origin: Corner
    offset_mm: Point
    x_mm: Point
    y_mm: Point
    turned: bool = False

    @property
    def corner(self) -> tuple[float, float]:
        """The page's origin corner, in page coordinates."""
        return (
            self.page.width_mm if self.origin.endswith("right") else 0.0,
            self.page.height_mm if self.origin.startswith("lower") else 0.0,
        )

    def points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) points of the page, as (n, 2) points of the machine; both in mm."""
        axes = np.array([_VECTORS[self.axes[0]], _VECTORS[self.axes[1]]])
        moved: NDArray[np.float64] = (points - self.corner) @ axes.T + self.offset_mm
        return moved

    def page_points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) points of the machine, as (n, 2) points of the page: the inverse of `points`."""
        axes = np.array([_VECTORS[self.axes[0]], _VECTORS[self.axes[1]]])
        moved: NDArray[np.float64] = (points - np.array(self.offset_mm)) @ axes + self.corner
        return moved

    def outside(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) mm by which points of the machine (n, 2) are beyond its travel; 0 within."""
        low, high = np.array([self.x_mm, self.y_mm]).T
        beyond: NDArray[np.float64] = np.maximum(np.maximum(low - points, points - high).max(axis=1), 0.0)
        return np.where(beyond > TOLERANCE_MM, beyond, 0.0)

    def describe(self) -> str:
        """The transform in one line, for people."""
        turned = ", turned by a quarter clockwise" if self.turned else ""
        return (
            f"page {self.page.width_mm:g} × {self.page.height_mm:g} mm{turned}; its {self.origin.replace('-', ' ')} "
            f"corner is at X{self.offset_mm[0]:g} Y{self.offset_mm[1]:g}, X grows {self.axes[0]}, Y grows "
            f"{self.axes[1]}; travel {self.travel}"
        )

    @property
    def travel(self) -> str:
        """The travel, for people."""
        return f"X {self.x_mm[0]:g}..{self.x_mm[1]:g}, Y {self.y_mm[0]:g}..{self.y_mm[1]:g} mm"


def page_transform(page: Page, profile: Profile) -> PageTransform:
    """How a page lies in the machine of a profile. Raises PlotError for one that it does not take."""
    machine = profile.machine
    if profile.papers:
        paper, turned = find_paper(page, profile)
        return _made(page, profile, paper.offset_mm, (paper.x_mm, paper.y_mm), turned)
    spans = machine.draw_spans
    across = machine.axes[0] in ("right", "left")
    room = [span[1] - span[0] for span in (spans if across else spans[::-1])]
    sides = page.width_mm, page.height_mm
    if _fits(sides, room):
        return _made(page, profile, machine.offset_mm, spans, turned=False)
    if _fits(sides[::-1], room):
        return _made(page, profile, machine.offset_mm, spans, turned=True)
    raise PlotError(
        f"a page of {page.width_mm:g} × {page.height_mm:g} mm is larger than what {profile.name} reaches, "
        f"{room[0]:g} × {room[1]:g} mm; take a smaller --page"
    )


def find_paper(page: Page, profile: Profile) -> tuple[Paper, bool]:
    """The machine's paper for a page, and whether the page lies on it turned. Raises PlotError if there is none."""
    for turned in (False, True):
        sides = (page.height_mm, page.width_mm) if turned else (page.width_mm, page.height_mm)
        for paper in profile.papers:
            sheet = paper.sheet
            if np.allclose(sides, (sheet.width_mm, sheet.height_mm), rtol=0, atol=SAME_MM):
                return paper, turned
    known = ", ".join(paper.page for paper in profile.papers)
    raise PlotError(
        f"a page of {page.width_mm:g} × {page.height_mm:g} mm is no paper of {profile.name}; it takes {known}"
    )


def _fits(sides: tuple[float, ...], room: list[float]) -> bool:
    return all(side <= most + SAME_MM for side, most in zip(sides, room, strict=True))


def _made(page: Page, profile: Profile, offset: Point, spans: tuple[Point, Point], turned: bool) -> PageTransform:
    axes, origin = profile.machine.axes, profile.machine.origin
    if turned:
        axes, origin = (_TURNED[axes[0]], _TURNED[axes[1]]), _TURNED_CORNER[origin]
    return PageTransform(page, axes, origin, offset, *spans, turned)
