"""Jacobians in both modes from one trace, for tests that compare them."""

import jax
import jax.numpy as jnp


def with_jacobians(function):
    """The value, the Jacobian by forward mode and the Jacobian by reverse mode of a function of one array.

    They have the axes of `jax.jacfwd` and `jax.jacrev`. The function is traced, and its value compiled, once for all.
    """

    def of(x):
        x = jnp.asarray(x)
        value, change = jax.linearize(function, x)
        back = jax.linear_transpose(change, x)
        forward = jax.vmap(change, out_axes=-1)(jnp.eye(x.size).reshape(x.size, *x.shape))
        reverse = jax.vmap(lambda weight: back(weight)[0])(jnp.eye(value.size).reshape(value.size, *value.shape))
        return value, *(jacobian.reshape(*value.shape, *x.shape) for jacobian in (forward, reverse))

    return of
