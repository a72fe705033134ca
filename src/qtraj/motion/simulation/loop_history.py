"""Combine the motion of a simulated closed loop with its program and its closed form."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, as_seconds
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent, times_text
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control.closed_form import ClosedMotion, closed_motion
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.programs.slew_history import attitudes_at
from qtraj.motion.simulation.solution import Solution

INTERVALS = 1200
"""Number of equal time intervals in `judging_times`."""
MULTIPLE = 64
"""The number of `judging_times` is a multiple of this number."""
BEFORE_JUMP = 1e-9
"""Time between a jump and the preceding instant in `judging_times`, as a fraction of the duration."""


class LoopHistory(AbstractResult):
    """The motion of a closed loop at n instants, with the program and the closed form at the same instants.

    `solution`: the `Solution`. `reference`: the attitudes of the program, with fields (n, …). `closed_form`: the motion
    without disturbances in closed form; None for a law without a linear error equation. `open_loop_angle` (n,) [rad]:
    the attitude error angle of the motion without feedback; None if this motion was not simulated. `history[rows]`
    selects instants. The motion of a `RigidBody` also has its torques and wheel momenta.
    """

    solution: Solution
    reference: Attitude
    closed_form: ClosedMotion | None
    open_loop_angle: Float[Array, " n"] | None = None

    @property
    def times(self) -> np.ndarray:
        """The instants [s]."""
        return np.asarray(self.solution.times)

    def record(self) -> Record:
        """Return all variables along `time`.

        The units of virtual rates and commands do not contain rad, because these are derivatives of ln|λ|².
        """
        solution, closed = self.solution, self.closed_form
        per = "s-1" if solution.commands == "rate" else "s-2"
        time, body, component = ("time",), ("time", "body"), ("time", "component")
        rate, command = np.asarray(solution.rate), np.asarray(solution.command)
        variables = {
            "angle": Quantity(solution.angle, "rad", "attitude error angle", time),
            "error": Quantity(solution.error, "1", "error quaternion of the law", component),
            "norm": Quantity(solution.norm, "1", "norm of the quaternion", time),
            "quaternion": Quantity(solution.quaternion, "1", "attitude of the body, not normalised", component),
            "rate": Quantity(rate[:, 1:], "rad s-1", "angular rate of the body, body axes", body),
            "virtual_rate": Quantity(rate[:, 0], "s-1", "virtual rate, d/dt ln|quaternion|²", time),
            "command": Quantity(command[:, 1:], f"rad {per}", "physical command, body axes", body),
            "virtual_command": Quantity(
                command[:, 0], per, "virtual command, which controls the norm of the quaternion", time
            ),
            "program_quaternion": Quantity(self.reference.quaternion, "1", "attitude of the program", component),
            "program_rate": Quantity(self.reference.rate, "rad s-1", "angular rate of the program, program axes", body),
        }
        if closed is not None:
            variables |= {
                "closed_form_angle": Quantity(
                    closed.angle, "rad", "attitude error angle in closed form, without disturbances", time
                ),
                "closed_form_error": Quantity(
                    closed.error, "1", "error quaternion in closed form, without disturbances", component
                ),
            }
        if self.open_loop_angle is not None:
            meaning = "attitude error angle under the acceleration of the program alone, without feedback"
            variables["open_loop_angle"] = Quantity(self.open_loop_angle, "rad", meaning, time)
        if solution.body is not None:
            own = solution.body.variables()
            variables |= {name: own[name] for name in ("torque", "momentum", "mismatch") if name in own}
        summary = f"{times_text(self.times)}: attitude error {extent(solution.angle, 'rad')}"
        times = Quantity(solution.times, "s", "time from the start of the program", time)
        about = {"frame": "body", "rate_convention": "body axes; a virtual rate is d/dt ln|quaternion|²"}
        return Record(summary, variables, {"time": times}, about)

    def at(self, times: ArrayInput) -> LoopHistory:
        """Return the history at `times` [s], which must be instants of this history."""
        return self[np.searchsorted(self.times, np.asarray(times))]

    def __getitem__(self, rows: ArrayInput | slice) -> LoopHistory:
        """Return the history at the selected instants."""
        code = self.solution.code
        return jax.tree.map(lambda values: values if values is code else jnp.asarray(values)[rows], self)


def loop_history(
    program: AbstractProgram,
    law: AbstractLaw,
    quaternion: ArrayInput,
    rate: ArrayInput,
    solution: Solution,
    open_loop: Solution | None = None,
) -> LoopHistory:
    """Combine a `solution` of `simulate` with its program and its closed form.

    `program`, `law`, `quaternion` and `rate` are the arguments of the simulation. `open_loop`: a solution of
    `open_loop` at the same instants, or None.

    **Raises:** ValueError for a solution without commands, or if the program is not defined at one of the instants.
    """
    if solution.command is None or solution.angle is None:
        raise ValueError("a solution of integrate has neither a command nor an error: use simulate for a closed loop")
    references = references_at(program, solution.times)
    closed = None
    if isinstance(law, AccelerationLaw | RateLaw):
        closed = closed_motion(law, references, as_float(quaternion), as_float(rate), solution.times)
    return LoopHistory(solution, references, closed, None if open_loop is None else open_loop.angle)


def references_at(program: AbstractProgram, times: ArrayInput) -> Attitude:
    """Return the attitudes of a program at the instants `times` (n,) [s].

    **Raises:** ValueError if the program is not defined at one of the instants.
    """
    references = attitudes_at(program, as_seconds(times))
    defined = np.isfinite(np.asarray(references.quaternion)).all(axis=1)
    if not defined.all():
        t = float(np.asarray(times)[int(np.argmin(defined))])
        raise ValueError(f"the program is not defined at t = {t:.6g} s: its attitude there is not finite")
    return references


def judging_times(times: np.ndarray, jumps: np.ndarray | None = None, renewals: np.ndarray | None = None) -> np.ndarray:
    """Return instants [s] that are dense enough for `judge_loop`.

    The instants are `times` (from 0 to the duration), the ends of 1200 equal intervals, the instants `renewals` of new
    commands, and both sides of each of the `jumps` of the program. Middles of the largest intervals between them make
    their number a multiple of 64, so that few compiled simulations serve all numbers of jumps and renewals.
    """
    duration, empty = float(times[-1]), np.zeros(0)
    jumps, renewals = (empty if x is None else x for x in (jumps, renewals))
    grid, before_jumps = np.linspace(0.0, duration, INTERVALS + 1), jumps - BEFORE_JUMP * duration
    others = np.concatenate([grid, jumps, before_jumps, renewals])
    found = np.unique(np.concatenate([times, others[(others >= 0) & (others <= duration)]]))
    steps = np.diff(found)
    largest = np.argsort(-steps, kind="stable")[: -found.size % MULTIPLE]
    return np.sort(np.concatenate([found, found[largest] + 0.5 * steps[largest]]))
