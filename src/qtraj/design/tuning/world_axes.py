"""Derivatives of a path in world axes, for limits on the upright frame."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.design.tuning.curves import angle_at


def upright_derivatives(axes: Array, angle: Array, r: Array, u: Array) -> Array:
    """Convert the derivatives `r` of a batch of paths to world axes, except for paths with a vertical axis.

    For paths with a vertical axis, the derivatives in the moving basis are sufficient.
    """
    tilted = jnp.any(axes[:, 2, :2] != 0, axis=1)

    def rotated() -> Array:
        in_world = jax.vmap(lambda axes, angle, r, u: to_world(axes, angle_at(angle, u, 0)[0], r))(axes, angle, r, u)
        return jnp.where(tilted[:, None, None, None], in_world, r)

    return jax.lax.cond(jnp.any(tilted), rotated, lambda: r)


def to_world(axes: Array, angle: Array, v: Array) -> Array:
    """Convert vectors (…, 3, instants) from the moving basis to world axes."""
    x, y, z = v[..., 0, :], v[..., 1, :], v[..., 2, :]
    cos, sin = _cos_sin(angle, x.ndim)
    local = jnp.stack([x * cos - y * sin, x * sin + y * cos, z], axis=-2)
    return jnp.einsum("ij,...jp->...ip", axes, local)


def _from_world(axes: Array, angle: Array, v: Array) -> Array:
    """Convert vectors (…, 3, instants) from world axes to the moving basis."""
    local = jnp.einsum("ji,...jp->...ip", axes, v)
    x, y, z = local[..., 0, :], local[..., 1, :], local[..., 2, :]
    cos, sin = _cos_sin(angle, x.ndim)
    return jnp.stack([x * cos + y * sin, y * cos - x * sin, z], axis=-2)


def _cos_sin(angle: Array, ndim: int) -> tuple[Array, Array]:
    angles = angle[(None,) * (ndim - 1)]
    return jnp.cos(angles), jnp.sin(angles)


def cross_axis(v: Array) -> Array:
    """Return k × v, where k is the axis of the moving basis."""
    x, y = v[..., 0, :], v[..., 1, :]
    return jnp.stack([-y, x, jnp.zeros_like(x)], axis=-2)


def world_derivatives(
    axes: Array, coefficients: Array, angle_derivatives: Array, r: Array, w: Array, u: Array
) -> tuple[Array, Array]:
    """Convert the derivatives `r` of a path, and their derivatives `w` in all directions, to world axes."""
    angle, in_u = angle_at(coefficients, u, 1)
    first = jnp.concatenate([angle_at(angle_derivatives, u, 0)[0], in_u[None]])
    return to_world(axes, angle, r), to_world(axes, angle, w + first[:, None, None] * cross_axis(r)[None])


def from_world(
    axes: Array, coefficients: Array, angle_derivatives: Array, r: Array, w: Array, gradient: Array, u: Array
) -> tuple[Array, Array]:
    """Return the gradient in the moving basis, and the terms of the Hessian due to the rotation of the basis."""
    angle, in_u, in_u_twice = angle_at(coefficients, u, 2)
    moved_angle, moved_in_u = angle_at(angle_derivatives, u, 1)
    second = jnp.zeros((*moved_angle.shape[:1] * 2, *moved_angle.shape[1:]), u.dtype)  # φ is linear in the slopes
    first = jnp.concatenate([moved_angle, in_u[None]])
    rotated, twice_rotated = cross_axis(r), cross_axis(cross_axis(r))
    second_angle = jnp.concatenate([second, moved_in_u[:, None]], axis=1)
    second_angle = jnp.concatenate([second_angle, jnp.concatenate([moved_in_u, 2 * in_u_twice[None]])[None]])
    local = _from_world(axes, angle, gradient)
    half = first[:, None] * jnp.einsum("okp,mokp->mp", local, cross_axis(w))[None]
    square = first[:, None] * first[None] * jnp.einsum("okp,okp->p", local, twice_rotated)[None, None]
    added = second_angle * jnp.einsum("okp,okp->p", local, rotated)[None, None]
    return local, half + jnp.swapaxes(half, 0, 1) + square + added
