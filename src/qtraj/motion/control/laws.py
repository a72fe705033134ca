"""Define the feedback laws of paper C; their error equations are linear and independent of time and program.

μ, μ* and Δ are the body error, the inertial error and the additive error (see `errors`). Let x be μ − 1, μ* − 1 or Δ.
Under the acceleration law, x satisfies ẍ + K1ẋ + K2x = 0. Under the rate law, x = μ − 1 satisfies ẋ + Kx = 0. Gains
are constant: a scalar, (4,) for a diagonal, or (4, 4). The vector part of a command is physical. The scalar part is
virtual: the on-board computer uses it to control |λ|, which has no effect on the body.
"""

import abc
import os
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import derivative, inverse, product
from qtraj.foundation import document
from qtraj.foundation.arrays import as_float, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.float_arguments import float_arguments
from qtraj.foundation.namespace import in_numpy
from qtraj.foundation.shown import shown, shown_html
from qtraj.foundation.toml_fault import quoted
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude, require_body_axes
from qtraj.motion.control.errors import (
    error_angle,
    error_quaternion,
    error_rate,
    pure,
    require_kind,
    target,
    to_body,
    to_inertial,
)

Gain = Float[Array, ""] | Float[Array, " n"] | Float[Array, "n n"]


class AbstractLaw(eqx.Module):
    """A feedback law, which computes a command from the attitude of the program and the measured state of the body.

    An own law is a subclass with the method `__call__`. A law may have a state of its own, such as the integral of the
    error or the estimate of an observer. Such a law also has the methods `start` and `slope`, and takes its state as
    the fourth argument of `__call__`. `simulate` integrates the state with the motion if the command is continuous, and
    calls `updated` at each new command if the sensor or the actuator is sampled.

    `commands`: "acceleration" (default) or "rate", what the law commands. `vectorized`: whether `deviation` also
    accepts arrays over many instants, NumPy or JAX, with components last.
    """

    commands: ClassVar[str] = "acceleration"
    vectorized: ClassVar[bool] = False

    @abc.abstractmethod
    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat | Vec3:
        """Return the command in body axes [rad/s²], or [rad/s] if `commands` is "rate".

        The command is the physical vector (3,), or (4,) with a virtual scalar part first. `reference` is the attitude
        of the program; `quaternion` (4,) and `rate` (4,) [rad/s], virtual rate first, are the measured state.
        """

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """Return the error quaternion (4,) that the law controls; by default the body error μ."""
        return error_quaternion(reference, quaternion)

    def start(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Any:
        """Return the initial state of the law, an array or a tree of arrays, or None for a law without a state."""
        return None

    def slope(self, state: Any, reference: Attitude, quaternion: Quat, rate: Quat) -> Any:
        """Return the time derivative of `state`, with the same structure; only laws with a state have it."""
        raise TypeError(f"{type(self).__name__} has a state, so it needs the method slope")

    def updated(self, state: Any, elapsed: Scalar, reference: Attitude, quaternion: Quat, rate: Quat) -> Any:
        """Return the state of the law at a new command, `elapsed` [s] after the previous one, in a sampled loop.

        By default `state` + `elapsed`·`slope`, with the slope at the new measurement.
        """
        slope = self.slope(state, reference, quaternion, rate)
        return jax.tree.map(lambda x, dx: x + elapsed * dx, state, slope)

    _repr_html_ = shown_html

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the law without loss of precision to a TOML or JSON file, which `qtraj.load` reads.

        **Raises:** ValueError for a suffix other than .toml or .json.
        """
        document.save(self, file)


@storable
class AccelerationLaw(AbstractLaw):
    """A law that commands the angular acceleration [rad/s²], with the error equation ẍ + K1ẋ + K2x = 0.

    `k1` [1/s] and `k2` [1/s²]: scalar, (4,) diagonal or (4, 4). `error`: "body" (x = μ − 1; commands in body axes, for
    strapdown sensors), "inertial" (x = μ* − 1) or "additive" (x = Δ). For the body error and scalar gains, the physical
    command is μ⁻¹ε⁰μ + w×Ω − (K1 + ω0)Ω − 2K2 μ_v/|μ|² with w = μ⁻¹ω⁰μ, Ω = ω_v − w and the physical rate ω_v of the
    body. ω⁰ and ε⁰ are the rate and the acceleration of the program in program axes, and ω0 is the virtual rate. The
    command has a pole at μ = 0: Ω and ω0 grow as 1/|μ|, so their product grows as 1/|μ|².

    **Raises:** ValueError for gains that are not finite or of another shape, or for an `error` other than "body",
    "inertial" or "additive".
    """

    k1: Gain
    k2: Gain
    error: str = eqx.field(static=True)
    vectorized: ClassVar[bool] = True

    def __init__(self, k1: ArrayInput, k2: ArrayInput, error: str = "body"):
        self.k1 = gain(k1, "k1", 4)
        self.k2 = gain(k2, "k2", 4)
        require_kind(error)
        self.error = error

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    @float_arguments
    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """Return the command (4,) [rad/s²] in body axes, with the virtual part first, then the physical vector."""
        x = error_quaternion(reference, quaternion, self.error)
        v = error_rate(reference, quaternion, rate, self.error)
        feedback = apply(self.k1, v) + apply(self.k2, x - target(self.error, x))  # −ẍ
        if self.error == "body":
            omega, epsilon = pure(reference.rate), pure(reference.acceleration)
            drift = product(epsilon, x) + product(omega, v) - product(v, rate)
            return product(inverse(x), drift - 2 * feedback)
        if self.error == "inertial":
            omega = to_inertial(quaternion, rate)
            omega_program = to_inertial(reference.quaternion, pure(reference.rate))
            epsilon = to_inertial(reference.quaternion, pure(reference.acceleration))
            drift = product(x, epsilon) + product(v, omega_program) - product(omega, v)
            return to_body(quaternion, product(drift - 2 * feedback, inverse(x)))
        second = second_derivative(reference) - feedback  # λ̈
        return 2 * product(inverse(quaternion), second) - 0.5 * product(rate, rate)

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """Return the error quaternion μ, μ* or Δ (4,) that the law controls."""
        return error_quaternion(reference, quaternion, self.error)


@storable
class RateLaw(AbstractLaw):
    """A law that commands the angular rate [rad/s], with the error equation μ̇ + K(μ − 1) = 0.

    The law is for bodies whose rate can be commanded. The command is ω_x = μ⁻¹∘[ω_z⁰∘μ − 2K(μ − 1)] with the rate ω_z⁰
    of the program in program axes. `k` [1/s]: scalar, (4,) diagonal or (4, 4).

    **Raises:** ValueError for a gain that is not finite or of another shape.
    """

    k: Gain
    commands: ClassVar[str] = "rate"
    vectorized: ClassVar[bool] = True

    def __init__(self, k: ArrayInput):
        self.k = gain(k, "k", 4)

    def __repr__(self) -> str:
        return shown(self, k="1/s")

    @float_arguments
    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat | None = None) -> Quat:
        """Return the command (4,) [rad/s] in body axes; `rate` is not used."""
        require_body_axes(reference)
        mu = error_quaternion(reference, quaternion)
        feedback = apply(self.k, mu - target("body", mu))
        return product(inverse(mu), product(pure(reference.rate), mu) - 2 * feedback)

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """Return the error quaternion μ (4,)."""
        return error_quaternion(reference, quaternion)


def commanded(law: AbstractLaw, state: Any, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
    """Return the command (4,) of a law; the virtual part of a command (3,) is 0.

    `state`: the state of the law, None for a law without a state.

    **Raises:** ValueError for a command of another shape.
    """
    function: Any = law
    command = function(reference, quaternion, rate, *(() if state is None else (state,)))
    command = as_float(jnp.asarray(command) if isinstance(command, list | tuple) else command).astype(quaternion.dtype)
    if command.shape not in ((3,), (4,)):
        raise ValueError(
            f"the command of {type(law).__name__} must have shape (3,), or (4,) with the virtual part first, but has "
            f"shape {command.shape}"
        )
    return pure(command) if command.shape == (3,) else command


def has_state(law: AbstractLaw) -> bool:
    """Return whether a law defines a state of its own."""
    return type(law).start is not AbstractLaw.start


def require_linear(law: Any, what: str) -> None:
    """Raise a ValueError unless the error equation of a law is linear, so that `what` has a closed form."""
    if not isinstance(law, AccelerationLaw | RateLaw):
        raise ValueError(
            f"{what} has a closed form only for an AccelerationLaw or a RateLaw, whose error equations are linear, but "
            f"{law!r} was given: use simulate"
        )


def errors_at(
    law: AbstractLaw, references: Attitude, quaternions: Float[Array, "n 4"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Return the error quaternion of the law and the attitude error angle [rad] at n instants."""
    return (_errors_at if law.vectorized else _mapped_errors_at)(law, references, quaternions)


@in_numpy
def _errors_at(law: AbstractLaw, references: Attitude, quaternions: Float[Array, "n 4"]) -> tuple[Array, Array]:
    return law.deviation(references, quaternions), error_angle(references, quaternions)


@eqx.filter_jit
def _mapped_errors_at(law: AbstractLaw, references: Attitude, quaternions: Float[Array, "n 4"]) -> tuple[Array, Array]:
    return jax.vmap(lambda *x: (law.deviation(*x), error_angle(*x)))(references, quaternions)


def second_derivative(reference: Attitude) -> Quat:
    """Return the second time derivative λ̈⁰ = ½λ⁰∘(ε_z⁰ − ½|ω⁰|²) [1/s²] of the quaternion of a program.

    ω⁰ and ε_z⁰ are the rate and the acceleration of the program in program axes.
    """
    scalar = -0.5 * jnp.sum(reference.rate * reference.rate, axis=-1, keepdims=True)
    return derivative(reference.quaternion, jnp.concatenate([scalar, reference.acceleration], axis=-1))


def gain(k: ArrayInput, name: str, size: int) -> Array:
    """Return a gain as a finite float array of shape (), (size,) or (size, size); raise a ValueError otherwise."""
    expected = f"{name} must be a number, {size} numbers for a diagonal, or a {size} × {size} matrix"
    try:
        array = as_float(k)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{expected}, but {quoted(k)} was given") from error
    if array.shape not in ((), (size,), (size, size)):
        raise ValueError(f"{expected}, but {quoted(k)} with shape {array.shape} was given")
    require_finite(array, name)
    return array


def apply(k: Array, x: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the product Kx for a scalar, diagonal or full matrix K."""
    k = k.astype(x.dtype)
    return jnp.einsum("ij,...j->...i", k, x, precision="highest") if k.ndim == 2 else jnp.broadcast_to(k, x.shape) * x
