"""What a closed loop did: against its closed form, until it settled, with what commands."""

import math
from typing import Any

import numpy as np

from qtraj.cli.tracking.course import Course
from qtraj.cli.tracking.job import Job
from qtraj.foundation.outcome import ResultCode
from qtraj.motion.control.errors import error_quaternion, error_rate
from qtraj.motion.control.laws import AccelerationLaw, RateLaw
from qtraj.motion.control.quaternion_sign import least_norm
from qtraj.motion.control.response import spectral_abscissa
from qtraj.motion.simulation.sensor import Sensor
from qtraj.motion.simulation.simulate import NEAR

SETTLED = math.radians(1.0)
"""Within this angle [rad] a loop has settled, unless told otherwise."""
REACHED = 1e-9
"""Relative: a command so near to its limit is limited."""
ACCUMULATED = 100
"""The errors of many steps may add up to so many tolerances of one."""
ROUND_OFF, COARSE = 1e-12, 1e-2
"""Relative: the closed form is met within no less than the first, and by no more than the second."""


def findings(job: Job, course: Course, settled: float) -> dict[str, Any]:
    """The figures of a closed loop at all instants of its course, in SI units; None where there is none."""
    times, angle, lengths = course.times, np.asarray(course.solution.angle), np.asarray(course.solution.norm)
    vectors = np.asarray(course.solution.physical_command)
    known = np.isfinite(vectors).all(axis=1)
    reason = _reason(job, course)
    time = float(course.solution.settling_time(settled))
    return {
        "instants": len(times),
        "initial_angle": float(angle[0]),
        "final_angle": float(angle[-1]),
        "settled": {"angle": settled, "time": None if math.isnan(time) else time},
        "peak_command": _peak_command(times[known], vectors[known]),
        "closed_form": _closed_form(job, course, reason),
        "least_error_norm": _least_error(job, course, reason),
        "norm": {
            "start": float(lengths[0]),
            "least": float(np.nanmin(lengths)) if known.any() else None,
            "largest": float(np.nanmax(lengths)) if known.any() else None,
            "drift": _drift(course, lengths, reason),
        },
    }


def _peak_command(times: np.ndarray, commands: np.ndarray) -> dict[str, Any] | None:
    """The greatest length of the command and when, and the greatest magnitude along each body axis."""
    if not len(commands):
        return None
    lengths = np.linalg.norm(commands, axis=1)
    peak = int(np.argmax(lengths))
    along = np.abs(commands).max(axis=0).tolist()
    return {"value": float(lengths[peak]), "time": float(times[peak]), "axes": along}


def outcome(course: Course, found: dict[str, Any]) -> int:
    """The code of the solution, or `near_zero_error` where the closed form tells that between two instants."""
    code, least = int(course.solution.code), found["least_error_norm"]
    first = float(np.asarray(course.solution.norm)[0])
    near = least is not None and least["value"] < NEAR * min(first, 1.0)
    return ResultCode.near_zero_error if near and code == ResultCode.successful else code


def stability(job: Job) -> dict[str, Any]:
    """The largest real part of the closed loop's eigenvalues [1/s], and whether the error decays."""
    fastest = spectral_abscissa(job.law)
    return {"growth": fastest, "stable": fastest < 0}


def _closed_form(job: Job, course: Course, reason: str | None) -> dict[str, Any]:
    """Whether the error is that of the closed form, relative to the largest error (and to 1)."""
    if reason is not None or course.closed is None:
        return {"applies": False, "reason": reason, "met": None, "deviation": None, "bound": None}
    expected = np.asarray(course.closed.error)
    deviation = _largest(np.asarray(course.solution.error) - expected) / max(1.0, _largest(expected))
    bound = min(ROUND_OFF + ACCUMULATED * (job.rtol + job.atol), COARSE)
    return {"applies": True, "reason": None, "met": deviation <= bound, "deviation": deviation, "bound": bound}


def _least_error(job: Job, course: Course, reason: str | None) -> dict[str, Any] | None:
    """The least |μ|, where the command is largest: by the closed form for ever, else at the instants."""
    law, lengths = job.law, np.asarray(course.solution.norm)
    if not isinstance(law, AccelerationLaw | RateLaw) or np.isnan(lengths).all():
        return None
    least = float(np.nanmin(lengths))
    kind = law.error if isinstance(law, AccelerationLaw) else "body"
    if reason is not None or kind == "additive" or spectral_abscissa(law) >= 0:
        return {"value": least, "exact": False}
    start = job.program(course.solution.times[0])
    mu, slope = (error_quaternion(start, job.quaternion, kind), error_rate(start, job.quaternion, job.rate, kind))
    return {"value": min(least, float(least_norm(law, mu, slope))), "exact": True}


def _reason(job: Job, course: Course) -> str | None:
    """What makes the loop differ from its closed form."""
    if course.closed is None:
        return "the closed loop of this law is not linear"
    if job.disturbance is not None:
        return "a disturbance acts on the body"
    if job.renewals is not None:
        return "the command is held between samples"
    if isinstance(job.sensor, Sensor) and (np.any(job.sensor.rate_bias) or np.any(job.sensor.attitude_bias)):
        return "the sensor has a bias"
    if not bool(course.solution.successful):
        return "the integration did not finish"
    if (when := _first_limited(job, course)) is not None:
        return f"the actuator's limit is reached, first at t = {when:.6g} s"
    return None


def _first_limited(job: Job, course: Course) -> float | None:
    if job.actuator is None or job.actuator.limit is None:
        return None
    limit, command = np.asarray(job.actuator.limit), np.asarray(course.solution.physical_command)
    if job.actuator.saturation == "norm":
        command = np.linalg.norm(command, axis=1, keepdims=True)
    limited = (np.abs(command) >= limit * (1 - REACHED)).any(axis=1)
    return float(course.times[np.argmax(limited)]) if limited.any() else None


def _drift(course: Course, lengths: np.ndarray, reason: str | None) -> float | None:
    """How far |λ| comes from what it should be, relative to that: from a constant, or from the closed form."""
    if course.closed is None:
        return _largest((lengths - lengths[0]) / lengths[0])
    if reason is not None:
        return None
    expected = np.linalg.norm(np.asarray(course.closed.quaternion), axis=1)
    return _largest((lengths - expected) / np.maximum(expected, lengths[0]))


def _largest(x: np.ndarray) -> float:
    """The largest length of a row, or magnitude of a number; NaN where one is."""
    return float(np.max(np.linalg.norm(x, axis=1) if x.ndim > 1 else np.abs(x)))
