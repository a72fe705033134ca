"""The keys of a turn, for `qtraj turn` and for the program of `qtraj track`."""

from typing import Literal

from pydantic import Field, model_validator

from qtraj.io.attitude_part import KnownAttitudePart
from qtraj.io.scenario_part import ANGLES, TEXT, Angles, Number, Part, Positive, Text, given

Kind = Literal["time_optimal", "s_curve", "cubic", "quintic", "septic"]

KIND = "'time_optimal', 's_curve', 'cubic', 'quintic' or 'septic'"
LIMITS = ("max_rate", "max_acceleration", "max_jerk")
END_RATES = ("start_rate", "end_rate")
NEEDED = {"time_optimal": ("max_acceleration",), "s_curve": ("max_acceleration", "max_jerk")}
"""Of laws that no duration alone determines."""


class TurnLawPart(Part):
    """[law] of a turn: how the angle proceeds in time."""

    kind: Kind = Field(default="time_optimal", description=KIND)
    max_rate: Positive | None = Field(default=None, description="a positive finite number, angle per s")
    max_acceleration: Positive | None = Field(default=None, description="a positive finite number, angle per s²")
    max_jerk: Positive | None = Field(default=None, description="a positive finite number, angle per s³")
    duration: Positive | None = Field(default=None, description="a positive finite number [s], of each turn")
    start_rate: Number | None = Field(default=None, description="a finite number, angle per s along the turn")
    end_rate: Number | None = Field(default=None, description="a finite number, angle per s along the turn")

    @model_validator(mode="after")
    def _suiting(self) -> "TurnLawPart":
        needed = NEEDED.get(self.kind)
        for name in needed or ():
            if getattr(self, name) is None:
                raise ValueError(f"the key '{name}' is missing: a turn of the kind '{self.kind}' needs it")
        if self.kind == "time_optimal" and self.max_jerk is not None:
            raise ValueError("a time_optimal turn has jumps of acceleration and no jerk limit: take kind = 's_curve'")
        if self.kind != "time_optimal" and (extra := given(self, *END_RATES)):
            raise ValueError(
                f"the key '{extra[0]}' belongs to 'time_optimal': a turn of the kind '{self.kind}' rests at its ends"
            )
        if needed is None and not given(self, *LIMITS, "duration"):
            raise ValueError(f"a {self.kind} turn needs a duration or a limit: {', '.join(LIMITS)}")
        for name in given(self, *END_RATES):
            if self.max_rate is not None and abs(getattr(self, name)) > self.max_rate:
                raise ValueError(
                    f"the key '{name}' holds {getattr(self, name):g}, but expected no more than max_rate = "
                    f"{self.max_rate:g}"
                )
        return self


class TurnPart(Part):
    """A turn from [start] to [end], by way of any [[via]], under a [law]."""

    start: KnownAttitudePart = Field(description="a table [start] with an attitude")
    via: list[KnownAttitudePart] = Field(default_factory=list, description="tables [[via]], an attitude each")
    end: KnownAttitudePart = Field(description="a table [end] with an attitude")
    law: TurnLawPart = Field(description="a table [law]")

    @model_validator(mode="after")
    def _resting(self) -> "TurnPart":
        if self.via and (extra := given(self.law, *END_RATES)):
            raise ValueError(f"the key 'law.{extra[0]}' suits no chain of turns, which rests at each attitude")
        return self


class TurnScenario(TurnPart):
    """A scenario of `qtraj turn`."""

    name: Text | None = Field(default=None, description=TEXT)
    description: Text | None = Field(default=None, description=TEXT)
    angles: Angles = Field(description=ANGLES)
