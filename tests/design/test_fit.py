"""The fit of a spiral-helix: a real turn, known turns that are recovered, and windows that raise."""

import importlib.resources
import re
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.algebra.rotation import to_dcm
from qtraj.design.fitting.fit import fit
from qtraj.foundation import document
from qtraj.foundation.outcome import ResultCode
from qtraj.io.track.track_file import read_track
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track
from qtraj.path.trihedral import Natural, trihedral

DATA = Path(__file__).parents[1] / "data"

SAMPLES = 58
"""The number of samples in the real window, so that all fits share their compilations."""

TOLERANCE = 1e-5
"""[m] Largest distance from a known, noise-free path with a size of 20 m at coordinates of 5e6 m."""

FLOAT32_TOLERANCE = 2e-4
"""[m] float32 resolves 150 m to 1.5e-5 m; polynomials and squares lose some digits."""

NOISE = 0.02
"""[m] Standard deviation of synthetic noise per coordinate."""

EAST, NORTH = 623_350.0, 4_848_810.0


@pytest.fixture(scope="module")
def turn():
    with importlib.resources.as_file(importlib.resources.files("qtraj.io") / "data" / "boreas_right_angle.csv") as file:
        return read_track(file).window(1093.5, 1099.5)


@pytest.fixture(scope="module")
def fitted(turn):
    return {motion: fit(turn, motion) for motion in ("uniform", "hermite")}


def known_path(motion, sense=1.0, origin=(EAST, NORTH, 0.0)):
    """A turn of about 100°, outwards and upwards, in 4 s."""
    angle = [0.4, 0.45 * sense] if motion == "uniform" else [0.4, 0.5 * sense, -0.06 * sense, 0.012 * sense]
    return SpiralHelix([18.0, 0.9, -0.3, 0.05], angle, [152.0, 0.2, 0.1, -0.02], 4.0, placement=Placement(origin))


def recorded(path, clock=1000.0, velocities=True):
    times = np.linspace(0.0, 4.0, SAMPLES)
    states = np.asarray(_states(path, jnp.asarray(times)))
    return Track(clock + times, states[:, 0], states[:, 1] if velocities else None)


@eqx.filter_jit
def _states(path, times):
    return jax.vmap(lambda t: path.derivatives(t, 2))(times)


def distance(path, other):
    """The largest distance between two paths of the same duration [m]."""
    times = jnp.linspace(0.0, 4.0, SAMPLES)
    gap = np.asarray(_states(path, times) - _states(other, times))[:, 0]
    return np.max(np.linalg.norm(gap, axis=1))


def test_a_real_turn_uniform(fitted):
    path, residual = fitted["uniform"].path, fitted["uniform"].residual
    assert fitted["uniform"].code == ResultCode.successful
    assert fitted["uniform"].result.startswith("converged in")
    assert int(residual.samples) == SAMPLES
    assert float(residual.horizontal_rms) <= 0.20
    np.testing.assert_allclose(residual.vertical_rms, 0.034, atol=0.001)
    np.testing.assert_allclose(np.degrees(residual.turn), 87.7, atol=0.1)
    assert float(residual.direction_rms) < np.radians(6)
    states = np.asarray(_states(path, jnp.linspace(0.0, float(path.duration), 200)))
    speed = np.linalg.norm(states[:, 1], axis=1)
    curvature = np.linalg.norm(np.cross(states[:, 1], states[:, 2]), axis=1) / speed**3
    np.testing.assert_allclose(curvature.max(), 0.050, atol=0.001)
    np.testing.assert_allclose((curvature * speed**2).max(), 2.9, atol=0.05)


def test_a_real_turn_hermite(fitted):
    residual = fitted["hermite"].residual
    assert fitted["hermite"].code == ResultCode.successful
    assert float(residual.horizontal_rms) <= 0.05
    np.testing.assert_allclose(residual.vertical_rms, 0.034, atol=0.001)


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_the_axis_of_a_real_turn_is_inside_the_bend(fitted, turn, motion):
    path, residual = fitted[motion].path, fitted[motion].residual
    assert float(residual.radius_min) > 5.0
    assert float(residual.radius_max) < 25.0
    assert float(path.turn) > 0.0
    np.testing.assert_allclose(path.duration, turn.duration)


