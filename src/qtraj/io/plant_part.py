"""What surrounds the body in a scenario of `qtraj track`: its error at the start, disturbance, sensor, actuator."""

from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, model_validator
from pydantic_core import PydanticCustomError

from qtraj.io.attitude_part import AttitudePart
from qtraj.io.scenario_part import (
    POSITIVE_SECONDS,
    THREE,
    NotNegative,
    Number,
    Part,
    Positive,
    Vector,
    given,
    is_number,
)

INERTIA = "a positive finite number, three of them, or three rows of three finite numbers [kg m²]"
SEEDS = 2**63
"""Seeds of `jax.random` are smaller."""
AXIS_LIMIT = "a positive finite number, or three of them with saturation = 'axis', angle per s² (of a rate law per s)"


def _numbers(value: Any, rows: bool) -> Any:
    """A number, three of them, or with `rows` three by three, as they are."""
    flat = value if isinstance(value, list) else [value]
    if rows and flat and all(isinstance(row, list) and len(row) == 3 for row in flat):
        flat = [entry for row in flat for entry in row]
    sizes = (3, 9) if rows else (3,)
    if not all(map(is_number, flat)) or (isinstance(value, list) and len(flat) not in sizes):
        raise PydanticCustomError("numbers", "no such numbers")
    return value


def _inertia(value: Any) -> Any:
    return _numbers(value, rows=True)


def _limit(value: Any) -> Any:
    known = _numbers(value, rows=False)
    if min(known if isinstance(known, list) else [known]) <= 0:
        raise PydanticCustomError("numbers", "not positive")
    return known


class ErrorPart(AttitudePart):
    """How the body starts against the program, λ = λ⁰∘μ, in body axes; without an attitude on the program."""

    rate: Vector = Field(
        default=[0.0, 0.0, 0.0],
        title="the body's rate less the program's",
        description=f"{THREE}, angle per s: the body's less the program's",
    )
    sign: Literal["auto", "near", "far"] = Field(
        default="auto",
        title="which of λ and −λ, two errors of one attitude: the better one, that with μ0 ≥ 0, or the other; not for "
        "the baselines, which take both alike, and not 'far' with gauge = 'gibbs'",
        description="'auto', 'near' or 'far'",
    )
    gauge: Literal["unit", "gibbs"] = Field(
        default="unit",
        title="|λ| and ω0: 1 and 0, or such that the Gibbs vector of the error obeys the law's linear equation",
        description="'unit' or 'gibbs'",
    )


class DisturbancePart(Part):
    """An acceleration or a torque in body axes, constant, or sin(2πt/period + phase) times it."""

    acceleration: Vector | None = Field(
        default=None, title="angular acceleration", description=f"{THREE}, angle per s²"
    )
    torque: Vector | None = Field(default=None, title="torque, with inertia", description=f"{THREE} [N m]")
    inertia: Annotated[Any, PlainValidator(_inertia)] | None = Field(
        default=None, title="inertia of the body", description=INERTIA
    )
    period: Positive | None = Field(default=None, title="period of a sinusoid", description=POSITIVE_SECONDS)
    phase: Number = Field(default=0.0, title="phase of a sinusoid", description="a finite angle")

    @model_validator(mode="after")
    def _one(self) -> "DisturbancePart":
        if len(given(self, "acceleration", "torque")) != 1:
            raise ValueError("give one of acceleration, or torque and inertia")
        if (self.torque is None) != (self.inertia is None):
            raise ValueError("torque and inertia belong together: ε = J⁻¹M")
        if self.period is None and "phase" in self.model_fields_set:
            raise ValueError("the key 'phase' belongs to a period, and there is none")
        return self


class SensorPart(Part):
    """What measures attitude and rate, or gyros alone, with which the on-board computer propagates λ."""

    kind: Literal["state", "gyros"] = Field(default="state", title="what it is", description="'state' or 'gyros'")
    sampling: Positive | None = Field(
        default=None, title="sampling period; continuous without", description=POSITIVE_SECONDS
    )
    rate_bias: Vector = Field(default=[0.0, 0.0, 0.0], title="bias of the rate", description=f"{THREE}, angle per s")
    rate_noise: NotNegative = Field(
        default=0.0,
        title="standard deviation of the rate",
        description="a finite number, not negative, angle per s and sample",
    )
    attitude_bias: Vector = Field(
        default=[0.0, 0.0, 0.0],
        title="bias of the attitude",
        description=f"{THREE}, angles: of gyros, at the start alone",
    )
    attitude_noise: NotNegative = Field(
        default=0.0,
        title="standard deviation of the attitude, of no gyros",
        description="a finite angle, not negative, per sample",
    )
    seed: Annotated[int, Field(ge=0, lt=SEEDS)] = Field(
        default=0, title="of the noise, which it determines", description="a whole number from 0 to 2⁶³ − 1"
    )

    @model_validator(mode="after")
    def _sampled(self) -> "SensorPart":
        noise = self.rate_noise or self.attitude_noise
        if self.sampling is None and (noise or self.kind == "gyros"):
            raise ValueError("the key 'sampling' is missing: noise and gyros need a sampling period [s]")
        if self.kind == "gyros" and self.attitude_noise:
            raise ValueError("the key 'attitude_noise' suits no gyros, which measure no attitude")
        return self


class ActuatorPart(Part):
    """Limit of the physical command, and how long a command is held."""

    limit: Annotated[Any, PlainValidator(_limit)] | None = Field(
        default=None, title="limit of the command", description=AXIS_LIMIT
    )
    saturation: Literal["norm", "axis"] = Field(
        default="norm", title="whether the length or each component is limited", description="'norm' or 'axis'"
    )
    sampling: Positive | None = Field(
        default=None, title="how long a command is held; continuous without", description=POSITIVE_SECONDS
    )

    @model_validator(mode="after")
    def _per_axis(self) -> "ActuatorPart":
        if isinstance(self.limit, list) and self.saturation == "norm":
            raise ValueError("a limit of each axis needs saturation = 'axis'")
        return self
