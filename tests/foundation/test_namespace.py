"""The namespace of a formula: NumPy for numbers and NumPy arrays, JAX for tracers, JAX arrays back for JAX arrays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.foundation.namespace import in_numpy, is_host, mapped, namespace, of_arrays, repeat, xp


@of_arrays
def distance(a, b):
    return xp.sqrt(xp.sum((a - b) ** 2, axis=-1))


@in_numpy
def total(tree):
    return xp.sum(tree["x"]) + tree["y"]


def test_the_namespace_is_found_from_the_arguments():
    assert namespace(1.0, np.zeros(3), [np.ones(2), 1]) is np
    assert namespace(1.0, [jnp.zeros(3)]) is jnp
    jax.jit(lambda x: [x][not is_host(x) - 1])(1.0)
    assert xp.float64 is np.float64
    assert xp.pi == np.pi


@pytest.mark.parametrize("convert", [list, np.asarray, lambda x: np.asarray(x, np.float32)])
def test_numbers_and_numpy_arrays_are_computed_in_float64(convert, compiled):
    found = distance(convert([1, 2, 3]), convert([1, 2, 5]))
    assert isinstance(found, np.float64)
    assert found == 2
    assert not compiled


@pytest.mark.parametrize(("first", "second", "expected"), [(4, 4, 4), (4, 8, 8), (8, 8, 8)])
def test_jax_arrays_come_back_as_jax_arrays_in_the_widest_dtype(first, second, expected, compiled):
    a, b = (jax.device_put(np.arange(3.0).astype(f"f{size}")) for size in (first, second))
    found = distance(a, b)
    assert isinstance(found, jax.Array)
    assert found.dtype.itemsize == expected
    found = total({"x": a, "y": 2.0})
    assert isinstance(found, jax.Array)
    assert found.dtype == a.dtype
    assert not compiled
    assert found == 5


def test_integers_of_jax_become_the_default_float():
    assert distance(jnp.arange(3), jnp.arange(3)).dtype == jnp.result_type(float)


def test_tracers_are_computed_by_jax():
    a, b = np.asarray([1.0, 2.0, 3.0]), np.asarray([3.0, 2.0, 3.0])
    assert jax.jit(distance)(a, b) == 2
    np.testing.assert_array_equal(jax.vmap(distance, (0, None))(np.stack([a, b]), b), [2, 0])
    np.testing.assert_allclose(jax.grad(distance)(a, b), [-1, 0, 0])
    assert jax.jit(total)({"x": a, "y": 2.0}) == 8


def test_numpy_arrays_can_be_indexed_by_tracers():
    """A closed-over NumPy array is a constant of the trace."""
    table = np.arange(5.0)
    pick = of_arrays(lambda x, i: x[i.astype(int)])
    assert jax.jit(lambda i: pick(table, i))(3.0) == 3


def test_loops_run_in_python_or_in_jax():
    for convert in (np.asarray, jnp.asarray):
        assert repeat(3, lambda x: 2 * x, convert(1.0)) == 8
        np.testing.assert_array_equal(mapped(lambda x: x**2)(convert([1.0, 2.0])), [1, 4])


def test_invalid_operations_do_not_warn():
    """As in JAX, the result is NaN; warnings are errors in this session."""
    assert np.isnan(of_arrays(lambda x: x / x)(np.asarray([0.0]))).all()