def test_a_polynomial_angle_is_the_default(turn, fitted):
    assert eqx.tree_equal(fit(turn), fitted["hermite"])


def test_a_polynomial_angle_fits_real_bends_better():
    """Two bends of a drive in windows of every length: the median error is less than half that at a constant rate."""
    drive = read_track(DATA / "boreas_bends.csv")
    windows = [drive.window(t0, t0 + length) for length in (5.0, 6.0, 7.0) for t0 in (70.0, 71.0, 79.5, 80.5)]
    errors = {m: [float(fit(w, m).residual.horizontal_rms) for w in windows] for m in ("uniform", "hermite")}
    assert np.median(errors["hermite"]) < 0.5 * np.median(errors["uniform"])


def test_the_fit_is_a_minimum(fitted, turn):
    """No small change of axis, ρ or φ reduces the cost."""
    path = fitted["uniform"].path

    def cost(p):
        states = np.asarray(_states(p, turn.elapsed))
        error = np.sum((states[:, 0] - np.asarray(turn.positions)) ** 2) / 0.005**2
        return error + np.sum((states[:, 1] - np.asarray(turn.velocities)) ** 2) / 0.08**2

    best = cost(path)
    for where, steps in (
        (lambda p: p.radius, [1e-2, 2e-3, 5e-4, 1e-4]),
        (lambda p: p.angle, [1e-3, 2e-4]),
        (lambda p: p.height, [1e-2, 2e-3, 5e-4, 1e-4]),
        (lambda p: p.placement.origin, [1e-2, 1e-2]),
    ):
        for k, step in enumerate(steps):
            for sign in (1.0, -1.0):
                change = sign * step * (np.arange(len(where(path))) == k)
                assert cost(eqx.tree_at(where, path, where(path) + change)) > best


def test_the_uniform_fit_follows_from_its_boundary_states(fitted):
    path = fitted["uniform"].path
    start, end = path.state(0.0), path.state(path.duration)
    rebuilt = SpiralHelix.from_boundary(start, end, placement=path.placement)
    np.testing.assert_allclose(rebuilt.duration, path.duration, rtol=1e-9)
    for name in ("radius", "angle", "height"):
        np.testing.assert_allclose(getattr(rebuilt, name), getattr(path, name), rtol=1e-6, atol=1e-7)


def test_the_hermite_fit_follows_from_its_boundary_states(fitted):
    path = fitted["hermite"].path
    start, end = path.state(0.0), path.state(path.duration)
    rebuilt = SpiralHelix.hermite(start, end, path.duration, placement=path.placement)
    for name in ("radius", "angle", "height"):
        np.testing.assert_allclose(getattr(rebuilt, name), getattr(path, name), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
@pytest.mark.parametrize("sense", [1.0, -1.0], ids=["left", "right"])
@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (EAST, NORTH, 0.0)], ids=["near", "far"])
def test_a_known_path_is_recovered(motion, sense, origin):
    path = known_path(motion, sense, origin)
    solution = fit(recorded(path), motion)
    result = solution.path
    assert solution.successful
    assert distance(result, path) < TOLERANCE
    np.testing.assert_allclose(result.placement.origin, path.placement.origin, atol=100 * TOLERANCE)
    np.testing.assert_allclose(result.radius[0], 18.0, atol=100 * TOLERANCE)
    np.testing.assert_allclose(result.turn, path.turn, rtol=1e-4)


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_a_known_path_is_recovered_from_positions_alone(motion):
    path = known_path(motion)
    result = fit(recorded(path, velocities=False), motion)
    assert distance(result.path, path) < TOLERANCE
    assert result.residual.velocity_rms is None
    assert result.residual.direction_rms is None


