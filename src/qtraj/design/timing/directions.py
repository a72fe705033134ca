"""Compute the direction of motion of a route at its stops.

On a segment with the normalised time s, −1 ≤ s ≤ 1, let r' = (1 + s)^m (1 − s)^n q, where q is a polynomial that does
not vanish at the stops. The factors of q are positive except at stops, so the direction of motion and its derivatives
can be computed from q.
"""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.timing.grid import path_derivatives
from qtraj.design.timing.namespace import namespace
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.stops import Segments

STANDS = 1e-12
"""A velocity below about this fraction of the largest velocity in its segment is treated as zero."""

ROUNDED = 2.0
"""Bound on the rounding error of each coefficient of q, in units of the machine epsilon times the largest coefficient.
"""


STRAIGHT = 1e-9
"""A path that would turn by less than this angle [rad] in its whole duration is treated as straight."""


class Directions(NamedTuple):
    """For each segment, the coefficients of Q(t) with dQ/dt = q, the powers m and n, and a bound on the error of q.

    Here r' = (1 + s)^m (1 − s)^n q, where −1 ≤ s ≤ 1 is the normalised time. The bound is in units of the machine
    epsilon times the largest coefficient of q. It accounts for the rounding of the coefficients, and for the small
    remainder of r' at the stop that the division by (1 + s) or (1 − s) neglects.
    """

    coefficients: Float[np.ndarray, "segments terms 3"]
    powers: Int[np.ndarray, "segments 2"]
    roundings: Float[np.ndarray, " segments"]


def directions(s: Segments, standing: np.ndarray) -> Directions | None:
    """Return the directions of all segments, or None if no moving segment starts or ends at a stop.

    `standing` (segments, 2) indicates whether the velocity is zero at the start and at the end. Exact fractions are
    used, so each coefficient is rounded once. For segments without motion, Q (see `Directions`) is an arbitrary
    straight line.
    """
    still = ~s.coefficients[:, 1:].any(axis=(1, 2))
    some = np.flatnonzero(standing.any(axis=1) & ~still)
    if not some.size:
        return None
    c, powers = s.coefficients.copy(), np.zeros((still.size, 2), int)
    roundings = np.full(still.size, ROUNDED)
    c[still, 1, 0] = 1.0
    for i in some:
        c[i], powers[i], left = _direction(s.coefficients[i], s.durations[i], standing[i])
        roundings[i] += left / np.finfo(float).eps
    return Directions(c, powers, roundings)


def _direction(
    c: Float[np.ndarray, "terms 3"], duration: float, standing: np.ndarray
) -> tuple[np.ndarray, list[int], float]:
    """Return the coefficients of Q and the powers (see `Directions`), and the neglected remainder of r' at the stops.

    The remainder is relative to the size of q.
    """
    unit = Fraction(float(duration)) / 2
    # Fractions represent r' in powers of x = 1 + s exactly.
    p = [[(k + 1) * Fraction(float(x)) * unit**k for x in c[k + 1]] for k in range(len(c) - 1)]
    size, powers, left = _size(p), [0, 0], Fraction(0)
    while standing[0] and (rest := max(map(abs, p[0]))) <= STANDS * size:
        p, powers[0], left = p[1:], powers[0] + 1, left + rest
    while standing[1] and (rest := _size_at_end(p)) <= STANDS * size:
        p, powers[1], left = _divided(p), powers[1] + 1, left + rest
    found = np.zeros_like(c)
    for k, row in enumerate(p):
        found[k + 1] = [float(x / unit**k / (k + 1)) for x in row]
    return found, powers, float(left / _size(p))


def _size(p: list[list[Fraction]]) -> Fraction:
    return max(abs(x) * 2**k for k, row in enumerate(p) for x in row)


def _size_at_end(p: list[list[Fraction]]) -> Fraction:
    return max(abs(sum((row[a] * 2**k for k, row in enumerate(p)), Fraction(0))) for a in range(3))


def _divided(p: list[list[Fraction]]) -> list[list[Fraction]]:
    """Divide a polynomial in x = 1 + s by 2 − x; the remainder is neglected."""
    quotient = [[-x for x in p[-1]]]
    for row in p[-2:0:-1]:
        quotient.insert(0, [2 * b - a for a, b in zip(row, quotient[0], strict=True)])
    return quotient


def straight(path: AbstractHodograph, knots: Float[Array, " cells+1"]) -> Bool[Array, " cells"]:
    """Return whether the curvature of the path is zero to within rounding in the middle of each cell."""
    r1, r2, _ = path_derivatives(path, 0.5 * (knots[1:] + knots[:-1]))
    xp = namespace(r1)
    across = xp.linalg.norm(xp.cross(r1, r2, axis=0), axis=0)
    return across * xp.asarray(path.duration) <= STRAIGHT * xp.sum(r1 * r1, axis=0)
