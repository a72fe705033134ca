"""Torques of turns about fixed axes, and turns within limits of torque.

About the axis e a body of inertia J needs the torque M = Φ̈p + Φ̇²q with p = Je and q = e×Je, in body axes (Euler's
equations). Along a piece of a profile that is a polynomial in time, and so its largest value is exact. Since q ⊥ p,
|M|² = Φ̈²|p|² + Φ̇⁴|q|². A turn that is s times slower needs M/s² everywhere.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import Polynomial

from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.types import ArrayInput
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.profiles.profile import AbstractProfile, Profile
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence

STEPS = 200
"""Most steps of the search for the best coast: each leaves 0.62 of the interval."""

WITHIN = 1e-10
"""Relative margin below the torque limit. Squared torques are polynomials of degree up to 24, whose computed maxima
are off by about 1e-11."""


class TorquePeak(NamedTuple):
    """The largest torques of a program, and when they first occur.

    `axes` (3,) and `axes_times` (3,): of each component in body axes [N m], [s]; `norm` and `norm_time`: of the length.
    """

    axes: tuple[float, float, float]
    axes_times: tuple[float, float, float]
    norm: float
    norm_time: float


def peak_torque(program: EulerTurn | SlewSequence, inertia: ArrayInput) -> TorquePeak:
    """The largest torque [N m] on the whole of a turn, or of a chain of turns, in body axes.

    `inertia` [kg m²]: a scalar, (3,) principal moments, or (3, 3), about the centre of mass, in body axes. The values
    are exact to about 1e-10 in float64: those at the ends and at the stationary points of the polynomials between the
    switches, where both sides count. Impulses at a jump of the rate, as at the end of a turn with an `end_rate`, do not
    show.

    **Raises:** ValueError for an inertia that is none, a program of another kind, or inside a trace.
    """
    J = np.asarray(inertia_matrix(inertia), float)
    axes, axes_times, norm, norm_time = np.zeros(3), np.zeros(3), 0.0, 0.0
    for start, axis, profile in _legs(program):
        p, q = _coefficients(J, axis)
        for begin, width, rate, acceleration in _pieces(profile):
            squared = rate * rate
            along = [acceleration * p[k] + squared * q[k] for k in range(3)]
            whole = acceleration * acceleration * (p @ p) + squared * squared * (q @ q)
            for k, component in enumerate(along):
                value, u = _largest(component)
                if value > axes[k] * (1 + WITHIN):
                    axes[k], axes_times[k] = value, start + begin + u * width
            value, u = _largest(whole)
            if value**0.5 > norm * (1 + WITHIN):
                norm, norm_time = value**0.5, start + begin + u * width
    return TorquePeak(_three(axes), _three(axes_times), norm, norm_time)


def within_torque(
    program: EulerTurn | SlewSequence, inertia: ArrayInput, max_torque: ArrayInput
) -> EulerTurn | SlewSequence:
    """The program under limits of torque as well: as it is where it keeps them, else slower.

    `inertia` as in `peak_torque`; `max_torque` [N m]: a number bounds the length of the torque, (3,) each component in
    body axes. One turn under a `TimeOptimal` law gets the coasting rate and the constant acceleration that make it
    shortest among such trapezoids (the duration is convex in the rate, and a search finds its minimum); accelerations
    that vary with the rate could be faster. A turn under another law, and a chain, keeps its shape and is stretched in
    time, so that its largest torque is the limit. Either way the limit holds on the whole turn: see `peak_torque`.

    **Raises:** ValueError for a torque limit that is not positive, a law with a fixed duration or end rates whose turn
    exceeds the limit (it says by how much), and as `peak_torque`.
    """
    bound = _bound(max_torque)
    excess = _excess(peak_torque(program, inertia), bound)
    if excess <= 1:
        return program
    law = program.law
    if (
        law.duration is not None
        or getattr(law, "start_rate", None) is not None
        or getattr(law, "end_rate", None) is not None
    ):
        raise ValueError(
            f"the turn needs {excess:.6g} times the torque that max_torque = {bound.tolist()} N m allows, and a fixed "
            "duration or end rates leave no freedom to slow it down. Allow more time, or leave them out."
        )
    aim = bound * (1 - WITHIN)
    if isinstance(program, EulerTurn) and isinstance(law, TimeOptimal):
        J = np.asarray(inertia_matrix(inertia), float)
        law = _shortest(law, float(program.angle), *_coefficients(J, np.asarray(program.axis(), float)), aim)
    else:
        law = _slowed(law, (excess / (1 - WITHIN)) ** 0.5)
    return dataclasses.replace(program, law=law)


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _legs(program: EulerTurn | SlewSequence) -> list[tuple[float, np.ndarray, Profile]]:
    """Start [s], axis in body axes and profile of each turn."""
    if isinstance(program, EulerTurn):
        turns, starts = [program], [0.0]
    elif isinstance(program, SlewSequence):
        turns = [
            EulerTurn(a, b, program.law) for a, b in zip(program.attitudes[:-1], program.attitudes[1:], strict=True)
        ]
        starts = [float(t) for t in program.times[:-1]]
    else:
        raise ValueError(f"an EulerTurn or a SlewSequence was expected, but a {type(program).__name__} was given")
    if any(concrete(turn.angle) is None for turn in turns):
        raise ValueError("torques of a turn ask for its numbers: call this outside of jax.jit, grad and vmap")
    return [(start, np.asarray(turn.axis(), float), turn.profile) for start, turn in zip(starts, turns, strict=True)]


def _coefficients(J: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """p and q of M = Φ̈p + Φ̇²q; what is round-off in q, as about a principal axis, is none."""
    p = J @ axis
    q = np.cross(axis, p)
    return p, np.where(np.abs(q) > 8 * np.finfo(float).eps * np.linalg.norm(p), q, 0.0)


def _pieces(profile: Profile) -> list[tuple[float, float, Polynomial, Polynomial]]:
    """Start, width [s], and Φ̇ and Φ̈ as polynomials in u of each piece that takes time."""
    scale = float(profile.total) if profile.proportional else 1.0
    found = []
    for start, width, coefficients in zip(
        *map(np.asarray, (profile.starts, profile.widths, profile.pieces)), strict=True
    ):
        if width > 0:
            angle = Polynomial(scale * coefficients.astype(float))
            found.append((float(start), float(width), angle.deriv() / width, angle.deriv(2) / width**2))
    return found


def _largest(curve: Polynomial) -> tuple[float, float]:
    """The largest magnitude on [0, 1] and the first u where it is: at an end, or where the slope vanishes."""
    slope = curve.deriv()
    slope = slope.trim(float(np.finfo(float).eps * np.abs(slope.coef).max()))
    # Of a complex pair the real part is taken as well: one point more does no harm, a double root that is lost may.
    places = np.array([0.0, *(u for u in np.sort(slope.roots().real) if 0 < u < 1), 1.0])
    values = np.abs(curve(places))
    first = int(np.argmax(values >= values.max() * (1 - WITHIN)))
    return float(values.max()), float(places[first])


def _bound(max_torque: ArrayInput) -> np.ndarray:
    bound = concrete(as_float(max_torque))
    if bound is None or bound.shape not in ((), (3,)) or not (np.isfinite(bound).all() and (bound > 0).all()):
        raise ValueError(
            f"max_torque must be a positive number or three of them, of each body axis [N m], but "
            f"{max_torque!r} was given"
        )
    return bound.astype(float)


def _excess(peak: TorquePeak, bound: np.ndarray) -> float:
    """The largest torque over its limit."""
    return peak.norm / float(bound) if bound.ndim == 0 else float(np.max(np.asarray(peak.axes) / bound))


def _shortest(law: TimeOptimal, angle: float, p: np.ndarray, q: np.ndarray, bound: np.ndarray) -> TimeOptimal:
    """The trapezoid of least duration Φ/V + V/A(V).

    At the rate V the largest torques are A|p| + V²|q| in each axis, or √(A²|p|² + V⁴|q|²): speeding up and braking both
    reach V. What they leave to A is concave and falls in V, so the duration is convex in V.
    """
    most = float(law.max_acceleration)

    def acceleration(V: float) -> float:
        if bound.ndim == 0:
            left = float(bound) ** 2 - V**4 * float(q @ q)
            return min(most, max(left, 0.0) ** 0.5 / float(np.linalg.norm(p)))
        left = np.maximum(bound - V**2 * np.abs(q), 0.0)
        return min(most, *(float(m / k) for m, k in zip(left, np.abs(p), strict=True) if k > 0))

    def duration(V: float) -> float:
        A = acceleration(V)
        return angle / V + V / A if A > 0 else np.inf

    # The coast must not be shorter than nothing: V² ≤ A(V)Φ, whose sides rise and fall in V.
    low, high = 0.0, (most * angle) ** 0.5
    if high**2 > acceleration(high) * angle:
        for _ in range(STEPS):
            middle = (low + high) / 2
            low, high = (middle, high) if middle**2 <= acceleration(middle) * angle else (low, middle)
        high = low
    high = high if law.max_rate is None else min(high, float(law.max_rate))
    best = _minimum(duration, high)
    return TimeOptimal(best, acceleration(best))


def _minimum(function: Callable[[float], float], high: float) -> float:
    """Where a convex function is least on (0, high], by golden sections; the upper end where it falls all the way."""
    ratio, low, top = (5**0.5 - 1) / 2, 0.0, high
    a, b = top - ratio * (top - low), low + ratio * (top - low)
    fa, fb = function(a), function(b)
    for _ in range(STEPS):
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
    """The law whose turns are those of `law`, so many times as long."""
    orders = {"max_rate": 1, "max_acceleration": 2, "max_jerk": 3}
    limits = {name: getattr(law, name, None) for name in orders}
    changed = {name: jnp.asarray(x / factor ** orders[name]) for name, x in limits.items() if x is not None}
    return dataclasses.replace(law, **changed)
