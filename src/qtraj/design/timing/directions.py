"""Compute the direction of motion of a route at its stops.

On a segment, let u be the fraction of its duration, and r' = uᵐ (1 − u)ⁿ q, where q is a polynomial that does not
vanish at the stops. The factors of q are positive except at stops, so the direction of motion and its derivatives can
be computed from q.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.proof.composed import directed
from qtraj.design.timing.grid import path_derivatives
from qtraj.foundation.namespace import namespace
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.stops import Segments

STANDS = 1e-12
"""A velocity below about this fraction of the largest velocity in its segment is treated as zero."""

STRAIGHT = 1e-9
"""On a straight part, the path turns by less than about this angle [rad] in its duration."""

Vector = tuple[ExactPolynomial, ...]


class Direction(NamedTuple):
    """The vector q and the factor of r' = factor·q on a segment, in exact integers.

    The small remainder of r' at a stop is set to zero.
    """

    direction: Vector
    factor: ExactPolynomial


def directions(s: Segments, standing: Bool[Any, "segments 2"]) -> dict[int, Direction]:
    """Return the directions of the moving segments that start or end at a stop, by the index of the segment.

    `standing` indicates whether the velocity is zero at the start and at the end. Segments that are curves with a
    progress are included, because they are products of this form: the derivative of a curve does not vanish.
    """
    moving, composed = s.coefficients[:, 1:].any(axis=(1, 2)), s.composed
    found = {
        int(i): _direction(s.coefficients[i], float(s.durations[i]), standing[i])
        for i in np.flatnonzero(standing.any(axis=1) & moving & ~composed)
    }
    for i in np.flatnonzero(composed & moving):
        q, factor = directed(s, int(i))
        found[int(i)] = Direction(tuple(q), factor)
    return found


def _direction(c: Float[Any, "terms 3"], duration: float, standing: np.ndarray) -> Direction:
    q: Vector = tuple(ExactPolynomial.from_floats(c[:, axis]).substituted(duration).derivative() for axis in range(3))
    size, factor = _size(q), ExactPolynomial([1])
    for side, own in zip(standing, (ExactPolynomial([0, 1]), ExactPolynomial([1, -1])), strict=True):
        while side and max(abs(p.floats()[0]) for p in q) <= STANDS * size:
            q, factor = tuple(p.divided_by_power(1) for p in q), factor * own
        q = tuple(p.reflected() for p in q)
    return Direction(q, factor)


def _size(q: Vector) -> float:
    """Return the largest coefficient."""
    return max(abs(x) for p in q for x in p.floats())


def straight(path: AbstractHodograph, knots: Float[Any, " cells+1"]) -> Bool[Any, " cells"]:
    """Return whether the curvature of the path is zero to within rounding in the middle of each cell."""
    r1, r2, _ = path_derivatives(path, 0.5 * (knots[1:] + knots[:-1]))
    xp = namespace(r1)
    across = xp.linalg.norm(xp.cross(r1, r2, axis=0), axis=0)
    return across * xp.asarray(path.duration) <= STRAIGHT * xp.sum(r1 * r1, axis=0)
