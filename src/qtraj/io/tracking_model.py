"""The keys of a scenario of `qtraj track`: a program, a law, and what surrounds the body."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from qtraj.io.feedback_part import BASELINES, FeedbackPart
from qtraj.io.plant_part import ActuatorPart, DisturbancePart, ErrorPart, SensorPart
from qtraj.io.scenario_part import (
    ABOUT,
    ANGLES,
    NAME,
    POSITIVE_SECONDS,
    TEXT,
    THREE,
    UNIT,
    Angles,
    Number,
    Part,
    Positive,
    Text,
    Vector,
    given,
)
from qtraj.io.turn_model import TurnPart

Frame = Literal["natural", "upright", "rotation-minimizing", "rotation_minimizing", "thrust-aligned", "thrust_aligned"]

FRAME = "'upright', 'natural', 'rotation-minimizing' or 'thrust-aligned'"
MOST_SAMPLES = 100_000
SOURCES = "[program.turn], path = 'a path scenario or a saved path', or file = 'a saved program'"


class ProgramPart(Part):
    """What the attitude shall be: a turn, the frame of a path, or a saved program."""

    turn: TurnPart | None = Field(
        default=None, title="a turn within limits, all of which it must keep", description="a table [program.turn]"
    )
    path: Text | None = Field(
        default=None,
        title="a path whose frame is the program",
        description="the name of a path scenario or a saved path, relative to the scenario",
    )
    frame: Frame | None = Field(
        default=None,
        title="frame of the path: x forward, y left, z up ('upright', if left out); tangent, principal normal, "
        "binormal, which flips over where the bend changes sides ('natural'); one that never rolls; or that of a "
        "multirotor, z along its thrust",
        description=FRAME,
    )
    up: Vector | None = Field(default=None, title="direction of the upright frame; [0, 0, 1]", description=THREE)
    heading: Number | None = Field(
        default=None,
        title="heading of the thrust-aligned frame, from world x towards world y; along the velocity if left out",
        description="a finite angle, the heading of the thrust-aligned frame",
    )
    file: Text | None = Field(
        default=None,
        title="a program such as the program.toml of qtraj turn",
        description="the name of a saved program, relative to the scenario",
    )

    @model_validator(mode="after")
    def _one(self) -> "ProgramPart":
        sources = given(self, "turn", "path", "file")
        if len(sources) != 1:
            found = f"there are several programs ({', '.join(sources)})" if sources else "there is no program"
            raise ValueError(f"{found}: give one of {SOURCES}")
        if self.path is None and (extra := given(self, "frame", "up", "heading")):
            raise ValueError(f"the key '{extra[0]}' belongs to a path, and there is none")
        if self.up is not None and ((self.frame or "upright") != "upright" or not any(self.up)):
            raise ValueError("the key 'up' belongs to frame = 'upright', and is a direction other than 0")
        if self.heading is not None and (self.frame or "").replace("_", "-") != "thrust-aligned":
            raise ValueError("the key 'heading' belongs to frame = 'thrust-aligned'")
        return self


class SimulationPart(Part):
    """Times and tolerances."""

    duration: Positive | None = Field(
        default=None,
        title="time simulated; that of the program if left out, and longer only where the program comes to rest",
        description=POSITIVE_SECONDS,
    )
    samples: Annotated[int, Field(ge=2, le=MOST_SAMPLES)] = Field(
        default=601,
        title="instants of the table; --samples goes before it",
        description=f"a whole number from 2 to {MOST_SAMPLES}, the instants of the table",
    )
    settled: Positive | None = Field(
        default=None,
        title="error within which the loop has settled; 1° if left out",
        description="a positive finite angle, within which it has settled",
    )
    rtol: Annotated[float, Field(ge=1e-14, le=1e-2)] = Field(
        default=1e-10, title="relative tolerance of a step", description="a number from 1e-14 to 1e-2"
    )
    atol: Annotated[float, Field(ge=1e-16, le=1e-2)] = Field(
        default=1e-12, title="absolute tolerance of a step", description="a number from 1e-16 to 1e-2"
    )


class TrackingScenario(Part):
    """A body that a feedback law makes follow a program, with what disturbs, measures and acts."""

    name: Text | None = Field(default=None, title=NAME, description=TEXT)
    description: Text | None = Field(default=None, title=ABOUT, description=TEXT)
    angles: Angles = Field(title=UNIT, description=ANGLES)
    program: ProgramPart = Field(title="what the attitude shall be", description="a table [program]")
    law: FeedbackPart = Field(title="the feedback", description="a table [law]")
    error: ErrorPart = Field(default=ErrorPart(), title="how the body starts", description="a table [error]")
    disturbance: DisturbancePart | None = Field(
        default=None, title="what acts besides the command", description="a table [disturbance]"
    )
    sensor: SensorPart | None = Field(
        default=None, title="what the computer knows of the body; all if left out", description="a table [sensor]"
    )
    actuator: ActuatorPart | None = Field(
        default=None, title="what the body gets of a command; all if left out", description="a table [actuator]"
    )
    simulation: SimulationPart = Field(
        default=SimulationPart(), title="times and tolerances", description="a table [simulation]"
    )

    @model_validator(mode="after")
    def _suiting(self) -> "TrackingScenario":
        if self.law.kind == "rate":
            if self.disturbance is not None:
                raise ValueError("[disturbance] suits no law of the kind 'rate', which commands the rate itself")
            if self.sensor is not None and self.sensor.kind == "gyros":
                raise ValueError("[sensor] of the kind 'gyros' suits no law of the kind 'rate', whose rate jumps")
            if any(self.error.rate):
                raise ValueError("the key 'error.rate' suits no law of the kind 'rate', which commands the rate itself")
        if self.error.gauge == "gibbs" and self.law.kind not in ("body", "inertial"):
            raise ValueError("error.gauge = 'gibbs' belongs to laws of the kinds 'body' and 'inertial'")
        if self.error.gauge == "gibbs" and self.error.sign == "far":
            raise ValueError("error.sign = 'far' contradicts error.gauge = 'gibbs', which has μ0 = 1: leave one out")
        if self.law.kind in BASELINES and "sign" in self.error.model_fields_set:
            raise ValueError(
                f"the key 'error.sign' suits no law of the kind '{self.law.kind}', which takes λ and −λ alike"
            )
        samplings = [p.sampling for p in (self.sensor, self.actuator) if p is not None and p.sampling is not None]
        if len(set(samplings)) > 1:
            raise ValueError("sensor.sampling and actuator.sampling differ: give both the same period, or one of them")
        return self