@pytest.mark.parametrize("whole_turns", [1.2, -3.4])
def test_more_than_a_whole_turn(whole_turns):
    rate = 2 * np.pi * whole_turns / 4.0
    path = SpiralHelix([9.0, 0.3], [-1.0, rate], [0.0, 2.0], 4.0, placement=Placement([40.0, -70.0, 0.0]))
    result = fit(recorded(path, velocities=False), "uniform").path
    assert distance(result, path) < TOLERANCE
    np.testing.assert_allclose(result.turn, path.turn, rtol=1e-8)


def noisy_errors(motion, noise, seeds):
    path = known_path(motion)
    clean = recorded(path, velocities=False)
    errors = []
    for seed in seeds:
        shift = noise * np.random.default_rng(seed).normal(size=(SAMPLES, 3))
        result = fit(Track(clean.times, clean.positions + shift), motion)
        times = clean.elapsed
        gap = np.asarray(_states(result.path, times) - _states(path, times))[:, 0]
        errors.append((np.mean(np.sum(gap[:, :2] ** 2, axis=1)), float(result.residual.horizontal_rms) ** 2))
    return np.mean(errors, axis=0)


@pytest.mark.parametrize(("motion", "unknowns"), [("uniform", 8), ("hermite", 10)])
def test_the_error_and_the_residual_have_the_expected_variance(motion, unknowns):
    """With 2n noisy coordinates and p unknowns, the squared path error is p σ², and the squared residual (2n − p) σ².

    Each mean over 12 windows is within four standard errors, which are sqrt(2/(12 p)) and sqrt(2/(12 (2n − p))).
    """
    error, remaining = noisy_errors(motion, NOISE, range(12))
    np.testing.assert_allclose(error, unknowns * NOISE**2 / SAMPLES, rtol=4 * np.sqrt(2 / (12 * unknowns)))
    expected = (2 * SAMPLES - unknowns) * NOISE**2 / SAMPLES
    np.testing.assert_allclose(remaining, expected, rtol=4 * np.sqrt(2 / (12 * (2 * SAMPLES - unknowns))))


def test_the_velocity_sigma_weights_the_velocities(turn, fitted):
    """A smaller velocity sigma reduces the misfit of velocities and increases that of positions."""
    refitted = fit(turn, "uniform", velocity_sigma=0.005).residual
    assert float(refitted.velocity_rms) < float(fitted["uniform"].residual.velocity_rms) - 0.01
    assert float(refitted.horizontal_rms) > float(fitted["uniform"].residual.horizontal_rms) + 0.01


def straight(bend=0.0, wobble=0.0):
    times = np.linspace(0.0, 4.0, SAMPLES)
    x = 10.0 * times
    y = 0.5 * bend / 40.0 * x**2 + wobble * np.sin(3.0 * times)
    return Track(times, np.stack([EAST + x, NORTH + y, 0 * x], axis=1))


def test_the_program_of_a_recording_is_upright(fitted):
    """Without a frame given: x along the velocity, y level."""
    fitted, t = fitted["hermite"], 2.0
    path = fitted.path
    forward, left, up = np.asarray(to_dcm(fitted.program()(t).quaternion))
    velocity = np.asarray(path.velocity(t))
    assert forward == pytest.approx(velocity / np.linalg.norm(velocity), abs=1e-12)
    assert left[2] == pytest.approx(0.0, abs=1e-12)
    assert up[2] > 0.9
    natural = np.asarray(to_dcm(fitted.program(Natural())(t).quaternion))
    assert natural[1] == pytest.approx(np.asarray(trihedral(path, t).normal), abs=1e-12)


@pytest.mark.parametrize(("bend", "words"), [(0.0, r"0\.00°"), (np.radians(6.0), r"6\.0\d°"), (-0.1, r"-5\.\d\d°")])
def test_a_nearly_straight_window_raises(bend, words):
    with pytest.raises(ValueError, match=rf"nearly straight: over 40.* turns by {words}.*at least 10°.*window"):
        fit(straight(bend))


