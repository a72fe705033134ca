"""Scenarios of `qtraj route`: a whole recording, how a route is fitted to it, and its limits."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import model_validator

from qtraj.design.fitting.fit_route import fit_route
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.limits import Limits
from qtraj.foundation.naming import naming
from qtraj.foundation.untrusted import read_bytes
from qtraj.io.recording import is_recording
from qtraj.path.track import Track
from qtraj.scenario.part import SECONDS, NamedPart, Part, Positive, Text, key
from qtraj.scenario.path import LimitsPart, VehiclePart, limits_with, require_limits
from qtraj.scenario.path_parts import TrackPart
from qtraj.scenario.reader import ScenarioFile, content_hash, read_scenario


class RouteFitPart(Part):
    """How the route is fitted; by default, spacing and smoothing are chosen by cross-validation."""

    spacing: Positive | None = key("time between the joints of the route", SECONDS, None)
    smoothing: Positive | None = key(
        "weight of the integral of the squared jerk, relative to the sum of squared distances",
        "a positive finite number [s⁵]",
        None,
    )
    tolerance: Positive | None = key(
        "select the largest smoothing with at most this root mean square of the distances",
        "a positive finite number [m]",
        None,
    )

    @model_validator(mode="after")
    def _one_smoothing(self) -> "RouteFitPart":
        if self.smoothing is not None and self.tolerance is not None:
            raise ValueError("smoothing and tolerance were both given: give one of them")
        return self


class RouteScenario(NamedPart):
    """A scenario: a recording, and limits that are checked along its whole route."""

    track: TrackPart = key("the recording", "a table [track]")
    fit: RouteFitPart = key("how the route is fitted", "a table [fit]", RouteFitPart())
    limits: LimitsPart = key(  # pyright: ignore[reportInvalidTypeForm]
        "limits to check on the whole route", "a table [limits]", LimitsPart()
    )
    vehicle: VehiclePart | None = key(
        "the vehicle, for limits on friction, power and forces", "a table [vehicle]", None
    )
    purpose: dict[str, Text] = key(
        "why there is a limit, for the tables", "a table [purpose] of texts, one for each limit", {}
    )

    @model_validator(mode="after")
    def _purposes(self) -> "RouteScenario":
        require_limits(self.purpose, self.limits, self.vehicle)
        return self


@dataclass(frozen=True)
class RouteTask:
    """The recording, the route fitted to it, and the limits; None without limits."""

    track: Track
    fitted: FittedRoute
    limits: Limits | None


def read_route(file: Path | None) -> ScenarioFile[Any]:
    """The scenario in a file; a recording is a scenario without limits.

    **Raises:** OSError if the file cannot be read; ValueError, naming it, if it is neither.
    """
    if file is None or not is_recording(file):
        return read_scenario(file, "route")
    scenario = RouteScenario(track=TrackPart(file=file.name))
    return ScenarioFile(file, scenario, content_hash(read_bytes(file)))


def fit_recording(given: ScenarioFile[RouteScenario]) -> RouteTask:
    """The route of a scenario's recording.

    **Raises:** OSError for a file that cannot be read; ValueError, naming the scenario, for data without a route.
    """
    scenario = given.scenario
    with naming(f"{given.file}: "):
        track = scenario.track.read(given.beside)
        fitted = fit_route(track, scenario.fit.spacing, scenario.fit.tolerance, scenario.fit.smoothing)
        limits = limits_with(scenario.limits, scenario.vehicle)
        return RouteTask(track, fitted, limits if limits.given() else None)
