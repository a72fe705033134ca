"""Paper S's quaternion matrices: printed form, monomial basis, identities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.algebra import matrices, quaternion, rotation

ROUND_OFF = 1e-14
RNG = np.random.default_rng(1843)
ALPHA = jnp.array(RNG.normal(size=4))
R_DOT, R_DDOT = jnp.array(RNG.normal(size=3)), jnp.array(RNG.normal(size=3))


def test_the_printed_forms():
    a0, a1, a2, a3 = np.array(ALPHA)
    at = [[a0, a1, a2, a3], [-a1, a0, a3, -a2], [-a2, -a3, a0, a1], [-a3, a2, -a1, a0]]
    tat = [[a0, -a1, -a2, -a3], [a1, a0, a3, -a2], [a2, -a3, a0, a1], [a3, a2, -a1, a0]]
    np.testing.assert_array_equal(matrices.at(ALPHA), at)
    np.testing.assert_array_equal(matrices.tat(ALPHA), tat)
    np.testing.assert_array_equal(matrices.a(ALPHA), np.transpose(at))
    np.testing.assert_array_equal(matrices.ta(ALPHA), np.transpose(tat))
    r1, r2, r3 = np.array(R_DOT)
    r0 = [[0, r1, r2, r3], [-r1, 0, -r3, r2], [-r2, r3, 0, -r1], [-r3, -r2, r1, 0]]
    r0_prime = [[0, r1, r2, r3], [-r1, 0, r3, -r2], [-r2, -r3, 0, r1], [-r3, r2, -r1, 0]]
    np.testing.assert_array_equal(matrices.r0(R_DOT), r0)
    np.testing.assert_array_equal(matrices.r0_prime(R_DOT), r0_prime)


@pytest.mark.parametrize("name", ["A_BASIS", "AT_BASIS", "TA_BASIS", "TAT_BASIS"])
def test_the_basis_is_monomial(name):
    basis = getattr(matrices, name)
    assert basis.shape == (4, 4, 4)
    assert set(np.unique(basis)) == {-1, 0, 1}
    np.testing.assert_array_equal(np.abs(basis).sum(axis=1), 1)
    np.testing.assert_array_equal(np.abs(basis).sum(axis=2), 1)
    function = getattr(matrices, name.removesuffix("_BASIS").lower())
    combination = sum(q * e for q, e in zip(np.array(ALPHA), basis, strict=True))
    np.testing.assert_array_equal(function(ALPHA), combination)


def test_left_transposition_exchanges_first_row_and_column():
    expected = np.array(matrices.a(ALPHA))
    expected[0], expected[:, 0] = expected[:, 0].copy(), expected[0].copy()
    np.testing.assert_array_equal(matrices.ta(ALPHA), expected)


@pytest.mark.parametrize("c", [1.0, -3.0, 1e-3])
def test_the_two_matrices_give_the_direction_cosines(c):
    """Aᵗ·ᵗAᵗ = |α|² diag(1, direction cosines), in either order."""
    q = c * ALPHA
    block = np.zeros((4, 4))
    block[0, 0], block[1:, 1:] = 1, rotation.to_dcm(q)
    expected = float(quaternion.norm_squared(q)) * block
    tolerance = ROUND_OFF * float(quaternion.norm_squared(q))
    np.testing.assert_allclose(matrices.at(q) @ matrices.tat(q), expected, rtol=0, atol=tolerance)
    np.testing.assert_allclose(matrices.tat(q) @ matrices.at(q), expected, rtol=0, atol=tolerance)


def test_cross_double_and_triple_products():
    once = np.cross(R_DOT, R_DDOT)
    twice = np.cross(R_DOT, once)
    thrice = np.cross(R_DOT, twice)
    half = 0.5 * np.array(matrices.r0(R_DOT) - matrices.r0_prime(R_DOT))
    column = np.concatenate([[0.0], R_DDOT])
    for power, expected in enumerate([once, twice, thrice], start=1):
        np.testing.assert_allclose(
            np.linalg.matrix_power(half, power) @ column, [0, *expected], rtol=ROUND_OFF, atol=ROUND_OFF
        )
        np.testing.assert_allclose(matrices.cross_repeated(R_DOT, R_DDOT, power), expected, rtol=ROUND_OFF)
    np.testing.assert_array_equal(matrices.cross(R_DOT), half)
    np.testing.assert_allclose(thrice, -np.dot(R_DOT, R_DOT) * once, rtol=ROUND_OFF)  # the printed expansion


def test_the_matrices_are_linear_and_keep_float32():
    np.testing.assert_array_equal(jax.jacfwd(matrices.a)(ALPHA), np.moveaxis(matrices.A_BASIS, 0, -1))
    assert matrices.tat(ALPHA.astype(jnp.float32)).dtype == jnp.float32
