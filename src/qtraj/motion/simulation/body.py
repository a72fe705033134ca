"""A rigid body that turns by Euler's equations, under torques that a computer calculates with the inertia it assumes.

Body:    J ω̇ + ω×(Jω + Ah) = −Au + M,    wheels:    ḣ = u

J is the inertia with the wheels' share across their axes, A (3, n) has the unit spin axes as columns, h (n,) are the
axial momenta of the wheels, u (n,) the torques of their motors, M an external torque. Without wheels −Au is a torque
that acts on the body directly (thrusters). To give the acceleration ε of the law, the computer commands
M_c = J_a ε + ω×(J_a ω + Ah) with its own J_a, and divides it among the wheels by the pseudo-inverse, −Au = M_c.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, real_scalar, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Mat3, Scalar, Vec3
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.simulation.disturbance import Signal, at_instant, checked_signal

SPAN = 1e-6
"""Spin axes whose smallest singular value is below this do not span the space."""

Torques = Float[Array, " n"]
Momenta = Float[Array, " n"]


@storable
class ReactionWheels(eqx.Module):
    """Three or more reaction wheels, whose motors exert torques on the body.

    `axes` (n, 3): spin axes in body axes, of any length. `max_torque` [N m] and `max_momentum` [N m s] of each wheel,
    numbers or (n,), None for no limit. Above it the torques of all motors are scaled by the same factor, so the torque
    on the body keeps its direction. At its maximum momentum a wheel can only be slowed down. `momentum` (n,) [N m s]:
    at the start.

    **Raises:** ValueError for axes of another shape or that do not span the space, limits that are not positive, or
    momenta of another shape.
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
            raise ValueError(f"the axes of at least three wheels, shape (n, 3), were expected, but {axes.shape} given")
        require_finite(axes, "the axes of the wheels")
        self.axes = axes / jnp.linalg.norm(axes, axis=1, keepdims=True)
        known = concrete(self.axes)
        if known is not None and not np.linalg.svd(np.nan_to_num(known), compute_uv=False)[-1] > SPAN:
            raise ValueError("the axes of the wheels must span the space: no torque is possible about one direction")
        count = axes.shape[0]
        self.max_torque = _each(max_torque, count, "max_torque", "N m")
        self.max_momentum = _each(max_momentum, count, "max_momentum", "N m s")
        momentum = jnp.zeros_like(axes[:, 0]) if momentum is None else as_float(momentum)
        if momentum.shape != (count,):
            raise ValueError(
                f"the momenta of {count} wheels must have shape ({count},), but {momentum.shape} was given"
            )
        require_finite(momentum, "the momenta of the wheels")
        self.momentum = momentum.astype(axes.dtype)


