"""Prescribed speeds at the ends of a timing: met exactly where they are within reach, otherwise explained."""

import jax
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt

EXACT = 1e-9
"""Relative error of a speed at an end that is within reach."""

CIRCLE = qt.SpiralHelix([10.0], [0, 1.0], [0.0], 2 * np.pi)
A = 0.5


@pytest.mark.parametrize(
    ("limits", "ends"),
    [
        ({"speed": 2.0}, (None, 1.0)),  # any deceleration is allowed, but not by the spline
        ({"speed": 2.0}, (0.3, None)),
        ({"speed": 20.0, "longitudinal_acceleration": A}, (2.0, 8.0)),
        ({"speed": 20.0, "acceleration": A}, (2.0, 2.2)),
        ({"speed": 20.0, "longitudinal_acceleration": A, "jerk": A}, (2.0, 4.0)),
    ],
)
@pytest.mark.parametrize("knots", [None, 64])
def test_speeds_within_reach_are_met_exactly(limits, ends, knots):
    timed = qt.retime(CIRCLE, qt.Limits(**limits), *ends, knots=knots, throw=True)
    assert timed.certificate.holds
    for speed, wanted in zip(np.asarray(timed.speeds), ends, strict=True):
        assert wanted is None or speed == pytest.approx(wanted, rel=EXACT)


def test_a_speed_is_met_although_the_timing_is_slowed_down(monkeypatch):
    """Where the proofs need a slower timing, its ends are corrected."""
    from qtraj.design.timing import part_timing

    proved = part_timing._proved

    def slowed(p, x):
        powers, *rest = proved(p, x)
        return 0.999 * powers, *rest

    monkeypatch.setattr(part_timing, "_proved", slowed)
    timed = qt.retime(CIRCLE, qt.Limits(speed=2.0, longitudinal_acceleration=A), 1.5, 1.0)
    assert np.asarray(timed.speeds) == pytest.approx([1.5, 1.0], rel=EXACT)


@pytest.mark.parametrize(
    ("limits", "ends", "speed", "says"),
    [
        ({"speed": 2.0}, (1.0, 3.0), 2.0, "end_speed cannot be reached .* ends with 2 m/s instead of 3 m/s"),
        ({"longitudinal_acceleration": A}, (2.0, 30.0), np.sqrt(4 + 40 * np.pi * A), "or choose a higher start_speed"),
        ({"acceleration": A}, (2.0, 3.0), np.sqrt(10 * A), r"Pass end_speed=2\.23\d, raise the limits"),
    ],
)
def test_a_speed_out_of_reach_is_named_with_the_highest_one(limits, ends, speed, says):
    timed = qt.retime(CIRCLE, qt.Limits(**{"speed": 20.0} | limits), *ends)
    assert timed.code == qt.ResultCode.end_speed_not_reached
    assert timed.speeds[1] == pytest.approx(speed, rel=1e-3)
    assert np.asarray(timed.wanted).tolist() == list(ends)
    with pytest.raises(RuntimeError, match=says) as error:
        timed.check()
    assert "start_speed cannot" not in str(error.value)


def test_the_advice_for_the_start_is_about_the_start():
    timed = qt.retime(CIRCLE, qt.Limits(speed=20.0, longitudinal_acceleration=0.01), 19.0, 2.0)
    assert "start_speed cannot be reached" in timed.result
    assert "end_speed cannot" not in timed.result


def test_the_speed_at_a_limit_is_the_limit():
    timed = qt.retime(CIRCLE, qt.Limits(speed=2.0, longitudinal_acceleration=A), 2.0, 2.0, throw=True)
    assert np.asarray(timed.speeds) == pytest.approx([2.0, 2.0], rel=3e-5)
    assert timed.certificate.holds


def test_several_bodies_end_with_the_prescribed_speed():
    u = np.arange(4.0)
    routes = [qt.Route.from_piecewise(CubicSpline(u, x)) for x in np.random.default_rng(0).normal(0, 3, (2, 4, 3))]
    timed = qt.retime_together(routes, qt.Limits(speed=3.0, longitudinal_acceleration=1.0), 0.0, 0.5, throw=True)
    assert timed[0].speeds[1] == pytest.approx(0.5, rel=EXACT)


def test_a_prescribed_duration_keeps_the_speeds():
    limits = qt.Limits(speed=4.0, longitudinal_acceleration=A)
    timed = qt.retime(CIRCLE, limits, 1.0, 1.5, duration=30.0, throw=True)
    assert np.asarray(timed.speeds) == pytest.approx([1.0, 1.5], rel=EXACT)
    assert timed.duration == pytest.approx(30.0, rel=1e-3)


def test_inside_jit_a_speed_is_a_bound():
    @jax.jit
    def ends(speed):
        timed = qt.retime(CIRCLE, qt.Limits(speed=2.0, longitudinal_acceleration=A), 1.5, speed, knots=64)
        return timed.speeds, timed.wanted

    speeds, wanted = ends(1.0)
    assert np.asarray(wanted).tolist() == [1.5, 1.0]
    assert np.asarray(speeds) == pytest.approx([1.5, 1.0], rel=1e-3)


def test_a_speed_that_the_duration_does_not_permit_is_explained_by_the_duration():
    limits = qt.Limits(speed=13.0, lateral_acceleration=2.0, longitudinal_acceleration=1.5)
    points = [(0, 0, 0), (20, 5, 0), (40, -5, 0), (60, 5, 0), (80, 0, 0)]
    route = qt.Route.from_piecewise(CubicSpline(5.0 * np.arange(5), points))
    timed = qt.retime(route, limits, start_speed=3.0, end_speed=3.0, duration=40.0)
    assert "start_speed cannot be reached with the duration of" in timed.result
    assert "or a shorter duration" in timed.result
    assert "raise the limits" not in timed.result
