"""Bound the pace |r'(u)| of a polynomial path, and the change of the pace, in intervals of the parameter u.

In an interval, r' is expanded at the middle. With the distance x from the middle, in half lengths of the interval, the
squared pace is a polynomial Σ sₖxᵏ with |x| ≤ 1, so it is between s₀ ± Σ|sₖ| (k ≥ 1), and its derivative is at most
Σ k|sₖ|. The derivative of the pace is this derivative divided by twice the pace, and at most |r''|. The same sums
with the magnitudes of all terms bound the rounding errors.
"""

from math import comb
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.algebra.polynomial import taylor_terms
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route

ROUNDING = 1e-12
"""Fraction of the sums of magnitudes that exceeds the rounding errors."""

Terms = list[Float[np.ndarray, " n"]]
"""Coefficients of polynomials in x in n intervals, in ascending order."""


class PaceBounds(NamedTuple):
    """Upper bounds on the pace and on the magnitude of its derivative; infinite where none was found."""

    pace: Float[np.ndarray, " n"]
    change: Float[np.ndarray, " n"]


def pace_bounds(
    path: AbstractHodograph, low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]
) -> PaceBounds | None:
    """Return bounds in intervals of the parameter of one path with concrete values, or None if it is not polynomial.

    There are no bounds in intervals that contain a joint of a route.
    """
    found = _in_intervals(path, low, high, _bounds)
    return None if found is None else PaceBounds(*found)


def remainders(
    path: AbstractHodograph, low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"], terms: int
) -> Float[np.ndarray, " n"] | None:
    """Return bounds on the Taylor coefficient of the order `terms` of the distance, at any point of intervals.

    The coefficients are those of powers of the fraction of the interval. They bound the error of an interpolation. The
    result is infinite where no bound was found, and None if the path is not polynomial.
    """
    found = _in_intervals(path, low, high, lambda *given: (_remainder(given, terms),))
    return None if found is None else found[0]


def _in_intervals(path: AbstractHodograph, low: np.ndarray, high: np.ndarray, bounds: Any) -> Any:
    """Return bounds, a function of coefficients, angle, middles and half lengths; infinite over joints of a route."""
    half, middle = 0.5 * (high - low), 0.5 * (high + low)
    if isinstance(path, Route):
        times = np.asarray(path.times, float)
        row = np.clip(np.searchsorted(times, middle, side="right") - 1, 0, times.size - 2)
        coefficients = np.asarray(path.in_time(), float)[row]
        own, zero = [coefficients[..., k].T for k in range(3)], [np.zeros((1, half.size))]
        found = bounds(own, zero, middle - times[row], half)
        inside = (low >= times[row]) & (high <= times[row + 1])
        return tuple(np.where(inside, x, np.inf) for x in found)
    polynomials = path.polynomials()
    if polynomials is None:
        return None
    parts = (polynomials.x, polynomials.y, polynomials.z, polynomials.angle)
    x, y, z, angle = (np.zeros((1, 1)) if c is None else np.asarray(c, float)[:, None] for c in parts)
    return bounds([x, y, z], angle, middle, half)


def _rates(parts: Any, angle: Any, middle: np.ndarray, half: np.ndarray, sign: float) -> tuple[list[Terms], Terms]:
    """Return the components of r' in axes that turn by an angle, and the rate of the angle.

    `parts` are the coefficients of the position in these axes. For magnitudes, `sign` is 1, otherwise −1.
    """
    x, y, z = parts
    turn = _rate(angle, middle, half)
    along, across = (_expanded(c, middle, half) for c in (x, y))
    first = _sum(_rate(x, middle, half), [sign * c for c in _product(across, turn)])
    return [first, _sum(_rate(y, middle, half), _product(along, turn)), _rate(z, middle, half)], turn


