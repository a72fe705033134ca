"""Dual quaternions Λ = λ + s λ′, s² = 0, which represent position and attitude by eight components.

The pose with position r (inertial axes) and attitude λ is Λ = λ + s ½ r∘λ; a point x of the body has the position r +
λ∘x∘λ⁻¹. Poses multiply like attitudes: Λ_AC = Λ_AB∘Λ_BC, where Λ_AB is the pose of B relative to A. Let ω be the
angular rate and v the velocity of the body's origin. With the twist U = ω + s u, 2Λ̇ = Λ∘U_X = U_ξ∘Λ. In body axes
(index X), u is v; in inertial axes (index ξ), u = v + r × ω is the velocity of the body point at the inertial origin
(Kotelnikov's transference principle; Chelnokov and Nelaeva, 2015). λ may have any nonzero norm.

A dual quaternion is an array (8,) with λ first. Leading axes of the arrays are batch axes.
"""

from qtraj.algebra import quaternion
from qtraj.algebra.rotation_rates import left_jacobian, left_jacobian_inverse
from qtraj.foundation.namespace import matmul, of_arrays, xp
from qtraj.foundation.types import DualQuat, Quat, Scalar, Vec3


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
    return from_pose(matmul(left_jacobian(v), u[..., None])[..., 0], quaternion.exp(0.5 * v))


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


def _pure(v: Vec3) -> Quat:
    return xp.concatenate([xp.zeros_like(v[..., :1]), v], axis=-1)
