"""What `qtraj track` has to say, as plain data: the JSON output, and what the tables on the terminal are made from."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj._version import __version__
from qtraj.cli.content import finite, scenario_content
from qtraj.cli.tracking.course import Course
from qtraj.cli.tracking.findings import SETTLED, findings, outcome, stability
from qtraj.cli.tracking.job import Job
from qtraj.cli.tracking.program import described
from qtraj.foundation.outcome import ResultCode
from qtraj.io.attitude_part import radians
from qtraj.io.instants import Column
from qtraj.io.scenario import ScenarioFile
from qtraj.io.tracking_model import TrackingScenario
from qtraj.motion.control.laws import RateLaw

ENDINGS = {
    ResultCode.successful: "finished: every instant was reached.",
    ResultCode.max_steps_reached: (
        "stopped: too many steps between two instants. Take smaller gains, larger simulation.rtol and simulation.atol, "
        "or a shorter simulation.duration."
    ),
    ResultCode.step_too_small: (
        "stopped: the step fell to round-off, since the command grows without bound there or the tolerances are too "
        "fine. Take another [error], smaller gains, or larger simulation.rtol and simulation.atol."
    ),
    ResultCode.near_zero_error: "finished, but the error quaternion came near zero, where the command grows as 1/|μ|².",
    ResultCode.wrong_sign: (
        "stopped: the error quaternion started with a negative scalar part (μ0 < 0) and ran into zero, where the law "
        "has no command."
    ),
}
"""How an integration ended, and what to do, in terms of the scenario."""

OTHER_SIGN = "λ and −λ are one attitude: sign = 'auto' in [error] takes the one that passes more smoothly."
NO_SIGN = (
    "Neither sign of λ passes more smoothly: take a smaller error.rate, other gains, or a law of the kind "
    "'quaternion', which looks at the attitude alone."
)


def track_content(
    given: ScenarioFile[TrackingScenario], job: Job, course: Course, columns: Mapping[str, Column]
) -> dict[str, Any]:
    """The whole outcome, of JSON's types only; angles in radians."""
    scenario = given.scenario
    settled = scenario.simulation.settled
    limit = None if job.actuator is None or job.actuator.limit is None else np.asarray(job.actuator.limit).tolist()
    found = findings(job, course, SETTLED if settled is None else radians(scenario.angles) * settled)
    content = {
        "qtraj": __version__,
        "command": "track",
        "scenario": scenario_content(given),
        "program": {"description": described(scenario.program, job.program), "duration": float(job.program.duration)},
        "law": {"kind": scenario.law.kind, "command": command_unit(job)} | _gains(job) | stability(job),
        "start": {
            "quaternion": np.asarray(job.quaternion).tolist(),
            "rate": np.asarray(job.rate).tolist(),
            "sheet": "far" if job.flipped else "near",
        },
        "duration": float(job.times[-1]),
        "command_limit": limit,
        "saturation": None if limit is None or job.actuator is None else job.actuator.saturation,
        "findings": found,
        "finished": bool(course.solution.successful),
        "result": _result(course, outcome(course, found), scenario.error.sign),
        "units": {"time": "s"} | {name: column.unit for name, column in columns.items()},
        "columns": {"time": job.times.tolist()} | {name: column.values.tolist() for name, column in columns.items()},
        "files": [],
    }
    return finite(content)


def track_columns(job: Job, course: Course) -> dict[str, Column]:
    """Everything over the instants of the table. The virtual parts, of d/dt ln|λ|², have no radians."""
    solution, rows = course.tabulated(), course.table
    per = "s-1" if isinstance(job.law, RateLaw) else "s-2"
    rate, command = np.asarray(solution.rate), np.asarray(solution.command)
    columns = {
        "angle": Column(np.asarray(solution.angle), "rad", "angle between body and program"),
        "error": Column(np.asarray(solution.error), "1", "error quaternion of the law", "component"),
        "norm": Column(np.asarray(solution.norm), "1", "length of the quaternion"),
        "quaternion": Column(np.asarray(solution.quaternion), "1", "attitude of the body, of any length", "component"),
        "rate": Column(rate[:, 1:], "rad s-1", "rate of the body, its own axes", "body"),
        "virtual_rate": Column(rate[:, 0], "s-1", "virtual rate, d/dt ln|quaternion|²"),
        "command": Column(command[:, 1:], f"rad {per}", "physical command, body axes", "body"),
        "virtual_command": Column(command[:, 0], per, "virtual command, which steers the length of the quaternion"),
        "program_quaternion": Column(
            np.asarray(course.references.quaternion)[rows], "1", "attitude of the program", "component"
        ),
        "program_rate": Column(
            np.asarray(course.references.rate)[rows], "rad s-1", "rate of the program, its own axes", "body"
        ),
    }
    if course.closed is not None:
        angle, error = np.asarray(course.closed.angle)[rows], np.asarray(course.closed.error)[rows]
        columns["closed_form_angle"] = Column(angle, "rad", "angle in closed form, undisturbed")
        columns["closed_form_error"] = Column(error, "1", "error quaternion in closed form, undisturbed", "component")
    return columns


def command_unit(job: Job) -> str:
    """Of the law's physical command."""
    return "rad/s" if isinstance(job.law, RateLaw) else "rad/s²"


def _result(course: Course, code: int, sign: str) -> str:
    """How the integration ended, and what to do."""
    text = ENDINGS.get(ResultCode(code), ResultCode(code).text)
    if code in (ResultCode.near_zero_error, ResultCode.wrong_sign):
        text = f"{text} {NO_SIGN if sign == 'auto' else OTHER_SIGN}"
    reached = course.times[np.isfinite(np.asarray(course.solution.quaternion)).all(axis=1)]
    if len(reached) == len(course.times):
        return text
    last = f"Last instant reached: t = {reached[-1]:.9g} s." if len(reached) else "No instant was reached."
    return f"{text} {last}"


def _gains(job: Job) -> dict[str, Any]:
    names = ("k",) if isinstance(job.law, RateLaw) else ("k1", "k2")
    return {name: np.asarray(getattr(job.law, name)).tolist() for name in names}
