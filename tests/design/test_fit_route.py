"""Routes fitted to recordings: known motions, outliers, gaps, stops, choice of knots and smoothing, covariances."""

from itertools import pairwise
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.linalg import solve
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.design.fitting import route_system as system
from qtraj.design.fitting.route_covariance import covariances
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
    whole = system.sample_system(system.design(knots, t), values, weights).plus(system.jerk_system(knots), 0.01)
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
    found = covariances(whole.matrix)
    for i in range(7):
        part = slice(3 * i, 3 * i + 3)
        np.testing.assert_allclose(found[i], blocks[part, part], rtol=1e-8, atol=1e-10)


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
    assert "segments fit the recording" in fitted.result
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
    assert "Gaps in the recording: 1, bridged with minimum jerk; the longest lasts 7" in fitted.result
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
    fitted.save(tmp_path / "fitted.json")
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
        ({"position_sigma": -0.1}, "position_sigma must be positive and finite, but position_sigma is -0.1"),
        ({"position_sigma": np.r_[np.ones(199), 0]}, r"position_sigma\[199\] is 0"),
        ({"position_sigma": np.full((200, 3), np.nan)}, r"position_sigma\[0, 0\] is nan"),
        ({"position_sigma": np.ones(3)}, r"\(200,\).*\(200, 3\).*shape \(3,\)"),
        ({"velocity_sigma": 0.1}, "the track has no velocities"),
    ],
)
def test_invalid_arguments(arguments, words):
    with pytest.raises(ValueError, match=words):
        qt.fit_route(recorded(20.0), **arguments)


@pytest.mark.parametrize("seconds", [0.5, 10.0, 60.0])
@pytest.mark.parametrize("metres", [1e-3, 1.0, 1e6])
def test_few_samples_are_waypoints(seconds, metres):
    """The route passes through them; its length is between the polygon's and a smooth curve's."""
    points = metres * np.array([[0, 0, 0], [80, 20, 0], [150, 60, 1], [200, 120, 2], [210, 190, 2.0]])
    times = seconds * np.arange(5.0)
    fitted = qt.fit_route(qt.Track(times, points))
    assert bool(fitted.successful)
    np.testing.assert_allclose([fitted.path.position(t) for t in times], points, atol=1e-6 * metres)
    polygon = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert polygon < float(fitted.path.length()) < 1.01 * polygon


def test_few_samples_and_times_that_do_not_increase():
    few = recorded(0.6)
    with pytest.raises(ValueError, match=r"at least 8 samples.*omit knots"):
        qt.fit_route(few, tolerance=0.1)
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


