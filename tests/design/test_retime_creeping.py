"""A timing does not depend on how slowly a recorded vehicle creeps, and limits between nodes cost no time."""

from pathlib import Path

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.timing.creeping import evenly
from qtraj.path.route import from_segments

CURVE = np.array(
    [[0.0, 0.0, 0.0], [6.0, 0.0, 0.1], [0.0, 0.15, 0.0], [-0.02, 0.03, 0.0], [0.0, -0.004, 0.001], [1e-4, 1e-4, 0.0]]
)
LIMITS = qt.Limits(speed=9.0, lateral_acceleration=2.0, longitudinal_acceleration=1.5, jerk=2.0)
DRIVE = Path(__file__).parents[2] / "examples" / "drive_8km.csv.gz"


def changes(start, end, half):
    """Two cubics along which the rate of progress changes from `start` to `end`; each takes the time `half`."""
    rise = (end - start) / half
    return [
        (half, [0.0, start, 0.0, rise / (6 * half)]),
        (half, [0.0, 0.5 * (start + end), 0.5 * rise, -rise / (6 * half)]),
    ]


def route_with(cubics):
    """The curve with this progress, given as durations and coefficients without the values at the start."""
    starts, rows, at, w = [], [], 0.0, 0.0
    for duration, c in cubics:
        starts.append(at)
        rows.append([w, *c[1:]])
        w += np.polyval(c[::-1], duration)
        at += duration
    curves = np.repeat(CURVE[None], len(rows), axis=0)
    return from_segments(np.array(starts), curves, np.array(at), np.zeros(3), np.array(rows))


def halting(slowest):
    """Drive at an even rate, slow down to the rate `slowest`, and drive on; and all of it at an even rate."""
    even = [(0.7, [0.0, 1.0, 0.0, 0.0])]
    slow = changes(1.0, slowest, 0.4), changes(slowest, 1.0, 0.8)
    hold = [(0.01 / slowest, [0.0, slowest, 0.0, 0.0])]
    return route_with([*even, *slow[0], *hold, *slow[1], *even])


def starting(slowest):
    """Start from rest, creep, and drive on."""
    hold = [(0.02 / slowest, [0.0, slowest, 0.0, 0.0])]
    return route_with([*changes(0.0, 0.5, 0.4), *changes(0.5, slowest, 0.3), *hold, *changes(slowest, 1.0, 0.5)])


def positions(route, count=40):
    lengths = np.linspace(0.0, float(route.length()), count)
    return np.array([np.asarray(route.position(route.time_at(s))) for s in lengths])


def slowest_inside(route):
    t = np.linspace(0.25, 0.98, 200) * float(route.duration)
    return np.linalg.norm(np.asarray(route.sampled(t, 1)[1]), axis=-1).min()


@pytest.mark.parametrize("route", [halting(0.1), halting(0.01), starting(0.02)])
def test_an_even_progress_keeps_the_curve_and_the_time(route):
    even = evenly(route)
    assert float(even.duration) == float(route.duration)
    # a centimetre takes seconds where the vehicle creeps
    np.testing.assert_allclose(positions(even), positions(route), rtol=0, atol=1e-9)
    assert np.abs(np.asarray(even.jumps(2))).max() < 1e-9
    slowest = [slowest_inside(x) for x in (route, even)]
    assert slowest[1] > 2.5 * slowest[0]
    for t in (0.0, float(route.duration)):
        np.testing.assert_allclose(even.position(t), route.position(t), rtol=0, atol=1e-12)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_route_may_begin_or_end_where_the_vehicle_creeps(backwards):
    """With a free speed there, the timing is as fast as that of the same curve with an even progress."""
    ramp, rest = changes(0.004, 1.0, 0.4), [(0.4, [0.0, 1.0, 0.0, 0.0])]
    slow = route_with([*ramp, *rest])
    constant = route_with([(sum(np.polyval(c[::-1], h) for h, c in ramp) + 0.4, [0.0, 1.0, 0.0, 0.0])])
    slow, constant = (x.reversed() if backwards else x for x in (slow, constant))
    assert slowest_inside(evenly(slow)) > 2
    found = qt.retime(slow, LIMITS, throw=True)
    assert found.duration == pytest.approx(float(qt.retime(constant, LIMITS, throw=True).duration), rel=1e-3)
    assert np.abs(np.asarray(evenly(slow).jumps(2))).max() < 1e-9


def test_a_reversed_route_creeps_as_little():
    route = halting(0.01)
    even = evenly(route.reversed())
    np.testing.assert_allclose(positions(even), positions(route.reversed()), rtol=0, atol=1e-9)
    assert float(even.duration) == pytest.approx(float(route.duration))
    assert slowest_inside(even) > 2.5 * slowest_inside(route)
    timed, back = (qt.retime(x, LIMITS, 0.0, 0.0) for x in (route, route.reversed()))
    assert back.converged
    assert float(back.duration) == pytest.approx(float(timed.duration), rel=2e-3)


def test_a_vehicle_that_creeps_for_long_takes_less_time():
    route = halting(1e-4)
    even = evenly(route)
    assert float(even.duration) < 0.1 * float(route.duration)
    assert slowest_inside(even) > 1.0
    np.testing.assert_allclose(positions(even), positions(route), rtol=0, atol=1e-9)


def test_only_creeping_is_replaced():
    route = halting(0.6)
    assert evenly(route) is route
    plain = qt.Route([0.0, 5.0], [[0.0, 0, 0], [20.0, 3, 0]], [[4.0, 0, 0], [4, 1, 0]], np.zeros((2, 3)))
    assert evenly(plain) is plain


@pytest.mark.parametrize("names", [["speed", "lateral_acceleration", "longitudinal_acceleration"], LIMITS.given()])
def test_the_timing_does_not_depend_on_creeping(names):
    """A route that creeps along a centimetre is as long as one without this centimetre."""
    limits = LIMITS.only(names)
    timed = [qt.retime(halting(slowest), limits, 0.0, 0.0) for slowest in (0.03, 3e-4)]
    assert all(x.converged and x.certificate.holds for x in timed), timed
    lengths = [float(halting(slowest).length()) for slowest in (0.03, 3e-4)]
    extra = (lengths[0] - lengths[1]) / 5.0
    assert 0 < extra < 0.1
    assert abs(float(timed[0].duration) - float(timed[1].duration) - extra) < 0.03
    assert max(float(x.gap) for x in timed) < 1e-3


def test_tighter_limits_between_the_nodes_cost_no_time():
    """Cells are halved where the limits at the nodes are much tighter than those that were given."""
    route = qt.fit_route(qt.read_track(DRIVE).window(130.0, 176.5)).path
    limits = qt.Limits(speed=13.9, lateral_acceleration=2.0, longitudinal_acceleration=1.5, jerk=2.0)
    timed, fine = (qt.retime(route, limits, 0.0, 0.0, tolerance=x) for x in (1e-3, 3e-4))
    assert timed.converged
    assert fine.converged
    assert abs(float(timed.duration) / float(fine.duration) - 1) < 3e-3  # 2 % with tighter limits in large cells
    assert float(timed.gap) < 1e-3


def test_a_fit_in_numpy_is_a_path_in_numpy_whatever_the_mode():
    track = qt.read_track(DRIVE).window(20.0, 40.0)
    with jax.enable_x64(False):
        path = qt.fit_route(track).path
        timed = qt.retime(path, LIMITS)
    assert {type(x) for x in jax.tree.leaves(path)} == {np.ndarray}
    assert path.coefficients.dtype == np.float64
    assert timed.converged
