"""Routes through recordings without noise: exact up to both ends, without smoothing and without outliers."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

import qtraj as qt

SIZES = np.array([1.0, 8.0, 1.0, 0.3, 0.05, 0.005])


def quintic(seed):
    """The coefficients (6, 3) of a quintic in time."""
    return np.random.default_rng(seed).standard_normal((6, 3)) * SIZES[:, None]


def derivatives(coefficients, t, order):
    """The derivatives (order + 1, 3) of a polynomial."""
    return np.stack([polynomial.polyval(t, polynomial.polyder(coefficients, m)) for m in range(order + 1)])


@pytest.mark.parametrize(("duration", "count"), [(3.0, 31), (6.0, 61), (20.0, 201), (6.0, 1201)])
def test_a_quintic_is_reproduced_up_to_its_ends(duration, count):
    c = quintic(count)
    times = np.linspace(0.0, duration, count)
    fitted = qt.fit_route(qt.Track(times, polynomial.polyval(times, c).T))
    assert len(fitted.outliers) == 0
    for t in (0.0, 0.4 * duration, duration):
        expected = derivatives(c, t, 3)
        size = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
        np.testing.assert_allclose(np.asarray(fitted.path.derivatives(t, 3)) / size, expected / size, atol=2e-9)


def test_the_ends_of_a_smooth_drive_have_their_jerk():
    times = np.arange(0.0, 59.95, 0.1)
    positions = np.stack([8 * times, 30 * np.sin(times / 9), 0.02 * times], axis=1)
    path = qt.fit_route(qt.Track(times, positions)).path
    for t in (0.0, 30.0, times[-1]):
        _, _, acceleration, jerk = np.asarray(path.derivatives(t, 3))[:, 1]
        assert acceleration == pytest.approx(-30 / 81 * np.sin(t / 9), abs=1e-7)
        assert jerk == pytest.approx(-30 / 729 * np.cos(t / 9), abs=1e-6)


def circle(times, radius, rate):
    return radius * np.stack([np.cos(rate * times), np.sin(rate * times), 0 * times], axis=1)


def test_knots_are_as_close_as_a_tight_circle_needs():
    radius, rate = 5.0, 2.0
    times = np.arange(0.0, 30.0, 0.02)
    path = qt.fit_route(qt.Track(times, circle(times, radius, rate))).path
    for t in (0.0, 15.0, times[-1]):
        jerk = np.asarray(path.derivatives(t, 3))[3]
        expected = radius * rate**3 * np.array([np.sin(rate * t), -np.cos(rate * t), 0.0])
        np.testing.assert_allclose(jerk, expected, atol=0.003 * radius * rate**3)


def test_a_gap_is_bridged_with_minimum_jerk():
    radius, rate = 20.0, 0.5
    times = np.arange(0.0, 60.0, 0.1)
    kept = times[(times < 10.35) | (times > 14.65)]
    path = qt.fit_route(qt.Track(kept, circle(kept, radius, rate))).path
    inside = np.linspace(10.3, 14.7, 50)
    errors = np.stack([path(t) for t in inside]) - circle(inside, radius, rate)
    assert np.linalg.norm(errors, axis=1).max() < 0.1


@pytest.mark.parametrize("noise", [1e-4, 0.02])
def test_noise_is_formulaed(noise):
    times = np.arange(0.0, 30.0, 0.1)
    positions = np.stack([8 * times, 30 * np.sin(times / 9), 0.02 * times], axis=1)
    noisy = positions + noise * np.random.default_rng(1).standard_normal(positions.shape)
    fitted = qt.fit_route(qt.Track(times, noisy))
    assert fitted.smoothing > 1e-12
    inner = times[20:-20]
    error = np.stack([fitted.path(t) for t in inner]) - positions[20:-20]
    assert np.sqrt(np.mean(error**2)) < 0.6 * noise


def test_a_gap_or_a_stop_is_no_reason_to_fail():
    times = np.concatenate([np.arange(0.0, 10.0, 0.1), np.arange(25.0, 40.0, 0.1)])
    fitted = qt.fit_route(qt.Track(times, np.stack([8 * times, 0.1 * times**2, 0 * times], axis=1)))
    assert len(fitted.gaps) == 1
    way = np.cumsum(np.clip(np.abs(np.arange(0.0, 40.0, 0.1) - 20) - 5, 0.0, 1.0))
    times = np.arange(len(way)) * 0.1
    assert len(qt.fit_route(qt.Track(times, np.stack([way, 0 * way, 0 * way], axis=1))).stops) == 1
