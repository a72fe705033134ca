"""One over the square root, by arithmetic alone.

A compiler for CPUs holds a root or a division too dear to be repeated: it stores each in a loop of its own, and with it
all that the loops on both sides need. Here it is a guess from the bits of the number and Newton's iteration, which
become part of any loop; its errors stay below two units in the last place.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

Numbers = Float[Array, "..."]
Choice = Bool[Array, "..."] | bool

# For each type: integers as wide; the number from which half the bits are taken, such that the guess is at most 3.5 %
# wrong (Lomont 2003, Robertson 2012); and the iterations to full precision, as an error e becomes 1.5 e².
_GUESS = {"float64": (jnp.int64, 0x5FE6EB50C7B537A9, 4), "float32": (jnp.int32, 0x5F375A86, 3)}


@jax.custom_jvp
def inverse_root(x: Numbers, there: Choice = True) -> Numbers:
    """1/√x where `there` says so and x is a normal number; elsewhere 0 with a derivative of 0, but NaN of NaN."""
    limits = jnp.finfo(x.dtype)
    normal = there & (x >= limits.tiny) & (x <= limits.max)
    safe = jnp.where(normal, x, 1.0)
    integer, magic, iterations = _GUESS[x.dtype.name]
    bits = lax.shift_right_logical(lax.bitcast_convert_type(safe, integer), jnp.asarray(1, integer))
    y = lax.bitcast_convert_type(jnp.asarray(magic, integer) - bits, x.dtype)
    for _ in range(iterations):
        y = y * (1.5 - 0.5 * (safe * y * y))
    return jnp.where(normal, y, jnp.where(there & jnp.isnan(x), x, 0.0))


@inverse_root.defjvp
def _of_inverse_root(primals: tuple[Numbers, Choice], tangents: tuple[Numbers, Any]) -> tuple[Numbers, Numbers]:
    y = inverse_root(*primals)
    # One factor after the other: the cube alone may be too large or too small for a float.
    return y, -0.5 * (y * (y * (y * tangents[0])))


@jax.custom_jvp
def root(x: Numbers) -> Numbers:
    """√x; 0 with a derivative of 0 where x is not positive, or too small for a normal number."""
    finite = jnp.where(x > 0, x * inverse_root(x, x > 0), 0.0)
    return jnp.where((x > jnp.finfo(x.dtype).max) | jnp.isnan(x), x, finite)


@root.defjvp
def _of_root(primals: tuple[Numbers], tangents: tuple[Numbers]) -> tuple[Numbers, Numbers]:
    (x,) = primals
    return root(x), 0.5 * (inverse_root(x, x > 0) * tangents[0])
