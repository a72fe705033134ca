"""Simulate an arm whose gripper follows an attitude program, and optionally a path, under a law.

Paper C (remark 1, (2.2)) recommends commands in inertial axes for manipulators with sensors in their joints. The joints
determine the attitude and the rate of the gripper. The law computes its angular acceleration ε_ξ in inertial axes, and
the geometric Jacobian converts ε_ξ to joint accelerations q̈. The norm |λ| and the virtual rate ω0 = d/dt ln|λ|² are not
measured: they are variables of the control computer. Away from singularities, the gripper has the commanded
acceleration, so the error of the gripper satisfies the same linear equation as the error of a free body.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import real_scalar, real_vector, require_positive
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import common_dtype, output_times
from qtraj.motion.control.errors import error_angle, to_body, to_inertial
from qtraj.motion.control.hysteresis import require_continuous_law
from qtraj.motion.control.laws import AbstractLaw, commanded
from qtraj.motion.manipulator.arm import Arm
from qtraj.motion.manipulator.arm_motion import ArmMotion
from qtraj.motion.manipulator.inverse import Damping, joint_accelerations, smallest_singular_value
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.interval import MAX_STEPS, Method, State, Tolerances
from qtraj.motion.simulation.ode import Grid
from qtraj.motion.simulation.task import checked_jumps, checked_tolerances, merged_grid, switches_of, within
from qtraj.path.hodograph import AbstractHodograph, require_path


class _Task(eqx.Module):
    """The arguments of a simulation.

    `gains` (2,) are k1 and k2 of the position feedback. `sign` is +1 or −1: λ/|λ| is `sign` times the quaternion that
    `Arm.pose` returns.
    """

    arm: Arm
    program: AbstractProgram
    law: AbstractLaw
    path: AbstractHodograph | None
    gains: Float[Array, 2]
    damping: Damping
    sign: Scalar

    def split(self, state: State) -> tuple[Array, Array, Scalar, Scalar]:
        """Return the joint values q, the joint rates q̇, ln|λ| and ω0 of a state vector."""
        n = len(self.arm.joints)
        return state[:n], state[n : 2 * n], state[2 * n], state[2 * n + 1]

    def gripper(self, state: State) -> _Gripper:
        """Return the motion of the gripper for a state vector."""
        q, q_dot, log_norm, omega0 = self.split(state)
        (position, attitude, jacobian), (*_, jacobian_rate) = jax.jvp(self.arm.kinematics, (q,), (q_dot,))
        rates = _matmul(jacobian, q_dot)
        quaternion = self.sign * jnp.exp(log_norm) * attitude
        rate = to_body(quaternion, jnp.concatenate([omega0[None], rates[:3]]))
        return _Gripper(position, rates[3:], quaternion, rate, jacobian, _matmul(jacobian_rate, q_dot))

    def reference(self, t: Scalar, state: State) -> Attitude:
        """Return the attitude of the program in the dtype of `state`."""
        return jax.tree.map(lambda x: x.astype(state.dtype), self.program(t))

    def command(self, t: Scalar, state: State, gripper: _Gripper) -> tuple[Scalar, Array]:
        """Return the virtual command ε0, and the commanded acceleration of the gripper in inertial axes.

        The acceleration is ε_ξ (3,) [rad/s²]. With a path, it is (ε_ξ, a) (6,) with the linear acceleration a [m/s²].
        """
        reference, quaternion = self.reference(t, state), gripper.quaternion
        command = to_inertial(quaternion, commanded(self.law, None, reference, quaternion, gripper.rate))
        if self.path is None:
            return command[0], command[1:]
        r = self.path.derivatives(t, 2).astype(command.dtype)
        feedback = self.gains[0] * (gripper.velocity - r[1]) + self.gains[1] * (gripper.position - r[0])
        return command[0], jnp.concatenate([command[1:], r[2] - feedback])

    def accelerations(self, t: Scalar, state: State, gripper: _Gripper) -> tuple[Scalar, Array, Array, Array]:
        """Return ε0, q̈, the deviation of the gripper's acceleration from the command, and the controlled rows of J."""
        _, q_dot, _, _ = self.split(state)
        virtual, command = self.command(t, state, gripper)
        rows, bias = gripper.jacobian[: command.shape[0]], gripper.bias[: command.shape[0]]
        q_ddot = joint_accelerations(rows, command - bias, q_dot, self.damping)
        return virtual, q_ddot, _matmul(rows, q_ddot) + bias - command, rows


class _Gripper(NamedTuple):
    """The motion of the gripper: position, velocity, λ, the rate ω_x (4,), the Jacobian J (6, n) and the bias J̇q̇ (6,).

    The rate is in body axes; position, velocity, Jacobian and bias are in inertial axes.
    """

    position: Vec3
    velocity: Vec3
    quaternion: Quat
    rate: Quat
    jacobian: Array
    bias: Array


