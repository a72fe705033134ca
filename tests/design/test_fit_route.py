"""Routes fitted to recordings: known motions, outliers, gaps, stops, choice of knots and smoothing, covariances."""

from itertools import pairwise
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.linalg import solve

import qtraj as qt
from qtraj.design.fitting import route_system as system
from qtraj.foundation import document

BENDS = Path(__file__).parents[1] / "data" / "boreas_bends.csv"
ORIGIN = np.array([623425.5, 4848821.0, 153.0])


def position(t):
    """A drive in bends at a changing speed."""
    s = 8 * t - 6 * np.sin(0.15 * t)
    return np.stack([s, 6 * np.sin(0.06 * s), 0.5 * np.cos(0.02 * s)], axis=1)


def velocity(t, h=1e-5):
    return (position(t + h) - position(t - h)) / (2 * h)


def recorded(duration=120.0, rate=10.0, sigma=0.01, seed=0, velocities=False, clock=1628166000.0):
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1 / rate)
    noisy = position(t) + ORIGIN + rng.normal(0, sigma, (len(t), 3))
    return qt.Track(t + clock, noisy, velocity(t) + rng.normal(0, 0.02, (len(t), 3)) if velocities else None)


def distances(route, t):
    """Distances from the exact motion."""
    actual = np.asarray(qt.evaluate(route, t, ("position",)).position)
    return np.linalg.norm(actual - position(t) - ORIGIN, axis=1)


def test_basis_and_jerk_are_those_of_scipy():
    knots = np.array([0.0, 0.7, 2.0])
    states = np.random.default_rng(0).normal(size=(3, 3, 1))
    expected = BPoly.from_derivatives(knots, states)
    t = np.linspace(0, 2, 41)
    for order in (0, 1):
        result = system.predict(system.design(knots, t, order), states)
        np.testing.assert_allclose(result, expected(t, nu=order), rtol=0, atol=1e-12)
    matrix = dense(system.jerk_system(knots).matrix)
    x = states.reshape(-1)
    third = expected.derivative(3)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    total = sum((b - a) / 2 * weights @ third((a + b) / 2 + (b - a) / 2 * nodes)[:, 0] ** 2 for a, b in pairwise(knots))
    assert x @ matrix @ x == pytest.approx(total, rel=1e-11)


def dense(banded):
    n = banded.shape[1]
    result = np.zeros((n, n))
    for d in range(6):
        diagonal = banded[5 - d, d:]
        result += np.diag(diagonal, d) + (np.diag(diagonal, -d) if d else 0)
    return result


