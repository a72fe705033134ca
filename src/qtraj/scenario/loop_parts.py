"""Define the scenario tables of a closed loop: law, gains, initial error, sensor and actuator."""

from collections.abc import Iterator
from typing import Annotated, Literal

import jax
import jax.numpy as jnp
import numpy as np
from pydantic import Field

from qtraj.foundation.naming import naming
from qtraj.foundation.types import Quat
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.baselines import QuaternionFeedback
from qtraj.motion.control.feedback_law import LAWS, feedback_law
from qtraj.motion.control.gains import RESIDUAL
from qtraj.motion.control.hysteresis import HALF_WIDTH, HystereticLaw
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw
from qtraj.motion.control.quaternion_sign import place
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.sensor import AbstractSensor, Gyros, Sensor
from qtraj.scenario import keys
from qtraj.scenario.keys import AttitudePart, Part, key, one_of, radians

GAIN = "a positive finite number, a list of finite numbers for a diagonal, or a square matrix of finite numbers"
SEEDS = 2**63
"""Exclusive upper bound of the seeds of `jax.random`."""
AXIS_LIMIT = "a positive finite number, or three with saturation = 'axis' [angle/s², or angle/s for a rate law]"


Gain = Annotated[keys.Positive | list[keys.Number] | list[list[keys.Number]], Field(description=GAIN)]
"""Lists and matrices may contain negative numbers, because gains of unstable loops are allowed."""


class WeightsPart(Part):
    """The weights of the linear-quadratic regulator, which minimises ∫(w_e x² + w_r ẋ² + w_c ẍ²) dt.

    x is the error. The keys error, rate and command are the weights w_e, w_r and w_c.
    """

    error: keys.Positive = key("weight of the error", unit="1/s⁴")
    rate: keys.NotNegative = key("weight of the rate of the error", 0.0, unit="1/s²")
    command: keys.Positive = key("weight of the command", 1.0)


class HysteresisPart(Part):
    """A stored sign of λ, which changes with hysteresis, so that noise near a half turn causes no chattering.

    The law uses hλ with h = ±1. At each update, h changes if hμ0 < −half_width·|μ|, with the error quaternion μ.
    """

    half_width: Annotated[float, Field(ge=0, lt=1)] = key(
        "half-width of the hysteresis; 0 selects the nearer of λ and −λ",
        HALF_WIDTH,
        values="a number from 0 to below 1",
    )
    sampling: keys.Seconds | None = key(
        "period of the updates; default: that of the sensor or of the actuator, one of which must be sampled", None
    )


class FeedbackPart(Part):
    """The feedback law and its gains.

    With the laws 'body', 'inertial' and 'additive', the error x satisfies ẍ + k1ẋ + k2x = 0; with the law 'rate', it
    satisfies ẋ + kx = 0. The laws 'quaternion', 'geometric' and 'logarithmic' are established laws, for comparison.
    Specify the gains in one of four ways: k1 and k2, settling_time, damping and frequency, or [law.weights]. The law
    'rate' needs k or settling_time.
    """

    kind: Annotated[str, one_of(LAWS)] = key("the feedback law", "body")
    k1: Gain | None = key("gain of the rate of the error", None, unit="1/s")
    k2: Gain | None = key("gain of the error", None, unit="1/s²")
    k: Gain | None = key("gain of the rate law", None, unit="1/s")
    settling_time: keys.Seconds | None = key(
        "time in which the error decays to the fraction 'residual' of its initial value", None
    )
    residual: Annotated[float, Field(gt=0, lt=1)] | None = key(
        f"fraction of the initial error at settling_time; default: {RESIDUAL}", None, values="a number between 0 and 1"
    )
    damping: keys.Positive | None = key("damping ratio", None)
    frequency: keys.Positive | None = key("undamped natural frequency", None, unit="rad/s")
    weights: WeightsPart | None = key("weights of a linear-quadratic regulator", None, values="a table [law.weights]")
    hysteresis: HysteresisPart | None = key(
        "hysteresis of the sign of λ; only with the laws 'body', 'inertial', 'additive' and 'quaternion'",
        None,
        values="a table [law.hysteresis], which may be empty",
    )

    def _faults(self) -> Iterator[str]:
        bare = self.bare_law()  # raises for gains that are not valid
        if self.hysteresis is not None and not isinstance(bare, AccelerationLaw | QuaternionFeedback):
            yield (
                f"'hysteresis' cannot be used with a law of kind '{self.kind}': use 'body', 'inertial', 'additive' or "
                "'quaternion'"
            )

    def bare_law(self) -> AbstractLaw:
        """Return the feedback law without its hysteresis."""
        return feedback_law(**self.model_dump(exclude_none=True, exclude={"hysteresis"}))

    def law(self) -> AbstractLaw:
        """Return the feedback law."""
        return self.with_hysteresis(self.bare_law())

    def with_hysteresis(self, law: AbstractLaw) -> AbstractLaw:
        """Return a law with the hysteresis of this table, if it has one and the law allows it."""
        if self.hysteresis is None or not isinstance(law, AccelerationLaw | QuaternionFeedback):
            return law
        return HystereticLaw(law, self.hysteresis.half_width, self.hysteresis.sampling)


