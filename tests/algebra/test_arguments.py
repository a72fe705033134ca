"""Integers are computed as floats, and a wrong last axis is refused by name, in every function of rotations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

FUNCTIONS = [
    *(qt.quaternion.unit, qt.quaternion.inverse, qt.quaternion.conjugate, qt.quaternion.log, qt.quaternion.log_norm),
    *(qt.quaternion.canonical, qt.quaternion.norm_squared, qt.quaternion.left_matrix, qt.quaternion.right_matrix),
    *(qt.rotation.to_dcm, qt.rotation.to_gibbs, qt.rotation.to_mrp, qt.rotation.to_rotation_vector),
]
OF_VECTORS = [
    *(qt.quaternion.exp, qt.rotation.from_rotation_vector, qt.rotation.from_gibbs, qt.rotation.from_mrp),
    *(qt.rotation.left_jacobian, qt.rotation.right_jacobian),
]
OF_TWO = {
    qt.rotation.angle_between: ([3, 1, 0, 2], [1, 0, 0, 1]),
    qt.rotation.slerp: ([3, 1, 0, 2], [1, 0, 0, 1], 2),
    qt.rotation.power: ([3, 1, 0, 2], 3),
    qt.rotation.between_vectors: ([1, 0, 2], [0, 3, 1]),
    qt.rotation.from_axis_angle: ([1, 0, 2], 2),
    qt.rotation.to_axis_angle: ([3, 1, 0, 2],),
    qt.rotation.mean: ([[3, 1, 0, 2], [3, 1, 1, 2]], [1, 2]),
    qt.rotation.align: ([[1, 0, 0], [0, 1, 1]], [[0, 0, 2], [1, 1, 0]]),
    qt.rotation.euler_rates_to_body: ("ZYX", [1, 0, 2], [0, 3, 1]),
    qt.rotation.body_to_euler_rates: ("ZYX", [1, 0, 2], [0, 3, 1]),
    qt.quaternion.rate: ([3, 1, 0, 2], [1, 0, 0, 1]),
}
"""Functions of several arguments, with lists of integers."""


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_integers_and_lists_are_floats(function):
    right = function(np.array([3.0, 1.0, 0.0, 2.0]))
    for given in ([3, 1, 0, 2], np.array([3, 1, 0, 2]), np.array([3, 1, 0, 2], np.int8)):
        np.testing.assert_allclose(function(given), right, rtol=1e-15)


@pytest.mark.parametrize("function", OF_VECTORS, ids=lambda f: f.__name__)
def test_integer_vectors_are_floats(function):
    right = function(np.array([1.0, 0.0, 2.0]))
    for given in ([1, 0, 2], np.array([1, 0, 2])):
        np.testing.assert_allclose(function(given), right, rtol=1e-15)


@pytest.mark.parametrize("function", OF_TWO, ids=lambda f: f.__name__)
def test_integers_and_lists_of_several_arguments_are_floats(function):
    given = OF_TWO[function]

    def called(convert):
        return jax.tree.leaves(function(*(x if isinstance(x, str) else convert(x) for x in given)))

    right = called(lambda x: np.asarray(x, float))
    for convert in (lambda x: x, np.asarray, lambda x: np.asarray(x, np.int8), jnp.asarray):
        for a, b in zip(called(convert), right, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-15)
    wrong = [np.ones((2, 5)) if np.ndim(x) else x for x in given]
    with pytest.raises(ValueError, match=r"must (both )?have shape \(\.\.\.,"):
        function(*wrong)


@pytest.mark.parametrize("function", FUNCTIONS[:4] + FUNCTIONS[9:], ids=lambda f: f.__name__)
@pytest.mark.parametrize("shape", [(), (3,), (4, 3), (5,)])
def test_a_wrong_last_axis_of_a_quaternion_is_refused(function, shape):
    with pytest.raises(ValueError, match=rf"{function.__name__}: q must have shape \(..., 4\), but shape"):
        function(np.ones(shape))


@pytest.mark.parametrize("function", OF_VECTORS, ids=lambda f: f.__name__)
def test_a_wrong_last_axis_of_a_vector_is_refused(function):
    with pytest.raises(ValueError, match=rf"{function.__name__}: . must have shape \(..., 3\), but shape \(4,\) was"):
        function(np.ones(4))


def test_the_result_does_not_have_the_type_of_one_argument():
    inertia = [1.5, 2.5, 3.5]
    whole = qt.dynamics.acceleration(np.array([1, 0, 0]), np.array([1, 2, 0]), inertia)
    np.testing.assert_allclose(whole, [2 / 3, 0, -4 / 7], rtol=1e-14)
    attitude = qt.Attitude(np.array([1, 0, 0, 0]), np.array([1, 2, 0]), np.array([0, 1, 0]))
    np.testing.assert_allclose(qt.dynamics.torque(attitude, inertia), [0, 2.5, 2.0], rtol=1e-14)
    assert float(qt.dynamics.rotational_power(attitude, inertia)) == 5.0
    attitude = qt.Attitude([1, 0, 0, 0], [1, 2, 0], [0, 1, 0])
    np.testing.assert_allclose(qt.dynamics.torque(attitude, inertia), [0, 2.5, 2.0], rtol=1e-14)


def test_whole_joint_values_are_floats():
    arm = qt.stanford_arm()
    for got, right in zip(arm.kinematics(np.zeros(6, int)), arm.kinematics(np.zeros(6)), strict=True):
        np.testing.assert_allclose(got, right, atol=1e-6)


def test_arguments_by_name_are_checked_too():
    with pytest.raises(ValueError, match=r"rotate: q must have shape \(..., 4\)"):
        qt.quaternion.rotate(q=[1, 0, 0], v_body=[1, 2, 3])
    with pytest.raises(ValueError, match=r"product: p must have shape \(..., 4\)"):
        qt.quaternion.product(p=[1, 0, 0], q=[1, 0, 0, 0])
    with pytest.raises(ValueError, match=r"conjugate: dual must have shape \(..., 8\)"):
        qt.dual_quaternion.conjugate(1.0)
