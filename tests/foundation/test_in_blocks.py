"""A batch in blocks has the values and the order of the batch, and other sizes are not compiled again."""

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


def test_arguments_that_are_no_arrays_are_shared():
    found = qt.in_blocks(lambda x, name: x * len(name), np.arange(3.0), "ab")
    np.testing.assert_array_equal(found, [0.0, 2.0, 4.0])


def test_derivatives_inside_a_trace():
    total = lambda x: jnp.sum(qt.in_blocks(lambda x: x**3, x, cost=np.arange(4.0)))  # noqa: E731
    x = jnp.arange(4.0)
    np.testing.assert_allclose(jax.grad(total)(x), 3 * x**2)
    np.testing.assert_allclose(jax.jit(total)(x), jnp.sum(x**3))


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((np.ones(3), np.ones(4)), {}, r"the shapes are \(3,\), \(4,\)"),
        ((2.0,), {}, "the shapes are none"),
        ((np.ones(0),), {}, "at least one element"),
        ((np.ones(3),), {"block": 0}, "block must be a positive integer, but 0 was given"),
        ((np.ones(3),), {"cost": [1.0, 2.0]}, "one number for each of 3 elements"),
        ((np.ones(3),), {"cost": [1.0, 2.0, np.nan]}, "without NaN"),
        ((np.ones(3),), {"cost": ["a", "b", "c"]}, "one number for each of 3 elements"),
    ],
)
def test_bad_arguments(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        qt.in_blocks(lambda *x: x[0], *arguments, **options)
