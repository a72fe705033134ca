"""Real polynomials Σ c_k t^k in one variable, represented by their ascending coefficients c_k.

The degrees are static and small, so the loops unroll into a few multiplications and additions.
"""

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.sparse import is_zero
from qtraj.foundation.arrays import as_float
from qtraj.foundation.namespace import is_host, xp
from qtraj.foundation.types import Scalar, ScalarLike


def evaluate(coefficients: Float[Array, " n"], t: ScalarLike) -> Scalar:
    """Return the value of the polynomial at `t`, by Horner's rule."""
    return taylor(coefficients, t, 0)[0]


def taylor(coefficients: Float[Array, " n"], t: ScalarLike, order: int) -> Float[Array, " {order}+1"]:
    """Return the Taylor coefficients at `t`, (order+1,): the k-th derivative at `t` divided by k!.

    Coefficients of orders above the degree are zero.
    """
    terms = split_taylor(coefficients, t, order)
    zero = xp.zeros_like(terms[0])
    return xp.stack([zero if is_zero(c) else c for c in terms])


def split_taylor(coefficients: Float[Array, "n *rest"], t: ScalarLike, order: int) -> list[Any]:
    """Return the result of `taylor` as a list, because XLA compiles expressions of separate numbers to faster loops.

    Coefficients of orders above the degree are the integer 0. Additional axes of `coefficients` represent separate
    polynomials.
    """
    if is_host(coefficients, t):
        return taylor_terms(list(coefficients), np.asarray(t, float), order)
    t = as_float(t).astype(coefficients.dtype)
    c = [x.reshape(x.shape[1:]) for x in jax.lax.split(jnp.asarray(coefficients), (1,) * coefficients.shape[0])]
    return taylor_terms(c, t, order)


def horner(coefficients: Sequence[Any], t: Any) -> Any:
    """Return the value at `t` of a polynomial whose coefficients are numbers or arrays that broadcast with `t`."""
    return taylor_terms(coefficients, t, 0)[0]


def taylor_terms(coefficients: Sequence[Any], t: Any, order: int) -> list[Any]:
    """Return the Taylor coefficients at `t`, orders 0 … `order`, from coefficients that broadcast with `t`.

    The method is repeated synthetic division (Ruffini–Horner). Coefficients of orders above the degree are the integer
    0, so that the caller can omit their terms.
    """
    c = list(coefficients)
    for k in range(min(order + 1, len(c) - 1)):
        for i in range(len(c) - 2, k - 1, -1):
            c[i] = c[i] + t * c[i + 1]
    return [*c[: order + 1], *[0] * (order + 1 - len(c))]


def hermite(start: Float[Array, " m"], end: Float[Array, " n"], duration: ScalarLike) -> Float[Array, " m+n"]:
    """Return the polynomial of lowest degree with given values and derivatives at both ends of [0, duration].

    `start[k]` and `end[k]` are the k-th derivatives with respect to t at 0 and at `duration`. Two numbers at each end
    yield the cubic of paper S, with the sign of its coefficient ρ3 corrected. Three numbers at each end yield a
    quintic.
    """
    m, n = start.shape[0], end.shape[0]
    duration = xp.asarray(duration, start.dtype)
    if m == n == 2:
        return _cubic(start, end, duration)
    a = start * _unit_scales(m, duration)
    b = end * _unit_scales(n, duration)
    # With u = t/duration, the polynomial is a(u) + u^m q(u). The data at the end determine the Taylor series of q about
    # u = 1.
    difference = b - taylor(a, 1.0, n - 1)
    series = [(-1) ** j * math.comb(m + j - 1, j) for j in range(n)]  # Taylor coefficients of u^(-m) about u = 1
    about_one = xp.stack([sum(series[j] * difference[k - j] for j in range(k + 1)) for k in range(n)])
    c = xp.concatenate([a, taylor(about_one, -1.0, n - 1)])
    return c / duration ** np.arange(m + n).astype(c.dtype)


def _cubic(start: Float[Array, " 2"], end: Float[Array, " 2"], duration: Any) -> Float[Array, " 4"]:
    """Return the cubic with given values and slopes at both ends, the most common case of `hermite`, in closed form."""
    mean = (end[0] - start[0]) / duration
    second = (3 * mean - 2 * start[1] - end[1]) / duration
    third = (start[1] + end[1] - 2 * mean) / duration**2
    return xp.stack([start[0], start[1], second, third])


def _unit_scales(count: int, duration: Any) -> Float[Array, " count"]:
    """Return duration^k / k! for k < `count`, which converts derivatives in t to Taylor coefficients in t/duration."""
    return xp.stack([duration**k / math.factorial(k) for k in range(count)])
