"""Define disturbances: angular accelerations and torques that are not commanded."""

import abc
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.arrays import one_instant, real_scalar, real_vector, require_finite, require_positive
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import reads_older, storable
from qtraj.foundation.float_arguments import single_arguments
from qtraj.foundation.renamed import renamed_arguments
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.simulation.signals import Signal, SignalInput, at_state, checked_signal


@storable
class Sinusoid(eqx.Module):
    """The disturbance signal amplitude·sin(2πt/period + phase), which can be saved to a file.

    `amplitude` (3,), in the unit of the disturbance; `period` [s]; `phase` [rad].

    **Raises:** ValueError for an amplitude of another shape, a period that is not positive, or a phase that is not
    finite.
    """

    amplitude: Vec3
    period: Scalar
    phase: Scalar

    def __init__(self, amplitude: ArrayInput, period: ArrayInput, phase: ArrayInput = 0.0):
        self.amplitude = real_vector(amplitude, "the amplitude", 3)
        self.period, self.phase = real_scalar(period, "the period"), real_scalar(phase, "the phase")
        require_positive(self.period, "the period", "s")
        require_finite(self.phase, "the phase")

    def __repr__(self) -> str:
        return shown(self, period="s", phase="rad")

    @on_one_device
    def __call__(self, t: ScalarLike) -> Vec3:
        """Return the vector (3,) at the time `t` [s]."""
        t = one_instant(t)
        wave = jnp.sin(2 * math.pi * t / self.period.astype(t.dtype) + self.phase.astype(t.dtype))
        return self.amplitude * wave.astype(self.amplitude.dtype)


class AbstractDisturbance(eqx.Module):
    """An angular acceleration that is not commanded; the base class of own disturbances."""

    @abc.abstractmethod
    def acceleration(self, t: Scalar, quaternion: Quat | None = None, rate: Vec3 | None = None) -> Vec3:
        """Return the angular acceleration (3,) [rad/s²] in body axes at the time `t` [s] and the true state.

        `quaternion` (4,): the attitude of the body, not normalised. `rate` (3,) [rad/s]: its rate in body axes.
        `simulate` always passes both.
        """


def _from_older(fields: dict[str, Any]) -> dict[str, Any]:
    return {"signal" if name == "course" else name: value for name, value in fields.items()}


@reads_older(_from_older)
@storable
class DisturbanceAcceleration(AbstractDisturbance):
    """A disturbing angular acceleration in body axes: a constant (3,) [rad/s²] or a function.

    `signal`: the constant, a function t [s] → (3,), or a function (t, quaternion, rate) → (3,) of the true state: the
    unit quaternion (4,), whose sign has no meaning, and the rate (3,) [rad/s] in body axes. A constant or a `Sinusoid`
    can be saved to a file, and so can an own class that is `qtraj.storable`; functions cannot.

    **Raises:** ValueError if `signal` cannot be called in one of these ways, or if its value does not have shape (3,).
    """

    signal: Signal

    @renamed_arguments(course="signal")
    def __init__(self, signal: SignalInput):
        self.signal = checked_signal(signal, "the disturbance acceleration", of_state=True)

    def __repr__(self) -> str:
        return shown(self, signal="rad/s²")

    @single_arguments
    def acceleration(self, t: ScalarLike, quaternion: Quat | None = None, rate: Vec3 | None = None) -> Vec3:
        """Return the signal (3,) [rad/s²] at the time `t` [s] and the true state."""
        return at_state(self.signal, one_instant(t), quaternion, rate)


@reads_older(_from_older)
@storable
class DisturbanceTorque(AbstractDisturbance):
    """A disturbing torque on a body in body axes: a constant (3,) [N m] or a function.

    `signal`: the constant, a function t [s] → (3,), or a function (t, quaternion, rate) → (3,) of the true state, such
    as a `torques.GravityGradient`; see `DisturbanceAcceleration`. `inertia` [kg m²]: a scalar, (3,) principal moments
    or (3, 3). The torque M causes the acceleration J⁻¹M, because the gyroscopic torque ω×Jω is included in the
    commanded torque; see `dynamics.torque`. Functions cannot be saved to a file.

    **Raises:** ValueError for an inertia that is not symmetric and positive definite, a function that cannot be called
    in one of these ways, or a value of another shape.
    """

    signal: Signal
    inertia: Float[Array, "3 3"]

    @renamed_arguments(course="signal")
    def __init__(self, signal: SignalInput, inertia: ArrayInput):
        self.signal = checked_signal(signal, "the disturbance torque", of_state=True)
        self.inertia = inertia_matrix(inertia)

    def __repr__(self) -> str:
        return shown(self, signal="N m", inertia="kg m²")

    @single_arguments
    def acceleration(self, t: ScalarLike, quaternion: Quat | None = None, rate: Vec3 | None = None) -> Vec3:
        """Return the acceleration J⁻¹M (3,) [rad/s²] at the time `t` [s] and the true state."""
        torque = at_state(self.signal, one_instant(t), quaternion, rate)
        return jnp.linalg.solve(self.inertia.astype(torque.dtype), torque)
