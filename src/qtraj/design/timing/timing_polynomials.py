"""Return the timing a = u̇² of each cell, and its derivatives, as polynomials with error bounds for the proof."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.algebra.chebyshev_model import ChebyshevModel

RADIUS, DEGREE = 17.0, 3
"""Radius of a disc that contains the ellipses of semi-axis 16 about a whole cell, and the degree of a."""


def scaled(p: CellPolynomial, factor: Float[Array, " cells"]) -> CellPolynomial:
    """Return the polynomials multiplied by powers of two; the products are exact."""
    return CellPolynomial(
        p.coefficients * factor[None, None, None], p.shifts * factor[None, None, None, None], p.error * factor[None]
    )


def on_wide_ellipses(p: ChebyshevModel) -> ChebyshevModel:
    """Return the model with bounds that include the errors on the ellipses about a whole cell.

    `CellPolynomial.on` bounds the polynomials on the small ellipses about subcells, where the errors are smaller.
    """
    return eqx.tree_at(lambda x: x.bound, p, p.bound + RADIUS**DEGREE * p.error[None])


def of_timing(
    coefficients: Float[Array, "cells 4"], at_rest: Bool[Array, " 2"]
) -> tuple[list[CellPolynomial], CellPolynomial]:
    """Return a = u̇² and two derivatives of a as polynomials in the position s in the cell, −1 ≤ s ≤ 1.

    The derivatives are with respect to s. Also return a divided by its factor that vanishes at an end at rest.
    """
    c0, c1, c2, c3 = coefficients.T  # powers of (1 + s)/2
    start, end = at_rest
    zero = jnp.zeros_like(c0)
    first, last = jnp.arange(c0.size) == 0, jnp.arange(c0.size) == c0.size - 1
    powers = jnp.stack([c0, c1, c2, c3])
    after_start = jnp.stack([c1, c2, c3, zero])
    before_end = jnp.stack([-(c1 + c2 + c3), -(c2 + c3), -c3, zero])
    rest = jnp.where(first & start, after_start, jnp.where(last & end, before_end, powers))
    forms = powers, jnp.stack([c1, 2 * c2, 3 * c3]) / 2, jnp.stack([2 * c2, 6 * c3]) / 4
    return [_centred(form) for form in forms], _centred(rest)


def _centred(powers: Float[Array, "k cells"]) -> CellPolynomial:
    """Convert powers of (1 + s)/2 to powers of s, with a bound on the rounding errors."""
    n = powers.shape[0] - 1
    matrix = np.zeros((n + 1, n + 1))
    for k in range(n + 1):
        matrix[: k + 1, k] = np.polynomial.polynomial.polypow([0.5, 0.5], k)
    form = jnp.sum(jnp.asarray(matrix)[:, :, None] * powers[None], axis=1)
    size = jnp.sum(jnp.abs(powers), axis=0)
    return cell_polynomial(form[None, :, None], (32 * float(np.finfo(powers.dtype).eps) * size)[None])
