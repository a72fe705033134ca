"""Compute with the segments of routes: polynomials with values (3,), represented by plain arrays.

Segment i has ascending coefficients `c[i]` (terms, 3) in t − start_i. The functions accept NumPy arrays and, inside a
trace, JAX arrays. The number of segments is padded to one of a few sizes, so that routes of similar length share
executables. The padding has infinite start times and zero coefficients, so no search for a time selects it.
"""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import of_arrays, xp
from qtraj.foundation.types import Scalar

TERMS = (6, 8)
"""Possible numbers of stored coefficients, for quintics and for septics."""

MIN_ROWS = 8
"""Smallest padded number of segments; larger padded numbers are powers of two."""


BLOCK_SIZE = 4096
"""Number of instants that are computed together in NumPy: their data fit into the cache of the processor."""


def arithmetic(*arrays: Any) -> Any:
    """Return the module `numpy` if all arrays are concrete, otherwise `jax.numpy`."""
    return jnp if is_traced(arrays) else np


def padded_size(count: int) -> int:
    """Return the number of segments after padding."""
    return max(MIN_ROWS, 1 << (count - 1).bit_length())


def padded(starts: Any, c: Any) -> tuple[Any, Any]:
    """Pad `starts` (n,) and `c` (n, terms, 3) to a padded number of segments, and to a number of terms in `TERMS`."""
    np_ = arithmetic(starts, c)
    rows = padded_size(starts.shape[0]) - starts.shape[0]
    terms = next(n for n in TERMS if n >= c.shape[1]) - c.shape[1]
    return (
        np_.concatenate([starts, np_.full((rows,), np.inf, starts.dtype)]),
        np_.pad(c, [(0, rows), (0, terms), (0, 0)]),
    )


def hermite(h: Any, states: Any, sense: Any = None) -> Any:
    """Return the coefficients (n, terms, 3) of segments that connect the joint states (n + 1, orders, 3).

    `h` (n,) are the durations. The axes of the states are the joint, the order of the derivative, and the coordinate.
    Three orders, position to acceleration, yield quintics; four orders, position to jerk, yield septics.

    `sense` (n,), 1 or −1, is the direction of a segment: with −1, it passes through both states backwards in time, so
    its derivatives of odd orders are those of the states with the opposite sign.
    """
    if sense is not None:
        c = hermite(h * sense, states)
        return c * (sense[:, None] ** np.arange(c.shape[1]))[:, :, None]
    a, b, h = states[:-1], states[1:], h[:, None]
    orders = states.shape[1]
    low = [a[:, k] / math.factorial(k) for k in range(orders)]
    # Subtract the Taylor polynomial about the start, evaluated at the end, from the end state. The factor h**k converts
    # the difference of the k-th derivatives to a length.
    gaps = []
    for k in range(orders):
        reached = [math.comb(j, k) * math.factorial(k) * low[j] * h ** (j - k) for j in range(k + 1, orders)]
        gaps.append(((b[:, k] - a[:, k]) - sum(reached, 0.0 * h)) * h**k)
    weights = _hermite_weights(orders)
    high = [sum(w * gap for w, gap in zip(row, gaps, strict=True)) / h ** (orders + i) for i, row in weights]
    return arithmetic(h, states).stack([*low, *high], axis=1)


def _hermite_weights(orders: int) -> Any:
    """Return pairs (i, weights) for `hermite`: coefficient orders + i is Σ_k weights[k]·gaps[k]/h^(orders + i).

    h is the duration of a segment. gaps[k] is h^k times the difference of the k-th derivatives of the end state and of
    the Taylor polynomial about the start.
    """
    quintic = ((10, -4, 1 / 2), (-15, 7, -1), (6, -3, 1 / 2))
    septic = ((35, -15, 5 / 2, -1 / 6), (-84, 39, -7, 1 / 2), (70, -34, 13 / 2, -1 / 2), (-20, 10, -2, 1 / 6))
    return enumerate(quintic if orders == 3 else septic)


def shifted(c: Any, s: Any) -> Any:
    """Return the coefficients (n, terms, 3) of `c` about the local times `s` (n,), computed by synthetic division."""
    terms = [c[:, k] for k in range(c.shape[1])]
    s = s[:, None]
    for k in range(len(terms) - 1):
        for i in range(len(terms) - 2, k - 1, -1):
            terms[i] = terms[i] + s * terms[i + 1]
    return arithmetic(c, s).stack(terms, axis=1)


