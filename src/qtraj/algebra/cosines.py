"""Direction cosines α (inertial → body; the rows are the body axes) and quaternions."""

import jax.numpy as jnp

from qtraj.algebra.quaternion import canonical, norm_squared, unit as unit_quaternion
from qtraj.algebra.vector import balanced
from qtraj.foundation.types import Mat3, Quat, Scalar

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
    return 0.25 * jnp.stack(_squares(C))


def pivot_row(C: Mat3) -> Quat:
    """4 α_k (α0, α1, α2, α3) for the k with the largest square: a multiple of the quaternion, of norm ≥ 2.

    All products 4 α_i α_k are linear in the direction cosines. Numbers are chosen one by one, because an array of rows
    with an index compiles to slow code for many matrices.
    """
    rows = _outer(C)
    a, b, c, d = (rows[k][k] for k in range(4))
    first, second, third = (a >= b) & (a >= c) & (a >= d), (b >= c) & (b >= d), c >= d
    choose = lambda w, x, y, z: jnp.where(first, w, jnp.where(second, x, jnp.where(third, y, z)))  # noqa: E731
    return jnp.stack([choose(*column) for column in zip(*rows, strict=True)])


def _outer(C: Mat3) -> list[list[Scalar]]:
    """4 α_i α_k for all pairs of components of the unit quaternion."""
    squares = _squares(C)
    d1, d2, d3 = C[1, 2] - C[2, 1], C[2, 0] - C[0, 2], C[0, 1] - C[1, 0]
    s1, s2, s3 = C[1, 2] + C[2, 1], C[2, 0] + C[0, 2], C[0, 1] + C[1, 0]
    return [
        [squares[0], d1, d2, d3],
        [d1, squares[1], s3, s2],
        [d2, s3, squares[2], s1],
        [d3, s2, s1, squares[3]],
    ]


def _squares(C: Mat3) -> list[Scalar]:
    return [1 + i * C[0, 0] + j * C[1, 1] + k * C[2, 2] for _, i, j, k in SIGNS]
