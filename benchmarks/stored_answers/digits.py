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

ROUNDED = mpmath.mpf(10) ** -14
"""Relative size of a divisor below which a quantity counts as undefined."""


def contradiction(given: Fields, k: int, name: str, limit: float, status: str, time: float) -> str:
    """Return why the `status` of a limit on path k cannot be right, or an empty string.

    A limit that is "proved" must be satisfied at many instants and near `time` [s]; one that is "broken" must be
    violated near `time`; the divisor of an "undefined" quantity must be negligible at `time`.
    """
    with mpmath.workdps(DIGITS):
        excess = _excess(given, k, name, limit)
        if status == "undefined":
            divisor, size = excess(time)[1:]
            return "" if divisor <= ROUNDED * size else f"the relative divisor is {mpmath.nstr(divisor / size, 5)}"
        duration = float(given["duration"][k])
        largest = _largest(lambda t: excess(t)[0], time, duration)
        if status == "proved":
            largest = max(largest, *(excess(t)[0] for t in np.linspace(0.0, duration, SAMPLES).tolist()))
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


def _excess(given: Fields, k: int, name: str, limit: float):
    """Return a function of time: numerator − limit²·denominator, the divisor, and the size of the divisor."""
    entry = quantity(name)
    rows = [_exact(given[key][k]) for key in ("radius", "angle", "height")]
    vehicle = None
    if "vehicle" in given:
        fields = car(given["vehicle"][k]).parameters()
        vehicle = SimpleNamespace(**{key: mpmath.mpf(float(x)) for key, x in fields._asdict().items()})
    bound = mpmath.mpf(float(limit)) / (1 if entry.factor is None else entry.factor(vehicle))

    def excess(t):
        i = Invariants(_derivatives(rows, mpmath.mpf(t)), vehicle=vehicle, root=mpmath.sqrt)
        denominator = 1 if entry.denominator is None else entry.denominator(i)
        size = {"cross_norm": i.S * i.A, "level": i.S, "speed": mpmath.mpf(1)}.get(entry.divisor or "", mpmath.mpf(1))
        divisor = {"cross_norm": i.N, "level": i.H, "speed": i.S}.get(entry.divisor or "", mpmath.mpf(1))
        return entry.numerator(i) - (bound if entry.signed else bound**2) * denominator, divisor, size

    return excess


def _exact(coefficients):
    return [mpmath.mpf(float(x)) for x in coefficients]


def _value(coefficients, t):
    return mpmath.polyval(coefficients[::-1], t)


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
