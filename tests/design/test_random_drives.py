"""Fits of random drives, whose ends are at rest, slow or fast, with little and with much noise."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from tests.design import drives, random_drives

import qtraj as qt

BOUND, STRAIGHT = 1.6, 0.05
"""Bound on the largest curvature, relative to that of the street, and the least such curvature [1/m]."""

NOISES = [(0.01, 10.0, 0.05), (0.05, 10.0, 0.15), (0.05, 50.0, 0.1)]
"""Noise [m], rate [Hz], and bound on the distance from the street [m]."""


def limits(drive):
    return qt.Limits(curvature=BOUND * max(drive.largest_curvature, STRAIGHT))


@pytest.mark.parametrize(("noise", "rate", "distance"), NOISES)
@pytest.mark.parametrize("seed", range(6))
def test_the_curvature_is_that_of_the_street_from_end_to_end(seed, noise, rate, distance):
    drive = random_drives.drive(seed)
    fitted = qt.fit_route(drive.recorded(noise, rate))
    assert float(fitted.residual.distance_rms) < 1.1 * noise * np.sqrt(2 + 0.3**2)
    t = np.linspace(0.0, float(fitted.path.duration), 2001)
    positions = np.asarray(qt.evaluate(fitted.path, t, outputs=("position",)).position)
    assert np.linalg.norm(positions - drive.at(t), axis=1).max() < distance
    assert np.abs(np.asarray(fitted.path.jumps())).max(axis=(0, 2)) == pytest.approx(0.0, abs=1e-10)
    certificate = qt.certify(fitted.path, limits(drive))
    assert certificate.holds, certificate


@pytest.mark.parametrize("seed", [0, 1])
def test_windows_that_start_or_end_with_the_recording(seed):
    drive = random_drives.drive(seed)
    track, middle = drive.recorded(0.01, 10.0), 0.5 * drive.duration
    for window in ((0.0, middle), (middle, float(track.times[-1]))):
        certificate = qt.certify(qt.fit_route(track, window=window).path, limits(drive))
        assert certificate.holds, certificate


@pytest.mark.parametrize("rate", [10.0, 20.0, 50.0])
def test_jitter_at_standstill_is_one_stop(rate):
    track = drives.recorded(noise=0.05, rate=rate)
    fitted = qt.fit_route(track)
    np.testing.assert_allclose(np.asarray(fitted.stops), drives.STOPS, atol=0.35)
    assert qt.certify(fitted.path, qt.Limits(curvature=1.4 / drives.RADIUS)).holds
    assert len(qt.fit_route(track, stop_distance=0.1).stops) == 0  # the noise is larger


def test_a_parked_vehicle_with_jitter():
    t = np.arange(0.0, 60.0, 0.1)
    noise = np.random.default_rng(3).normal(0.0, 0.05, (len(t), 3))
    fitted = qt.fit_route(qt.Track(t, np.array([3.0, 4.0, 5.0]) + noise))
    np.testing.assert_array_equal(fitted.stops, [[0.0, t[-1]]])
    np.testing.assert_array_equal(fitted.path.velocity(7.0), 0.0)


def test_a_drive_that_ends_with_reversing_a_short_way_is_fitted_in_the_time():
    """The point of reversal is too close to the end: nothing would be left of a curve between them."""
    t = np.arange(0.0, 18.4, 0.1)
    speed = PchipInterpolator([0, 6, 12, 13, 14, 15, 16, 17, 18.4], [6, 6, 5, 2.5, 0.6, 0, -0.4, -0.4, 0])
    s = speed.antiderivative()(t)
    street = np.stack([s, 0.01 * s**2, 0 * s], axis=1)
    fitted = qt.fit_route(qt.Track(t, street + np.random.default_rng(0).normal(0.0, 0.01, street.shape)))
    positions = np.asarray(qt.evaluate(fitted.path, t, outputs=("position",)).position)
    assert np.linalg.norm(positions - street, axis=1).max() < 0.03
