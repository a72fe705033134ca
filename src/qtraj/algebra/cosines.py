"""Direction cosines α (inertial → body; the rows are the body axes) and quaternions."""

import jax.numpy as jnp
from jax.lax import stop_gradient

from qtraj.algebra.quaternion import canonical, norm_squared, unit as unit_quaternion
from qtraj.algebra.vector import balanced
from qtraj.foundation.types import Mat3, Mat4, Quat

SIGNS = ((1, 1, 1, 1), (1, 1, -1, -1), (1, -1, 1, -1), (1, -1, -1, 1))
"""Paper S's matrix H with H·H = 4E, which maps the squares of a unit quaternion to (1, α11, α22, α33)."""


def to_dcm(q: Quat) -> Mat3:
    """Direction cosines α = R(λ)ᵀ, inertial to body components; `q` and `c*q` agree for any c ≠ 0."""
    q = balanced(q)
    s, x, y, z = q
    rows = [
        [s * s + x * x - y * y - z * z, 2 * (x * y + s * z), 2 * (x * z - s * y)],
        [2 * (x * y - s * z), s * s - x * x + y * y - z * z, 2 * (y * z + s * x)],
        [2 * (x * z + s * y), 2 * (y * z - s * x), s * s - x * x - y * y + z * z],
    ]
    return jnp.stack([jnp.stack(row) for row in rows]) / norm_squared(q)


def from_dcm(C: Mat3) -> Quat:
    """The unit quaternion of a rotation matrix α, first non-zero component positive (so the scalar is ≥ 0).

    Uses Shepperd's method: the row of 4 λ_i λ_k with the largest diagonal element. (The diagonal alone, as in
    `squares_from_dcm`, loses the signs.) Value and gradient are finite at every rotation. For a matrix that is not
    orthogonal the result depends on the row.
    """
    return canonical(unit_quaternion(pivot_row(C)))


def squares_from_dcm(C: Mat3) -> Quat:
    """(α0², α1², α2², α3²) of the unit quaternion by paper S's linear system, ¼H(1, α11, α22, α33)."""
    column = jnp.concatenate([jnp.ones_like(C, shape=1), jnp.diagonal(C)])
    return 0.25 * jnp.sum(jnp.asarray(SIGNS, column.dtype) * column[None, :], axis=1)


def outer_from_dcm(C: Mat3) -> Mat4:
    """4 α_i α_k for all pairs of components of the unit quaternion: linear in the direction cosines."""
    squares = 4 * squares_from_dcm(C)
    d1, d2, d3 = C[1, 2] - C[2, 1], C[2, 0] - C[0, 2], C[0, 1] - C[1, 0]
    s1, s2, s3 = C[1, 2] + C[2, 1], C[2, 0] + C[0, 2], C[0, 1] + C[1, 0]
    rows = [
        [squares[0], d1, d2, d3],
        [d1, squares[1], s3, s2],
        [d2, s3, squares[2], s1],
        [d3, s2, s1, squares[3]],
    ]
    return jnp.stack([jnp.stack(row) for row in rows])


def pivot_row(C: Mat3) -> Quat:
    """4 α_k (α0, α1, α2, α3) for the k with the largest square: a multiple of the quaternion, of norm ≥ 2."""
    outer = outer_from_dcm(C)
    largest = stop_gradient(jnp.argmax(jnp.diagonal(outer)))
    return jnp.sum(jnp.where((jnp.arange(4) == largest)[:, None], outer, 0.0), axis=0)