def test_a_vehicle_that_stands_still_raises():
    with pytest.raises(ValueError, match=r"stands still in this window: all .* within 0\.1 m.*in which it moves"):
        fit(Track(np.arange(10.0), np.ones((10, 3)), np.zeros((10, 3))))


def test_a_parked_car_raises():
    """The direction of its noisy velocities turns by thousands of degrees."""
    with pytest.raises(ValueError, match=r"stands still.* no direction of travel.*track\.window"):
        fit(read_track(DATA / "boreas_standing.csv"))


def test_a_parked_car_whose_position_drifts_raises():
    """A random walk of the position, and velocities that are noise alone."""
    rng = np.random.default_rng(18)
    positions = np.cumsum(rng.normal(0.0, 0.01, (300, 3)), axis=0)
    positions *= 0.8 / np.hypot(*(positions - positions.mean(axis=0))[:, :2].T).max()
    track = Track(np.arange(300) / 10, positions, rng.normal(0.0, 0.03, (300, 3)))
    with pytest.raises(ValueError, match=r"stands still.*does not exceed velocity_sigma = 0\.08.*positions drift"):
        fit(track)


def test_a_vertical_climb_raises():
    times = np.linspace(0.0, 8.0, 50)
    track = Track(times, np.stack([0 * times, 0 * times, 3 * times], axis=1))
    with pytest.raises(ValueError, match=r"moves vertically in this window: the height changes by 24 m"):
        fit(track)


def test_a_window_that_is_too_short_raises():
    path = SpiralHelix([0.5], [0.0, 0.3], [0.0], 4.0)
    with pytest.raises(ValueError, match=r"too short: the vehicle travels 0\.6 m .* at least 1 m, 200 times .*Widen"):
        fit(recorded(path))
    assert fit(recorded(path), position_sigma=1e-4, velocity_sigma=1e-3).successful


@pytest.mark.parametrize("velocities", [True, False], ids=["velocities", "positions"])
def test_bends_that_cancel_raise(velocities):
    """An S-bend of 50° to the left and back is not straight, although its net turn is zero."""
    times = np.linspace(0.0, 8.0, 200)
    heading = np.radians(50.0) * np.sin(np.pi * times / 8.0) ** 2
    speed = 8.0 * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    positions = np.cumsum(speed, axis=0) * (times[1] - times[0])
    track = Track(20.0 + times, positions + np.array([EAST, NORTH, 0.0]), speed if velocities else None)
    words = r"contains 2 bends in opposite directions: over 6\d.* only one bend.*the largest bend, from about 2\d"
    with pytest.raises(ValueError, match=words):
        fit(track)


def test_two_real_bends_raise_and_the_larger_is_reported():
    drive = read_track(DATA / "boreas_bends.csv")
    with pytest.raises(
        ValueError, match=r"contains 2 bends.*the largest bend, from about .* s, turns by -10"
    ) as caught:
        fit(drive)
    start, end = map(float, re.findall(r"about (\S+) to (\S+) s", str(caught.value))[0])
    assert fit(drive.window(start, end)).residual.horizontal_rms < 1.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"motion": "quintic"}, r"motion='quintic' is unknown: choose one of 'uniform', 'hermite'"),
        ({"position_sigma": 0}, r"position_sigma must be positive, but 0"),
        ({"velocity_sigma": float("nan")}, r"velocity_sigma must be positive, but nan"),
        ({"radius_bounds": (20.0, 10.0)}, r"radius_bounds must be .* 0 < low < high"),
        ({"max_steps": 0}, r"max_steps must be positive"),
    ],
)
def test_invalid_arguments_raise(turn, arguments, words):
    with pytest.raises(ValueError, match=words):
        fit(turn, **arguments)


