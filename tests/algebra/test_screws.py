"""Exponential, logarithm and screw interpolation of poses, against matrix exponentials."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import qtraj as qt
from qtraj.algebra import dual_quaternion
from qtraj.algebra.rotation_rates import left_jacobian_inverse

RNG = np.random.default_rng(12)
TURNS = [0.0, 1e-9, 1e-3, 0.5, 0.999999, 1.000001, 2.0, 3.0, np.pi - 1e-9]


def twist(v, u):
    """The twist as a matrix (4, 4)."""
    x, y, z = v
    return np.array([[0, -z, y, u[0]], [z, 0, -x, u[1]], [-y, x, 0, u[2]], [0, 0, 0, 0]])


def matrix(dual):
    """The pose as a homogeneous matrix (4, 4)."""
    position, q = dual_quaternion.to_pose(dual)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = np.asarray(qt.rotation.to_dcm(q)).T, position
    return frame


def pose():
    return dual_quaternion.from_pose(RNG.normal(size=3), RNG.normal(size=4))


@pytest.mark.parametrize("angle", TURNS)
def test_exp_is_the_matrix_exponential_and_log_its_inverse(angle):
    v, u = RNG.normal(size=3), RNG.normal(size=3)
    v *= angle / np.linalg.norm(v)
    dual = dual_quaternion.exp(v, u)
    np.testing.assert_allclose(matrix(dual), expm(twist(v, u)), atol=2e-14)
    for scaled in (dual, -3.0 * dual):
        back = dual_quaternion.log(scaled)
        np.testing.assert_allclose(back[0], v, atol=1e-14)
        np.testing.assert_allclose(back[1], u, atol=1e-13)


def test_the_inverse_of_the_jacobian_solves_it():
    v = RNG.normal(size=(len(TURNS), 3))
    v *= (np.array([*TURNS[:-1], 5.0]) / np.linalg.norm(v, axis=1))[:, None]
    w = RNG.normal(size=v.shape)
    right = np.linalg.solve(qt.rotation.left_jacobian(v), w[..., None])[..., 0]
    np.testing.assert_allclose(left_jacobian_inverse(v, w), right, atol=1e-13)


def test_interpolation_is_a_constant_twist_between_both_poses():
    a, b = pose(), pose()
    s = np.array([-0.5, 0.0, 0.3, 1.0, 1.7])
    found = dual_quaternion.interpolate(a, b, s)
    first, last = matrix(a), matrix(b)
    v, u = dual_quaternion.log(dual_quaternion.product(dual_quaternion.inverse(a), b))
    for share, dual in zip(s, found, strict=True):
        np.testing.assert_allclose(matrix(dual), first @ expm(share * twist(v, u)), atol=1e-13)
        np.testing.assert_allclose(np.linalg.norm(dual[:4]), 1.0, rtol=1e-14)
    np.testing.assert_allclose(matrix(found[1]), first, atol=1e-14)
    np.testing.assert_allclose(matrix(found[3]), last, atol=1e-14)


def test_interpolation_does_not_depend_on_the_axes():
    a, b, left, right = pose(), pose(), pose(), pose()

    def moved(x):
        return dual_quaternion.product(dual_quaternion.product(left, x), right)

    np.testing.assert_allclose(
        matrix(dual_quaternion.interpolate(moved(a), moved(b), 0.4)),
        matrix(moved(dual_quaternion.interpolate(a, b, 0.4))),
        atol=1e-13,
    )


def test_interpolation_of_positions_and_of_attitudes_alone():
    q, p, r = RNG.normal(size=4), RNG.normal(size=4), RNG.normal(size=(2, 3))
    straight = dual_quaternion.interpolate(*(dual_quaternion.from_pose(x, q) for x in r), 0.25)
    np.testing.assert_allclose(dual_quaternion.to_pose(straight)[0], 0.75 * r[0] + 0.25 * r[1], atol=1e-14)
    at_origin = dual_quaternion.interpolate(*(dual_quaternion.from_pose(np.zeros(3), x) for x in (q, p)), 0.25)
    np.testing.assert_allclose(dual_quaternion.to_pose(at_origin)[1], qt.rotation.slerp(q, p, 0.25), atol=1e-14)


@jax.jit
def slopes_of_interpolation(a, b, s):
    """The derivatives with respect to the fraction `s` and to the second pose."""
    return jax.jacobian(dual_quaternion.interpolate, (2, 1))(a, b, s)


@pytest.mark.parametrize("angle", [0.0, 1e-5, 1.0, np.pi])
def test_derivatives_are_finite_and_those_of_finite_differences(angle):
    a = pose()
    b = dual_quaternion.product(a, dual_quaternion.exp([0.0, angle, 0.0], [0.3, 1.0, -0.4]))
    slopes, in_pose = slopes_of_interpolation(jnp.asarray(a), jnp.asarray(b), jnp.asarray(0.3))
    step = 1e-5
    right = (dual_quaternion.interpolate(a, b, 0.3 + step) - dual_quaternion.interpolate(a, b, 0.3 - step)) / (2 * step)
    np.testing.assert_allclose(slopes, right, atol=1e-9)
    assert np.isfinite(in_pose).all()


def generator(twist_of_six):
    """The commutator with a twist as a matrix (6, 6): the adjoint of exp(v, u) is its matrix exponential."""
    (x, y, z), (a, b, c) = twist_of_six[:3], twist_of_six[3:]
    turn, move = (np.array([[0, -r, q], [r, 0, -p], [-q, p, 0]]) for p, q, r in ((x, y, z), (a, b, c)))
    return np.block([[turn, np.zeros((3, 3))], [move, turn]])


@pytest.mark.parametrize("angle", TURNS)
def test_the_adjoint_of_a_screw_motion_is_the_exponential_of_its_generator(angle):
    v, u = RNG.normal(size=3), RNG.normal(size=3)
    v *= angle / np.linalg.norm(v)
    found = dual_quaternion.adjoint(-2.0 * dual_quaternion.exp(v, u))
    np.testing.assert_allclose(found, expm(generator([*v, *u])), atol=1e-13)


def test_the_adjoint_changes_the_axes_of_twists():
    """Matrices: T [U] T⁻¹ with the pose T and the twist [U] (4, 4)."""
    a, b = pose(), pose()
    omega, u = RNG.normal(size=3), RNG.normal(size=3)
    inertial = dual_quaternion.inertial_twist(a, omega, u)
    right = matrix(a) @ twist(omega, u) @ np.linalg.inv(matrix(a))
    np.testing.assert_allclose(twist(*inertial), right, atol=1e-13)
    np.testing.assert_allclose(dual_quaternion.adjoint(a) @ [*omega, *u], np.concatenate(inertial), atol=1e-13)
    back = dual_quaternion.body_twist(a, *inertial)
    np.testing.assert_allclose(np.concatenate(back), [*omega, *u], atol=1e-13)
    inverse = dual_quaternion.adjoint(dual_quaternion.inverse(a))
    np.testing.assert_allclose(inverse @ dual_quaternion.adjoint(a), np.eye(6), atol=1e-13)
    both = dual_quaternion.adjoint(dual_quaternion.product(a, b))
    np.testing.assert_allclose(both, dual_quaternion.adjoint(a) @ dual_quaternion.adjoint(b), atol=1e-12)


def test_the_twist_in_inertial_axes_is_that_of_the_derivative():
    """2Λ̇ = U_ξ∘Λ for Λ̇ of `derivative`, whose velocity is that of the origin of the body."""
    dual, omega, velocity = pose(), RNG.normal(size=3), RNG.normal(size=3)
    slope = dual_quaternion.derivative(dual, omega, velocity)
    u = qt.quaternion.rotate(qt.quaternion.conjugate(dual[:4]), velocity)
    rate, moment = dual_quaternion.inertial_twist(dual, omega, u)
    right = 0.5 * dual_quaternion.product(np.array([0, *rate, 0, *moment]), dual)
    np.testing.assert_allclose(slope, right, atol=1e-13)


@pytest.mark.parametrize("angle", [*TURNS, 5.0, 2 * np.pi])
def test_the_jacobians_map_rates_of_a_twist_to_twists(angle):
    """Central differences of exp; for small angles also the series Σ ad^k/(k + 1)! of the generator."""
    v, u, change = RNG.normal(size=3), RNG.normal(size=3), RNG.normal(size=6)
    v *= angle / np.linalg.norm(v)
    step = 1e-5

    def motion(h):
        return matrix(dual_quaternion.exp(v + h * change[:3], u + h * change[3:]))

    slope, back = (motion(step) - motion(-step)) / (2 * step), np.linalg.inv(motion(0.0))
    left, right = (f(v, u) for f in (dual_quaternion.left_jacobian, dual_quaternion.right_jacobian))
    for jacobian, expected in ((left, slope @ back), (right, back @ slope)):
        rates = jacobian @ change
        np.testing.assert_allclose(twist(rates[:3], rates[3:]), expected, atol=1e-9)
    series, power = np.eye(6), np.eye(6)
    for k in range(1, 60):
        power = power @ generator([*v, *u]) / (k + 1)
        series = series + power
    np.testing.assert_allclose(left, series, atol=1e-13)
    np.testing.assert_allclose(left, dual_quaternion.adjoint(dual_quaternion.exp(v, u)) @ right, atol=1e-13)