def test_the_banded_solve_and_covariances_are_those_of_dense_matrices():
    rng = np.random.default_rng(1)
    knots, t = np.linspace(0, 6, 7), np.sort(rng.uniform(0, 6, 90))
    values = rng.normal(size=(90, 3))
    weights = rng.uniform(0.5, 2, 90)
    whole = system.sample_system(7, system.design(knots, t), values, weights).plus(system.jerk_system(knots), 0.01)
    matrix = dense(whole.matrix)
    at = system.design(knots, t)
    design = np.zeros((90, 21))
    for k in range(6):
        design[np.arange(90), 3 * at.segment + k] = at.factors[:, k]
    expected = design.T @ (weights[:, None] * design) + 0.01 * dense(system.jerk_system(knots).matrix)
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-10)
    states = solve(matrix, design.T @ (weights[:, None] * values))
    np.testing.assert_allclose(system.solve(whole).reshape(21, 3), states, rtol=0, atol=1e-9)
    blocks = np.linalg.inv(matrix)
    covariances = system.covariances(whole.matrix)
    for i in range(7):
        part = slice(3 * i, 3 * i + 3)
        np.testing.assert_allclose(covariances[i], blocks[part, part], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("velocities", [False, True])
def test_the_errors_of_a_known_motion_are_below_the_noise(velocities):
    track = recorded(velocities=velocities)
    fitted = qt.fit_route(track)
    t = np.linspace(0, 119.9, 3001)
    errors = distances(fitted.path, t)
    assert np.sqrt(np.mean(errors**2)) < 0.01  # the noise has 0.017 m
    assert float(fitted.prediction_error) == pytest.approx(0.0173 * 1.1, rel=0.15)
    assert float(fitted.position_sigma) == pytest.approx(0.01, rel=0.15)
    assert len(fitted.outliers) == len(fitted.stops) == len(fitted.gaps) == 0
    assert fitted.successful
    assert "segments follow the recording" in fitted.result
    assert float(fitted.path.duration) == pytest.approx(119.9)
    rate_errors = np.asarray(qt.evaluate(fitted.path, t, ("velocity",)).velocity) - velocity(t)
    assert np.sqrt(np.mean(np.sum(rate_errors**2, axis=1))) < 0.06


def test_the_errors_agree_with_the_covariance():
    ratios = []
    for seed in range(6):
        fitted = qt.fit_route(recorded(40.0, seed=seed), knots=1.0, smoothing=1e-4)
        t = np.asarray(fitted.knots)
        rate_errors = np.asarray(fitted.path.joints(1))[:, :, :] - np.stack([position(t) + ORIGIN, velocity(t)], axis=1)
        sizes = np.sqrt(np.einsum("nkk->nk", fitted.covariance()))[:, :2, None]
        ratios.append((rate_errors / sizes)[2:-2])
    spread = np.sqrt(np.mean(np.square(ratios), axis=(0, 1, 3)))
    np.testing.assert_allclose(spread, 1.0, atol=0.15)


def test_a_swerve_is_no_outlier():
    """A smooth motion faster than the first knots is followed, not left out."""
    t = np.linspace(0.0, 20.0, 401)
    swerve = 0.6 * np.exp(-(((t - 11.0) / 0.5) ** 2))
    fitted = qt.fit_route(qt.Track(t, np.stack([10.0 * t, swerve, 0 * t], axis=1)))
    assert len(fitted.outliers) == 0
    assert float(fitted.residual.maximum) < 0.02


def test_outliers_are_found_and_have_no_effect():
    track = recorded(velocities=True)
    positions = np.array(track.positions)
    wrong = np.array([100, 101, 102, 400, 777, 778, 1100])
    positions[wrong] += np.random.default_rng(2).normal(0, 5, (7, 3))
    clean = qt.fit_route(track)
    fitted = qt.fit_route(qt.Track(track.times, positions, track.velocities))
    assert np.asarray(fitted.outliers).tolist() == wrong.tolist()
    assert "Outliers excluded from the fit: 7." in fitted.result
    t = np.linspace(0, 119.9, 3001)
    assert np.max(distances(fitted.path, t)) < 1.5 * np.max(distances(clean.path, t)) + 0.01
    assert float(fitted.residual.maximum) < 0.1


def test_uneven_samples_and_gaps():
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0, 100, 1000))
    t = t[(t < 40) | (t > 47)]
    track = qt.Track(t, position(t) + ORIGIN + rng.normal(0, 0.01, (len(t), 3)))
    fitted = qt.fit_route(track)
    [gap] = np.asarray(fitted.gaps)
    assert gap[1] - gap[0] > 6.9
    assert "Gaps in the recording: 1, bridged by minimum jerk; the longest lasts 7" in fitted.result
    outside = np.linspace(0, float(fitted.path.duration), 2001)
    outside = outside[(outside + t[0] < 40) | (outside + t[0] > 47)]
    actual = np.asarray(qt.evaluate(fitted.path, outside, ("position",)).position)
    errors = actual - position(outside + t[0]) - ORIGIN
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 0.012


def stopped(t):
    """A drive that stops from 20 to 30 s."""
    go = np.clip(t, 0, 20) + np.clip(t - 30, 0, None)
    u = np.clip(go / 20, 0, 1)
    s = 150 * u**3 * (10 - 15 * u + 6 * u**2)
    later = np.clip((go - 20) / 20, 0, 1)
    s = s + 150 * later**3 * (10 - 15 * later + 6 * later**2)
    return np.stack([s, 0.001 * s**2, 0 * s], axis=1)


