"""Dual quaternions Λ = λ + s λ′, s² = 0, which represent position and attitude by eight components.

The pose with position r (inertial axes) and attitude λ is Λ = λ + s ½ r∘λ; a point x of the body has the position r +
λ∘x∘λ⁻¹. Poses multiply like attitudes: Λ_AC = Λ_AB∘Λ_BC, where Λ_AB is the pose of B relative to A. Let ω be the
angular rate and v the velocity of the body's origin. With the twist U = ω + s u, 2Λ̇ = Λ∘U_X = U_ξ∘Λ. In body axes
(index X), u is v; in inertial axes (index ξ), u = v + r × ω is the velocity of the body point at the inertial origin
(Kotelnikov's transference principle; Chelnokov and Nelaeva, 2015). λ may have any nonzero norm.

A dual quaternion is an array (8,) with λ first. A twist (ω, u) is a pair of arrays (3,), the rotational part first, as
in `exp` and `log`; in matrices (6, 6) the first three rows and columns belong to ω. Leading axes of the arrays are
batch axes.
"""

from typing import Any

import numpy as np

from qtraj.algebra import quaternion, rotation_rates
from qtraj.algebra.rotation_rates import left_jacobian_derivative, left_jacobian_inverse
from qtraj.algebra.vector import cross
from qtraj.foundation.namespace import matmul, of_arrays, xp
from qtraj.foundation.types import DualQuat, Mat6, Quat, Scalar, Vec3


@of_arrays
def from_pose(position: Vec3, q: Quat) -> DualQuat:
    """Return Λ = λ + s ½ r∘λ of the position r (3,) [m], in inertial axes, and the attitude λ (4,)."""
    return xp.concatenate([q, 0.5 * quaternion.product(_pure(position), q)], axis=-1)


@of_arrays
def to_pose(dual: DualQuat) -> tuple[Vec3, Quat]:
    """Return the position 2λ′∘λ⁻¹ (3,) [m] and the attitude λ (4,) of Λ = λ + s λ′.

    Λ and cΛ, c ≠ 0, have the same position.
    """
    real, dual_part = dual[..., :4], dual[..., 4:]
    return 2 * quaternion.product(dual_part, quaternion.inverse(real))[..., 1:], real


@of_arrays
def product(a: DualQuat, b: DualQuat) -> DualQuat:
    """Return Λ_a∘Λ_b: for a pose Λ_b relative to the body axes of Λ_a, this is the same pose in inertial axes."""
    cross = quaternion.product(a[..., :4], b[..., 4:]) + quaternion.product(a[..., 4:], b[..., :4])
    return xp.concatenate([quaternion.product(a[..., :4], b[..., :4]), cross], axis=-1)


@of_arrays
def conjugate(dual: DualQuat) -> DualQuat:
    """Return the conjugate λ̄ + s λ̄′ of Λ = λ + s λ′; it is the inverse if Λ is a pose with |λ| = 1."""
    return xp.concatenate([quaternion.conjugate(dual[..., :4]), quaternion.conjugate(dual[..., 4:])], axis=-1)


@of_arrays
def inverse(dual: DualQuat) -> DualQuat:
    """Return the inverse Λ⁻¹ = λ⁻¹ − s λ⁻¹∘λ′∘λ⁻¹ of Λ = λ + s λ′."""
    real = quaternion.inverse(dual[..., :4])
    return xp.concatenate([real, -quaternion.product(quaternion.product(real, dual[..., 4:]), real)], axis=-1)


@of_arrays
def transform(dual: DualQuat, point: Vec3) -> Vec3:
    """Return the position (3,) [m], in inertial axes, of a body point whose components in body axes are `point`."""
    position, q = to_pose(dual)
    return position + quaternion.rotate(q, point)


@of_arrays
def derivative(dual: DualQuat, omega: Vec3 | Quat, velocity: Vec3) -> DualQuat:
    """Return Λ̇ = ½ Λ∘(ω_X + s λ⁻¹∘v∘λ) from the velocity v of the body's origin and the angular rate ω_X.

    λ is the attitude in Λ = λ + s λ′. `velocity` is v [m/s] in inertial components. `omega` is ω_X [rad/s] in body
    components: (3,), or (4,) with the scalar part ω0 = d/dt ln|λ|² first.
    """
    rate = omega if omega.shape[-1] == 4 else _pure(omega)
    body_velocity = _pure(quaternion.rotate(quaternion.conjugate(dual[..., :4]), velocity))
    return 0.5 * product(dual, xp.concatenate([rate, body_velocity], axis=-1))


@of_arrays
def exp(v: Vec3, u: Vec3) -> DualQuat:
    """Return the unit dual quaternion exp ½(v + s u): the pose after a constant twist for unit time, from Λ = 1.

    `v` (..., 3) [rad] is the rotation vector, and `u` (..., 3) [m] the displacement of the body's origin in body axes.
    The position is J_left(v) u (Lynch and Park, Modern Robotics, section 3.3.3), see `rotation.left_jacobian`.
    """
    v, u = xp.broadcast_arrays(v, u)
    return from_pose(matmul(rotation_rates.left_jacobian(v), u[..., None])[..., 0], quaternion.exp(0.5 * v))