@storable
class RigidBody(eqx.Module):
    """A rigid body for `simulate`, with inertia, torques and optional wheels.

    `inertia` [kg m²]: a scalar, (3,) principal moments or (3, 3); `assumed`: the one with which the computer calculates
    torques, None for the same. `torque` [N m]: an external one in body axes, constant (3,) or a function t → (3,).
    `wheels`: `ReactionWheels`; None for a torque that acts from outside, whose length `max_torque` [N m] limits.

    With the exact inertia, no external torque and no active limit, the body follows the law exactly.

    **Raises:** ValueError for inertias that are not symmetric and positive, a torque of another shape, or `max_torque`
    beside wheels, which have their own.
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
        torque: Callable[[Scalar], Vec3] | ArrayInput | None = None,
        wheels: ReactionWheels | None = None,
        max_torque: ArrayInput | None = None,
    ):
        self.inertia = inertia_matrix(inertia)
        self.assumed = self.inertia if assumed is None else inertia_matrix(assumed)
        self.torque = None if torque is None else checked_signal(torque, "the external torque")
        if wheels is not None and not isinstance(wheels, ReactionWheels):
            raise ValueError(f"wheels must be ReactionWheels(axes), but {wheels!r} was given")
        if wheels is not None and max_torque is not None:
            raise ValueError("wheels have a limit of their own: give ReactionWheels(axes, max_torque=...) instead")
        self.wheels = wheels
        self.max_torque = None if max_torque is None else real_scalar(max_torque, "max_torque")
        if self.max_torque is not None:
            require_positive(self.max_torque, "max_torque", "N m")

    @property
    def momentum(self) -> Momenta:
        """The momenta of the wheels at the start [N m s]; none without wheels."""
        return jnp.zeros_like(self.inertia, shape=(0,)) if self.wheels is None else self.wheels.momentum

    def order(self, acceleration: Vec3, rate: Vec3, momentum: Momenta) -> Torques:
        """The ordered motor torques [N m] for an acceleration [rad/s²], within their limits.

        Without wheels the torque on the body (3,).
        """
        assumed = self.assumed.astype(rate.dtype)
        wanted = _matmul(assumed, acceleration) + jnp.cross(rate, _matmul(assumed, rate) + self.stored(momentum))
        if self.wheels is None:
            return _shortened(wanted, norm(wanted), self.max_torque)
        motors = -_matmul(jnp.linalg.pinv(self.wheels.axes.astype(rate.dtype)).T, wanted)
        if self.wheels.max_torque is None:
            return motors
        use = jnp.max(jnp.abs(motors) / self.wheels.max_torque.astype(motors.dtype))
        return motors / jnp.maximum(use, 1.0)

    def given(self, order: Torques, momentum: Momenta) -> Torques:
        """The actual motor torques of an order: a wheel at its maximum momentum is not accelerated further."""
        if self.wheels is None or self.wheels.max_momentum is None:
            return order
        full = jnp.abs(momentum) >= self.wheels.max_momentum.astype(momentum.dtype)
        return jnp.where(full & (order * momentum > 0), 0.0, order)

    def control_torque(self, given: Torques) -> Vec3:
        """The torque of motors or thrusters on the body (3,) [N m], body axes."""
        return given if self.wheels is None else -_matmul(given, self.wheels.axes.astype(given.dtype))

    def acceleration(self, t: Scalar, rate: Vec3, momentum: Momenta, order: Torques) -> Vec3:
        """ε [rad/s²] by Euler's equations, body axes."""
        inertia, control = self.inertia.astype(rate.dtype), self.control_torque(self.given(order, momentum))
        if self.torque is not None:
            control = control + at_instant(self.torque, t).astype(rate.dtype)
        return jnp.linalg.solve(inertia, control - jnp.cross(rate, _matmul(inertia, rate) + self.stored(momentum)))

    def momentum_slope(self, order: Torques, momentum: Momenta) -> Momenta:
        """ḣ [N m] of the wheels; none without."""
        return momentum if self.wheels is None else self.given(order, momentum)

    def stored(self, momentum: Momenta) -> Vec3:
        """Ah (3,) [N m s], the momentum of the wheels in body axes."""
        if self.wheels is None:
            return jnp.zeros_like(momentum, shape=3)
        return _matmul(momentum, self.wheels.axes.astype(momentum.dtype))


def _each(value: ArrayInput | None, count: int, name: str, unit: str) -> Float[Array, " n"] | None:
    if value is None:
        return None
    numbers = as_float(value)
    if numbers.shape not in ((), (count,)):
        raise ValueError(f"{name} must be one number or one for each of {count} wheels, but has shape {numbers.shape}")
    require_positive(numbers, name, unit)
    return jnp.broadcast_to(numbers, (count,))


def _shortened(vector: Vec3, length: Scalar, limit: Scalar | None) -> Vec3:
    if limit is None:
        return vector
    over = length > limit.astype(length.dtype)
    return vector * jnp.where(over, limit.astype(length.dtype) / jnp.where(over, length, 1.0), 1.0)


def _matmul(a: Any, b: Any) -> Array:
    return jnp.matmul(a, b, precision="highest")
