"""Integrate the closed loop, with a continuous command or with new commands at discrete instants."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.hysteresis import initial_sign, updated_sign, with_sign
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.interval import Memory, State
from qtraj.motion.simulation.loop import Loop
from qtraj.motion.simulation.plant import Held, Plant, law_start
from qtraj.motion.simulation.task import Setup


class States(eqx.Module):
    """The state vectors at n instants, the held commands, the signs of λ and the states of the law.

    `held` and `law` are None if the command is continuous; `signs` is None for a law without hysteresis.
    """

    states: Float[Array, "n d"]
    held: Held | None
    signs: Float[Array, " n"] | None
    law: Any


class Output(eqx.Module):
    """The attitude of the program, the motion of the body and the command at one instant.

    `applied`: the command and the torques after the lag of the actuator.
    """

    reference: Attitude
    quaternion: Quat
    rate: Quat
    momentum: Float[Array, " m"]
    command: Quat
    applied: Held
    law_state: Any


def run(loop: Loop, setup: Setup) -> tuple[Plant, States, Int[Array, ""]]:
    """Integrate the closed loop, and return the body, the states at the output instants and the result code.

    If the sensor or the actuator is sampled, the command is held between the updates of the grid. Otherwise the command
    is continuous, and the updates change only the sign of a hysteretic law.
    """
    task = setup.task
    reference = loop.reference(task.times[0], task.quaternion.dtype)
    law_state = law_start(loop, reference, task.quaternion, task.rate)
    plant = Plant(loop, setup.scale, law_state)
    start = plant.pack(task.quaternion, task.rate)
    if loop.actuator.time_constant is not None and not loop.holds:
        command = loop.command(reference, task.quaternion, task.rate, law_state)
        start = plant.pack(task.quaternion, task.rate, plant.hold(start, command, task.rate))
    integrate = _sampled if loop.holds else _continuous
    states, code = integrate(plant, setup, start)
    return plant, jax.tree.map(lambda x: x[setup.outputs], states), code


def outputs_at(plant: Plant, setup: Setup, states: States) -> Output:
    """Return the outputs (n, …) at all output instants; a loop over them compiles faster than a vectorised form."""

    def at(x: tuple[Scalar, States]) -> Output:
        t, now = x
        reference = plant.loop.reference(t, now.states.dtype)
        law_state, held = now.law, now.held
        if held is None:
            law_state = plant.law_state_of(now.states)
            held = _command(plant, setup, t, reference, now.states, now.signs)
        applied = plant.applied(t, now.states, held)
        quaternion, rate = plant.unpack(now.states, applied.command)
        momentum = plant.momentum_of(now.states)
        return Output(reference, with_sign(now.signs, quaternion), rate, momentum, held.command, applied, law_state)

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
    law_state = plant.law_state_of(state)
    return plant.hold(state, plant.loop.command(reference, with_sign(sign, quaternion), rate, law_state), rate)


def _continuous(plant: Plant, setup: Setup, start: State) -> tuple[States, Int[Array, ""]]:
    task, loop = setup.task, plant.loop

    def field(t: Scalar, state: State, sign: Scalar | None) -> State:
        reference, law_slope = loop.reference(t, state.dtype), None
        if plant.law_state is not None:
            measured = _measured(plant, setup, t, state)
            law_slope = loop.law.slope(plant.law_state_of(state), reference, *measured)
        return plant.slope(t, state, _command(plant, setup, t, reference, state, sign), law_slope)

    def update(k: Int[Array, ""], t: Scalar, state: State, sign: Scalar | None) -> Scalar | None:
        quaternion, _ = _measured(plant, setup, t, state)
        return updated_sign(loop.law, sign, loop.reference(t, state.dtype), quaternion)

    sign = initial_sign(loop.law, task.quaternion)
    renew = ode.keep if sign is None else update
    states, signs, code = ode.march(field, renew, start, sign, setup.grid, task.tolerances, task.method)
    return States(states, None, signs, None), code


def _sampled(plant: Plant, setup: Setup, start: State) -> tuple[States, Int[Array, ""]]:
    task, loop = setup.task, plant.loop

    def field(t: Scalar, state: State, memory: Memory) -> State:
        return plant.slope(t, state, memory[0])

    def renew(k: Int[Array, ""], t: Scalar, state: State, memory: Memory) -> Memory:
        held, count, before, sensed, sign, law_state = memory
        quaternion, rate = plant.unpack(state, plant.applied(t, state, held).command)
        if loop.sensor is not None:
            quaternion, rate, sensed = loop.sensor.measure(count, t - before, quaternion, rate, sensed)
        reference = loop.reference(t, quaternion.dtype)
        sign = updated_sign(loop.law, sign, reference, quaternion)
        quaternion = with_sign(sign, quaternion)
        if law_state is not None:
            law_state = loop.law.updated(law_state, t - before, reference, quaternion, rate)
        command = loop.command(reference, quaternion, rate, law_state).astype(held.command.dtype)
        held = plant.renewed(t, state, command, rate, held, count == 0)
        return held, count + 1, t, sensed, sign, law_state

    sensed = None if loop.sensor is None else loop.sensor.start(task.quaternion, task.rate)
    sign = initial_sign(loop.law, task.quaternion)
    none = plant.hold(start, task.rate, task.rate)
    if loop.actuator.time_constant is not None:
        torques = none.command[1:] if loop.body is None else none.torques
        none = Held(none.command, none.torques, torques, task.times[0])
    no_command = jax.tree.map(jnp.zeros_like, none)
    memory = (no_command, jnp.asarray(0), task.times[0], sensed, sign, plant.law_state)
    states, memories, code = ode.march(field, renew, start, memory, setup.grid, task.tolerances, task.method)
    reached = jnp.isfinite(states[:, 0])
    held = jax.tree.map(lambda x: jnp.where(jnp.expand_dims(reached, range(1, x.ndim)), x, jnp.nan), memories[0])
    return States(states, held, memories[4], memories[5]), code