@on_one_device
def simulate_arm(
    arm: Arm,
    program: AbstractProgram,
    law: AbstractLaw,
    joints: ArrayInput,
    joint_rates: ArrayInput,
    times: ArrayInput,
    path: AbstractHodograph | None = None,
    gains: tuple[ArrayInput, ArrayInput] = (2.0, 1.0),
    damping: Damping | None = None,
    solver: Any = None,
    rtol: ArrayInput = 1e-10,
    atol: ArrayInput = 1e-12,
    *,
    jumps: ArrayInput | None = None,
    adjoint: Any = None,
    max_steps: int = MAX_STEPS,
    throw: bool = False,
) -> ArmMotion:
    """Simulate an arm whose gripper follows `program` under `law`, from `joints` (m,) and `joint_rates` (m,).

    Joint values are angles [rad] or lengths [m]. `times` (n,) [s] are measured from the start of the program; `joints`
    and `joint_rates` are the state at times[0]. `path`: the path of the gripper's position, or None to control only the
    attitude. `gains`: k1 [1/s] and k2 [1/s²] of the position feedback, with which the position error e (gripper minus
    path) satisfies ë + k1ė + k2e = 0. `damping`: the `Damping` near singularities, `Damping()` for None. Of λ and −λ,
    the simulation starts with the quaternion that is nearer to the program. `jumps` [s]: as in `integrate`; with None,
    the `switches` of the program and the knots of a route are used. `rtol`, `atol`, `solver`, `adjoint`, `max_steps`
    and `throw` are as in `integrate`.

    **Raises:** ValueError for arguments of another type or shape, a law that commands rates or has a discrete state, an
    arm with fewer than three joints (six with a path), or times that do not increase. RuntimeError if `throw` is true
    and an instant was not reached.
    """
    count = len(arm.joints) if isinstance(arm, Arm) else 0
    rows = 3 if path is None else 6
    _require_parts(arm, program, law, path, rows)
    times = output_times(times)
    q, q_dot = real_vector(joints, "the joints", count), real_vector(joint_rates, "the joint rates", count)
    dtype = common_dtype(q, q_dot, times)
    k1, k2 = (k.astype(dtype) for k in _gains(gains))
    damping = Damping() if damping is None else damping
    task = _Task(arm, program.prepared(), law, path, jnp.stack([k1, k2]), damping, jnp.ones((), dtype))
    start = jnp.concatenate([q, q_dot, jnp.zeros(2, dtype)]).astype(dtype)
    times, tolerances = times.astype(dtype), checked_tolerances(rtol, atol, dtype)
    jumps = switches_of(program, path) if jumps is None else checked_jumps(jumps)
    jumps = None if jumps is None else within(times, jumps.astype(dtype))
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
) -> ArmMotion:
    alignment = jnp.sum(task.reference(times[0], start).quaternion * task.gripper(start).quaternion)
    sign = jnp.where(jax.lax.stop_gradient(alignment) < 0, -1.0, 1.0).astype(start.dtype)
    task = eqx.tree_at(lambda x: x.sign, task, sign)

    def field(t: Scalar, state: State, memory: None) -> State:
        _, q_dot, _, omega0 = task.split(state)
        virtual, q_ddot, _, _ = task.accelerations(t, state, task.gripper(state))
        return jnp.concatenate([q_dot, q_ddot, jnp.stack([0.5 * omega0, virtual])])

    states, _, code = ode.march(field, ode.keep, start, None, grid, tolerances, method)
    states = states[outputs]

    def columns_at(t: Scalar, state: State) -> dict[str, Array]:
        gripper = task.gripper(state)
        position, quaternion = gripper.position, gripper.quaternion
        _, q_ddot, deficit, rows = task.accelerations(t, state, gripper)
        reference = task.reference(t, state)
        q, q_dot, _, _ = task.split(state)
        columns = {}
        if task.path is not None:
            columns["distance"] = norm(position - task.path.position(t).astype(state.dtype))
            columns["acceleration_error"] = norm(deficit[3:])
        return columns | {
            "joints": q,
            "joint_rates": q_dot,
            "joint_accelerations": q_ddot,
            "position": position,
            "quaternion": quaternion,
            "rate": to_inertial(quaternion, gripper.rate),
            "error": task.law.deviation(reference, quaternion),
            "angle": error_angle(reference, quaternion),
            "smallest_singular_value": smallest_singular_value(jnp.where(jnp.isfinite(rows), rows, 0.0)),
            "angular_acceleration_error": norm(deficit[:3]),
        }

    columns = jax.lax.map(lambda x: columns_at(*x), (times, states))
    reached = jnp.isfinite(states[:, 0])
    columns = {name: jnp.where(reached.reshape(-1, *[1] * (x.ndim - 1)), x, jnp.nan) for name, x in columns.items()}
    return ArmMotion(times, code=code, **columns)


def _gains(gains: Any) -> tuple[Scalar, Scalar]:
    """Return the gains k1 and k2 of the position feedback as scalars; raise a ValueError unless both are positive."""
    try:
        k1, k2 = gains
    except (TypeError, ValueError) as error:
        raise ValueError(f"gains must be two numbers, (k1, k2) [1/s, 1/s²], but {gains!r} was given") from error
    scalars = real_scalar(k1, "the position gain k1"), real_scalar(k2, "the position gain k2")
    for name, k in zip(("k1", "k2"), scalars, strict=True):
        require_positive(k, f"the position gain {name}", "1/s" if name == "k1" else "1/s²")
    return scalars


def _require_parts(arm: Any, program: Any, law: Any, path: Any, rows: int) -> None:
    if not isinstance(arm, Arm):
        raise ValueError(f"the arm must be an Arm such as stanford_arm(), but {arm!r} was given")
    if not isinstance(program, AbstractProgram):
        raise ValueError(
            f"the program must be an attitude program such as FrameProgram(path), but {program!r} was given"
        )
    require_continuous_law(law, "the law")
    if path is not None:
        require_path(path)
    if len(arm.joints) < rows:
        controlled = "attitude" if rows == 3 else "attitude and position"
        raise ValueError(
            f"control of the gripper's {controlled} needs at least {rows} joints, but the arm has {len(arm.joints)}"
        )


def _matmul(a: Array, b: Array) -> Array:
    return jnp.matmul(a, b, precision="highest")
