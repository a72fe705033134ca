"""Time-optimal turns: as fast as a rate and an acceleration limit allow (bang–bang, bang–coast–bang)."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from qtraj.foundation.arrays import concrete, real_scalar, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Flag, Scalar
from qtraj.motion.profiles.profile import (
    TOLERANCE,
    AbstractProfile,
    Profile,
    fixed_duration,
    is_turn,
    limit,
    require_limits,
    size_of,
)


@storable
class TimeOptimal(AbstractProfile):
    """Full acceleration, a coast at `max_rate` where it is reached, full braking.

    `max_rate` [rad/s] may be None; `max_acceleration` [rad/s²]. From rest to rest unless `start_rate` and `end_rate`
    [rad/s] along the turn's axis are given. With a `duration` [s] the coast is slower instead, and the acceleration
    stays full. Optimal among turns about a fixed axis, and among all turns of a spherical body whose |ε| is limited;
    limits on each axis alone can allow faster turns about a moving axis (Bilimoria and Wie 1993: 180° about a body
    axis, unit inertia and torques, in 3.24308 s instead of 3.54491 s).

    **Raises:** ValueError for limits or a duration that are not positive, or end rates beyond `max_rate`; in `profile`
    for a duration that is too short, or in which the end rates cannot be met.
    """

    max_rate: Scalar | None
    max_acceleration: Scalar
    start_rate: Scalar | None
    end_rate: Scalar | None
    duration: Scalar | None
    name: ClassVar[str] = "time-optimal"

    def __init__(
        self,
        max_rate: ArrayInput | None,
        max_acceleration: ArrayInput,
        start_rate: ArrayInput | None = None,
        end_rate: ArrayInput | None = None,
        duration: ArrayInput | None = None,
    ):
        self.max_rate = limit(max_rate)
        self.max_acceleration = real_scalar(max_acceleration, "max_acceleration")
        self.start_rate = None if start_rate is None else real_scalar(start_rate, "start_rate")
        self.end_rate = None if end_rate is None else real_scalar(end_rate, "end_rate")
        self.duration = limit(duration)
        require_limits(self)
        for rate, name in ((self.start_rate, "start_rate"), (self.end_rate, "end_rate")):
            if rate is not None:
                require_finite(rate, name)
                _require_within(rate, self.max_rate, name)

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        return _timed(self, total)


def _timed(law: TimeOptimal, total: Scalar) -> tuple[Profile, Scalar]:
    resting = law.start_rate is None and law.end_rate is None
    task = _Task(
        angle=size_of(total) if resting else total,
        start=_value(law.start_rate, total),
        end=_value(law.end_rate, total),
        rate=None if law.max_rate is None else law.max_rate.astype(total.dtype),
        acceleration=law.max_acceleration.astype(total.dtype),
    )
    coast = _fastest(task)
    if resting:
        needed = is_turn(total)
        coast = _Coast(coast.rate, jnp.where(needed, coast.width, 0.0), jnp.where(needed, coast.duration, 0.0))
    minimal, feasible = coast.duration, jnp.asarray(True)
    if law.duration is not None:
        duration, possible = fixed_duration(law.duration.astype(total.dtype), minimal)
        coast, reached = _in_time(task, duration)
        feasible = possible & reached
    return _chain(task, coast, total, feasible, resting), minimal


class _Task(eqx.Module):
    """What a turn must do: angle [rad], end rates [rad/s], limits."""

    angle: Scalar
    start: Scalar
    end: Scalar
    rate: Scalar | None
    acceleration: Scalar


class _Coast(eqx.Module):
    """The rate [rad/s] and width [s] of the middle piece, and the whole duration [s]."""

    rate: Scalar
    width: Scalar
    duration: Scalar


def _fastest(task: _Task) -> _Coast:
    """The least time: v_p = s√(sAΦ + (v0² + v1²)/2), or a coast at sV where |v_p| would exceed V."""
    angle, v0, v1, acceleration = task.angle, task.start, task.end, task.acceleration
    sense = jnp.where(angle < (v0 + v1) * jnp.abs(v1 - v0) / (2 * acceleration), -1.0, 1.0).astype(angle.dtype)
    peak = sense * _root(sense * acceleration * angle + (v0**2 + v1**2) / 2)
    width = jnp.zeros_like(angle)
    if task.rate is not None:
        clipped = jnp.abs(peak) > task.rate
        top = jnp.where(clipped, task.rate, 1.0)
        left = angle - sense * (2 * top**2 - v0**2 - v1**2) / (2 * acceleration)
        width = jnp.where(clipped, left / (sense * top), width)
        peak = jnp.where(clipped, sense * top, peak)
    ramps = sense * (2 * peak - v0 - v1) / acceleration
    return _Coast(peak, width, ramps + width)


def _in_time(task: _Task, duration: Scalar) -> tuple[_Coast, Flag]:
    """The coast that fills a given duration T, and whether there is one within the limits.

    With m the mean and Δ the difference of the end rates, and v = m + y: for |y| ≤ |Δ|/2 the angle is linear in y,
    beyond it y² − AT|y| + Δ²/4 + A|Φ − mT| = 0. At rest this is v = ½(AT − √(A²T² − 4AΦ)), without its cancellation.
    """
    v0, v1, a = task.start, task.end, task.acceleration
    mean, change = (v0 + v1) / 2, jnp.abs(v1 - v0)
    excess = task.angle - mean * duration
    room = duration - change / a
    between = (jnp.abs(excess) <= change / 2 * room) & (room > 0)
    linear = excess / jnp.where(between, room, 1.0)
    square = (a * duration) ** 2 - change**2 - 4 * a * jnp.abs(excess)
    outer = 2 * (a * jnp.abs(excess) + change**2 / 4) / (a * duration + _root(square))
    rate = mean + jnp.where(between, linear, jnp.where(excess < 0, -outer, outer))
    width = jnp.maximum(duration - (jnp.abs(rate - v0) + jnp.abs(rate - v1)) / a, 0.0)
    slack = 4 * TOLERANCE * float(jnp.finfo(duration.dtype).eps)
    reached = (square >= -slack * (a * duration) ** 2) & (room >= -slack * duration)
    if task.rate is not None:
        reached &= jnp.abs(rate) <= task.rate * (1 + slack**0.5)  # v is a root: half the digits at T minimal
        # The minimal time ends on the limit itself: its round-off must not pass it.
        rate = jnp.clip(rate, -task.rate, task.rate)
    return _Coast(rate, width, duration), reached


def _chain(task: _Task, coast: _Coast, total: Scalar, feasible: Flag, resting: bool) -> Profile:
    """The three pieces v0 → v, v, v → v1; scaled to a unit angle where the turn rests at both ends."""
    v0, v, v1 = task.start, coast.rate, task.end
    first, last = jnp.abs(v - v0) / task.acceleration, jnp.abs(v1 - v) / task.acceleration
    widths = jnp.stack([first, coast.width, last])
    linear = jnp.stack([v0, v, v]) * widths
    square = jnp.stack([(v - v0) / 2, jnp.zeros_like(v), (v1 - v) / 2]) * widths
    constant = jnp.cumsum(linear + square) - (linear + square)
    pieces = jnp.stack([constant, linear, square], axis=1)
    return Profile(
        total=total,
        duration=coast.duration,
        starts=jnp.stack([jnp.zeros_like(v), first, coast.duration - last]),
        widths=widths,
        pieces=pieces / task.angle if resting else pieces,
        end_rate=v1,
        feasible=feasible,
        proportional=resting,
    )


def _root(x: Scalar) -> Scalar:
    """√x, and 0 with zero gradient for x ≤ 0."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)


def _value(rate: Scalar | None, like: Scalar) -> Scalar:
    return jnp.zeros_like(like) if rate is None else rate.astype(like.dtype)


def _require_within(rate: Scalar, bound: Scalar | None, name: str) -> None:
    value, top = concrete(rate), None if bound is None else concrete(bound)
    if value is not None and top is not None and abs(value) > top:
        raise ValueError(f"{name} is {float(value):.9g} rad/s, which is already beyond max_rate = {float(top):.9g}")
