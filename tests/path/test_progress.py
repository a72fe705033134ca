"""Segments that are curves with a progress: the same motion as their polynomials in the time, in all operations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import PPoly

import qtraj as qt
from qtraj.path import pieces, progress
from qtraj.path.route import from_segments

DURATION = 3.5


def segments(terms=6):
    """Random curves, and cubics that do not decrease; the middle segment is a polynomial in the time."""
    rng = np.random.default_rng(4)
    c = rng.normal(size=(3, terms, 3))
    own = np.stack([[0.2, 0.0, 0.4, 0.3], progress.IDENTITY, [0.0, 0.7, -0.2, 0.1]])
    starts = np.array([0.0, 1.0, 2.25])
    return starts, c, np.asarray(DURATION), np.array([10.0, -20.0, 5.0]), own


@pytest.fixture(scope="module")
def route():
    return from_segments(*segments())


@pytest.fixture(scope="module")
def plain(route):
    """SciPy's polynomials in the time, composed independently."""
    starts, c, duration, origin, own = segments()
    rows = []
    for curve, w in zip(c, own, strict=True):
        inner = np.polynomial.Polynomial(w)
        found = [np.polynomial.Polynomial(curve[:, axis])(inner).coef for axis in range(3)]
        rows.append(np.stack([np.pad(x, (0, 16 - len(x))) for x in found], axis=1))
    coefficients = np.array(rows)
    coefficients[:, 0] += origin
    return PPoly(np.moveaxis(coefficients, 0, 1)[::-1], np.append(starts, duration))


TIMES = np.linspace(0.0, DURATION, 58)


def check(route, plain, times=TIMES, at=None, order=4):
    for t, u in zip(times, times if at is None else at, strict=True):
        for k, row in enumerate(np.asarray(route.derivatives(t, order))):
            np.testing.assert_allclose(row, plain.derivative(k)(u) if k else plain(u), rtol=1e-11, atol=1e-11)


def test_derivatives_are_those_of_the_polynomials_in_the_time(route, plain):
    check(route, plain)
    np.testing.assert_allclose(route.to_ppoly().c, plain.c, rtol=1e-13, atol=1e-13)


def test_jax_agrees_with_numpy(route):
    rows = jax.jit(jax.vmap(lambda t: route.derivatives(t, 3)))(jnp.asarray(TIMES))
    expected = np.stack([route.derivatives(t, 3) for t in TIMES])
    np.testing.assert_allclose(rows, expected, rtol=1e-12, atol=1e-12)


def test_derivatives_with_respect_to_the_progress(route):
    def height(own):
        starts, c, duration, origin, _ = segments()
        return from_segments(jnp.asarray(starts), jnp.asarray(c), duration, origin, own).position(0.7)[2]

    own, h = jnp.asarray(segments()[4]), 1e-6
    slope = jax.jit(jax.grad(height))(own)
    for place in ((0, 0), (0, 2), (0, 3)):
        step = np.zeros(own.shape)
        step[place] = h
        known = (height(own + step) - height(own - step)) / (2 * h)
        assert float(slope[place]) == pytest.approx(float(known), rel=1e-7)


@pytest.mark.parametrize(("t0", "t1"), [(0.4, 3.2), (0.0, 0.9), (1.3, 2.0), (2.6, 3.5)])
def test_windows(route, plain, t0, t1):
    window = route.window(t0, t1)
    times = np.linspace(0.0, t1 - t0, 23)[1:-1]
    check(window, plain, times, times + t0)


def test_reversing_and_joining(route, plain):
    back = route.reversed()
    for t in TIMES[1:-1]:
        expected = [(-1) ** k * (plain.derivative(k)(DURATION - t) if k else plain(DURATION - t)) for k in range(4)]
        np.testing.assert_allclose(back.derivatives(t, 3), expected, rtol=1e-10, atol=1e-10)
    first, second = route.window(0.0, 1.4), route.window(1.4, DURATION)
    check(first + second, plain, TIMES)
    line = qt.Route([0.0, 1.0], np.stack([plain(DURATION), plain(DURATION) + 1]), np.ones((2, 3)), np.zeros((2, 3)))
    longer = route + line
    np.testing.assert_allclose(longer.position(DURATION + 0.5), plain(DURATION) + 0.5, rtol=1e-12)
    check(longer, plain, TIMES[:-1])


def test_lengths_times_and_the_nearest_point(route, plain):
    fine = np.linspace(0, DURATION, 400_001)
    speed = np.linalg.norm(plain.derivative()(fine), axis=1)
    length = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine)))
    assert float(route.length()) == pytest.approx(length[-1], rel=1e-5)
    assert float(route.arc_length(1.7)) == pytest.approx(np.interp(1.7, fine, length), rel=1e-5)
    assert float(route.time_at(np.interp(2.9, fine, length))) == pytest.approx(2.9, abs=1e-3)
    point = plain(0.6) + np.array([0.01, 0.0, -0.01])
    distance = np.linalg.norm(plain(fine) - point, axis=1).min()
    assert float(route.nearest(point).distance) == pytest.approx(distance, abs=1e-6)


def test_files_keep_every_digit(route, tmp_path):
    for suffix in ("toml", "json"):
        file = tmp_path / f"route.{suffix}"
        route.save(file)
        loaded = qt.load(file)
        np.testing.assert_array_equal(loaded.progress, route.progress)
        np.testing.assert_array_equal(loaded.coefficients, route.coefficients)
    assert "progress" in qt.Route.to_xarray(route)


def test_many_instants_at_once(route):
    table = qt.evaluate(route, TIMES, outputs=("position", "velocity", "acceleration", "curvature"))
    rows = np.stack([route.derivatives(t, 2) for t in TIMES])
    for k, name in enumerate(("position", "velocity", "acceleration")):
        np.testing.assert_allclose(getattr(table, name), rows[:, k], rtol=1e-12, atol=1e-12)


def test_times_at():
    own = np.array([[0.0, 0.0, 0.4, 0.3], [1.0, 0.7, -0.2, 0.1]])
    t = np.array([0.3, 0.8])
    goal = pieces.values(own[..., None], t, 0)[0][..., 0]
    np.testing.assert_allclose(progress.times_at(own, np.ones(2), goal), t, rtol=1e-14)


def test_wrong_shapes_are_refused():
    starts, c, duration, origin, own = segments()
    with pytest.raises(ValueError, match="the progress must have shape"):
        from_segments(starts, c, duration, origin, own[:2])
    with pytest.raises(ValueError, match="a shape has no stops"):
        qt.Shape(from_segments(starts, c, duration, origin, own))
