"""Functions that contain the square roots of two positive functions S and H, as Chebyshev models.

Numbers a + b√S + c√H + d√(SH) can be added and multiplied without computing a root. The roots are enclosed only at the
end, in cells. Let q be the polynomial through the values of √S at the nodes. Since √S − q = (S − q²)/(√S + q), the
error |√S − q| is at most a bound on |S − q²| divided by a lower bound on q. A coefficient that is zero everywhere adds
no error, so a sum without roots is an ordinary model.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.cells import semi_axes
from qtraj.algebra.chebyshev_model import (
    NODES,
    SLACK,
    TINY,
    TO_CHEBYSHEV,
    ChebyshevModel,
    add_rounding,
    interpolated,
    max_abs,
)
from qtraj.algebra.sparse import add, is_zero, mul

Cells = Float[Array, "cells paths"]

ONE, ROOT_S, ROOT_H = 0, 1, 2
"""Bits of the index of a coefficient; a bit that is set means a factor √S or √H."""


class RootSum:
    """A number a + b√S + c√H + d√(SH) with two positive functions S and H.

    `coefficients` are a, b, c and d, each a model or the integer 0 or 1; `squares` are the models of S and H.
    """

    def __init__(self, coefficients: Sequence[Any], squares: tuple[ChebyshevModel, ChebyshevModel]):
        self.coefficients = tuple(coefficients)
        self.squares = squares

    def __add__(self, other: "RootSum") -> "RootSum":
        both = zip(self.coefficients, other.coefficients, strict=True)
        return RootSum([add([a, b]) for a, b in both], self.squares)

    def __sub__(self, other: "RootSum") -> "RootSum":
        pairs = zip(self.coefficients, other.coefficients, strict=True)
        return RootSum([_difference(a, b) for a, b in pairs], self.squares)

    def __mul__(self, other: "RootSum") -> "RootSum":
        found: list[Any] = [0, 0, 0, 0]
        for i, a in enumerate(self.coefficients):
            for j, b in enumerate(other.coefficients):
                product = mul(a, b)
                for bit, square in zip((ROOT_S, ROOT_H), self.squares, strict=True):
                    product = mul(product, square) if i & j & bit else product
                found[i ^ j] = add([found[i ^ j], product])
        return RootSum(found, self.squares)

    def scaled(self, factor: Any, error: Any) -> "RootSum":
        """Return the product with `factor`, a number of either sign with the absolute uncertainty `error`."""
        one = self.squares[0].one()
        models = [
            a if is_zero(a) else scaled(one if isinstance(a, int) else a, factor, error) for a in self.coefficients
        ]
        return RootSum(models, self.squares)

    def model(self, half: Cells) -> ChebyshevModel:
        """Return the sum as one model; `half` are the half widths of the cells of the coefficients."""
        S, H = self.squares
        first, *others = self.models()
        with_roots = jax.vmap(_times_root, in_axes=(0, 0, None))(_stacked(others), _stacked([S, H, S * H]), half)
        for k in range(3):
            first = first + jax.tree.map(lambda x, k=k: x[k], with_roots)
        return first

    def models(self) -> list[ChebyshevModel]:
        """Return all coefficients as models."""
        one = self.squares[0].one()
        return [_constant(one, a) if isinstance(a, int) else a for a in self.coefficients]


def _difference(a: Any, b: Any) -> Any:
    if is_zero(b):
        return a
    return _minus(b) if is_zero(a) else _less(a, b)


@jax.jit
def _minus(p: ChebyshevModel) -> ChebyshevModel:
    return -1 * p


@jax.jit
def _less(p: ChebyshevModel, q: ChebyshevModel) -> ChebyshevModel:
    return p - q


def _constant(one: ChebyshevModel, value: int) -> ChebyshevModel:
    return one if value else jax.tree.map(jnp.zeros_like, one)


def _stacked(models: Sequence[ChebyshevModel]) -> ChebyshevModel:
    return jax.tree.map(lambda *x: jnp.stack(x), *models)


@jax.jit
def scaled(p: ChebyshevModel, factor: Float[Array, "1 paths"], error: Float[Array, "1 paths"]) -> ChebyshevModel:
    """Return `p` multiplied by a `factor` of either sign with the absolute uncertainty `error`."""
    size, bound = jnp.abs(factor) * p.size, (jnp.abs(factor) + error)[None] * p.bound * SLACK
    rounding = add_rounding(jnp.abs(factor) * p.error + error * (p.size + p.error), 1, size)
    return ChebyshevModel(factor[None] * p.values, size * SLACK, rounding, bound)


@jax.jit
def _times_root(b: ChebyshevModel, square: ChebyshevModel, half: Cells) -> ChebyshevModel:
    """Return b·√square, where `square` is nonnegative; the error is infinite in cells where no bound was found."""
    axes = semi_axes(half)
    values = jnp.sqrt(jnp.maximum(square.values, 0.0))
    a = jnp.tensordot(jnp.asarray(TO_CHEBYSHEV, values.dtype), values, 1, precision="highest")
    # q is the polynomial with the computed coefficients that exceed the rounding error. The smaller coefficients are
    # only rounding errors, but on the large ellipses of small cells they would be multiplied by huge values of the
    # Chebyshev polynomials T_k.
    eps = float(np.finfo(values.dtype).eps)
    size = max_abs(values)
    rounding = 8 * NODES**2 * eps * size
    kept = jnp.abs(a) > rounding[None]
    magnitudes = jnp.where(kept, jnp.abs(a), 0.0)
    # At the rounded nodes q differs from `values` by the rounding of its coefficients and by the omitted coefficients.
    uncertainty = (rounding + jnp.sum(jnp.where(kept, 0.0, jnp.abs(a)), axis=0)) * SLACK
    # On an ellipse the magnitude of a Chebyshev polynomial is largest at the ends of the major axis.
    bound = jnp.sum(magnitudes[:, None] * _chebyshev(axes), axis=0) * SLACK
    lowest = a[0] - jnp.sum(magnitudes[1:], axis=0) - rounding
    q = ChebyshevModel(values, size, uncertainty, bound)
    rest = square - q * q
    coefficients, error = interpolated(rest, axes)
    largest = (jnp.sum(jnp.abs(coefficients), axis=0) * (1 + 2 * NODES * eps) + error) * SLACK
    distance = jnp.where(lowest > 0, largest / jnp.where(lowest > 0, lowest, 1.0), jnp.inf) * SLACK + TINY
    product = b * q
    widest = jnp.min(b.bound, axis=0)  # valid between the nodes too, because every ellipse contains the cell
    added = jnp.where(widest == 0, 0.0, widest * distance) * SLACK
    return ChebyshevModel(product.values, product.size, (product.error + added) * SLACK, product.bound)


def _chebyshev(x: Float[Array, "ellipses cells paths"]) -> Float[Array, "k ellipses cells paths"]:
    """Return the values of the Chebyshev polynomials T_0, …, T_(NODES−1) at x ≥ 1, increased to cover rounding."""
    found = [jnp.ones_like(x), x]
    while len(found) < NODES:
        found.append(2 * x * found[-1] - found[-2])
    return jnp.stack(found) * (1 + 2.0**-30)
