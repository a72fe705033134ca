"""What acts on a body besides its command."""

import abc
import inspect
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, real_scalar, real_vector, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar, Vec3
from qtraj.motion.dynamics import inertia_matrix

Course = Callable[[Scalar], Vec3] | Vec3
"""A vector as a function of time [s], or a constant one."""


@storable
class Sinusoid(eqx.Module):
    """amplitude·sin(2πt/period + phase): a course of a disturbance that can be stored.

    `amplitude` (3,), in the disturbance's unit; `period` [s]; `phase` [rad].

    **Raises:** ValueError for another shape, a period that is not positive, or a phase that is not finite.
    """

    amplitude: Vec3
    period: Scalar
    phase: Scalar

    def __init__(self, amplitude: ArrayInput, period: ArrayInput, phase: ArrayInput = 0.0):
        self.amplitude = real_vector(amplitude, "the amplitude", 3)
        self.period, self.phase = real_scalar(period, "the period"), real_scalar(phase, "the phase")
        require_positive(self.period, "the period", "s")
        require_finite(self.phase, "the phase")

    def __call__(self, t: Scalar) -> Vec3:
        wave = jnp.sin(2 * math.pi * t / self.period.astype(t.dtype) + self.phase.astype(t.dtype))
        return self.amplitude * wave.astype(self.amplitude.dtype)


class AbstractDisturbance(eqx.Module):
    """An angular acceleration that no law has commanded."""

    @abc.abstractmethod
    def acceleration(self, t: Scalar) -> Vec3:
        """Angular acceleration (3,) [rad/s²] in body axes at the time `t` [s]."""


@storable
class DisturbanceAcceleration(AbstractDisturbance):
    """An angular acceleration in body axes: a function t [s] → (3,) [rad/s²], or a constant (3,).

    A constant one and a `Sinusoid` can be stored.

    **Raises:** ValueError for a function that cannot be called with the time alone, or another shape.
    """

    course: Course

    def __init__(self, course: Callable[[Scalar], Vec3] | ArrayInput):
        self.course = course_of(course, "the disturbance acceleration")

    def acceleration(self, t: Scalar) -> Vec3:
        return at_instant(self.course, t)


@storable
class DisturbanceTorque(AbstractDisturbance):
    """A torque on a body of given inertia, ε = J⁻¹M: a function t [s] → (3,) [N m] in body axes, or a constant (3,).

    `inertia` [kg m²]: a scalar, (3,) principal moments or (3, 3). The gyroscopic torque ω×Jω is the commanded
    torque's business: see `dynamics.torque`. A constant torque and a `Sinusoid` can be stored.

    **Raises:** ValueError for an inertia that is not symmetric and positive, a function that cannot be called with the
    time alone, or another shape.
    """

    course: Course
    inertia: Float[Array, "3 3"]

    def __init__(self, course: Callable[[Scalar], Vec3] | ArrayInput, inertia: ArrayInput):
        self.course = course_of(course, "the disturbance torque")
        self.inertia = inertia_matrix(inertia)

    def acceleration(self, t: Scalar) -> Vec3:
        torque = at_instant(self.course, t)
        return jnp.linalg.solve(self.inertia.astype(torque.dtype), torque)


def course_of(course: Callable[[Scalar], Vec3] | ArrayInput, name: str) -> Any:
    """A function of time as a tree, or a constant vector (3,); ValueError for what is neither."""
    if not callable(course):
        return real_vector(course, name, 3)
    _require_function_of_time(course, name)
    return course if isinstance(course, eqx.Module | jax.tree_util.Partial) else jax.tree_util.Partial(course)


def _require_function_of_time(course: Callable[..., Any], name: str) -> None:
    """Raise a ValueError where a function cannot be called with the time alone."""
    try:
        signature = inspect.signature(course)
    except (TypeError, ValueError):  # some functions written in C have none: the call itself will tell
        return
    try:
        signature.bind(0.0)
    except TypeError as error:
        raise ValueError(
            f"{name} must be a function of the time alone, t [s] -> (3,), but the function given takes {signature}"
        ) from error


def at_instant(course: Course, t: Scalar) -> Vec3:
    """The vector (3,) at the time `t` [s]."""
    if not callable(course):
        return course
    vector = as_float(course(t))
    if vector.shape != (3,):
        raise ValueError(f"a disturbance must be a vector (3,) at each time, but has shape {vector.shape}")
    return vector
