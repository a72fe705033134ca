"""The closed loop as one differential equation, with continuous or sampled commands."""

from typing import Any

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
from qtraj.motion.simulation.ode import Memory, State
from qtraj.motion.simulation.sensor import AbstractSensor, Gyros
from qtraj.motion.simulation.task import Scale, Task

ROUNDING = 1e-9
"""Fraction of a period, in addition to round-off, by which the last sample may miss the end."""

MAX_RENEWALS = 1_000_000
"""The largest number of commands; more would take many minutes."""


class Loop(eqx.Module):
    """The parts of a closed loop.

    **Raises:** ValueError for parts of another type, and for a disturbance or `Gyros` with a rate law.
    """

    program: AbstractProgram
    law: AbstractLaw
    disturbance: AbstractDisturbance | None
    sensor: AbstractSensor | None
    actuator: Actuator

    def __check_init__(self):
        _require_kind(self.program, AbstractProgram, "program", "FrameProgram(path)")
        _require_kind(self.law, AbstractLaw, "law", "AccelerationLaw(2.0, 1.0)")
        _require_kind(self.disturbance, AbstractDisturbance | None, "disturbance", "DisturbanceTorque(torque, inertia)")
        _require_kind(self.sensor, AbstractSensor | None, "sensor", "Gyros(0.1)")
        _require_kind(self.actuator, Actuator, "actuator", "Actuator(1.0)")
        if self.commands_rate and self.disturbance is not None:
            raise ValueError(
                "a rate law commands the rate, which a disturbing acceleration cannot change. Use an AccelerationLaw."
            )
        if self.commands_rate and isinstance(self.sensor, Gyros):
            raise ValueError("Gyros need a continuous rate, but a rate law lets the rate jump. Use an AccelerationLaw.")

    @property
    def commands_rate(self) -> bool:
        """Whether the law commands the rate instead of the acceleration."""
        return isinstance(self.law, RateLaw)

    def reference(self, t: Scalar, dtype: DTypeLike) -> Attitude:
        """The program's attitude, in the dtype of the state."""
        return jax.tree.map(lambda x: x.astype(dtype), self.program(t))

    def command(self, t: Scalar, quaternion: Quat, rate: Quat) -> Quat:
        """The limited command for a measured state."""
        return self.actuator(self.law(self.reference(t, quaternion.dtype), quaternion, rate))


class States(eqx.Module):
    """λ, ω and the command at the output instants."""

    quaternion: Float[Array, "n 4"]
    rate: Float[Array, "n 4"]
    command: Float[Array, "n 4"]


class Plant(eqx.Module):
    """The body under a command: its state is in R⁸ for accelerations and in R⁴ for rates."""

    loop: Loop
    scale: Scale

    def pack(self, quaternion: Quat, rate: Quat) -> State:
        """The state vector of λ and ω."""
        return quaternion / self.scale.quaternion if self.loop.commands_rate else self.scale.pack(quaternion, rate)

    def unpack(self, state: State, command: Quat) -> tuple[Quat, Quat]:
        """λ and ω of a state vector; under a rate law ω is the command."""
        if self.loop.commands_rate:
            return state * self.scale.quaternion, command
        return self.scale.unpack(state)

    def states(self, states: Float[Array, "n d"], commands: Float[Array, "n 4"]) -> States:
        """λ, ω and the commands for many state vectors."""
        return States(*jax.vmap(self.unpack)(states, commands), commands)

    def slope(self, t: Scalar, state: State, command: Quat) -> State:
        """The time derivative of the state vector [1/s]."""
        command = command.astype(state.dtype)
        if self.loop.commands_rate:
            return derivative(state, command)
        if self.loop.disturbance is not None:
            command = command + pure(self.loop.disturbance.acceleration(t).astype(state.dtype))
        quaternion, rate = self.scale.unpack(state)
        return self.scale.pack(derivative(quaternion, rate), command)


def run(loop: Loop, task: Task, renewals: Float[Array, " m"] | None) -> tuple[States, Int[Array, ""]]:
    """The motion at the task's times, and the result code.

    With `renewals` [s] the command is held between them; without, it is continuous.
    """
    plant = Plant(loop, Scale(task))
    return _continuous(plant, task) if renewals is None else _sampled(plant, task, renewals)


