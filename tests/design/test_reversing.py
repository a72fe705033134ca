"""Drives on which the vehicle reverses: fitted, certified, tuned and retimed like any other drive with stops."""

import re

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.tuning_route import circuit

LIMITS = qt.Limits(horizontal_curvature=0.2, lateral_acceleration=1.0, speed=5.0)
NOISE = 0.003


def manoeuvre(legs, pause, step=0.05):
    """Positions of a vehicle that is at rest between legs (length [m], steering curvature [1/m], direction, time)."""
    times, places, angles, t, p, heading = [], [], [], 0.0, np.zeros(2), 0.3
    for length, curvature, direction, duration in legs:
        own = np.arange(0.0, duration, step)
        u = own / duration
        s = direction * length * u**3 * (10 - 15 * u + 6 * u * u)
        turned = heading + curvature * s
        # the exact arc, as a chord at half of the turned angle
        chord = s * np.sinc(0.5 * curvature * s / np.pi)
        middle = heading + 0.5 * curvature * s
        places.append(p + chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1))
        angles.append(turned)
        times.append(t + own)
        s = direction * length
        p = p + s * np.sinc(0.5 * curvature * s / np.pi) * np.array(
            [np.cos(heading + 0.5 * curvature * s), np.sin(heading + 0.5 * curvature * s)]
        )
        heading += curvature * s
        own = np.arange(0.0, pause, step)
        places.append(np.tile(p, (len(own), 1)))
        angles.append(np.full(len(own), heading))
        times.append(t + duration + own)
        t += duration + pause
    joined = np.concatenate(places)
    return np.concatenate(times), np.pad(joined, ((0, 0), (0, 1))), np.concatenate(angles)


PARKING = ((25.0, 0.05, 1, 10.0), (14.0, 0.1, -1, 8.0))


def recorded(legs=PARKING, pause=2.0, seed=3):
    times, places, angles = manoeuvre(legs, pause)
    noise = np.random.default_rng(seed).normal(0.0, NOISE, places.shape) * (1.0, 1.0, 0.3)
    return qt.Track(times, places + noise), places, angles


def heading(path, times):
    forward = np.asarray(qt.evaluate(path, times, ("dcm",)).dcm)[:, 0]
    return np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))


@pytest.fixture(scope="module")
def drive():
    return qt.fit_route(recorded()[0]).path


@pytest.fixture(scope="module")
def tuned(drive):
    return qt.tune_route(drive, LIMITS, tube=0.3)


@pytest.mark.parametrize("pause", [0.0, 2.0])
def test_the_shape_at_a_point_of_reversal_is_fitted(pause):
    track, places, angles = recorded(pause=pause)
    fitted = qt.fit_route(track)
    path = fitted.path
    times = np.asarray(track.times) - float(track.times[0])
    at = np.asarray(qt.evaluate(path, times, ("position",)).position)
    assert np.sqrt(np.mean((at - places) ** 2)) < NOISE
    assert len(path.stops) == (2 if pause else 0)
    # The first samples, and those at rest, do not determine the heading.
    np.testing.assert_allclose(heading(path, times[10:]), angles[10:], rtol=0, atol=0.06)
    assert qt.certify(path, qt.Limits(curvature=0.6)).holds


def test_a_parking_manoeuvre_is_tuned(drive, tuned):
    assert tuned.converged
    assert tuned.certificate.holds
    assert not np.any(tuned.kept)
    assert qt.certify(drive, LIMITS).status["lateral_acceleration"] == "broken"
    starts = np.asarray(tuned.path.times)[1:-1]
    before, after = (np.stack(tuned.path.sampled(starts + d, 1)[0]) for d in (-1e-9, 1e-9))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-7)
    times = np.linspace(0.0, float(tuned.path.duration), 2000)
    assert np.abs(np.diff(heading(tuned.path, times))).max() < np.radians(1)


def test_the_curvature_at_a_stop_with_a_fixed_state_is_limited_at_its_node(drive, tuned):
    """Where the drive ends at rest, the speed along the curve may change, and with it the curvature."""
    assert int(tuned.iterations) < 80  # 254 with repeated searches, because only the proofs saw the curvature there
    found = qt.tune_route(drive, qt.Limits(curvature=0.2), tube=0.3)
    assert found.converged
    assert int(found.iterations) < 80
    ends = ((x, [float(x.stops[-1][0]) - 1e-3]) for x in (drive, found.path))
    before, after = (float(qt.evaluate(x, end, ("curvature",)).curvature[0]) for x, end in ends)
    assert before > 0.25
    assert after == pytest.approx(0.2, rel=1e-3)
    timed = qt.retime(found.path, qt.Limits(speed=4.0, lateral_acceleration=1.0, longitudinal_acceleration=1.0))
    assert qt.certify(timed.path, qt.Limits(curvature=0.2)).holds


@pytest.mark.parametrize(
    ("limit", "others"),
    [
        (1.2, {}),
        pytest.param(1.1, {"lateral_acceleration": 1.0, "speed": 5.0}, marks=pytest.mark.slow),
        pytest.param(0.6, {"lateral_acceleration": 1.0, "speed": 5.0}, marks=pytest.mark.slow),
    ],
)
def test_limits_far_below_the_accelerations_of_the_drive(drive, limit, others):
    """A second search with convex matrices succeeds; the steps of the first one are too short."""
    limits = qt.Limits(longitudinal_acceleration=limit, **others)
    assert qt.certify(drive, limits).worst["longitudinal_acceleration"][1] > 1.4
    found = qt.tune_route(drive, limits, tube=0.3)
    assert found.code == 0
    assert found.certificate.holds
    assert found.iterations < 160  # 161, and not solved with 609, without the second search


