"""The linear systems of the search for a timing, against NumPy's dense solver."""

import numpy as np
import pytest

from qtraj.design.solve.band import factor, solve
from qtraj.design.timing.spline import gathered, gathered_band, nodes

SIZES = (19, 131, 515)


def bands_of(batch, n, seed):
    """Positive definite matrices with three subdiagonals: row i has the entries (i, i − 3) to (i, i)."""
    rng = np.random.default_rng(seed)
    band = np.concatenate([rng.uniform(-0.4, 0.4, (batch, n, 3)), rng.uniform(1.5, 2.5, (batch, n, 1))], axis=2)
    for k in range(3):
        band[:, : 3 - k, k] = 0.0
    return band


def dense(band):
    """The whole matrix of the rows of a band."""
    lower = np.sum([np.diag(band[k:, 3 - k], -k) for k in range(1, 4)], axis=0)
    return lower + lower.T + np.diag(band[:, 3])


@pytest.mark.parametrize("n", SIZES)
def test_a_batch_of_band_systems_has_the_solutions_of_the_dense_matrices(n):
    band, right = bands_of(3, n, n), np.random.default_rng(0).normal(size=(3, n))
    expected = [np.linalg.solve(dense(own), b) for own, b in zip(band, right, strict=True)]
    found = solve(factor(band.copy()), right)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(right).max())


@pytest.mark.parametrize("bad", [np.nan, -1.0])
def test_a_matrix_that_is_not_positive_definite_does_not_affect_the_others(bad):
    band, right = bands_of(4, 20, 1), np.random.default_rng(0).normal(size=(4, 20))
    expected = [np.linalg.solve(dense(own), b) for own, b in zip(band, right, strict=True)]
    band[2, 5, 3] = bad
    found = solve(factor(band), right)
    assert np.isnan(found[2]).all()
    np.testing.assert_allclose(np.delete(found, 2, axis=0), np.delete(expected, 2, axis=0), rtol=0, atol=1e-12)


def test_the_matrix_of_a_step_is_the_sum_over_the_nodes():
    """Each column is the gathered product of the second derivatives at the nodes with a unit vector's values."""
    own = nodes(np.array([0.0, 1.0, 1.5, 2.5, 4.0, 4.5, 5.0]), (False, False))
    half = np.random.default_rng(3).normal(size=(3, 3, 2, 7))
    whole = half + half.swapaxes(0, 1)
    bands = np.asarray(gathered_band(own, whole[np.tril_indices(3)]))
    for j in range(9):
        local = np.stack([np.pad(np.eye(9)[j], (0, 1))[k : k + 7] for k in range(4)])
        v = np.einsum("okdn,kn->odn", own.basis, local)
        column = gathered(own, np.einsum("iodn,odn->idn", whole, v))
        for d in range(4):
            if j + d < 9:
                np.testing.assert_allclose(bands[d, j + d], column[j + d], rtol=0, atol=1e-12)