def chosen(c: Any, i: Any) -> Any:
    """Return the coefficients (..., terms, 3) of the segments `i` (...) from those of all segments (n, terms, 3).

    In NumPy, the memory contains one contiguous array for each term and axis, which makes the arithmetic of `values`
    twice as fast.
    """
    if not isinstance(c, np.ndarray):
        return c[i]
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(c, 0, -1))[..., i], (0, 1), (-2, -1))


def values(c: Any, s: Any, order: int) -> list[Any]:
    """Return the values and derivatives (..., 3) of segments `c` (..., terms, 3) at local times `s` (...), as a list.

    The k-th entry of the list is the k-th derivative, k = 0 … `order`.
    """
    terms = [c[..., k, :] for k in range(c.shape[-2])]
    s = s[..., None]
    for k in range(min(order + 1, len(terms) - 1)):
        for i in range(len(terms) - 2, k - 1, -1):
            product = s * terms[i + 1]
            product += terms[i]  # in NumPy in place: large arrays take as long to allocate as to compute
            terms[i] = product
    results = [terms[k] if k < 2 else math.factorial(k) * terms[k] for k in range(min(order + 1, len(terms)))]
    return [*results, *[0.0 * terms[0]] * (order + 1 - len(results))]


def derivatives(c: np.ndarray, i: np.ndarray, s: np.ndarray, order: int) -> Float[np.ndarray, "{order} 3 ..."]:
    """Return the derivatives 1 to `order` of the segments `i` of `c` (n, terms, 3) at local times `s`, in NumPy.

    The shape of `s` is (m, ...), and `i` broadcasts to it. Instants are computed in blocks, whose data fit into the
    cache of the processor, and without the terms that are zero in all segments: this is several times as fast as
    `values` for many instants.
    """
    terms = 1 + int(np.flatnonzero(c.any(axis=(0, 2))).max(initial=0))
    rates = np.ascontiguousarray(np.moveaxis(c[:, 1:terms] * np.arange(1.0, terms)[:, None], 0, -1))
    found = np.zeros((order, 3, *s.shape))
    rows = max(1, BLOCK_SIZE // max(1, math.prod(s.shape[1:])))
    for first in range(0, len(s), rows):
        block = slice(first, first + rows)
        at, own = s[block], np.take(rates, i[block], axis=-1)
        for axis in range(3):
            powers = list(own[:, axis])
            for k in range(min(order, terms - 1)):
                for j in range(terms - 3, k - 1, -1):
                    product = at * powers[j + 1]
                    product += powers[j]
                    powers[j] = product
                np.multiply(powers[k], math.factorial(k), out=found[k, axis, block])
    return found


def time_reversed(c: Any, h: Any) -> Any:
    """Return the coefficients (n, terms, 3) of `c` in the time until the end; `h` (n,) are the durations."""
    signs = (-1.0) ** np.arange(c.shape[1])
    return shifted(c, h) * signs.astype(c.dtype)[None, :, None]


def durations(starts: Any, duration: Any) -> Any:
    """Return the durations (rows,) of the segments of a route with this `duration`; the duration of padding is zero."""
    np_ = arithmetic(starts, duration)
    ends = np_.minimum(np_.concatenate([starts[1:], duration[None]]), duration)
    return ends - np_.minimum(starts, duration)


@of_arrays
def index(starts: Float[Array, " rows"], t: Array) -> Int[Array, "..."]:
    """Return the indices of the segments at the times `t` [s]; at a joint, the index of the later segment."""
    return xp.maximum(xp.searchsorted(starts, t, side="right") - 1, 0)


@of_arrays
def nodes(starts: Float[Array, " rows"], duration: Scalar) -> Float[Array, " nodes"]:
    """Return the times [s] of the joints and of three instants in each segment; padding repeats the duration."""
    parts = (np.arange(4) / 4).astype(duration.dtype)
    h = durations(starts, duration)
    return (xp.minimum(starts, duration)[:, None] + h[:, None] * parts[None]).ravel()
