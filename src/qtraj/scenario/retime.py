"""Read the scenarios of `qtraj retime`: scenarios of `qtraj tune` and `qtraj route`, with a table [retime]."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.limits import Limits
from qtraj.foundation.naming import naming
from qtraj.foundation.progress import Progress
from qtraj.foundation.untrusted import decoded, parse_toml, read_bytes
from qtraj.io.recording import is_recording
from qtraj.io.saved import is_saved, saved_hodograph
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.track import Track
from qtraj.scenario import DATA
from qtraj.scenario.path import LimitsPart, lay
from qtraj.scenario.reader import ScenarioFile, content_hash, read_scenario
from qtraj.scenario.route import RouteScenario, fit_recording, read_route

EMBEDDED = DATA / "retime.toml"
"""The built-in scenario."""
SHAPES = {"route": ("route",), "spiral-helix": ("path",)}
"""The kinds of scenarios for each value of `retime.shape`."""


@dataclass(frozen=True)
class RetimeTask:
    """The path to retime, its limits, the recording to which the path was fitted, and a function that tunes the path.

    `track` and `fitted` are None without a recording, and `tuning` is None if the path is not tuned.
    """

    path: AbstractHodograph
    limits: Limits
    track: Track | None = None
    fitted: Fitted | FittedRoute | None = None
    tuning: Callable[[Callable[[Progress], None]], Any] | None = None


def read_retiming(file: Path | None) -> ScenarioFile[Any]:
    """Read the scenario in a file; a recording is read as a scenario without limits.

    For a saved path, the field `scenario` of the result is None.

    **Raises:** OSError if the file cannot be read; ValueError, which names the file, if the file is not valid.
    """
    if file is None:
        return read_scenario(EMBEDDED, "path")
    if is_recording(file):
        return read_route(file)
    if is_saved(file):
        return ScenarioFile[Any](file, None, content_hash(read_bytes(file)))
    first, *others = _kinds(file)
    try:
        return read_scenario(file, first)
    except ValueError:
        for kind in others:
            try:
                return read_scenario(file, kind)
            except ValueError:
                continue
        raise


def _kinds(file: Path) -> tuple[str, ...]:
    """Return the possible kinds of a scenario: two if it has a [track] but no valid `retime.shape`, otherwise one."""
    try:
        data = parse_toml(decoded(file, read_bytes(file)))
    except ValueError:  # `read_scenario` describes the fault
        return ("path",)
    if "track" not in data:
        return ("path",)
    part = data.get("retime")
    return SHAPES.get(str(part.get("shape")) if isinstance(part, dict) else "", ("route", "path"))


def with_limits(loaded: ScenarioFile[Any], more: Mapping[str, float]) -> ScenarioFile[Any]:
    """Return the scenario with the additional limits `more`, which replace its own limits with the same names.

    **Raises:** ValueError for a limit that is not positive, or that needs a vehicle that the scenario does not have.
    """
    if not more or loaded.scenario is None:
        return loaded
    vehicle = loaded.scenario.vehicle
    Limits(**more, vehicle=None if vehicle is None else vehicle.vehicle())
    limits = LimitsPart(**loaded.scenario.limits.limits() | dict(more))
    return replace(loaded, scenario=loaded.scenario.model_copy(update={"limits": limits}))


def retiming(loaded: ScenarioFile[Any], more: Mapping[str, float]) -> RetimeTask:
    """Return the task of a scenario; it includes the tuning of the path if the scenario has a table [tune].

    The limits `more` are added to the limits of the scenario, and replace its limits with the same names.

    **Raises:** OSError if a file cannot be read; ValueError, which names the scenario, if the data do not define a
    path.
    """
    if loaded.scenario is None:
        return RetimeTask(saved_hodograph(loaded.file), Limits(**more, vehicle=None))
    loaded = with_limits(loaded, more)
    tuned = "tune" in loaded.scenario.model_fields_set
    if isinstance(loaded.scenario, RouteScenario):
        route = fit_recording(loaded)
        limits = route.limits or Limits()
        tuning = (lambda progress: route.tuned()) if tuned and route.limits else None
        return RetimeTask(route.fitted.path, limits, route.track, route.fitted, tuning)
    task = lay(loaded)

    def tune(progress: Callable[[Progress], None]) -> Any:
        from qtraj.design.tuning.tune import tune

        with naming(f"{loaded.file}: "):
            return tune(**task.tuning(), progress=progress)

    return RetimeTask(task.path, task.limits, task.track, task.fitted, tune if tuned else None)