def test_too_few_samples_raise(turn):
    with pytest.raises(ValueError, match="at least 8 samples, but the window has 5"):
        fit(turn.window(1094.0, 1094.5))


def test_a_search_that_does_not_converge_is_reported(turn):
    result = fit(turn, max_steps=2)
    assert result.code == ResultCode.not_converged
    assert not result.successful
    assert "not converged after 2 steps" in result.result
    assert "max_steps" in result.result
    assert np.isfinite(float(result.residual.horizontal_rms))
    with pytest.raises(RuntimeError, match=r"not converged after 2 steps.*max_steps"):
        fit(turn, max_steps=2, throw=True)


def test_a_poor_fit_is_told_whether_the_search_converged_or_not(turn):
    result = fit(turn, radius_bounds=(3.0, 4.0), max_steps=2)
    assert result.code == ResultCode.poor_fit
    assert "of the radius of the turn" in result.result


def test_a_radius_at_a_bound_is_reported(turn):
    result = fit(turn, "uniform", radius_bounds=(18.0, 22.0), throw=True)
    assert result.code == ResultCode.held_by_bounds
    assert result.successful
    assert "at one of its bounds, 18 to 22 m" in result.result
    minimum, maximum = radius_range(result.path)
    assert (minimum, maximum) == (pytest.approx(18.0, abs=1e-4), pytest.approx(20.378, abs=1e-3))


def radius_range(path):
    """The minimum and maximum radius of a path [m], by dense sampling."""
    times = np.linspace(0.0, float(path.duration), 20001)
    radius = np.polynomial.Polynomial(np.asarray(path.radius))(times)
    return radius.min(), radius.max()


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
@pytest.mark.parametrize("bounds", [None, (8.0, 30.0), (15.0, 25.0), (60.0, 70.0)], ids=str)
@pytest.mark.parametrize("window", [(69.0, 77.9), (78.4, 87.6)], ids=["right", "left"])
def test_the_bounds_are_satisfied_on_the_whole_path(motion, bounds, window):
    """Real bends whose unbounded optimum violates the bounds: the radius stays inside, and the result says so."""
    result = fit(read_track(DATA / "boreas_bends.csv").window(*window), motion, radius_bounds=bounds)
    low, high = map(float, result.radius_bounds)
    assert bounds is None or (low, high) == bounds
    minimum, maximum = radius_range(result.path)
    assert low <= minimum < maximum <= high
    at_bound = minimum < 1.001 * low or maximum > 0.999 * high
    assert at_bound == ("at one of its bounds, " in result.result) or result.code == ResultCode.not_converged


def test_a_bounded_fit_is_a_minimum_inside_its_bounds(turn):
    """No small random change of axis, ρ or φ that keeps the radius in its bounds reduces the cost."""
    result = fit(turn, "uniform", radius_bounds=(18.0, 22.0))
    rng = np.random.default_rng(5)
    at = np.concatenate([np.asarray(result.path.placement.origin)[:2], result.path.radius, result.path.angle])
    scale = np.array([0.1, 0.1, 0.1, 0.05, 0.01, 0.002, 0.005, 0.001])

    def path_from(numbers):
        origin = [*numbers[:2], 0.0]
        return SpiralHelix(numbers[2:6], numbers[6:], result.path.height, result.path.duration, Placement(origin))

    def cost(path):
        states = np.asarray(_states(path, turn.elapsed))
        error = np.sum((states[:, 0] - np.asarray(turn.positions)) ** 2) / 0.005**2
        return error + np.sum((states[:, 1] - np.asarray(turn.velocities)) ** 2) / 0.08**2

    best, n_inside = cost(result.path), 0
    for _ in range(300):
        other = path_from(at + 10 ** rng.uniform(-3, 0) * scale * rng.normal(size=8))
        minimum, maximum = radius_range(other)
        if minimum >= 18.0 and maximum <= 22.0:
            n_inside += 1
            assert cost(other) > best * (1 - 1e-6)
    assert n_inside > 50


