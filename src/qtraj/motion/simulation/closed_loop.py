"""Integrate the closed loop, with a continuous command or with new commands at discrete instants."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.hysteresis import initial_sign, updated_sign, with_sign
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.interval import Memory, State
from qtraj.motion.simulation.plant import Held, Plant
from qtraj.motion.simulation.task import Setup


class States(eqx.Module):
    """The state vectors at n instants, the held commands (None if the command is continuous) and the signs of λ.

    The signs are None for a law without hysteresis.
    """

    states: Float[Array, "n d"]
    held: Held | None
    signs: Float[Array, " n"] | None


class Output(eqx.Module):
    """The attitude of the program, the motion of the body and the current commands at one instant."""

    reference: Attitude
    quaternion: Quat
    rate: Quat
    momentum: Float[Array, " m"]
    held: Held


def run(plant: Plant, setup: Setup) -> tuple[States, Int[Array, ""]]:
    """Integrate the closed loop, and return the states at the output instants and the result code.

    If the sensor or the actuator is sampled, the command is held between the updates of the grid. Otherwise the command
    is continuous, and the updates change only the sign of a hysteretic law.
    """
    states, held, signs, code = _sampled(plant, setup) if plant.loop.holds else _continuous(plant, setup)
    states, held, signs = jax.tree.map(lambda x: x[setup.outputs], (states, held, signs))
    return States(states, held, signs), code


def outputs_at(plant: Plant, setup: Setup, states: States) -> Output:
    """Return the outputs (n, …) at all output instants; a loop over them compiles faster than a vectorised form."""

    def at(x: tuple[Scalar, States]) -> Output:
        t, now = x
        reference = plant.loop.reference(t, now.states.dtype)
        held = _command(plant, setup, t, reference, now.states, now.signs) if now.held is None else now.held
        quaternion, rate = plant.unpack(now.states, held.command)
        return Output(reference, with_sign(now.signs, quaternion), rate, plant.momentum_of(now.states), held)

    return jax.lax.map(at, (setup.times, states))


def _measured(plant: Plant, setup: Setup, t: Scalar, state: State) -> tuple[Quat, Quat]:
    """Return the measured λ and ω for a continuous command."""
    exact = plant.unpack(state, setup.task.rate)  # a rate law does not use the rate, so its value has no effect
    sensor = plant.loop.sensor
    if sensor is None:
        return exact
    return sensor.measure(jnp.asarray(0), jnp.zeros_like(t), *exact, sensor.start(*exact))[:2]


def _command(plant: Plant, setup: Setup, t: Scalar, reference: Attitude, state: State, sign: Scalar | None) -> Held:
    quaternion, rate = _measured(plant, setup, t, state)
    return plant.hold(state, plant.loop.command(reference, with_sign(sign, quaternion), rate), rate)


def _continuous(plant: Plant, setup: Setup) -> tuple[Array, None, Array | None, Int[Array, ""]]:
    task, loop = setup.task, plant.loop

    def field(t: Scalar, state: State, sign: Scalar | None) -> State:
        return plant.slope(t, state, _command(plant, setup, t, loop.reference(t, state.dtype), state, sign))

    def update(k: Int[Array, ""], t: Scalar, state: State, sign: Scalar | None) -> Scalar | None:
        quaternion, _ = _measured(plant, setup, t, state)
        return updated_sign(loop.law, sign, loop.reference(t, state.dtype), quaternion)

    start, sign = plant.pack(task.quaternion, task.rate), initial_sign(loop.law, task.quaternion)
    renew = ode.keep if sign is None else update
    states, signs, code = ode.march(field, renew, start, sign, setup.grid, task.tolerances, task.method)
    return states, None, signs, code


def _sampled(plant: Plant, setup: Setup) -> tuple[Array, Held, Array | None, Int[Array, ""]]:
    task, loop = setup.task, plant.loop

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
    states, memories, code = ode.march(field, renew, start, memory, setup.grid, task.tolerances, task.method)
    reached = jnp.isfinite(states[:, :1])
    return states, jax.tree.map(lambda x: jnp.where(reached, x, jnp.nan), memories[0]), memories[4], code
