"""The keys of a path scenario, for `qtraj tune` and `qtraj evaluate`, each with what it may hold."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from qtraj.io.scenario_part import (
    POSITIVE_SECONDS,
    TEXT,
    THREE,
    Number,
    Part,
    Positive,
    Quaternion,
    Text,
    Vector,
    Wholes,
)

Motion = Literal["uniform", "hermite"]
Objective = Literal["nearest", "fastest", "smoothest"]

MOTION = "'uniform' or 'hermite'"
OBJECTIVE = "'nearest', 'fastest' or 'smoothest'"


class TrackPart(Part):
    """[track]: a window of a recording."""

    file: Text = Field(description="the name of a text file, relative to the scenario")
    window: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="two finite times [t0, t1] in seconds on the recording's own clock"
    )
    columns: dict[Literal["time", "position", "velocity", "attitude"], Text | list[Text]] | None = Field(
        default=None,
        description="column names of 'time', 'position', 'velocity' or 'attitude'; an empty list leaves a part out",
    )
    source: Text | None = Field(default=None, description="a text: where the recording comes from, and its licence")

    @model_validator(mode="after")
    def _ordered(self) -> "TrackPart":
        if self.window is not None and not self.window[0] < self.window[1]:
            raise ValueError(f"the key 'window' holds {self.window}, but expected [t0, t1] with t0 < t1")
        return self


class FitPart(Part):
    """[fit]: how the recording is fitted; what is left out takes the defaults of `qtraj.fit`."""

    motion: Motion | None = Field(default=None, description=MOTION)
    position_sigma: Positive | None = Field(default=None, description="a positive finite number [m]")
    velocity_sigma: Positive | None = Field(default=None, description="a positive finite number [m/s]")
    radius_bounds: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="two positive finite radii [low, high] [m]"
    )


class StatePart(Part):
    """[start] or [end]: a boundary state in world axes."""

    position: Vector = Field(description=f"{THREE} [m]")
    velocity: Vector = Field(description=f"{THREE} [m/s]")
    acceleration: Vector | None = Field(default=None, description=f"{THREE} [m/s²]")


class PlacementPart(Part):
    """[placement]: where the axis of the path stands."""

    origin: Vector = Field(description=f"{THREE} [m], a point of the axis")
    orientation: Quaternion | None = Field(
        default=None,
        description="a quaternion of four finite numbers, scalar first, from the path's axes to the world's",
    )


class LimitsPart(Part):
    """[limits]: upper bounds on magnitudes along the path."""

    curvature: Positive | None = Field(default=None, description="a positive finite number [1/m]")
    torsion: Positive | None = Field(default=None, description="a positive finite number [1/m]")
    speed: Positive | None = Field(default=None, description="a positive finite number [m/s]")
    acceleration: Positive | None = Field(default=None, description="a positive finite number [m/s²]")
    lateral_acceleration: Positive | None = Field(default=None, description="a positive finite number [m/s²]")
    longitudinal_acceleration: Positive | None = Field(default=None, description="a positive finite number [m/s²]")
    slope: Positive | None = Field(default=None, description="a positive finite number [-], rise over run")
    angular_rate: Positive | None = Field(default=None, description="a positive finite number [rad/s]")
    angular_acceleration: Positive | None = Field(default=None, description="a positive finite number [rad/s²]")

    def given(self) -> dict[str, float]:
        """The limits that are set, by name."""
        return {name: value for name, value in self.model_dump().items() if value is not None}


class TunePart(Part):
    """[tune]: what is asked of the tuned path."""

    objective: Objective = Field(default="nearest", description=OBJECTIVE)
    motion: Motion = Field(default="uniform", description=MOTION)
    duration: Positive | None = Field(default=None, description=POSITIVE_SECONDS)
    turns: Wholes | None = Field(default=None, description="a whole number, 0 or more")


class Scenario(Part):
    """A scenario: one path (a track, two boundary states, or a saved path), limits, and what tuning is to do."""

    name: Text | None = Field(default=None, description=TEXT)
    description: Text | None = Field(default=None, description=TEXT)
    track: TrackPart | None = Field(default=None, description="a table [track]")
    fit: FitPart | None = Field(default=None, description="a table [fit]")
    start: StatePart | None = Field(default=None, description="a table [start]")
    end: StatePart | None = Field(default=None, description="a table [end]")
    path: Text | None = Field(default=None, description="the name of a saved path, relative to the scenario")
    placement: PlacementPart | None = Field(default=None, description="a table [placement]")
    duration: Positive | None = Field(default=None, description=POSITIVE_SECONDS)
    turns: Wholes | None = Field(default=None, description="a whole number, 0 or more")
    limits: LimitsPart = Field(default=LimitsPart(), description="a table [limits]")
    purpose: dict[str, Text] = Field(default_factory=dict, description="a table [purpose] of texts, one for each limit")
    tune: TunePart = Field(default=TunePart(), description="a table [tune]")

    @model_validator(mode="after")
    def _one_path(self) -> "Scenario":
        states = [name for name in ("start", "end") if getattr(self, name) is not None]
        sources = [name for name in ("track", *states, "path") if getattr(self, name) is not None]
        if not sources:
            raise ValueError('there is no path: give [track], or [start] and [end], or path = "a saved path"')
        if len(states) == 1 and len(sources) == 1:
            raise ValueError(f"[{states[0]}] stands alone: [{'end' if states == ['start'] else 'start'}] is missing")
        if len(sources) > 1 and sources != ["start", "end"]:
            raise ValueError(f"there are several paths ({', '.join(sources)}): give one of track, start and end, path")
        return self

    @model_validator(mode="after")
    def _belonging(self) -> "Scenario":
        if self.fit is not None and self.track is None:
            raise ValueError("[fit] belongs to a [track], and there is none")
        for name in ("placement", "duration", "turns"):
            if getattr(self, name) is not None and self.start is None:
                raise ValueError(f"{name} belongs to [start] and [end]: a track or a saved path has its own")
        if self.tune.turns is not None and self.start is None:
            raise ValueError("tune.turns belongs to [start] and [end]: a track or a saved path has its own turn")
        for name in ("duration", "turns"):
            if getattr(self, name) is not None and getattr(self.tune, name) is not None:
                raise ValueError(f"{name} and tune.{name} are the same thing: give one of them")
        return self

    @model_validator(mode="after")
    def _purposes(self) -> "Scenario":
        if extra := sorted(set(self.purpose) - set(self.limits.given())):
            raise ValueError(f"purpose.{extra[0]}: [limits] has no {extra[0]!r} that could have a purpose")
        return self
