"""Recordings in other units: every result scales with the lengths and times of its input."""

import numpy as np
import pytest

import qtraj as qt

SCALES = [(1e-6, 1.0), (1e9, 1e5), (1e-6, 1e-9), (1e-6, 1e5), (1e3, 1e4), (1.0, 1e-6), (1.7, 0.3)]
TIMES = np.arange(0.0, 30.0, 0.1)
AGREE = {"rtol": 1e-6, "atol": 1e-7}


def drive(times):
    return np.stack([8 * times, 30 * np.sin(times / 9), 0.02 * times], axis=1)


def recorded(kind):
    """The positions (300, 3) of a drive with noise: without stops, with a stop, or with outliers."""
    random = np.random.default_rng(1)
    noise = 0.02 * random.standard_normal((len(TIMES), 3))
    if kind == "stop":
        later = TIMES - 15
        return drive(15 + np.sign(later) * np.clip(np.abs(later) - 3, 0, None)) + 0.1 * noise
    positions = drive(TIMES) + noise
    if kind == "outliers":
        bad = random.random(len(TIMES)) < 0.1
        positions[bad] += 20 * random.standard_normal((int(bad.sum()), 3))
    return positions if kind != "exact" else drive(TIMES)


def states(route):
    """Position, velocity and acceleration (3, 3) at each joint."""
    return [np.asarray(route.derivatives(t, 2)) for t in np.asarray(route.times)]


def stops(length, time):
    return {"stop_speed": 0.05 * length / time, "stop_distance": 0.1 * length}


@pytest.fixture(scope="module", params=["moving", "stop", "outliers", "exact"])
def fitted(request):
    positions = recorded(request.param)
    return positions, qt.fit_route(qt.Track(TIMES, positions), **stops(1, 1))


@pytest.mark.parametrize(("length", "time"), SCALES)
def test_a_fitted_route_scales(fitted, length, time):
    positions, reference = fitted
    scaled = qt.fit_route(qt.Track(TIMES * time, positions * length), **stops(length, time))
    path, expected = scaled.path, reference.path
    np.testing.assert_allclose(np.asarray(path.times) / time, expected.times, **AGREE)
    for got, right in zip(states(path), states(expected), strict=True):
        np.testing.assert_allclose(got * time ** np.arange(3)[:, None] / length, right, atol=1e-6 * np.abs(right).max())
    np.testing.assert_array_equal(scaled.outliers, reference.outliers)
    np.testing.assert_allclose(np.asarray(scaled.stops) / time, reference.stops, **AGREE)
    np.testing.assert_allclose(float(scaled.smoothing) / time**5, reference.smoothing, rtol=1e-3)
    for name, tolerance in (("prediction_error", 1e-3), ("stretch_error", 1e-3), ("position_sigma", 1e-3)):
        got, right = (float(getattr(x, name)) for x in (scaled, reference))
        assert got / length == pytest.approx(right, rel=tolerance, abs=1e-6)
    factor = np.outer(length / time ** np.arange(3), length / time ** np.arange(3))
    middle = len(scaled.knots) // 2
    got, right = (np.asarray(x.covariance())[middle] for x in (scaled, reference))
    if float(reference.position_sigma) > 1e-6:
        np.testing.assert_allclose(got / factor, right, rtol=1e-3, atol=1e-6 * np.abs(right).max())


@pytest.mark.parametrize(("length", "time"), SCALES)
def test_a_few_waypoints_scale(length, time):
    times = np.array([0.0, 3.0, 5.0, 9.0, 14.0])
    reference, scaled = (
        qt.fit_route(qt.Track(times * t, drive(times) * x), stop_distance=0.1 * x) for x, t in ((1, 1), (length, time))
    )
    for got, right in zip(states(scaled.path), states(reference.path), strict=True):
        np.testing.assert_allclose(got * time ** np.arange(3)[:, None] / length, right, **AGREE)


@pytest.mark.parametrize(("length", "time"), SCALES)
def test_a_fitted_turn_scales(length, time):
    angle = 0.4 * TIMES[:51]
    turn = np.stack([20 * np.cos(angle), 20 * np.sin(angle), 0.5 * TIMES[:51]], axis=1)
    turn += 0.01 * np.random.default_rng(2).standard_normal(turn.shape)
    reference, scaled = (
        qt.fit(qt.Track(TIMES[:51] * t, turn * x), position_sigma=0.01 * x) for x, t in ((1.0, 1.0), (length, time))
    )
    assert int(scaled.code) == int(reference.code)
    for share in (0.0, 0.3, 1.0):
        got = np.asarray(scaled.path(share * scaled.path.duration)) / length
        np.testing.assert_allclose(got, reference.path(share * reference.path.duration), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("length", "time"), SCALES)
def test_evaluated_tables_and_certificates_scale(length, time):
    def route(x, t):
        knots = np.linspace(0.0, 30.0, 8)
        r = np.stack([8 * knots, 30 * np.sin(knots / 9), 5 * np.cos(knots / 6)], axis=1)
        v = np.stack([8 + 0 * knots, 30 / 9 * np.cos(knots / 9), -5 / 6 * np.sin(knots / 6)], axis=1)
        a = np.stack([0 * knots, -30 / 81 * np.sin(knots / 9), -5 / 36 * np.cos(knots / 6)], axis=1)
        return qt.Route(knots * t, r * x, v * x / t, a * x / t**2)

    units = {
        "position": length,
        "speed": length / time,
        "curvature": 1 / length,
        "torsion": 1 / length,
        "quaternion": 1.0,
        "rate": 1 / time,
        "angular_acceleration": 1 / time**2,
    }
    instants = np.linspace(0.0, 30.0, 41)
    expected = qt.evaluate(route(1.0, 1.0), instants, tuple(units))
    table = qt.evaluate(route(length, time), np.minimum(instants * time, 30.0 * time), tuple(units))
    for name, unit in units.items():
        right = np.asarray(getattr(expected, name))
        got = np.asarray(getattr(table, name)) / unit
        np.testing.assert_allclose(got, right, rtol=1e-6, atol=1e-7 * np.abs(right).max(), err_msg=name)
    for factor in (0.99, 1.01):
        limits = [
            qt.Limits(curvature=0.0058 * factor / x, speed=8.7 * factor * x / t, lateral_acceleration=0.4 * x / t**2)
            for x, t in ((1.0, 1.0), (length, time))
        ]
        right, got = (
            qt.certify(route(x, t), limit) for (x, t), limit in zip(((1, 1), (length, time)), limits, strict=True)
        )
        np.testing.assert_array_equal(got.segments.codes, right.segments.codes)


@pytest.mark.parametrize(("length", "time"), SCALES)
def test_a_tuned_route_scales(length, time):
    def tuned(x, t):
        knots = np.linspace(0.0, 30.0, 16)
        r = drive(knots)
        r[8, 1] += 0.3
        track = qt.Track(knots * t, r * x)
        route = qt.fit_route(track, **stops(x, t), knots=2.0 * t, smoothing=1e-3 * t**5).path
        return qt.tune_route(route, qt.Limits(lateral_acceleration=0.45 * x / t**2), tube=0.5 * x)

    reference, scaled = tuned(1.0, 1.0), tuned(length, time)
    assert int(scaled.code) == int(reference.code) == int(qt.ResultCode.successful)
    for got, right in zip(states(scaled.path), states(reference.path), strict=True):
        np.testing.assert_allclose(got[0] / length, right[0], atol=1e-4)
