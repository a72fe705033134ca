"""The findings on a path and its tuning as one program, which a later run need not trace again."""

from typing import Any

from jaxtyping import Array

from qtraj.cli.kept import kept
from qtraj.cli.tuning.job import Job
from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.outcome import CONVERGED, Tuned
from qtraj.design.tuning.tune import tune
from qtraj.path.boundary import BoundaryState
from qtraj.path.spiral_helix import SpiralHelix

Program = dict[str, Any]


def search(job: Job) -> tuple[Certificate, Tuned] | None:
    """What `certify` and `tune` find on a job; None where no program is kept, or the search did not converge.

    A search that did not converge is worth repeating step by step, with its advice and what it says on the way.
    """
    numbers = {"duration": job.duration, "turn": job.turn}

    def program(path: SpiralHelix, start: BoundaryState, end: BoundaryState, limits: Limits, given: Any) -> Program:
        best = tune(
            **job.tuning() | given | {"start": start, "end": end, "limits": limits, "placement": path.placement}
        )
        tuned = best.path
        return {
            "before": _arrays(certify(path, limits)),
            "after": _arrays(best.certificate),
            "path": (tuned.radius, tuned.angle, tuned.height, tuned.duration),
            "ends": (best.start.velocity, best.end.velocity),
            "outcome": (best.objective, best.code, best.iterations),
        }

    name = f"tune {job.objective} {job.motion} {job.turns} {job.starts}"
    given = {key: value for key, value in numbers.items() if value is not None}
    found = kept(name, program, job.path, job.start, job.end, job.limits, given)
    if found is None or int(found["outcome"][1]) != CONVERGED:
        return None
    names = tuple(job.limits.given())
    objective, code, iterations = found["outcome"]
    radius, angle, height, duration = found["path"]
    best = Tuned(
        SpiralHelix(radius, angle, height, duration, job.path.placement),
        BoundaryState(job.start.position, found["ends"][0]),
        BoundaryState(job.end.position, found["ends"][1]),
        objective,
        Certificate(names, *found["after"]),
        code,
        iterations,
    )
    return Certificate(names, *found["before"]), best


def _arrays(certificate: Certificate) -> tuple[Array, ...]:
    return certificate.codes, certificate.times, certificate.values, certificate.limits