class ErrorPart(AttitudePart):
    """The initial error μ: λ = λ⁰∘μ for the quaternions λ of body and λ⁰ of program; without an attitude, μ = 1."""

    rate: keys.Vector = key("rate of the body minus rate of the program, in body axes", [0.0, 0.0, 0.0], unit="angle/s")
    sign: Literal["auto", "near", "far"] = key(
        "sign of the initial λ: 'near' (μ0 ≥ 0), 'far' (μ0 ≤ 0) or 'auto' (the sign with the larger minimum of |μ|; "
        "for the law 'additive', the same as 'near'). 'far' cannot be combined with normalization = 'gibbs'. Not for "
        "the laws 'quaternion', 'geometric' and 'logarithmic'",
        "auto",
    )
    normalization: Literal["unit", "gibbs"] = key(
        "initial norm |λ| and virtual rate ω0: 'unit' (|λ| = 1, ω0 = 0), or 'gibbs' (the Gibbs vector g of the error "
        "satisfies g̈ + k1ġ + k2g = 0, or ġ + kg = 0 with the law 'rate')",
        "unit",
    )

    def state(self, angles: str, start: Attitude, law: AbstractLaw) -> tuple[Quat, Quat]:
        """Return the initial λ and ω, for the initial attitude `start` of the program."""
        rate = radians(angles) * jnp.asarray(self.rate)
        with naming("the key 'error.normalization': "):
            return place(law, start, self.unit_quaternion(angles), rate, self.sign, self.normalization)


class SensorPart(Part):
    """A sensor of attitude and rate, or gyros with which the on-board computer propagates λ."""

    kind: Literal["state", "gyros"] = key("the kind of sensor", "state")
    sampling: keys.Seconds | None = key("sampling period; default: continuous", None)
    rate_bias: keys.Vector = key("bias of the measured rate, in body axes", [0.0, 0.0, 0.0], unit="angle/s")
    rate_noise: keys.NotNegative = key("standard deviation of the rate noise about each axis", 0.0, unit="angle/s")
    attitude_bias: keys.Vector = key(
        "attitude bias, a rotation vector in body axes; for gyros, the error of the initial attitude estimate",
        [0.0, 0.0, 0.0],
        unit="angle",
    )
    attitude_noise: keys.NotNegative = key(
        "standard deviation of the attitude noise about each axis; not for gyros", 0.0, unit="angle"
    )
    seed: Annotated[int, Field(ge=0, lt=SEEDS)] = key("seed of the noise", 0, values="an integer from 0 to 2⁶³ − 1")

    def _faults(self) -> Iterator[str]:
        if self.sampling is None and (self.rate_noise or self.attitude_noise or self.kind == "gyros"):
            yield "the key 'sampling' is missing: noise and gyros need a sampling period [s]"
        if self.kind == "gyros" and self.attitude_noise:
            yield "'attitude_noise' cannot be used with gyros, which do not measure the attitude"

    def sensor(self, scale: float) -> AbstractSensor:
        """Return the sensor; `scale` converts angles to radians."""
        rate_bias, attitude_bias = (scale * np.array(bias) for bias in (self.rate_bias, self.attitude_bias))
        rate_noise, attitude_noise = scale * self.rate_noise, scale * self.attitude_noise
        random = jax.random.key(self.seed) if rate_noise or attitude_noise else None
        if self.kind == "gyros" and self.sampling is not None:
            return Gyros(self.sampling, rate_bias, rate_noise, attitude_bias, random)
        return Sensor(rate_bias, rate_noise, attitude_bias, attitude_noise, self.sampling, random)


class ActuatorPart(Part):
    """The limit, the sampling and the lag of the command; the limit applies to the vector part of the command."""

    limit: keys.Positive | keys.PositiveVector | None = key("limit on the command", None, values=AXIS_LIMIT)
    saturation: Literal["norm", "axis"] = key(
        "the limit applies to the norm of the command ('norm') or to each component ('axis')", "norm"
    )
    sampling: keys.Seconds | None = key("sampling period of the command; default: continuous", None)
    time_constant: keys.Seconds | None = key(
        "time constant of a first-order lag, with which the actuator follows the command; default: no lag", None
    )

    def _faults(self) -> Iterator[str]:
        self.actuator(1.0)  # raises in the units of the file
        yield from ()

    def actuator(self, scale: float) -> Actuator:
        """Return the actuator; `scale` converts angles to radians."""
        limit = None if self.limit is None else scale * np.asarray(self.limit, float)
        return Actuator(limit, self.saturation, self.sampling, self.time_constant)