def uneven(seed=8):
    """A drive with velocities, whose errors are small at every third sample, and larger in z than in x and y."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 60.0, 0.1)
    bad = (np.arange(600) % 3 > 0)[:, None]
    position_sigma, velocity_sigma = np.where(bad, [0.3, 0.3, 0.9], [0.01, 0.01, 0.03]), np.where(bad[:, 0], 1.0, 0.02)
    noise, speed_noise = rng.normal(size=(2, len(t), 3))
    track = qt.Track(
        t, position(t) + ORIGIN + position_sigma * noise, velocity(t) + velocity_sigma[:, None] * speed_noise
    )
    return track, position_sigma, velocity_sigma


def test_standard_deviations_of_the_samples_reduce_the_error():
    track, position_sigma, velocity_sigma = uneven()
    t = np.linspace(0.0, 59.9, 1201)

    def rms(*sigmas):
        fitted = qt.fit_route(track, None, None, None, *sigmas)
        assert len(fitted.outliers) == 0 or not sigmas
        return np.sqrt(np.mean(distances(fitted.path, t) ** 2))

    weighted = rms(position_sigma, velocity_sigma)
    assert weighted < 0.1 * rms()
    assert weighted < 0.1 * rms(0.2, 0.5)
    assert weighted < 0.3 * rms(None, velocity_sigma)
    assert weighted < rms(position_sigma[:, 0], velocity_sigma) < 1.5 * weighted


def test_outliers_are_judged_in_standard_deviations():
    track, position_sigma, _ = uneven()
    positions = np.array(track.positions)
    positions[51] += [0.0, 0.5, 0.0]  # 50 standard deviations, but less than the errors of good samples
    found = [
        np.asarray(qt.fit_route(qt.Track(track.times, positions), 1.0, None, 1e-3, sigma).outliers).tolist()
        for sigma in (position_sigma, None)
    ]
    assert found == [[51], []]


def test_the_weighted_fit_and_its_covariance_are_those_of_dense_matrices():
    track, position_sigma, velocity_sigma = uneven()
    smoothing, knots = 1e-3, np.linspace(0.0, 59.9, 31)
    fitted = qt.fit_route(track, knots, None, smoothing, position_sigma, velocity_sigma)
    t = np.asarray(track.times)
    at = [system.design(knots, t, order).matrix.toarray() for order in (0, 1)]
    jerk = dense(system.jerk_system(knots).matrix)
    unit = np.sqrt(1 / np.mean(1 / position_sigma**2))
    assert float(fitted.position_sigma) == pytest.approx(unit, rel=1e-12)
    values = np.asarray(track.positions) - ORIGIN, np.asarray(track.velocities)
    for k in range(3):
        rows = [m / s[:, None] for m, s in zip(at, (position_sigma[:, k], velocity_sigma), strict=True)]
        right = [x[:, k] / s for x, s in zip(values, (position_sigma[:, k], velocity_sigma), strict=True)]
        matrix = sum(m.T @ m for m in rows) + smoothing / unit**2 * jerk
        states = np.linalg.solve(matrix, sum(m.T @ x for m, x in zip(rows, right, strict=True)))
        joints = np.asarray(fitted.path.joints(2))[:, :, k] - [ORIGIN[k], 0, 0]
        np.testing.assert_allclose(joints, states.reshape(31, 3), rtol=0, atol=1e-6)
        inverse = np.linalg.inv(matrix)
        blocks = [inverse[i : i + 3, i : i + 3] for i in range(0, 93, 3)]
        np.testing.assert_allclose(fitted.covariance()[k], blocks, rtol=1e-6, atol=1e-12)


def test_equal_standard_deviations_are_one_number(tmp_path):
    track = recorded(20.0, velocities=True)
    one = qt.fit_route(track, 1.0, None, 1e-3, 0.02, 0.05)
    for shape in ((200,), (200, 3)):
        many = qt.fit_route(track, 1.0, None, 1e-3, np.full(shape, 0.02), np.full(shape, 0.05))
        np.testing.assert_allclose(many.path.joints(2), one.path.joints(2), rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(np.broadcast_to(one.covariance(), many.covariance().shape), many.covariance())
        assert float(many.prediction_error) == pytest.approx(float(one.prediction_error))
        document.save(many, tmp_path / "fitted.json")
        np.testing.assert_array_equal(qt.load(tmp_path / "fitted.json").covariance(), many.covariance())


def test_recorded_rates_are_compared_after_the_mounting_is_estimated(tmp_path):
    track = recorded(40.0, velocities=True)
    program = qt.FrameProgram(qt.fit_route(track).path)
    rates = np.array(jax.vmap(program)(track.elapsed).rate)
    mounting = Rotation.from_euler("ZYX", [0.4, -0.2, 3.0])
    bias = np.array([0.0, 0.0, 0.01])
    parts = track.times, track.positions, track.velocities, None
    fitted = qt.fit_route(qt.Track(*parts, mounting.inv().apply(rates)))
    np.testing.assert_allclose(Rotation.from_quat(np.roll(fitted.rates.mounting, -1)).as_matrix(), mounting.as_matrix())
    np.testing.assert_allclose(fitted.rates.rms, 0.0, atol=1e-9)
    np.testing.assert_allclose(fitted.rates.correlation, 1.0)
    speeds = np.linalg.norm(np.asarray(jax.vmap(program.path.velocity)(track.elapsed)), axis=1)
    assert int(fitted.rates.samples) == np.sum(speeds > 3.0)
    compiled = qt.compare_rates(qt.FrameProgram(fitted.path), qt.Track(*parts, mounting.inv().apply(rates)))
    for name in ("rms", "correlation", "mounting"):
        np.testing.assert_allclose(getattr(fitted.rates, name), getattr(compiled, name), rtol=1e-9, atol=1e-12)
    assert "rate_mounting" in fitted.to_xarray()
    fitted.save(tmp_path / "fitted.json")
    assert qt.load(tmp_path / "fitted.json").rates.correlation.shape == (3,)

    vertical = qt.compare_rates(program, qt.Track(*parts, (rates + bias)[:, 2:]))
    assert vertical.mounting is None
    np.testing.assert_allclose(vertical.rms, [0.01])
    np.testing.assert_allclose(vertical.correlation, [1.0])
    assert vertical.note == fitted.rates.note == ""
    right = qt.compare_rates(program, qt.Track(*parts, -rates[:, 2:]))
    np.testing.assert_allclose(right.correlation, [-1.0])
    assert "about yaw is -1.000: the recorded yaw rate is probably positive to the right" in right.note
    assert right.note in repr(right)
    mirrored = qt.compare_rates(program, qt.Track(*parts, rates * [1.0, 1.0, -1.0]))
    assert min(mirrored.correlation) > -0.5 or "left-handed" in mirrored.note
    noise = np.random.default_rng(3).normal(size=(len(rates), 1))
    noisy = qt.compare_rates(program, qt.Track(*parts, noise - 0.2 * rates[:, 2:]))
    assert (noisy.correlation < 0).all()
    assert "probably mostly noise" in noisy.note
    with pytest.raises(ValueError, match=r"exceeds min_speed = 100 m/s at fewer than 3 samples"):
        qt.compare_rates(program, qt.Track(*parts, rates), 100)
    with pytest.raises(ValueError, match="no angular rates"):
        qt.compare_rates(program, track)


def test_rates_about_one_axis_determine_the_smallest_mounting():
    t = np.linspace(0.0, 20.0, 201)
    flat = qt.Track(
        t,
        np.stack([50 * np.sin(0.2 * t), 50 * np.cos(0.2 * t), 0 * t], axis=1),
        rates=0.2 * np.tile([0.0, np.sin(0.3), -np.cos(0.3)], (201, 1)),
    )
    fitted = qt.fit_route(flat, 2.0, None, 1e-6)
    assert np.degrees(0.3) == pytest.approx(np.degrees(2 * np.arccos(float(fitted.rates.mounting[0]))), abs=0.1)
    np.testing.assert_allclose(fitted.rates.rms, 0.0, atol=1e-3)
