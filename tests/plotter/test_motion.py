"""Motion against what is known by formula, and what no plan may do."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from strokeplan.errors import InputError
from strokeplan.plotter.motion import Limits, Motion, Pen, plan

FAST = Limits(rate=(6000, 6000), acceleration=(500, 500), junction_deviation=0.01)


def draw(points: object, feed: float = 3000, limits: Limits = FAST, pen: Pen | None = None) -> Motion:
    """One polyline, drawn from its own first point."""
    line = np.array(points, float)
    return plan(line, np.array([0, len(line)]), limits, feed, pen=pen, start=(line[0, 0], line[0, 1]))


def test_a_long_line_is_a_trapezoid() -> None:
    """50 mm/s at 500 mm/s²: 0.1 s and 2.5 mm up, the same down, 95 mm between."""
    motion = draw([[0, 0], [100, 0]])
    assert motion.total_s == pytest.approx(0.1 + 0.1 + 95 / 50)
    assert motion.cruise[0] == pytest.approx(50)


def test_a_short_line_is_a_triangle() -> None:
    motion = draw([[0, 0], [2, 0]])
    assert motion.total_s == pytest.approx(2 * sqrt(2 / 500))
    assert motion.cruise[0] == pytest.approx(sqrt(500 * 2))


def test_corners_of_a_square_are_taken_at_the_junction_speed() -> None:
    """At 90° the half angle has sin √½; both axes' limits bound the acceleration across it by √2 of one."""
    motion = draw([[0, 0], [50, 0], [50, 50], [0, 50], [0, 0]])
    corner = sqrt(500 * sqrt(2) * 0.01 * sqrt(0.5) / (1 - sqrt(0.5)))
    assert motion.exit[:3] == pytest.approx([corner] * 3)
    assert motion.entry[1:] == pytest.approx([corner] * 3)


