"""Dual quaternions Λ = λ + s λ′, s² = 0: position and attitude in one number with eight components.

The pose with the position r (inertial axes) and the attitude λ is Λ = λ + s ½ r∘λ: a point x of the body is at
r + λ∘x∘λ⁻¹. Poses multiply like attitudes: Λ_AC = Λ_AB∘Λ_BC. With the twist U = ω + s u, 2Λ̇ = Λ∘U_x = U_ξ∘Λ, where
u_x is the velocity of the body's origin in body axes, and u_ξ = v + r × ω is the velocity of the body point at the
inertial origin (Kotelnikov's transference principle; Chelnokov and Nelaeva, 2015). λ may have any nonzero norm.

A dual quaternion is an array (8,), λ first. Each function takes one; use `jax.vmap` for batches.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import quaternion
from qtraj.foundation.types import Quat, Vec3

DualQuat = Float[Array, "8"]


def from_pose(position: Vec3, q: Quat) -> DualQuat:
    """Λ = λ + s ½ r∘λ from a position r (3,) [m], inertial axes, and an attitude λ (4,)."""
    return jnp.concatenate([q, 0.5 * quaternion.product(_pure(position), q)])


def to_pose(dual: DualQuat) -> tuple[Vec3, Quat]:
    """Position r = 2λ′∘λ⁻¹ (3,) [m] and attitude λ (4,). Λ and cΛ, c ≠ 0, give the same position and λ and cλ."""
    real, dual_part = dual[:4], dual[4:]
    return 2 * quaternion.product(dual_part, quaternion.inverse(real))[1:], real


def product(a: DualQuat, b: DualQuat) -> DualQuat:
    """Λ_a∘Λ_b: if Λ_b is a pose relative to the pose Λ_a, the same pose relative to the inertial axes."""
    cross = quaternion.product(a[:4], b[4:]) + quaternion.product(a[4:], b[:4])
    return jnp.concatenate([quaternion.product(a[:4], b[:4]), cross])


def conjugate(dual: DualQuat) -> DualQuat:
    """Λ̄ = λ̄ + s λ̄′; for |λ| = 1 it is the inverse."""
    return jnp.concatenate([quaternion.conjugate(dual[:4]), quaternion.conjugate(dual[4:])])


def inverse(dual: DualQuat) -> DualQuat:
    """Λ⁻¹ = λ⁻¹ − s λ⁻¹∘λ′∘λ⁻¹."""
    real = quaternion.inverse(dual[:4])
    return jnp.concatenate([real, -quaternion.product(quaternion.product(real, dual[4:]), real)])


def transform(dual: DualQuat, point: Vec3) -> Vec3:
    """The position (3,) [m] in inertial axes of a body point, given in body axes."""
    position, q = to_pose(dual)
    return position + quaternion.rotate(q, point)


def derivative(dual: DualQuat, omega: Vec3 | Quat, velocity: Vec3) -> DualQuat:
    """Λ̇ from the `velocity` [m/s] of the origin, inertial axes, and the rate `omega` [rad/s], body axes.

    `omega` is (3,), or (4,) with ω0 = d/dt ln|λ|² first. 2Λ̇ = Λ∘(ω_x + s λ⁻¹∘v∘λ).
    """
    rate = omega if omega.shape == (4,) else _pure(omega)
    body_velocity = _pure(quaternion.rotate(quaternion.conjugate(dual[:4]), velocity))
    return 0.5 * product(dual, jnp.concatenate([rate, body_velocity]))


def _pure(v: Vec3) -> Quat:
    return jnp.concatenate([jnp.zeros_like(v, shape=1), v])
