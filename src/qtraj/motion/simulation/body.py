"""Model a rigid body by Euler's equations; the control torques are calculated with an assumed inertia.

Body:    J ω̇ + ω×(Jω + Ah) = −Au + M,    wheels:    ḣ = u

All vectors are in body axes; ω is the rate of the body. J is the inertia of the body, including the transverse inertia
of the wheels. The columns of A (3, n) are the unit spin axes, h (n,) are the axial momenta of the wheels, u (n,) are
the motor torques, and M is an external torque. Without wheels, −Au is the torque of thrusters. For the acceleration ε
of the law, the control computer commands the torque M_c = J_a ε + ω×(J_a ω + Ah) with its assumed inertia J_a, and
distributes M_c to the wheels with the pseudo-inverse of A, so that −Au = M_c.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import (
    as_float,
    concrete,
    one_instant,
    real_scalar,
    real_vector,
    require_finite,
    require_positive,
)
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.float_arguments import single_arguments
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Mat3, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.simulation.signals import Signal, SignalInput, at_state, checked_signal

MIN_SINGULAR_VALUE = 1e-6
"""Unit spin axes span three dimensions if the smallest singular value of their matrix exceeds this value."""

ROUND_OFF = 1e-6
"""Relative excess of an initial momentum over its limit that is allowed, such as of values in single precision."""

Torques = Float[Array, " n"]
Momenta = Float[Array, " n"]


@storable
class ReactionWheels(eqx.Module):
    """Three or more reaction wheels, whose motors exert torques on the body.

    `axes` (n, 3): vectors along the spin axes, in body axes, not necessarily normalised. `max_torque` [N m] and
    `max_momentum` [N m s]: limits of each wheel, scalars or (n,); None for no limit. If a torque exceeds its limit, all
    motor torques are scaled by the same factor, so the direction of the torque on the body does not change. A wheel at
    its maximum momentum can only be slowed down. `momentum` (n,) [N m s]: the initial momenta; None for zero.

    **Raises:** ValueError for axes of another shape, zero axes, axes that do not span three dimensions, limits that are
    not positive, momenta of another shape, or momenta beyond `max_momentum`.
    """

    axes: Float[Array, "n 3"]
    max_torque: Torques | None
    max_momentum: Momenta | None
    momentum: Momenta

    def __repr__(self) -> str:
        return shown(self, max_torque="N m", max_momentum="N m s", momentum="N m s")

    def __init__(
        self,
        axes: ArrayInput,
        max_torque: ArrayInput | None = None,
        max_momentum: ArrayInput | None = None,
        momentum: ArrayInput | None = None,
    ):
        axes = as_float(axes)
        if axes.ndim != 2 or axes.shape[0] < 3 or axes.shape[1] != 3:
            raise ValueError(
                f"axes must have shape (n, 3), with at least three wheels, but shape {axes.shape} was given"
            )
        require_finite(axes, "the spin axes of the wheels")
        given = concrete(axes)
        if given is not None and not given.any(axis=1).all():
            wheel = int(np.argmin(given.any(axis=1)))
            raise ValueError(
                f"every wheel needs a spin axis, but the spin axis of wheel {wheel} (counted from 0) is zero"
            )
        self.axes = axes / jnp.linalg.norm(axes, axis=1, keepdims=True)
        values = concrete(self.axes)
        if values is not None and not np.linalg.svd(values, compute_uv=False)[-1] > MIN_SINGULAR_VALUE:
            raise ValueError(
                "the spin axes of the wheels must span three dimensions, but there is an axis about which these wheels "
                "produce no torque"
            )
        count = axes.shape[0]
        self.max_torque = _per_wheel(max_torque, count, "max_torque", "N m")
        self.max_momentum = _per_wheel(max_momentum, count, "max_momentum", "N m s")
        momentum = jnp.zeros_like(axes[:, 0]) if momentum is None else as_float(momentum)
        if momentum.shape != (count,):
            raise ValueError(
                f"the momenta of {count} wheels must have shape ({count},), but shape {momentum.shape} was given"
            )
        require_finite(momentum, "the momenta of the wheels")
        self.momentum = momentum.astype(axes.dtype)
        _require_within(self.momentum, self.max_momentum)


@storable
class RigidBody(eqx.Module):
    """A rigid body for `simulate`: its inertia, torques, and optional reaction wheels.

    `inertia` [kg m²]: a scalar, principal moments (3,), or a tensor (3, 3). `assumed` [kg m²]: the inertia that the
    control computer uses; None for the exact inertia. `torque` [N m]: an external torque in body axes, a constant (3,),
    a function t → (3,), or a function (t, quaternion, rate) → (3,) of the true state, such as a
    `torques.GravityGradient` (see `DisturbanceAcceleration`). `wheels`: the `ReactionWheels` that produce the control
    torque; None for thrusters, for which `max_torque` [N m] limits the magnitude of the torque.

    With the exact inertia, exact measurements, a continuous command, no external torque or disturbance and no active
    limit, the acceleration of the body is exactly the command of the law. Without a law, `integrate(body.free, ...)` is
    the free motion under the external torque.

    **Raises:** ValueError for an inertia that is not symmetric and positive definite, a torque of another shape, or
    both `wheels` and `max_torque`.
    """

    inertia: Mat3
    assumed: Mat3
    torque: Signal | None
    wheels: ReactionWheels | None
    max_torque: Scalar | None

    def __repr__(self) -> str:
        return shown(self, inertia="kg m²", assumed="kg m²", torque="N m", max_torque="N m")

    def __init__(
        self,
        inertia: ArrayInput,
        assumed: ArrayInput | None = None,
        torque: SignalInput | None = None,
        wheels: ReactionWheels | None = None,
        max_torque: ArrayInput | None = None,
    ):
        self.inertia = inertia_matrix(inertia)
        self.assumed = self.inertia if assumed is None else inertia_matrix(assumed)
        self.torque = None if torque is None else checked_signal(torque, "the external torque", of_state=True)
        if wheels is not None and not isinstance(wheels, ReactionWheels):
            raise ValueError(f"wheels must be ReactionWheels(axes), but {wheels!r} was given")
        if wheels is not None and max_torque is not None:
            raise ValueError(
                "RigidBody(max_torque=...) limits thrusters, but wheels were given: use ReactionWheels(max_torque=...)"
            )
        self.wheels = wheels
        self.max_torque = None if max_torque is None else real_scalar(max_torque, "max_torque")
        if self.max_torque is not None:
            require_positive(self.max_torque, "max_torque", "N m")

    @property
    def momentum(self) -> Momenta:
        """The initial momenta (n,) [N m s] of the wheels; (0,) without wheels."""
        return jnp.zeros_like(self.inertia, shape=(0,)) if self.wheels is None else self.wheels.momentum

    @single_arguments
    def commanded_torques(self, acceleration: Vec3, rate: Vec3, momentum: ArrayInput) -> Torques:
        """Return the commanded motor torques (n,) [N m] for an `acceleration` [rad/s²], within the motors' limits.

        Without wheels, return the commanded torque (3,) on the body.
        """
        acceleration, rate = jnp.asarray(acceleration), jnp.asarray(rate)
        assumed = self.assumed.astype(rate.dtype)
        total_momentum = _matmul(assumed, rate) + self.wheel_momentum(momentum)
        torque = _matmul(assumed, acceleration) + jnp.cross(rate, total_momentum)
        if self.wheels is None:
            return _limited(torque, self.max_torque)
        motors = -_matmul(jnp.linalg.pinv(self.wheels.axes.astype(rate.dtype)).T, torque)
        if self.wheels.max_torque is None:
            return motors
        ratio = jnp.max(jnp.abs(motors) / self.wheels.max_torque.astype(motors.dtype))
        return motors / jnp.maximum(ratio, 1.0)

    @on_one_device
    def actual_torques(self, commanded: ArrayInput, momentum: ArrayInput) -> Torques:
        """Return the motor torques; a torque that would accelerate a wheel beyond its maximum momentum is zero."""
        commanded, momentum = self._torques(commanded), self._momenta(momentum)
        if self.wheels is None or self.wheels.max_momentum is None:
            return commanded
        at_maximum = jnp.abs(momentum) >= self.wheels.max_momentum.astype(momentum.dtype)
        return jnp.where(at_maximum & (commanded * momentum > 0), 0.0, commanded)

    @on_one_device
    def control_torque(self, commanded: ArrayInput, momentum: ArrayInput) -> Vec3:
        """Return the actual torque (3,) [N m] of motors or thrusters on the body, body axes."""
        torques = self.actual_torques(commanded, momentum)
        return torques if self.wheels is None else -_matmul(torques, self.wheels.axes.astype(torques.dtype))

    @single_arguments
    def acceleration(
        self, t: ScalarLike, quaternion: Quat, rate: Vec3, momentum: ArrayInput, commanded: ArrayInput
    ) -> Vec3:
        """Return the acceleration (3,) [rad/s²], body axes, by Euler's equations under the `commanded` torques."""
        rate = jnp.asarray(rate)
        inertia, torque = self.inertia.astype(rate.dtype), self.control_torque(commanded, momentum)
        if self.torque is not None:
            torque = torque + at_state(self.torque, one_instant(t), quaternion, rate).astype(rate.dtype)
        total_momentum = _matmul(inertia, rate) + self.wheel_momentum(momentum)
        return jnp.linalg.solve(inertia, torque - jnp.cross(rate, total_momentum))

    @single_arguments
    def free(self, t: ScalarLike, quaternion: Quat, rate: Quat) -> Quat:
        """Return the acceleration (4,) [rad/s²] without control torque, body axes, for `integrate`.

        The external torque acts, and wheels keep their initial momenta. `rate` (4,): virtual rate first.
        """
        rate = jnp.asarray(rate)
        momentum = self.momentum.astype(rate.dtype)
        nothing = jnp.zeros_like(rate, shape=(3,) if self.wheels is None else momentum.shape)
        physical = self.acceleration(t, quaternion, rate[1:], momentum, nothing)
        return jnp.concatenate([jnp.zeros_like(rate[:1]), physical.astype(rate.dtype)])

    @on_one_device
    def momentum_rate(self, commanded: ArrayInput, momentum: ArrayInput) -> Momenta:
        """Return the time derivative ḣ (n,) [N m] of the momenta of the wheels; (0,) without wheels."""
        return self._momenta(momentum) if self.wheels is None else self.actual_torques(commanded, momentum)

    def wheel_momentum(self, momentum: ArrayInput) -> Vec3:
        """Return the total momentum Ah (3,) [N m s] of the wheels in body axes."""
        momentum = self._momenta(momentum)
        if self.wheels is None:
            return jnp.zeros_like(momentum, shape=3)
        return _matmul(momentum, self.wheels.axes.astype(momentum.dtype))

    def _momenta(self, momentum: ArrayInput) -> Momenta:
        return jnp.asarray(real_vector(momentum, "the momenta of the wheels", self.momentum.shape[0]))

    def _torques(self, commanded: ArrayInput) -> Torques:
        count = 3 if self.wheels is None else self.wheels.axes.shape[0]
        return jnp.asarray(real_vector(commanded, "the commanded torques", count))


