"""Piecewise polynomials with values (3,), as plain arrays: the segments of routes.

Segment i has ascending coefficients `c[i]` (terms, 3) in t − start_i. The functions work on NumPy arrays and, inside a
trace, on JAX arrays. Segments are padded to a few sizes, so that routes of similar length share executables. The
padding has infinite start times and zero coefficients, so no search for a time selects it.
"""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

TERMS = (6, 8)
"""The stored numbers of coefficients: of a quintic or of a septic."""

MIN_ROWS = 8
"""The smallest padded number of segments; larger ones are powers of two."""


def arithmetic(*arrays: Any) -> Any:
    """`numpy` if all arrays are concrete, else `jax.numpy`."""
    return jnp if any(isinstance(x, Tracer) for x in arrays) else np


def padded_size(count: int) -> int:
    """The padded number of `count` segments."""
    return max(MIN_ROWS, 1 << (count - 1).bit_length())


def padded(starts: Any, c: Any) -> tuple[Any, Any]:
    """Starts and coefficients, padded in the number of segments and in the degree."""
    np_ = arithmetic(starts, c)
    rows = padded_size(starts.shape[0]) - starts.shape[0]
    terms = next(n for n in TERMS if n >= c.shape[1]) - c.shape[1]
    return (
        np_.concatenate([starts, np_.full((rows,), np.inf, starts.dtype)]),
        np_.pad(c, [(0, rows), (0, terms), (0, 0)]),
    )


def hermite(h: Any, states: Any) -> Any:
    """Coefficients (n, terms, 3) of the segments with durations `h` (n,) between joint states (n + 1, orders, 3).

    Three orders, position to acceleration, make quintics; four, with the jerk, make septics.
    """
    a, b, h = states[:-1], states[1:], h[:, None]
    orders = states.shape[1]
    low = [a[:, k] / math.factorial(k) for k in range(orders)]
    # The end state minus the end state of the Taylor polynomial about the start, scaled to lengths.
    gaps = []
    for k in range(orders):
        reached = [math.comb(j, k) * math.factorial(k) * low[j] * h ** (j - k) for j in range(k + 1, orders)]
        gaps.append(((b[:, k] - a[:, k]) - sum(reached, 0.0 * h)) * h**k)
    weights = _hermite_weights(orders)
    high = [sum(w * gap for w, gap in zip(row, gaps, strict=True)) / h ** (orders + i) for i, row in weights]
    return arithmetic(h, states).stack([*low, *high], axis=1)


def _hermite_weights(orders: int) -> Any:
    """The weights of the end state in each of the higher coefficients."""
    quintic = ((10, -4, 1 / 2), (-15, 7, -1), (6, -3, 1 / 2))
    septic = ((35, -15, 5 / 2, -1 / 6), (-84, 39, -7, 1 / 2), (70, -34, 13 / 2, -1 / 2), (-20, 10, -2, 1 / 6))
    return enumerate(quintic if orders == 3 else septic)


def shifted(c: Any, s: Any) -> Any:
    """Coefficients (n, terms, 3) of the same polynomials about the local times `s` (n,), by synthetic division."""
    terms = [c[:, k] for k in range(c.shape[1])]
    s = s[:, None]
    for k in range(len(terms) - 1):
        for i in range(len(terms) - 2, k - 1, -1):
            terms[i] = terms[i] + s * terms[i + 1]
    return arithmetic(c, s).stack(terms, axis=1)


def values(c: Any, s: Any, order: int) -> list[Any]:
    """Value and derivatives up to `order` of segments `c` (..., terms, 3) at local times `s` (...), each (..., 3)."""
    terms = [c[..., k, :] for k in range(c.shape[-2])]
    s = s[..., None]
    for k in range(min(order + 1, len(terms) - 1)):
        for i in range(len(terms) - 2, k - 1, -1):
            terms[i] = terms[i] + s * terms[i + 1]
    results = [math.factorial(k) * terms[k] for k in range(min(order + 1, len(terms)))]
    return [*results, *[0.0 * terms[0]] * (order + 1 - len(results))]


def time_reversed(c: Any, h: Any) -> Any:
    """Coefficients (n, terms, 3) in the time left until the end of each segment; durations `h` (n,)."""
    signs = (-1.0) ** np.arange(c.shape[1])
    return shifted(c, h) * signs.astype(c.dtype)[None, :, None]


def durations(starts: Any, duration: Any) -> Any:
    """Durations (rows,) of the segments; zero for padding."""
    np_ = arithmetic(starts, duration)
    ends = np_.minimum(np_.concatenate([starts[1:], duration[None]]), duration)
    return ends - np_.minimum(starts, duration)
