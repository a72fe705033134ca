"""Simulates a body under a law that makes its position and attitude follow a program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import dual_quaternion
from qtraj.algebra.quaternion import derivative
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, real_vector
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.motion.checks import common_dtype, initial_quaternion, output_times
from qtraj.motion.control.errors import error_angle, pure
from qtraj.motion.pose.pose_law import PoseLaw, PoseProgram, pose_error
from qtraj.motion.pose.pose_motion import PoseMotion
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.disturbance import Signal, at_instant, checked_signal
from qtraj.motion.simulation.initial_sign import NEARER, require_sign, start_quaternion
from qtraj.motion.simulation.ode import MAX_STEPS, Grid, Method, State, Tolerances


class _Task(eqx.Module):
    """The parts of a simulation.

    `push` [m/s²] and `twist` [rad/s²] are the linear and the angular acceleration of the disturbance.
    """

    program: PoseProgram
    law: PoseLaw
    push: Signal | None
    twist: Signal | None

    def reference(self, t: Scalar, state: State) -> tuple[Array, Attitude]:
        """Position, velocity and acceleration (3, 3), and attitude of the program."""
        return jax.tree.map(lambda x: x.astype(state.dtype), self.program(t))

    def commands(self, t: Scalar, state: State) -> tuple[Quat, Vec3]:
        """ε and a."""
        quaternion, rate, position, velocity = _split(state)
        return self.law(*self.reference(t, state), position, velocity, quaternion, rate)


def simulate_pose(
    program: PoseProgram,
    law: PoseLaw,
    position: ArrayInput,
    velocity: ArrayInput,
    quaternion: ArrayInput,
    rate: ArrayInput,
    times: ArrayInput,
    push: Callable[[Scalar], Vec3] | ArrayInput | None = None,
    twist: Callable[[Scalar], Vec3] | ArrayInput | None = None,
    solver: Any = None,
    rtol: ArrayInput = 1e-10,
    atol: ArrayInput = 1e-12,
    *,
    sign: str = NEARER,
    adjoint: Any = None,
    max_steps: int = MAX_STEPS,
    throw: bool = False,
) -> PoseMotion:
    """The motion of a body that follows `program` in position and attitude under `law`.

    The initial state, at the first of `times` (n,) [s], measured from the start of the program, is `position` and
    `velocity` (3,) [m, m/s], inertial axes, `quaternion` (4,), and `rate` (4,) [rad/s], body axes. The disturbances are
    constant (3,) or functions of time: `push`, an acceleration [m/s²] in inertial axes, and `twist`, an angular
    acceleration [rad/s²] in body axes. `sign` is as in `simulate`; `solver`, `rtol`, `atol`, `adjoint`, `max_steps` and
    `throw` are as in `integrate`.

    **Raises:** ValueError for arguments of another type or shape, another sign, or times that do not increase.
    RuntimeError if `throw` is true and an instant was not reached.
    """
    require_sign(sign)
    if not isinstance(program, PoseProgram):
        raise ValueError(f"the program must be a PoseProgram(path, attitude), but {program!r} was given")
    if not isinstance(law, PoseLaw):
        raise ValueError(f"the law must be a PoseLaw(attitude, k1, k2), but {law!r} was given")
    times, q = output_times(times), initial_quaternion(quaternion)
    rate = real_vector(rate, "the initial rate", 4)
    r, v = real_vector(position, "the position", 3), real_vector(velocity, "the velocity", 3)
    dtype = common_dtype(times, q, rate, r, v)
    q = start_quaternion(sign, program(times[0])[1], q)
    start = jnp.concatenate([x.astype(dtype) for x in (q, rate, r, v)])
    task = _Task(
        program,
        law,
        None if push is None else checked_signal(push, "the push"),
        None if twist is None else checked_signal(twist, "the twist"),
    )
    epsilon = 4 * float(jnp.finfo(dtype).eps)
    tolerances = Tolerances(*(jnp.maximum(as_float(x).astype(dtype), epsilon) for x in (rtol, atol)))
    motion = _simulate(task, start, times.astype(dtype), tolerances, Method(solver, adjoint, max_steps))
    return motion.check() if throw else motion


@eqx.filter_jit
def _simulate(
    task: _Task, start: State, times: Float[Array, " n"], tolerances: Tolerances, method: Method
) -> PoseMotion:
    def field(t: Scalar, state: State, memory: None) -> State:
        quaternion, rate, _, velocity = _split(state)
        epsilon, acceleration = task.commands(t, state)
        if task.twist is not None:
            epsilon = epsilon + pure(at_instant(task.twist, t).astype(state.dtype))
        if task.push is not None:
            acceleration = acceleration + at_instant(task.push, t).astype(state.dtype)
        return jnp.concatenate([derivative(quaternion, rate), epsilon, velocity, acceleration])

    grid = Grid(times[0], times - times[0], jnp.zeros(times.shape, bool))
    states, _, code = ode.march(field, ode.keep, start, None, grid, tolerances, method)

    def columns_at(t: Scalar, state: State) -> dict[str, Array]:
        quaternion, rate, position, velocity = _split(state)
        target, reference = task.reference(t, state)
        epsilon, acceleration = task.commands(t, state)
        program = dual_quaternion.from_pose(target[0], reference.quaternion)
        return {
            "position": position,
            "velocity": velocity,
            "acceleration": acceleration,
            "quaternion": quaternion,
            "rate": rate,
            "command": epsilon,
            "error": pose_error(program, dual_quaternion.from_pose(position, quaternion)),
            "distance": norm(position - target[0]),
            "angle": error_angle(reference, quaternion),
        }

    return PoseMotion(times, code=code, **jax.vmap(columns_at)(times, states))


def _split(state: State) -> tuple[Quat, Quat, Vec3, Vec3]:
    """λ, ω, r and v of a state vector."""
    return state[:4], state[4:8], state[8:11], state[11:]
