"""Prove limits on many segments at once by the Bernstein coefficients of their inequalities, with NumPy.

Most segments of a route satisfy their limits with a margin. Their inequalities have positive Bernstein coefficients on
the whole segment. This is a proof and costs little. Only the other segments need the branch and bound of `judge`. The
time unit is the duration of the segment, and the length unit is the metre. All rounding errors are included.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra.bernstein import EPS, Polynomials, from_powers
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PathQuantity

DIVISORS = {"speed": "S", "cross_norm": "N", "level": "H"}

INSTANTS = 33
"""Number of equally spaced instants at which a quantity is sampled in a proved segment."""

NEAR = 0.98
"""The search refines the local maxima of a squared quantity that exceed this fraction of the largest sample."""

NARROWING = (8.0, 64.0, 512.0)
"""Factors by which the three instants of a parabola are closer together than the samples, one for each refinement."""

EVEN = 0.2
"""Minimum ratio of the lower to the upper bound on a divisor.

With a smaller ratio, peaks may be narrower than the sampling interval, so the first pass does not decide the limit.
"""

MAX_SHIFT = 4.0
"""Largest distance of the vertex of a parabola from the middle of its three instants, in units of their spacing."""

ROUNDINGS = 10
"""Bound on the number of roundings in a coefficient of a derivative, due to powers of the duration and factorials."""

DURATIONS = (2.0**-40, 2.0**40)
"""Range of durations [s] in which powers of the duration neither overflow nor underflow."""


class Derivatives(NamedTuple):
    """The first three derivatives of the position in each segment, with its duration `h` [s] as the unit of time.

    Each array contains the coefficients of ascending powers of the time in [0, 1]. Its axes are the power, the
    component and the segment.
    """

    orders: list[Float[np.ndarray, "terms 3 rows"]]
    h: Float[np.ndarray, " rows"]

    def rows(self, selected: np.ndarray) -> "Derivatives":
        """Return the derivatives of the selected segments."""
        return Derivatives([a[:, :, selected] for a in self.orders], self.h[selected])


def is_simple(entry: PathQuantity) -> bool:
    """Return whether the first pass supports a quantity.

    The quantity must be nonnegative, must not need a vehicle, and must have no separate formula `square`.
    """
    return not entry.needs_vehicle and entry.square is None and entry.signed is None


def derivatives(c: np.ndarray, directions: np.ndarray, h: np.ndarray, keep: np.ndarray) -> Derivatives:
    """Return the first derivative of `directions`, and the second and third derivative of `c` or `directions`.

    The second and third derivative are computed from `c` where `keep` (rows,) is true, otherwise from `directions`.

    `c` and `directions` (rows, terms, 3) are coefficients of ascending powers of the time, one row for each segment.
    `h` (rows,) are the durations of the segments.
    """
    powers = [np.ones_like(h)]
    for _ in range(c.shape[1] - 1):
        powers.append(powers[-1] * h)
    factors = np.stack(powers)[:, None]
    of_direction = np.ascontiguousarray(directions.transpose(1, 2, 0)) * factors
    of_path = np.where(keep, c.transpose(1, 2, 0) * factors, of_direction) if keep.any() else of_direction
    return Derivatives([_derivative(x, k) for k, x in enumerate((of_direction, of_path, of_path), start=1)], h)


def _derivative(a: np.ndarray, order: int) -> np.ndarray:
    k = range(order, len(a))
    return a[order:] * np.array([math.factorial(j) / math.factorial(j - order) for j in k])[:, None, None]


def proved(
    of: Derivatives, entries: list[PathQuantity], bounds: Float[np.ndarray, " limits"], roundings: int
) -> Bool[np.ndarray, "rows limits"]:
    """Return whether each limit is proved on each segment; false means only that this pass does not decide it.

    `roundings` is the number of rounding errors that each coefficient of the segments already contains.
    """
    with np.errstate(all="ignore"):  # no bound is proved after an overflow
        forms = [from_powers(np.swapaxes(a, 0, 1), roundings + ROUNDINGS) for a in of.orders]
        i = Invariants([None, *forms])
        return np.stack(
            [_is_proved(entry, i, bound, of.h) for entry, bound in zip(entries, bounds, strict=True)], axis=1
        )


def _is_proved(entry: PathQuantity, i: Invariants, bound: float, h: np.ndarray) -> np.ndarray:
    numerator: Polynomials = entry.numerator(i)
    denominator: Polynomials = numerator.one() if entry.denominator is None else entry.denominator(i)
    square = (bound * _power(h, entry.per_time)) ** 2
    normal = (square > 2.0**-200) & (square < 2.0**200) & (h > DURATIONS[0]) & (h < DURATIONS[1])
    slack = denominator.multiple(square, np.where(normal, 16 * EPS * square, np.inf)) - numerator
    positive = slack.form.positive
    if entry.divisor is None:
        return positive
    divisor = getattr(i, DIVISORS[entry.divisor]).form
    return positive & divisor.positive & (divisor.lower > EVEN * divisor.size)


def _power(h: np.ndarray, exponent: int) -> np.ndarray:
    result = np.ones_like(h)
    for _ in range(exponent):
        result = result * h
    return result


def largest(of: Derivatives, entry: PathQuantity) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest value of a quantity in each segment, and its time since the start of the segment [s].

    The divisor must be positive. The quantity is sampled, and parabolas refine all maxima that can be the largest.
    """
    u = np.linspace(0.0, 1.0, INSTANTS)
    squares = _sampled(of, entry, u)
    best, rows = np.argmax(squares, axis=0), np.arange(squares.shape[1])
    value, at = squares[best, rows], u[best]
    left, right = np.full_like(squares, -np.inf), np.full_like(squares, -np.inf)
    left[1:], right[:-1] = squares[:-1], squares[1:]
    candidates = (squares > left) & (squares >= right) & (squares >= NEAR * value)
    place, row = np.nonzero(candidates)
    place = np.clip(place, 1, INSTANTS - 2)
    centre, step = u[place], u[1]
    middle, before, after = squares[place, row], left[place, row], right[place, row]
    chosen, shift = of.rows(row), _vertex(before, middle, after)
    for narrowing in NARROWING:
        # The three instants stay inside the segment, even for a maximum at an end.
        centre = np.clip(centre + step * shift, u[1] / narrowing, 1 - u[1] / narrowing)
        step = u[1] / narrowing
        before, middle, after = (_at(chosen, entry, centre + k * step) for k in (-1, 0, 1))
        _replace(value, at, row, middle, centre)
        shift = _vertex(before, middle, after)
    centre = np.clip(centre + step * shift, 0.0, 1.0)
    _replace(value, at, row, _at(chosen, entry, centre), centre)
    scale = _power(of.h, entry.per_time)
    return np.sqrt(np.maximum(value, 0.0)) / scale, at * of.h


