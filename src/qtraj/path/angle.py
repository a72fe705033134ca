"""Limits on angles as limits on tangents.

The tangent of an angle, or of half of it, is a ratio of polynomials and roots, so proofs and searches limit the tangent
instead of the angle. It increases with the angle, so both limits are satisfied at the same points.
"""

from typing import Any

import numpy as np

from qtraj.algebra import bernstein
from qtraj.foundation.namespace import namespace

ROUNDING = 2.0**-49
"""A tangent is made stricter by this fraction, which exceeds the rounding errors of its computation."""

STEEPEST = float(np.nextafter(np.pi / 2, 0))
"""Largest angle whose tangent is used; its tangent exceeds that of every larger float below a right angle."""


def tangent(angle: Any, part: int) -> Any:
    """Return tan(`angle`/`part`); an infinite angle, which means that there is no limit, remains infinite."""
    xp = namespace(angle)
    absent = xp.isinf(angle)
    known = xp.clip(xp.where(absent, 0.0, angle) / part, -STEEPEST, STEEPEST)
    return xp.where(absent, angle, xp.tan(known))


def strict_tangent(angle: Any, part: int, side: int) -> np.ndarray:
    """Return the tangent of a limit, rounded down for an upper limit (`side` 1) and up for a lower one (−1)."""
    found = np.asarray(tangent(np.asarray(angle, float), part))
    return np.where(np.isinf(found), found, found - side * ROUNDING * np.abs(found))


def strict_curve(curve: Any, part: int, side: int) -> np.ndarray:
    """Return polynomials on the strict side of the tangents of limits that are polynomials of one sign.

    Both are given by Bernstein coefficients (n, terms). Constant limits and limits of which no accurate polynomial is
    found get constant tangents.
    """
    constant = side * np.min(side * curve, axis=1)
    strict = np.repeat(strict_tangent(constant, part, side)[:, None], bernstein.INTERPOLATED, axis=1)
    changes = np.isfinite(constant) & (curve != curve[:, :1]).any(axis=1)
    if changes.any():
        own = curve[changes]
        at_nodes = [tangent(bernstein.values(own, z), part) for z in bernstein.nodes(bernstein.INTERPOLATED)]
        found = bernstein.interpolated(np.stack(at_nodes, axis=1)) - side * _error(own, part)[:, None]
        better = (side * (found.mean(axis=1) - strict[changes, 0]) > 0) & (found * constant[changes, None] > 0).all(
            axis=1
        )
        strict[changes] = np.where(better[:, None], found, strict[changes])
    return strict


def gap_of_curve(curve: Any, part: int, side: int) -> np.ndarray:
    """Return bounds (n,) on the distance of the result of `strict_curve` from the tangent of a limit."""
    error, strict = 2 * _error(curve, part), strict_curve(curve, part, side)
    spread = np.ptp(tangent(curve, part), axis=1) if np.isfinite(curve).all() else np.full(len(curve), np.inf)
    constant = (strict == strict[:, :1]).all(axis=1)
    return np.where((curve == curve[:, :1]).all(axis=1), 0.0, np.where(constant, spread, error))


def _error(curve: np.ndarray, part: int) -> np.ndarray:
    """Return bounds on the errors of interpolations of the tangents of limits.

    The Taylor coefficients of t = tan(x) follow from those of x by the recurrence of t' = (1 + t²)·x', here for
    magnitudes.
    """
    with np.errstate(all="ignore"):
        x = [c / part for c in bernstein.derivative_bounds(curve)]
        largest = np.abs(curve).max(axis=1) / part
        t = [np.abs(tangent(largest, 1))]
        for k in range(bernstein.INTERPOLATED):
            square = [sum(t[i] * t[j - i] for i in range(j + 1)) + (j == 0) for j in range(k + 1)]
            t.append(sum(square[j] * (k + 1 - j) * x[k + 1 - j] for j in range(k + 1) if k + 1 - j < len(x)) / (k + 1))
        rounding = bernstein.ROUNDING * (t[0] + (1 + t[0] ** 2) * largest)
        return bernstein.error(np.asarray(t[-1]), bernstein.INTERPOLATED) + rounding


def angle_of(tangent: Any, part: int) -> Any:
    """Return the angle for which tan(angle/`part`) is `tangent`."""
    return part * namespace(tangent).arctan(tangent)
