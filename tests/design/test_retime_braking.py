"""A start speed above the limits: the vehicle brakes until it is within them; closed forms, samples and refusals."""

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.timing.braking import RESERVE

A, V, START = 2.0, 13.0, 20.0
STRAIGHT = qt.Shape.through([[0.0, 0, 0], [80, 0, 0], [150, 0, 0]])
CORNER = qt.Shape.through([[0, 0, 0], [60, 0, 0], [100, 25, 0], [120, 70, 1], [160, 90, 2], [240, 90, 2]])
LIMITS = {"speed": V, "lateral_acceleration": 2.0, "longitudinal_acceleration": 1.5}


def sampled(timed, *names, count=4001):
    times = np.linspace(0.0, float(timed.duration), count)
    return times, qt.evaluate(timed.path, times, names)


def test_on_a_straight_line_the_vehicle_brakes_to_the_limit():
    """It brakes for (v − V)/A, over (v² − V²)/(2A), and drives the rest with V."""
    timed = qt.retime(STRAIGHT, qt.Limits(speed=V, longitudinal_acceleration=A), start_speed=START, throw=True)
    time, distance = (START - V) / A, (START**2 - V**2) / (2 * A)
    total = time + (150 - distance) / V
    assert timed.code == qt.ResultCode.starts_above_limits
    assert timed.successful
    assert float(timed.braking_time) == pytest.approx(time, rel=0.02)  # up to the next knot, more gently
    assert float(timed.duration) == pytest.approx(total, rel=2e-3)
    assert np.asarray(timed.speeds)[0] == pytest.approx(START, rel=1e-9)
    assert timed.certificate.status == {"speed": "broken", "longitudinal_acceleration": "proved"}
    assert timed.certificate.worst["speed"][1] == pytest.approx(START, rel=1e-6)
    assert f"From t = {float(timed.braking_time):.4g} s" in timed.result
    assert "20 of 13 m/s" in timed.result


@pytest.mark.parametrize("start", [12.9, 14.0, START])
def test_from_the_end_of_braking_on_every_limit_is_satisfied(start):
    """At 12.9 m/s the speed is within its limit, but the bend ahead is too close for it."""
    shape = CORNER if start > V else qt.Shape.through([[0, 0, 0], [20, 0, 0], [32, 12, 0], [32, 40, 0], [32, 90, 0]])
    timed = qt.retime(shape, qt.Limits(**LIMITS), start_speed=start)
    assert timed.code == qt.ResultCode.starts_above_limits
    times, x = sampled(timed, "speed", "lateral_acceleration", "longitudinal_acceleration")
    late = times > float(timed.braking_time)
    assert not timed.certificate.holds
    assert timed.certificate.status["longitudinal_acceleration"] == "proved"
    assert max(np.max(x.speed / V), np.max(x.lateral_acceleration / 2)) > 1.01
    assert max(np.max(x.speed[late] / V), np.max(x.lateral_acceleration[late] / 2)) <= 1
    assert np.allclose(x.speed[~late], start - 1.5 * times[~late], rtol=0, atol=0.03 * start)
    assert np.max(np.abs(np.diff(x.speed))) <= 1.5 * times[1] * (1 + 1e-9)
    place = timed.path.position(timed.braking_time)
    speed = np.interp(float(timed.braking_time), times, x.speed)
    assert float(timed.braking_distance) == pytest.approx((start**2 - speed**2) / 3, rel=0.02)
    assert np.all(np.isfinite(np.asarray(place)))


def test_braking_ends_where_the_timing_from_a_free_start_is_met():
    """From there on, the timing is the same, and before, the deceleration is the limit but for its reserve."""
    limits = qt.Limits(**LIMITS)
    free, timed = qt.retime(CORNER, limits), qt.retime(CORNER, limits, start_speed=START)
    u = np.linspace(timed.timing.parameter(timed.braking_time) + 1e-9, float(timed.timing.knots[-1]), 400)
    for parameter in u[::40]:
        assert timed.timing.squared_speed(parameter) == pytest.approx(float(free.timing.squared_speed(parameter)))
    times, x = sampled(timed, "longitudinal_acceleration")
    early = times < 0.9 * float(timed.braking_time)
    usage = np.abs(x.longitudinal_acceleration[early]) / 1.5
    assert np.min(usage) > 0.95
    assert np.max(usage) <= 1 - RESERVE / 10


def test_the_certificate_of_the_path_agrees():
    limits = qt.Limits(**LIMITS)
    timed = qt.retime(CORNER, limits, start_speed=START)
    assert qt.certify(timed.path, limits).status == timed.certificate.status
    assert qt.certify(timed.path, limits.only(("longitudinal_acceleration",))).holds


