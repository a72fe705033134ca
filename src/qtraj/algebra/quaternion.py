"""Hamilton's algebra for quaternions of shape (4,) with any norm, and the conventions of the whole library.

| question                | answer                                                                                   |
|-------------------------|------------------------------------------------------------------------------------------|
| component order         | λ = (λ0, λ1, λ2, λ3), scalar first                                                       |
| product                 | Hamilton: i∘j = k, i∘i = −1                                                              |
| direction               | λ maps body X to inertial ξ: v_ξ = λ∘v_X∘λ⁻¹ (one vector, two sets of components)        |
| as an active rotation   | R(λ)v = λ∘v∘λ⁻¹ rotates the inertial basis into the body basis                           |
| rotation by Φ about e   | λ = cos Φ/2 + e sin Φ/2 = exp(Φe/2), positive by the right-hand rule                     |
| composition             | λ_AC = λ_AB∘λ_BC for C → B → A; a further rotation in body axes multiplies on the right  |
| rates                   | 2λ̇ = λ∘ω_X (body axes) = ω_ξ∘λ (inertial axes); ω is (3,), or (4,) with scalar part first |
| scalar part of ω        | ω0 = d/dt ln(λ∘λ̄); the attitude does not depend on it                                   |
| direction cosines α     | inertial → body, v_X = α v_ξ, α = R(λ)ᵀ; the rows of α are the body axes (τ, n, b)       |
| Gibbs vector            | G = λ_v/λ0 = e tan Φ/2, the same in body and inertial components (αG = G)                |
| scale                   | λ and cλ, c ≠ 0, represent the same attitude in every function; λ = 0 has no attitude    |
| SciPy                   | `Rotation.from_quat(λ, scalar_first=True)`; its `as_matrix()` is R(λ) = αᵀ               |

The functions accept single quaternions and arrays of quaternions (..., 4), components last. Paper
S writes α_k for λ_k; paper C writes λ.
"""

import math

from qtraj.algebra import hamilton, matrices
from qtraj.algebra.polynomial import horner
from qtraj.algebra.vector import balanced, cross, norm, unit as unit_vector
from qtraj.foundation.namespace import of_arrays, xp
from qtraj.foundation.types import Mat4, Quat, Scalar, Vec3

__all__ = [
    "canonical",
    "conjugate",
    "derivative",
    "exp",
    "from_xyzw",
    "inverse",
    "left_matrix",
    "log",
    "log_norm",
    "norm_squared",
    "product",
    "rate",
    "right_matrix",
    "rotate",
    "to_xyzw",
    "unit",
]

_COS = [(-1) ** k / math.factorial(2 * k) for k in range(8)]
_SINC = [(-1) ** k / math.factorial(2 * k + 1) for k in range(8)]
_ATANC = [(-1) ** k / (2 * k + 1) for k in range(8)]
# Below these values of θ² (`exp`) and tan² θ (`log`), where θ is the norm of the logarithm, the series and their first
# two derivatives are exact to within rounding error. Above them, the closed forms are accurate, because the rounding
# error of their derivatives grows only in proportion to 1/θ.
_SMALL_ANGLE_SQUARED = 0.05
_SMALL_TANGENT_SQUARED = 0.0025


def __dir__() -> list[str]:
    return __all__


