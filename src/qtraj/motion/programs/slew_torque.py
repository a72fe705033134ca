"""Slow slews down to satisfy torque limits, or reduce their acceleration in a fixed duration.

The torque is that of `slew_peak_torque`. A slew that is s times slower needs the torque M/s².
"""

from __future__ import annotations  # so that `help` shows short names

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from qtraj.foundation.arrays import as_float, concrete, require_concrete
from qtraj.foundation.types import ArrayInput
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.profiles.profile import END_STATES, AbstractProfile, has_end_states
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.slew_peak_torque import MARGIN, TorquePeak, coefficients, peak_torque, slews_of

MAX_STEPS = 200
"""Number of steps of each search for a coasting rate; a step reduces the interval to at most 62 % of its length."""

STEPS = 45
"""Number of steps of each search for an acceleration, whose relative error is then below 1e-9."""


def within_torque(
    program: EulerTurn | SlewSequence, inertia: ArrayInput, max_torque: ArrayInput
) -> EulerTurn | SlewSequence:
    """Return the program, slowed down if it violates a torque limit.

    `inertia`: as in `peak_torque`. `max_torque` [N m]: a number limits the magnitude of the torque; an array (3,)
    limits each component in body axes. A program that satisfies the limit is returned unchanged. For a single slew with
    a `TimeOptimal` profile, the coasting rate and the constant acceleration are chosen for minimum duration (the
    duration is convex in the rate); a slew whose acceleration varies with the rate could be faster. A slew with another
    profile, or a slew sequence, is stretched in time until its largest torque equals the limit. With a fixed duration,
    a `TimeOptimal` or an `SCurve` profile keeps its duration, and its acceleration is reduced to the largest value that
    satisfies the limit. The largest torque is computed as in `peak_torque`, so the limit holds on the whole slew.

    **Raises:** ValueError for a torque limit that is not positive; for a slew that violates the limit and has a start
    rate or an end rate, or a fixed duration in which its profile cannot satisfy the limit; and in the same cases as
    `peak_torque`.
    """
    require_concrete("within_torque", program, inertia, max_torque)
    bound = _bound(max_torque)
    ratio = _ratio(peak_torque(program, inertia), bound)
    if ratio <= 1:
        return program
    law = program.law
    needed = f"the slew needs {ratio:.6g} times the torque that max_torque = {bound.tolist()} N m allows, but it cannot"
    if has_end_states(law):
        fixed = [name for name in (*END_STATES, "duration") if getattr(law, name, None) is not None]
        raise ValueError(f"{needed} be slowed down, because the profile has {' and '.join(fixed)}. Omit these.")
    target = bound * (1 - MARGIN)
    if law.duration is not None:
        gentler = _gentler(program, inertia, target)
        if gentler is None:
            slower = within_torque(dataclasses.replace(program, law=_unhurried(law, ratio)), inertia, max_torque)
            raise ValueError(
                f"{needed} satisfy the limit in its fixed duration of {float(law.duration):.9g} s. Increase the "
                f"duration to at least {float(slower.duration) / _count(program):.9g} s."
            )
        return gentler
    if isinstance(program, EulerTurn) and isinstance(law, TimeOptimal):
        J = np.asarray(inertia_matrix(inertia), float)
        law = _shortest(law, float(program.angle), *coefficients(J, np.asarray(program.axis(), float)), target)
    else:
        law = _slowed(law, (ratio / (1 - MARGIN)) ** 0.5)
    return dataclasses.replace(program, law=law)


def _gentler(
    program: EulerTurn | SlewSequence, inertia: ArrayInput, target: np.ndarray
) -> EulerTurn | SlewSequence | None:
    """Return the program of a fixed duration with the largest acceleration within the torque `target`, or None.

    A smaller acceleration needs a higher coasting rate, so the torque, whose parts are proportional to the acceleration
    and to the square of the rate, has a minimum. Above it, the torque increases with the acceleration.
    """
    law = program.law
    if not isinstance(law, TimeOptimal | SCurve):
        return None
    angles = [float(slew.total) for _, _, slew in slews_of(program)]

    def tried(acceleration: float) -> EulerTurn | SlewSequence:
        return dataclasses.replace(program, law=dataclasses.replace(law, max_acceleration=acceleration))

    def ratio(acceleration: float) -> float:
        return _ratio(peak_torque(tried(acceleration), inertia), target)

    highest = float(law.max_acceleration)
    lowest = _bisected(lambda a: all(_feasible(law, a, angle) for angle in angles), highest, 0.0)
    best = lowest + _argmin(lambda x: ratio(lowest + x), highest - lowest, STEPS) if lowest < highest else highest
    if ratio(best) > 1:
        return None
    return tried(_bisected(lambda a: ratio(a) <= 1, best, highest))