def _expanded(coefficients: np.ndarray, middle: np.ndarray, half: np.ndarray) -> Terms:
    """Return polynomials, given by coefficients (terms, …) in u, as polynomials in x."""
    terms = taylor_terms(list(coefficients), middle, len(coefficients) - 1)
    return [np.broadcast_to(c, half.shape) * half**k for k, c in enumerate(terms)]


def _rate(coefficients: np.ndarray, middle: np.ndarray, half: np.ndarray) -> Terms:
    """Return the derivatives with respect to u of polynomials."""
    powers = np.arange(1, len(coefficients))
    return _expanded(coefficients[1:] * powers.reshape(-1, 1), middle, half) or [np.zeros_like(half)]


def _sum(a: Terms, b: Terms) -> Terms:
    a, b = (a, b) if len(a) >= len(b) else (b, a)
    return [*(x + y for x, y in zip(a, b, strict=False)), *a[len(b) :]]


def _product(a: Terms, b: Terms) -> Terms:
    found: list[Any] = [0.0] * (len(a) + len(b) - 1)
    for j, x in enumerate(a):
        for k, y in enumerate(b):
            found[j + k] = found[j + k] + x * y
    return found


def _magnitudes(parts: Any, angle: Any, middle: np.ndarray, half: np.ndarray) -> list[Terms]:
    """Return the components of r' with the magnitudes of all terms."""
    return _rates([np.abs(c) for c in parts], np.abs(angle), np.abs(middle), half, 1.0)[0]


def _square(rates: list[Terms]) -> Terms:
    s: Terms = [np.zeros_like(rates[0][0])]
    for c in rates:
        s = _sum(s, _product(c, c))
    return s


def _remainder(given: tuple[Any, Any, Any, Any], terms: int) -> np.ndarray:
    """Return the result of `remainders`; `given` are the coefficients, the angle, the middles and the half lengths.

    With the squared pace Σ sₖxᵏ, the Taylor coefficients of the pace at any x follow from those of its square by the
    recurrence of the root, here for magnitudes.
    """
    half = given[-1]
    s, sizes = _square(_rates(*given, -1.0)[0]), _square(_magnitudes(*given))
    s = [np.abs(c) + ROUNDING * size for c, size in zip(s, sizes, strict=True)]
    least = s[0] - 2 * ROUNDING * sizes[0] - sum(s[1:])
    root = np.sqrt(np.where(least > 0, least, 1.0))
    pace: Terms = [root]
    for k in range(1, terms):
        own = sum(comb(j, k) * s[j] for j in range(k, len(s))) + sum(pace[i] * pace[k - i] for i in range(1, k))
        pace.append(own / (2 * root))
    found = half * pace[-1] / terms * 2.0**terms * (1 + ROUNDING)
    return np.where(least > 0, found, np.inf)


def _bounds(parts: Any, angle: Any, middle: np.ndarray, half: np.ndarray) -> PaceBounds:
    rates, turn = _rates(parts, angle, middle, half, -1.0)
    sizes = [sum(c) for c in _magnitudes(parts, angle, middle, half)]
    s = _square(rates)
    error = ROUNDING * sum(x * x for x in sizes)
    rest, slope = sum(map(abs, s[1:])), sum(k * abs(c) for k, c in enumerate(s))
    least, pace = s[0] - rest - error, np.sqrt(s[0] + rest + error)
    width = np.where(half > 0, half, 1.0)
    by_square = (slope + len(s) * error) / (2 * width * np.sqrt(np.where(least > 0, least, 1.0)))
    each = zip(rates, sizes, strict=True)
    second = [sum(k * (abs(c) + ROUNDING * size) for k, c in enumerate(x)) / width for x, size in each]
    whole = (np.sqrt(sum(x * x for x in second)) + sum(map(abs, turn)) * pace) * (1 + ROUNDING)
    change = np.where(half > 0, np.where(least > 0, np.minimum(by_square, whole), whole), 0.0)
    return PaceBounds(pace, change)
