"""What `tune` has to say, as plain data: the JSON output, and what the tables on the terminal are made from."""

from typing import Any

import numpy as np
import xarray

from qtraj._version import __version__
from qtraj.cli.content import finite, scenario_content
from qtraj.cli.tuning.job import Job, ends
from qtraj.cli.tuning.remarks import far_off, held, moved
from qtraj.design.fitting.facts import facts
from qtraj.design.proof.certificate import Certificate
from qtraj.design.tuning.outcome import Tuned
from qtraj.foundation import units
from qtraj.io.scenario import ScenarioFile
from qtraj.path.boundary import BoundaryState, cylindrical
from qtraj.path.deviation import max_deviation
from qtraj.path.placement import Placement
from qtraj.path.quantity import quantity
from qtraj.path.spiral_helix import SpiralHelix

COMPONENTS = ("V_rho", "V_phi", "V_h")


def tune_content(
    given: ScenarioFile, job: Job, before: Certificate, best: Tuned, dataset: xarray.Dataset
) -> dict[str, Any]:
    """The whole outcome of a tuning, of JSON's types only (None where a number is not finite)."""
    was, now = (
        np.stack([dataset[part].sel(path=name).values for part in ("position", "velocity")])
        for name in ("before", "after")
    )
    content = {
        "qtraj": __version__,
        "command": "tune",
        "scenario": scenario_content(given),
        "fit": None if job.fitted is None else facts(job.fitted),
        "frame": dataset.attrs["frame"],
        "limits": {name: _limit(name, before, best.certificate, given.scenario.purpose) for name in before.status},
        "boundary": _boundary(job, best),
        "departure": max_deviation(now[0], was[0]),
        "change": moved(was, now),
        "tuning": {
            "objective": job.objective,
            "motion": job.motion,
            "method": job.method,
            "options": dict(job.options),
            **held(job),
            "value": float(best.objective),
            "status": best.status,
            "iterations": int(best.iterations),
            "result": best.result,
        },
    }
    return finite(content | {"warning": far_off(content, was[0])})


def _limit(name: str, before: Certificate, after: Certificate, purpose: dict[str, str]) -> dict[str, Any]:
    return {
        "unit": units.symbol(quantity(name).unit),
        "purpose": purpose.get(name),
        "limit": before.worst[name][2],
        "before": _finding(name, before),
        "after": _finding(name, after),
    }


def _finding(name: str, certificate: Certificate) -> dict[str, Any]:
    time, value, _ = certificate.worst[name]
    return {
        "value": value,
        "time": time,
        "margin": certificate.margin(name),
        "status": certificate.status[name],
        "binding": name in certificate.active,
    }


def _boundary(job: Job, best: Tuned) -> dict[str, Any]:
    """Cylindrical velocities as given, before (those of the path on which tuning starts) and after."""
    given = {"start": _components(job.start, job.path.placement), "end": _components(job.end, job.path.placement)}
    return {"given": given, "before": _ends(job.path), "after": _ends(best.path)}


def _ends(path: SpiralHelix) -> dict[str, Any]:
    start, end, turn, length = ends(path)
    duration = float(path.duration)
    return {
        "start": _components(start, path.placement),
        "end": _components(end, path.placement),
        "duration": duration,
        "mean_rate": turn / duration,
        "length": length,
    }


def _components(state: BoundaryState, placement: Placement | None) -> dict[str, float]:
    velocity = np.asarray(cylindrical(state, placement).velocity)
    return dict(zip(COMPONENTS, velocity.tolist(), strict=True))
