"""Control of the gripper of an arm: joints → λ, ω → ε in inertial axes → accelerations of the joints.

Paper C names manipulators with sensors in their joints as the case for commands in inertial axes (remark 1, (2.2)). The
gripper's attitude and rate come from the joints; the law, the inertial error among others, gives ε_ξ; the geometric
Jacobian turns that into q̈. |λ| and ω0 are variables of the computer. Where the arm is not singular the gripper has
the commanded acceleration, so its error satisfies the same linear equation as the error of a free body.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import real_scalar, real_vector
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import common_dtype, output_times
from qtraj.motion.control.errors import error_angle, to_body, to_inertial
from qtraj.motion.control.laws import AbstractLaw, RateLaw
from qtraj.motion.manipulator.arm import Arm
from qtraj.motion.manipulator.arm_motion import ArmMotion
from qtraj.motion.manipulator.inverse import Damping, joint_accelerations, smallest_singular_value
from qtraj.motion.simulation import ode
from qtraj.motion.simulation.ode import MAX_STEPS, Grid, Method, State, Tolerances
from qtraj.path.hodograph import AbstractHodograph


class _Job(eqx.Module):
    """What is simulated; `gains` (2,) are those of the position, k1 and k2."""

    arm: Arm
    program: AbstractProgram
    law: AbstractLaw
    path: AbstractHodograph | None
    gains: Float[Array, 2]
    damping: Damping
    sign: Scalar

    def split(self, state: State) -> tuple[Array, Array, Scalar, Scalar]:
        """q, q̇, ln|λ| and ω0."""
        n = len(self.arm.joints)
        return state[:n], state[n : 2 * n], state[2 * n], state[2 * n + 1]

    def look(self, state: State) -> _Look:
        """The gripper at a state."""
        q, q_dot, log_norm, omega0 = self.split(state)
        (position, attitude, jacobian), (*_, slope) = jax.jvp(self.arm.kinematics, (q,), (q_dot,))
        twist = _matmul(jacobian, q_dot)
        quaternion = self.sign * jnp.exp(log_norm) * attitude
        rate = to_body(quaternion, jnp.concatenate([omega0[None], twist[:3]]))
        return _Look(position, twist[3:], quaternion, rate, jacobian, _matmul(slope, q_dot))

    def reference(self, t: Scalar, state: State) -> Attitude:
        return jax.tree.map(lambda x: x.astype(state.dtype), self.program(t))

    def wanted(self, t: Scalar, reference: Attitude, at: _Look) -> tuple[Scalar, Array]:
        """The virtual part of the law's command, and the wanted acceleration of the gripper: (ε_ξ) or (ε_ξ, a)."""
        command = to_inertial(at.quaternion, self.law(reference, at.quaternion, at.rate))
        if self.path is None:
            return command[0], command[1:]
        r = self.path.derivatives(t, 2).astype(command.dtype)
        feedback = self.gains[0] * (at.velocity - r[1]) + self.gains[1] * (at.position - r[0])
        return command[0], jnp.concatenate([command[1:], r[2] - feedback])

    def accelerations(self, t: Scalar, state: State, at: _Look) -> tuple[Scalar, Array, Array, Array]:
        """ε0, q̈, the missing part of the wanted acceleration, and the rows of the Jacobian."""
        _, q_dot, _, _ = self.split(state)
        virtual, wanted = self.wanted(t, self.reference(t, state), at)
        rows, bias = at.jacobian[: wanted.shape[0]], at.bias[: wanted.shape[0]]
        found = joint_accelerations(rows, wanted - bias, q_dot, self.damping)
        return virtual, found, _matmul(rows, found) + bias - wanted, rows


