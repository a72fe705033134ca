"""Hamilton's algebra on unnormalised quaternions of shape (4,), and the conventions of the whole library.

| question                | answer                                                                                   |
|-------------------------|------------------------------------------------------------------------------------------|
| component order         | λ = (λ0, λ1, λ2, λ3), scalar first                                                       |
| product                 | Hamilton: i∘j = k, i∘i = −1                                                              |
| direction               | λ maps body X to inertial ξ: v_ξ = λ∘v_X∘λ⁻¹ (one vector, two sets of components)        |
| as an active rotation   | R(λ)v = λ∘v∘λ⁻¹ turns the inertial basis into the body basis                             |
| turn by Φ about e       | λ = cos Φ/2 + e sin Φ/2 = exp(Φe/2), positive by the right-hand rule                     |
| composition             | λ_AC = λ_AB∘λ_BC for C → B → A; a further turn in body axes multiplies on the right      |
| rates                   | 2λ̇ = λ∘ω_x (body axes) = ω_ξ∘λ (inertial axes); ω is (3,), or (4,) with scalar part first |
| scalar part of ω        | ω0 = d/dt ln(λ∘λ̄); the attitude does not depend on it                                   |
| direction cosines α     | inertial → body, v_X = α v_ξ, α = R(λ)ᵀ; the rows of α are the body axes (τ, n, b)       |
| Gibbs vector            | G = λ_v/λ0 = e tan Φ/2, the same components in both axes (αG = G)                        |
| scale                   | every read-out of λ agrees for λ and cλ, c ≠ 0; λ = 0 has no attitude and gives NaN      |
| SciPy                   | `Rotation.from_quat(λ, scalar_first=True)`; its `as_matrix()` is R(λ) = αᵀ               |

Each function takes one quaternion; batches are `jax.vmap`'s. Paper S writes α_k for λ_k, paper C writes λ.
"""

import math

import jax.numpy as jnp

from qtraj.algebra import matrices
from qtraj.algebra.vector import balanced, norm, unit as unit_vector
from qtraj.foundation.types import Flag, Mat4, Quat, Scalar, Vec3

_COS = [(-1) ** k / math.factorial(2 * k) for k in range(8)]
_SINC = [(-1) ** k / math.factorial(2 * k + 1) for k in range(8)]
_ATANC = [(-1) ** k / (2 * k + 1) for k in range(8)]
_SMALL_ANGLE_SQUARED = 0.05  # below, the series are exact to rounding with two derivatives;
_SMALL_TANGENT_SQUARED = 0.0025  # above, the closed forms are, since their derivatives lose no more than 1/θ


def product(p: Quat, q: Quat) -> Quat:
    """p∘q by Hamilton's rule."""
    a, b, c, d = p
    s, x, y, z = q
    return jnp.stack(
        [
            a * s - b * x - c * y - d * z,
            a * x + b * s + c * z - d * y,
            a * y - b * z + c * s + d * x,
            a * z + b * y - c * x + d * s,
        ]
    )


def conjugate(q: Quat) -> Quat:
    """q̄ = (q0, −q1, −q2, −q3)."""
    return jnp.concatenate([q[:1], -q[1:]])


def norm_squared(q: Quat) -> Scalar:
    """|q|² = q∘q̄."""
    return jnp.sum(q * q)


def inverse(q: Quat) -> Quat:
    """q⁻¹ = q̄/|q|²."""
    length = norm(q)
    return conjugate(q) / length / length  # |q|² could underflow


def unit(q: Quat) -> Quat:
    """q/|q|; NaN for q = 0."""
    return q / norm(q)


def canonical(q: Quat) -> Quat:
    """Of q and −q the one whose first non-zero component is positive: scalar ≥ 0, and one choice for half turns."""
    s, x, y, z = q
    return jnp.where(_negative(s, _negative(x, _negative(y, z < 0))), -q, q)


def from_xyzw(xyzw: Quat) -> Quat:
    """λ from components with the scalar part last, as SciPy's default, ROS and TUM files have them."""
    return jnp.roll(xyzw, 1, axis=-1)


def to_xyzw(q: Quat) -> Quat:
    """The components of λ with the scalar part last."""
    return jnp.roll(q, -1, axis=-1)


def _negative(x: Scalar, next_is: Flag) -> Flag:
    return (x < 0) | ((x == 0) & next_is)


def rotate(q: Quat, v_body: Vec3) -> Vec3:
    """Body vector in inertial axes, λ∘v∘λ⁻¹; `q` and `c*q` agree for any c ≠ 0."""
    q = balanced(q)
    s, u = q[0], q[1:]
    return v_body + 2 * jnp.cross(u, s * v_body + jnp.cross(u, v_body)) / norm_squared(q)


def left_matrix(q: Quat) -> Mat4:
    """L(q) with L(q) p = q∘p; paper S's A."""
    return matrices.a(q)


def right_matrix(q: Quat) -> Mat4:
    """R(q) with R(q) p = p∘q; paper S's ᵗAᵗ."""
    return matrices.tat(q)


def exp(v: Vec3) -> Quat:
    """Exponential of the pure quaternion (0, v): (cos|v|, v sin|v|/|v|), the turn by 2|v| [rad] about v."""
    square = jnp.sum(v * v)
    small = square < _SMALL_ANGLE_SQUARED
    near = jnp.where(small, square, 0.0)
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    cosine = jnp.where(small, _series(_COS, near), jnp.cos(angle))
    sinc = jnp.where(small, _series(_SINC, near), jnp.sin(angle) / angle)
    return jnp.concatenate([cosine[None], sinc * v])


def log(q: Quat) -> Vec3:
    """Vector part of ln q, half a rotation vector of length [0, π]: exp(log(q)) = q/|q|, log(cq) = log(q) for c > 0.

    The scalar part is `log_norm`. A negative real q has the length π and no axis of its own: (π, 0, 0) is given, with
    zero derivative. The other branch, for shortest turns, is `rotation.to_rotation_vector`.
    """
    q = balanced(q)
    s, u = q[0], q[1:]
    square = jnp.sum(u * u)
    small = (s > 0) & (square < _SMALL_TANGENT_SQUARED * s * s)
    cosine = jnp.where(small, s, 1.0)
    tangent_squared = jnp.where(small, square, 0.0) / (cosine * cosine)
    near = u * _series(_ATANC, tangent_squared) / cosine
    first_axis = jnp.asarray([1.0, 0.0, 0.0], dtype=q.dtype)
    far = unit_vector(u, first_axis) * jnp.arctan2(norm(u), s)
    return jnp.where(small, near, far)


def log_norm(q: Quat) -> Scalar:
    """Scalar part of ln q: ln|q|."""
    return jnp.log(norm(q))


def derivative(q: Quat, omega: Vec3 | Quat, axes: str = "body") -> Quat:
    """λ̇ [1/s] at the rate `omega` [rad/s]: 2λ̇ = λ∘ω_x in body axes, ω_ξ∘λ in inertial axes.

    `omega` is a vector (3,), or (4,) with the scalar part ω0 = d/dt ln|λ|² first.

    **Raises:** ValueError for other axes.
    """
    rate = omega if omega.shape == (4,) else jnp.concatenate([jnp.zeros_like(omega, shape=1), omega])
    if axes == "body":
        return 0.5 * product(q, rate)
    if axes == "inertial":
        return 0.5 * product(rate, q)
    raise ValueError(f"axes must be 'body' or 'inertial', but {axes!r} was given")


def _series(coefficients: list[float], x: Scalar) -> Scalar:
    """Σ_k coefficients_k x^k by Horner's rule."""
    total = jnp.full_like(x, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total
