"""Store torques and wheel momenta of a rigid body under a law, and deviations from the exact error equation."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import conjugate, product
from qtraj.foundation.arrays import as_float
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent, times_text
from qtraj.foundation.types import ArrayInput, Quat
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_quaternion, error_rate
from qtraj.motion.control.laws import AccelerationLaw
from qtraj.motion.control.response import error_state

MISMATCH = 1e-6
"""A mismatch above this fraction of the largest acceleration is not a rounding error."""


@storable
class BodyMotion(AbstractResult):
    """The torques of a simulated `RigidBody` and deviations from the exact error equation, at `times` (n,) [s].

    - `torque` (n, 3) [N m]: the torque of motors or thrusters on the body, body axes.
    - `momentum` (n, m) [N m s]: the momenta of the wheels; None without wheels.
    - `mismatch` (n, 3) [rad/s²]: the acceleration of the body minus the command of the law at the true state, body
      axes. The mismatch is caused by errors of the inertia and the sensors, disturbances, limits and sampling.
    - `residual` (n, 4) [1/s²]: ẍ + K1ẋ + K2x, the residual of the error equation of an `AccelerationLaw` with the error
      x; None for other laws.
    - `deviation` (n, 4): the error quaternion minus its closed form for the same initial state; None for other laws and
      for hysteretic laws.
    """

    times: Float[Array, "*batch n"]
    torque: Float[Array, "*batch n 3"]
    momentum: Float[Array, "*batch n m"] | None
    mismatch: Float[Array, "*batch n 3"]
    residual: Float[Array, "*batch n 4"] | None
    deviation: Float[Array, "*batch n 4"] | None

    def __init__(
        self,
        times: ArrayInput,
        torque: ArrayInput,
        mismatch: ArrayInput,
        momentum: ArrayInput | None = None,
        residual: ArrayInput | None = None,
        deviation: ArrayInput | None = None,
    ):
        self.times, self.torque, self.mismatch = as_float(times), as_float(torque), as_float(mismatch)
        self.momentum = None if momentum is None else as_float(momentum)
        self.residual = None if residual is None else as_float(residual)
        self.deviation = None if deviation is None else as_float(deviation)

    def variables(self) -> dict[str, Quantity]:
        """Return the fields with units, along `time`, or along `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        error = (along, "component")
        columns = {
            "torque": Quantity(self.torque, "N m", "control torque on the body, body axes", (along, "body")),
            "momentum": Quantity(self.momentum, "N m s", "momentum of each wheel about its axis", (along, "wheel")),
            "mismatch": Quantity(
                self.mismatch, "rad s-2", "acceleration minus the command of the law, body axes", (along, "body")
            ),
            "residual": Quantity(self.residual, "s-2", "residual of the closed-loop error equation", error),
            "deviation": Quantity(self.deviation, "1", "error quaternion minus its closed form", error),
        }
        return {name: q for name, q in columns.items() if q.values is not None}

    def record(self) -> Record:
        """Return the fields with units, along `time`, or along `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        prefix = batch_prefix(self.torque.shape[:-2])
        summary = f"{prefix}{times_text(self.times)}: {self.exactness()}, torque {extent(_length(self.torque), 'N m')}"
        return Record(
            summary, self.variables(), {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": "body"}
        )

    def exactness(self) -> str:
        """Describe the deviation from the exact error equation."""
        text = f"the acceleration deviated from the command by up to {_largest(self.mismatch):.3g} rad/s²"
        if self.deviation is None:
            return text
        return f"{text}, and the error deviated from its closed form by up to {_largest(self.deviation):.3g}"

    def largest(self) -> Float[Array, "*batch"]:
        """Return the largest magnitude of `mismatch` [rad/s²]; NaN if an instant was not reached."""
        return jnp.max(jnp.sqrt(jnp.sum(self.mismatch**2, axis=-1)), axis=-1)

    def first_mismatch(self, command: ArrayInput, rate: ArrayInput) -> float | None:
        """Return the first instant [s] at which `mismatch` is not a rounding error; None if there is none.

        `command` (n, 3) [rad/s²] and `rate` (n, 3) or (n, 4) [rad/s] of the solution determine the rounding errors.
        """
        largest = np.max(_length(command)) + np.max(_length(np.asarray(rate)[:, -3:])) ** 2
        deviates = _length(self.mismatch) > MISMATCH * largest
        return float(self.times[np.argmax(deviates)]) if deviates.any() else None


def residual_of(law: AccelerationLaw, reference: Attitude, quaternion: Quat, mismatch: Quat) -> Quat:
    """Return the residual ẍ + K1ẋ + K2x [1/s²] if the acceleration is the command plus `mismatch` (4,) [rad/s²].

    The mismatch changes the second derivative λ̈ by ½λ∘mismatch.
    """
    second_derivative = 0.5 * product(quaternion, mismatch)
    if law.error == "body":
        return product(conjugate(reference.quaternion), second_derivative)
    return product(second_derivative, conjugate(reference.quaternion)) if law.error == "inertial" else second_derivative


def deviation_of(
    law: AccelerationLaw, references: Attitude, times: Float[Array, " n"], quaternions: Array, rates: Array
) -> Float[Array, "n 4"]:
    """Return the error of the law minus the closed form with the same state at times[0]."""
    first = jax.tree.map(lambda x: x[0], references)
    x = error_quaternion(first, quaternions[0], law.error)
    v = error_rate(first, quaternions[0], rates[0], law.error)
    closed = jax.vmap(lambda t: error_state(law, x, v, t - times[0])[0])(times)
    return jax.vmap(lambda at, q: error_quaternion(at, q, law.error))(references, quaternions) - closed


def _length(x: ArrayInput) -> np.ndarray:
    return np.linalg.norm(np.asarray(x), axis=-1)


def _largest(x: Array) -> float:
    lengths = _length(x)
    finite = lengths[np.isfinite(lengths)]
    return float(finite.max()) if finite.size else float("nan")
