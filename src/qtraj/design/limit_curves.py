"""Polynomials that replace a linear limit along the way in intervals of the parameter of a path, for proofs.

The limit is a linear function of the distance, and the distance a smooth function of the parameter. The polynomial
interpolates the limit at Chebyshev nodes. Its error is at most a constant times a bound on a derivative of the
distance. This error and the effect of the uncertainty of the distance are subtracted, so that the polynomial is nowhere
less strict than the limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra import bernstein
from qtraj.design.varying import ROUNDING, Varying
from qtraj.path.chords import within_segments
from qtraj.path.distances import CONVERGED, UNCERTAINTY
from qtraj.path.pace_bounds import pace_bounds, remainders
from qtraj.path.route import Route

TERMS = bernstein.INTERPOLATED
"""Number of coefficients of a polynomial."""

ACCURATE, ROUGHLY = 1e-10, 1e-7
"""Relative errors of polynomials that are accurate enough; the second one on paths that are not polynomial."""

SHORT = 0.25
"""Part of the uncertainty of a distance below which an error of the distance needs no smaller intervals."""

NEAR = 1e-2
"""A limit that bends closer to an end of an interval than this part of the uncertainty bends at the end."""

APART = 4 * CONVERGED / UNCERTAINTY
"""Part of the uncertainty that exceeds the effect of errors of the differences between distances: the largest one
times the Lebesgue constant of the nodes, which is below 3. An error of all distances in an interval has no such factor.
"""

OF_PARAMETERS = 16 * float(np.finfo(float).eps)
"""Relative rounding error of the parameters of intervals and nodes."""


class Curves(NamedTuple):
    """Polynomials for a limit in n intervals, by Bernstein coefficients in the fraction of the interval.

    `rest` is by how much each is stricter than the limit, at most, and `rough` whether polynomials in halves of the
    interval are closer to the limit.
    """

    coefficients: Float[np.ndarray, "n terms"]
    rest: Float[np.ndarray, " n"]
    rough: Bool[np.ndarray, " n"]


def curves(limit: Varying, low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]) -> Curves:
    """Return polynomials between parameters of the path that are nowhere less strict than a linear limit.

    Where no accurate polynomial is known, and where its sign would change, it is a constant or a line.
    """
    on = limit.on
    line, rest = limit.approximated(low, high)
    size = np.abs(line).max(axis=1)
    is_line = line[:, 0] != line[:, 1]
    stricter = np.where(is_line, limit.side * ROUNDING * TERMS * size, 0.0)  # for the rounding errors of the elevation
    plain = bernstein.elevated(line, TERMS) - stricter[:, None]
    long = on.at(high) - on.at(low) > SHORT * on.uncertainty
    found = _interpolated(limit, low, high)
    if found is None:
        return Curves(plain, rest, long & (rest > ROUGHLY * size))
    own, error, accurate = found
    one_sign = ((own > 0).all(axis=1) | (own < 0).all(axis=1)) & (error < rest)
    rough = np.where(one_sign, ~accurate, rest > ACCURATE * size)
    return Curves(np.where(one_sign[:, None], own, plain), np.where(one_sign, error, rest), long & rough)


def _interpolated(
    limit: Varying, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return polynomials, how much stricter than the limit (infinite where it bends), and which are accurate.

    The result is None if the path is not polynomial.
    """
    on, side = limit.on, limit.side
    ends = within_segments(on.path, low, high) if isinstance(on.path, Route) else (low, high)
    remainder, bounds = remainders(on.path, *ends, TERMS), pace_bounds(on.path, *ends)
    if remainder is None or bounds is None:
        return None
    first, last, error = on.at(low), on.at(high), on.uncertainty
    d, values = np.asarray(limit.along.distance, float), np.asarray(limit.along.values, float)
    bends = np.searchsorted(d, first + NEAR * error) < np.searchsorted(d, last - NEAR * error)
    k = np.maximum(np.searchsorted(d, 0.5 * (first + last), side="right") - 1, 0)[:, None]
    rise = np.append(np.diff(values) / np.diff(d), 0.0)
    u = low[:, None] + (high - low)[:, None] * bernstein.nodes(TERMS)
    at_nodes = values[k] + rise[k] * (on.at(u.ravel()).reshape(u.shape) - d[k])
    size = np.abs(values[np.concatenate([k, np.minimum(k + 1, values.size - 1)], axis=1)]).max(axis=1)
    slope = limit.steepest(first, last)
    of_parameter = OF_PARAMETERS * bounds.pace * np.maximum(np.abs(low), np.abs(high))
    of_distance = bernstein.error(remainder, TERMS) + of_parameter
    with np.errstate(invalid="ignore"):
        above = slope * (of_distance + (1 + APART + 2 * NEAR) * error)
        above = np.where(slope > 0, above, 0.0) + bernstein.ROUNDING * size
        own = bernstein.interpolated(at_nodes) - side * above[:, None]
        accurate = slope * of_distance <= np.maximum(SHORT * slope * error, ACCURATE * size)
    return own, np.where(bends | ~np.isfinite(above), np.inf, 2 * above), accurate