def _feasible(law: AbstractProfile, acceleration: float, angle: float) -> bool:
    """Return whether a slew of `angle` [rad] is possible in the fixed duration of the profile."""
    profile, _ = dataclasses.replace(law, max_acceleration=acceleration).timed(np.asarray(angle))  # pyright: ignore[reportCallIssue, reportArgumentType]
    return bool(profile.feasible)


def _bisected(holds: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return a number between `inside`, where a condition holds, and `outside`, next to where it ceases to hold."""
    for _ in range(STEPS):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside


def _unhurried(law: AbstractProfile, ratio: float) -> AbstractProfile:
    """Return a profile with a fixed duration as one whose slews take the time that their limits need."""
    if isinstance(law, TimeOptimal | SCurve):
        return dataclasses.replace(law, duration=None)
    return dataclasses.replace(law, duration=law.duration * (ratio / (1 - MARGIN)) ** 0.5)  # pyright: ignore[reportOptionalOperand, reportCallIssue]


def _count(program: EulerTurn | SlewSequence) -> int:
    """Return the number of slews, each of which has the duration of the profile."""
    return 1 if isinstance(program, EulerTurn) else len(slews_of(program))


def _bound(max_torque: ArrayInput) -> np.ndarray:
    bound = concrete(as_float(max_torque))
    if bound is None or bound.shape not in ((), (3,)) or not (np.isfinite(bound).all() and (bound > 0).all()):
        raise ValueError(
            "max_torque must be a positive number, or three positive numbers for the body axes [N m], but "
            f"{max_torque!r} was given"
        )
    return bound.astype(float)


def _ratio(peak: TorquePeak, bound: np.ndarray) -> float:
    """Return the largest ratio of a peak torque to its limit."""
    return peak.norm / float(bound) if bound.ndim == 0 else float(np.max(np.asarray(peak.axes) / bound))


def _shortest(law: TimeOptimal, angle: float, p: np.ndarray, q: np.ndarray, bound: np.ndarray) -> TimeOptimal:
    """Return the trapezoidal profile of minimum duration Φ/V + V/A(V).

    Φ is the angle, V the coasting rate and A(V) the largest acceleration within the acceleration limit and the torque
    limit. p_k and q_k are the components of the vectors p and q with M = Φ̈p + Φ̇²q. The rate reaches V at the end of the
    acceleration and at the start of the deceleration, so the largest torque about axis k is A|p_k| + V²|q_k|, and the
    largest magnitude of the torque is √(A²|p|² + V⁴|q|²). A(V) is concave and does not increase, so the duration is
    convex in V.
    """
    max_acceleration = float(law.max_acceleration)

    def acceleration(V: float) -> float:
        if bound.ndim == 0:
            available = float(bound) ** 2 - V**4 * float(q @ q)
            return min(max_acceleration, max(available, 0.0) ** 0.5 / float(np.linalg.norm(p)))
        available = np.maximum(bound - V**2 * np.abs(q), 0.0)
        return min(max_acceleration, *(float(m / k) for m, k in zip(available, np.abs(p), strict=True) if k > 0))

    def duration(V: float) -> float:
        A = acceleration(V)
        return angle / V + V / A if A > 0 else np.inf

    # The coast has a non-negative duration if V² ≤ A(V)Φ. The left side increases with V and the right side does not,
    # so bisection finds the largest such V.
    low, high = 0.0, (max_acceleration * angle) ** 0.5
    if high**2 > acceleration(high) * angle:
        for _ in range(MAX_STEPS):
            middle = (low + high) / 2
            low, high = (middle, high) if middle**2 <= acceleration(middle) * angle else (low, middle)
        high = low
    high = high if law.max_rate is None else min(high, float(law.max_rate))
    best = _argmin(duration, high)
    return TimeOptimal(best, acceleration(best))


def _argmin(function: Callable[[float], float], high: float, steps: int = MAX_STEPS) -> float:
    """Return the minimiser of a convex function on (0, high] by golden-section search."""
    ratio, low, top = (5**0.5 - 1) / 2, 0.0, high
    a, b = top - ratio * (top - low), low + ratio * (top - low)
    fa, fb = function(a), function(b)
    for _ in range(steps):
        if fa <= fb:
            top, b, fb = b, a, fa
            a = top - ratio * (top - low)
            fa = function(a)
        else:
            low, a, fa = a, b, fb
            b = low + ratio * (top - low)
            fb = function(b)
    return high if function(high) <= min(fa, fb) else (a if fa <= fb else b)


def _slowed(law: AbstractProfile, factor: float) -> AbstractProfile:
    """Return the motion profile `law` with its limits reduced so that slews take `factor` times as long."""
    orders = {"max_rate": 1, "max_acceleration": 2, "max_jerk": 3}
    limits = {name: getattr(law, name, None) for name in orders}
    changed = {name: jnp.asarray(x / factor ** orders[name]) for name, x in limits.items() if x is not None}
    return dataclasses.replace(law, **changed)
