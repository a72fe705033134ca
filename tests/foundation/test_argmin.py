"""Minimum and index against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.foundation.argmin import min_and_argmin


def test_minimum_and_index_agree_with_numpy():
    values = np.random.default_rng(3).normal(size=(100, 33))
    lowest, index = jax.vmap(min_and_argmin)(jnp.asarray(values))
    np.testing.assert_array_equal(index, np.argmin(values, axis=1))
    np.testing.assert_array_equal(lowest, np.min(values, axis=1))
    np.testing.assert_array_equal(min_and_argmin(jnp.asarray(values), 1)[1], index)


def test_nan_counts_as_infinite():
    assert min_and_argmin(jnp.asarray([jnp.nan, 2.0, 1.0, jnp.nan]))[1] == 2
    for number in (1, 2, 40):
        lowest, index = min_and_argmin(jnp.full(number, jnp.nan))
        assert lowest == jnp.inf
        assert index == 0


def test_the_result_has_no_derivative():
    assert jax.grad(lambda x: min_and_argmin(jnp.stack([x, 2 * x]))[0])(1.0) == 0
