"""Simulation of the closed loop: program, law, body, disturbance, sensor and actuator."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.algebra.quaternion import norm_squared
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control.errors import error_angle
from qtraj.motion.control.hysteresis import without_hysteresis
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.body_motion import BodyMotion, deviation_of, residual_of
from qtraj.motion.simulation.closed_loop import run
from qtraj.motion.simulation.disturbance import AbstractDisturbance, DisturbanceAcceleration
from qtraj.motion.simulation.initial_sign import NEARER, require_sign, start_quaternion
from qtraj.motion.simulation.loop import Loop, renewal_instants
from qtraj.motion.simulation.ode import MAX_STEPS, Method
from qtraj.motion.simulation.plant import Held, Plant, States
from qtraj.motion.simulation.sensor import AbstractSensor
from qtraj.motion.simulation.solution import Solution
from qtraj.motion.simulation.task import Scale, Task, checked

NEAR = 0.1
"""Length of the error quaternion, relative to its initial one (and to 1), below which the result mentions it."""


def simulate(
    program: AbstractProgram,
    law: AbstractLaw,
    quaternion: ArrayInput,
    rate: ArrayInput,
    times: ArrayInput,
    disturbance: AbstractDisturbance | Callable[..., Any] | None = None,
    sensor: AbstractSensor | None = None,
    actuator: Actuator | None = None,
    solver: Any = None,
    rtol: ArrayInput = 1e-10,
    atol: ArrayInput = 1e-12,
    *,
    sign: str = NEARER,
    body: RigidBody | None = None,
    jumps: ArrayInput | None = None,
    adjoint: Any = None,
    max_steps: int = MAX_STEPS,
    throw: bool = False,
) -> Solution:
    """The motion of a body that `law` makes follow `program`, from `quaternion` (4,) and body `rate` (4,) [rad/s].

    `times` (n,) [s]: instants of the program's own time, increasing; the first is that of the initial state.
    `sign`: λ and −λ are one attitude, and "nearer" starts with the one nearer to the program. With the other the body
    takes the long way round. "as given" keeps the sign of `quaternion`: after `control.place` or `control.choose_sign`,
    which look at the rate too, or to study that way. Later changes of sign need a `HystereticLaw`.
    `disturbance`: a `DisturbanceTorque`, a `DisturbanceAcceleration`, or a function t → (3,) [rad/s²] in body axes.
    `sensor`: `Sensor` or `Gyros`; None measures the exact state. `actuator`: limits and hold of the command. With a
    sampled sensor or actuator the command changes at the samples only. `jumps`: instants where program or disturbance
    jump, such as a slew's `profile.switches`. `jumps`, the tolerances, `solver`, `adjoint`, `max_steps` and `throw` are
    those of `integrate`. A `RateLaw` commands the rate: `rate` then determines the dtype only, and a disturbance is not
    possible.

    `body`: a `RigidBody`, which turns under torques that are calculated with the inertia the computer assumes, from
    wheels that may saturate, and under external torques. The error equation of the law is then no longer exact; the
    solution's `body` and `result` report the deviation. None: the body follows the commanded acceleration exactly, and
    `dynamics.torque` computes the torque it needs.

    `command` of the solution is the limited command, without the disturbance, and at a sample the new one.

    **Raises:** ValueError as `integrate`; for another `sign`; for parts of another type, or a disturbance that is not a
    function of the time alone; for a disturbance, `Gyros` or a `body` with a rate law; where sensor, actuator and
    hysteretic law sample differently; for a period that is traced or too short. RuntimeError with `throw`.
    """
    require_sign(sign)
    task = checked(quaternion, rate, times, jumps, rtol, atol, Method(solver, adjoint, max_steps))
    loop = Loop(program, law, _disturbance(disturbance), sensor, Actuator() if actuator is None else actuator, body)
    solution = _simulate(loop, task, renewal_instants(loop, task.times), sign)
    return solution.check() if throw else solution


@eqx.filter_jit
def _simulate(loop: Loop, task: Task, renewals: Float[Array, " m"] | None, sign: str) -> Solution:
    first = loop.reference(task.times[0], task.times.dtype)
    task = eqx.tree_at(lambda x: x.quaternion, task, start_quaternion(sign, first, task.quaternion))
    states, code = run(loop, task, renewals)
    references = jax.vmap(lambda t: loop.reference(t, t.dtype))(task.times)
    errors = jax.vmap(loop.law.deviation)(references, states.quaternion)
    angles = jax.vmap(error_angle)(references, states.quaternion)
    code = _refined_code(loop.law, code, references, states.quaternion)
    commands = "rate" if isinstance(loop.law, RateLaw) else "acceleration"
    body_motion = _body_motion(loop, task, states, references)
    motion = (task.times, states.quaternion, states.rate, code, states.held.command, errors, angles)
    return Solution(*motion, "body", commands, body_motion)


def _body_motion(loop: Loop, task: Task, states: States, references: Attitude) -> BodyMotion | None:
    """Torques, and deviations from the exact error equation, of a body with inertia."""
    if loop.body is None:
        return None
    plant = Plant(loop, Scale(task))
    law, body = without_hysteresis(loop.law), loop.body

    def mismatch(t: Scalar, reference: Attitude, quaternion: Quat, rate: Quat, momentum: Array, held: Held) -> Quat:
        epsilon = plant.disturbed(t, plant.acceleration(t, rate, momentum, held))
        return epsilon - loop.law(reference, quaternion, rate)

    motion = (states.quaternion, states.rate, states.momentum, states.held)
    mismatches = jax.vmap(mismatch)(task.times, references, *motion)
    torques = jax.vmap(body.control_torque)(states.held.torques, states.momentum)
    residuals = deviations = None
    if isinstance(law, AccelerationLaw):
        residuals = jax.vmap(lambda *x: residual_of(law, *x))(references, states.quaternion, mismatches)
    if isinstance(loop.law, AccelerationLaw):
        deviations = deviation_of(loop.law, references, task.times, states.quaternion, states.rate)
    momenta = None if body.wheels is None else states.momentum
    return BodyMotion(task.times, torques, mismatches[:, 1:], momenta, residuals, deviations)


def _refined_code(
    law: AbstractLaw, code: Int[Array, ""], references: Attitude, quaternions: Float[Array, "n 4"]
) -> Int[Array, ""]:
    """The result code, refined for laws with a pole at μ = 0."""
    if not isinstance(without_hysteresis(law), AccelerationLaw | RateLaw):
        return code
    lengths = jnp.sqrt(jax.vmap(norm_squared)(quaternions))
    minimum = jnp.nanmin(lengths)
    far = jnp.sum(references.quaternion[0] * quaternions[0]) < 0
    passed = (code == ResultCode.successful) & (minimum < NEAR * jnp.minimum(lengths[0], 1.0))
    stuck = ((code == ResultCode.max_steps_reached) | (code == ResultCode.step_too_small)) & far
    refined = jnp.where(passed, ResultCode.near_zero_error, jnp.where(stuck, ResultCode.wrong_sign, code))
    return refined.astype(jnp.int32)


def _disturbance(
    disturbance: AbstractDisturbance | Callable[..., Any] | None,
) -> AbstractDisturbance | None:
    if disturbance is None or isinstance(disturbance, AbstractDisturbance):
        return disturbance
    return DisturbanceAcceleration(disturbance)
