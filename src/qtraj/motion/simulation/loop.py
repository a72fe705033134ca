"""The closed loop as one differential equation, continuous or with commands renewed at given instants."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, Int

from qtraj.algebra.quaternion import derivative
from qtraj.foundation.arrays import concrete
from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control.errors import pure
from qtraj.motion.control.laws import AbstractLaw, RateLaw
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.disturbance import AbstractDisturbance
from qtraj.motion.simulation.kinematics import Scale, merged
from qtraj.motion.simulation.ode import Memory, Method, State, Tolerances
from qtraj.motion.simulation.sensor import AbstractSensor, Gyros

ROUNDING = 1e-9
"""A last renewal this part of a period before the end counts as one at the end."""


class Loop(eqx.Module):
    """All that closes the loop around a body.

    **Raises:** ValueError for a disturbance or a strapdown computer with a rate law.
    """

    program: AbstractProgram
    law: AbstractLaw
    disturbance: AbstractDisturbance | None
    sensor: AbstractSensor | None
    actuator: Actuator

    def __check_init__(self):
        if self.commands_rate and self.disturbance is not None:
            raise ValueError("a rate law leaves no room for a disturbing acceleration: take an AccelerationLaw")
        if self.commands_rate and isinstance(self.sensor, Gyros):
            raise ValueError("a strapdown computer needs a rate that does not jump: take an AccelerationLaw")

    @property
    def commands_rate(self) -> bool:
        """Whether the law commands the rate and not the acceleration."""
        return isinstance(self.law, RateLaw)

    def reference(self, t: Scalar, dtype: DTypeLike) -> Attitude:
        """The program's attitude, in the dtype of the state."""
        return jax.tree.map(lambda x: x.astype(dtype), self.program(t))

    def command(self, t: Scalar, quaternion: Quat, rate: Quat) -> Quat:
        """The actuator's command for what the sensor shows."""
        return self.actuator(self.law(self.reference(t, quaternion.dtype), quaternion, rate))


class States(eqx.Module):
    """λ, ω and the command in force at the output instants."""

    quaternion: Float[Array, "n 4"]
    rate: Float[Array, "n 4"]
    command: Float[Array, "n 4"]


class Plant(eqx.Module):
    """The body under a command: in R⁸ for accelerations, in R⁴ for rates."""

    loop: Loop
    scale: Scale

    def pack(self, quaternion: Quat, rate: Quat) -> State:
        return quaternion / self.scale.quaternion if self.loop.commands_rate else self.scale.pack(quaternion, rate)

    def unpack(self, state: State, command: Quat) -> tuple[Quat, Quat]:
        if self.loop.commands_rate:
            return state * self.scale.quaternion, command
        return self.scale.unpack(state)

    def slope(self, t: Scalar, state: State, command: Quat) -> State:
        """d/dt of the state vector [1/s]."""
        command = command.astype(state.dtype)
        if self.loop.commands_rate:
            return derivative(state, command)
        if self.loop.disturbance is not None:
            command = command + pure(self.loop.disturbance.acceleration(t).astype(state.dtype))
        return self.scale.field(state, command)


def run(
    loop: Loop,
    quaternion: Quat,
    rate: Quat,
    times: Float[Array, " n"],
    renewals: Float[Array, " m"] | None,
    jumps: Float[Array, " k"] | None,
    allowed: Tolerances,
    method: Method,
) -> tuple[States, Int[Array, ""]]:
    """The motion at `times` and the outcome: with renewals the command is held between them, else it is continuous."""
    plant = Plant(loop, Scale(quaternion, rate, times))
    if renewals is None:
        return _continuous(plant, quaternion, rate, times, jumps, allowed, method)
    return _sampled(plant, quaternion, rate, times, renewals, jumps, allowed, method)


