"""What `qtraj track` has to say, as plain data: the JSON output, and what the tables on the terminal are made from."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj._version import __version__
from qtraj.cli.content import finite, scenario_content
from qtraj.cli.tracking.findings import SETTLED, ClosedForm, findings
from qtraj.cli.tracking.job import Job
from qtraj.cli.tracking.program import described
from qtraj.io.attitude_part import radians
from qtraj.io.instants import Column
from qtraj.io.scenario import ScenarioFile
from qtraj.io.tracking_model import TrackingScenario
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.laws import RateLaw
from qtraj.motion.simulation.solution import FAR_SHEET, NEAR_ZERO, Solution


def track_content(
    given: ScenarioFile[TrackingScenario],
    job: Job,
    solution: Solution,
    closed: ClosedForm | None,
    columns: Mapping[str, Column],
) -> dict[str, Any]:
    """The whole outcome, of JSON's types only; angles in radians."""
    scenario = given.scenario
    settled = scenario.simulation.settled
    limit = None if job.actuator is None or job.actuator.limit is None else np.asarray(job.actuator.limit).tolist()
    content = {
        "qtraj": __version__,
        "command": "track",
        "scenario": scenario_content(given),
        "program": {"description": described(scenario.program, job.program), "duration": float(job.program.duration)},
        "law": {"kind": scenario.law.kind, "command": command_unit(job)} | _gains(job),
        "start": {
            "quaternion": np.asarray(job.quaternion).tolist(),
            "rate": np.asarray(job.rate).tolist(),
            "sheet": "far" if job.flipped else "near",
        },
        "duration": float(job.times[-1]),
        "command_limit": limit,
        "findings": findings(job, solution, closed, SETTLED if settled is None else radians(scenario.angles) * settled),
        "finished": bool(solution.successful),
        "result": _result(solution),
        "units": {"time": "s"} | {name: column.unit for name, column in columns.items()},
        "columns": {"time": job.times.tolist()} | {name: column.values.tolist() for name, column in columns.items()},
        "files": [],
    }
    return finite(content)


def track_columns(job: Job, references: Attitude, solution: Solution, closed: ClosedForm | None) -> dict[str, Column]:
    """Everything over the instants."""
    unit = command_unit(job).replace("/s²", " s-2").replace("/s", " s-1")
    columns = {
        "angle": Column(np.asarray(solution.angle), "rad", "angle between body and program"),
        "error": Column(np.asarray(solution.error), "1", "error quaternion of the law", "component"),
        "norm": Column(np.asarray(solution.norm), "1", "length of the quaternion"),
        "quaternion": Column(np.asarray(solution.quaternion), "1", "attitude of the body, of any length", "component"),
        "rate": Column(np.asarray(solution.rate), "rad s-1", "rate of the body, the virtual one first", "component"),
        "command": Column(np.asarray(solution.command), unit, "command, the virtual one first", "component"),
        "program_quaternion": Column(np.asarray(references.quaternion), "1", "attitude of the program", "component"),
        "program_rate": Column(np.asarray(references.rate), "rad s-1", "rate of the program, its own axes", "body"),
    }
    if closed is not None:
        columns["closed_form_angle"] = Column(closed.angle, "rad", "angle in closed form, undisturbed")
        columns["closed_form_error"] = Column(closed.error, "1", "error quaternion in closed form", "component")
    return columns


def _result(solution: Solution) -> str:
    """How the integration ended; where the sign of λ is the cause, with the key that chooses it."""
    hint = " In the scenario that is sign = 'auto' in [error]."
    return f"{solution.result}{hint if int(solution.code) in (NEAR_ZERO, FAR_SHEET) else ''}"


def command_unit(job: Job) -> str:
    """Of the law's command."""
    return "rad/s" if isinstance(job.law, RateLaw) else "rad/s²"


def _gains(job: Job) -> dict[str, Any]:
    names = ("k",) if isinstance(job.law, RateLaw) else ("k1", "k2")
    return {name: np.asarray(getattr(job.law, name)).tolist() for name in names}
