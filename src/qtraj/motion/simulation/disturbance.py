"""Define disturbances: angular accelerations and torques that are not commanded."""

import abc
import inspect
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.foundation.arrays import as_float, real_scalar, real_vector, require_finite, require_positive
from qtraj.foundation.document import reads_older, storable
from qtraj.foundation.renamed import renamed_arguments
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, Vec3
from qtraj.motion.dynamics import inertia_matrix

Signal = Callable[[Scalar], Vec3] | Vec3
"""A vector as a function of time [s], or a constant vector."""

SignalInput = TypeAliasType("SignalInput", Callable[[Scalar], Vec3] | ArrayInput)


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

    def __call__(self, t: Scalar) -> Vec3:
        """Return the vector (3,) at the time `t` [s]."""
        wave = jnp.sin(2 * math.pi * t / self.period.astype(t.dtype) + self.phase.astype(t.dtype))
        return self.amplitude * wave.astype(self.amplitude.dtype)


class AbstractDisturbance(eqx.Module):
    """An angular acceleration that is not commanded."""

    @abc.abstractmethod
    def acceleration(self, t: Scalar) -> Vec3:
        """Return the angular acceleration (3,) [rad/s²] in body axes at the time `t` [s]."""


def _from_older(fields: dict[str, Any]) -> dict[str, Any]:
    return {"signal" if name == "course" else name: value for name, value in fields.items()}


@reads_older(_from_older)
@storable
class DisturbanceAcceleration(AbstractDisturbance):
    """A disturbing angular acceleration in body axes, a function t [s] → (3,) [rad/s²] or a constant (3,).

    `signal`: the function or the constant. A constant or a `Sinusoid` can be saved to a file; other functions cannot.

    **Raises:** ValueError if `signal` cannot be called with the time alone, or if its value does not have shape (3,).
    """

    signal: Signal

    @renamed_arguments(course="signal")
    def __init__(self, signal: SignalInput):
        self.signal = checked_signal(signal, "the disturbance acceleration")

    def __repr__(self) -> str:
        return shown(self, signal="rad/s²")

    def acceleration(self, t: Scalar) -> Vec3:
        """Return the signal (3,) [rad/s²] at the time `t` [s]."""
        return at_instant(self.signal, t)


@reads_older(_from_older)
@storable
class DisturbanceTorque(AbstractDisturbance):
    """A disturbing torque on a body, a function t [s] → (3,) [N m] in body axes or a constant (3,).

    `signal`: the function or the constant. `inertia` [kg m²]: a scalar, (3,) principal moments or (3, 3). The torque M
    causes the acceleration J⁻¹M, because the gyroscopic torque ω×Jω is included in the commanded torque; see
    `dynamics.torque`. A constant or a `Sinusoid` can be saved to a file; other functions cannot.

    **Raises:** ValueError for an inertia that is not symmetric and positive definite, a function that cannot be called
    with the time alone, or a value of another shape.
    """

    signal: Signal
    inertia: Float[Array, "3 3"]

    @renamed_arguments(course="signal")
    def __init__(self, signal: SignalInput, inertia: ArrayInput):
        self.signal = checked_signal(signal, "the disturbance torque")
        self.inertia = inertia_matrix(inertia)

    def __repr__(self) -> str:
        return shown(self, signal="N m", inertia="kg m²")

    def acceleration(self, t: Scalar) -> Vec3:
        """Return the acceleration J⁻¹M (3,) [rad/s²] at the time `t` [s]."""
        torque = at_instant(self.signal, t)
        return jnp.linalg.solve(self.inertia.astype(torque.dtype), torque)


def checked_signal(signal: SignalInput, name: str) -> Any:
    """Return a function of time as a pytree, or a constant vector (3,); raise a ValueError for other values."""
    if not callable(signal):
        return real_vector(signal, name, 3)
    _require_function_of_time(signal, name)
    return signal if isinstance(signal, eqx.Module | jax.tree_util.Partial) else jax.tree_util.Partial(signal)


def _require_function_of_time(signal: Callable[..., Any], name: str) -> None:
    """Raise a ValueError unless a function can be called with the time alone."""
    try:
        signature = inspect.signature(signal)
    except (
        TypeError,
        ValueError,
    ):  # functions written in C may have no signature; if the arguments are wrong, the call fails later
        return
    try:
        signature.bind(0.0)
    except TypeError as error:
        raise ValueError(
            f"{name} must be a function of time only (it takes t [s] and returns shape (3,)), "
            f"but its signature is {signature}"
        ) from error


def at_instant(signal: Signal, t: Scalar) -> Vec3:
    """Return the vector (3,) at the time `t` [s]."""
    if not callable(signal):
        return signal
    vector = as_float(signal(t))
    if vector.shape != (3,):
        raise ValueError(f"a disturbance must return a vector (3,) at each time, but returned shape {vector.shape}")
    return vector
