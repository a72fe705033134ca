"""Define the scenario keys of a path, and build the path and the tuning problem."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.limits import Limits
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.tuning.initial import initial_path
from qtraj.design.tuning.outcome import Tuned
from qtraj.foundation.naming import naming
from qtraj.foundation.progress import Report
from qtraj.io.saved import saved_hodograph, saved_path
from qtraj.io.track.reading import Recording
from qtraj.path.boundary import BoundaryState
from qtraj.path.change import sampled
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.own_name import OwnName
from qtraj.path.placement import Placement
from qtraj.path.quantity import quantity
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track
from qtraj.scenario import keys
from qtraj.scenario.keys import NamedPart, Part, key
from qtraj.scenario.limit_keys import LimitsPart
from qtraj.scenario.path_parts import FitPart, RetimePart, TrackPart, TunePart
from qtraj.scenario.reader import ScenarioFile
from qtraj.scenario.recorded_limits import along_path, with_odd_limits
from qtraj.scenario.robust_part import BoxPart, SpreadPart, faults_of_deviations
from qtraj.scenario.sweep_part import SweepPart
from qtraj.scenario.vehicle import Beside, VehiclePart, require_vehicle


class StatePart(Part):
    """A boundary state in world axes."""

    position: keys.Vector = key("position", unit="m")
    velocity: keys.Vector = key("velocity", unit="m/s")
    acceleration: keys.Vector | None = key(
        "acceleration, for both states or neither; only for a hermite path with a duration, and not for `qtraj tune`; "
        "radius, angle and height are then quintics in time",
        None,
        unit="m/s²",
    )


class PlacementPart(Part):
    """The axis of a path between two boundary states."""

    origin: keys.Vector = key("a point on the axis", unit="m")
    orientation: keys.Quaternion | None = key(
        "orientation of the path axes, whose z axis is the axis of the path; default: z vertical",
        None,
        values="four finite numbers, scalar first: the quaternion from path components to world components",
    )


class LimitedScenario(NamedPart):
    """The limits of a path, the reason for each limit, and the settings of the retiming."""

    limits: LimitsPart = key(  # pyright: ignore[reportInvalidTypeForm]
        "limits on the whole path", LimitsPart()
    )
    vehicle: VehiclePart | None = key("the vehicle, for limits on friction, power, forces and moments", None)
    purpose: dict[str, keys.Text] = key(
        "the reason for each limit, printed with results", {}, values="a table [purpose] of strings, one for each limit"
    )
    retime: RetimePart = key("settings of the retiming", RetimePart())
    sweep: SweepPart | None = key("parameters of a sweep", None)

    def _faults(self) -> Iterator[str]:
        limits, vehicle = self.limits.limits(), self.vehicle and self.vehicle.without_file()
        for name in limits:
            if quantity(name).needs:
                require_vehicle(vehicle, quantity(name).needs, f"limits.{name}")
        if (columns := self.limits.columns()) and getattr(self, "track", None) is None:
            yield f"limits.{next(iter(columns))} is a column of a recording: specify [track], or another form of limit"
        if extra := sorted(set(self.purpose) - set(limits)):
            yield (
                f"there is no limit {extra[0]!r} in [limits] for purpose.{extra[0]}: add the limit, or remove the "
                "purpose"
            )

    def all_limits(
        self, beside: Beside, recording: Recording | None = None, path: AbstractHodograph | None = None
    ) -> Limits:
        """Return the limits, combined with the vehicle; `beside` maps the name of a file to its path.

        Limits in columns are those of the `recording`, along the `path` fitted to it; without them, they are left out.
        """
        bounds = {name: along_path(name, x, recording, path) for name, x in self.limits.limits().items()}
        vehicle = self.vehicle and self.vehicle.vehicle(beside)
        own: Any = {name: bound for name, bound in bounds.items() if isinstance(name, OwnName)}
        named = {name: bound for name, bound in bounds.items() if name not in own}
        return Limits(**named, own=own, vehicle=vehicle, **self.limits.obstacles())


class PathScenario(LimitedScenario):
    """A scenario with one path (a track, two boundary states, or a saved path), limits and settings of the tuning."""

    track: TrackPart | None = key("the recording to which the path is fitted", None)
    fit: FitPart | None = key("settings of the fit", None)
    start: StatePart | None = key("the first of two boundary states", None)
    end: StatePart | None = key("the second of two boundary states", None)
    path: keys.Text | None = key("a saved path", None, values="the name of a saved path, relative to the scenario")
    placement: PlacementPart | None = key("the axis of a path between two states", None)
    duration: keys.Seconds | None = key(
        "duration between two states; default: computed from the angular rates about the axis at both states", None
    )
    turns: keys.Wholes | None = key("additional whole turns of a path between two states", None)
    tune: TunePart = key("settings of the tuning", TunePart())
    spread: SpreadPart | None = key("standard deviations, for a tuning with margins", None)
    box: BoxPart | None = key("intervals of deviations, for a tuning with margins that are proved", None)

    @property
    def motion(self) -> str:
        """The motion of the tuned path: the value in [tune], or the default for the source of the path."""
        return self.tune.motion or ("uniform" if self.track is None else "hermite")

    def _faults(self) -> Iterator[str]:
        states, sources = self.given("start", "end"), self.given("track", "start", "end", "path")
        if not sources:
            yield 'there is no path: specify [track], or [start] and [end], or path = "a saved path"'
        if len(states) == 1 and len(sources) == 1:
            yield f"[{states[0]}] requires [{'end' if states == ['start'] else 'start'}], which is missing"
        if len(sources) > 1 and sources != ["start", "end"]:
            yield (
                f"there are several paths ({', '.join(sources)}): specify only [track], or only [start] and [end], or "
                'only path = "a saved path"'
            )
        if self.fit is not None and self.track is None:
            yield "[fit] requires [track], which is missing"
        for name in self.given("placement", "duration", "turns"):
            if self.start is None:
                yield (
                    f"{name} is valid only with [start] and [end]: a track or a saved path already defines its {name}"
                )
        if self.tune.turns is not None and self.start is None:
            yield "tune.turns is valid only with [start] and [end]: a track or a saved path already defines its turn"
        yield from faults_of_deviations(self, of_route=False)
        for name in self.given("duration", "turns"):
            if getattr(self.tune, name) is not None:
                yield f"{name} and tune.{name} are the same setting: specify one of them"
        yield from super()._faults()


@dataclass(frozen=True)
class PathTask:
    """The task of `qtraj tune`: the original path, and the arguments of `qtraj.tune`; `part` is the table [tune].

    `deviations`: the table [spread] or [box].
    """

    path: SpiralHelix
    start: BoundaryState
    end: BoundaryState
    limits: Limits
    objective: str
    motion: str
    duration: float | None
    starts: int
    part: TunePart
    turns: int = 0
    turn: float | None = None
    recording: Recording | None = None
    fitted: Fitted | None = None
    nearest_to: AbstractHodograph | None = None
    deviations: SpreadPart | BoxPart | None = None

    @property
    def track(self) -> Track | None:
        """The recorded track to which the path was fitted."""
        return None if self.recording is None else self.recording.track

    def tuning(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.tune`."""
        names = ("start", "end", "limits", "objective", "motion", "duration", "turns", "turn", "starts", "nearest_to")
        arguments = {name: getattr(self, name) for name in names}
        return arguments | {"placement": self.path.placement} | self.part.arguments()

    def tuned(self, progress: Report | None = None) -> Tuned:
        """Return the result of `qtraj.tune`."""
        from qtraj.design.tuning.tune import tune

        return tune(**self.tuning(), progress=progress)

    def robust_tuned(self, progress: Report | None = None) -> RobustTuned | BoxTuned | None:
        """Return the result of `qtraj.robust_tune`; None if nothing deviates."""
        if self.deviations is None:
            return None
        from qtraj.design.robust.robust_tune import robust_tune

        return robust_tune(**self.tuning(), **self.deviations.arguments(), progress=progress)


