"""Decide whether the velocity of a route vanishes within a segment: in floats with error bounds, or exactly."""

import numpy as np
from jaxtyping import Bool

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.surd import Claim
from qtraj.design.proof.deciding import decided
from qtraj.design.timing.directions import directions
from qtraj.path.components import dot
from qtraj.path.stops import Segments

VANISHES = 1e-9
"""The velocity counts as zero below about this fraction of its largest coefficient in the segment.

Where a straight line reverses, rounding errors of the other coordinates keep the velocity from being exactly zero.
"""


def first_zero(
    s: Segments, standing: Bool[np.ndarray, "n 2"], still: Bool[np.ndarray, " n"]
) -> tuple[int, float] | None:
    """Return the first segment in which the velocity vanishes, and the fraction of its duration there, or None.

    Segments that are `still` do not count, nor does a velocity of zero at the ends that `standing` indicates.
    """
    divided = directions(s, standing)
    rows = sorted(divided)
    plain = ~still
    plain[rows] = False
    powers = np.arange(1, s.coefficients.shape[1])
    v = s.coefficients[:, 1:] * (powers * s.durations[:, None] ** powers)[..., None]
    least = VANISHES * np.abs(v).max(axis=(1, 2))

    def in_floats() -> Claim:
        rates = tuple(BoundedPolynomial(x.T, k=len(powers) + 2) for x in np.moveaxis(v, 2, 0))
        return Claim(dot(rates, rates) - BoundedPolynomial.constant(least**2, k=1))

    def in_integers(k: int) -> Claim:
        x, y, z = (ExactPolynomial.from_floats(s.coefficients[k, :, axis]) for axis in range(3))
        rates = tuple(p.substituted(float(s.durations[k])).derivative() for p in (x, y, z))
        return Claim(dot(rates, rates) - ExactPolynomial.of(least[k]) * ExactPolynomial.of(least[k]))

    def of_direction(k: int) -> Claim:
        q = divided[rows[k]].direction
        return Claim(dot(q, q))

    found = decided(plain, in_floats, in_integers, strict=True)
    beside_stops = decided(np.ones(len(rows), bool), lambda: None, of_direction, strict=True)
    zeros = [(int(k), float(found.at[k])) for k in np.flatnonzero(plain & ~found.proved)]
    zeros += [(rows[k], float(beside_stops.at[k])) for k in np.flatnonzero(~beside_stops.proved)]
    return min(zeros, default=None)
