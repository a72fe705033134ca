"""Model the body of a closed loop by the differential equation of λ, ω and all other continuous states.

The state vector consists of λ and ω (under a rate law, of λ only), the wheel momenta of a `RigidBody`, the outputs of
an actuator with a lag and the state of the law if the command is continuous. Parts that a loop does not have are
empty. If the command is held between samples, the outputs of the actuator are known in closed form, a(t) = u + (a_k −
u)·exp(−(t − t_k)/τ), so that a short lag does not make the equations stiff.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import derivative
from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import pure
from qtraj.motion.simulation.interval import State
from qtraj.motion.simulation.loop import Loop
from qtraj.motion.simulation.task import Scale


class Held(eqx.Module):
    """The current command (4,) of the law and, for a `RigidBody`, the commanded torques (m,) of motors or thrusters.

    For a sampled loop and an actuator with a lag: the output of the actuator at the last sample, and its instant [s].
    """

    command: Quat
    torques: Float[Array, " m"]
    output: Array | None = None
    since: Scalar | None = None


class Plant(eqx.Module):
    """The body under a command; `law_state` is an example of the state of the law, or None."""

    loop: Loop
    scale: Scale
    law_state: Any

    @property
    def rigid(self) -> int:
        """The number of components of λ and ω in the state vector."""
        return 4 if self.loop.commands_rate else 8

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

    @property
    def actuator_scale(self) -> Scalar:
        """The scale by which the outputs of an actuator with a lag are divided."""
        return self.scale.rate if self.loop.commands_rate else self.momentum_scale * self.scale.rate

    def pack(self, quaternion: Quat, rate: Quat, held: Held | None = None) -> State:
        """Return the initial state vector; `held`, the first command, is needed for an actuator with a lag."""
        rigid = self.scale.pack(quaternion, rate)[: self.rigid]
        parts = [rigid, self.momentum / self.momentum_scale]
        if not self.loop.holds:
            if held is not None:
                parts.append(self._target(held) / self.actuator_scale)
            parts.append(ravel_pytree(self.law_state)[0])
        return jnp.concatenate([x.astype(rigid.dtype) for x in parts]) if sum(x.size for x in parts[1:]) else rigid

    def unpack(self, state: State, command: Quat) -> tuple[Quat, Quat]:
        """Return λ and ω of a state vector; under a rate law, ω is the command."""
        if self.loop.commands_rate:
            return state[:4] * self.scale.quaternion, command
        return self.scale.unpack(state[:8])

    def momentum_of(self, state: State) -> Float[Array, " m"]:
        """Return the wheel momenta [N m s] of a state vector."""
        return self._split(state)[0] * self.momentum_scale

    def law_state_of(self, state: State) -> Any:
        """Return the state of the law in a state vector; None for a law without a state."""
        return None if self.law_state is None else ravel_pytree(self.law_state)[1](self._split(state)[2])

    def hold(self, state: State, command: Quat, rate: Quat) -> Held:
        """Return the new command with its torques, which are calculated from the measured `rate`."""
        if self.loop.body is None:
            return Held(command, jnp.zeros_like(command, shape=(0,)))
        momentum = self.momentum_of(state)
        return Held(command, self.loop.body.commanded_torques(command[1:], rate[1:], momentum))

    def renewed(self, t: Scalar, state: State, command: Quat, rate: Quat, before: Held, first: Array) -> Held:
        """Return the new command of a sampled loop; `before` is the previous one, unless this is the `first`."""
        held = self.hold(state, command, rate)
        if self.loop.actuator.time_constant is None:
            return held
        output = jnp.where(first, self._target(held), self._target(self.applied(t, state, before)))
        return Held(held.command, held.torques, output, t)

    def applied(self, t: Scalar, state: State, held: Held) -> Held:
        """Return the command and the torques that act on the body, after the lag of the actuator."""
        if self.loop.actuator.time_constant is None:
            return held
        if held.output is None or held.since is None:
            output = self._split(state)[1] * self.actuator_scale
        else:
            target = self._target(held)
            time_constant = self.loop.actuator.time_constant.astype(t.dtype)
            output = target + (held.output - target) * jnp.exp(-(t - held.since) / time_constant)
        if self.loop.body is not None:
            return Held(held.command, output)
        return Held(jnp.concatenate([held.command[:1].astype(output.dtype), output]), held.torques)

    def acceleration(self, t: Scalar, quaternion: Quat, rate: Quat, momentum: Float[Array, " m"], held: Held) -> Quat:
        """Return the acceleration (4,) [rad/s²], body axes, under the applied command, with the disturbance."""
        epsilon = held.command
        if self.loop.body is not None:
            physical = self.loop.body.acceleration(t, quaternion, rate[1:], momentum, held.torques)
            epsilon = jnp.concatenate([epsilon[:1], physical])
        if self.loop.disturbance is None:
            return epsilon.astype(rate.dtype)
        disturbance = self.loop.disturbance.acceleration(t, quaternion, rate[1:])
        return epsilon.astype(rate.dtype) + pure(disturbance.astype(rate.dtype))

    def slope(self, t: Scalar, state: State, held: Held, law_slope: Any = None) -> State:
        """Return the time derivative of the state vector [1/s] under the current command.

        `law_slope`: the time derivative of the state of the law, unless this state is constant between samples.
        """
        applied, momentum = self.applied(t, state, held), self.momentum_of(state)
        if self.loop.commands_rate:
            parts = [derivative(state[:4], applied.command.astype(state.dtype))]
        else:
            quaternion, rate = self.scale.unpack(state[:8])
            epsilon = self.acceleration(t, quaternion, rate, momentum, applied)
            parts = [self.scale.pack(derivative(quaternion, rate), epsilon)]
        if self.loop.body is not None:
            parts.append(self.loop.body.momentum_rate(applied.torques, momentum) / self.momentum_scale)
        if self.loop.actuator.time_constant is not None and not self.loop.holds:
            change = self._target(held) - self._target(applied)
            parts.append(change / (self.loop.actuator.time_constant.astype(state.dtype) * self.actuator_scale))
        if law_slope is not None:
            parts.append(ravel_pytree(law_slope)[0])
        return jnp.concatenate([x.astype(state.dtype) for x in parts]) if len(parts) > 1 else parts[0]

    def _target(self, held: Held) -> Array:
        """Return the part of a command that an actuator with a lag follows."""
        return held.command[1:] if self.loop.body is None else held.torques

    def _split(self, state: State) -> tuple[Array, Array, Array]:
        """Return the other parts of a state vector: wheel momenta, outputs of the actuator, state of the law."""
        momenta = self.momentum.size
        outputs = 0
        if self.loop.actuator.time_constant is not None and not self.loop.holds:
            outputs = 3 if self.loop.body is None or self.loop.body.wheels is None else momenta
        a, b = self.rigid + momenta, self.rigid + momenta + outputs
        return state[self.rigid : a], state[a:b], state[b:]


def law_start(loop: Loop, reference: Attitude, quaternion: Quat, rate: Quat) -> Any:
    """Return the initial state of the law as a tree of arrays with the dtype of the motion, or None."""
    state = loop.law.start(reference, quaternion, rate)
    return None if state is None else jax.tree.map(lambda x: jnp.asarray(x).astype(quaternion.dtype), state)
