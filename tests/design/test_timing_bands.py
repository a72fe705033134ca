"""The linear systems of the search for a timing, against NumPy's dense solver."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.design.timing import banded, banded_batch
from qtraj.design.timing.spline import gathered, gathered_band, nodes

SIZES = (19, 131, 515, 1027, 2500)  # every size of blocks; the last has separators for which LAPACK is not used


def band_of(n, seed):
    """Columns of a positive definite matrix with three subdiagonals, without entries before the first column."""
    rng = np.random.default_rng(seed)
    band = np.concatenate([rng.uniform(-0.4, 0.4, (3, n)), rng.uniform(1.5, 2.5, (1, n))])
    for k in range(3):
        band[k, : 3 - k] = 0.0
    return band


def dense(band):
    """The whole matrix: column i of `band` has the entries (i, i − 3) to (i, i)."""
    n = band.shape[1]
    lower = np.sum([np.diag(band[3 - k, k:], -k) for k in range(1, 4)], axis=0)
    return lower + lower.T + np.diag(band[3, :n])


@pytest.mark.parametrize("solver", [banded, banded_batch])
@pytest.mark.parametrize("n", SIZES)
def test_a_band_system_has_the_solution_of_the_dense_matrix(solver, n):
    band, right = band_of(n, n), np.random.default_rng(0).normal(size=n)
    found = jax.jit(lambda b, r: solver.solve(solver.factor(b), r))(jnp.asarray(band), jnp.asarray(right))
    np.testing.assert_allclose(found, np.linalg.solve(dense(band), right), rtol=0, atol=1e-13 * np.abs(right).max())


def test_the_matrix_of_a_step_is_the_sum_over_the_nodes():
    """Each column is the gathered product of the second derivatives at the nodes with a unit vector's values."""
    own = nodes(np.array([0.0, 1.0, 1.5, 2.5, 4.0, 4.5, 5.0]), (False, False))
    rng = np.random.default_rng(3)
    parts = [[jnp.asarray(rng.normal(size=(2, 7))) for _ in range(i + 1)] for i in range(3)]
    whole = jnp.stack([jnp.stack([parts[max(i, j)][min(i, j)] for j in range(3)]) for i in range(3)])
    bands = np.asarray(gathered_band(own, parts))
    for j in range(9):
        local = np.stack([np.pad(np.eye(9)[j], (0, 1))[k : k + 7] for k in range(4)])
        v = np.einsum("okdn,kn->odn", own.basis, local)
        column = gathered(own, list(jnp.einsum("iodn,odn->idn", whole, v)))
        for d in range(4):
            if j + d < 9:
                np.testing.assert_allclose(bands[d, j + d], column[j + d], rtol=0, atol=1e-12)
