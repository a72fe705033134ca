"""Chebyshev models: the results of their arithmetic stay within the error bounds, in cells of any size."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from qtraj.algebra.cell_polynomial import cell_polynomial
from qtraj.algebra.cells import semi_axes
from qtraj.algebra.chebyshev_model import NODES, POINTS, TO_CHEBYSHEV, interpolated, multiple

CELLS = [(0.0, 0.125), (0.875, 0.125), (-0.375, 2.0**-7), (0.625, 2.0**-20)]
PLACES = np.linspace(-1.0, 1.0, 7)
DIGITS = 60


def vectors(degree, seed, error=0.0):
    """A random vector of polynomials, as models and as exact coefficients."""
    coefficients = np.random.default_rng(seed).normal(size=(3, degree + 1))
    model = cell_polynomial(jnp.asarray(coefficients)[:, :, None, None], jnp.full((1, 1), error))
    return model, [[mpmath.mpf(float(x)) for x in row] for row in coefficients]


def exact(row, s):
    return mpmath.fsum(x * s**k for k, x in enumerate(row))


def require_enclosed(build, truth, scale=1.0, tight=1e-11):
    """The model from `build` differs from the exact function by less than its bound, and the bound is small."""
    for centre, half in CELLS:
        cell = jnp.full((1, 1), centre), jnp.full((1, 1), half)
        coefficients, error = jax.jit(lambda *cell: interpolated(build(*cell), semi_axes(cell[1])))(*cell)
        assert float(error[0, 0]) < tight * scale or half > 0.1, "only in wide cells may the bound be large"
        with mpmath.workdps(DIGITS):
            own = [mpmath.mpf(float(x)) for x in coefficients[:, 0, 0]]
            for u in PLACES:
                s = mpmath.mpf(centre) + mpmath.mpf(half) * mpmath.mpf(float(u))
                assert abs(exact(own, mpmath.mpf(float(u))) - truth(s)) <= float(error[0, 0]), (centre, half, u)


def test_nodes_and_their_matrix_are_exact_to_rounding():
    with mpmath.workdps(DIGITS):
        for j, x in enumerate(POINTS):
            assert abs(float(x) - mpmath.cos(mpmath.pi * (2 * j + 1) / (2 * NODES))) < 2.0**-53
            for k in range(NODES):
                entry = mpmath.cos(mpmath.pi * k * (2 * j + 1) / (2 * NODES)) * (2 if k else 1) / NODES
                assert abs(float(TO_CHEBYSHEV[k, j]) - entry) < 2 * 2.0**-53 / NODES * (2 if k else 1)


@pytest.mark.parametrize(("m", "n"), [(0, 3), (3, 3), (5, 11), (11, 11)])
def test_products_and_sums_stay_within_their_bounds(m, n):
    (p, exact_p), (q, exact_q) = vectors(m, 1), vectors(n, 2)

    def build(*cell):
        a, b = p.on(*cell), q.on(*cell)
        return (a @ b) * (a[0] + b[1]) - 3 * b[2]

    def truth(s):
        a, b = [exact(row, s) for row in exact_p], [exact(row, s) for row in exact_q]
        return sum(x * y for x, y in zip(a, b, strict=True)) * (a[0] + b[1]) - 3 * b[2]

    require_enclosed(build, truth, scale=(3 * m + 3) ** 2 * (3 * n + 3) ** 2)


def test_vector_products_and_high_powers():
    (p, exact_p), (q, exact_q) = vectors(4, 3), vectors(4, 4)

    def build(*cell):
        c = p.on(*cell).cross(q.on(*cell))
        return (c @ c) * (c @ c)

    def truth(s):
        a, b = [exact(row, s) for row in exact_p], [exact(row, s) for row in exact_q]
        c = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
        return sum(x * x for x in c) ** 2

    require_enclosed(build, truth, scale=1e6)


def test_errors_of_the_coefficients_are_propagated():
    """Coefficients with errors up to 1e-6 give bounds that include the shifted values."""
    (p, exact_p), (q, exact_q) = vectors(3, 5, error=1e-6), vectors(3, 6)
    exact_p = [[x + mpmath.mpf(1e-6) / 4 for x in row] for row in exact_p]
    factor, uncertainty = jnp.full((1, 1), 2.0), jnp.full((1, 1), 1e-7)

    def build(*cell):
        return multiple(p.on(*cell)[0] * q.on(*cell)[1], factor, uncertainty) + q.on(*cell)[2].one()

    require_enclosed(build, lambda s: 2 * exact(exact_p[0], s) * exact(exact_q[1], s) + 1, scale=1e7)
    require_enclosed(build, lambda s: (2 + 1e-7) * exact(exact_p[0], s) * exact(exact_q[1], s) + 1, scale=1e7)


def test_a_model_with_an_infinite_error_has_no_finite_bound():
    p, _ = vectors(3, 7, error=np.inf)
    cell = jnp.zeros((1, 1)), jnp.full((1, 1), 0.125)
    _, error = interpolated(p.on(*cell)[0], semi_axes(cell[1]))
    assert not float(error[0, 0]) < np.inf