@pytest.mark.slow
def test_a_limit_on_the_curvature_below_the_manoeuvres(drive):
    """The advice is near the curvature of the arc, 0.1 1/m, and the result violates no limit by more than the drive."""
    limits = qt.Limits(curvature=0.05)
    found = qt.tune_route(drive, limits, tube=0.3)
    assert found.code == qt.ResultCode.limits_contradict
    assert found.certificate.worst["curvature"][1] < 1.001 * qt.certify(drive, limits).worst["curvature"][1]
    advised = float(re.search(r"With curvature = ([\d.]+) 1/m, every limit is satisfied", found.result)[1])
    assert 0.09 < advised < 0.13
    assert qt.tune_route(drive, qt.Limits(curvature=advised), tube=0.3).successful


def test_the_manoeuvre_backwards_has_the_same_optimum(drive, tuned):
    back = qt.tune_route(drive.reversed(), LIMITS, tube=0.3)
    assert float(back.objective) == pytest.approx(float(tuned.objective), rel=1e-4)
    places = np.linspace(0.0, 1.0, 200)
    at, mirrored = (
        np.asarray(qt.evaluate(x.path, x.path.duration * u, ("position",)).position)
        for x, u in ((tuned, places), (back, 1 - places))
    )
    np.testing.assert_allclose(mirrored, at, rtol=0, atol=1e-4)


def test_derivatives_agree_with_differences(drive):
    def objective(limit):
        return qt.tune_route(drive, qt.Limits(lateral_acceleration=limit, speed=5.0), tube=0.3).objective

    slope = jax.jvp(objective, (1.0,), (1.0,))[1]
    step = 1e-3
    difference = (objective(1.0 + step) - objective(1.0 - step)) / (2 * step)
    assert float(slope) == pytest.approx(float(difference), rel=1e-3)


def test_a_parking_manoeuvre_is_retimed(tuned):
    limits = qt.Limits(speed=4.0, lateral_acceleration=2.0, longitudinal_acceleration=1.5)
    timed = qt.retime(tuned.path, limits)
    assert timed.converged
    assert qt.certify(timed.path, limits).holds
    assert qt.certify(timed.path, qt.Limits(horizontal_curvature=0.2)).holds
    times = np.arange(0.0, float(timed.path.duration), 0.01)
    assert np.abs(np.diff(heading(timed.path, times))).max() < np.radians(1)


def test_the_curvature_of_a_vehicle_in_reverse_has_the_other_sign_than_its_steering(drive):
    limits = qt.Limits(horizontal_curvature=(-0.11, 0.06))
    found = qt.tune_route(drive, limits, tube=0.5)
    assert found.converged
    assert qt.certify(found.path, limits).holds
    times = np.linspace(0.0, float(found.path.duration), 4001)
    table = qt.evaluate(found.path, times, ("horizontal_curvature", "speed"))
    values = np.asarray(table.horizontal_curvature)[np.asarray(table.speed) > 0.01]
    np.testing.assert_allclose([values.min(), values.max()], [-0.11, 0.06], rtol=0.01)


def test_a_sharp_turn_is_not_taken_for_a_reversal():
    """After a turn by 120° at rest, it is unclear whether the vehicle drives forwards or in reverse."""
    legs = ((20.0, 0.0, 1, 8.0), (20.0, 0.0, 1, 8.0))
    times, places, _ = manoeuvre(legs, 2.0)
    turn = np.radians(120)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1.0]])
    half = times > 9.0
    places[half] = places[half][0] + (places[half] - places[half][0]) @ rotation.T
    noise = np.random.default_rng(4).normal(0.0, NOISE, places.shape)
    path = qt.fit_route(qt.Track(times, places + noise)).path
    assert len(path.stops) == 2
    before = np.searchsorted(np.asarray(path.starts), path.stops[0][0]) - 1
    assert path.progress is None or np.array_equal(np.asarray(path.progress)[before], [0.0, 1.0, 0.0, 0.0])


def test_a_stop_in_a_hairpin_is_not_taken_for_a_reversal():
    """The radius is so small that the vehicle leaves the zones of the stop in the direction from which it came."""
    radius, times = 0.5, np.arange(0.0, 18.0, 0.05)
    half = np.clip(np.minimum(times, 8.0) / 8.0, 0.0, 1.0), np.clip((times - 10.0) / 8.0, 0.0, 1.0)
    s = sum(20.0 * u**3 * (10 - 15 * u + 6 * u * u) for u in half) - 20.0
    angle = np.clip(s / radius, -np.pi / 2, np.pi / 2)
    straight = np.clip(np.abs(s) - 0.5 * np.pi * radius, 0.0, None)
    places = np.stack([radius * np.cos(angle) - straight, radius * np.sin(angle), 0 * s], axis=1)
    noise = np.random.default_rng(4).normal(0.0, NOISE, places.shape)
    path = qt.fit_route(qt.Track(times, places + noise)).path
    at = np.asarray(qt.evaluate(path, times, ("position",)).position)
    assert np.abs(at - places).max() < 0.02
    np.testing.assert_allclose(heading(path, np.linspace(6.0, 12.0, 601))[[0, -1]], [0.0, np.pi], rtol=0, atol=0.1)


@pytest.mark.parametrize("last", [1.0, -1.0])
def test_a_vehicle_does_not_return_to_the_start_of_a_closed_route_with_the_opposite_heading(last):
    c, h = np.zeros((2, 6, 3)), np.ones(2)
    c[:, 1, 0] = 1.0, last  # the tangents at the start and at the end
    circuit.require_same_heading(c, h, np.array([1.0, last]))
    with pytest.raises(ValueError, match="the vehicle reverses an odd number of times"):
        circuit.require_same_heading(c, h, np.array([1.0, -last]))
