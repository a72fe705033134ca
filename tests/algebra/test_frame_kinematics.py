"""Vector identities and kinematics by quaternion matrices: against mpmath, SciPy and the Frenet–Serret formulas."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj import matrices

RNG = np.random.default_rng(20)
ROUND_OFF = 1e-13
STEP = 1e-4


def exact_cross(a, b):
    """With 50 digits."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def test_the_two_vector_identities():
    """Against products of crosses with 50 digits; of one vector they are the powers of ½(Ṙ₀ − Ṙ₀′)."""
    with mpmath.workdps(50):
        for _ in range(5):
            vectors = RNG.normal(size=(4, 3))
            a, b, c, d = ([mpmath.mpf(x) for x in v] for v in vectors)
            double = [float(x) for x in exact_cross(a, exact_cross(b, c))]
            triple = [float(x) for x in exact_cross(a, exact_cross(b, exact_cross(c, d)))]
            np.testing.assert_allclose(matrices.double_product(*vectors[:3]), double, atol=ROUND_OFF)
            np.testing.assert_allclose(matrices.triple_product(*vectors), triple, atol=10 * ROUND_OFF)
    v, x = jnp.asarray(RNG.normal(size=(2, 3)))
    np.testing.assert_allclose(matrices.double_product(v, v, x), matrices.cross_repeated(v, x, 2), atol=ROUND_OFF)
    np.testing.assert_allclose(
        matrices.triple_product(v, v, v, x), matrices.cross_repeated(v, x, 3), atol=10 * ROUND_OFF
    )


def test_rates_and_slopes_of_any_quaternion():
    """Against SciPy's rotations at two instants, for a λ of changing length."""
    q, q_dot = jnp.asarray(RNG.normal(size=(2, 4)))
    turns = Rotation.from_quat(np.array([q - STEP * q_dot, q + STEP * q_dot]), scalar_first=True)
    inertial = (turns[1] * turns[0].inv()).as_rotvec() / (2 * STEP)
    np.testing.assert_allclose(matrices.rate(q, q_dot, "inertial"), inertial, atol=1e-6)
    np.testing.assert_allclose(matrices.rate(q, q_dot), turns[0].inv().apply(inertial), atol=1e-2 * STEP**0.5)
    np.testing.assert_allclose(qt.quaternion.rotate(q, matrices.rate(q, q_dot)), inertial, atol=1e-6)
    whole = np.asarray(matrices.rotation(q)) / float(jnp.sum(q * q))
    np.testing.assert_allclose(whole[1:, 1:], qt.rotation.to_dcm(q), atol=ROUND_OFF)
    np.testing.assert_allclose(whole[0], [1.0, 0, 0, 0], atol=ROUND_OFF)
    slope = jax.jvp(matrices.rotation, (q,), (q_dot,))[1]
    np.testing.assert_allclose(matrices.rotation_slope(q, q_dot), slope, atol=ROUND_OFF * 10)


@pytest.mark.parametrize("axes", ["body", "inertial"])
def test_the_kinematic_matrix_and_the_way_back(axes):
    q, omega = jnp.asarray(RNG.normal(size=4)), jnp.asarray(RNG.normal(size=3))
    q_dot = 0.5 * matrices.kinematic(omega, axes) @ q
    np.testing.assert_allclose(q_dot, qt.quaternion.derivative(q, omega, axes), atol=ROUND_OFF)
    np.testing.assert_allclose(matrices.rate(q, q_dot, axes), omega, atol=ROUND_OFF)
    np.testing.assert_allclose(matrices.kinematic(omega, axes).T, -matrices.kinematic(omega, axes))
    for call in (lambda: matrices.kinematic(omega, "world"), lambda: matrices.rate(q, q, "world")):
        with pytest.raises(ValueError, match="axes must be 'body' or 'inertial'"):
            call()


def test_the_frame_of_a_path_obeys_frenet_and_serret():
    """τ̇ = vκn, ṅ = −vκτ + vχb, ḃ = −vχn, and ω = (vχ, 0, vκ): by quaternion matrices from λ and λ̇."""
    path = qt.SpiralHelix([8.0, 0.3, 0.1], [0.4, 0.5, 0.05], [1.0, 0.4, -0.2, 0.03], 2.5)
    program = qt.FrameProgram(path)
    for t in (0.3, 1.2, 2.1):
        q, q_dot = jax.jvp(lambda t: program(t).quaternion, (t,), (1.0,))
        at = qt.trihedral(path, t)
        v, bend, twist = at.speed, at.curvature, at.torsion
        table = v * jnp.array([[0.0, bend, 0.0], [-bend, 0.0, twist], [0.0, -twist, 0.0]])
        np.testing.assert_allclose(matrices.rotation_slope(q, q_dot)[1:, 1:], table @ at.dcm(), atol=1e-11)
        np.testing.assert_allclose(matrices.rate(q, q_dot), [v * twist, 0.0, v * bend], atol=1e-11)
