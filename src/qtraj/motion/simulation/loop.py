"""Define the components of a closed loop, and the instants of new commands."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import concrete
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control.hysteresis import HystereticLaw
from qtraj.motion.control.laws import AbstractLaw, commanded
from qtraj.motion.simulation.actuator import Actuator, sampling_instants
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.disturbance import AbstractDisturbance
from qtraj.motion.simulation.sensor import AbstractSensor, Gyros

ROUNDING = 1e-9
"""Fraction of a period by which the last sample may be later than the last instant, in addition to round-off."""

MAX_RENEWALS = 1_000_000
"""Maximum number of commands; a simulation with more commands would take many minutes."""

MAX_LAGS = 1_000_000
"""Maximum duration of a simulation with a continuous command, in time constants of the actuator."""


class Loop(eqx.Module):
    """The components of a closed loop.

    **Raises:** ValueError for components of another type, and if a disturbance, `Gyros` or a body is combined with a
    rate law.
    """

    program: AbstractProgram
    law: AbstractLaw
    disturbance: AbstractDisturbance | None
    sensor: AbstractSensor | None
    actuator: Actuator
    body: RigidBody | None = None

    def __check_init__(self):
        require_type(self.program, AbstractProgram, "program", "an object such as FrameProgram(path)")
        require_type(self.law, AbstractLaw, "law", "an object such as AccelerationLaw(2.0, 1.0)")
        require_type(
            self.disturbance,
            AbstractDisturbance | None,
            "disturbance",
            "an object such as DisturbanceTorque(torque, inertia)",
        )
        require_type(self.sensor, AbstractSensor | None, "sensor", "an object such as Gyros(0.1)")
        require_type(self.actuator, Actuator, "actuator", "an object such as Actuator(1.0)")
        require_type(self.body, RigidBody | None, "body", "an object such as RigidBody(inertia)")
        if self.commands_rate and self.body is not None:
            raise ValueError(
                "a rate law commands the rate directly, so it cannot be used with body=RigidBody(...): use an "
                "AccelerationLaw"
            )
        if self.commands_rate and self.disturbance is not None:
            raise ValueError(
                "a rate law commands the rate directly, so a disturbance has no effect: use a law that commands the "
                "acceleration, or omit the disturbance"
            )
        if self.commands_rate and isinstance(self.sensor, Gyros):
            raise ValueError(
                "gyros need a continuous rate, which they interpolate, but under a rate law the rate is discontinuous: "
                "use a law that commands the acceleration, or another sensor"
            )

    @property
    def holds(self) -> bool:
        """Whether the sensor or the actuator is sampled, so that the command is held between updates."""
        return any(part is not None and part.sampling is not None for part in (self.sensor, self.actuator))

    @property
    def commands_rate(self) -> bool:
        """Whether the law commands the rate instead of the acceleration."""
        return self.law.commands == "rate"

    def reference(self, t: Scalar, dtype: DTypeLike) -> Attitude:
        """Return the program's attitude at `t` [s] with the dtype of the state."""
        return jax.tree.map(lambda x: x.astype(dtype), self.program(t))

    def command(self, reference: Attitude, quaternion: Quat, rate: Quat, law_state: Any) -> Quat:
        """Return the command (4,), body axes, for a measured state, limited by the actuator."""
        return self.actuator(commanded(self.law, law_state, reference, quaternion, rate))


def renewal_instants(loop: Loop, times: Float[Array, " n"]) -> Float[Array, " m"] | None:
    """Return the instants [s] of new commands or sign updates, or None for a continuous loop.

    **Raises:** ValueError if sensor, actuator and hysteretic law have different sampling, if the law is hysteretic and
    nothing is sampled, if a period is traced or results in more than `MAX_RENEWALS` instants, or if the first instant
    is later than times[0].
    """
    with jax.ensure_compile_time_eval():  # constants stay concrete inside a trace
        return _renewal_instants(loop, times)


def steps_with_lag(loop: Loop, times: ArrayInput, max_steps: int) -> int:
    """Return the maximum number of steps between two instants, increased for the short steps of a continuous lag.

    **Raises:** ValueError for a lag that is too short for the time span.
    """
    lag, instants = loop.actuator.time_constant, concrete(times)
    lag = None if lag is None or loop.holds else concrete(lag)
    if lag is None or instants is None or np.size(instants) < 2:
        return max_steps
    span = float(np.ptp(instants))
    if span > MAX_LAGS * float(lag):
        raise ValueError(
            f"the actuator's time constant of {float(lag):.6g} s is much shorter than the simulation of {span:.6g} s, "
            "so that a continuous command would need millions of steps. Omit the time constant, because such a lag has "
            "almost no effect, or set the sampling of the actuator: between samples, lags are computed in closed form."
        )
    return max(max_steps, 16 ** math.ceil(math.log(max(span / float(lag), 1.0), 16)))


def _renewal_instants(loop: Loop, times: Float[Array, " n"]) -> Float[Array, " m"] | None:
    law = loop.law if isinstance(loop.law, HystereticLaw) else None
    parts = {"sensor": loop.sensor, "actuator": loop.actuator, "hysteretic law": law}
    given = {name: sampling_instants(part.sampling) for name, part in parts.items() if part is not None}
    named = {name: sampling for name, sampling in given.items() if sampling is not None}
    samplings = list(named.values())
    if not samplings:
        if law is not None:
            raise ValueError(
                "a hysteretic law updates its sign at sampling instants, but no sampling was given: set the sampling "
                "[s] of the law, the sensor or the actuator"
            )
        return None
    if not all(_same(samplings[0], other) for other in samplings[1:]):
        raise ValueError(
            f"{' and '.join(named)} must have the same sampling, but different values were given: use the same value, "
            "or specify the sampling of only one of them"
        )
    sampling = samplings[0].astype(times.dtype)
    if sampling.ndim:
        _require_early(sampling, times)
        return sampling
    period, span = concrete(sampling), concrete(times[-1] - times[0])
    if period is None or span is None:
        raise ValueError(
            "the sampling period and the time span must be concrete, because they determine the number of "
            "commands, but traced values were given: pass the instants (m,) as sampling instead of a period"
        )
    periods = float(span) / float(period)
    rounding = ROUNDING + 4 * float(np.finfo(span.dtype).eps) * periods
    if periods > MAX_RENEWALS:
        raise ValueError(
            f"a sampling period of {float(period):.6g} s requires {periods:.3g} commands in {float(span):.6g} s, but "
            f"the maximum is {MAX_RENEWALS}. Use a longer period, or no sampling, for a continuous loop."
        )
    count = int(np.floor(periods + rounding)) + 1
    return times[0] + sampling * jnp.arange(count, dtype=times.dtype)


def _same(a: Array, b: Array) -> bool:
    values_a, values_b = concrete(a), concrete(b)
    if values_a is None or values_b is None:
        return a is b
    return a.shape == b.shape and bool(np.all(values_a == values_b))


def _require_early(instants: Float[Array, " m"], times: Float[Array, " n"]) -> None:
    first, start = concrete(instants[0]), concrete(times[0])
    if first is not None and start is not None and first > start:
        raise ValueError(
            f"the first sampling instant, {float(first):.9g} s, is later than times[0] = {float(start):.9g} s, so no "
            "command is defined between them: pass a first instant that is not later than times[0]"
        )
