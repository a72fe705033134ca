"""From a scenario to what the commands work on: the path before tuning, and what tuning needs besides."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.design.fitting.fit import fit
from qtraj.design.fitting.fitted import Fitted
from qtraj.design.limits import Limits
from qtraj.design.tuning.initial import initial_path
from qtraj.design.tuning.outcome import Tuned
from qtraj.foundation.types import Scalar
from qtraj.io.attitude_angles import AttitudeAngles
from qtraj.io.scenario import ScenarioFile
from qtraj.io.scenario_model import Scenario
from qtraj.io.tangent_plane import TangentPlane
from qtraj.io.track_file import read_track
from qtraj.path.boundary import BoundaryState
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track

LEARNING_RATE = 0.01
"""Of "adam", where the scenario does not say."""


@dataclass(frozen=True)
class Choice:
    """What the command line may say in place of the scenario; None leaves it to the scenario."""

    motion: str | None = None
    objective: str | None = None
    starts: int | None = None


@dataclass(frozen=True)
class Job:
    """The path before tuning, the boundary states given, and the arguments of `tune`."""

    path: SpiralHelix
    start: BoundaryState
    end: BoundaryState
    limits: Limits
    objective: str
    motion: str
    duration: float | None
    turns: int
    starts: int
    fixed: tuple[str, ...] = ()
    bounds: dict[str, tuple[float | None, float | None]] = field(default_factory=dict)
    turn: float | None = None
    corridor: float | None = None
    method: str = "sqp"
    options: dict[str, Any] = field(default_factory=dict)
    track: Track | None = None
    fitted: Fitted | None = None

    def tuning(self) -> dict[str, Any]:
        """The arguments of `tune`."""
        return {
            "start": self.start,
            "end": self.end,
            "limits": self.limits,
            "objective": self.objective,
            "motion": self.motion,
            "duration": self.duration,
            "turns": self.turns,
            "turn": self.turn,
            "starts": self.starts,
            "fixed": self.fixed,
            "bounds": self.bounds,
            "corridor": self.corridor,
            "placement": self.path.placement,
            **_search(self.method, self.options),
        }


def lay(given: ScenarioFile[Scenario], choice: Choice = Choice()) -> Job:
    """The job of a scenario.

    **Raises:** OSError for a file that cannot be read; ValueError, naming the scenario, for data that make no path.
    """
    scenario = given.scenario
    objective = choice.objective or scenario.tune.objective
    motion = choice.motion or scenario.motion
    starts = scenario.tune.starts if choice.starts is None else choice.starts
    limits = Limits(**scenario.limits.given())
    try:
        if scenario.track is not None:
            fitted, track = _fitted(given, scenario, motion)
            return _along(fitted.path, scenario, limits, objective, motion, starts, track, fitted)
        if scenario.path is not None:
            return _along(saved_path(given.beside(scenario.path)), scenario, limits, objective, motion, starts)
        return _between(scenario, limits, objective, motion, starts)
    except ValueError as error:
        raise ValueError(f"{given.file}: {error}") from error


def is_saved(file: Path) -> bool:
    """Whether a file is a stored document (of a path, or of something else) and no scenario."""
    if file.suffix == ".json":
        return True
    return any(line.split("=")[0].strip() == "format" for line in _top(file))


def _top(file: Path) -> list[str]:
    """The lines of a TOML file before its first table."""
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    first = next((k for k, line in enumerate(lines) if line.lstrip().startswith("[")), len(lines))
    return lines[:first]


def saved_path(file: Path) -> SpiralHelix:
    """The path in a saved document; of a tuned or fitted result, its path.

    **Raises:** OSError, or ValueError naming the file where it holds no spiral-helix.
    """
    from qtraj.io.stored import load  # here, for it imports every class that can be stored

    stored = load(file)
    path = stored.path if isinstance(stored, Tuned | Fitted) else stored
    if not isinstance(path, SpiralHelix):
        raise ValueError(f"{file}: a saved path was expected, but the file holds a {type(stored).__name__}")
    return path


class Ends(NamedTuple):
    """The boundary states of a path, its turn [rad] and length [m]."""

    start: BoundaryState
    end: BoundaryState
    turn: float
    length: float


def ends(path: SpiralHelix) -> Ends:
    """The boundary states of a path, its turn and length."""
    (first, last), turn, length = _ends(path)
    return Ends(BoundaryState(*first), BoundaryState(*last), float(turn), float(length))


@eqx.filter_jit
def _ends(path: SpiralHelix) -> tuple[list[Float[Array, "2 3"]], Scalar, Scalar]:
    return [path.derivatives(t, 1) for t in (0.0, path.duration)], path.turn, path.length()


def _fitted(given: ScenarioFile[Scenario], scenario: Scenario, motion: str) -> tuple[Fitted, Track]:
    part = scenario.track
    if part is None:
        raise ValueError("there is no [track] to fit")
    columns = None if part.columns is None else {name: chosen or None for name, chosen in part.columns.items()}
    angles = None if part.angles is None else AttitudeAngles(**part.angles.model_dump())
    origin = None if part.origin is None else (part.origin[0], part.origin[1], part.origin[2])
    projection = None if part.projection is None else TangentPlane(origin)
    track = read_track(given.beside(part.file), columns, angles, projection)
    if part.window is not None:
        track = track.window(*part.window)
    settings = {} if scenario.fit is None else scenario.fit.model_dump(exclude_none=True)
    if bounds := settings.get("radius_bounds"):
        settings["radius_bounds"] = tuple(map(float, bounds))
    return fit(track, **{"motion": motion, **settings}), track


def _along(
    path: SpiralHelix,
    scenario: Scenario,
    limits: Limits,
    objective: str,
    motion: str,
    starts: int,
    track: Track | None = None,
    fitted: Fitted | None = None,
) -> Job:
    """The job of a path that is there already: its ends are the boundary states, its turn is kept."""
    holds = motion == "hermite" or objective == "smoothest"
    duration = scenario.tune.duration or (float(path.duration) if holds else None)
    # Without its mismatch it has the structure of a tuned path, and what is compiled for one serves both.
    plain = SpiralHelix(path.radius, path.angle, path.height, path.duration, path.placement)
    start, end, turn, _ = ends(plain)
    return Job(
        path=plain,
        start=start,
        end=end,
        limits=limits,
        objective=objective,
        motion=motion,
        duration=duration,
        turns=0,
        starts=starts,
        fixed=tuple(scenario.tune.fixed),
        bounds=_bounds(scenario),
        turn=turn,
        corridor=scenario.tune.corridor,
        **_method(scenario),
        track=track,
        fitted=fitted,
    )


def _between(scenario: Scenario, limits: Limits, objective: str, motion: str, starts: int) -> Job:
    """The job between two boundary states."""
    if scenario.start is None or scenario.end is None:
        raise ValueError("there are no [start] and [end]")
    start, end = (BoundaryState(**s.model_dump(exclude_none=True)) for s in (scenario.start, scenario.end))
    placement = None if scenario.placement is None else Placement(**scenario.placement.model_dump(exclude_none=True))
    duration = scenario.tune.duration or scenario.duration
    turns = scenario.tune.turns or scenario.turns or 0
    path = initial_path(start, end, objective, motion, duration, turns, placement)
    fixed, bounds = tuple(scenario.tune.fixed), _bounds(scenario)
    more = {"corridor": scenario.tune.corridor, **_method(scenario)}
    return Job(path, start, end, limits, objective, motion, duration, turns, starts, fixed, bounds, **more)


def _method(scenario: Scenario) -> dict[str, Any]:
    """The method and those of its options that are given."""
    names = ("max_steps", "inner_steps", "learning_rate")
    given = {name: value for name in names if (value := getattr(scenario.tune, name)) is not None}
    return {"method": scenario.tune.method, "options": given}


def _search(method: str, options: dict[str, Any]) -> dict[str, Any]:
    """The method and its options as arguments of `tune`."""
    options = dict(options)
    rate = options.pop("learning_rate", LEARNING_RATE)
    return {"method": _adam(rate) if method == "adam" else method, **options}


@lru_cache(maxsize=8)
def _adam(learning_rate: float) -> Any:
    """One optimiser for each rate: what is compiled for it serves again."""
    import optax  # here, for most scenarios do without

    return optax.adam(learning_rate)


def _bounds(scenario: Scenario) -> dict[str, tuple[float | None, float | None]]:
    """Lowest and highest value by name, None for none."""
    given = scenario.tune.bounds.items()
    return {name: (x.get("min"), x.get("max")) if isinstance(x, dict) else (x[0], x[1]) for name, x in given}