@pytest.mark.parametrize("velocities", [False, True])
def test_stops_are_found_and_exact(velocities):
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 50.0, 0.1)
    h = 1e-5
    speeds = (stopped(t + h) - stopped(t - h)) / (2 * h) + rng.normal(0, 0.001, (len(t), 3))
    track = qt.Track(t, stopped(t) + rng.normal(0, 0.002, (len(t), 3)), speeds if velocities else None)
    fitted = qt.fit_route(track)
    inner = [stop for stop in np.asarray(fitted.stops).tolist() if stop[0] > 5 and stop[1] < 45]
    assert len(inner) == 1
    start, end = inner[0]
    assert 17.5 < start < 21
    assert 29 < end < 32.5
    at = np.asarray(jax.vmap(lambda x: fitted.path.derivatives(x, 3))(np.linspace(start, end - 1e-9, 50)))
    assert np.max(np.abs(at[:, 1:])) == 0.0
    assert isinstance(qt.FrameProgram(fitted.path).frame, qt.Driving)
    assert float(fitted.residual.distance_rms) < 0.01


@pytest.mark.parametrize("velocities", [False, True])
def test_a_parked_vehicle(velocities):
    t = np.arange(0.0, 20.0, 0.1)
    noise = np.random.default_rng(5).normal(0, 0.002, (len(t), 3))
    fitted = qt.fit_route(qt.Track(t, ORIGIN + noise, np.zeros((len(t), 3)) if velocities else None))
    np.testing.assert_array_equal(fitted.stops, [[0.0, t[-1]]])
    np.testing.assert_allclose(fitted.path.position(7.0), ORIGIN, rtol=0, atol=0.001)
    np.testing.assert_array_equal(fitted.path.velocity(7.0), 0.0)


def test_user_knots_smoothing_and_tolerance():
    track = recorded(60.0)
    given = qt.fit_route(track, knots=[0.0, 10.0, 30.0, 40.0, 59.9], smoothing=1e-3)
    np.testing.assert_allclose(given.knots, [0.0, 10.0, 30.0, 40.0, 59.9])
    assert float(given.smoothing) == 1e-3
    even = qt.fit_route(track, knots=2.0, tolerance=0.03)
    assert np.diff(even.knots).max() == pytest.approx(2.0, rel=0.02)
    offsets = distances(even.path, np.asarray(track.elapsed))
    assert offsets.max() > 0.01
    assert float(even.residual.distance_rms) == pytest.approx(0.03, rel=1e-3)
    smooth = qt.fit_route(track, knots=2.0, tolerance=0.06)
    assert float(smooth.smoothing) > float(even.smoothing)


def test_a_recorded_turn():
    fitted = qt.fit_route(qt.read_track(BENDS))
    assert float(fitted.residual.distance_rms) < 0.02
    assert float(fitted.prediction_error) < 0.02


def test_the_result_is_stored(tmp_path):
    fitted = qt.fit_route(recorded(30.0))
    document.save(fitted, tmp_path / "fitted.json")
    again = qt.load(tmp_path / "fitted.json")
    np.testing.assert_array_equal(again.covariance(), fitted.covariance())
    assert again.result == fitted.result
    assert again.path.segments == fitted.path.segments


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"knots": -1.0}, "knots must be positive"),
        ({"knots": [0.0, 5.0]}, "times that increase from 0 to the duration"),
        ({"tolerance": 0.0}, "tolerance must be positive"),
        ({"smoothing": np.nan}, "smoothing must be positive"),
        ({"smoothing": 1.0, "tolerance": 1.0}, "tolerance determines the smoothing"),
        ({"tolerance": 1e-9, "knots": 5.0}, "pass a larger tolerance or more knots"),
    ],
)
def test_invalid_arguments(arguments, words):
    with pytest.raises(ValueError, match=words):
        qt.fit_route(recorded(20.0), **arguments)


def test_few_samples_and_times_that_do_not_increase():
    few = recorded(0.6)
    with pytest.raises(ValueError, match="at least 8 samples"):
        qt.fit_route(few)
    with pytest.raises(ValueError, match="must increase strictly"):
        qt.Track([0.0, 1.0, 1.0, 2.0], np.zeros((4, 3)))


def test_recorded_attitudes_are_compared_after_the_mounting_is_estimated():
    track = recorded(40.0, velocities=True)
    program = qt.FrameProgram(qt.fit_route(track).path)
    frames = jax.vmap(program)(track.elapsed).quaternion
    mounting = np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])
    attitudes = jax.vmap(lambda q: 3.0 * qt.quaternion.product(q, mounting))(frames)
    fitted = qt.fit_route(qt.Track(track.times, track.positions, track.velocities, attitudes))
    assert float(fitted.attitude.rms) < 1e-6
    assert "attitude_rms" in fitted.to_xarray()