def _continuous(
    plant: Plant,
    quaternion: Quat,
    rate: Quat,
    times: Float[Array, " n"],
    jumps: Float[Array, " k"] | None,
    allowed: Tolerances,
    method: Method,
) -> tuple[States, Int[Array, ""]]:
    loop = plant.loop

    def command(t: Scalar, state: State) -> Quat:
        known = plant.unpack(state, rate)  # a rate law looks at no rate
        if loop.sensor is not None:
            memory = loop.sensor.start(*known)
            *known, _ = loop.sensor.measure(jnp.asarray(0), jnp.zeros_like(t), *known, memory)
        return loop.command(t, *known)

    def field(t: Scalar, state: State, memory: None) -> State:
        return plant.slope(t, state, command(t, state))

    grid, outputs = merged(times, jumps, None)
    states, _, code = ode.march(
        field, lambda k, t, y, memory: memory, plant.pack(quaternion, rate), None, grid, allowed, method
    )
    states = states[outputs]
    commands = jax.vmap(command)(times, states)
    return States(*jax.vmap(plant.unpack)(states, commands), commands), code


def _sampled(
    plant: Plant,
    quaternion: Quat,
    rate: Quat,
    times: Float[Array, " n"],
    renewals: Float[Array, " m"],
    jumps: Float[Array, " k"] | None,
    allowed: Tolerances,
    method: Method,
) -> tuple[States, Int[Array, ""]]:
    loop = plant.loop

    def field(t: Scalar, state: State, memory: Memory) -> State:
        return plant.slope(t, state, memory[0])

    def renew(k: Int[Array, ""], t: Scalar, state: State, memory: Memory) -> Memory:
        held, count, before, sensed = memory
        known = plant.unpack(state, held)
        if loop.sensor is not None:
            *known, sensed = loop.sensor.measure(count, t - before, *known, sensed)
        return loop.command(t, *known).astype(held.dtype), count + 1, t, sensed

    sensed = None if loop.sensor is None else loop.sensor.start(quaternion, rate)
    memory = (jnp.zeros_like(rate), jnp.asarray(0), times[0], sensed)
    grid, outputs = merged(times, jumps, renewals)
    states, memories, code = ode.march(field, renew, plant.pack(quaternion, rate), memory, grid, allowed, method)
    states, commands = states[outputs], memories[0][outputs]
    commands = jnp.where(jnp.isfinite(states[:, :1]), commands, jnp.nan)
    return States(*jax.vmap(plant.unpack)(states, commands), commands), code


def renewal_instants(loop: Loop, times: Float[Array, " n"]) -> Float[Array, " m"] | None:
    """The instants of new commands [s], from those of sensor and actuator; None for a continuous loop.

    **Raises:** ValueError where the two differ, where a period is traced, or where the first instant comes late.
    """
    with jax.ensure_compile_time_eval():  # what is known outside a trace stays known inside
        return _renewal_instants(loop, times)


def _renewal_instants(loop: Loop, times: Float[Array, " n"]) -> Float[Array, " m"] | None:
    given = [part.sampling for part in (loop.sensor, loop.actuator) if part is not None and part.sampling is not None]
    if not given:
        return None
    if len(given) == 2 and not _same(given[0], given[1]):
        raise ValueError("sensor and actuator sample differently: give both the same period or instants, or one none")
    sampling = given[0].astype(times.dtype)
    if sampling.ndim:
        _require_early(sampling, times)
        return sampling
    period, span = concrete(sampling), concrete(times[-1] - times[0])
    if period is None or span is None:
        raise ValueError("a traced period or span has no known number of renewals: pass the instants as sampling")
    count = int(np.floor(span / period + ROUNDING)) + 1
    return times[0] + sampling * jnp.arange(count, dtype=times.dtype)


def _same(a: Array, b: Array) -> bool:
    known_a, known_b = concrete(a), concrete(b)
    if known_a is None or known_b is None:
        return a is b
    return a.shape == b.shape and bool(np.all(known_a == known_b))


def _require_early(instants: Float[Array, " m"], times: Float[Array, " n"]) -> None:
    first, start = concrete(instants[0]), concrete(times[0])
    if first is not None and start is not None and first > start:
        raise ValueError(
            f"the first sampling instant, {float(first):.9g} s, comes after the first of times, {float(start):.9g} s: "
            "there would be no command in between"
        )
