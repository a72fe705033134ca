"""Stops of recordings with noise from 0.1 mm to 1 m, with and without velocities."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import qtraj as qt
from qtraj.design.fitting.route_standstill import Samples, stands, standstill

RATE = 10.0
STOP = (15.0, 30.0)
DRIVE = [(0, 10), (10, 10), (15, 0), (30, 0), (36, 10), (46, 10)]
"""Times [s] and speeds [m/s] of a drive that brakes, stands for 15 s, and departs."""

VELOCITY_SIGMA = 0.02
RADIUS = 60.0
"""Radius [m] of the bend in which the vehicle drives."""

AT_REST = 1e-4
"""Largest yaw rate [rad/s] of a vehicle at rest."""

ENDS = 1.0
"""Accuracy [s] of the ends of a stop: while the vehicle moves by a part of the noise, it cannot be noticed."""


def recorded(sigma, velocities=False, seed=0, drive=DRIVE, abrupt=True):
    """Return a recording with noise `sigma` [m] of a drive along a bend."""
    knots = np.array(drive, float)
    speed = (lambda t: np.interp(t, *knots.T)) if abrupt else PchipInterpolator(*knots.T)
    fine = np.linspace(0.0, knots[-1, 0], 100_001)
    way = np.append(0.0, np.cumsum(0.5 * (speed(fine[1:]) + speed(fine[:-1])) * np.diff(fine)))
    t = np.arange(0.0, knots[-1, 0] + 0.5 / RATE, 1 / RATE)
    angle = np.interp(t, fine, way) / RADIUS
    rng = np.random.default_rng(seed)
    positions = RADIUS * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
    headings = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * speed(t)[:, None]
    noise = [rng.normal(0.0, size, positions.shape) for size in (sigma, VELOCITY_SIGMA)]
    return qt.Track(t, positions + noise[0], headings + noise[1] if velocities else None)


def yaw_rate(path, start, end):
    """Return the largest yaw rate [rad/s] of a path between two times."""
    return np.abs(qt.evaluate(path, np.linspace(start, end, 500), ("yaw_rate",)).yaw_rate).max()


@pytest.mark.parametrize("velocities", [False, True], ids=["positions", "velocities"])
@pytest.mark.parametrize("sigma", [1e-4, 1e-3, 0.01, 0.02, 0.05, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("abrupt", [True, False], ids=["abrupt", "smooth"])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_stop_is_found_in_any_noise(sigma, velocities, abrupt, seed):
    fitted = qt.fit_route(recorded(sigma, velocities, seed, abrupt=abrupt))
    assert len(fitted.stops) == 1
    np.testing.assert_allclose(fitted.stops[0], STOP, atol=ENDS)
    assert yaw_rate(fitted.path, STOP[0] + ENDS, STOP[1] - ENDS) <= AT_REST
    assert "1 stops" in repr(fitted)


@pytest.mark.parametrize("velocities", [False, True], ids=["positions", "velocities"])
@pytest.mark.parametrize("sigma", [0.02, 0.05, 0.3])
@pytest.mark.parametrize("given", ["knots", "smoothing", "tolerance", "sigmas"])
def test_a_stop_is_found_whatever_is_given(given, sigma, velocities):
    sigmas = {"position_sigma": sigma} | ({"velocity_sigma": VELOCITY_SIGMA} if velocities else {})
    arguments = {"knots": {"knots": 1.0}, "smoothing": {"smoothing": 1e-3}, "tolerance": {"tolerance": 1.8 * sigma}}
    fitted = qt.fit_route(recorded(sigma, velocities), **(arguments | {"sigmas": sigmas})[given])
    assert len(fitted.stops) == 1
    np.testing.assert_allclose(fitted.stops[0], STOP, atol=ENDS)
    assert yaw_rate(fitted.path, STOP[0] + ENDS, STOP[1] - ENDS) <= AT_REST


@pytest.mark.parametrize("velocities", [False, True], ids=["positions", "velocities"])
@pytest.mark.parametrize("sigma", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("slowest", [0.3, 1.0, 10.0])
def test_a_vehicle_that_creeps_does_not_stop(sigma, velocities, slowest):
    creeping = [(t, v or slowest) for t, v in DRIVE]
    for seed in range(3):
        assert len(qt.fit_route(recorded(sigma, velocities, seed, creeping)).stops) == 0


def test_a_stop_that_noise_conceals_is_not_claimed():
    short = [(0, 10), (10, 10), (15, 0), (17, 0), (23, 10), (33, 10)]
    assert len(qt.fit_route(recorded(1.0, drive=short)).stops) == 0
    assert len(qt.fit_route(recorded(1e-3, drive=short)).stops) == 1


def test_two_stops_in_noise():
    twice = [*DRIVE, (56, 10), (61, 0), (76, 0), (82, 10), (92, 10)]
    fitted = qt.fit_route(recorded(0.3, drive=twice))
    np.testing.assert_allclose(fitted.stops, [STOP, (61.0, 76.0)], atol=ENDS)


def at(velocity, sigma, seed, count=150):
    """Return samples of a uniform motion at 10 Hz."""
    t = np.arange(count) / RATE
    noise = np.random.default_rng(seed).normal(0.0, sigma, (count, 3))
    return Samples(t, t[:, None] * np.array([velocity, 0.0, 0.0]) + noise, np.full((count, 3), sigma), None, None)


def test_the_test_of_a_vehicle_at_rest_and_in_motion():
    deviation = 1.0 * np.sqrt(12.0) / (15.0 * np.sqrt(150))  # of the mean velocity
    rest = sum(stands(at(0.0, 1.0, seed), 8 * deviation) for seed in range(500))
    moving = sum(stands(at(8 * deviation, 1.0, seed), 8 * deviation) for seed in range(500))
    assert rest >= 495
    assert moving <= 5
    assert not any(stands(at(0.0, 1.0, seed), 4 * deviation) for seed in range(20))  # it would not be noticed


def test_the_part_of_an_interval_at_rest():
    still, moving = at(0.0, 0.1, 0, 100), at(1.0, 0.1, 1, 50)
    positions = np.concatenate([still.positions, moving.positions])
    samples = Samples(np.arange(150) / RATE, positions, np.full((150, 3), 0.1), None, None)
    [(start, end)] = standstill(samples, 0.0, 14.9, 0.2, 1.0)
    assert start == 0.0
    assert 9.9 <= end <= 10.8
    assert standstill(samples, 10.5, 14.9, 0.2, 1.0) == []
