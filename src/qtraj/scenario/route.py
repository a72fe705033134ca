"""Define the scenario keys of recorded drives, fit their routes, and read the input of `qtraj retime`.

`qtraj retime` reads scenarios of paths and of recorded drives, recordings, saved paths, and curves without times.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from qtraj.design.fitting.fit_route import fit_route
from qtraj.design.fitting.route_stops import NOISY_DISTANCE
from qtraj.design.limits import Limits
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.robust.robust_tune_route import robust_tune_route
from qtraj.design.tuning_route.arguments import require_suitable
from qtraj.design.tuning_route.tune_route import tune_route
from qtraj.foundation.naming import naming
from qtraj.foundation.progress import Report
from qtraj.io.input_file import read_input, with_track
from qtraj.io.saved import saved_hodograph
from qtraj.io.track.reading import Recording
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.route import Route
from qtraj.path.shape import Shape
from qtraj.path.track import STANDSTILL, Track
from qtraj.scenario import DATA, KINDS, keys
from qtraj.scenario.keys import Part, key
from qtraj.scenario.line import limits_of_line, line_in, require_no_columns
from qtraj.scenario.path import LimitedScenario, lay, with_notes
from qtraj.scenario.path_parts import TrackPart
from qtraj.scenario.reader import ScenarioFile, nearest_kind, scenario_in
from qtraj.scenario.recorded_limits import with_odd_limits
from qtraj.scenario.robust_part import BoxPart, SpreadPart, faults_of_deviations

EMBEDDED = DATA / "retime.toml"
"""The built-in scenario of `qtraj retime`."""
SHAPES = {"route": ("route",), "spiral-helix": ("path",)}
"""The kinds of scenarios for each value of `retime.shape`."""


class RouteFitPart(Part):
    """The settings of the fit; by default, spacing and smoothing are chosen by cross-validation."""

    spacing: keys.Seconds | None = key("time between the knots of the route", None)
    smoothing: keys.Positive | None = key(
        "weight of the integral of the squared jerk, relative to the sum of squared distances",
        None,
        values="a positive finite number [s⁵]",
    )
    tolerance: keys.Metres | None = key(
        "largest allowed RMS distance from the recording; the largest smoothing that satisfies this limit is used", None
    )
    position_sigma: keys.Metres | None = key(
        "standard deviation of a recorded position; by default estimated from the residuals", None
    )
    velocity_sigma: keys.Positive | None = key(
        "standard deviation of a recorded velocity; by default estimated from the residuals",
        None,
        values="a positive finite number [m/s]",
    )
    stop_speed: keys.Positive | None = key(
        "largest speed at a stop; by default 0.5 % of the largest speed, or more in noise",
        None,
        values="a positive finite number [m/s]",
    )
    stop_distance: keys.Metres | None = key(
        f"largest distance from the mean position at a stop; by default {STANDSTILL} m, but at least "
        f"{NOISY_DISTANCE:g} standard deviations of the positions",
        None,
    )

    def _faults(self) -> Iterator[str]:
        if self.smoothing is not None and self.tolerance is not None:
            yield "smoothing and tolerance were both specified: specify one of them"


class RouteTunePart(Part):
    """The settings of the tuning; without this table, the limits are only checked."""

    tube: keys.Metres = key("largest distance from the fitted route, horizontally and vertically", 0.5)
    objective: Literal["nearest", "smoothest", "fastest"] = key(
        "the quantity to minimise: the change of the route ('nearest'), the integral of the squared jerk ('smoothest') "
        "or the duration ('fastest')",
        "nearest",
    )
    nearest_to: keys.Text | None = key(
        "a saved path that replaces the fitted route in the objective 'nearest'",
        None,
        values="the name of a saved path, relative to the scenario",
    )
    max_steps: keys.Counts = key("maximum number of steps of a search with its repetitions", 300)
    fixed_ends: bool = key("whether the states at both ends of the route are kept", True, values="a bool")


class RouteScenario(LimitedScenario):
    """A scenario with a recording, and limits that are checked on the whole route fitted to it."""

    track: TrackPart = key("the recording")
    fit: RouteFitPart = key("settings of the fit", RouteFitPart())
    tune: RouteTunePart | None = key("settings of the tuning", None)
    spread: SpreadPart | None = key("standard deviations, for a tuning with margins", None)
    box: BoxPart | None = key("intervals of deviations, for a tuning with margins that are proved", None)

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.tune is not None and not (self.limits.limits() or self.limits.keep_out):
            yield "[tune] needs limits: add a table [limits]"
        if self.tune is not None:
            require_suitable(tuple(self.limits.limits()), self.tune.objective)
        for name in self.given("spread", "box"):
            if self.tune is None:
                yield f"[{name}] is for a tuning: add the table [tune]"
        yield from faults_of_deviations(self, of_route=True)


class RouteTask(NamedTuple):
    """A path and its limits, the recording to which the path was fitted, and a function that tunes the path.

    `recording` and `fitted`: None without a recording. `tuning`: None if the path is not tuned; the argument of this
    function reports the progress. `robust_tuning`: the same with margins, None if nothing deviates.
    """

    path: AbstractHodograph | Shape
    limits: Limits
    recording: Recording | None = None
    fitted: Any = None
    tuning: Callable[[Report], Any] | None = None
    robust_tuning: Callable[[Report], RobustTuned | BoxTuned] | None = None

    @property
    def track(self) -> Track | None:
        """The recorded track to which the path was fitted."""
        return None if self.recording is None else self.recording.track


def read_route(
    file: Path | None,
    limits: Mapping[str, Any] = MappingProxyType({}),
    track: Mapping[str, Any] = MappingProxyType({}),
) -> ScenarioFile[Any]:
    """Read the scenario in a file; a recording is read as a scenario without limits.

    `limits` and `track` replace limits and keys of [track] in the scenario, or are added to them.

    **Raises:** OSError if the file cannot be read; ValueError, which names the file, if the file is not a valid
    scenario or recording.
    """
    given = read_input(KINDS["route"].embedded if file is None else file)
    return scenario_in(with_track(given, track), "route", limits, recording=True)


def fit_recording(loaded: ScenarioFile[RouteScenario]) -> RouteTask:
    """Fit a route to the recording of a scenario.

    **Raises:** OSError if a file cannot be read; ValueError, which names the scenario, if no route can be fitted.
    """
    scenario = loaded.scenario
    with naming(f"{loaded.file}: "):
        scenario.all_limits(loaded.beside)  # checked first, because the fit takes longer
        window = scenario.track.window
        recording = scenario.track.read_whole(loaded.beside, scenario.limits.columns())
        recording = with_odd_limits(recording, scenario.limits.limits())
        settings = scenario.fit.model_dump(exclude={"spacing"})
        with with_notes(recording):
            fitted = fit_route(recording.track, scenario.fit.spacing, window=window, **settings)
        if window is not None:
            recording = recording._replace(track=recording.track.window(*window))
        limits = scenario.all_limits(loaded.beside, recording, fitted.path)
        near = scenario.tune and scenario.tune.nearest_to
        target = None if near is None else saved_hodograph(loaded.beside(near))
        if scenario.tune is None:
            return RouteTask(fitted.path, limits, recording, fitted)
        tuning = partial(_tuned, fitted.path, limits, scenario.tune, target)
        deviations = scenario.spread or scenario.box
        robust = None if deviations is None else partial(tuning, deviations=deviations.arguments())
        return RouteTask(fitted.path, limits, recording, fitted, tuning, robust)


def _tuned(
    path: Route,
    limits: Limits,
    part: RouteTunePart,
    target: AbstractHodograph | None,
    progress: Report,
    deviations: Mapping[str, Any] | None = None,
) -> Any:
    """Return the tuned route, with `deviations` a result of `robust_tune_route`; the progress is not reported."""
    options: dict[str, Any] = {"tube": part.tube, "objective": part.objective, "nearest_to": target}
    options["max_steps"] = part.max_steps
    if not part.fixed_ends:
        options["fixed"] = np.zeros(len(path.times), bool)
    if deviations is None:
        return tune_route(path, limits, **options)
    return robust_tune_route(path, limits, **deviations, **options)


def read_retiming(
    file: Path | None, limits: Mapping[str, Any], track: Mapping[str, Any] = MappingProxyType({})
) -> ScenarioFile[Any]:
    """Read the scenario in a file; a recording is read as a scenario without limits.

    `limits` and `track` replace limits and keys of [track] in the scenario, or are added to them. For a saved path and
    a curve without times, the field `scenario` of the result is None.

    **Raises:** OSError if the file cannot be read; ValueError, which names the file, if the file is not valid.
    """
    if file is not None and (line := line_in(file, track)) is not None:
        return line
    given = with_track(read_input(EMBEDDED if file is None else file), track)
    if given.is_saved:
        return ScenarioFile(given.file, None, given.hash)
    part = given.data.get("retime")
    shape = str(part.get("shape")) if isinstance(part, dict) else ""
    kinds = SHAPES.get(shape, ("route", "path")) if "track" in given.data else ("path",)
    return scenario_in(given, nearest_kind(given.data, kinds), limits, recording=True, others=("slew", "loop"))


def retiming(loaded: ScenarioFile[Any], limits: Mapping[str, Any]) -> RouteTask:
    """Return the task of a scenario; it includes the tuning of the path if the scenario has a table [tune].

    `limits`: the limits for a saved path, which has no scenario.

    **Raises:** OSError if a file cannot be read; ValueError, which names the scenario, if the data do not define a
    path.
    """
    if loaded.line is not None:
        return RouteTask(loaded.line.shape, limits_of_line(limits))
    if loaded.scenario is None:
        return RouteTask(saved_hodograph(loaded.file), _without_vehicle(limits, loaded.file.name))
    if isinstance(loaded.scenario, RouteScenario):
        return fit_recording(loaded)
    task = lay(loaded)
    tuning = task.tuned if "tune" in loaded.scenario.model_fields_set else None
    return RouteTask(task.path, task.limits, task.recording, task.fitted, tuning)


def _without_vehicle(limits: Mapping[str, Any], name: str) -> Limits:
    if needs := [limit for limit in limits if quantity(limit).needs]:
        raise ValueError(
            f"a limit on {needs[0]} needs a vehicle, which a saved path does not have: write a scenario with path = "
            f"'{name}', [vehicle] and [limits]"
        )
    require_no_columns(limits, "a saved path")
    return Limits(**limits, vehicle=None)