def test_a_circle_is_no_faster_than_its_segments_allow() -> None:
    """Chords of n parts turn by 2π/n; deviation d of such a junction is a circle of radius r with v² = a r."""
    n, radius = 60, 20.0
    angle = np.linspace(0, 2 * pi, n + 1)
    limits = Limits((1e6, 1e6), (500, 500), 0.01, lookahead=1000)
    motion = draw(radius * np.stack([np.cos(angle), np.sin(angle)], 1), 1e6, limits)
    half = np.cos(pi / n)
    slowest = sqrt(500 * 0.01 * half / (1 - half))
    middle = motion.entry[n // 3 : 2 * n // 3]
    assert middle.min() >= slowest * (1 - 1e-6)
    assert middle.min() == pytest.approx(slowest, rel=1e-3)
    assert middle.max() <= slowest * 2**0.25 * (1 + 1e-6)


def test_collinear_segments_do_not_slow_down() -> None:
    whole, parts = draw([[0, 0], [100, 50]]), draw(np.linspace([0, 0], [100, 50], 12))
    assert parts.total_s == pytest.approx(whole.total_s)


def test_a_full_turn_stops() -> None:
    assert draw([[0, 0], [10, 0], [0, 0]]).total_s == pytest.approx(2 * draw([[0, 0], [10, 0]]).total_s)


def test_a_short_buffer_holds_the_speed_back() -> None:
    """0.1 mm blocks and 15 at once: entered no faster than 14 of them stop."""
    line = np.linspace([0, 0], [50, 0], 501)
    motion = draw(line, 6000)
    assert motion.cruise.max() == pytest.approx(sqrt(2 * 500 * 1.4), rel=0.03)
    assert draw(line, 6000, Limits((6000, 6000), (500, 500), lookahead=501)).cruise.max() == pytest.approx(100)


def test_each_axis_has_its_limits() -> None:
    limits = Limits(rate=(6000, 600), acceleration=(500, 100))
    motion = draw([[0, 0], [300, 300]], 1e5, limits)
    assert motion.cruise[0] == pytest.approx(10 * sqrt(2))
    assert motion.acceleration[0] == pytest.approx(100 * sqrt(2))


def test_corexy_limits_are_those_of_the_motors() -> None:
    """Along x both motors run as fast as the pen; on the diagonal one stands and the other runs √2 as fast."""
    limits = Limits((6000, 6000), (500, 500), kinematics="corexy")
    assert draw([[0, 0], [100, 0]], 1e5, limits).cruise[0] == pytest.approx(100)
    assert draw([[0, 0], [100, 100]], 1e5, limits).cruise[0] == pytest.approx(100 / sqrt(2))


def test_pens_wait_and_travels_are_rapid() -> None:
    points = np.array([[10, 0], [20, 0], [120, 0], [130, 0.0]])
    pen = Pen(down_s=0.2, up_s=0.1)
    motion = plan(points, np.array([0, 2, 4]), FAST, 600, pen=pen)
    assert motion.cruise[~motion.down].max() == pytest.approx(100)
    assert motion.total_s == pytest.approx(motion.duration.sum() + 2 * 0.3)
    assert sum(motion.by([7, 9]).values()) == pytest.approx(motion.total_s)
    before = motion.at([motion.began[1] - 0.1])  # the pen is going down
    assert before.speeds[0] == 0
    assert not before.down[0]
    assert before.points[0] == pytest.approx([10, 0])


def test_whole_steps_move_the_corners() -> None:
    motion = draw([[0, 0], [0.04, 0], [10.04, 0]], limits=Limits((6000, 6000), (500, 500), steps_mm=10))
    assert len(motion.duration) == 1
    assert motion.end[0] == pytest.approx([10, 0])


lines = hnp.arrays(np.float64, st.tuples(st.integers(1, 30), st.just(2)), elements=st.integers(-400, 400).map(float))


@given(points=lines, deviation=st.sampled_from([0.0, 0.01, 1.0]), scale=st.sampled_from([0.01, 1.0]), data=st.data())
def test_what_no_plan_may_do(points: NDArray[np.float64], deviation: float, scale: float, data: st.DataObject) -> None:
    limits = Limits((5000, 3000), (800, 300), deviation, data.draw(st.integers(2, 20)))
    cut = data.draw(st.integers(0, len(points) - 1))
    starts = np.unique([0, cut, len(points)])
    motion = plan(points * scale, starts, limits, 2400)
    step = motion.end - motion.begin
    length = np.hypot(*step.T)
    unit = np.abs(step) / length[:, None]
    assert np.all(motion.cruise[:, None] * unit <= np.array([5000, 3000]) / 60 * (1 + 1e-9))
    assert np.all(motion.acceleration[:, None] * unit <= np.array([800, 300]) * (1 + 1e-9))
    assert np.all(motion.cruise[motion.down] <= 40 * (1 + 1e-9))
    assert np.all(motion.exit[:-1] == motion.entry[1:])
    for v in (motion.entry, motion.exit):
        assert np.all(motion.cruise**2 - v**2 <= 2 * motion.acceleration * length * (1 + 1e-6) + 1e-9)
    assert np.all(motion.duration >= length / motion.cruise * (1 - 1e-9))
    assert np.all(motion.duration >= (2 * motion.cruise - motion.entry - motion.exit) / motion.acceleration - 1e-9)
    rests = np.flatnonzero((motion.down[1:] != motion.down[:-1]) | (motion.stroke[1:] != motion.stroke[:-1]))
    assert np.all(motion.exit[rests] == 0)


@given(points=lines)
def test_with_all_in_sight_the_way_back_takes_as_long(points: NDArray[np.float64]) -> None:
    limits = Limits((5000, 3000), (800, 300), 0.05, lookahead=100)
    assert draw(points, limits=limits).total_s == pytest.approx(draw(points[::-1], limits=limits).total_s)


@given(points=lines, t=st.floats(0, 1))
def test_speed_is_the_slope_of_the_way(points: NDArray[np.float64], t: float) -> None:
    motion = draw(points)
    if len(motion.duration):
        end = motion.at(motion.total_s).points[0]
        assert end == pytest.approx(points[-1])
        times = np.array([t, t + 1e-6]) * motion.total_s
        two = motion.at(times)
        gap = np.hypot(*np.diff(two.points, axis=0)[0])
        assert gap <= max(two.speeds.max(), 1e-9) * np.diff(times)[0] + 1e-3 * np.diff(times)[0] + 1e-9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"feed": 0.0}, "feed 0.0 must be above 0"),
        ({"points": np.array([[0, 0], [np.inf, 0]])}, "point 1 is no number"),
        ({"starts": np.array([0, 1])}, "starts must rise from 0 to the number of points, 2"),
    ],
)
def test_what_cannot_be_drawn_is_refused(change: dict[str, object], message: str) -> None:
    given_ = {"points": np.eye(2), "starts": np.array([0, 2]), "limits": FAST, "feed": 100.0, **change}
    with pytest.raises(InputError, match=message):
        plan(**given_)  # type: ignore[arg-type]


def test_limits_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="rate"):
        Limits((0, 1), (1, 1))
    with pytest.raises(InputError, match="pen delays"):
        Pen(-1)
