"""Jets: values, gradients and Hessians agree with JAX and with finite differences, for every operation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.algebra import jets
from qtraj.algebra.jets import Jet, variables

POINT = np.array([[0.7, 1.3], [1.9, 0.4], [0.6, 2.2]])  # three variables, a batch of two

FUNCTIONS = {
    "sum": lambda x, y, z: x + 2.0 + (y - z) - (1.5 - x),
    "product": lambda x, y, z: x * y * z + 3.0 * (x * x) - (-y),
    "quotient": lambda x, y, z: x / y + 1.0 / z + z / 2.0,
    "root": lambda x, y, z: jets.sqrt(x * y + z),
    "logarithm": lambda x, y, z: jets.log(x * y + z) * y,
    "exponential": lambda x, y, z: jets.exp(x - y) * z,
    "trigonometry": lambda x, y, z: jets.sin(x * y) + jets.cos(z * z),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_agree_with_jax(name):
    function = FUNCTIONS[name]
    jet = function(*variables(POINT))
    for k in range(POINT.shape[1]):
        x = jnp.asarray(POINT[:, k])
        expected = function(*x), jax.grad(lambda x: function(*x))(x), jax.hessian(lambda x: function(*x))(x)
        for own, value in zip((jet.value, jet.gradient, jet.hessian), expected, strict=True):
            np.testing.assert_allclose(own[..., k], value, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_agree_with_finite_differences(name):
    function, step = FUNCTIONS[name], 1e-6
    jet = function(*variables(POINT))
    for k in range(len(POINT)):
        shift = step * np.eye(len(POINT))[k][:, None]
        above, below = (function(*variables(POINT + sign * shift)) for sign in (1, -1))
        np.testing.assert_allclose(jet.gradient[k], (above.value - below.value) / (2 * step), rtol=1e-8, atol=1e-8)
        slopes = (above.gradient - below.gradient) / (2 * step)
        np.testing.assert_allclose(jet.hessian[k], slopes, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_jets_of_first_order_have_the_same_gradients(name):
    first = [Jet(x.value, x.gradient) for x in variables(POINT)]
    jet, expected = FUNCTIONS[name](*first), FUNCTIONS[name](*variables(POINT))
    assert jet.hessian is None
    np.testing.assert_array_equal(jet.gradient, expected.gradient)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_coordinates_have_the_same_derivatives_as_variables(name):
    jet, expected = FUNCTIONS[name](*jets.coordinates(POINT)), FUNCTIONS[name](*variables(POINT))
    np.testing.assert_array_equal(jet.value, expected.value)
    for own, other in ((jet.gradient, expected.gradient), (jet.hessian, expected.hessian)):
        np.testing.assert_allclose(np.broadcast_to(own, other.shape), other, rtol=1e-15, atol=1e-15)


def test_an_array_on_the_left_leaves_the_operation_to_the_jet():
    x = variables(POINT)[0]
    factor = np.array([2.0, -3.0])
    np.testing.assert_array_equal((factor * x).value, factor * POINT[0])
    np.testing.assert_array_equal((factor - x).gradient, -x.gradient)
    np.testing.assert_array_equal((factor / x).value, factor / POINT[0])


def test_logarithm_and_root_where_a_value_is_not_positive():
    x = variables(np.array([[4.0, 0.0, -1.0]]))[0]
    logarithm, root = jets.log(x, -7.0), jets.sqrt(x)
    np.testing.assert_allclose(logarithm.value, [np.log(4.0), -7.0, -7.0])
    np.testing.assert_allclose(root.value, [2.0, 0.0, 0.0])
    for jet in (logarithm, root):
        assert np.all(jet.gradient[:, 1:] == 0)
        assert np.all(jet.hessian[..., 1:] == 0)
    np.testing.assert_array_equal(jets.log(jnp.asarray([1.0, 0.0]), -7.0), [0.0, -7.0])


def test_a_weighted_sum_over_a_new_batch_axis():
    x, weights = variables(POINT)[1], np.array([0.25, 0.75])
    nodes = np.array([[1.0], [2.0]])
    total = jets.weighted_sum(jets.spread(x) * jets.spread(x) * nodes, weights)
    np.testing.assert_allclose(total.value, 1.75 * POINT[1] ** 2)
    np.testing.assert_allclose(total.gradient[1], 3.5 * POINT[1])
    np.testing.assert_allclose(total.hessian[1, 1], 3.5)


def test_a_matrix_product_over_a_new_batch_axis():
    x, matrix = variables(POINT)[1], np.array([[0.25, 0.75], [1.0, -2.0], [0.0, 1.0]])
    nodes = np.array([[1.0], [2.0]])
    product = jets.matrix_product(matrix, jets.spread(x) * jets.spread(x) * nodes)
    sums = (matrix @ nodes)[:, :1]
    np.testing.assert_allclose(product.value, sums * POINT[1] ** 2)
    np.testing.assert_allclose(product.gradient[1], sums * 2 * POINT[1])
    np.testing.assert_allclose(product.hessian[1, 1], np.broadcast_to(2 * sums, product.value.shape))
    np.testing.assert_allclose(jets.matrix_product(matrix, nodes), matrix @ nodes)
