"""Compute the largest torque of eigenaxis slews.

A slew of a body with inertia J by the angle Φ(t) about the axis e needs the torque M = Φ̈p + Φ̇²q with p = Je and q =
e×Je, in body axes (Euler's equations). On each segment of a profile the torque is a polynomial in time, so its maximum
is found without sampling. Since q ⊥ p, |M|² = Φ̈²|p|² + Φ̇⁴|q|².
"""

from __future__ import annotations  # so that `help` shows short names

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from qtraj.foundation.arrays import require_concrete
from qtraj.foundation.types import ArrayInput
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.profiles.profile import Profile
from qtraj.motion.profiles.stationary import stationary_points
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence

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
    require_concrete("the torque of a slew", program, inertia)
    J = np.asarray(inertia_matrix(inertia), float)
    axes, axes_times, norm, norm_time = np.zeros(3), np.zeros(3), 0.0, 0.0
    for start, axis, profile in slews_of(program):
        p, q = coefficients(J, axis)
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


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def slews_of(program: EulerTurn | SlewSequence) -> list[tuple[float, np.ndarray, Profile]]:
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
    return [(start, np.asarray(slew.axis(), float), slew.profile) for start, slew in zip(starts, slews, strict=True)]


def coefficients(J: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
