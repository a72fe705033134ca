"""Enumerate the motions of piecewise constant jerk between two states, in NumPy, over a batch.

Jerk and acceleration limit are 1. Forwards, the jerk is 1, 0, −1, 0, −1, 0, 1 in the seven segments of a motion; if it
is 0 in the fourth, the rate is then constant. The fastest motion has this form, or is its mirror image (all signs
changed). The acceleration rises from a0 to p ≤ 1, keeps p for the time h if p = 1, and falls to 0, where the rate is w;
it falls further to −q, keeps −q for the time k if q = 1, and rises to a1. If p or q is negative, the acceleration
changes directly from p to −q without a coast. With the rates c = v − a²/2, from which the acceleration would have risen
since it was 0, and with b0 = a0, b1 = −a1 (the second half is a first half, reversed in time):

    w = c0 + p² + ph = c1 + q² + qk,    Φ = F(c0, b0, p, h) + F(c1, b1, q, k) + w·(time of the coast)
    F(c, b, p, h) = c(p − b) − b³/6 + ch + p²h/2 + ph²/2 + wp

Without h, k and a coast, m = p + q solves a quartic equation with the coefficients of `_both_peaks`; with one of h and
k, q or p does (`_one_hold`); with both, w solves a quadratic equation (`_two_holds`).
"""

import functools
from typing import Any, NamedTuple

import numpy as np

Batch = Any
"""An array over a batch of motions; in the formulas without a search also a JAX array."""

NEWTON_STEPS = 4
"""Number of Newton steps that refine the eigenvalues of companion matrices."""


class Ends(NamedTuple):
    """The distance and the rates and accelerations of both ends, where b1 is minus the final acceleration."""

    distance: Batch
    v0: Batch
    b0: Batch
    v1: Batch
    b1: Batch

    @property
    def c0(self) -> Batch:
        """The initial rate without the initial acceleration."""
        return self.v0 - self.b0**2 / 2

    @property
    def c1(self) -> Batch:
        """The final rate without the final acceleration."""
        return self.v1 - self.b1**2 / 2

    def mirrored(self) -> "Ends":
        """Return the ends with all signs changed."""
        return Ends(*(-x for x in self))

    def reversed(self) -> "Ends":
        """Return the ends of the motion that runs backwards in time, with the same rates."""
        return Ends(self.distance, self.v1, self.b1, self.v0, self.b0)


class Motions(NamedTuple):
    """The peaks p and q, the times h and k at these peaks, and the time of the coast of motions."""

    p: Batch
    h: Batch
    q: Batch
    k: Batch
    coast: Batch

    def rate(self, ends: Ends) -> Batch:
        """Return the rate w at zero acceleration."""
        return ends.c0 + self.p**2 + self.p * self.h

    def duration(self, ends: Ends) -> Batch:
        """Return the duration."""
        return (self.p - ends.b0) + self.h + (self.p + self.q) + self.coast + self.k + (self.q - ends.b1)

    def shortest_segment(self, ends: Ends) -> Batch:
        """Return the shortest time of the segments, which is negative for a motion that does not exist."""
        times = [self.p - ends.b0, self.h, self.p + self.q, self.coast, self.k, self.q - ends.b1]
        return functools.reduce(np.minimum, times)


def half_distance(c: Batch, b: Batch, p: Batch, h: Batch) -> tuple[Batch, Batch]:
    """Return F(c, b, p, h), and the sum of the magnitudes of its terms."""
    terms = [c * (p - b), -(b**3) / 6, c * h, p**2 * h / 2, p * h**2 / 2, (c + p**2 + p * h) * p]
    return sum(terms), sum(map(abs, terms))


def enumerate_motions(ends: Ends, max_rate: Batch) -> Motions:
    """Return all motions of the forward form, with a new first axis; also such that have negative times."""
    backwards = ends.reversed()
    roots = _real_roots(np.stack([_both_peaks(ends), _one_hold(ends), _one_hold(backwards)], axis=1))
    kinds = [_from_sum(m, ends) for m in roots[:, 0]]
    kinds += [_from_last_peak(q, ends) for q in roots[:, 1]]
    kinds += [_exchanged(_from_last_peak(p, backwards)) for p in roots[:, 2]]
    kinds += [*_two_holds(ends), _at_rate(ends, max_rate), _single_ramp(ends)]
    return Motions(*(np.stack(np.broadcast_arrays(*x)) for x in zip(*kinds, strict=True)))


def _exchanged(motion: Motions) -> Motions:
    return Motions(motion.q, motion.k, motion.p, motion.h, motion.coast)


