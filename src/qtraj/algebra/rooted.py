"""Functions with the square roots of two positive functions, as Chebyshev models.

Numbers a + b√S + c√H + d√(SH) can be added and multiplied without taking a root. The roots are enclosed only at the
end, in cells: q is the polynomial through their values at the nodes, and since √S − q = (S − q²)/(√S + q), a bound on
|S − q²| over a lower bound on q is one on the distance. A coefficient that is zero everywhere adds no error, so a sum
without roots is a model like any other.
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
"""The bits of the index of a coefficient: which roots it multiplies."""


class RootSum:
    """A number a + b√S + c√H + d√(SH); `coefficients` are models, or the integers 0 and 1."""

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
        """The product with a number of either sign that has the absolute uncertainty `error`."""
        one = self.squares[0].one()
        models = [
            a if is_zero(a) else scaled(one if isinstance(a, int) else a, factor, error) for a in self.coefficients
        ]
        return RootSum(models, self.squares)

    def model(self, half: Cells) -> ChebyshevModel:
        """The value as a model in cells of the half width `half`, which must be those of its coefficients."""
        S, H = self.squares
        first, *others = self.models()
        with_roots = jax.vmap(_times_root, in_axes=(0, 0, None))(_stacked(others), _stacked([S, H, S * H]), half)
        for k in range(3):
            first = first + jax.tree.map(lambda x, k=k: x[k], with_roots)
        return first

    def models(self) -> list[ChebyshevModel]:
        """The coefficients, all as models."""
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
    """`p` times a `factor` of either sign with the absolute uncertainty `error`."""
    size, bound = jnp.abs(factor) * p.size, (jnp.abs(factor) + error)[None] * p.bound * SLACK
    rounding = add_rounding(jnp.abs(factor) * p.error + error * (p.size + p.error), 1, size)
    return ChebyshevModel(factor[None] * p.values, size * SLACK, rounding, bound)


@jax.jit
def _times_root(b: ChebyshevModel, square: ChebyshevModel, half: Cells) -> ChebyshevModel:
    """b·√square, where `square` is nonnegative; its error is infinite where a root cannot be enclosed."""
    axes = semi_axes(half)
    values = jnp.sqrt(jnp.maximum(square.values, 0.0))
    a = jnp.tensordot(jnp.asarray(TO_CHEBYSHEV, values.dtype), values, 1, precision="highest")
    # q has exactly these values at the rounded nodes, so its coefficients are uncertain by the nodes' rounding as well.
    eps = float(np.finfo(values.dtype).eps)
    size = max_abs(values)
    rounding = 8 * NODES**2 * eps * size
    uncertain = jnp.abs(a) + rounding[None]
    # On an ellipse |T_k| is largest at the end of the long semi-axis.
    bound = jnp.sum(uncertain[:, None] * _chebyshev(axes), axis=0) * SLACK
    lowest = a[0] - jnp.sum(uncertain[1:], axis=0) - rounding
    q = ChebyshevModel(values, size, jnp.zeros_like(size), bound)
    rest = square - q * q
    coefficients, error = interpolated(rest, axes)
    largest = (jnp.sum(jnp.abs(coefficients), axis=0) * (1 + 2 * NODES * eps) + error) * SLACK
    distance = jnp.where(lowest > 0, largest / jnp.where(lowest > 0, lowest, 1.0), jnp.inf) * SLACK + TINY
    product = b * q
    widest = jnp.min(b.bound, axis=0)  # also between the nodes, since all ellipses contain the cell
    added = jnp.where(widest == 0, 0.0, widest * distance) * SLACK
    return ChebyshevModel(product.values, product.size, (product.error + added) * SLACK, product.bound)


def _chebyshev(x: Float[Array, "ellipses cells paths"]) -> Float[Array, "k ellipses cells paths"]:
    """T_0 … T_n at x ≥ 1, enlarged for rounding."""
    found = [jnp.ones_like(x), x]
    while len(found) < NODES:
        found.append(2 * x * found[-1] - found[-2])
    return jnp.stack(found) * (1 + 2.0**-30)
