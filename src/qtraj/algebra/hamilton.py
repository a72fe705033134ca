"""Quaternion formulas component by component, for four numbers or for four arrays over many quaternions.

`qtraj.algebra.quaternion` states the conventions and offers the same operations on one quaternion (4,).
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.algebra.sparse import add, mul, sub

Components = Any
"""w, x, y, z: a tuple of four arrays of one shape, or one array (4,). The integer 0 stands for a zero component."""


def product(p: Components, q: Components) -> tuple[Any, Any, Any, Any]:
    """p∘q by Hamilton's rule."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        sub(sub(sub(mul(a, w), mul(b, x)), mul(c, y)), mul(d, z)),
        sub(add([mul(a, x), mul(b, w), mul(c, z)]), mul(d, y)),
        add([sub(mul(a, y), mul(b, z)), mul(c, w), mul(d, x)]),
        add([sub(add([mul(a, z), mul(b, y)]), mul(c, x)), mul(d, w)]),
    )


def from_axes(
    tangent: Any, normal: Any, binormal: Any, inverse_root: Callable[[Any], Any]
) -> tuple[Any, Any, Any, Any]:
    """The unit quaternion, of either sign, of the frame with these orthonormal axes, each (x, y, z).

    For many frames at once: it selects values instead of branching and divides only through `inverse_root`, 1/√x. For
    one matrix use `rotation.from_dcm`, whose sign and gradient are defined at every rotation.

    With u = w + ix and m = z − iy: um = (τ_y + iτ_z)/2, u² = (n_y + b_z + i(n_z − b_y))/2 and
    m² = (b_z − n_y − i(n_z + b_y))/2. The larger of u and m is computed as a square root, the other by division, so no
    digits are lost.
    """
    u_is_larger = tangent[0] >= 0
    real = jnp.where(u_is_larger, binormal[2] + normal[1], binormal[2] - normal[1])
    imaginary = jnp.where(u_is_larger, normal[2] - binormal[1], -normal[2] - binormal[1])
    modulus = 1 + jnp.abs(tangent[0])
    real_is_larger = real >= 0
    larger = modulus + jnp.abs(real)
    scale = 0.5 * inverse_root(larger)
    a, b = jnp.where(real_is_larger, larger, imaginary) * scale, jnp.where(real_is_larger, imaginary, larger) * scale
    inv_modulus = inverse_root(modulus) ** 2
    c, d = (tangent[1] * a + tangent[2] * b) * inv_modulus, (tangent[2] * a - tangent[1] * b) * inv_modulus
    w, x = jnp.where(u_is_larger, a, c), jnp.where(u_is_larger, b, d)
    z, y = jnp.where(u_is_larger, c, a), -jnp.where(u_is_larger, d, b)
    return w, x, y, z


def is_negative(q: Components) -> Any:
    """Whether the first non-zero component is negative."""
    w, x, y, z = q
    return _negative(w, _negative(x, _negative(y, z < 0)))


def continuous_signs(alignment: Float[Array, "*batch n"]) -> Float[Array, "*batch n+1"]:
    """Signs ±1 that make n+1 quaternions in a row continuous, from ⟨λ_{k−1}, λ_k⟩; the first sign is +1.

    The signs are constants to differentiation.
    """
    flips = jnp.cumsum((alignment < 0).astype(jnp.int32), axis=-1)
    flips = jnp.concatenate([jnp.zeros_like(flips, shape=(*flips.shape[:-1], 1)), flips], axis=-1)
    return stop_gradient(jnp.where(flips % 2 == 0, 1.0, -1.0).astype(alignment.dtype))


def _negative(x: Any, next_is_negative: Any) -> Any:
    return (x < 0) | ((x == 0) & next_is_negative)