def _continuous(plant: Plant, task: Task) -> tuple[States, Int[Array, ""]]:
    loop = plant.loop

    def command(t: Scalar, state: State) -> Quat:
        known = plant.unpack(state, task.rate)  # a rate law does not use the rate
        if loop.sensor is not None:
            memory = loop.sensor.start(*known)
            *known, _ = loop.sensor.measure(jnp.asarray(0), jnp.zeros_like(t), *known, memory)
        return loop.command(t, *known)

    def field(t: Scalar, state: State, memory: None) -> State:
        return plant.slope(t, state, command(t, state))

    grid, outputs = task.grid()
    start = plant.pack(task.quaternion, task.rate)
    states, _, code = ode.march(field, ode.keep, start, None, grid, task.tolerances, task.method)
    return plant.states(states[outputs], jax.vmap(command)(task.times, states[outputs])), code


def _sampled(plant: Plant, task: Task, renewals: Float[Array, " m"]) -> tuple[States, Int[Array, ""]]:
    loop = plant.loop

    def field(t: Scalar, state: State, memory: Memory) -> State:
        return plant.slope(t, state, memory[0])

    def renew(k: Int[Array, ""], t: Scalar, state: State, memory: Memory) -> Memory:
        held, count, before, sensed = memory
        known = plant.unpack(state, held)
        if loop.sensor is not None:
            *known, sensed = loop.sensor.measure(count, t - before, *known, sensed)
        return loop.command(t, *known).astype(held.dtype), count + 1, t, sensed

    sensed = None if loop.sensor is None else loop.sensor.start(task.quaternion, task.rate)
    memory = (jnp.zeros_like(task.rate), jnp.asarray(0), task.times[0], sensed)
    grid, outputs = task.grid(renewals)
    start = plant.pack(task.quaternion, task.rate)
    states, memories, code = ode.march(field, renew, start, memory, grid, task.tolerances, task.method)
    states, commands = states[outputs], memories[0][outputs]
    return plant.states(states, jnp.where(jnp.isfinite(states[:, :1]), commands, jnp.nan)), code


def renewal_instants(loop: Loop, times: Float[Array, " n"]) -> Float[Array, " m"] | None:
    """The instants of new commands [s], from the sampling of sensor and actuator; None for a continuous loop.

    **Raises:** ValueError where the two differ, where a period is traced or gives more than `MAX_RENEWALS` instants,
    or where the first instant is after the first of `times`.
    """
    with jax.ensure_compile_time_eval():  # what is known outside a trace stays known inside
        return _renewal_instants(loop, times)


def _renewal_instants(loop: Loop, times: Float[Array, " n"]) -> Float[Array, " m"] | None:
    parts = [part for part in (loop.sensor, loop.actuator) if part is not None]
    samplings = [part.sampling for part in parts if part.sampling is not None]
    if not samplings:
        return None
    if len(samplings) == 2 and not _same(samplings[0], samplings[1]):
        raise ValueError(
            "sensor and actuator sample differently. Use the same sampling for both, or sampling=None for one."
        )
    sampling = samplings[0].astype(times.dtype)
    if sampling.ndim:
        _require_early(sampling, times)
        return sampling
    period, span = concrete(sampling), concrete(times[-1] - times[0])
    if period is None or span is None:
        raise ValueError(
            "the number of commands is not known for a traced period or span: pass the instants as sampling"
        )
    periods = float(span) / float(period)
    rounding = ROUNDING + 4 * float(np.finfo(span.dtype).eps) * periods
    if periods > MAX_RENEWALS:
        raise ValueError(
            f"a sampling period of {float(period):.6g} s means {periods:.3g} commands in {float(span):.6g} s, but the "
            f"maximum is {MAX_RENEWALS}. Use a longer period, or sampling=None for a continuous loop."
        )
    count = int(np.floor(periods + rounding)) + 1
    return times[0] + sampling * jnp.arange(count, dtype=times.dtype)


def _require_kind(part: Any, kind: Any, name: str, example: str) -> None:
    if not isinstance(part, kind):
        raise ValueError(f"the {name} must be an object such as {example}, but {part!r} was given")


def _same(a: Array, b: Array) -> bool:
    values_a, values_b = concrete(a), concrete(b)
    if values_a is None or values_b is None:
        return a is b
    return a.shape == b.shape and bool(np.all(values_a == values_b))


def _require_early(instants: Float[Array, " m"], times: Float[Array, " n"]) -> None:
    first, start = concrete(instants[0]), concrete(times[0])
    if first is not None and start is not None and first > start:
        raise ValueError(
            f"the first sampling instant, {float(first):.9g} s, comes after the first of times, {float(start):.9g} s: "
            "no command is defined in between"
        )
