"""1/√x from products and sums: accuracy, derivatives, and 0 where it is undefined."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.algebra.cpu.inverse_root import inverse_root, root

ULPS = 2


def numbers(kind, count=200_000):
    """Positive normal numbers of all sizes."""
    limits = np.finfo(kind)
    powers = np.random.default_rng(5).uniform(np.log2(limits.tiny) + 1, np.log2(limits.max) - 1, count)
    return np.concatenate([np.exp2(powers), [1.0, 2.0, 4.0, limits.tiny, limits.max]]).astype(kind)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_it_is_accurate_to_two_units_in_the_last_place(kind):
    x = numbers(kind)
    exact = 1 / np.sqrt(x.astype(np.longdouble))
    eps = np.finfo(kind).eps
    y = jax.jit(inverse_root)(jnp.asarray(x))
    assert y.dtype == kind
    assert np.max(np.abs(np.asarray(y) / exact - 1)) < ULPS * eps
    assert np.max(np.abs(np.asarray(jax.jit(root)(jnp.asarray(x))) * exact - 1)) < ULPS * eps


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_it_is_zero_where_it_is_undefined(kind):
    undefined = jnp.array([0.0, -0.0, -1.0, np.finfo(kind).tiny / 8, -np.inf], kind)
    slope = jax.vmap(jax.grad(inverse_root))
    for f in (inverse_root, slope, jax.vmap(jax.grad(jax.grad(inverse_root))), root, jax.vmap(jax.grad(root))):
        np.testing.assert_array_equal(f(undefined), np.zeros_like(undefined))
    np.testing.assert_array_equal(inverse_root(jnp.array([4.0, 4.0]), jnp.array([True, False])), [0.5, 0.0])


def test_infinity_and_nan():
    x = jnp.array([np.inf, np.nan])
    np.testing.assert_array_equal(inverse_root(x), [0.0, np.nan])
    np.testing.assert_array_equal(root(x), x)
    np.testing.assert_array_equal(inverse_root(x, x > 0), [0.0, 0.0])


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_derivatives_are_accurate_for_numbers_of_all_sizes(kind):
    x = numbers(kind, 2000)
    exact = np.sqrt(x.astype(np.longdouble))
    slope = np.asarray(jax.vmap(jax.grad(root))(jnp.asarray(x)))
    assert np.max(np.abs(2 * exact * slope - 1)) < 4 * np.finfo(kind).eps
    # The derivative of the inverse root, −½ x^(−3/2), overflows or underflows for the smallest and largest numbers.
    expected = -0.5 / exact**3
    normal = (np.abs(expected) < np.finfo(kind).max) & (np.abs(expected) > np.finfo(kind).tiny)
    slope = np.asarray(jax.vmap(jax.grad(inverse_root))(jnp.asarray(x)))
    assert np.sum(normal) > 500
    assert np.max(np.abs(slope[normal] / expected[normal] - 1)) < 8 * np.finfo(kind).eps


def test_second_derivatives_and_forward_mode():
    x = jnp.asarray([1e-3, 0.7, 3.0, 40.0])
    for f, power in ((inverse_root, -0.5), (root, 0.5)):
        np.testing.assert_allclose(jax.vmap(jax.jacfwd(f))(x), power * x ** (power - 1), rtol=1e-14)
        second = power * (power - 1) * x ** (power - 2)
        np.testing.assert_allclose(jax.vmap(jax.hessian(f))(x), second, rtol=1e-14)
