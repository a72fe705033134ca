"""Elements at traced indices against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.foundation.indexing import choose, element, with_element

VALUES = np.random.default_rng(11).normal(size=(3, 4, 5))
TREE = {"a": jnp.asarray(VALUES), "b": jnp.arange(60).reshape(3, 4, 5)}


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("index", [np.uint32(0), np.int32(2)])
def test_an_element_agrees_with_numpy(axis, index):
    found = jax.jit(lambda k: element(TREE, k, axis))(index)
    np.testing.assert_array_equal(found["a"], np.take(VALUES, index, axis))
    np.testing.assert_array_equal(found["b"], np.take(np.arange(60).reshape(3, 4, 5), index, axis))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_only_the_element_is_replaced(axis):
    new = jax.tree.map(lambda x: -jnp.take(x, 1, axis), TREE)
    changed = np.asarray(jax.jit(lambda k: with_element(TREE, k, new, axis))(np.uint32(1))["a"])
    expected = np.moveaxis(VALUES.copy(), axis, 0)
    expected[1] *= -1
    np.testing.assert_array_equal(np.moveaxis(changed, axis, 0), expected)


def test_each_element_of_a_batch_is_chosen():
    condition = np.asarray([True, False, True])
    chosen = choose(jnp.asarray(condition), TREE, jax.tree.map(lambda x: -x, TREE))
    np.testing.assert_array_equal(chosen["a"], np.where(condition[:, None, None], VALUES, -VALUES))
