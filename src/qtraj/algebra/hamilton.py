"""Compute quaternion formulas component by component; each component is a number, or an array over many quaternions.

`qtraj.algebra.quaternion` states the conventions and provides the same operations for one quaternion (4,).
"""

from collections.abc import Callable
from typing import Any

from jaxtyping import Array, Float

from qtraj.algebra.sparse import add, mul, sub
from qtraj.foundation.namespace import stop_gradient, xp

Components = Any
"""Components w, x, y, z: a tuple of four arrays of one shape, or one array (4,).

In a tuple, the integer 0 represents a component that is identically zero.
"""


def product(p: Components, q: Components) -> tuple[Any, Any, Any, Any]:
    """Return the Hamilton product p∘q."""
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
    """Return the unit quaternion (w, x, y, z), of either sign, of the frame with the given orthonormal axes.

    The function is intended for many frames at once. It selects values instead of branching, and uses `inverse_root`, a
    function that returns 1/√x, instead of divisions. For one matrix use `rotation.from_dcm`: the sign and the gradient
    of its result are defined at every rotation.

    Let τ, n, b be the axes, each (x, y, z), and let u = w + ix and m = z − iy. Then um = (τ_y + iτ_z)/2, u² = (n_y +
    b_z + i(n_z − b_y))/2 and m² = (b_z − n_y − i(n_z + b_y))/2. If |u| ≥ |m|, the function computes u as a square root
    and m as um/u, otherwise m as a square root and u as um/m. This avoids cancellation.
    """
    u_is_larger = tangent[0] >= 0
    real = xp.where(u_is_larger, binormal[2] + normal[1], binormal[2] - normal[1])
    imaginary = xp.where(u_is_larger, normal[2] - binormal[1], -normal[2] - binormal[1])
    modulus = 1 + abs(tangent[0])
    real_is_larger = real >= 0
    larger = modulus + abs(real)
    scale = 0.5 * inverse_root(larger)
    a, b = xp.where(real_is_larger, larger, imaginary) * scale, xp.where(real_is_larger, imaginary, larger) * scale
    inv_modulus = inverse_root(modulus) ** 2
    c, d = (tangent[1] * a + tangent[2] * b) * inv_modulus, (tangent[2] * a - tangent[1] * b) * inv_modulus
    w, x = xp.where(u_is_larger, a, c), xp.where(u_is_larger, b, d)
    z, y = xp.where(u_is_larger, c, a), -xp.where(u_is_larger, d, b)
    return w, x, y, z


def is_negative(q: Components) -> Any:
    """Return whether the first non-zero component of `q` is negative."""
    w, x, y, z = q
    return _negative(w, _negative(x, _negative(y, z < 0)))


def continuous_signs(alignment: Float[Array, "*batch n"]) -> Float[Array, "*batch n+1"]:
    """Return signs ±1 that make n+1 consecutive quaternions λ_k continuous; the first sign is +1.

    `alignment` contains the n scalar products ⟨λ_{k−1}, λ_k⟩. The signs are treated as constants in differentiation.
    """
    flips = xp.cumsum((alignment < 0).astype(xp.int32), axis=-1)
    flips = xp.concatenate([xp.zeros_like(flips, shape=(*flips.shape[:-1], 1)), flips], axis=-1)
    return stop_gradient(xp.where(flips % 2 == 0, 1.0, -1.0).astype(alignment.dtype))


def _negative(x: Any, next_is_negative: Any) -> Any:
    return (x < 0) | ((x == 0) & next_is_negative)