class _Look(NamedTuple):
    """The gripper: position, velocity, λ and ω_x (4,) in body axes; the Jacobian (6, n) and J̇q̇ (6,)."""

    position: Vec3
    velocity: Vec3
    quaternion: Quat
    rate: Quat
    jacobian: Array
    bias: Array


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
    adjoint: Any = None,
    max_steps: int = MAX_STEPS,
    throw: bool = False,
) -> ArmMotion:
    """The motion of an arm whose gripper follows `program` under `law`, from `joints` (m,) and `joint_rates` (m,).

    Angles [rad] and lengths [m] and their rates [1/s]. `times` (n,) [s]: instants of the program's own time, the first
    is that of the initial state. `path`: a hodograph for the position of the gripper, with `gains` (k1 [1/s],
    k2 [1/s²]) of its error r̈ + k1ṙ + k2r = 0; without one the attitude alone is commanded, by the smallest joint
    accelerations. `damping`: a `Damping`, near singularities. The sign of λ is the one nearer to the program. `rtol`,
    `atol`, `solver`, `adjoint`, `max_steps` and `throw` are those of `integrate`.

    **Raises:** ValueError for parts of another type, other shapes, a law that commands rates or has a memory, too
    few joints, or times that do not increase. RuntimeError with `throw` where an instant was missed.
    """
    count = len(arm.joints) if isinstance(arm, Arm) else 0
    rows = 3 if path is None else 6
    _require_parts(arm, program, law, path, rows)
    times = output_times(times)
    q, q_dot = real_vector(joints, "the joints", count), real_vector(joint_rates, "the joint rates", count)
    dtype = common_dtype(q, q_dot, times)
    k1, k2 = (real_scalar(k, "a gain of the position").astype(dtype) for k in gains)
    damping = Damping() if damping is None else damping
    job = _Job(arm, program, law, path, jnp.stack([k1, k2]), damping, jnp.ones((), dtype))
    start = jnp.concatenate([q, q_dot, jnp.zeros(2, dtype)]).astype(dtype)
    epsilon = 4 * float(jnp.finfo(dtype).eps)
    tolerances = Tolerances(*(jnp.maximum(real_scalar(x, "a tolerance").astype(dtype), epsilon) for x in (rtol, atol)))
    motion = _simulate(job, start, times.astype(dtype), tolerances, Method(solver, adjoint, max_steps))
    return motion.check() if throw else motion


@eqx.filter_jit
def _simulate(job: _Job, start: State, times: Float[Array, " n"], tolerances: Tolerances, method: Method) -> ArmMotion:
    far = jax.lax.stop_gradient(jnp.sum(job.reference(times[0], start).quaternion * job.look(start).quaternion)) < 0
    job = eqx.tree_at(lambda x: x.sign, job, jnp.where(far, -1.0, 1.0).astype(start.dtype))

    def field(t: Scalar, state: State, memory: None) -> State:
        _, q_dot, _, omega0 = job.split(state)
        virtual, q_ddot, _, _ = job.accelerations(t, state, job.look(state))
        return jnp.concatenate([q_dot, q_ddot, jnp.stack([0.5 * omega0, virtual])])

    grid = Grid(times[0], times - times[0], jnp.zeros(times.shape, bool))
    states, _, code = ode.march(field, ode.keep, start, None, grid, tolerances, method)

    def shown(t: Scalar, state: State) -> dict[str, Array]:
        at = job.look(state)
        position, quaternion = at.position, at.quaternion
        _, q_ddot, missed, rows = job.accelerations(t, state, at)
        reference = job.reference(t, state)
        far = {} if job.path is None else {"distance": norm(position - job.path.position(t).astype(state.dtype))}
        q, q_dot, _, _ = job.split(state)
        return far | {
            "joints": q,
            "joint_rates": q_dot,
            "joint_accelerations": q_ddot,
            "position": position,
            "quaternion": quaternion,
            "rate": to_inertial(quaternion, at.rate),
            "error": job.law.deviation(reference, quaternion),
            "angle": error_angle(reference, quaternion),
            "smallest": smallest_singular_value(jnp.where(jnp.isfinite(rows), rows, 0.0)),
            "missed": norm(missed),
        }

    columns = jax.vmap(shown)(times, states)
    reached = jnp.isfinite(states[:, 0])
    columns = {name: jnp.where(reached.reshape(-1, *[1] * (x.ndim - 1)), x, jnp.nan) for name, x in columns.items()}
    return ArmMotion(times, code=code, **columns)


def _require_parts(arm: Any, program: Any, law: Any, path: Any, rows: int) -> None:
    if not isinstance(arm, Arm):
        raise ValueError(f"the arm must be one such as Arm(joints, position) or stanford_arm(), but {arm!r} was given")
    if not isinstance(program, AbstractProgram):
        raise ValueError(f"the program must be one such as FrameProgram(path), but {program!r} was given")
    if not isinstance(law, AbstractLaw) or isinstance(law, RateLaw) or hasattr(law, "half_width"):
        raise ValueError(
            f"the law must give accelerations from the state alone, as AccelerationLaw(2.0, 1.0), not {law!r}"
        )
    if path is not None and not isinstance(path, AbstractHodograph):
        raise ValueError(f"the path of the gripper must be a hodograph such as Curve(position, duration), not {path!r}")
    if len(arm.joints) < rows:
        what = "attitude" if rows == 3 else "attitude and position"
        raise ValueError(f"the {what} of a gripper need at least {rows} joints, but the arm has {len(arm.joints)}")


def _matmul(a: Array, b: Array) -> Array:
    return jnp.matmul(a, b, precision="highest")
