"""Error quaternions of a body against its program, their rates, and the way back (paper C, scheme (1.1)).

| kind         | error            | vanishes at | its rate                       |
|--------------|------------------|-------------|--------------------------------|
| `"body"`     | μ = λ̄⁰∘λ         | 1           | 2μ̇ = μ∘ω_x − ω_z⁰∘μ            |
| `"inertial"` | μ* = λ∘λ̄⁰        | 1           | 2μ̇* = ω_ξ∘μ* − μ*∘ω_ξ⁰         |
| `"additive"` | Δ = λ − λ⁰       | 0           | 2Δ̇ = λ∘ω_x − λ⁰∘ω_z⁰           |

λ⁰ is the unit quaternion of the program; λ may have any length. Rates are (4,) in body axes, ω0 = d/dt ln|λ|² first.
"""

import jax.numpy as jnp

from qtraj.algebra.quaternion import conjugate, derivative, inverse, product
from qtraj.algebra.vector import norm
from qtraj.foundation.types import Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude, require_body_axes

KINDS = ("body", "inertial", "additive")


def pure(v: Vec3) -> Quat:
    """The quaternion (0, v) of a vector."""
    return jnp.concatenate([jnp.zeros_like(v, shape=1), v])


def target(kind: str, error: Quat) -> Quat:
    """What an error of this kind is when there is none: (1, 0, 0, 0), or 0 for the additive error."""
    nothing = jnp.zeros_like(error)
    return nothing if kind == "additive" else nothing.at[0].set(1.0)


def error_quaternion(reference: Attitude, quaternion: Quat, kind: str = "body") -> Quat:
    """The error (4,) of λ against the program: μ, μ* or Δ.

    **Raises:** ValueError for another kind.
    """
    require_kind(kind)
    if kind == "body":
        return product(conjugate(reference.quaternion), quaternion)
    if kind == "inertial":
        return product(quaternion, conjugate(reference.quaternion))
    return quaternion - reference.quaternion


def error_rate(reference: Attitude, quaternion: Quat, rate: Quat, kind: str = "body") -> Quat:
    """d/dt of `error_quaternion` [1/s], for the body rate (4,) [rad/s].

    **Raises:** ValueError for another kind.
    """
    require_body_axes(reference)
    error = error_quaternion(reference, quaternion, kind)
    if kind == "body":
        return 0.5 * (product(error, rate) - product(pure(reference.rate), error))
    if kind == "inertial":
        omega = to_inertial(quaternion, rate)
        omega_program = to_inertial(reference.quaternion, pure(reference.rate))
        return 0.5 * (product(omega, error) - product(error, omega_program))
    return derivative(quaternion, rate) - derivative(reference.quaternion, reference.rate)


def error_angle(reference: Attitude, quaternion: Quat) -> Scalar:
    """The angle of the turn from the program to the body, 0 … π [rad]; λ and −λ have the same."""
    mu = error_quaternion(reference, quaternion)
    return 2 * jnp.arctan2(norm(mu[1:]), jnp.abs(mu[0]))


def state_from_error(reference: Attitude, error: Quat, rate: Quat, kind: str = "body") -> tuple[Quat, Quat]:
    """The λ (4,) and body rate ω_x (4,) [rad/s] that have this error and this error rate [1/s].

    For the body error λ = λ⁰∘μ and ω_x = μ⁻¹∘ω_z⁰∘μ + 2μ⁻¹∘μ̇.

    **Raises:** ValueError for another kind.
    """
    require_body_axes(reference)
    require_kind(kind)
    if kind == "body":
        quaternion = product(reference.quaternion, error)
        omega = product(pure(reference.rate), error) + 2 * rate
        return quaternion, product(inverse(error), omega)
    if kind == "inertial":
        quaternion = product(error, reference.quaternion)
        omega_program = to_inertial(reference.quaternion, pure(reference.rate))
        omega = product(product(error, omega_program) + 2 * rate, inverse(error))
        return quaternion, to_body(quaternion, omega)
    quaternion = reference.quaternion + error
    velocity = derivative(reference.quaternion, reference.rate) + rate
    return quaternion, 2 * product(inverse(quaternion), velocity)


def to_inertial(quaternion: Quat, x: Quat) -> Quat:
    """λ∘x∘λ⁻¹: a quaternion of body components in inertial ones; the scalar part is the same."""
    return product(product(quaternion, x), inverse(quaternion))


def to_body(quaternion: Quat, x: Quat) -> Quat:
    """λ⁻¹∘x∘λ: a quaternion of inertial components in body ones; the scalar part is the same."""
    return product(product(inverse(quaternion), x), quaternion)


def require_kind(kind: str) -> None:
    """Raise a ValueError where `kind` is not one of the three errors."""
    if kind not in KINDS:
        raise ValueError(f"error must be one of {', '.join(map(repr, KINDS))}, but {kind!r} was given")
