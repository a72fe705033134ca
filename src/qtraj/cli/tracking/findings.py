"""What a closed loop did: against its closed form, until it settled, with what commands."""

import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import conjugate, product
from qtraj.algebra.vector import norm
from qtraj.cli.tracking.job import Job
from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_quaternion, error_rate, state_from_error
from qtraj.motion.control.laws import AccelerationLaw, RateLaw
from qtraj.motion.control.response import error_state
from qtraj.motion.simulation.sensor import Sensor
from qtraj.motion.simulation.solution import Solution

SETTLED = math.radians(1.0)
"""Within this angle [rad] a loop has settled, unless told otherwise."""
REACHED = 1e-9
"""Relative: a command so near to its limit is limited."""


@dataclass(frozen=True)
class ClosedForm:
    """The error in closed form at the instants, as if nothing disturbed; `reason` says why it does not apply."""

    error: np.ndarray
    angle: np.ndarray
    norm: np.ndarray
    reason: str | None


def closed_form(job: Job, references: Attitude, solution: Solution) -> ClosedForm | None:
    """The closed form of a loop; None for a law that has none."""
    if not isinstance(job.law, AccelerationLaw | RateLaw):
        return None
    error, angle, length = _closed(job.law, references, job.quaternion, job.rate, jnp.asarray(job.times))
    return ClosedForm(np.asarray(error), np.asarray(angle), np.asarray(length), _effect(job, solution))


def findings(job: Job, solution: Solution, closed: ClosedForm | None, settled: float) -> dict[str, Any]:
    """The figures of a closed loop, in SI units; None where there is none."""
    times, angle = job.times, np.asarray(solution.angle)
    lengths = np.asarray(solution.norm)
    commands = np.linalg.norm(np.asarray(solution.physical_command), axis=1)
    known = np.isfinite(commands)
    peak = int(np.argmax(np.where(known, commands, -1.0)))
    applies = closed is not None and closed.reason is None
    return {
        "initial_angle": float(angle[0]),
        "final_angle": float(angle[-1]),
        "settled": {"angle": settled, "time": settling_time(times, angle, settled)},
        "peak_command": {"value": float(commands[peak]), "time": float(times[peak])} if known.any() else None,
        "closed_form": {
            "applies": applies,
            "reason": "the closed loop of this law is not linear" if closed is None else closed.reason,
            "deviation": _largest(np.asarray(solution.error) - closed.error) if closed and applies else None,
        },
        "norm": {
            "start": float(lengths[0]),
            "least": float(np.nanmin(lengths)) if known.any() else None,
            "largest": float(np.nanmax(lengths)) if known.any() else None,
            "drift": _drift(lengths, closed),
        },
    }


def settling_time(times: np.ndarray, angle: np.ndarray, settled: float) -> float | None:
    """From when on the angle stays within `settled` to the end, by interpolation [s]; None where it does not."""
    outside = np.flatnonzero(~(angle <= settled))
    if not outside.size:
        return float(times[0])
    last = int(outside[-1])
    if last + 1 == len(times) or not np.isfinite(angle[last]):
        return None
    part = (angle[last] - settled) / (angle[last] - angle[last + 1])
    return float(times[last] + part * (times[last + 1] - times[last]))


def _effect(job: Job, solution: Solution) -> str | None:
    """What makes the loop differ from its closed form."""
    if job.disturbance is not None:
        return "a disturbance acts on the body"
    samplings = [p.sampling for p in (job.sensor, job.actuator) if p is not None and p.sampling is not None]
    if samplings:
        return "the command is held between samples"
    if isinstance(job.sensor, Sensor) and (np.any(job.sensor.rate_bias) or np.any(job.sensor.attitude_bias)):
        return "the sensor has a bias"
    if not bool(solution.successful):
        return "the integration did not finish"
    if (when := _first_limited(job, solution)) is not None:
        return f"the actuator's limit is reached, first at t = {when:.6g} s"
    return None


def _first_limited(job: Job, solution: Solution) -> float | None:
    if job.actuator is None or job.actuator.limit is None:
        return None
    limit, command = np.asarray(job.actuator.limit), np.asarray(solution.physical_command)
    if job.actuator.saturation == "norm":
        command = np.linalg.norm(command, axis=1, keepdims=True)
    limited = (np.abs(command) >= limit * (1 - REACHED)).any(axis=1)
    return float(job.times[np.argmax(limited)]) if limited.any() else None


def _drift(lengths: np.ndarray, closed: ClosedForm | None) -> float | None:
    """How far |λ| comes from what it should be, relative to its start: from a constant, or from the closed form."""
    if closed is not None and closed.reason is not None:
        return None
    return _largest((lengths - (lengths[0] if closed is None else closed.norm)) / lengths[0])


def _largest(x: np.ndarray) -> float:
    """The largest length of a row, or magnitude of a number; NaN where one is."""
    return float(np.max(np.linalg.norm(x, axis=1) if x.ndim > 1 else np.abs(x)))


@eqx.filter_jit
def _closed(
    law: AccelerationLaw | RateLaw, references: Attitude, quaternion: Quat, rate: Quat, times: Float[Array, " n"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"], Float[Array, " n"]]:
    kind = law.error if isinstance(law, AccelerationLaw) else "body"
    first = jax.tree.map(lambda x: x[0], references)
    start = error_quaternion(first, quaternion, kind)
    start_rate = error_rate(first, quaternion, rate, kind)

    def at(reference: Attitude, t: Scalar) -> tuple[Quat, Scalar, Scalar]:
        error, slope = error_state(law, start, start_rate, t)
        reached, _ = state_from_error(reference, error, slope, kind)
        mu = product(conjugate(reference.quaternion), reached)
        return error, 2 * jnp.arctan2(norm(mu[1:]), jnp.abs(mu[0])), norm(reached)

    return jax.vmap(at)(references, times)