def lay(
    loaded: ScenarioFile[PathScenario],
    motion: str | None = None,
    objective: str | None = None,
    starts: int | None = None,
) -> PathTask:
    """Build the path of a scenario and its tuning problem.

    `motion`, `objective` and `starts` override the values of the scenario.

    **Raises:** OSError if a file cannot be read; ValueError, which names the scenario, if the data do not define a
    path.
    """
    scenario = loaded.scenario
    chosen: dict[str, Any] = {
        "objective": objective or scenario.tune.objective,
        "motion": motion or scenario.motion,
        "starts": scenario.tune.starts if starts is None else starts,
        "part": scenario.tune,
        "deviations": scenario.spread or scenario.box,
    }
    with naming(f"{loaded.file}: "):
        if scenario.tune.nearest_to is not None:
            chosen["nearest_to"] = saved_hodograph(loaded.beside(scenario.tune.nearest_to))
        chosen["limits"] = scenario.all_limits(loaded.beside)
        if scenario.track is not None:
            recording = scenario.track.read(loaded.beside, scenario.limits.columns())
            recording = with_odd_limits(recording, scenario.limits.limits())
            with with_notes(recording):
                fitted = (scenario.fit or FitPart()).fit(recording.track, chosen["motion"])
            chosen["limits"] = scenario.all_limits(loaded.beside, recording, fitted.path)
            return _along(fitted.path, recording=recording, fitted=fitted, **chosen)
        if scenario.path is not None:
            return _along(saved_path(loaded.beside(scenario.path)), **chosen)
        return _between(scenario, **chosen)


@contextmanager
def with_notes(recording: Recording) -> Iterator[None]:
    """Append what is odd in a recording to the message of a fit that fails."""
    try:
        yield
    except ValueError as error:
        if not recording.notes:
            raise
        raise ValueError(f"{error}. Note: {'; '.join(recording.notes)}") from error


def _along(path: SpiralHelix, part: TunePart, **chosen: Any) -> PathTask:
    """Return the task that keeps the turn of an existing path; the boundary states are the ends of this path."""
    keeps = chosen["motion"] == "hermite" or chosen["objective"] == "smoothest"
    duration = part.duration or (float(path.duration) if keeps else None)
    # A path without the field `mismatch` has the same structure as a tuned path, so both use the same executables.
    plain = SpiralHelix(path.radius, path.angle, path.height, path.duration, path.placement)
    states = sampled(plain)
    start, end = states.ends
    return PathTask(plain, start, end, duration=duration, turn=float(states.turn), part=part, **chosen)


def _between(scenario: PathScenario, part: TunePart, **chosen: Any) -> PathTask:
    """Return the task between two boundary states."""
    if scenario.start is None or scenario.end is None:
        raise ValueError("[start] and [end] are missing")
    start, end = (BoundaryState(**s.model_dump(exclude_none=True)) for s in (scenario.start, scenario.end))
    placement = None if scenario.placement is None else Placement(**scenario.placement.model_dump(exclude_none=True))
    duration, turns = part.duration or scenario.duration, part.turns or scenario.turns or 0
    path = initial_path(start, end, chosen["objective"], chosen["motion"], duration, turns, placement)
    return PathTask(path, start, end, duration=duration, turns=turns, part=part, **chosen)
