"""Simulate a body whose position and attitude follow a program under a law."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.algebra import dual_quaternion
from qtraj.algebra.quaternion import derivative
from qtraj.algebra.vector import norm
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_angle, pure
from qtraj.motion.pose.pose_law import PoseLaw, PoseProgram, initial_state, pose_error
from qtraj.motion.pose.pose_motion import PoseMotion
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.initial_sign import NEARER
from qtraj.motion.simulation.interval import MAX_STEPS, Method, State, Tolerances
from qtraj.motion.simulation.ode import Grid
from qtraj.motion.simulation.signals import Signal, at_instant, checked_signal
from qtraj.motion.simulation.task import checked_jumps, checked_tolerances, merged_grid, switches_of, within


class _Task(eqx.Module):
    """The arguments of a simulation.

    `push` [m/s²], inertial axes, is the disturbance of the linear acceleration. `twist` [rad/s²], body axes, is the
    disturbance of the angular acceleration.
    """

    program: PoseProgram
    law: PoseLaw
    push: Signal | None
    twist: Signal | None

    def reference(self, t: Scalar, state: State) -> tuple[Array, Attitude]:
        """Return position, velocity and acceleration (3, 3), and the attitude, of the program at `t` [s]."""
        return jax.tree.map(lambda x: x.astype(state.dtype), self.program(t))

    def commands(self, t: Scalar, state: State) -> tuple[Quat, Vec3]:
        """Return the commands ε (4,) [rad/s²] in body axes and a (3,) [m/s²] in inertial axes."""
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
    jumps: ArrayInput | None = None,
    adjoint: Any = None,
    max_steps: int = MAX_STEPS,
    throw: bool = False,
) -> PoseMotion:
    """Simulate a body whose position and attitude follow `program` under `law`.

    `times` (n,) [s] are measured from the start of the program. The initial state, at times[0], consists of `position`
    (3,) [m] and `velocity` (3,) [m/s], inertial axes, `quaternion` (4,), and `rate` (4,) [rad/s], body axes, with the
    virtual rate first. The disturbances `push`, an acceleration [m/s²] in inertial axes, and `twist`, an angular
    acceleration [rad/s²] in body axes, are each a constant (3,) or a function of time. `sign` is as in `simulate`.
    `jumps` [s]: as in `integrate`; with None, the `switches` of the attitude program and the knots of a route are used.
    `solver`, `rtol`, `atol`, `adjoint`, `max_steps` and `throw` are as in `integrate`.

    **Raises:** ValueError for arguments of another type or shape, a `sign` other than "nearer" or "as given", or
    times that do not increase. RuntimeError if `throw` is true and an instant was not reached.
    """
    times, start = initial_state(program, law, (position, velocity, quaternion, rate), times, sign)
    jumps = switches_of(program.attitude, program.path) if jumps is None else checked_jumps(jumps)
    jumps = None if jumps is None else within(times, jumps.astype(times.dtype))
    task = _Task(
        PoseProgram(program.path, program.attitude.prepared()),
        law,
        None if push is None else checked_signal(push, "the push"),
        None if twist is None else checked_signal(twist, "the twist"),
    )
    tolerances = checked_tolerances(rtol, atol, times.dtype)
    grid, outputs = merged_grid(times, jumps)
    motion = _simulate(task, start, times, grid, outputs, tolerances, Method(solver, adjoint, max_steps))
    return motion.check() if throw else motion


@eqx.filter_jit
def _simulate(
    task: _Task,
    start: State,
    times: Float[Array, " n"],
    grid: Grid,
    outputs: Int[Array, " n"],
    tolerances: Tolerances,
    method: Method,
) -> PoseMotion:
    def field(t: Scalar, state: State, memory: None) -> State:
        quaternion, rate, _, velocity = _split(state)
        epsilon, acceleration = task.commands(t, state)
        if task.twist is not None:
            epsilon = epsilon + pure(at_instant(task.twist, t).astype(state.dtype))
        if task.push is not None:
            acceleration = acceleration + at_instant(task.push, t).astype(state.dtype)
        return jnp.concatenate([derivative(quaternion, rate), epsilon, velocity, acceleration])

    states, _, code = ode.march(field, ode.keep, start, None, grid, tolerances, method)
    states = states[outputs]

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

    return PoseMotion(times, code=code, **jax.lax.map(lambda x: columns_at(*x), (times, states)))


def _split(state: State) -> tuple[Quat, Quat, Vec3, Vec3]:
    """Return λ, ω in body axes, and r and v in inertial axes, of a state vector."""
    return state[:4], state[4:8], state[8:11], state[11:]
