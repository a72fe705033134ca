"""Vector polynomials on [−1, 1], for many paths at once, as Chebyshev models in cells (subintervals)."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.cells import Cells, semi_axes
from qtraj.algebra.chebyshev_model import AXIS, MIN_SIZE, POINTS, SLACK, ChebyshevModel, add_rounding
from qtraj.algebra.polynomial import horner

ELLIPSES_RADIUS = 3.0
"""Radius of a disc about 0 that contains the ellipses of all cells whose half width is at most 1/8."""


class CellPolynomial(eqx.Module):
    """A vector of polynomials with ascending `coefficients`; the axis of length k contains the powers.

    `shifts[l]` contains the coefficients of the l-th derivative divided by l!. In each component, `error` bounds the
    sum of the errors of the coefficients, also after a change to the scaled variable of a cell.
    """

    coefficients: Float[Array, "axes k 1 paths"]
    shifts: Float[Array, "k axes k 1 paths"]
    error: Float[Array, "1 paths"]

    def on(self, centre: Cells, half: Cells) -> ChebyshevModel:
        """Return the model in the cells `centre` ± `half` of [−1, 1]; `half` must be a power of two."""
        return _shifted(self, centre, half)

    def at(self, s: Cells) -> tuple[Array, ...]:
        """Return the values of the components at `s`."""
        return _values(self.coefficients, s)


def cell_polynomial(coefficients: Float[Array, "axes k 1 paths"], error: Float[Array, "1 paths"]) -> CellPolynomial:
    """Create polynomials with uncertain coefficients; in each component, `error` bounds the sum of their errors."""
    size = jnp.max(jnp.sum(jnp.abs(coefficients), axis=AXIS), axis=0)
    return CellPolynomial(coefficients, _shifts(coefficients), add_rounding(error, 2 * coefficients.shape[AXIS], size))


@jax.jit
def _shifts(coefficients: Float[Array, "axes k 1 paths"]) -> Array:
    """Return an array whose row l contains the coefficients of the l-th derivative divided by l!."""
    n = coefficients.shape[AXIS] - 1
    weights = jnp.asarray(_binomials(n), coefficients.dtype)[:, :, None, None]
    rows = [jnp.pad(coefficients[:, k:], [(0, 0), (0, k), (0, 0), (0, 0)]) for k in range(n + 1)]
    return weights[:, None] * jnp.stack(rows)


@jax.jit
def _shifted(p: CellPolynomial, centre: Cells, half: Cells) -> ChebyshevModel:
    c: Any = horner(list(p.shifts), centre[None, None])
    powers = [jnp.ones_like(half)]
    for _ in range(c.shape[AXIS] - 1):
        powers.append(powers[-1] * half)
    c = c * jnp.stack(powers)[None]
    degree = c.shape[AXIS] - 1
    sizes, radii = jnp.max(jnp.abs(c), axis=0), semi_axes(half)
    points = jnp.asarray(POINTS, c.dtype)[None, :, None, None]
    values = horner([*(c[:, k : k + 1] for k in range(degree)), c[:, -1:] * jnp.ones_like(points)], points)
    bound = horner([*(sizes[k][None] for k in range(degree)), sizes[-1][None] * jnp.ones_like(radii)], radii)
    size = jnp.sum(sizes, axis=0) * SLACK + MIN_SIZE
    error = add_rounding(p.error, 2 * c.shape[AXIS], size)
    return ChebyshevModel(values, size, error, (bound + ELLIPSES_RADIUS**degree * error[None]) * SLACK)


@jax.jit
def _values(coefficients: Float[Array, "axes k 1 paths"], s: Cells) -> tuple[Array, ...]:
    return tuple(horner([*c[:-1], c[-1] + jnp.zeros_like(s)], s) for c in coefficients)


def _binomials(n: int) -> np.ndarray:
    """Return a matrix with the binomial coefficient C(k+l, l) in row l and column k, or 0 if k + l > n."""
    return np.array([[math.comb(k + j, j) if k + j <= n else 0 for k in range(n + 1)] for j in range(n + 1)], float)