def components(q: Quat) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Return the components of `q` one by one."""
    return q[..., 0], q[..., 1], q[..., 2], q[..., 3]


@of_arrays
def product(p: Quat, q: Quat) -> Quat:
    """Return the Hamilton product p∘q."""
    return _joined(*hamilton.product(components(p), components(q)))


@of_arrays
def conjugate(q: Quat) -> Quat:
    """Return the conjugate q̄ = (q0, −q1, −q2, −q3)."""
    w, x, y, z = components(q)
    return _joined(w, -x, -y, -z)


@of_arrays
def norm_squared(q: Quat) -> Scalar:
    """Return the squared norm |q|² = q∘q̄."""
    return xp.sum(q * q, axis=-1)


@of_arrays
def inverse(q: Quat) -> Quat:
    """Return the inverse q⁻¹ = q̄/|q|²."""
    length = norm(q)[..., None]
    return conjugate(q) / length / length  # |q|² could underflow


@of_arrays
def unit(q: Quat) -> Quat:
    """Return the unit quaternion q/|q|; NaN for q = 0."""
    return q / norm(q)[..., None]


@of_arrays
def canonical(q: Quat) -> Quat:
    """Return q or −q, so that the first non-zero component is positive; the choice is unique at half turns too."""
    return xp.where(hamilton.is_negative(components(q))[..., None], -q, q)


@of_arrays
def from_xyzw(xyzw: Quat) -> Quat:
    """Move the scalar part from last to first. ROS, TUM files and, by default, SciPy store it last."""
    return xp.roll(xyzw, 1, axis=-1)


@of_arrays
def to_xyzw(q: Quat) -> Quat:
    """Move the scalar part of `q` from first to last."""
    return xp.roll(q, -1, axis=-1)


@of_arrays
def rotate(q: Quat, v_body: Vec3) -> Vec3:
    """Return q∘v∘q⁻¹, the inertial components of a body vector v; `q` and `c*q` give the same result for any c ≠ 0."""
    q = balanced(q)
    s, u = q[..., :1], q[..., 1:]
    return v_body + 2 * cross(u, s * v_body + cross(u, v_body)) / norm_squared(q)[..., None]


def left_matrix(q: Quat) -> Mat4:
    """Return the matrix L(q) with L(q) p = q∘p, which is A in paper S."""
    return matrices.a(q)


def right_matrix(q: Quat) -> Mat4:
    """Return the matrix R(q) with R(q) p = p∘q, which is ᵗAᵗ in paper S."""
    return matrices.tat(q)


@of_arrays
def exp(v: Vec3) -> Quat:
    """Return (cos|v|, v sin|v|/|v|), the exponential of the pure quaternion (0, v): a rotation by 2|v| [rad]."""
    square = xp.sum(v * v, axis=-1, keepdims=True)
    small = square < _SMALL_ANGLE_SQUARED
    near = xp.where(small, square, 0.0)
    angle = xp.sqrt(xp.where(small, 1.0, square))
    cosine = xp.where(small, horner(_COS, near), xp.cos(angle))
    sinc = xp.where(small, horner(_SINC, near), xp.sin(angle) / angle)
    return xp.concatenate([cosine, sinc * v], axis=-1)


@of_arrays
def log(q: Quat) -> Vec3:
    """Return the vector part of ln q, which is half a rotation vector.

    exp(log(q)) = q/|q|, and log(cq) = log(q) for c > 0. The norm of the result is in [0, π]. The scalar part of ln q is
    `log_norm`. A negative real q has no axis; the result is then (π, 0, 0), with zero derivative. For the shorter
    rotation use `rotation.to_rotation_vector`.
    """
    q = balanced(q)
    s, u = q[..., :1], q[..., 1:]
    square = xp.sum(u * u, axis=-1, keepdims=True)
    small = (s > 0) & (square < _SMALL_TANGENT_SQUARED * s * s)
    cosine = xp.where(small, s, 1.0)
    tangent_squared = xp.where(small, square, 0.0) / (cosine * cosine)
    near = u * horner(_ATANC, tangent_squared) / cosine
    first_axis = xp.stack([xp.ones_like(s[..., 0]), *2 * [xp.zeros_like(s[..., 0])]], axis=-1)
    far = unit_vector(u, first_axis) * xp.arctan2(norm(u)[..., None], s)
    return xp.where(small, near, far)


@of_arrays
def log_norm(q: Quat) -> Scalar:
    """Return ln|q|, the scalar part of ln q."""
    return xp.log(norm(q))


@of_arrays
def derivative(q: Quat, omega: Vec3 | Quat, axes: str = "body") -> Quat:
    """Return the derivative λ̇ [1/s] of λ = `q` at the rate `omega` [rad/s].

    2λ̇ = λ∘ω_X with the rate ω_X in body axes, and 2λ̇ = ω_ξ∘λ with the rate ω_ξ in inertial axes; `axes` are the axes
    of `omega`. `omega` is a vector (3,), or (4,) with the scalar part ω0 = d/dt ln|λ|² first.

    **Raises:** ValueError if `axes` is neither 'body' nor 'inertial'.
    """
    rate = omega if omega.shape[-1] == 4 else xp.concatenate([xp.zeros_like(omega[..., :1]), omega], axis=-1)
    if axes == "body":
        return 0.5 * product(q, rate)
    if axes == "inertial":
        return 0.5 * product(rate, q)
    raise ValueError(f"axes must be 'body' or 'inertial', but {axes!r} was given")


def rate(q: Quat, q_dot: Quat, axes: str = "body") -> Vec3:
    """Return the angular rate (..., 3) [rad/s] of λ = `q` (..., 4) with the derivative λ̇ = `q_dot` [1/s].

    The inverse of `derivative`, without the scalar part. λ may have any norm. `axes` are the axes of the result.

    **Raises:** ValueError if `axes` is neither 'body' nor 'inertial'.
    """
    return matrices.rate(q, q_dot, axes)


def _joined(w: Scalar, x: Scalar, y: Scalar, z: Scalar) -> Quat:
    return xp.stack([w, x, y, z], axis=-1)
