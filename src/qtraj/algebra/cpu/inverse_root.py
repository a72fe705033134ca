"""Compute square roots and inverse square roots without roots or divisions.

XLA's CPU compiler does not duplicate roots and divisions, so it ends the fused loop at each of them and writes all
intermediate results to memory. `inverse_root` computes an estimate from the bits of the number and refines it by
Newton's iteration, whose products and sums do not end a fused loop. The error is below two units in the last place.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float

from qtraj.foundation.namespace import is_host

Numbers = Float[Any, "..."]
Choice = Bool[Any, "..."] | bool

# For each dtype: the integer dtype of the same width, a constant, and the number of iterations to full precision. The
# constant minus the bit pattern of x shifted right by one is the bit pattern of an estimate of 1/√x. The relative error
# of the estimate is at most 3.5 % (Lomont 2003, Robertson 2012). Each iteration changes a relative error e to 1.5 e².
_ESTIMATE = {"float64": (jnp.int64, 0x5FE6EB50C7B537A9, 4), "float32": (jnp.int32, 0x5F375A86, 3)}

_TINY, _MAX = float(np.finfo(np.float64).tiny), float(np.finfo(np.float64).max)


def inverse_root(x: Numbers, exists: Choice = True) -> Numbers:
    """Return 1/√x where `exists` is true and x is a positive normal number, otherwise 0 with derivative 0.

    Where `exists` is true and x is NaN, the result is NaN.
    """
    if not is_host(x, exists):
        return _compiled(x, exists)
    normal = exists & (x >= _TINY) & (x <= _MAX)
    return np.where(normal, 1 / np.sqrt(np.where(normal, x, 1.0)), np.where(exists & (x != x), x, 0.0))


@partial(jax.jit, inline=True)  # traced once for each shape
def _compiled(x: Numbers, exists: Choice) -> Numbers:
    return _inverse_root(x, exists)


@jax.custom_jvp
def _inverse_root(x: Numbers, exists: Choice) -> Numbers:
    limits = jnp.finfo(x.dtype)
    normal = exists & (x >= limits.tiny) & (x <= limits.max)
    safe = jnp.where(normal, x, 1.0)
    integer, magic, iterations = _ESTIMATE[x.dtype.name]
    bits = lax.shift_right_logical(lax.bitcast_convert_type(safe, integer), jnp.asarray(1, integer))
    y = lax.bitcast_convert_type(jnp.asarray(magic, integer) - bits, x.dtype)
    for _ in range(iterations):
        y = y * (1.5 - 0.5 * (safe * y * y))
    return jnp.where(normal, y, jnp.where(exists & jnp.isnan(x), x, 0.0))


@_inverse_root.defjvp
def _inverse_root_jvp(primals: tuple[Numbers, Choice], tangents: tuple[Numbers, Any]) -> tuple[Numbers, Numbers]:
    y = inverse_root(*primals)
    # Multiply step by step, because the cube of y may overflow or underflow.
    return y, -0.5 * (y * (y * (y * tangents[0])))


def root(x: Numbers) -> Numbers:
    """Return √x, or 0 with derivative 0 where x is not a positive normal number; infinity and NaN are unchanged."""
    if not is_host(x):
        return _compiled_root(x)
    too_small = x < _TINY
    return np.where(too_small, 0.0, np.sqrt(np.where(too_small, 0.0, x)))


@partial(jax.jit, inline=True)
def _compiled_root(x: Numbers) -> Numbers:
    return _root(x)


@jax.custom_jvp
def _root(x: Numbers) -> Numbers:
    finite = jnp.where(x > 0, x * inverse_root(x, x > 0), 0.0)
    return jnp.where((x > jnp.finfo(x.dtype).max) | jnp.isnan(x), x, finite)


@_root.defjvp
def _root_jvp(primals: tuple[Numbers], tangents: tuple[Numbers]) -> tuple[Numbers, Numbers]:
    (x,) = primals
    return root(x), 0.5 * (inverse_root(x, x > 0) * tangents[0])
