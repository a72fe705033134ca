"""Define the scenario keys of an atlas, a tuning problem with two or three keys that change, and build its function."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from qtraj.design.limits import Limits, limits_of
from qtraj.foundation.naming import naming
from qtraj.foundation.progress import Report
from qtraj.foundation.suggestion import suggestion
from qtraj.path.boundary import BoundaryState
from qtraj.path.own_units import unit_of
from qtraj.path.placement import Placement
from qtraj.path.quantity import quantity
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key
from qtraj.scenario.path import PathScenario, PathTask, lay
from qtraj.scenario.reader import ScenarioFile
from qtraj.sweeps.atlas.atlas import MAX_EVALUATIONS, atlas
from qtraj.sweeps.atlas.axis import AtlasAxis
from qtraj.sweeps.atlas.outcome import Atlas
from qtraj.sweeps.atlas.tuned_points import tuned_points

LIMITS = "limits."

MOST_SLICES = 64
"""Maximum number of values of the third key."""

UNITS = {
    "start.speed": "m/s",
    "end.speed": "m/s",
    "start.radius": "m",
    "end.radius": "m",
    "radius": "m",
    "start.heading": "rad",
    "end.heading": "rad",
    "duration": "s",
}
"""The keys that may change, other than limits, and their units."""

MAGNITUDES = ("start.speed", "end.speed", "start.radius", "end.radius", "radius", "duration")
"""Those that cannot be negative."""


class AxisPart(Part):
    """One axis of the atlas: the key that changes, and its range.

    The keys are start.speed and end.speed (the direction is kept), start.heading and end.heading (the horizontal
    direction of the velocity, from the x axis to the left, in radians), start.radius and end.radius (the distance from
    the axis of the turn) or radius for both, duration, and limits with one number, such as limits.curvature.
    """

    key: keys.Text = keys.key("the key that changes", values='a key, such as "start.speed" or "limits.curvature"')
    range: keys.Pair = keys.key("its first and last value, in SI units", values="two finite numbers [low, high]")
    tolerance: keys.Positive = keys.key("largest distance of the border from its true position, in the unit of the key")
    steps: keys.Counts = keys.key("number of coarse cells; smaller regions may be missed", 16)

    def _faults(self) -> Iterator[str]:
        self.axis()  # raises for a range without length and for too many cells
        if self.key in MAGNITUDES and self.range[0] < 0:
            yield f"the range of {self.key} starts at {self.range[0]}, but this key cannot be negative"

    def axis(self) -> AtlasAxis:
        """Return the axis.

        **Raises:** ValueError for an unknown key, or an invalid range.
        """
        low, high = self.range
        return AtlasAxis(self.key, low, high, self.tolerance, self.steps, _unit(self.key))


class SlicesPart(Part):
    """A third key that changes, one of those of the axes: an atlas is computed for each of its values."""

    key: keys.Text = keys.key("the key that changes", values='a key, such as "limits.curvature"')
    values: list[keys.Number] = keys.key(
        "its values, in SI units", values=f"2 to {MOST_SLICES} different finite numbers in ascending order"
    )

    def _faults(self) -> Iterator[str]:
        if not 2 <= len(self.values) <= MOST_SLICES or self.values != sorted(set(self.values)):
            yield (
                f"atlas.z.values must be 2 to {MOST_SLICES} different numbers in ascending order, but {self.values} "
                "was given"
            )
        if self.key in MAGNITUDES and self.values[0] < 0:
            yield f"the values of {self.key} start at {self.values[0]}, but this key cannot be negative"
        self.unit()  # raises for an unknown key

    def unit(self) -> str:
        """Return the unit of the key in netCDF notation.

        **Raises:** ValueError for an unknown key.
        """
        return unit_of(_unit(self.key))


class AtlasPart(Part):
    """The axes of the atlas, and the borders that are followed."""

    x: AxisPart = key("the horizontal axis", values="a table [atlas.x]")
    y: AxisPart = key("the vertical axis", values="a table [atlas.y]")
    z: SlicesPart | None = key(
        "a third key; one atlas is computed for each of its values, which a slider in report.html selects", None
    )
    follow: Literal["feasible", "status", "limit"] = key(
        "the borders that are followed: of the feasible region, between all classes, or also between different limits",
        "feasible",
    )
    max_evaluations: keys.Counts = key("maximum number of tunings of each atlas", MAX_EVALUATIONS)

    def parts(self) -> dict[str, AxisPart | SlicesPart]:
        """Return the tables of the keys that change, by name."""
        both: dict[str, AxisPart | SlicesPart] = {"x": self.x, "y": self.y}
        return both if self.z is None else {**both, "z": self.z}


class AtlasScenario(PathScenario):
    """A tuning problem, as for `qtraj tune`, and two or three of its keys that change."""

    atlas: AtlasPart = key("the axes of the atlas", values="a table [atlas]")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.limits.keep_out:
            yield "an atlas tunes boundary velocities, which does not support obstacles: omit limits.keep_out"
        for name in self.given("spread", "box"):
            yield f"an atlas tunes without margins: omit [{name}], or specify smaller limits"
        if not self.limits.limits():
            yield "the table [limits] is missing or empty, but an atlas needs at least one limit"
        parts = self.atlas.parts()
        for one, other in itertools.combinations(parts, 2):
            if parts[one].key == parts[other].key:
                key = parts[one].key
                yield f"atlas.{one} and atlas.{other} have the same key, {key!r}: choose another key for one of them"
        numbers = self.limits.limits()
        for name in (part.key.removeprefix(LIMITS) for part in parts.values() if LIMITS in part.key):
            if name in numbers and not isinstance(numbers[name], float | int):
                yield f"limits.{name} is a key of the atlas, so it must be one number"


@dataclass(frozen=True)
class AtlasTask:
    """The task of `qtraj atlas`: the tuning problem, and the table [atlas]."""

    tuning: PathTask
    part: AtlasPart

    def computed(self, progress: Report | None = None, third: float | None = None) -> Atlas:
        """Return the atlas, for a value of the third key if there is one."""
        names = (self.part.x.key, self.part.y.key)
        arguments = self.tuning.tuning()
        varied = {name: arguments.pop(name) for name in ("start", "end", "limits", "duration", "turn", "placement")}
        point = Point(**varied)
        if self.part.z is not None and third is not None:
            point = point.at(self.part.z.key, third)

        def problem(x: float, y: float) -> dict[str, Any]:
            return point.at(names[0], x).at(names[1], y)._asdict()

        x, y = self.part.x.axis(), self.part.y.axis()
        function, part = tuned_points(problem, **arguments), self.part
        return atlas(function, x, y, follow=part.follow, max_evaluations=part.max_evaluations, progress=progress)


class Point(NamedTuple):
    """The arguments of `tune` that may change from point to point."""

    start: BoundaryState
    end: BoundaryState
    limits: Limits
    duration: Any
    turn: Any
    placement: Placement | None

    def at(self, name: str, value: float) -> "Point":
        """Return the arguments with another value of a key."""
        if name.startswith(LIMITS):
            return self._replace(limits=_with_limit(self.limits, name.removeprefix(LIMITS), value))
        if name == "duration":
            return self._replace(duration=value)
        side, _, part = name.rpartition(".")
        change = CHANGES[part]
        sides = [side] if side else ["start", "end"]
        return self._replace(**{each: change(getattr(self, each), value, self.placement) for each in sides})


def atlas_task(loaded: ScenarioFile[AtlasScenario]) -> AtlasTask:
    """Build the tuning problem of a scenario.

    **Raises:** OSError if a file cannot be read; ValueError, which names the scenario, if the data do not define a
    path.
    """
    task = lay(loaded)  # pyright: ignore[reportArgumentType]
    with naming(f"{loaded.file}: "):
        part = loaded.scenario.atlas
        point = Point(task.start, task.end, task.limits, None, None, task.path.placement)
        for axis in (part.x, part.y):
            point.at(axis.key, axis.range[1])
        if part.z is not None:
            for value in part.z.values:
                point.at(part.z.key, value)
    return AtlasTask(task, part)


def _with_limit(limits: Limits, name: str, value: float) -> Limits:
    return limits_of({**limits.given(), name: value}, limits.vehicle)


def _with_speed(state: BoundaryState, value: float, _: Placement | None) -> BoundaryState:
    velocity = np.asarray(state.velocity)
    return BoundaryState(state.position, velocity * (value / np.linalg.norm(velocity)))


def _with_heading(state: BoundaryState, value: float, _: Placement | None) -> BoundaryState:
    velocity = np.asarray(state.velocity)
    along = np.hypot(velocity[0], velocity[1]) * np.array([np.cos(value), np.sin(value)])
    return BoundaryState(state.position, np.append(along, velocity[2]))


def _with_radius(state: BoundaryState, value: float, placement: Placement | None) -> BoundaryState:
    place = Placement() if placement is None else placement
    local = np.asarray(place.to_local(state.position - place.origin))
    scaled: Any = np.append(local[:2] * (value / np.hypot(local[0], local[1])), local[2])
    return BoundaryState(place.origin + place.to_world(scaled), state.velocity)


CHANGES: dict[str, Callable[[BoundaryState, float, Placement | None], BoundaryState]] = {
    "speed": _with_speed,
    "heading": _with_heading,
    "radius": _with_radius,
}
"""How a boundary state gets another speed, heading or radius."""


def _unit(name: str) -> str:
    if name.startswith(LIMITS):
        return quantity(name.removeprefix(LIMITS)).unit or "1"
    if name not in UNITS:
        raise ValueError(f"the key {name!r} cannot change in an atlas: {suggestion(name, [*UNITS, 'limits.…'])}")
    return UNITS[name]