def _replace(value: np.ndarray, at: np.ndarray, row: np.ndarray, new: np.ndarray, instants: np.ndarray) -> None:
    """Replace the values and instants of the rows in which a candidate is at least as large, to within rounding."""
    order = np.argsort(new, kind="stable")  # the largest candidate of a row is written last
    row, new, instants = row[order], new[order], instants[order]
    better = new >= value[row] * (1 - 4 * EPS)
    at[row[better]] = instants[better]
    value[row[better]] = np.maximum(new[better], value[row[better]])


def _vertex(before: np.ndarray, middle: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the offset of the vertex of a parabola through three values at −1, 0 and 1, or 0 if it has no maximum."""
    curvature = 2 * middle - before - after
    peak = curvature > 0
    return np.clip(np.where(peak, (after - before) / np.where(peak, 2 * curvature, 1.0), 0.0), -MAX_SHIFT, MAX_SHIFT)


def _sampled(of: Derivatives, entry: PathQuantity, u: np.ndarray) -> np.ndarray:
    """Return the squared quantity (instants, rows) at the same instants `u` in each segment."""
    orders = []
    for a in of.orders[: entry.order]:
        values = (u[:, None] ** np.arange(len(a))) @ a.reshape(len(a), -1)
        orders.append(tuple(np.moveaxis(values.reshape(len(u), *a.shape[1:]), 1, 0)))
    return _square(entry, orders)


def _at(of: Derivatives, entry: PathQuantity, u: np.ndarray) -> np.ndarray:
    """Return the squared quantity (rows,) at one instant `u` in each segment."""
    orders = []
    for a in of.orders[: entry.order]:
        value = a[-1]
        for term in a[-2::-1]:
            value = term + u * value
        orders.append(tuple(value))
    return _square(entry, orders)


def _square(entry: PathQuantity, orders: list[Any]) -> np.ndarray:
    i = Invariants([None, *orders], root=np.sqrt)
    numerator = entry.numerator(i)
    return numerator if entry.denominator is None else numerator / entry.denominator(i)
