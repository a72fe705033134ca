"""Limits on angles as limits on tangents.

The tangent of an angle, or of half of it, is a ratio of polynomials and roots, so proofs and searches limit the tangent
instead of the angle. It increases with the angle, so both limits are satisfied at the same points.
"""

from typing import Any

import numpy as np

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


def strict_line(line: Any, part: int, side: int) -> np.ndarray:
    """Return lines (n, 2) on the strict side of the tangents of limits that are linear between the ends of `line`.

    The tangent differs from its chord by at most an eighth of the squared change of the angle times the largest second
    derivative of the tangent.
    """
    return strict_tangent(line, part, side) - side * gap_of_line(line, part)[:, None]


def gap_of_line(line: Any, part: int) -> np.ndarray:
    """Return bounds (n,) on the distance of the tangent of a linear limit from its chord."""
    steepest = np.abs(tangent(line, part)).max(axis=1)
    change = (line[:, 1] - line[:, 0]) / part
    with np.errstate(invalid="ignore", over="ignore"):
        gap = 2 * steepest * (1 + steepest**2) * change**2 / 8 * (1 + ROUNDING)
    return np.where(line[:, 0] == line[:, 1], 0.0, gap)


def angle_of(tangent: Any, part: int) -> Any:
    """Return the angle for which tan(angle/`part`) is `tangent`."""
    return part * namespace(tangent).arctan(tangent)