def _both_peaks(ends: Ends) -> Batch:
    """Return the coefficients of m⁴ + 4(c0 + c1)m² − 4Dm − (c1 − c0)², for motions without segments of zero jerk."""
    v0, b0, v1, b1 = ends[1:]
    left = ends.distance + (v0 * b0 - b0**3 / 3) + (v1 * b1 - b1**3 / 3)
    coefficients = [1.0, 0.0, 4 * (ends.c0 + ends.c1), -4 * left, -((ends.c1 - ends.c0) ** 2)]
    return np.stack(np.broadcast_arrays(*coefficients))


def _from_sum(m: Batch, ends: Ends) -> Motions:
    """Return the motion without segments of zero jerk from m = p + q."""
    ratio = np.where(m > 0, (ends.c1 - ends.c0) / np.where(m > 0, m, 1.0), np.nan)
    zero = np.zeros_like(m)
    return Motions((m + ratio) / 2, zero, (m - ratio) / 2, zero, zero)


def _one_hold(ends: Ends) -> Batch:
    """Return the coefficients of (q² + q)²/2 + c1(q² + 2q) + C, for motions with p = 1 and k = 0, so w = c1 + q²."""
    c0, c1, b0, b1 = ends.c0, ends.c1, ends.b0, ends.b1
    constant = (c1**2 + c1 - c0**2 + c0) / 2 - c0 * b0 - b0**3 / 6 - c1 * b1 - b1**3 / 6 - ends.distance
    return np.stack(np.broadcast_arrays(0.5, 1.0, c1 + 0.5, 2 * c1, constant))


def _from_last_peak(q: Batch, ends: Ends) -> Motions:
    """Return the motion with p = 1 and k = 0 from q."""
    zero = np.zeros_like(q)
    return Motions(1 + zero, ends.c1 - ends.c0 + q**2 - 1, q, zero, zero)


def _two_holds(ends: Ends) -> list[Motions]:
    """Return the motions with p = q = 1: w² + w = Φ + Σ((c² − c)/2 + cb + b³/6)."""
    one = np.ones_like(ends.v0)
    sides = [(c**2 - c) / 2 + c * b + b**3 / 6 for c, b in ((ends.c0, ends.b0), (ends.c1, ends.b1))]
    root = np.sqrt(0.25 + ends.distance + sides[0] + sides[1])
    return [Motions(one, w - ends.c0 - 1, one, w - ends.c1 - 1, 0 * one) for w in (root - 0.5, -root - 0.5)]


def _at_rate(ends: Ends, max_rate: Batch) -> Motions:
    """Return the motion that coasts at the limit on the rate."""
    (p, h), (q, k) = ramp(max_rate - ends.c0), ramp(max_rate - ends.c1)
    ramps = half_distance(ends.c0, ends.b0, p, h)[0] + half_distance(ends.c1, ends.b1, q, k)[0]
    return Motions(p, h, q, k, (ends.distance - ramps) / max_rate)


def _single_ramp(ends: Ends) -> Motions:
    """Return the motion with a single segment, in which the acceleration rises from a0 to a1."""
    zero = np.zeros_like(ends.v0)
    return Motions(-ends.b1, zero, ends.b1, zero, zero)


def ramp(gain: Batch) -> tuple[Batch, Batch]:
    """Return the peak p and the time h at this peak for p² + ph = `gain`; NaN for a negative gain."""
    short = gain <= 1
    return np.where(short, np.sqrt(gain), 1.0), np.where(short, 0.0, gain - 1)


def _real_roots(coefficients: Batch) -> Batch:
    """Return the real parts of the roots of quartic polynomials, descending coefficients, refined by Newton's method.

    The real parts of complex roots are included, because round-off may split a double root into a complex pair.
    """
    lower = coefficients[1:] / coefficients[0]
    companion = np.zeros((*lower.shape[1:], 4, 4))
    companion[..., 0, :] = np.where(np.isfinite(lower).all(axis=0), -lower, 0.0).transpose(*range(1, lower.ndim), 0)
    companion[..., [1, 2, 3], [0, 1, 2]] = 1
    roots = np.linalg.eigvals(companion).real.transpose(-1, *range(lower.ndim - 1))
    for _ in range(NEWTON_STEPS):
        value, slope = _horner(coefficients, roots)
        step = np.where(slope == 0, 0.0, value / np.where(slope == 0, 1.0, slope))
        better = np.abs(_horner(coefficients, roots - step)[0]) < np.abs(value)
        roots = np.where(better, roots - step, roots)
    return roots


def _horner(coefficients: Batch, x: Batch) -> tuple[Any, Any]:
    """Return the value and the slope of polynomials with descending coefficients."""
    value, slope = 0.0, 0.0
    for c in coefficients:
        value, slope = value * x + c, slope * x + value
    return value, slope
