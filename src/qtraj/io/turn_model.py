"""The keys of a turn, for `qtraj turn` and for the program of `qtraj track`."""

from typing import Literal

from pydantic import Field, model_validator

from qtraj.io.attitude_part import KnownAttitudePart
from qtraj.io.scenario_part import (
    ABOUT,
    ANGLES,
    NAME,
    TEXT,
    UNIT,
    Angles,
    Number,
    Part,
    Positive,
    Text,
    Vector,
    given,
)
from qtraj.motion.dynamics import inertia_matrix

Kind = Literal["time_optimal", "s_curve", "cubic", "quintic", "septic"]

KIND = "'time_optimal', 's_curve', 'cubic', 'quintic' or 'septic'"
LIMITS = ("max_rate", "max_acceleration", "max_jerk")
END_RATES = ("start_rate", "end_rate")
NEEDED = {"time_optimal": ("max_acceleration",), "s_curve": ("max_acceleration", "max_jerk")}
"""Of laws that no duration alone determines."""
JERKY = ("time_optimal", "cubic")
"""Laws whose acceleration jumps, within the turn or at its ends: no jerk limit holds."""


class TurnLawPart(Part):
    """How the angle of each turn proceeds in time.

    A time_optimal turn needs max_acceleration, an s_curve max_acceleration and max_jerk; the polynomials (cubic,
    quintic, septic) need a limit or a duration. With limits alone the turn takes the least time within them.
    """

    kind: Kind = Field(default="time_optimal", title="the law", description=KIND)
    max_rate: Positive | None = Field(
        default=None, title="limit of the rate", description="a positive finite number, angle per s"
    )
    max_acceleration: Positive | None = Field(
        default=None, title="limit of the acceleration", description="a positive finite number, angle per s²"
    )
    max_jerk: Positive | None = Field(
        default=None,
        title="limit of the jerk, of laws whose acceleration does not jump: s_curve, quintic, septic",
        description="a positive finite number, angle per s³",
    )
    duration: Positive | None = Field(
        default=None,
        title="what each turn takes; a polynomial is then made without its limits, and judged by them",
        description="a positive finite number [s], of each turn",
    )
    start_rate: Number | None = Field(
        default=None,
        title="rate at which a time_optimal turn starts; 0 if left out",
        description="a finite number, angle per s along the turn",
    )
    end_rate: Number | None = Field(
        default=None,
        title="rate at which a time_optimal turn ends; 0 if left out",
        description="a finite number, angle per s along the turn",
    )

    @model_validator(mode="after")
    def _suiting(self) -> "TurnLawPart":
        needed = NEEDED.get(self.kind)
        for name in needed or ():
            if getattr(self, name) is None:
                raise ValueError(f"the key '{name}' is missing: a turn of the kind '{self.kind}' needs it")
        if self.kind in JERKY and self.max_jerk is not None:
            other = "'s_curve'" if self.kind == "time_optimal" else "'quintic', 'septic' or 's_curve'"
            raise ValueError(f"a {self.kind} turn has jumps of acceleration and no jerk limit: take kind = {other}")
        if self.kind != "time_optimal" and (extra := given(self, *END_RATES)):
            raise ValueError(
                f"the key '{extra[0]}' belongs to 'time_optimal': a turn of the kind '{self.kind}' rests at its ends"
            )
        if needed is None and not given(self, *LIMITS, "duration"):
            limits = LIMITS[:2] if self.kind in JERKY else LIMITS
            raise ValueError(f"a {self.kind} turn needs a duration or a limit: {', '.join(limits)}")
        for name in given(self, *END_RATES):
            if self.max_rate is not None and abs(getattr(self, name)) > self.max_rate:
                raise ValueError(
                    f"the key '{name}' holds {getattr(self, name)!r}, but expected no more than max_rate = "
                    f"{self.max_rate!r}"
                )
        return self


class BodyPart(Part):
    """The body that turns: its inertia, and how much torque there is."""

    inertia: Positive | Vector | list[Vector] = Field(
        title="moment of inertia of a spherical body, principal moments, or the tensor, in body axes [kg m²]",
        description="a positive number, three of them, or three rows of three",
    )
    max_torque: Positive | Vector | None = Field(
        default=None,
        title="limit of the torque [N m]: of its length, or of each component in body axes; the turn slows to keep it",
        description="a positive number, or three of them",
    )

    @model_validator(mode="after")
    def _physical(self) -> "BodyPart":
        try:
            inertia_matrix(self.inertia)
        except ValueError as error:
            raise ValueError(f"the key 'inertia' holds {self.inertia!r}: {error}") from error
        if isinstance(self.max_torque, list) and not all(m > 0 for m in self.max_torque):
            raise ValueError(f"the key 'max_torque' holds {self.max_torque!r}, but expected positive numbers [N m]")
        return self


class TurnPart(Part):
    """A turn from [start] to [end], by way of any [[via]], under a [law]: the shorter way about a fixed axis each."""

    start: KnownAttitudePart = Field(title="the first attitude", description="a table [start] with an attitude")
    via: list[KnownAttitudePart] = Field(
        default_factory=list,
        title="attitudes in between, at rest at each",
        description="tables [[via]], an attitude each",
    )
    end: KnownAttitudePart = Field(title="the last attitude", description="a table [end] with an attitude")
    law: TurnLawPart = Field(title="how the angle proceeds", description="a table [law]")
    body: BodyPart | None = Field(
        default=None, title="the body, for torques and their limit", description="a table [body]"
    )

    @model_validator(mode="after")
    def _resting(self) -> "TurnPart":
        if self.via and (extra := given(self.law, *END_RATES)):
            raise ValueError(f"the key 'law.{extra[0]}' suits no chain of turns, which rests at each attitude")
        return self

    def attitudes(self) -> dict[str, KnownAttitudePart]:
        """All attitudes in their order, by the names of their tables."""
        return {"start": self.start} | {f"via[{k}]": part for k, part in enumerate(self.via)} | {"end": self.end}


class TurnScenario(TurnPart):
    """A turn from [start] to [end], by way of any [[via]], under a [law]: the shorter way about a fixed axis each."""

    name: Text | None = Field(default=None, title=NAME, description=TEXT)
    description: Text | None = Field(default=None, title=ABOUT, description=TEXT)
    angles: Angles = Field(title=UNIT, description=ANGLES)
