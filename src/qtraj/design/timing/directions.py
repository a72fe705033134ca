"""The direction of a route at its stops: the polynomial q with r' = (1 + s)^m (1 − s)^n q, −1 ≤ s ≤ 1 in a segment.

The two factors vanish only at stops and are positive elsewhere; q does not vanish at the stops. So the direction of
motion and its change can be computed from q.
"""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.path.stops import Segments

STANDS = 1e-12
"""A velocity below this fraction of the size of its segment is zero."""


class Directions(NamedTuple):
    """For each segment the coefficients of Q(t), whose time derivative is q, and the powers m and n."""

    coefficients: Float[np.ndarray, "segments terms 3"]
    powers: Int[np.ndarray, "segments 2"]


def directions(s: Segments, standing: np.ndarray) -> Directions | None:
    """The directions of all segments, or None if no moving segment starts or ends at a stop.

    `standing` (segments, 2): whether the velocity is zero at the start and at the end. Each coefficient is rounded
    once. Segments without motion get an arbitrary straight line.
    """
    still = ~s.coefficients[:, 1:].any(axis=(1, 2))
    some = np.flatnonzero(standing.any(axis=1) & ~still)
    if not some.size:
        return None
    c, powers = s.coefficients.copy(), np.zeros((still.size, 2), int)
    c[still, 1, 0] = 1.0
    for i in some:
        c[i], powers[i] = _direction(s.coefficients[i], s.durations[i], standing[i])
    return Directions(c, powers)


def _direction(c: Float[np.ndarray, "terms 3"], duration: float, standing: np.ndarray) -> tuple[np.ndarray, list[int]]:
    unit = Fraction(float(duration)) / 2
    # Fractions represent r' in powers of x = 1 + s exactly.
    p = [[(k + 1) * Fraction(float(x)) * unit**k for x in c[k + 1]] for k in range(len(c) - 1)]
    size = max(abs(x) * 2**k for k, row in enumerate(p) for x in row)
    powers = [0, 0]
    while standing[0] and max(map(abs, p[0])) <= STANDS * size:
        p, powers[0] = p[1:], powers[0] + 1
    while standing[1] and max(abs(sum(row[a] * 2**k for k, row in enumerate(p))) for a in range(3)) <= STANDS * size:
        p, powers[1] = _divided(p), powers[1] + 1
    found = np.zeros_like(c)
    for k, row in enumerate(p):
        found[k + 1] = [float(x / unit**k / (k + 1)) for x in row]
    return found, powers


def _divided(p: list[list[Fraction]]) -> list[list[Fraction]]:
    """The quotient of a polynomial in x by 2 − x, without the remainder."""
    quotient = [[-x for x in p[-1]]]
    for row in p[-2:0:-1]:
        quotient.insert(0, [2 * b - a for a, b in zip(row, quotient[0], strict=True)])
    return quotient
