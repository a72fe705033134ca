"""Check statuses of limits with 60 digits, from the coefficients of a spiral-helix.

The derivatives of the path are computed here, independently of the library; the formulas of the quantities are those of
the registry, over mpmath numbers.
"""

from types import SimpleNamespace

import mpmath
import numpy as np

from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity

from .group import Fields, car

DIGITS, SAMPLES = 60, 257
NEAR, STEPS = 1e-3, 60
"""Part of the duration in which the largest excess near a reported time is sought, and steps of this search."""

DIVISORS = {"speed": "S", "level": "H", "cross_norm": "N"}
"""Names of divisors in `Invariants`."""

ROUNDED = 1e-12
"""A divisor, relative to its largest value along the path, below which a quantity may be undefined."""


def contradiction(given: Fields, k: int, name: str, limit: float, status: str, time: float) -> str:
    """Return why the `status` of a limit on path k cannot be right, or an empty string.

    A limit that is "proved" must be satisfied at many instants and near `time` [s]; one that is "broken" must be
    violated near `time`; the divisor of an "undefined" quantity must be negligible at `time`.
    """
    with mpmath.workdps(DIGITS):
        invariants, entry, duration = _invariants(given, k), quantity(name), float(given["duration"][k])
        instants = np.linspace(0.0, duration, SAMPLES).tolist()
        if status == "undefined":
            divisors = [getattr(invariants(t), DIVISORS.get(entry.divisor or "", "S")) for t in (time, *instants)]
            share = divisors[0] / (max(divisors) or 1)
            return "" if share <= ROUNDED else f"the divisor is {mpmath.nstr(share, 5)} times its largest value"
        excess = _excess(entry, invariants, limit)
        largest = _largest(excess, time, duration)
        if status == "proved":
            largest = max(largest, *map(excess, instants))
        right = {"proved": largest <= 0, "broken": largest > 0}
        return "" if right.get(status, True) else f"the largest excess is {mpmath.nstr(largest, 5)}"


def _largest(excess, time: float, duration: float):
    """Return the largest excess near a time, by golden-section search."""
    golden = (mpmath.sqrt(5) - 1) / 2
    low = mpmath.mpf(max(time - NEAR * duration, 0.0))
    high = mpmath.mpf(min(time + NEAR * duration, duration))
    best = max(excess(x) for x in (time, low, high))
    for _ in range(STEPS):
        a, b = high - golden * (high - low), low + golden * (high - low)
        left, right = excess(a), excess(b)
        low, high = (low, b) if left > right else (a, high)
        best = max(best, left, right)
    return best


def _invariants(given: Fields, k: int):
    """Return a function of time that returns the invariants of path k."""
    rows = [_exact(given[key][k]) for key in ("radius", "angle", "height")]
    vehicle = None
    if "vehicle" in given:
        parameters = car(given["vehicle"][k]).parameters()._asdict()
        vehicle = SimpleNamespace(**{key: mpmath.mpf(float(x)) for key, x in parameters.items()})
    return lambda t: Invariants(_derivatives(rows, mpmath.mpf(t)), vehicle=vehicle, root=mpmath.sqrt)


def _excess(entry, invariants, limit: float):
    """Return a function of time: numerator − limit²·denominator, or numerator − limit·denominator if it has a sign."""

    def excess(t):
        i = invariants(t)
        bound = mpmath.mpf(float(limit)) / (1 if entry.factor is None else entry.factor(i.vehicle))
        denominator = 1 if entry.denominator is None else entry.denominator(i)
        return entry.numerator(i) - (bound if entry.signed else bound**2) * denominator

    return excess


def _exact(coefficients):
    return [mpmath.mpf(float(x)) for x in coefficients]


def _value(coefficients, t):
    result = mpmath.mpf(0)
    for c in reversed(coefficients):
        result = result * t + c
    return result


def _slope(coefficients):
    return [k * x for k, x in enumerate(coefficients)][1:]


def _product(a, b):
    found = [mpmath.mpf(0)] * (len(a) + len(b) - 1) if a and b else []
    for j, x in enumerate(a):
        for k, y in enumerate(b):
            found[j + k] += x * y
    return found


def _sum(a, b):
    count = max(len(a), len(b))
    a, b = (x + [mpmath.mpf(0)] * (count - len(x)) for x in (a, b))
    return [x + y for x, y in zip(a, b, strict=True)]


def _derivatives(rows, t):
    """Return the derivatives of orders 0 to 4 at time t in the rotating basis: e^{-iφ} d/dt (z e^{iφ}) = ż + iφ̇z."""
    radius, angle, height = rows
    rate = _slope(angle)
    x, y, z = radius, [], height
    found = []
    for _ in range(5):
        found.append(tuple(_value(c, t) if c else mpmath.mpf(0) for c in (x, y, z)))
        turned = [[-c for c in _product(rate, y)], _product(rate, x)]
        x, y, z = _sum(_slope(x), turned[0]), _sum(_slope(y), turned[1]), _slope(z)
    return found
