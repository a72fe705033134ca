"""Compute error quaternions of a body relative to its program, their rates, and the state from an error.

The definitions are from paper C, (1.1):

| kind         | error            | target      | rate                           |
|--------------|------------------|-------------|--------------------------------|
| `"body"`     | μ = λ̄⁰∘λ         | 1           | 2μ̇ = μ∘ω_x − ω_z⁰∘μ            |
| `"inertial"` | μ* = λ∘λ̄⁰        | 1           | 2μ̇* = ω_ξ∘μ* − μ*∘ω_ξ⁰         |
| `"additive"` | Δ = λ − λ⁰       | 0           | 2Δ̇ = λ∘ω_x − λ⁰∘ω_z⁰           |

λ⁰ is the unit quaternion of the program; λ, the quaternion of the body, need not be normalised. The rate of the body is
ω_x in body axes and ω_ξ in inertial axes; the rate of the program is ω_z⁰ in program axes and ω_ξ⁰ in inertial axes.
Rates have four components: first the virtual rate ω0 = d/dt ln|λ|², which is 0 for the program, then the physical rate.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import conjugate, derivative, inverse, product
from qtraj.algebra.vector import norm
from qtraj.foundation.float_arguments import float_arguments
from qtraj.foundation.namespace import in_numpy, xp
from qtraj.foundation.types import Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude, require_body_axes

KINDS = ("body", "inertial", "additive")


def pure(v: Vec3) -> Quat:
    """Return the quaternion (0, v) of a vector."""
    return jnp.concatenate([jnp.zeros_like(v[..., :1]), v], axis=-1)


def target(kind: str, error: Quat) -> Quat:
    """Return the value of an error for λ = λ⁰, with the shape and dtype of `error`.

    The value is (1, 0, 0, 0) for the body and the inertial error, and 0 for the additive error.
    """
    zero = jnp.zeros_like(error)
    return zero if kind == "additive" else zero.at[..., 0].set(1.0)


@float_arguments
def error_quaternion(reference: Attitude, quaternion: Quat, kind: str = "body") -> Quat:
    """Return the error μ, μ* or Δ (4,) of λ = `quaternion` relative to the program.

    **Raises:** ValueError for a `kind` other than "body", "inertial" or "additive".
    """
    require_kind(kind)
    if kind == "body":
        return product(conjugate(reference.quaternion), quaternion)
    if kind == "inertial":
        return product(quaternion, conjugate(reference.quaternion))
    return quaternion - reference.quaternion


@float_arguments
def error_rate(reference: Attitude, quaternion: Quat, rate: Quat, kind: str = "body") -> Quat:
    """Return the time derivative [1/s] of `error_quaternion` for a body with the `rate` (4,) [rad/s], body axes.

    **Raises:** ValueError for a `kind` other than "body", "inertial" or "additive", or a reference in inertial axes.
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


@float_arguments
def error_angle(reference: Attitude, quaternion: Quat) -> Scalar:
    """Return the attitude error angle [rad], from 0 to π; λ and −λ have the same angle."""
    mu = error_quaternion(reference, quaternion)
    return 2 * xp.arctan2(norm(mu[..., 1:]), abs(mu[..., 0]))


@in_numpy
def body_errors_at(
    references: Attitude, quaternions: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Return the body errors μ and the attitude error angles [rad] at n instants."""
    return error_quaternion(references, quaternions), error_angle(references, quaternions)


@float_arguments
def state_from_error(reference: Attitude, error: Quat, rate: Quat, kind: str = "body") -> tuple[Quat, Quat]:
    """Return λ (4,) and the body rate ω_x (4,) [rad/s] from an error and its time derivative `rate` (4,) [1/s].

    For the body error, λ = λ⁰∘μ and ω_x = μ⁻¹∘ω_z⁰∘μ + 2μ⁻¹∘μ̇.

    **Raises:** ValueError for a `kind` other than "body", "inertial" or "additive", or a reference in inertial axes.
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
    """Transform `x` (4,) from body to inertial axes by λ∘x∘λ⁻¹, λ = `quaternion`; the scalar part does not change."""
    return product(product(quaternion, x), inverse(quaternion))


def to_body(quaternion: Quat, x: Quat) -> Quat:
    """Transform `x` (4,) from inertial to body axes by λ⁻¹∘x∘λ, λ = `quaternion`; the scalar part does not change."""
    return product(product(inverse(quaternion), x), quaternion)


def require_kind(kind: str) -> None:
    """Raise a ValueError unless `kind` is in `KINDS`."""
    if kind not in KINDS:
        raise ValueError(f"error must be one of {', '.join(map(repr, KINDS))}, but {kind!r} was given")
