"""The feedback law in a scenario of `qtraj track`, with its gains in one of several forms."""

from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, model_validator
from pydantic_core import PydanticCustomError

from qtraj.io.scenario_part import POSITIVE_SECONDS, NotNegative, Part, Positive, given, is_number

Kind = Literal["body", "inertial", "additive", "rate", "quaternion", "geometric", "logarithmic"]

KIND = "'body', 'inertial', 'additive', 'rate', 'quaternion', 'geometric' or 'logarithmic'"
LINEAR = ("body", "inertial", "additive")
"""Acceleration laws with an exactly linear error."""
BASELINES = ("quaternion", "geometric", "logarithmic")
"""Established feedbacks, whose error is not linear."""
FORMS = ("k1", "k", "settling_time", "damping", "weights")
WAYS = "k1 and k2, or settling_time, or damping and frequency, or [law.weights]"
GAIN = "a positive finite number, a list of finite numbers for a diagonal, or a square matrix of them"


def _gain(value: Any) -> Any:
    """A positive number, a row of numbers, or rows of them as long as there are rows; whether these make a stable law
    their entries do not tell."""
    rows = value if isinstance(value, list) else [value]
    square = all(isinstance(row, list) and len(row) == len(rows) for row in rows)
    entries = [entry for row in rows for entry in row] if square else rows
    positive = isinstance(value, list) or (is_number(value) and value > 0)
    if not entries or not all(map(is_number, entries)) or not positive:
        raise PydanticCustomError("gain", "no gain")
    return value


Gain = Annotated[Any, PlainValidator(_gain)]


class WeightsPart(Part):
    """Weights of the linear-quadratic regulator, which minimises ∫(error x² + rate ẋ² + command ẍ²)dt."""

    error: Positive = Field(title="weight of the error", description="a positive finite number [1/s⁴]")
    rate: NotNegative = Field(
        default=0.0, title="weight of its rate", description="a finite number [1/s²], not negative"
    )
    command: Positive = Field(default=1.0, title="weight of the command", description="a positive finite number")


class FeedbackPart(Part):
    """The feedback law and its gains, in one of several forms.

    Of 'body', 'inertial' and 'additive' the error x obeys ẍ + k1ẋ + k2x = 0, of 'rate' ẋ + kx = 0; 'quaternion',
    'geometric' and 'logarithmic' are established baselines. Gains: k1 and k2, or settling_time, or damping and
    frequency, or [law.weights]; of 'rate' k or settling_time.
    """

    kind: Kind = Field(default="body", title="the law", description=KIND)
    k1: Gain | None = Field(default=None, title="gain on the rate of the error", description=f"{GAIN} [1/s]")
    k2: Gain | None = Field(default=None, title="gain on the error", description=f"{GAIN} [1/s²]")
    k: Gain | None = Field(default=None, title="gain of the rate law", description=f"{GAIN} [1/s]")
    settling_time: Positive | None = Field(
        default=None, title="critically damped: the time to 'residual'", description=POSITIVE_SECONDS
    )
    residual: Annotated[float, Field(gt=0, lt=1)] = Field(
        default=0.02, title="part of the error left at settling_time", description="a number between 0 and 1"
    )
    damping: Positive | None = Field(
        default=None, title="damping ratio", description="a positive finite number, the damping ratio"
    )
    frequency: Positive | None = Field(
        default=None, title="natural frequency", description="a positive finite number [1/s], undamped"
    )
    weights: WeightsPart | None = Field(
        default=None, title="weights of a quadratic regulator", description="a table [law.weights]"
    )

    @model_validator(mode="after")
    def _one_form(self) -> "FeedbackPart":
        for a, b in (("k1", "k2"), ("damping", "frequency")):
            if (getattr(self, a) is None) != (getattr(self, b) is None):
                missing = b if getattr(self, b) is None else a
                raise ValueError(f"the key '{missing}' is missing: {a} and {b} belong together")
        forms = given(self, *FORMS)
        ways = "k or settling_time" if self.kind == "rate" else WAYS
        if len(forms) != 1:
            found = f"there are several gains ({', '.join(forms)})" if forms else "there are no gains"
            raise ValueError(f"{found}: give one of {ways}")
        allowed = ("k", "settling_time") if self.kind == "rate" else ("k1", "settling_time", "damping", "weights")
        if forms[0] not in allowed:
            raise ValueError(f"the key '{forms[0]}' does not suit the kind '{self.kind}': give {ways}")
        if self.settling_time is None and "residual" in self.model_fields_set:
            raise ValueError("the key 'residual' belongs to settling_time, and there is none")
        return self

    @model_validator(mode="after")
    def _fitting(self) -> "FeedbackPart":
        size = 4 if self.kind in (*LINEAR, "rate") else 3
        for name in given(self, "k1", "k2", "k"):
            value = getattr(self, name)
            if isinstance(value, list) and len(value) != size:
                raise ValueError(
                    f"the key '{name}' holds a gain of size {len(value)}, but expected a number, {size} for a "
                    f"diagonal, or {size} × {size} for a law of the kind '{self.kind}'"
                )
        return self
