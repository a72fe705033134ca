"""A closed loop solved at enough instants to judge it by, whatever the table asks for."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from qtraj.cli.tracking.job import Job
from qtraj.cli.turning.course import program_attitudes
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.closed_form import ClosedMotion, closed_motion
from qtraj.motion.control.laws import AccelerationLaw, RateLaw
from qtraj.motion.simulation.simulate import simulate
from qtraj.motion.simulation.solution import Solution

FINE = 1200
"""Equal intervals at whose ends a loop is judged; besides, at every renewal of the command and beside every jump."""
SIDE = 1e-9
"""Of the duration: how far before a jump its earlier side is looked at."""


@dataclass(frozen=True)
class Course:
    """The motion at all instants that were solved for, the program there, and which rows are those of the table.

    `closed` is the motion if nothing disturbed it; None for a law without a closed form.
    """

    solution: Solution
    references: Attitude
    table: np.ndarray
    closed: ClosedMotion | None

    @property
    def times(self) -> np.ndarray:
        """The instants [s]."""
        return np.asarray(self.solution.times)

    def tabulated(self) -> Solution:
        """The motion at the instants of the table."""
        s, rows = self.solution, self.table
        parts = (s.times, s.quaternion, s.rate, s.command, s.error, s.angle)
        times, quaternion, rate, command, error, angle = (None if x is None else np.asarray(x)[rows] for x in parts)
        if times is None or quaternion is None or rate is None:
            raise ValueError("a motion without attitudes has no table")
        return Solution(times, quaternion, rate, s.code, command, error, angle)


def solve(job: Job) -> Course:
    """The motion of a closed loop.

    **Raises:** ValueError for a program without an attitude at one of the instants.
    """
    times = _instants(job)
    references = program_attitudes(job.program, jnp.asarray(times))
    good = np.isfinite(np.asarray(references.quaternion)).all(axis=1)
    if not good.all():
        raise ValueError(f"[program]: there is no attitude at t = {times[int(np.argmin(good))]:.6g} s")
    solution = simulate(
        job.program,
        job.law,
        job.quaternion,
        job.rate,
        times,
        job.disturbance,
        job.sensor,
        job.actuator,
        rtol=job.rtol,
        atol=job.atol,
        sign="as given",  # `place` has chosen it, as the scenario asks
        jumps=job.jumps,
    )
    closed = None
    if isinstance(job.law, AccelerationLaw | RateLaw):
        closed = closed_motion(job.law, references, job.quaternion, job.rate, jnp.asarray(times))
    return Course(solution, references, np.searchsorted(times, job.times), closed)


def _instants(job: Job) -> np.ndarray:
    """The instants to solve for [s], those of the table among them."""
    duration = float(job.times[-1])
    jumps, renewals = (np.zeros(0) if x is None else x for x in (job.jumps, job.renewals))
    others = np.concatenate([np.linspace(0.0, duration, FINE + 1), jumps, jumps - SIDE * duration, renewals])
    return np.unique(np.concatenate([job.times, others[(others >= 0) & (others <= duration)]]))
