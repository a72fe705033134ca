"""Polynomials against NumPy's, and the two-point Hermite problem against its own conditions."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import Polynomial

from qtraj.algebra import polynomial

ROUND_OFF = 1e-13


@pytest.mark.parametrize("degree", [0, 1, 3, 6])
@pytest.mark.parametrize("t", [0.0, 1.7, -2.3])
def test_taylor_gives_every_derivative(degree, t):
    c = np.random.default_rng(degree).normal(size=degree + 1)
    series = polynomial.taylor(jnp.asarray(c), t, 8)
    for k in range(9):
        expected = Polynomial(c).deriv(k)(t) / math.factorial(k) if k <= degree else 0.0
        np.testing.assert_allclose(series[k], expected, rtol=ROUND_OFF, atol=ROUND_OFF * np.abs(c).max() * 40)


@pytest.mark.parametrize("degree", [0, 1, 5])
def test_horner_takes_arrays_of_coefficients(degree):
    c, t = np.random.default_rng(1).normal(size=(degree + 1, 4, 1)), np.linspace(-2.0, 2.0, 3)
    expected = np.array([Polynomial(row)(t) for row in c[..., 0].T])
    value = np.broadcast_to(polynomial.horner(list(c), t), expected.shape)
    np.testing.assert_allclose(value, expected, rtol=ROUND_OFF, atol=ROUND_OFF * np.abs(c).max() * 40)


def test_orders_above_the_degree_are_the_integer_zero():
    assert polynomial.taylor_terms([3.0], 0.5, 2) == [3.0, 0, 0]


@pytest.mark.parametrize(("at_start", "at_end"), [(1, 1), (2, 2), (3, 3), (3, 1), (2, 4)])
@pytest.mark.parametrize("duration", [0.3, 1.0, 12.0])
def test_hermite_meets_both_ends(at_start, at_end, duration):
    rng = np.random.default_rng(10 * at_start + at_end)
    start, end = rng.normal(size=at_start), rng.normal(size=at_end)
    c = Polynomial(np.asarray(polynomial.hermite(jnp.asarray(start), jnp.asarray(end), duration)))
    assert c.degree() == at_start + at_end - 1
    scale = max(1.0, duration, 1 / duration) ** (at_start + at_end)
    for k in range(at_start):
        np.testing.assert_allclose(c.deriv(k)(0.0), start[k], atol=ROUND_OFF * scale)
    for k in range(at_end):
        np.testing.assert_allclose(c.deriv(k)(duration), end[k], atol=1e2 * ROUND_OFF * scale)


def test_hermite_gives_the_cubic_of_paper_s():
    """Paper S, with the sign of ρ3 corrected."""
    a, va, b, vb, t = 20.0, 1.5, 26.0, -0.7, 4.0
    c = polynomial.hermite(jnp.asarray([a, va]), jnp.asarray([b, vb]), t)
    expected = [a, va, 3 * (b - a) / t**2 - (vb + 2 * va) / t, -2 * (b - a) / t**3 + (vb + va) / t**2]
    np.testing.assert_allclose(c, expected, rtol=1e-14)


def test_dtype_is_kept():
    c = jnp.asarray([1.0, 2.0, 3.0], jnp.float32)
    assert polynomial.taylor(c, 0.5, 2).dtype == jnp.float32
    assert polynomial.hermite(c[:2], c[1:], 2.0).dtype == jnp.float32


def test_derivative_in_t_is_the_second_taylor_coefficient():
    c = jnp.asarray([1.0, -2.0, 0.5, 3.0])
    np.testing.assert_allclose(
        jax.grad(lambda t: polynomial.evaluate(c, t))(0.8), polynomial.taylor(c, 0.8, 1)[1], rtol=ROUND_OFF
    )
