"""Norms and directions of vectors of ordinary, extreme and zero length."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.algebra import vector

ULPS = 4 * np.finfo(float).eps
UP = jnp.array([0.0, 0.0, 1.0])
UNIT_SLOPES = [jax.jit(jax.jacfwd(vector.unit)), jax.jit(jax.jacrev(vector.unit))]
DIRECTION = np.array([2.0, -3.0, 6.0]) / 7


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1.0, 1e160, 1e300])
def test_norm_and_unit_neither_underflow_nor_overflow(size):
    v = jnp.array(size * DIRECTION)
    np.testing.assert_allclose(vector.norm(v), size, rtol=ULPS)
    np.testing.assert_allclose(vector.unit(v, UP), DIRECTION, rtol=ULPS)
    np.testing.assert_allclose(jax.grad(vector.norm)(v), DIRECTION, rtol=ULPS)
    slope = (np.eye(3) - np.outer(DIRECTION, DIRECTION)) / size
    for jacobian in UNIT_SLOPES:
        np.testing.assert_allclose(jacobian(v, UP), slope, rtol=1e-14, atol=ULPS / size)


def test_the_zero_vector_has_the_fallback_and_zero_derivatives():
    zero = jnp.zeros(3)
    assert vector.norm(zero) == 0
    np.testing.assert_array_equal(vector.unit(zero, UP), UP)
    np.testing.assert_array_equal(jax.grad(vector.norm)(zero), zero)
    np.testing.assert_array_equal(jax.jit(jax.hessian(vector.norm))(zero), np.zeros((3, 3)))
    for jacobian in UNIT_SLOPES:
        np.testing.assert_array_equal(jacobian(zero, UP), np.zeros((3, 3)))
    np.testing.assert_array_equal(jax.jit(jax.jacrev(vector.unit, argnums=1))(zero, UP), np.eye(3))


def test_second_derivative_of_the_norm():
    v = jnp.array([0.3, -1.2, 2.0])
    n = vector.norm(v)
    np.testing.assert_allclose(
        jax.jit(jax.hessian(vector.norm))(v), (np.eye(3) - np.outer(v, v) / n**2) / n, atol=1e-15
    )


def test_nan_is_not_hidden_by_the_fallback():
    invalid = jnp.array([jnp.nan, 0.0, 0.0])
    assert np.isnan(vector.norm(invalid))
    assert np.isnan(vector.unit(invalid, UP)).any()


def test_float32_is_kept():
    v = jnp.array([1e-30, 0, 0], dtype=jnp.float32)
    assert vector.norm(v).dtype == vector.unit(v, UP.astype(jnp.float32)).dtype == jnp.float32
    np.testing.assert_allclose(vector.norm(v), 1e-30, rtol=1e-6)