def _per_wheel(value: ArrayInput | None, count: int, name: str, unit: str) -> Float[Array, " n"] | None:
    """Return the limit of each wheel (n,) from one number or n numbers."""
    if value is None:
        return None
    numbers = as_float(value)
    if numbers.shape not in ((), (count,)):
        raise ValueError(f"{name} must be a scalar or have shape ({count},), but shape {numbers.shape} was given")
    require_positive(numbers, name, unit)
    return jnp.broadcast_to(numbers, (count,))


def _require_within(momentum: Momenta, limit: Momenta | None) -> None:
    """Raise a ValueError for a concrete momentum beyond its limit, up to round-off."""
    if limit is None or (values := concrete(momentum)) is None or (limits := concrete(limit)) is None:
        return
    excess = abs(values) - limits * (1 + ROUND_OFF)
    if (excess > 0).any():
        wheel = int(np.argmax(excess))
        raise ValueError(
            f"the initial momentum of wheel {wheel} (counted from 0) is {values[wheel]:.9g} N m s, but its "
            f"max_momentum is {limits[wheel]:.9g} N m s: reduce the momentum, or raise the limit"
        )


def _limited(vector: Vec3, limit: Scalar | None) -> Vec3:
    """Return the vector, scaled to a magnitude of at most `limit`."""
    if limit is None:
        return vector
    length = norm(vector)
    exceeds = length > limit.astype(length.dtype)
    return vector * jnp.where(exceeds, limit.astype(length.dtype) / jnp.where(exceeds, length, 1.0), 1.0)


def _matmul(a: Any, b: Any) -> Array:
    return jnp.matmul(a, b, precision="highest")
