"""Vectors of polynomials on [−1, 1], side by side for many paths, as Chebyshev models in cells."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.cells import Cells, semi_axes
from qtraj.algebra.chebyshev_model import AXIS, FLOOR, POINTS, SLACK, ChebyshevModel, add_rounding

FARTHEST = 3.0
"""No ellipse about a cell of at most an eighth of [−1, 1] leaves the disc of this radius."""


class CellPolynomial(eqx.Module):
    """Components with ascending `coefficients`; those of the derivatives over l! in `shifts`.

    `error` bounds the sum of the errors of the coefficients of a component, about any centre.
    """

    coefficients: Float[Array, "axes k 1 paths"]
    shifts: Float[Array, "k axes k 1 paths"]
    error: Float[Array, "1 paths"]

    def on(self, centre: Cells, half: Cells) -> ChebyshevModel:
        """It in cells `centre` ± `half` of [−1, 1], which must be exact in binary: powers of a half width are, too."""
        return _shifted(self, centre, half)

    def at(self, s: Cells) -> tuple[Array, ...]:
        """The components at instants s."""
        return _valued(self.coefficients, s)


def cell_polynomial(coefficients: Float[Array, "axes k 1 paths"], error: Float[Array, "1 paths"]) -> CellPolynomial:
    """Polynomials whose coefficients have errors that sum up to at most `error` in each component."""
    size = jnp.max(jnp.sum(jnp.abs(coefficients), axis=AXIS), axis=0)
    return CellPolynomial(coefficients, _shifts(coefficients), add_rounding(error, 2 * coefficients.shape[AXIS], size))


@jax.jit
def _shifts(coefficients: Float[Array, "axes k 1 paths"]) -> Array:
    """All Taylor coefficients: row l holds those of the l-th derivative over l!."""
    n = coefficients.shape[AXIS] - 1
    weights = jnp.asarray(_binomials(n), coefficients.dtype)[:, :, None, None]
    rows = [jnp.pad(coefficients[:, k:], [(0, 0), (0, k), (0, 0), (0, 0)]) for k in range(n + 1)]
    return weights[:, None] * jnp.stack(rows)


@jax.jit
def _shifted(p: CellPolynomial, centre: Cells, half: Cells) -> ChebyshevModel:
    c: Any = p.shifts[-1]
    for shift in reversed([p.shifts[k] for k in range(p.shifts.shape[0] - 1)]):
        c = c * centre[None, None] + shift
    powers = [jnp.ones_like(half)]
    for _ in range(c.shape[AXIS] - 1):
        powers.append(powers[-1] * half)
    c = c * jnp.stack(powers)[None]
    sizes, far = jnp.max(jnp.abs(c), axis=0), semi_axes(half)
    points = jnp.asarray(POINTS, c.dtype)[None, :, None, None]
    values, bound = c[:, -1:] * jnp.ones_like(points), sizes[-1][None] * jnp.ones_like(far)
    for k in reversed(range(c.shape[AXIS] - 1)):
        values, bound = values * points + c[:, k : k + 1], bound * far + sizes[k][None]
    size = jnp.sum(sizes, axis=0) * SLACK + FLOOR
    error = add_rounding(p.error, 2 * c.shape[AXIS], size)
    return ChebyshevModel(values, size, error, (bound + FARTHEST ** (c.shape[AXIS] - 1) * error[None]) * SLACK)


@jax.jit
def _valued(coefficients: Float[Array, "axes k 1 paths"], s: Cells) -> tuple[Array, ...]:
    found = []
    for c in coefficients:
        value = c[-1] + jnp.zeros_like(s)
        for k in reversed(range(c.shape[0] - 1)):
            value = value * s + c[k]
        found.append(value)
    return tuple(found)


def _binomials(n: int) -> np.ndarray:
    """C(k+l, l) over l and k, 0 … n; 0 where k + l > n."""
    return np.array([[math.comb(k + j, j) if k + j <= n else 0 for k in range(n + 1)] for j in range(n + 1)], float)
