"""Integrals by blocks agree with those over all samples at once, for any division into blocks, with derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.batch.sums import integrals, neighbours

SAMPLES = 128
"""Samples of a block: 300 instants of one path are three blocks, 5 instants of 25 paths are one."""


def work(paths, cut):
    """a sin(b t), and its square."""
    x = paths["a"][:, None] * jnp.sin(paths["b"][:, None] * cut[0])
    return {"x": (x, x**2)}


def stack(count):
    k = jnp.arange(float(count))
    return {"a": 1 + 0.1 * k, "b": 2 - 0.01 * k}


def instants(count, rows):
    """Unevenly spaced instants, different for each row."""
    t = np.linspace(0.0, 2.0, count) ** 1.2
    return jnp.asarray(np.stack([t * (1 + 0.02 * r) for r in range(rows)]))


def integrate(paths, times, samples=SAMPLES):
    return jnp.stack(integrals(work, paths, times, neighbours(times), samples)["x"])


def expected(paths, times):
    x = np.stack([np.asarray(x) for x in work(paths, (times,))["x"]])
    return np.trapezoid(x, np.broadcast_to(times, x.shape[1:]), axis=-1)


@pytest.mark.parametrize("count", [1, 3, 60])
@pytest.mark.parametrize("number", [1, 2, 5, 128, 129, 300])
@pytest.mark.parametrize("own", [False, True])
def test_integrals_agree_with_the_samples(count, number, own):
    paths, times = stack(count), instants(number, count if own else 1)
    np.testing.assert_allclose(jax.jit(integrate)(paths, times), expected(paths, times), rtol=1e-13, atol=1e-14)


def test_the_integrals_of_pieces_of_a_row_add_up():
    paths, times = stack(2), instants(300, 1)
    around = neighbours(times, 3).reshape(1, 3, 2)
    pieces = [integrals(work, paths, times[:, 100 * k : 100 * k + 100], around[:, k], SAMPLES)["x"] for k in range(3)]
    total = sum(jnp.stack(piece) for piece in pieces)
    np.testing.assert_allclose(total, expected(paths, times), rtol=1e-13)
    np.testing.assert_array_equal(neighbours(times), times[:, np.array([0, -1])])


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(("count", "number"), [(2, 300), (60, 5)])
def test_derivatives_agree_with_all_samples_at_once(own, count, number):
    paths, times = stack(count), instants(number, count if own else 1)
    weights = jnp.cos(jnp.arange(2.0 * count)).reshape(2, count)

    def blocks(paths, times):
        return jnp.sum(weights * integrate(paths, times) ** 2)

    def at_once(paths, times):
        x = jnp.stack(work(paths, (times,))["x"])
        steps = jnp.diff(jnp.broadcast_to(times, x.shape))
        return jnp.sum(weights * jnp.sum(0.5 * steps * (x[..., 1:] + x[..., :-1]), axis=-1) ** 2)

    for derivative in (jax.grad, jax.jacfwd):
        of_blocks, of_all = (jax.jit(derivative(f, argnums=(0, 1)))(paths, times) for f in (blocks, at_once))
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-12), of_blocks, of_all)
    second = [jax.jit(jax.hessian(f))(paths, times)["a"]["b"] for f in (blocks, at_once)]
    np.testing.assert_allclose(*second, rtol=1e-10, atol=1e-11)


def test_the_sum_of_many_samples_is_accurate():
    times = jnp.linspace(0.0, np.pi, 1_000_001)[None]
    paths = {"a": jnp.ones(1), "b": jnp.ones(1)}
    exact = np.array([[2.0], [np.pi / 2]])
    # The error of the trapezoidal rule is (π/n)²/6 = 1.6e-12 for the sine, and 0 for its square, which is periodic.
    np.testing.assert_allclose(jax.jit(lambda *x: integrate(*x, 16384))(paths, times), exact, rtol=5e-12)


@pytest.mark.parametrize("number", [3, 300])
def test_an_infinite_sample_makes_an_infinite_integral(number):
    """At the last instant of a row, which is repeated to fill the last block."""
    times = jnp.linspace(0.0, 2.0, number)[None]
    pole = lambda paths, cut: {"x": (paths["a"][:, None] / (2.0 - cut[0]),)}  # noqa: E731
    assert np.isposinf(integrals(pole, stack(1), times, neighbours(times), SAMPLES)["x"][0])
