"""Poses as dual quaternions Λ = λ + s λ′, s² = 0: an attitude and a position in one number of eight components.

Λ = λ + s ½ r∘λ for the position r (inertial axes) and the attitude λ, so that a point x of the body is at
r + λ∘x∘λ⁻¹, and poses multiply as attitudes do: Λ_AC = Λ_AB∘Λ_BC. With the twist U = ω + s u,
2Λ̇ = Λ∘U_x = U_ξ∘Λ; u_x is the velocity of the body's origin in body axes, u_ξ = v + r × ω that of the point of the body
at the inertial origin (Kotelnikov's transference principle; Chelnokov and Nelaeva, 2015). λ may have any length but 0.

Each is an array (8,), λ first. One of each; batches are `jax.vmap`'s.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import quaternion
from qtraj.foundation.types import Quat, Vec3

DualQuat = Float[Array, "8"]


def from_pose(position: Vec3, q: Quat) -> DualQuat:
    """Λ = λ + s ½ r∘λ of a position r (3,) [m], inertial axes, and an attitude λ (4,)."""
    return jnp.concatenate([q, 0.5 * quaternion.product(_pure(position), q)])


def to_pose(dual: DualQuat) -> tuple[Vec3, Quat]:
    """Position r = 2λ′∘λ⁻¹ (3,) [m] and attitude λ (4,); the same for Λ and cΛ, c ≠ 0, but for the length of λ."""
    real, moved = dual[:4], dual[4:]
    return 2 * quaternion.product(moved, quaternion.inverse(real))[1:], real


def product(a: DualQuat, b: DualQuat) -> DualQuat:
    """Λ_a∘Λ_b: the pose b, described in the axes of the pose a."""
    cross = quaternion.product(a[:4], b[4:]) + quaternion.product(a[4:], b[:4])
    return jnp.concatenate([quaternion.product(a[:4], b[:4]), cross])


def conjugate(dual: DualQuat) -> DualQuat:
    """Λ̄ = λ̄ + s λ̄′: of a unit pose the way back."""
    return jnp.concatenate([quaternion.conjugate(dual[:4]), quaternion.conjugate(dual[4:])])


def inverse(dual: DualQuat) -> DualQuat:
    """Λ⁻¹ = λ⁻¹ − s λ⁻¹∘λ′∘λ⁻¹."""
    back = quaternion.inverse(dual[:4])
    return jnp.concatenate([back, -quaternion.product(quaternion.product(back, dual[4:]), back)])


def transform(dual: DualQuat, point: Vec3) -> Vec3:
    """The position in inertial axes of a point of the body (3,) [m], body axes."""
    position, q = to_pose(dual)
    return position + quaternion.rotate(q, point)


def derivative(dual: DualQuat, omega: Vec3 | Quat, velocity: Vec3) -> DualQuat:
    """Λ̇ of a body whose origin moves at `velocity` [m/s], inertial axes, and turns at `omega` [rad/s], body axes.

    `omega` is (3,), or (4,) with ω0 = d/dt ln|λ|² first: 2Λ̇ = Λ∘(ω_x + s λ⁻¹∘v∘λ).
    """
    turning = omega if omega.shape == (4,) else _pure(omega)
    back = _pure(quaternion.rotate(quaternion.conjugate(dual[:4]), velocity))
    return 0.5 * product(dual, jnp.concatenate([turning, back]))


def _pure(v: Vec3) -> Quat:
    return jnp.concatenate([jnp.zeros_like(v, shape=1), v])
