"""The peaks of a turn against its limits, exactly, from the polynomial pieces of its profile."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from qtraj.cli.turning.job import Leg
from qtraj.motion.profiles.profile import Profile

ORDERS = {"max_rate": 1, "max_acceleration": 2, "max_jerk": 3}
UNITS = {"max_rate": "rad/s", "max_acceleration": "rad/s²", "max_jerk": "rad/s³"}
TOLERANCE = 1e-9
"""Relative: a limit is broken by more than this, and binds where the peak is nearer to it."""


def judged(turns: Sequence[Leg], limits: dict[str, float], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The peak of each magnitude over all turns, when it first occurs, and what it is against its limit."""
    found = {}
    for name in names:
        value, time = _peak(turns, ORDERS[name])
        bound = limits.get(name)
        found[name] = {
            "unit": UNITS[name],
            "value": value,
            "time": time,
            "limit": bound,
            "margin": None if bound is None else bound - value,
            "status": None if bound is None else "broken" if value > bound * (1 + TOLERANCE) else "met",
            "binding": bound is not None and abs(value - bound) <= TOLERANCE * bound,
        }
    return found


def _peak(turns: Sequence[Leg], order: int) -> tuple[float, float]:
    """The largest magnitude of a derivative of the angle, and the first instant of it [s]."""
    best, when = 0.0, turns[0].start
    for leg in turns:
        for value, time in _extremes(leg.profile, order):
            if abs(value) > best * (1 + TOLERANCE):
                best, when = abs(value), leg.start + time
    return best, when


def _extremes(profile: Profile, order: int) -> Iterator[tuple[float, float]]:
    """A derivative at the ends of each piece and where it is stationary in between, with the time of each."""
    scale = float(profile.total) if profile.proportional else 1.0
    starts, widths, pieces = (np.asarray(x).tolist() for x in (profile.starts, profile.widths, profile.pieces))
    for start, width, coefficients in zip(starts, widths, pieces, strict=True):
        if width <= 0:
            continue
        curve = scale * Polynomial(coefficients).deriv(order)
        turning = [complex(u) for u in curve.deriv().roots()]
        inner = [u.real for u in turning if math.isclose(u.imag, 0.0, abs_tol=TOLERANCE) and 0 < u.real < 1]
        for u in (0.0, *sorted(inner), 1.0):
            yield float(curve(u)) / width**order, start + u * width