@pytest.mark.parametrize("velocities", [True, False], ids=["velocities", "positions"])
@pytest.mark.parametrize("size", [0.0, 0.02, 0.06, 0.2])
def test_loose_and_poor_fits_are_reported(size, velocities):
    """A circle of 20 m with a superimposed wave of `size` radii, which a cubic cannot follow."""
    angle = np.linspace(0.0, 3.0, SAMPLES)
    radius = 20.0 * (1.0 + np.sqrt(2.0) * size * np.sin(12 * angle))
    slope = 20.0 * np.sqrt(2.0) * size * 12 * np.cos(12 * angle)
    cos, sin = np.cos(angle), np.sin(angle)
    position = np.stack([radius * cos, radius * sin, 0 * angle], axis=1)
    velocity = np.stack([slope * cos - radius * sin, slope * sin + radius * cos, 0 * angle], axis=1)
    result = fit(Track(angle, position, velocity if velocities else None), "uniform", velocity_sigma=1e3)
    exceeds = [
        float(result.relative_rms) > max_rms or float(result.relative_speed) > max_speed
        for max_rms, max_speed in THRESHOLDS
    ]
    expected = ResultCode.poor_fit if exceeds[1] else ResultCode.loose_fit if exceeds[0] else ResultCode.successful
    assert result.code == expected
    assert result.successful == (not exceeds[1])
    assert (size > 0) == exceeds[0]
    if size == 0.2:
        with pytest.raises(RuntimeError, match=r"radius of the turn, more than 10%.*does not follow its recording"):
            fit(Track(angle, position, velocity if velocities else None), "uniform", velocity_sigma=1e3, throw=True)


THRESHOLDS = ((0.03, 0.25), (0.10, 0.50))
"""As documented: above the first thresholds a fit is loose, above the second poor."""


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_the_quality_of_a_fit_follows_from_the_recording(motion):
    window = read_track(DATA / "boreas_bends.csv").window(78.4, 87.6)
    result = fit(window, motion)
    states = np.asarray(_states(result.path, window.elapsed))
    recorded = np.linalg.norm(window.velocities, axis=1)
    error = np.abs(np.linalg.norm(states[:, 1], axis=1) - recorded).max() / np.sqrt(np.mean(recorded**2))
    np.testing.assert_allclose(result.relative_speed, error, rtol=1e-9)
    deviation = np.asarray(states[:, 0] - window.positions)[:, :2]
    radius = np.linalg.norm(np.diff(np.asarray(window.positions)[:, :2], axis=0), axis=1).sum() / float(window.turn)
    np.testing.assert_allclose(result.relative_rms, np.sqrt(np.mean(np.sum(deviation**2, axis=1))) / radius, rtol=0.02)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_fit_and_its_path_are_stored(tmp_path, fitted, suffix):
    for name, value in (("fitted", fitted["hermite"]), ("path", fitted["hermite"].path)):
        value.save(tmp_path / f"{name}{suffix}")
        assert eqx.tree_equal(document.load(tmp_path / f"{name}{suffix}"), value)


def test_a_fit_compiles_nothing(turn, compiled):
    jax.clear_caches()
    for motion in ("uniform", "hermite"):
        assert int(fit(turn.window(1093.6, 1099.2), motion).residual.samples) < SAMPLES
    assert not compiled


def as_float32(track):
    return Track(*(jnp.asarray(np.asarray(x), jnp.float32) for x in (track.times, track.positions, track.velocities)))


@pytest.mark.parametrize("x64", [True, False])
def test_float32_near_the_origin(x64):
    """A float32 recording is fitted to the accuracy of float32, with and without x64; the path is float32."""
    track = recorded(known_path("uniform", origin=(0.0, 0.0, 0.0)), clock=0.0)
    with jax.enable_x64(x64):
        result = fit(as_float32(track))
        assert result.path.radius.dtype == jnp.float32
        assert result.successful
        assert float(result.residual.distance_rms) < FLOAT32_TOLERANCE
