"""Compute torques of eigenaxis slews, and slow slews down to satisfy torque limits.

A slew of a body with inertia J by the angle Φ(t) about the axis e needs the torque M = Φ̈p + Φ̇²q with p = Je and q =
e×Je, in body axes (Euler's equations). On each segment of a profile the torque is a polynomial in time, so its maximum
is found without sampling. Since q ⊥ p, |M|² = Φ̈²|p|² + Φ̇⁴|q|². A slew that is s times slower needs the torque M/s².
"""

from __future__ import annotations  # so that `help` shows short names

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import Polynomial

from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.types import ArrayInput
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.profiles.profile import AbstractProfile, Profile, is_fixed, stationary_points
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence

MAX_STEPS = 200
"""Number of steps of each search for a coasting rate; a step reduces the interval to at most 62 % of its length."""

MARGIN = 1e-10
"""Relative margin below the torque limit; computed maxima of polynomials up to degree 24 have errors of about 1e-11."""


class TorquePeak(NamedTuple):
    """The largest torques [N m] of a program, and the first instants [s] at which they occur.

    `axes` (3,) and `axes_times` (3,) refer to the absolute value of each component, body axes. `norm` and `norm_time`
    refer to the magnitude of the torque vector.
    """

    axes: tuple[float, float, float]
    axes_times: tuple[float, float, float]
    norm: float
    norm_time: float


def peak_torque(program: EulerTurn | SlewSequence, inertia: ArrayInput) -> TorquePeak:
    """Compute the largest torque [N m] of a slew, or of a slew sequence, in body axes.

    `inertia` [kg m²]: a scalar, (3,) principal moments, or (3, 3), about the centre of mass, in body axes. The maxima
    have a relative error of about 1e-10 in float64: the torque is evaluated at the ends and at the stationary points of
    its polynomials, on both sides of each switch. Impulses at a jump of the rate, such as at the end of a slew with an
    `end_rate`, are not included.

    **Raises:** ValueError for an invalid inertia, a program that is neither an `EulerTurn` nor a `SlewSequence`, or
    inside a trace.
    """
    J = np.asarray(inertia_matrix(inertia), float)
    axes, axes_times, norm, norm_time = np.zeros(3), np.zeros(3), 0.0, 0.0
    for start, axis, profile in _slews(program):
        p, q = _coefficients(J, axis)
        for begin, width, rate, acceleration in _pieces(profile):
            squared = rate * rate
            torque = [acceleration * p[k] + squared * q[k] for k in range(3)]
            torque_squared = acceleration * acceleration * (p @ p) + squared * squared * (q @ q)
            for k, component in enumerate(torque):
                value, u = _largest(component)
                if value > axes[k] * (1 + MARGIN):
                    axes[k], axes_times[k] = value, start + begin + u * width
            value, u = _largest(torque_squared)
            if value**0.5 > norm * (1 + MARGIN):
                norm, norm_time = value**0.5, start + begin + u * width
    return TorquePeak(_three(axes), _three(axes_times), norm, norm_time)


def within_torque(
    program: EulerTurn | SlewSequence, inertia: ArrayInput, max_torque: ArrayInput
) -> EulerTurn | SlewSequence:
    """Return the program, slowed down if it violates a torque limit.

    `inertia`: as in `peak_torque`. `max_torque` [N m]: a number limits the magnitude of the torque; an array (3,)
    limits each component in body axes. A program that satisfies the limit is returned unchanged. For a single slew with
    a `TimeOptimal` profile, the coasting rate and the constant acceleration are chosen for minimum duration (the
    duration is convex in the rate); a slew whose acceleration varies with the rate could be faster. A slew with another
    profile, or a slew sequence, is stretched in time until its largest torque equals the limit. The largest torque is
    computed as in `peak_torque`, so the limit is satisfied on the whole slew.

    **Raises:** ValueError for a torque limit that is not positive; for a slew that violates the limit and has a fixed
    duration, a start rate or an end rate; and in the same cases as `peak_torque`.
    """
    bound = _bound(max_torque)
    ratio = _ratio(peak_torque(program, inertia), bound)
    if ratio <= 1:
        return program
    law = program.law
    if is_fixed(law):
        raise ValueError(
            f"the slew needs {ratio:.6g} times the torque that max_torque = {bound.tolist()} N m allows, but it cannot "
            "be slowed down, because its duration, start_rate or end_rate is fixed. Increase the duration, or omit "
            "duration, start_rate and end_rate."
        )
    target = bound * (1 - MARGIN)
    if isinstance(program, EulerTurn) and isinstance(law, TimeOptimal):
        J = np.asarray(inertia_matrix(inertia), float)
        law = _shortest(law, float(program.angle), *_coefficients(J, np.asarray(program.axis(), float)), target)
    else:
        law = _slowed(law, (ratio / (1 - MARGIN)) ** 0.5)
    return dataclasses.replace(program, law=law)


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _slews(program: EulerTurn | SlewSequence) -> list[tuple[float, np.ndarray, Profile]]:
    """Return start [s], axis in body axes and profile of each slew."""
    if isinstance(program, EulerTurn):
        slews, starts = [program], [0.0]
    elif isinstance(program, SlewSequence):
        slews = [
            EulerTurn(a, b, program.law) for a, b in zip(program.attitudes[:-1], program.attitudes[1:], strict=True)
        ]
        starts = [float(t) for t in program.times[:-1]]
    else:
        raise ValueError(f"an EulerTurn or a SlewSequence was expected, but a {type(program).__name__} was given")
    if any(concrete(slew.angle) is None for slew in slews):
        raise ValueError(
            "the torque of a slew needs concrete values, but a traced slew was given: call this function outside jit, "
            "grad and vmap"
        )
    return [(start, np.asarray(slew.axis(), float), slew.profile) for start, slew in zip(starts, slews, strict=True)]


def _coefficients(J: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return p and q of M = Φ̈p + Φ̇²q; components of q below round-off, as for a principal axis, are set to zero."""
    p = J @ axis
    q = np.cross(axis, p)
    return p, np.where(np.abs(q) > 8 * np.finfo(float).eps * np.linalg.norm(p), q, 0.0)


def _pieces(profile: Profile) -> list[tuple[float, float, Polynomial, Polynomial]]:
    """Return start [s], width [s], and Φ̇ and Φ̈ as polynomials in u, of each segment of nonzero width."""
    scale = float(profile.total) if profile.proportional else 1.0
    pieces = []
    for start, width, coefficients in zip(
        *map(np.asarray, (profile.starts, profile.widths, profile.pieces)), strict=True
    ):
        if width > 0:
            angle = Polynomial(scale * coefficients.astype(float))
            pieces.append((float(start), float(width), angle.deriv() / width, angle.deriv(2) / width**2))
    return pieces


def _largest(curve: Polynomial) -> tuple[float, float]:
    """Return the maximum of |curve| on [0, 1], and the first u at which it occurs."""
    points = np.array(stationary_points(curve))
    values = np.abs(curve(points))
    first = int(np.argmax(values >= values.max() * (1 - MARGIN)))
    return float(values.max()), float(points[first])


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


def _argmin(function: Callable[[float], float], high: float) -> float:
    """Return the minimiser of a convex function on (0, high] by golden-section search."""
    ratio, low, top = (5**0.5 - 1) / 2, 0.0, high
    a, b = top - ratio * (top - low), low + ratio * (top - low)
    fa, fb = function(a), function(b)
    for _ in range(MAX_STEPS):
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
