"""Simulate open-loop control by the acceleration ε⁰ of a program (paper C, (1.5), (1.6), (3.14), (3.15)).

If the body starts with the attitude and rate of the program, it follows the program. Errors are not corrected: an
attitude error remains, a rate error increases the attitude error with time, and a disturbance is integrated twice. For
control with feedback, use `simulate`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.foundation.arrays import real_vector
from qtraj.foundation.namespace import in_numpy, xp
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import output_times, require_axes
from qtraj.motion.control.errors import body_errors_at, pure, to_body
from qtraj.motion.simulation.disturbance import AbstractDisturbance, DisturbanceAcceleration
from qtraj.motion.simulation.initial_sign import NEARER, require_sign, start_quaternion
from qtraj.motion.simulation.interval import MAX_STEPS
from qtraj.motion.simulation.kinematics import integrate
from qtraj.motion.simulation.solution import Solution
from qtraj.motion.simulation.task import switches_of


def open_loop(
    program: AbstractProgram,
    times: ArrayInput,
    quaternion: ArrayInput | None = None,
    rate: ArrayInput | None = None,
    axes: str = "body",
    disturbance: AbstractDisturbance | Callable[..., Any] | None = None,
    solver: Any = None,
    rtol: ArrayInput = 1e-10,
    atol: ArrayInput = 1e-12,
    *,
    sign: str = NEARER,
    jumps: ArrayInput | None = None,
    adjoint: Any = None,
    max_steps: int = MAX_STEPS,
    throw: bool = False,
) -> Solution:
    """Simulate a body under ω̇ = ε⁰(t), the acceleration of `program`, without feedback.

    `times` (n,) [s]: increasing instants, measured from the start of the program. `quaternion` (4,) and `rate` (4,)
    [rad/s]: the state at times[0]; None for the state of the program. `axes`, "body" or "inertial": the axes in which
    the components of ε⁰ are applied, and the axes of the initial and the resulting rate. The motion depends on `axes`
    if the attitude of the body differs from the attitude of the program. `disturbance` (in body axes) and `sign` are as
    in `simulate`. `jumps` [s]: with None, the `switches` of the program are used, if it has this property. All other
    arguments are as in `integrate`.

    In the solution, `command` is ε⁰ in body axes, `error` is the body error μ, and `angle` is the attitude error angle.

    **Raises:** ValueError in the same cases as `integrate`, for a `program` of another type, and for a `sign` other
    than "nearer" or "as given". RuntimeError if `throw` is true and an instant was not reached.
    """
    require_axes(axes)
    require_sign(sign)
    if not isinstance(program, AbstractProgram):
        raise ValueError(
            f"the program must be an attitude program such as FrameProgram(path), but {program!r} was given"
        )
    if disturbance is not None and not isinstance(disturbance, AbstractDisturbance):
        disturbance = DisturbanceAcceleration(disturbance)
    times = output_times(times)
    first = program.at(times[0], axes)
    start = first.quaternion if quaternion is None else real_vector(quaternion, "the initial quaternion", 4)
    start = start_quaternion(sign, first, start)
    rate = pure(first.rate) if rate is None else rate
    source = ProgramAcceleration(program.prepared(), disturbance, axes)
    if jumps is None:
        jumps = switches_of(program)
    solution = integrate(
        source, start, rate, times, axes, solver, rtol, atol, jumps=jumps, adjoint=adjoint, max_steps=max_steps
    )
    solution = _with_errors(source, solution)
    return solution.check() if throw else solution


class ProgramAcceleration(eqx.Module):
    """The acceleration of a program plus a disturbance, as a function for `integrate`."""

    program: AbstractProgram
    disturbance: AbstractDisturbance | None
    axes: str = eqx.field(static=True)

    def __call__(self, t: Scalar, quaternion: Quat, rate: Quat) -> Quat:
        """Return ε (4,) [rad/s²], including the disturbance, in `axes`."""
        epsilon = self._acceleration(t, quaternion)
        if self.disturbance is None:
            return pure(epsilon)
        body_rate = rate if self.axes == "body" else to_body(quaternion, rate)
        disturbance = self.disturbance.acceleration(t, quaternion, body_rate[1:]).astype(quaternion.dtype)
        return pure(epsilon + (disturbance if self.axes == "body" else rotate(quaternion, disturbance)))

    def command(self, t: Scalar, quaternion: Quat) -> Quat:
        """Return ε⁰ (4,) [rad/s²] in body axes."""
        epsilon = self._acceleration(t, quaternion)
        return pure(epsilon if self.axes == "body" else rotate(conjugate(quaternion), epsilon))

    def _acceleration(self, t: Scalar, quaternion: Quat) -> Vec3:
        return self.program.at(t, self.axes).acceleration.astype(quaternion.dtype)


@eqx.filter_jit
def _outputs(source: ProgramAcceleration, solution: Solution) -> tuple[Attitude, Float[Array, "n 4"]]:
    """Return the attitudes of the program and the commands, at the instants of the solution."""

    def at(x: tuple[Scalar, Quat]) -> tuple[Attitude, Quat]:
        t, quaternion = x
        reference = jax.tree.map(lambda x: x.astype(t.dtype), source.program(t))
        return reference, source.command(t, quaternion)

    return jax.lax.map(at, (solution.times, solution.quaternion))


def _with_errors(source: ProgramAcceleration, solution: Solution) -> Solution:
    """Return the solution with commands, errors and angles."""
    s = solution
    references, commands = _outputs(source, solution)
    errors, angles = body_errors_at(references, s.quaternion)
    commands = _where_reached(s.quaternion, commands)
    return Solution(s.times, s.quaternion, s.rate, s.code, commands, errors, angles, s.axes)


@in_numpy
def _where_reached(quaternions: Float[Array, "n 4"], values: Float[Array, "n 4"]) -> Float[Array, "n 4"]:
    return xp.where(xp.isfinite(quaternions[:, :1]), values, xp.nan)
