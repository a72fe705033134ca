"""Evaluate Lagrange basis polynomials and their derivatives."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.namespace import xp


def lagrange(x: Float[Array, "*batch"], knots: Float[Array, "*batch w"]) -> Float[Array, "*batch w"]:
    """Return the values (w,) at `x` of the Lagrange basis polynomials of the `knots`; the arguments are broadcast.

    Values and derivatives are computed as products without divisions by x − x_k, so that they are finite at the knots.
    """
    before, after = _products(_differences(x, knots), 1.0, _times)
    return xp.stack([p * q for p, q in zip(before, after, strict=True)], axis=-1) / _denominators(knots)


def lagrange_slopes(x: Float[Array, "*batch"], knots: Float[Array, "*batch w"]) -> Float[Array, "*batch w"]:
    """Return the derivatives (w,) of the values of `lagrange` in x."""
    factors = [(d, 1.0) for d in _differences(x, knots)]
    before, after = _products(factors, (1.0, 0.0), _times_with_slope)
    slopes = [p[1] * q[0] + p[0] * q[1] for p, q in zip(before, after, strict=True)]
    return xp.stack([slope + 0 * factors[0][0] for slope in slopes], axis=-1) / _denominators(knots)


def _differences(x: Any, knots: Any) -> list[Any]:
    return [x - knots[..., k] for k in range(knots.shape[-1])]


def _denominators(knots: Float[Array, "*batch w"]) -> Float[Array, "*batch w"]:
    """Return the products of x_j − x_k over all k ≠ j."""
    same = np.eye(knots.shape[-1], dtype=bool)[(None,) * (knots.ndim - 1)]
    return xp.prod(xp.where(same, 1.0, knots[..., :, None] - knots[..., None, :]), axis=-1)


def _products(factors: list[Any], one: Any, times: Any) -> tuple[list[Any], list[Any]]:
    """Return, for each factor, the product of all previous factors and the product of all later factors."""
    before, after = [one], [one]
    for k in range(len(factors) - 1):
        before.append(times(before[-1], factors[k]))
        after.append(times(factors[-1 - k], after[-1]))
    return before, after[::-1]


def _times(a: Any, b: Any) -> Any:
    return a * b


def _times_with_slope(a: Any, b: Any) -> Any:
    """Return the product of two functions with values and derivatives."""
    return a[0] * b[0], a[1] * b[0] + a[0] * b[1]
