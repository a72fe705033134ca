"""Derivatives of a path in the axes of the world, for limits on its upright frame."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.design.tuning.curves import angle_at


def upright(axes: Array, angle: Array, r: Array, u: Array) -> Array:
    """r', r'', … with the third axis vertical, where the axis of the path is not."""
    tilted = jnp.any(axes[2, :2] != 0)
    return jax.lax.cond(tilted, lambda: turned(axes, angle_at(angle, u, 0)[0], r), lambda: r)


def turned(axes: Array, angle: Array, v: Array) -> Array:
    """Vectors (…, 3, places) from the moving basis to the world's."""
    x, y, z = v[..., 0, :], v[..., 1, :], v[..., 2, :]
    cos, sin = _cos_sin(angle, x.ndim)
    local = jnp.stack([x * cos - y * sin, x * sin + y * cos, z], axis=-2)
    return jnp.einsum("ij,...jp->...ip", axes, local)


def _turned_back(axes: Array, angle: Array, v: Array) -> Array:
    """Vectors (…, 3, places) from the world's axes to the moving basis."""
    local = jnp.einsum("ji,...jp->...ip", axes, v)
    x, y, z = local[..., 0, :], local[..., 1, :], local[..., 2, :]
    cos, sin = _cos_sin(angle, x.ndim)
    return jnp.stack([x * cos + y * sin, y * cos - x * sin, z], axis=-2)


def _cos_sin(angle: Array, ndim: int) -> tuple[Array, Array]:
    wide = angle[(None,) * (ndim - 1)]
    return jnp.cos(wide), jnp.sin(wide)


def spun(v: Array) -> Array:
    """k × v."""
    x, y = v[..., 0, :], v[..., 1, :]
    return jnp.stack([-y, x, jnp.zeros_like(x)], axis=-2)


def in_world(
    axes: Array, coefficients: Array, changes: Array, r: Array, w: Array, u: Array
) -> tuple[Array, Array, Any]:
    """r', r'', … and their derivatives in all directions in the world's axes; and what takes derivatives back.

    That gives derivatives in the moving basis, and what the turning of the basis adds to second ones.
    """
    angle, in_u, in_u_twice = angle_at(coefficients, u, 2)
    moved, moved_in_u = angle_at(changes, u, 1)
    second = jnp.zeros((*moved.shape[:1] * 2, *moved.shape[1:]), u.dtype)  # φ is linear in the slopes
    first = jnp.concatenate([moved, in_u[None]])
    once, again = spun(r), spun(spun(r))
    twice = jnp.concatenate([second, moved_in_u[:, None]], axis=1)
    twice = jnp.concatenate([twice, jnp.concatenate([moved_in_u, 2 * in_u_twice[None]])[None]])

    def back(bar: Array) -> tuple[Array, Array]:
        own = _turned_back(axes, angle, bar)
        half = first[:, None] * jnp.einsum("okp,mokp->mp", own, spun(w))[None]
        square = first[:, None] * first[None] * jnp.einsum("okp,okp->p", own, again)[None, None]
        added = twice * jnp.einsum("okp,okp->p", own, once)[None, None]
        return own, half + jnp.swapaxes(half, 0, 1) + square + added

    return turned(axes, angle, r), turned(axes, angle, w + first[:, None, None] * once[None]), back
