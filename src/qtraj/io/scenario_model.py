"""The keys of a path scenario, for `qtraj tune` and `qtraj evaluate`, each with what it may hold."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model, model_validator

from qtraj.design.fitting.fit import BOUNDS, POSITION_SIGMA, VELOCITY_SIGMA
from qtraj.design.tuning.choices import MOTIONS, OBJECTIVES, either
from qtraj.io.scenario_part import (
    ABOUT,
    NAME,
    POSITIVE_SECONDS,
    TEXT,
    THREE,
    Counts,
    Part,
    Positive,
    Quaternion,
    RangeMap,
    Text,
    Vector,
    Wholes,
)
from qtraj.io.track_part import TrackPart
from qtraj.path.quantity import QUANTITIES, PathQuantity

if TYPE_CHECKING:  # a checker of types takes no names that are read from a registry
    Motion = str
    Objective = str
else:
    Motion = Literal[tuple(MOTIONS)]
    Objective = Literal[tuple(OBJECTIVES)]
Method = Literal["sqp", "lbfgs", "adam"]

MOTION = either(MOTIONS)
VARIABLES = "'start.V_rho', 'start.V_phi' (hermite), 'start.V_h', the same of 'end', 'duration'"
OBJECTIVE = either(OBJECTIVES)
METHOD = "'sqp', 'lbfgs' or 'adam'"


class FitPart(Part):
    """How the recording is fitted."""

    motion: Motion | None = Field(
        default=None,
        title="of the angle: a polynomial, or at a constant rate; that of [tune] if left out",
        description=MOTION,
    )
    position_sigma: Positive | None = Field(
        default=None,
        title=f"standard deviation of a recorded position; {POSITION_SIGMA} if left out",
        description="a positive finite number [m]",
    )
    velocity_sigma: Positive | None = Field(
        default=None,
        title=f"standard deviation of a recorded velocity; {VELOCITY_SIGMA} if left out",
        description="a positive finite number [m/s]",
    )
    radius_bounds: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = Field(
        default=None,
        title=f"least and largest radius about the axis; {BOUNDS[0]:g} and {BOUNDS[1]:g} mean radii if left out",
        description="two positive finite radii [low, high] [m]",
    )


class StatePart(Part):
    """A boundary state in world axes."""

    position: Vector = Field(title="where the vehicle is", description=f"{THREE} [m]")
    velocity: Vector = Field(title="how it moves", description=f"{THREE} [m/s]")
    acceleration: Vector | None = Field(
        default=None,
        title="its acceleration, of a hermite path alone and at both ends: ρ, φ, h are then quintics",
        description=f"{THREE} [m/s²]",
    )


class PlacementPart(Part):
    """Where the axis of a path between two boundary states stands."""

    origin: Vector = Field(title="where the axis stands", description=f"{THREE} [m], a point of the axis")
    orientation: Quaternion | None = Field(
        title="the direction of the axis; vertical if left out",
        default=None,
        description="a quaternion of four finite numbers, scalar first, from the path's axes to the world's",
    )


class LimitedPart(Part):
    """Upper bounds on path quantities, anywhere on the path."""

    def given(self) -> dict[str, float]:
        """The limits that are set, by name."""
        return {name: value for name, value in self.model_dump().items() if value is not None}


def _limit(entry: PathQuantity) -> Any:
    described = f"a positive finite number [{entry.label}]"
    number: Any = Positive
    return number | None, Field(default=None, title=entry.meaning, description=described)


_limits: dict[str, Any] = {name: _limit(entry) for name, entry in QUANTITIES.items()}
LimitsPart = create_model("LimitsPart", __base__=LimitedPart, __doc__=LimitedPart.__doc__, **_limits)
"""One key for each entry of the registry of path quantities."""


class TunePart(Part):
    """What is asked of the tuned path."""

    objective: Objective = Field(
        default="nearest",
        title="what is sought within the limits: the least change of the boundary velocities (not of the path), "
        "the least duration, or the least jerk",
        description=OBJECTIVE,
    )
    motion: Motion | None = Field(
        default=None,
        title="of the angle: at a constant rate, or a polynomial; if left out, 'hermite' of a [track] and 'uniform' of "
        "all else",
        description=MOTION,
    )
    duration: Positive | None = Field(
        default=None,
        title="first one of a hermite path, held where the smoothest is sought; if left out, that of the given rates",
        description=POSITIVE_SECONDS,
    )
    turns: Wholes | None = Field(
        default=None, title="whole turns about the axis besides", description="a whole number, 0 or more"
    )
    fixed: list[Text] = Field(
        default_factory=list,
        title=f"variables that keep their given value: {VARIABLES}; and 'start.heading', 'end.heading'",
        description='a list of names, as in fixed = ["end.V_h"]',
    )
    bounds: RangeMap = Field(
        default_factory=dict,
        title="between which values a variable must stay; what is not named may go as far as the search does",
        description="a table [tune.bounds] of [low, high] in m/s or s: duration = [4.0, 8.0], or of one of them alone: "
        'duration = {max = 8.0}, or {min = 4.0}; a name with a dot stands in quotes: "end.V_h" = [-0.5, 0.5]',
    )
    corridor: Positive | None = Field(
        default=None,
        title="largest distance from the given path, at equal parts of the durations and counted along the arc",
        description="a positive finite number [m]",
    )
    starts: Counts = Field(
        default=8, title="searches, from the given states and about them", description="a whole number, 1 or more"
    )
    method: Method = Field(
        default="sqp",
        title="how to search: sequential quadratic programming, much the fastest, or an augmented Lagrangian around "
        "an optimiser of optax, for comparison",
        description=METHOD,
    )
    max_steps: Counts | None = Field(
        default=None,
        title="steps of 'sqp', or rounds of the others, after which a search ends; 300 if left out",
        description="a whole number, 1 or more",
    )
    inner_steps: Counts | None = Field(
        default=None,
        title="steps of 'lbfgs' or 'adam' in one round; 200 if left out",
        description="a whole number, 1 or more",
    )
    learning_rate: Positive | None = Field(
        default=None,
        title="of 'adam', in reference speeds; 0.01 if left out",
        description="a positive finite number",
    )

    @model_validator(mode="after")
    def _options(self) -> "TunePart":
        if self.learning_rate is not None and self.method != "adam":
            raise ValueError(f"learning_rate belongs to method = 'adam', but the method is {self.method!r}")
        if self.inner_steps is not None and self.method == "sqp":
            raise ValueError("inner_steps belongs to method = 'lbfgs' or 'adam', but the method is 'sqp'")
        return self


class Scenario(Part):
    """A scenario: one path (a track, two boundary states, or a saved path), limits, and what tuning is to do."""

    name: Text | None = Field(default=None, title=NAME, description=TEXT)
    description: Text | None = Field(default=None, title=ABOUT, description=TEXT)
    track: TrackPart | None = Field(default=None, title="the path from a recording", description="a table [track]")
    fit: FitPart | None = Field(default=None, title="how the recording is fitted", description="a table [fit]")
    start: StatePart | None = Field(
        default=None, title="the path from two states: the first", description="a table [start]"
    )
    end: StatePart | None = Field(default=None, title="the path from two states: the last", description="a table [end]")
    path: Text | None = Field(
        default=None, title="the path from a file", description="the name of a saved path, relative to the scenario"
    )
    placement: PlacementPart | None = Field(
        default=None, title="the axis of a path from two states", description="a table [placement]"
    )
    duration: Positive | None = Field(
        default=None,
        title="of a path from two states; if left out, that of their rates about the axis",
        description=POSITIVE_SECONDS,
    )
    turns: Wholes | None = Field(
        default=None, title="of a path from two states: whole turns besides", description="a whole number, 0 or more"
    )
    limits: LimitsPart = Field(  # pyright: ignore[reportInvalidTypeForm]
        default=LimitsPart(), title="what tuning must keep", description="a table [limits]"
    )
    purpose: dict[str, Text] = Field(
        default_factory=dict,
        title="why there is a limit, for the tables",
        description="a table [purpose] of texts, one for each limit",
    )
    tune: TunePart = Field(default=TunePart(), title="what tuning is to do", description="a table [tune]")

    @property
    def motion(self) -> str:
        """The motion of the tuned path: as given, or what suits its source."""
        return self.tune.motion or ("uniform" if self.track is None else "hermite")

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
