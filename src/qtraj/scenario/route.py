"""Scenario keys of `qtraj route`: a recording, the settings of the fit, and limits; construction of the route."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import model_validator

from qtraj.design.fitting.fit_route import fit_route
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.limits import Limits
from qtraj.design.tuning_route.tune_route import require_suitable
from qtraj.foundation.naming import naming
from qtraj.foundation.untrusted import read_bytes
from qtraj.io.recording import is_recording
from qtraj.path.track import Track
from qtraj.scenario.part import SECONDS, Counts, NamedPart, Part, Positive, Text, key
from qtraj.scenario.path import LimitsPart, VehiclePart, limits_with, require_limits
from qtraj.scenario.path_parts import COUNT, TrackPart
from qtraj.scenario.reader import ScenarioFile, content_hash, read_scenario


class RouteFitPart(Part):
    """Settings of the fit; by default, spacing and smoothing are chosen by cross-validation."""

    spacing: Positive | None = key("time between the knots of the route", SECONDS, None)
    smoothing: Positive | None = key(
        "weight of the integral of the squared jerk, relative to the sum of squared distances",
        "a positive finite number [s⁵]",
        None,
    )
    tolerance: Positive | None = key(
        "use the largest smoothing whose RMS distance does not exceed this",
        "a positive finite number [m]",
        None,
    )

    @model_validator(mode="after")
    def _one_smoothing(self) -> "RouteFitPart":
        if self.smoothing is not None and self.tolerance is not None:
            raise ValueError("smoothing and tolerance were both given: give one of them")
        return self


class RouteTunePart(Part):
    """How the route may change; without this table its limits are only checked."""

    tube: Positive = key(
        "largest distance from the fitted route, horizontally and vertically", "a positive finite number [m]", 0.5
    )
    objective: Literal["nearest", "smoothest", "fastest"] = key(
        "what is minimised: the change of the route, the jerk, or the duration",
        "'nearest', 'smoothest' or 'fastest'",
        "nearest",
    )
    max_steps: Counts = key("maximum number of steps of all searches together", COUNT, 300)


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
        "the reason for each limit, shown in the tables", "a table [purpose] of strings, one for each limit", {}
    )
    tune: RouteTunePart | None = key("how the route may change", "a table [tune]", None)

    @model_validator(mode="after")
    def _with_limits(self) -> "RouteScenario":
        require_limits(self.purpose, self.limits, self.vehicle)
        if self.tune is not None and not self.limits.limits():
            raise ValueError("[tune] needs limits: add a table [limits]")
        if self.tune is not None:
            require_suitable(tuple(self.limits.limits()), self.tune.objective)
        return self


@dataclass(frozen=True)
class RouteTask:
    """The recording, the route fitted to it, the limits, and how to tune; None where the scenario has none."""

    track: Track
    fitted: FittedRoute
    limits: Limits | None
    tune: RouteTunePart | None


def read_route(file: Path | None) -> ScenarioFile[Any]:
    """The scenario in a file; a recording is treated as a scenario without limits.

    **Raises:** OSError if the file cannot be read; ValueError, naming it, if it is not a valid scenario or recording.
    """
    if file is None or not is_recording(file):
        return read_scenario(file, "route")
    scenario = RouteScenario(track=TrackPart(file=file.name))
    return ScenarioFile(file, scenario, content_hash(read_bytes(file)))


def fit_recording(loaded: ScenarioFile[RouteScenario]) -> RouteTask:
    """Fit a route to the recording of a scenario.

    **Raises:** OSError if a file cannot be read; ValueError, naming the scenario, if no route can be fitted.
    """
    scenario = loaded.scenario
    with naming(f"{loaded.file}: "):
        track = scenario.track.read(loaded.beside)
        fitted = fit_route(track, scenario.fit.spacing, scenario.fit.tolerance, scenario.fit.smoothing)
        limits = limits_with(scenario.limits, scenario.vehicle)
        return RouteTask(track, fitted, limits if limits.given() else None, scenario.tune)
