"""Collocation schemes compared with 60 digits of mpmath, and single steps of all methods."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import qtraj as qt
from qtraj.motion.propagation.gauss_legendre import GaussLegendre, lobatto, tableau
from qtraj.motion.propagation.increment import increments
from qtraj.motion.propagation.magnus import Magnus, sixth_order

ONE_ROUNDING = 1.2e-16  # relative
ROUND_OFF = 1e-15
STAGES = (1, 2, 3, 8, 13)
ANGLES = np.array([0.0, 1e-9, 0.3, 1.0, 1.9])
"""[rad] h|ω| of a step, up to ANGLE_PER_STEP."""


def reference(stages):
    """c, b, a from the zeros of the Legendre polynomial and from the conditions Σ_j a_ij c_j^k = c_i^{k+1}/(k+1)."""
    with mpmath.workdps(60):
        rough = np.polynomial.legendre.leggauss(stages)[0]
        zeros = [mpmath.findroot(lambda x: mpmath.legendre(stages, x), mpmath.mpf(float(x))) for x in rough]
        c = [(1 + x) / 2 for x in zeros]
        powers = mpmath.matrix(stages, stages)
        for k in range(stages):
            for j in range(stages):
                powers[k, j] = c[j] ** k
        inverse = powers**-1
        rows = [[x ** (k + 1) / (k + 1) for k in range(stages)] for x in [*c, mpmath.mpf(1)]]
        solved = [[sum(row[k] * inverse[j, k] for k in range(stages)) for j in range(stages)] for row in rows]
        return np.array(c, float), np.array(solved[-1], float), np.array(solved[:-1], float)


@pytest.mark.parametrize("stages", STAGES)
def test_the_scheme_is_exact_up_to_one_rounding(stages):
    scheme = tableau(stages)
    for actual, expected in zip(scheme[:3], reference(stages), strict=True):
        np.testing.assert_allclose(actual, expected, rtol=ONE_ROUNDING, atol=0)


@pytest.mark.parametrize("stages", STAGES)
def test_lobatto_integrates_polynomials(stages):
    x, w = lobatto(stages + 1)
    assert x[0] == 0.0
    assert x[-1] == 1.0
    for degree in range(2 * stages):
        assert abs(w @ x**degree - 1 / (degree + 1)) < ROUND_OFF
    assert abs(w @ x ** (2 * stages) - 1 / (2 * stages + 1)) > 0.1 * 16.0**-stages / (2 * stages + 1)


def numerical_angle(method, angle):
    """The angle of a step with a constant rate: GL-1 is Cayley's map, the others are exact to round-off here."""
    return 4 * np.arctan(angle / 4) if method == GaussLegendre(1) else angle


@pytest.mark.parametrize("method", [GaussLegendre(1), GaussLegendre(8), Magnus(4), Magnus(6)], ids=str)
def test_constant_rate_and_length(method):
    """A constant rate has a closed form; |E| = 1 to round-off for any rate."""
    axis = np.array([1.0, -2.0, 2.0]) / 3
    constant = np.broadcast_to(axis, (len(ANGLES), len(method.nodes), 3))
    random = np.random.default_rng(1).uniform(-1, 1, size=constant.shape) / np.sqrt(3)
    expected = qt.rotation.from_rotation_vector(numerical_angle(method, ANGLES)[:, None] * axis)
    np.testing.assert_allclose(increments(method, constant, ANGLES)[0], expected, rtol=0, atol=ROUND_OFF)
    rotations = increments(method, random, ANGLES)[0]
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=1), 1.0, rtol=0, atol=ROUND_OFF)
    compiled = jax.jit(lambda rates, h: increments(method, rates, h)[0])(jnp.asarray(random), jnp.asarray(ANGLES))
    np.testing.assert_allclose(compiled, rotations, rtol=0, atol=ROUND_OFF)


def test_the_embedded_method_of_order_4():
    """It agrees with order 6 for a fixed axis, and otherwise differs by the fifth power of h."""
    rates = np.random.default_rng(3).normal(size=(3, 3))
    nodes = Magnus(6).nodes - 0.5

    def difference(h):
        smooth = (h * nodes[:, None]) ** np.arange(3) @ rates
        sixth, fourth = sixth_order(smooth, np.asarray(h))
        return np.linalg.norm(sixth - fourth)

    assert np.log2(difference(0.02) / difference(0.01)) == pytest.approx(5, abs=0.1)
    constant = np.arange(3.0)[:, None] * np.array([[1.0, 2.0, 3.0]])
    sixth, fourth = sixth_order(constant, np.asarray(0.5))
    np.testing.assert_array_equal(sixth, fourth)


@pytest.mark.parametrize("stages", [0, 65])
def test_bad_stages(stages):
    with pytest.raises(ValueError, match="integer from 1 to 64"):
        GaussLegendre(stages)


def test_bad_order():
    with pytest.raises(ValueError, match="must be 4 or 6, but 5"):
        Magnus(5)
