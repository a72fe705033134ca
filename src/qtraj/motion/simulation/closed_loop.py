"""Integrate the closed loop, with a continuous command or with new commands at discrete instants."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.hysteresis import initial_sign, updated_sign, with_sign
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.interval import Memory, State
from qtraj.motion.simulation.loop import Loop
from qtraj.motion.simulation.plant import Held, Plant, States
from qtraj.motion.simulation.task import Scale, Task


def run(
    loop: Loop, task: Task, renewals: Float[Array, " m"] | None, references: Attitude
) -> tuple[States, Int[Array, ""]]:
    """Integrate the closed loop, and return the motion at the times of `task` and the result code.

    `references` are the attitudes of the program at these times, with fields (n, …). With `renewals` [s], the command
    is held between these instants if the sensor or the actuator is sampled, and the command is continuous if only the
    law updates its sign. Without `renewals`, the command is continuous.
    """
    plant = Plant(loop, Scale(task))
    if renewals is None or not loop.holds:
        return _continuous(plant, task, renewals, references)
    return _sampled(plant, task, renewals)


def _continuous(
    plant: Plant, task: Task, updates: Float[Array, " m"] | None, references: Attitude
) -> tuple[States, Int[Array, ""]]:
    loop = plant.loop

    def measured(t: Scalar, state: State) -> tuple[Quat, Quat]:
        exact = plant.unpack(state, task.rate)  # a rate law does not use the rate, so its value has no effect
        if loop.sensor is None:
            return exact
        return loop.sensor.measure(jnp.asarray(0), jnp.zeros_like(t), *exact, loop.sensor.start(*exact))[:2]

    def command(t: Scalar, reference: Attitude, state: State, sign: Scalar | None) -> Held:
        quaternion, rate = measured(t, state)
        return plant.hold(state, loop.command(reference, with_sign(sign, quaternion), rate), rate)

    def field(t: Scalar, state: State, sign: Scalar | None) -> State:
        return plant.slope(t, state, command(t, loop.reference(t, state.dtype), state, sign))

    def update(k: Int[Array, ""], t: Scalar, state: State, sign: Scalar | None) -> Scalar | None:
        return updated_sign(loop.law, sign, loop.reference(t, state.dtype), measured(t, state)[0])

    grid, outputs = task.grid(updates)
    start, sign = plant.pack(task.quaternion, task.rate), initial_sign(loop.law, task.quaternion)
    states, signs, code = ode.march(field, update, start, sign, grid, task.tolerances, task.method)
    states, signs = states[outputs], jax.tree.map(lambda x: x[outputs], signs)
    held = jax.lax.map(lambda x: command(*x), (task.times, references, states, signs))
    return plant.states(states, held, signs), code


def _sampled(plant: Plant, task: Task, renewals: Float[Array, " m"]) -> tuple[States, Int[Array, ""]]:
    loop = plant.loop

    def field(t: Scalar, state: State, memory: Memory) -> State:
        return plant.slope(t, state, memory[0])

    def renew(k: Int[Array, ""], t: Scalar, state: State, memory: Memory) -> Memory:
        held, count, before, sensed, sign = memory
        quaternion, rate = plant.unpack(state, held.command)
        if loop.sensor is not None:
            quaternion, rate, sensed = loop.sensor.measure(count, t - before, quaternion, rate, sensed)
        reference = loop.reference(t, quaternion.dtype)
        sign = updated_sign(loop.law, sign, reference, quaternion)
        command = loop.command(reference, with_sign(sign, quaternion), rate).astype(held.command.dtype)
        return plant.hold(state, command, rate), count + 1, t, sensed, sign

    sensed = None if loop.sensor is None else loop.sensor.start(task.quaternion, task.rate)
    sign = initial_sign(loop.law, task.quaternion)
    start = plant.pack(task.quaternion, task.rate)
    no_command = jax.tree.map(jnp.zeros_like, plant.hold(start, task.rate, task.rate))
    memory = (no_command, jnp.asarray(0), task.times[0], sensed, sign)
    grid, outputs = task.grid(renewals)
    states, memories, code = ode.march(field, renew, start, memory, grid, task.tolerances, task.method)
    states = states[outputs]
    held, signs = (jax.tree.map(lambda x: x[outputs], memories[k]) for k in (0, 4))
    reached = jnp.isfinite(states[:, :1])
    return plant.states(states, jax.tree.map(lambda x: jnp.where(reached, x, jnp.nan), held), signs), code