@of_arrays
def log(dual: DualQuat) -> tuple[Vec3, Vec3]:
    """Return v (..., 3) [rad] and u (..., 3) [m] of the screw motion to the pose Λ; `exp(v, u)` is ±Λ/|λ|.

    v is the rotation vector of the shorter rotation, as in `rotation.to_rotation_vector`. Λ and cΛ, c ≠ 0, have the
    same result.
    """
    position, q = to_pose(dual)
    v = 2 * quaternion.log(quaternion.canonical(q))
    return v, left_jacobian_inverse(v, position)


@of_arrays
def interpolate(a: DualQuat, b: DualQuat, s: Scalar) -> DualQuat:
    """Return the pose on the screw motion from `a` to `b` (..., 8) after the share `s` (...) of its angle and length.

    The twist of the motion is constant, and its rotation is the shorter one. The result is a/|a| for s = 0, where |a|
    is the norm of the attitude, and ±b/|b| for s = 1; other values of s extrapolate. The motion does not depend on the
    choice of the inertial axes and of the body axes (Kavan, Collins, Žára and O'Sullivan, 2006, ScLERP). For a half
    turn see `rotation.slerp`.
    """
    v, u = log(product(inverse(a), b))
    share = xp.asarray(s)[..., None]
    start = a / xp.sqrt(quaternion.norm_squared(a[..., :4]))[..., None]
    return product(start, exp(share * v, share * u))


@of_arrays
def inertial_twist(dual: DualQuat, omega: Vec3, u: Vec3) -> tuple[Vec3, Vec3]:
    """Return the twist U_ξ = Λ∘U_X∘Λ⁻¹ in inertial axes of the twist (ω, u) in body axes, both parts (..., 3).

    With the attitude R and the position r of the pose Λ, the result is (Rω, Ru + r × Rω). This is the adjoint action of
    SE(3); `adjoint` is its matrix. ω [rad/s] is the angular rate, and u [m/s] the velocity of the body point at the
    origin of the axes.
    """
    position, q = to_pose(dual)
    rate = quaternion.rotate(q, omega)
    return rate, quaternion.rotate(q, u) + cross(position, rate)


@of_arrays
def body_twist(dual: DualQuat, omega: Vec3, u: Vec3) -> tuple[Vec3, Vec3]:
    """Return the twist U_X = Λ⁻¹∘U_ξ∘Λ in body axes of the twist (ω, u) in inertial axes, both parts (..., 3).

    It is the inverse of `inertial_twist`, (Rᵀω, Rᵀ(u − r × ω)), and its matrix is `adjoint(inverse(dual))`.
    """
    position, q = to_pose(dual)
    back = quaternion.conjugate(q)
    return quaternion.rotate(back, omega), quaternion.rotate(back, u - cross(position, omega))


@of_arrays
def adjoint(dual: DualQuat) -> Mat6:
    """Return the adjoint (..., 6, 6) of the pose Λ, the matrix of `inertial_twist` for twists (ω, u), ω first.

    Ad = ((R, 0), ([r×]R, R)). It is Ad_a Ad_b for the product Λ_a∘Λ_b (Lynch and Park, Modern Robotics, section 3.3.2).
    """
    columns = [xp.concatenate(inertial_twist(dual, *_parts(e)), axis=-1) for e in np.eye(6, dtype=dual.dtype)]
    return xp.stack(columns, axis=-1)


@of_arrays
def left_jacobian(v: Vec3, u: Vec3) -> Mat6:
    """Return the left Jacobian (..., 6, 6) of SE(3) at the twist (`v`, `u`) of `exp`, both (..., 3).

    It maps the rates (v̇, u̇) to the twist of Λ = exp(v, u) in inertial axes, 2Λ̇∘Λ⁻¹: J = ((J_v, 0), (Q, J_v)), where J_v
    is `rotation.left_jacobian` at v and Q its derivative in the direction u, by the transference principle. Values and
    derivatives are finite for all v and u (Barfoot, State Estimation for Robotics, section 7.1.5).
    """
    v, u = xp.broadcast_arrays(v, u)
    diagonal, below = rotation_rates.left_jacobian(v), left_jacobian_derivative(v, u)
    upper = xp.concatenate([diagonal, xp.zeros_like(diagonal)], axis=-1)
    return xp.concatenate([upper, xp.concatenate([below, diagonal], axis=-1)], axis=-2)


@of_arrays
def right_jacobian(v: Vec3, u: Vec3) -> Mat6:
    """Return the right Jacobian (..., 6, 6) of SE(3) at the twist (`v`, `u`) of `exp`, both (..., 3).

    It maps the rates (v̇, u̇) to the twist of Λ = exp(v, u) in body axes, 2Λ⁻¹∘Λ̇, and is `left_jacobian(-v, -u)`.
    """
    return left_jacobian(-v, -u)


def _parts(twist: Any) -> tuple[Any, Any]:
    return twist[..., :3], twist[..., 3:]


def _pure(v: Vec3) -> Quat:
    return xp.concatenate([xp.zeros_like(v[..., :1]), v], axis=-1)
