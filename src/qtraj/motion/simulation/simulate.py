"""Simulate a closed loop of program, law, body, disturbance, sensor and actuator."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from qtraj.algebra.quaternion import norm_squared
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.namespace import in_numpy, xp
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput, Flag, Quat, Scalar
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.control.hysteresis import without_hysteresis
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw, commanded, errors_at
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.body_motion import BodyMotion, deviation_of, residual_of
from qtraj.motion.simulation.closed_loop import Output, outputs_at, run
from qtraj.motion.simulation.disturbance import AbstractDisturbance, DisturbanceAcceleration
from qtraj.motion.simulation.initial_sign import NEARER, is_far, require_sign, start_quaternion
from qtraj.motion.simulation.interval import MAX_STEPS, Method
from qtraj.motion.simulation.loop import Loop, renewal_instants, steps_with_lag
from qtraj.motion.simulation.plant import Plant
from qtraj.motion.simulation.sensor import AbstractSensor
from qtraj.motion.simulation.solution import Solution
from qtraj.motion.simulation.task import Setup, checked, setup

NEAR = 0.1
"""|μ| counts as near zero if it is below this fraction of the smaller of |μ(0)| and 1."""


@on_one_device
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
    """Simulate a body that follows `program` under `law`, from `quaternion` (4,) and body `rate` [rad/s], (3,) or (4,).

    `times` (n,) [s]: increasing instants, measured from the start of the program; `quaternion` and `rate` are the state
    at times[0]. `sign`: λ and −λ represent the same attitude. "nearer" starts with the quaternion nearer to the
    program. With the other quaternion, the body would rotate by more than a half turn. "as given" keeps the sign of
    `quaternion`: use it after `control.place` or `control.choose_sign`, which also consider the rate, or to study such
    rotations. Only a `HystereticLaw` changes the sign later. `disturbance`: a `DisturbanceTorque`, a
    `DisturbanceAcceleration`, or a function t → (3,) or (t, quaternion, rate) → (3,) [rad/s²] in body axes, where
    quaternion (4,) is the unit quaternion of the true attitude and rate (3,) [rad/s] the true rate in body axes.
    `sensor`: `Sensor` or `Gyros`; None for exact measurements. `actuator`: an `Actuator`, which can limit the command,
    hold it between samples and follow it with a lag; None for an ideal one. With a sampled sensor or actuator, the
    command changes at the samples only. `law` may have a state of its own (see `control.AbstractLaw`). `jumps` [s]:
    instants at which the program or the disturbance jumps, such as `profile.switches` of a slew. `jumps`, the
    tolerances, `solver`, `adjoint`, `max_steps` and `throw` are as in `integrate`. A `RateLaw` commands the rate. In
    this case `rate` determines only the dtype, and a disturbance is not possible.

    `body`: a `RigidBody`, which rotates under external torques and under control torques that are calculated with an
    assumed inertia and may saturate. The error equation of the law is then no longer exact; the solution's `body` and
    `result` report the deviation. With None, the body has exactly the commanded acceleration, and `dynamics.torque`
    computes the required torque.

    The `command` of the solution is the limited command, without the disturbance; at a sample, it is the new command.

    For batches, `qtraj.in_blocks` takes fewer steps than `jax.vmap`, and does not compile again for other sizes.

    **Raises:** ValueError in the same cases as `integrate`; for a `sign` other than "nearer" or "as given"; for
    arguments of another type, or a disturbance with other arguments; if a disturbance, `Gyros` or a
    `body` is combined with a rate law; if sensor, actuator and hysteretic law have different sampling; for a period
    that is traced or too short. RuntimeError if `throw` is true and an instant was not reached.
    """
    require_sign(sign)
    loop = Loop(program, law, _disturbance(disturbance), sensor, Actuator() if actuator is None else actuator, body)
    method = Method(solver, adjoint, steps_with_lag(loop, times, max_steps))
    task = checked(quaternion, rate, times, jumps, rtol, atol, method)
    renewals = renewal_instants(loop, task.times)
    first = program(task.times[0])
    task = eqx.tree_at(lambda x: x.quaternion, task, start_quaternion(sign, first, task.quaternion))
    loop = eqx.tree_at(lambda x: x.program, loop, program.prepared())
    outputs, code, body_motion = _simulate(loop, setup(task, renewals))
    error, angle = errors_at(law, outputs.reference, outputs.quaternion)
    if isinstance(without_hysteresis(law), AccelerationLaw | RateLaw):
        code = _refined_code(code, outputs.quaternion, is_far(first, task.quaternion))
    motion = (task.times, outputs.quaternion, outputs.rate, code, outputs.command, error, angle)
    solution = Solution(*motion, "body", law.commands, body_motion, outputs.law_state)
    return solution.check() if throw else solution


@eqx.filter_jit
def _simulate(loop: Loop, setup: Setup) -> tuple[Output, Int[Array, ""], BodyMotion | None]:
    plant, states, code = run(loop, setup)
    outputs = outputs_at(plant, setup, states)
    body_motion = _body_motion(plant, setup, outputs)
    if outputs.law_state is not None:
        rows = jax.vmap(lambda x: ravel_pytree(x)[0])(outputs.law_state)
        reached = jnp.isfinite(outputs.quaternion[:, :1])
        outputs = eqx.tree_at(lambda x: x.law_state, outputs, jnp.where(reached, rows, jnp.nan))
    return outputs, code, body_motion


def _body_motion(plant: Plant, setup: Setup, outputs: Output) -> BodyMotion | None:
    """Return torques and deviations from the exact error equation of a `RigidBody`; None without a `RigidBody`."""
    loop = plant.loop
    if loop.body is None:
        return None
    law, body = without_hysteresis(loop.law), loop.body

    def at(x: tuple[Scalar, Output]) -> tuple[Quat, Array, Quat | None]:
        t, now = x
        epsilon = plant.acceleration(t, now.quaternion, now.rate, now.momentum, now.applied)
        mismatch = epsilon - commanded(loop.law, now.law_state, now.reference, now.quaternion, now.rate)
        torque = body.control_torque(now.applied.torques, now.momentum)
        if not isinstance(law, AccelerationLaw):
            return mismatch, torque, None
        return mismatch, torque, residual_of(law, now.reference, now.quaternion, mismatch)

    mismatches, torques, residuals = jax.lax.map(at, (setup.times, outputs))
    deviations = None
    if isinstance(loop.law, AccelerationLaw):
        deviations = deviation_of(loop.law, outputs.reference, setup.times, outputs.quaternion, outputs.rate)
    momenta = None if body.wheels is None else outputs.momentum
    return BodyMotion(setup.times, torques, mismatches[:, 1:], momenta, residuals, deviations)


@in_numpy
def _refined_code(code: Int[Array, ""], quaternions: Float[Array, "n 4"], far: Flag) -> Int[Array, ""]:
    """Return the result code, with the codes `near_zero_error` and `wrong_sign`, for a law with a pole at μ = 0.

    `far`: whether the motion starts with the quaternion that is farther from the program.
    """
    lengths = xp.sqrt(norm_squared(quaternions))
    minimum = xp.min(xp.where(xp.isnan(lengths), xp.inf, lengths))
    passed = (code == ResultCode.successful) & (minimum < NEAR * xp.minimum(lengths[0], 1.0))
    stuck = ((code == ResultCode.max_steps_reached) | (code == ResultCode.step_too_small)) & far
    refined = xp.where(passed, ResultCode.near_zero_error, xp.where(stuck, ResultCode.wrong_sign, code))
    return refined.astype(np.int32)


def _disturbance(
    disturbance: AbstractDisturbance | Callable[..., Any] | None,
) -> AbstractDisturbance | None:
    if disturbance is None or isinstance(disturbance, AbstractDisturbance):
        return disturbance
    return DisturbanceAcceleration(disturbance)
