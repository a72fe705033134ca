"""Enclosures of sums with square roots, against values with 40 digits."""

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from qtraj.algebra.cell_polynomial import cell_polynomial
from qtraj.algebra.cells import semi_axes
from qtraj.algebra.chebyshev_model import interpolated
from qtraj.algebra.rooted import RootSum

S, H = [1.0, 0.3, -0.25, 0.1, 0.02, -0.03, 0.01], [0.8, 0.2, -0.3, 0.1, 0.0, 0.02, 0.0]
CENTRE = 0.3125
POINTS = np.linspace(-1.0, 1.0, 9)
PRECISE = 5e-11


def exact(half):
    """√S + √H + √(SH) at points of the cell."""
    found = []
    for u in POINTS:
        s = mpmath.mpf(CENTRE) + mpmath.mpf(half) * mpmath.mpf(float(u))
        a, b = (mpmath.sqrt(mpmath.polyval(x, s, asc=True)) for x in (S, H))
        found.append(a + b + a * b)
    return found


@pytest.mark.parametrize("bits", [1, 4, 7, 10, 20])
def test_roots_are_enclosed_and_the_error_is_small_in_small_cells(bits):
    half = 2.0**-bits
    polynomial = cell_polynomial(jnp.asarray([S, H])[:, :, None, None], jnp.zeros((1, 1)))
    cell = jnp.full((1, 1), CENTRE), jnp.full((1, 1), half)
    models = polynomial.on(*cell)
    squares = models[0], models[1]
    total = RootSum((0, 1, 0, 0), squares) + RootSum((0, 0, 1, 0), squares) + RootSum((0, 0, 0, 1), squares)
    model = total.model(cell[1])
    c, error = interpolated(model, semi_axes(cell[1]))
    c, error = np.asarray(c)[:, 0, 0], float(error[0, 0])
    with mpmath.workdps(40):
        for u, value in zip(POINTS, exact(half), strict=True):
            found = mpmath.polyval([mpmath.mpf(float(x)) for x in c], mpmath.mpf(float(u)), asc=True)
            assert abs(found - value) <= error
    if bits > 2:
        assert error < PRECISE