def test_a_route_brakes_before_its_first_stop():
    velocity = [[20.0, 0, 0], [0, 0, 0], [0, 0, 0], [6, 0.5, 0.2]]
    route = qt.Route(
        [0.0, 15, 18, 21], [[-150.0, 0, 0], [0, 0, 0], [0, 0, 0], [12, 1, 0.5]], velocity, np.zeros((4, 3))
    )
    limits = qt.Limits(speed=V, longitudinal_acceleration=A)
    timed = qt.retime(route, limits, start_speed=START)
    assert timed.code == qt.ResultCode.starts_above_limits
    times, x = sampled(timed, "speed")
    assert np.max(x.speed[times > float(timed.braking_time)]) <= V
    assert qt.retime(route, limits, start_speed=26.0).code == qt.ResultCode.end_speed_not_reached  # needs 169 m


@pytest.mark.parametrize(
    ("limits", "advice"),
    [
        ({"speed": V, "acceleration": A}, "add a limit on longitudinal_acceleration"),
        ({"speed": V, "acceleration": A, "jerk": 1.0}, "add a limit on longitudinal_acceleration"),
        ({"speed": V, "longitudinal_acceleration": 0.1}, "before its first stop or the end"),
        ({"speed": V, "longitudinal_acceleration": 0.9, "jerk": 0.2}, "before its first stop or the end"),
    ],
)
def test_refusals_say_what_to_do(limits, advice):
    timed = qt.retime(STRAIGHT, qt.Limits(**limits), start_speed=START)
    assert timed.code == qt.ResultCode.end_speed_not_reached
    assert advice in timed.result
    assert float(timed.braking_time) == 0.0


@pytest.mark.parametrize(("top", "jerk"), [(V, 1.0), (V, 0.4), (19.0, 1.0)])
def test_with_a_limit_on_the_jerk_braking_ends_gradually(top, jerk):
    """On a line, v0 − A·t, then the deceleration decreases at the rate J to 0; for a small change of the speed, from
    √(2J(v0 − V)) on, without a constant part."""
    timed = qt.retime(STRAIGHT, qt.Limits(speed=top, longitudinal_acceleration=A, jerk=jerk), start_speed=START)
    most = min(A, np.sqrt(2 * jerk * (START - top)))
    ramp = most / jerk
    steady = (START - top - most * ramp / 2) / most
    middle = START - most * steady
    distance = (START + middle) / 2 * steady + middle * ramp - most * ramp**2 / 3
    assert timed.code == qt.ResultCode.starts_above_limits
    assert timed.certificate.status == {"speed": "broken", "longitudinal_acceleration": "proved", "jerk": "proved"}
    assert float(timed.duration) == pytest.approx(steady + ramp + (150 - distance) / top, rel=1e-3)
    assert float(timed.braking_time) == pytest.approx(steady + ramp, rel=0.01)
    assert float(timed.braking_distance) == pytest.approx(distance, rel=0.01)
    times, x = sampled(timed, "longitudinal_acceleration", "jerk")
    assert np.max(np.abs(np.diff(x.longitudinal_acceleration))) <= jerk * times[1] * (1 + 1e-6)
    late = (times > steady + 0.1) & (times < steady + ramp - 0.1)
    assert np.allclose(np.linalg.norm(x.jerk[late], axis=1), jerk, rtol=5e-3)
    assert "as strongly as the limits on the longitudinal acceleration and the jerk allow" in timed.result


@pytest.mark.parametrize("seed", range(6))
def test_after_braking_within_the_jerk_on_a_random_path_every_limit_is_satisfied(seed):
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.normal(0, 0.35, 12))
    steps = 25 * np.stack([np.cos(angle), np.sin(angle), rng.normal(0, 0.02, 12)], axis=1)
    shape = qt.Shape.through(np.cumsum(steps, axis=0))
    own = LIMITS | {"longitudinal_acceleration": 2.5, "jerk": float(rng.uniform(1.0, 4.0))}
    limits = qt.Limits(**own)
    timed = qt.retime(shape, limits, start_speed=float(rng.uniform(13.5, 19.0)))
    assert timed.code == qt.ResultCode.starts_above_limits
    times, x = sampled(timed, *own)
    late = times > float(timed.braking_time)
    for name, limit in own.items():
        assert np.max(np.abs(getattr(x, name)[late])) <= limit
    assert np.max(np.abs(x.longitudinal_acceleration)) <= 2.5
    assert np.max(np.abs(np.diff(x.longitudinal_acceleration))) <= 4 * own["jerk"] * times[1]  # without a jump
    found = qt.certify(timed.path, limits).status
    assert found == timed.certificate.status
    assert found["longitudinal_acceleration"] == "proved"


def test_a_path_that_is_not_polynomial_is_sampled():
    curve = qt.Curve(lambda t: jax.numpy.stack([12.0 * t, 5.0 * jax.numpy.sin(0.2 * t), 0.0 * t]), 20.0)
    timed = qt.retime(curve, qt.Limits(**LIMITS), start_speed=START, knots=64)
    assert timed.code == qt.ResultCode.starts_above_limits
    assert "on, every limit is satisfied at all samples" in timed.result


def test_a_result_that_brakes_is_stored(tmp_path):
    timed = qt.retime(STRAIGHT, qt.Limits(speed=V, longitudinal_acceleration=A), start_speed=START)
    timed.save(tmp_path / "timed.json")
    assert qt.load(tmp_path / "timed.json").result == timed.result
