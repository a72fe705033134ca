"""Hamilton's algebra, the convention table, exponential and logarithm with derivatives at their singular points."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from tests.derivatives import with_jacobians

from qtraj.algebra import quaternion, rotation

ROUND_OFF = 1e-14
DIFFERENCE = 1e-8  # central differences with step 1e-5
RNG = np.random.default_rng(1993)
P, Q, R = (jnp.array(x) for x in RNG.normal(size=(3, 4)))
V = jnp.array(RNG.normal(size=3))
ONE, E1, E2, E3 = jnp.eye(4)


def derivatives(f):
    """x → first derivatives (forward, reverse) and second derivatives (forward and reverse over reverse)."""

    def both(x):
        return (jax.jacfwd(f)(x), jax.jacrev(f)(x)), (jax.hessian(f)(x), jax.jacrev(jax.jacrev(f))(x))

    return quickly(both)


def quickly(f):
    """Compiled without optimisation, which halves the time of a test that runs once."""
    return jax.jit(f)


EXP, LOG = derivatives(quaternion.exp), derivatives(quaternion.log)


def close(actual, expected, tolerance=ROUND_OFF):
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance)


# The convention table


@pytest.mark.parametrize(
    ("p", "q", "pq"), [(E1, E2, E3), (E2, E3, E1), (E3, E1, E2), (E2, E1, -E3), (E1, E1, -ONE), (ONE, E1, E1)]
)
def test_hamilton_s_table(p, q, pq):
    np.testing.assert_array_equal(quaternion.product(p, q), pq)


def test_a_quarter_turn_about_z_shows_every_convention():
    """A body yawed by +90°: its x axis (τ) is the inertial y axis."""
    q = jnp.array([1.0, 0, 0, 1])  # unnormalised on purpose
    close(quaternion.rotate(q, jnp.array([1.0, 0, 0])), [0, 1, 0])
    close(rotation.to_dcm(q), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # rows: body axes in inertial components
    close(rotation.to_dcm(q) @ jnp.array([0.0, 1, 0]), [1, 0, 0])  # inertial → body
    close(quaternion.exp(jnp.array([0, 0, np.pi / 4])), np.array(q) / np.sqrt(2))
    close(rotation.to_gibbs(q), [0, 0, 1])
    close(rotation.to_rotation_vector(q), [0, 0, np.pi / 2])
    close(rotation.to_euler(q, "ZYX"), [np.pi / 2, 0, 0])
    scipy = Rotation.from_quat(q, scalar_first=True)
    close(scipy.as_matrix().T, rotation.to_dcm(q))
    close(scipy.apply([1, 0, 0]), [0, 1, 0])


def test_composition_multiplies_on_the_right_in_body_axes():
    close(quaternion.rotate(quaternion.product(P, Q), V), quaternion.rotate(P, quaternion.rotate(Q, V)))


# The algebra


def test_product_is_associative_and_distributive():
    product = quaternion.product
    close(product(product(P, Q), R), product(P, product(Q, R)))
    close(product(P, Q + R), product(P, Q) + product(P, R))


def test_norm_conjugate_and_inverse():
    product, conjugate = quaternion.product, quaternion.conjugate
    close(quaternion.norm_squared(product(P, Q)), quaternion.norm_squared(P) * quaternion.norm_squared(Q))
    close(conjugate(product(P, Q)), product(conjugate(Q), conjugate(P)))
    close(product(P, conjugate(P)), quaternion.norm_squared(P) * ONE)
    close(product(P, quaternion.inverse(P)), ONE)
    close(product(quaternion.inverse(P), P), ONE)
    close(quaternion.norm_squared(quaternion.unit(P)), 1)
    close(quaternion.inverse(1e-200 * P) * 1e-200, quaternion.inverse(P))


def test_matrices_of_left_and_right_multiplication():
    close(quaternion.left_matrix(P) @ Q, quaternion.product(P, Q))
    close(quaternion.right_matrix(P) @ Q, quaternion.product(Q, P))
    close(
        quaternion.left_matrix(P) @ quaternion.right_matrix(Q), quaternion.right_matrix(Q) @ quaternion.left_matrix(P)
    )


@pytest.mark.parametrize("c", [1.0, -3.0, 1e-3, 1e-200, -1e200])
def test_rotate_is_the_sandwich_at_any_scale(c):
    sandwich = quaternion.product(quaternion.product(P, jnp.concatenate([jnp.zeros(1), V])), quaternion.inverse(P))
    close(quaternion.rotate(c * P, V), sandwich[1:])
    close(sandwich[0], 0)
    close(quaternion.rotate(c * P, V), Rotation.from_quat(np.array(P), scalar_first=True).apply(np.array(V)))


def test_rotate_has_the_derivative_of_a_homogeneous_function():
    """No change along q, and the same matrix forward, reverse and by differences."""

    def f(q):
        return quaternion.rotate(q, V)

    _, forward, reverse = quickly(with_jacobians(f))(P)
    close(forward, reverse)
    close(forward @ P, np.zeros(3))
    close(forward, differences(f, P), DIFFERENCE)


def differences(f, x, step=1e-5):
    shifts = step * jnp.eye(x.size)
    slopes = quickly(jax.vmap(lambda h: (f(x + h) - f(x - h)) / (2 * step)))(shifts)
    return np.moveaxis(slopes, 0, -1)


def test_canonical_takes_the_first_non_zero_component():
    for q in ([0.0, 0, -2, 1], [-1e-300, 1, 0, 0], [0.0, 0, 0, -1], [-1.0, 0, 0, 0]):
        np.testing.assert_array_equal(quaternion.canonical(jnp.array(q)), -np.array(q))
        np.testing.assert_array_equal(quaternion.canonical(-jnp.array(q)), -np.array(q))


def test_zero_has_no_attitude():
    assert np.isnan(quaternion.rotate(jnp.zeros(4), V)).all()


# Exponential and logarithm

SIZES = [1e-300, 1e-160, 1e-9, 1e-3, 0.0499, 0.0501, 0.223, 0.224, 2.0, 3.1, 40.0]


@pytest.mark.parametrize("size", SIZES)
def test_exp_against_the_matrix_exponential_and_high_precision(size):
    v = jnp.array(size * np.array([2.0, -3, 6]) / 7)
    q = np.array(quaternion.exp(v))
    with mpmath.workdps(40):
        angle = mpmath.sqrt(mpmath.fsum(mpmath.mpf(x) ** 2 for x in v.tolist()))
        cosine, sinc = mpmath.cos(angle), mpmath.sin(angle) / angle
        expected = np.array([float(cosine), *(float(sinc * mpmath.mpf(x)) for x in v.tolist())])
    np.testing.assert_allclose(q, expected, rtol=1e-15 * max(1, 2 * size), atol=1e-15 * min(size, 1) * max(1, size))
    pure = jnp.concatenate([jnp.zeros(1), v])
    close(q, expm(np.array(quaternion.left_matrix(pure)))[:, 0], 1e-13)


def test_exp_at_zero_with_first_and_second_derivatives():
    zero = jnp.zeros(3)
    np.testing.assert_array_equal(quaternion.exp(zero), ONE)
    slope = np.vstack([np.zeros(3), np.eye(3)])
    curvature = np.zeros((4, 3, 3))
    curvature[0] = -np.eye(3)
    first, second = EXP(zero)
    for derivative in first:
        np.testing.assert_array_equal(derivative, slope)
    for derivative in second:
        np.testing.assert_array_equal(derivative, curvature)


def test_log_at_the_identity_with_first_and_second_derivatives():
    np.testing.assert_array_equal(quaternion.log(ONE), np.zeros(3))
    slope = np.hstack([np.zeros((3, 1)), np.eye(3)])
    curvature = np.zeros((3, 4, 4))
    for k in range(3):
        curvature[k, 0, k + 1] = curvature[k, k + 1, 0] = -1
    first, second = LOG(ONE)
    for derivative in first:
        np.testing.assert_array_equal(derivative, slope)
    for derivative in second:
        np.testing.assert_array_equal(derivative, curvature)


def log_of_exp(v):
    return quaternion.log(quaternion.exp(v))


@quickly
def log_of_exp_with_derivatives(v):
    f = log_of_exp
    return f(v), (jax.jacfwd(f)(v), jax.jacrev(f)(v)), jax.hessian(f)(v)


@pytest.mark.parametrize("size", [s for s in SIZES if s < np.pi])
def test_log_inverts_exp_with_value_and_derivatives(size):
    """log(exp(v)) = v with its first and second derivatives, also where the series end."""
    v = jnp.array(size * np.array([2.0, -3, 6]) / 7)
    loss = max(1.0, 1 / (np.pi - size))  # the direction of v is ill-conditioned near |v| = π
    value, first, second = log_of_exp_with_derivatives(v)
    np.testing.assert_allclose(value, v, rtol=2e-15 * loss)
    for derivative in first:
        close(derivative, np.eye(3), ROUND_OFF * loss)
    close(second, np.zeros((3, 3, 3)), 2 * ROUND_OFF * loss**2)


@pytest.mark.parametrize("c", [1.0, 7.0, 1e-200])
@pytest.mark.parametrize("scalar", [0.5, 1e-300, 0.0, -0.5, -1e9])
def test_log_against_high_precision_in_all_four_quadrants(scalar, c):
    q = np.array([scalar, 0.3, -0.1, 0.2])
    with mpmath.workdps(40):
        s, *u = (mpmath.mpf(x) for x in q)
        size = mpmath.sqrt(sum(x * x for x in u))
        expected = [float(x / size * mpmath.atan2(size, s)) for x in u]
        log_norm = float(mpmath.log(mpmath.sqrt(s * s + size * size)))
    np.testing.assert_allclose(quaternion.log(jnp.array(c * q)), expected, rtol=1e-15)
    np.testing.assert_allclose(quaternion.log_norm(jnp.array(q)), log_norm, rtol=1e-15)
    unit = quaternion.unit(jnp.array(q))
    close(quaternion.exp(quaternion.log(jnp.array(q))), unit)


def test_log_of_a_negative_real_is_finite_and_inverts():
    q = jnp.array([-2.0, 0, 0, 0])
    np.testing.assert_array_equal(quaternion.log(q), [np.pi, 0, 0])
    close(quaternion.exp(quaternion.log(q)), -ONE)
    for derivative in jax.tree.leaves(LOG(q)):
        assert np.isfinite(derivative).all()


@pytest.mark.parametrize("f", [quaternion.log, lambda q: quaternion.exp(q[1:]), quaternion.inverse, quaternion.unit])
def test_derivatives_against_differences(f):
    _, forward, reverse = quickly(with_jacobians(f))(P)
    close(forward, reverse)
    close(forward, differences(jax.jit(f), P), DIFFERENCE)


# Kinematics


def test_derivative_is_the_flow_of_a_constant_rate():
    """d/dt of λ∘exp(ω_x t/2), and of exp(ω_ξ t/2)∘λ, where the scalar part makes |λ|² grow as exp ω0 t."""
    omega = jnp.array([0.7, 0.1, -0.4, 0.9])

    def growing_rotation(t):
        return jnp.exp(0.5 * omega[0] * t) * quaternion.exp(0.5 * omega[1:] * t)

    def flow(f):
        return quickly(lambda t: jax.jvp(f, (t,), (jnp.array(1.0),))[1])(jnp.array(0.0))

    close(flow(lambda t: quaternion.product(P, growing_rotation(t))), quaternion.derivative(P, omega))
    close(flow(lambda t: quaternion.product(growing_rotation(t), P)), quaternion.derivative(P, omega, axes="inertial"))
    rate = quaternion.derivative(P, omega)
    close(2 * P @ rate / (P @ P), omega[0])


def test_a_rate_vector_has_scalar_part_zero_and_may_be_in_body_or_inertial_axes():
    padded = jnp.concatenate([jnp.zeros(1), V])
    np.testing.assert_array_equal(quaternion.derivative(P, V), quaternion.derivative(P, padded))
    close(P @ quaternion.derivative(P, V), 0)
    close(quaternion.derivative(P, V), quaternion.derivative(P, quaternion.rotate(P, V), axes="inertial"))


def test_unknown_axes_are_refused():
    with pytest.raises(ValueError, match="'body' or 'inertial', but 'world'"):
        quaternion.derivative(P, V, axes="world")


# float32


@quickly
def everything(q, v):
    return (
        quaternion.product(q, q),
        quaternion.rotate(q, v),
        quaternion.exp(v),
        quaternion.log(q),
        quaternion.inverse(q),
        quaternion.left_matrix(q),
        quaternion.derivative(q, v),
        jax.hessian(quaternion.exp)(jnp.zeros_like(v)),
        jax.hessian(quaternion.log)(jnp.zeros_like(q).at[0].set(1.0)),
    )


def test_float32_is_kept_and_agrees():
    singles = everything(P.astype(jnp.float32), V.astype(jnp.float32))
    for single, double in zip(singles, everything(P, V), strict=True):
        assert single.dtype == jnp.float32
        close(single, double, 2e-6)
    tiny = jax.jit(quaternion.rotate)(1e-30 * P.astype(jnp.float32), V.astype(jnp.float32))
    close(tiny, quaternion.rotate(P, V), 2e-6)
