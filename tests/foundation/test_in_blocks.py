"""A batch in blocks has the values and the order of the batch, and other sizes are not compiled again."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt


class Traced:
    """A function that counts how often it is traced."""

    def __init__(self):
        self.count = 0

    def __call__(self, x, y):
        self.count += 1
        return {"sum": x["a"] + y, "square": x["a"] ** 2}


@pytest.mark.parametrize("count", [1, 8, 9, 70, 130])
@pytest.mark.parametrize("cost", [False, True])
def test_values_are_in_the_order_of_the_batch(count, cost):
    rng = np.random.default_rng(count)
    x, y = rng.normal(size=(count, 3)), rng.normal(size=count)
    found = qt.in_blocks(lambda x, y: x["a"] * y, {"a": x}, jnp.asarray(y), cost=y if cost else None, block=16)
    np.testing.assert_array_equal(found, x * y[:, None])


def test_other_sizes_are_not_compiled_again():
    function = Traced()
    for count in (200, 129, 67, 65):
        x = np.arange(float(count))
        found = qt.in_blocks(function, {"a": x}, x)
        np.testing.assert_array_equal(found["sum"], 2 * x)
    assert function.count == 1
    qt.in_blocks(function, {"a": np.ones(7)}, np.ones(7))
    assert function.count == 2


def test_batches_of_other_sizes_compile_nothing(compiled):
    """`jax.vmap` compiles a propagation again for each size."""

    def last(size):
        rate = lambda t: size * jnp.stack([0 * t, 0 * t, 1 + jnp.sin(t)])  # noqa: E731
        return qt.propagate(rate, [1.0, 0, 0, 0], np.linspace(0.0, 2.0, 3), qt.GaussLegendre(1), steps=1)[-1]

    sizes = np.linspace(0.5, 1.5, 1001)
    in_vmap = jax.jit(jax.vmap(last))
    expected = np.asarray(in_vmap(sizes))
    for count, again in ((1000, 1), (1001, 0), (900, 0)):
        del compiled[:]
        np.testing.assert_allclose(qt.in_blocks(last, sizes[:count]), expected[:count], rtol=0, atol=1e-14)
        assert len(compiled) == again
    del compiled[:]
    in_vmap(sizes[:900])
    assert len(compiled) == 1


def test_arguments_that_are_no_arrays_are_shared():
    found = qt.in_blocks(lambda x, name: x * len(name), np.arange(3.0), "ab")
    np.testing.assert_array_equal(found, [0.0, 2.0, 4.0])


def test_derivatives_inside_a_trace():
    total = lambda x: jnp.sum(qt.in_blocks(lambda x: x**3, x, cost=np.arange(4.0)))  # noqa: E731
    x = jnp.arange(4.0)
    np.testing.assert_allclose(jax.grad(total)(x), 3 * x**2)
    np.testing.assert_allclose(jax.jit(total)(x), jnp.sum(x**3))


@pytest.mark.parametrize("count", [3, 70])
def test_derivatives_with_respect_to_a_value_in_the_function(count):
    x = np.arange(float(count))
    total = lambda c: jnp.sum(qt.in_blocks(lambda x: x * c**2, x))  # noqa: E731
    np.testing.assert_allclose(jax.grad(total)(2.0), 4 * x.sum())
    np.testing.assert_allclose(jax.jit(total)(2.0), 4 * x.sum())
    np.testing.assert_allclose(jax.vmap(total)(jnp.array([1.0, 2.0])), [x.sum(), 4 * x.sum()])


def test_a_function_that_contains_arrays():
    x = np.arange(3.0)
    scaled = lambda c: qt.in_blocks(eqx.Partial(jnp.multiply, c), x)  # noqa: E731
    np.testing.assert_array_equal(scaled(jnp.asarray(2.0)), 2 * x)
    np.testing.assert_allclose(jax.grad(lambda c: jnp.sum(scaled(c)))(2.0), x.sum())


def test_concrete_arguments_inside_a_trace():
    x = np.arange(3.0)
    double = lambda x: 2 * x  # noqa: E731
    qt.in_blocks(double, x)
    np.testing.assert_allclose(jax.jit(lambda c: c * qt.in_blocks(double, x))(3.0), 6 * x)


def test_a_traced_cost_is_not_used():
    x = np.arange(3.0)
    found = jax.jit(lambda cost: qt.in_blocks(lambda x: 2 * x, x, cost=cost))(np.array([3.0, 1.0, 2.0]))
    np.testing.assert_allclose(found, 2 * x)


@pytest.mark.parametrize("kind", ["threefry2x32", "rbg"])
def test_random_keys(kind):
    keys = jax.random.split(jax.random.key(0, impl=kind), 5)
    found, sample = qt.in_blocks(lambda key: (key, jax.random.key_data(key)), keys, cost=np.arange(5.0)[::-1])
    assert found.dtype == keys.dtype
    np.testing.assert_array_equal(jax.random.key_data(found), jax.random.key_data(keys))
    np.testing.assert_array_equal(sample, jax.random.key_data(keys))


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((np.ones(3), np.ones(4)), {}, r"the shapes are \(3,\), \(4,\)"),
        ((2.0,), {}, "no argument is an array"),
        (([1.0, 2.0, 3.0],), {}, r"lists and numbers are not divided: pass jnp.asarray"),
        ((np.ones(0),), {}, "at least one element"),
        ((np.ones(3),), {"block": 0}, "block must be a positive integer, but 0 was given"),
        ((np.ones(3),), {"cost": [1.0, 2.0]}, "one number for each of 3 elements"),
        ((np.ones(3),), {"cost": [1.0, 2.0, np.nan]}, "without NaN"),
        ((np.ones(3),), {"cost": [[1], [2, 3]]}, "one number for each of 3 elements"),
        ((np.ones(3),), {"cost": ["a", "b", "c"]}, "one number for each of 3 elements"),
    ],
)
def test_bad_arguments(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        qt.in_blocks(lambda *x: x[0], *arguments, **options)
