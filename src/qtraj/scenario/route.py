"""Define the scenario keys of `qtraj route` (recording, fit, limits, tuning), and fit the route."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from qtraj.design.fitting.fit_route import fit_route
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.limits import Limits
from qtraj.design.tuning_route.tune_route import require_suitable
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.naming import naming
from qtraj.foundation.untrusted import read_bytes
from qtraj.io.recording import is_recording
from qtraj.path.track import Track
from qtraj.scenario.part import Counts, Metres, NamedPart, Part, Positive, Seconds, Text, key
from qtraj.scenario.path import LimitsPart, VehiclePart, limits_with, require_limits
from qtraj.scenario.path_parts import RetimePart, TrackPart
from qtraj.scenario.reader import ScenarioFile, content_hash, read_scenario


class RouteFitPart(Part):
    """The settings of the fit; by default, spacing and smoothing are chosen by cross-validation."""

    spacing: Seconds | None = key("time between the knots of the route", None)
    smoothing: Positive | None = key(
        "weight of the integral of the squared jerk, relative to the sum of squared distances",
        None,
        values="a positive finite number [s⁵]",
    )
    tolerance: Metres | None = key(
        "largest allowed RMS distance from the recording; the largest smoothing that satisfies this limit is used", None
    )
    position_sigma: Metres | None = key(
        "standard deviation of a recorded position; by default estimated from the residuals", None
    )
    velocity_sigma: Positive | None = key(
        "standard deviation of a recorded velocity; by default estimated from the residuals",
        None,
        values="a positive finite number [m/s]",
    )

    def _faults(self) -> Iterator[str]:
        if self.smoothing is not None and self.tolerance is not None:
            yield "smoothing and tolerance were both specified: specify one of them"


class RouteTunePart(Part):
    """The settings of the tuning; without this table, the limits are only checked."""

    tube: Metres = key("largest distance from the fitted route, horizontally and vertically", 0.5)
    objective: Literal["nearest", "smoothest", "fastest"] = key(
        "the quantity to minimise: the change of the route, the jerk, or the duration", "nearest"
    )
    max_steps: Counts = key("maximum number of steps of all searches together", 300)


class RouteScenario(NamedPart):
    """A scenario with a recording, and limits that are checked on the whole route fitted to it."""

    track: TrackPart = key("the recording")
    fit: RouteFitPart = key("settings of the fit", RouteFitPart())
    limits: LimitsPart = key(  # pyright: ignore[reportInvalidTypeForm]
        "limits to check on the whole route", LimitsPart()
    )
    vehicle: VehiclePart | None = key("the vehicle, for limits on friction, power, forces and moments", None)
    purpose: dict[str, Text] = key(
        "the reason for each limit, shown in the tables", {}, values="a table [purpose] of strings, one for each limit"
    )
    tune: RouteTunePart | None = key("settings of the tuning", None)
    retime: RetimePart = key("settings of the retiming", RetimePart())

    def _faults(self) -> Iterator[str]:
        require_limits(self.purpose, self.limits, self.vehicle)
        if self.tune is not None and not self.limits.limits():
            yield "[tune] needs limits: add a table [limits]"
        if self.tune is not None:
            require_suitable(tuple(self.limits.limits()), self.tune.objective)


@dataclass(frozen=True)
class RouteTask:
    """The recording of a scenario, the route fitted to the recording, and the limits and the settings of the tuning.

    `limits` and `tune` are None if the scenario does not contain them.
    """

    track: Track
    fitted: FittedRoute
    limits: Limits | None
    tune: RouteTunePart | None

    def tuned(self) -> TunedRoute:
        """Return the tuned route.

        **Raises:** ValueError if the scenario has no limits or no table [tune], or for limits that the tuning does not
        support.
        """
        from qtraj.design.tuning_route.tune_route import tune_route

        if self.limits is None or self.tune is None:
            raise ValueError("a tuning needs the tables [limits] and [tune]")
        part = self.tune
        return tune_route(self.fitted.path, self.limits, part.tube, part.objective, max_steps=part.max_steps)


def read_route(file: Path | None) -> ScenarioFile[Any]:
    """Read the scenario in a file; a recording is read as a scenario without limits.

    **Raises:** OSError if the file cannot be read; ValueError, which names the file, if the file is not a valid
    scenario or recording.
    """
    if file is None or not is_recording(file):
        return read_scenario(file, "route")
    scenario = RouteScenario(track=TrackPart(file=file.name))
    return ScenarioFile(file, scenario, content_hash(read_bytes(file)))


def fit_recording(loaded: ScenarioFile[RouteScenario]) -> RouteTask:
    """Fit a route to the recording of a scenario.

    **Raises:** OSError if a file cannot be read; ValueError, which names the scenario, if no route can be fitted.
    """
    scenario = loaded.scenario
    with naming(f"{loaded.file}: "):
        limits = limits_with(scenario.limits, scenario.vehicle)  # checked first, because the fit takes longer
        track = scenario.track.read(loaded.beside)
        part = scenario.fit
        sigmas = part.position_sigma, part.velocity_sigma
        fitted = fit_route(track, part.spacing, part.tolerance, part.smoothing, *sigmas)
        return RouteTask(track, fitted, limits if limits.given() else None, scenario.tune)
