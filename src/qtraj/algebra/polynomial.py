"""Real polynomials in one variable, by their ascending coefficients: Σ c_k t^k.

Degrees are static and small, so the loops below unroll into a few multiplications and additions.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import Scalar, ScalarLike


def evaluate(coefficients: Float[Array, " n"], t: ScalarLike) -> Scalar:
    """The value at `t`, by Horner's rule."""
    return taylor(coefficients, t, 0)[0]


def taylor(coefficients: Float[Array, " n"], t: ScalarLike, order: int) -> Float[Array, " {order}+1"]:
    """Coefficients in s of the polynomial at t + s, up to s^order: the k-th derivative at `t` divided by k!.

    Orders above the degree are zero.
    """
    return jnp.stack([jnp.asarray(c, coefficients.dtype) for c in terms(coefficients, t, order)])


def terms(coefficients: Float[Array, "n *rest"], t: ScalarLike, order: int) -> list[Any]:
    """As `taylor`, one number each: what is computed from them then stays apart, which compiles to faster loops.

    Repeated synthetic division (Ruffini–Horner). Orders above the degree are the integer 0, so that what is computed
    from them can be left out. Polynomials side by side, each coefficient an array, are taken together.
    """
    c = [x.reshape(x.shape[1:]) for x in jax.lax.split(coefficients, (1,) * coefficients.shape[0])]
    t = as_float(t).astype(coefficients.dtype)
    for k in range(min(order + 1, len(c) - 1)):
        for i in range(len(c) - 2, k - 1, -1):
            c[i] = c[i] + t * c[i + 1]
    return [*c[: order + 1], *[0] * (order + 1 - len(c))]


def product(p: Float[Array, " n"], q: Float[Array, " m"]) -> Float[Array, " n+m-1"]:
    """Coefficients of the product of two polynomials."""
    return jnp.convolve(p, q)


def derivative(coefficients: Float[Array, " n"]) -> Float[Array, " m"]:
    """Coefficients of dp/dt; the derivative of a constant is the constant zero."""
    n = coefficients.shape[0]
    if n == 1:
        return jnp.zeros_like(coefficients)
    return coefficients[1:] * jnp.arange(1, n, dtype=coefficients.dtype)


def hermite(start: Float[Array, " m"], end: Float[Array, " n"], duration: ScalarLike) -> Float[Array, " m+n"]:
    """The polynomial of least degree with given value and derivatives at both ends of [0, duration].

    `start[k]` and `end[k]` are the k-th derivatives in t at 0 and at `duration`: two of each give the cubic of
    paper S (its ρ2, ρ3 with the sign of ρ3 corrected), three of each a quintic.
    """
    m, n = start.shape[0], end.shape[0]
    duration = as_float(duration).astype(start.dtype)
    if m == n == 2:
        return _cubic(start, end, duration)
    a = start * _unit_scales(m, duration)
    b = end * _unit_scales(n, duration)
    # In u = t/duration: p(u) = a(u) + u^m q(u), where q is fixed by its Taylor series about u = 1.
    gap = b - taylor(a, 1.0, n - 1)
    series = [(-1) ** j * math.comb(m + j - 1, j) for j in range(n)]  # (1 + s)^(-m)
    about_one = jnp.stack([sum(series[j] * gap[k - j] for j in range(k + 1)) for k in range(n)])
    c = jnp.concatenate([a, taylor(about_one, -1.0, n - 1)])
    return c / duration ** jnp.arange(m + n, dtype=c.dtype)


def _cubic(start: Float[Array, " 2"], end: Float[Array, " 2"], duration: Scalar) -> Float[Array, " 4"]:
    """`hermite` of values and slopes, written out: most paths are made of these."""
    mean = (end[0] - start[0]) / duration
    second = (3 * mean - 2 * start[1] - end[1]) / duration
    third = (start[1] + end[1] - 2 * mean) / duration**2
    return jnp.stack([start[0], start[1], second, third])


def _unit_scales(count: int, duration: Scalar) -> Float[Array, " count"]:
    """duration^k / k!: turns derivatives in t into Taylor coefficients in t/duration."""
    return jnp.stack([duration**k / math.factorial(k) for k in range(count)])
