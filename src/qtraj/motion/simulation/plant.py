"""Model the body of a closed loop by the differential equation of λ, ω and the wheel momenta under a command."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import derivative
from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.control.errors import pure
from qtraj.motion.simulation.interval import State
from qtraj.motion.simulation.loop import Loop
from qtraj.motion.simulation.task import Scale

RIGID = 8
"""Number of components of λ and ω in the state vector; the wheel momenta follow."""


class Held(eqx.Module):
    """The current command (4,) of the law and, for a `RigidBody`, the commanded torques (m,) of motors or thrusters."""

    command: Quat
    torques: Float[Array, " m"]


class Plant(eqx.Module):
    """The body under a command.

    The state vector consists of λ and ω, and the wheel momenta of a `RigidBody`; under a rate law, it consists of λ
    only.
    """

    loop: Loop
    scale: Scale

    def pack(self, quaternion: Quat, rate: Quat) -> State:
        """Return the state vector of λ, ω and the initial wheel momenta."""
        if self.loop.commands_rate:
            return quaternion / self.scale.quaternion
        state = self.scale.pack(quaternion, rate)
        return state if self.loop.body is None else jnp.concatenate([state, self.momentum / self.momentum_scale])

    def unpack(self, state: State, command: Quat) -> tuple[Quat, Quat]:
        """Return λ and ω of a state vector; under a rate law, ω is the command."""
        if self.loop.commands_rate:
            return state * self.scale.quaternion, command
        return self.scale.unpack(state[:RIGID])

    @property
    def momentum(self) -> Float[Array, " m"]:
        """The initial wheel momenta [N m s]."""
        empty = jnp.zeros_like(self.scale.rate, shape=(0,))
        return empty if self.loop.body is None else self.loop.body.momentum.astype(empty.dtype)

    @property
    def momentum_scale(self) -> Scalar:
        """The scale [N m s] by which momenta are divided, so that they are of order one."""
        if self.loop.body is None:
            return self.scale.rate
        size = jnp.max(jnp.abs(self.loop.body.inertia)).astype(self.scale.rate.dtype) * self.scale.rate
        return jax.lax.stop_gradient(size)

    def hold(self, state: State, command: Quat, rate: Quat) -> Held:
        """Return the new command with its torques, which are calculated from the measured `rate`."""
        if self.loop.body is None:
            return Held(command, jnp.zeros_like(command, shape=(0,)))
        momentum = self.momentum_of(state)
        return Held(command, self.loop.body.commanded_torques(command[1:], rate[1:], momentum))

    def momentum_of(self, state: State) -> Float[Array, " m"]:
        """Return the wheel momenta [N m s] of a state vector."""
        return state[RIGID:] * self.momentum_scale

    def acceleration(self, t: Scalar, rate: Quat, momentum: Float[Array, " m"], held: Held) -> Quat:
        """Return the acceleration (4,) [rad/s²], body axes, under the current command without a disturbance."""
        if self.loop.body is None:
            return held.command
        physical = self.loop.body.acceleration(t, rate[1:], momentum, held.torques)
        return jnp.concatenate([held.command[:1], physical])

    def slope(self, t: Scalar, state: State, held: Held) -> State:
        """Return the time derivative of the state vector [1/s]."""
        command = held.command.astype(state.dtype)
        if self.loop.commands_rate:
            return derivative(state, command)
        quaternion, rate = self.scale.unpack(state[:RIGID])
        momentum = self.momentum_of(state)
        epsilon = self.disturbed(t, self.acceleration(t, rate, momentum, held).astype(state.dtype))
        slope = self.scale.pack(derivative(quaternion, rate), epsilon)
        if self.loop.body is None:
            return slope
        return jnp.concatenate([slope, self.loop.body.momentum_rate(held.torques, momentum) / self.momentum_scale])

    def disturbed(self, t: Scalar, epsilon: Quat) -> Quat:
        """Return the sum of the acceleration `epsilon` (4,) and the disturbance [rad/s²], body axes."""
        if self.loop.disturbance is None:
            return epsilon
        return epsilon + pure(self.loop.disturbance.acceleration(t).astype(epsilon.dtype))
