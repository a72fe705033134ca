"""Arrays in one loop: the same values and derivatives from fewer loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.interpreters import partial_eval

from qtraj.algebra.cpu.one_loop import derivatives_in_one_loop, in_one_loop

X = jnp.linspace(0.3, 1.7, 64).reshape(4, 16)


def several(x):
    """Three arrays that share most of their work."""
    shared = jnp.sin(x) * x + x**3
    return [shared * x, shared + x, shared**2 - x]


def count_loops(f, *arguments):
    text = jax.jit(f).lower(*arguments).compile().as_text()
    return sum(" fusion(" in line for line in text[text.index("ENTRY") :].splitlines())


def test_values_are_unchanged_and_share_a_loop():
    for actual, expected in zip(jax.jit(lambda x: in_one_loop(several(x)))(X), several(X), strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-15)
    assert count_loops(lambda x: in_one_loop(several(x)), X) < count_loops(several, X)


def test_nan_infinity_integers_and_flags_are_unchanged():
    odd = jnp.array([jnp.nan, jnp.inf, -jnp.inf, 0.0, -2.0])
    integers, flags = jnp.arange(5), odd > 0
    actual = jax.jit(lambda *x: in_one_loop(x))(odd, integers, 2 * odd, flags)
    for x, expected in zip(actual, (odd, integers, 2 * odd, flags), strict=True):
        np.testing.assert_array_equal(x, expected)
    assert in_one_loop([flags])[0] is flags


@pytest.mark.parametrize("joined", [in_one_loop, derivatives_in_one_loop])
def test_derivatives_of_all_orders_and_modes_are_unchanged(joined):
    def loss(x, join):
        first, second, third = several(x)
        # The second is not used, and the last has no derivative.
        one, _, three, four = join([first, second, third * first, jnp.cos(X[0, :3])])
        return jnp.sum(one * three + four * one**2)

    x = X[0, :3]
    for transform in (jax.grad, jax.jacfwd, jax.hessian, lambda f: jax.jacrev(jax.grad(f))):
        actual, expected = (jax.jit(transform(lambda x, join=join: loss(x, join)))(x) for join in (joined, list))
        np.testing.assert_allclose(actual, expected, rtol=1e-13, atol=1e-13)
    many = jax.jit(jax.vmap(jax.grad(lambda x: loss(x, joined))))(jnp.stack([x, 2 * x]))
    np.testing.assert_allclose(many[1], jax.grad(lambda x: loss(x, list))(2 * x), rtol=1e-13)


def test_arrays_may_be_shared_by_the_batch():
    outputs = jax.vmap(lambda x, y: in_one_loop([x, y, x * y]), in_axes=(1, None))(X, X[:, 0])
    np.testing.assert_array_equal(outputs[1], jnp.broadcast_to(X[:, 0], (16, 4)))
    np.testing.assert_array_equal(outputs[2], X.T * X[:, 0][None])


def test_cotangents_share_a_loop():
    def gradient(join):
        return jax.grad(lambda x: sum(jnp.sum(y) for y in several_of(join(x))), argnums=0)

    def several_of(x):
        return [part for k, y in enumerate(x) for part in several(y * (k + 1))]

    arrays = [X, 2 * X, 3 * X]
    assert count_loops(gradient(derivatives_in_one_loop), arrays) < count_loops(gradient(list), arrays)


def test_unused_arrays_are_not_computed():
    traced = jax.make_jaxpr(lambda x: in_one_loop([jnp.cosh(x), jnp.sin(x), jnp.tan(x)]))(X)
    used, _ = partial_eval.dce_jaxpr(traced.jaxpr, [False, True, False])
    assert [str(equation.primitive) for equation in used.eqns] == ["sin", "in_one_loop"]
    nothing, _ = partial_eval.dce_jaxpr(traced.jaxpr, [False, False, False])
    assert not nothing.eqns
