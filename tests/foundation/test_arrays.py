"""Conversion of input compiles nothing and copies the caller's memory."""

import jax
import numpy as np
import pytest

from qtraj.foundation.arrays import as_array, as_float, part

SIZE = 1009  # no other test uses this size, so nothing of this shape is compiled yet


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64, np.bool_])
def test_concrete_input_compiles_nothing(compiled, dtype):
    x = np.ones(SIZE, dtype)
    assert as_float(x).dtype == np.float64
    assert as_float(x.tolist()).shape == as_array(x, np.int32).shape == (SIZE,)
    np.testing.assert_array_equal(part(as_float(x), slice(3, 7)), np.ones(4))
    assert not compiled


def test_later_writes_of_the_caller_do_not_change_the_array():
    memory = np.zeros(SIZE + 8)
    x = memory[-memory.ctypes.data % 64 // 8 :][:SIZE]  # aligned, so that JAX would not copy it by itself
    converted = as_float(x)
    x[:] = 1.0
    assert not np.any(converted)


def test_part_of_a_traced_array():
    rows = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(jax.vmap(lambda row: part(row, slice(1, 3)))(rows), rows[:, 1:3])
    np.testing.assert_array_equal(jax.grad(lambda row: part(row, 2))(rows[0]), [0, 0, 1, 0])
