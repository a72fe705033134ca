"""Test whether a vehicle stands in an interval, from samples with so much noise that their spread does not show it.

A vehicle stands if two things hold. No motion is significant: the coefficients of a cubic in the time, fitted to the
positions, and of a quadratic, fitted to recorded velocities, are as small as noise makes them (chi-square test). And a
motion would be: the standard deviation of the mean velocity is so small that a vehicle that creeps would be noticed. So
a short interval, or a noisy one, is no stop, although nothing in it contradicts a standstill.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.recording import Recording

DEGREE = 3
"""Degree of the polynomial in the time of the positions of a motion."""

CONFIDENCE = 0.999
"""Probability that a vehicle at rest passes a test."""

NOTICED = 6.0
"""Minimum ratio of the speed of a creeping vehicle to the standard deviation of the mean velocity."""

PARTS = 12
"""Number of equal parts of an interval; a standstill in it starts and ends between two of them."""

HALVINGS = 4
"""Number of halvings of a part in which a standstill is extended."""


class Samples(NamedTuple):
    """The inliers of a recording with the standard deviations, per axis, of positions and velocities."""

    times: Float[np.ndarray, " n"]
    positions: Float[np.ndarray, "n 3"]
    position_sigma: Float[np.ndarray, "n 3"]
    velocities: Float[np.ndarray, "n 3"] | None
    velocity_sigma: Float[np.ndarray, "n 3"] | None

    def between(self, start: float, end: float) -> "Samples":
        """Return the samples of an interval."""
        inside = (self.times >= start) & (self.times <= end)
        velocities, sigma = (None if x is None else x[inside] for x in (self.velocities, self.velocity_sigma))
        return Samples(self.times[inside], self.positions[inside], self.position_sigma[inside], velocities, sigma)


def samples_of(recording: Recording, sigma: float) -> Samples:
    """Return the inliers; `sigma` is the standard deviation of a position with the weight 1.

    Unless it is known, the standard deviation of the velocities is that of their changes from sample to sample.
    """
    inliers = recording.weights > 0
    times, positions = recording.times[inliers], recording.positions[inliers]
    own = _sigma(recording.position_sigmas.weights[inliers], sigma)
    if recording.velocities is None:
        return Samples(times, positions, own, None, None)
    velocities, sigmas = recording.velocities[inliers], recording.velocity_sigmas
    unit = _changes(velocities) if sigmas.unit is None else sigmas.unit
    return Samples(times, positions, own, velocities, _sigma(sigmas.weights[inliers], unit))


def standstills(
    samples: Samples, intervals: list[tuple[float, float]], creeping: float, shortest: float
) -> list[tuple[float, float]]:
    """Return the parts of intervals in which the vehicle stands.

    `creeping` is the speed that would be noticed, and `shortest` the minimum duration. Neighbours are none if the
    vehicle may have moved uniformly through both: then it creeps.
    """
    found = [part for interval in intervals for part in standstill(samples, *interval, creeping, shortest)]
    pairs = [{first, second} for first, second in pairwise(found) if _is_uniform(samples.between(first[0], second[1]))]
    return [part for part in found if not any(part in pair for pair in pairs)]


def _is_uniform(samples: Samples) -> bool:
    """Return whether nothing but a uniform motion is significant in the positions."""
    powers, _ = _powers(samples.times)
    return _is_noise(samples.positions, samples.position_sigma, powers, 2)


def standstill(
    samples: Samples, start: float, end: float, creeping: float, shortest: float
) -> list[tuple[float, float]]:
    """Return the longest part of an interval in which the vehicle stands, as a list with one interval or none.

    `creeping` is the speed that would be noticed, and `shortest` the minimum duration. Of the parts between equally
    spaced times, the longest is chosen, and then extended within the interval.
    """
    edges = np.linspace(start, end, PARTS + 1)
    parts = [(float(a), float(b)) for k, a in enumerate(edges) for b in edges[k + 1 :] if b - a >= shortest]
    for a, b in sorted(parts, key=lambda part: part[0] - part[1]):
        if stands(samples.between(a, b), creeping):
            step = (end - start) / PARTS
            a = _extended(lambda x, b=b: stands(samples.between(x, b), creeping), a, max(a - step, start))
            b = _extended(lambda x, a=a: stands(samples.between(a, x), creeping), b, min(b + step, end))
            return [(a, b)]
    return []


def _extended(good: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return the last of the times from `inside` to `outside`, by halving, up to which an interval is good."""
    for _ in range(HALVINGS if outside != inside else 0):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if good(middle) else (inside, middle)
    return inside


def stands(samples: Samples, creeping: float) -> bool:
    """Return whether a motion would be noticed in the samples of an interval, and none is."""
    if len(samples.times) <= DEGREE + 1:
        return False
    powers, span = _powers(samples.times)
    known, still = _information(samples.positions, samples.position_sigma, powers, span)
    if samples.velocities is not None and samples.velocity_sigma is not None:
        weights = samples.velocity_sigma**-2.0
        known = known + weights.sum(axis=0)
        still = still and _is_noise(samples.velocities, samples.velocity_sigma, powers[:, :DEGREE], 0)
    return still and bool((creeping * np.sqrt(known) >= NOTICED).all())


def _powers(t: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n k"], float]:
    """Return the powers of the times, relative to their mean and in units of their span, and the span."""
    span = float(t[-1] - t[0])
    return np.vander((t - t.mean()) / span, DEGREE + 1, increasing=True), span


def _information(
    x: Float[np.ndarray, "n 3"], sigma: Float[np.ndarray, "n 3"], powers: Float[np.ndarray, "n k"], span: float
) -> tuple[Float[np.ndarray, " 3"], bool]:
    """Return the inverse variances of the mean velocity from positions, and whether their motion is only noise."""
    weights = sigma**-2.0
    t = span * powers[:, 1:2]
    centred = t - (weights * t).sum(axis=0) / weights.sum(axis=0)
    return (weights * centred**2).sum(axis=0), _is_noise(x, sigma, powers, 1)


def _is_noise(
    x: Float[np.ndarray, "n 3"], sigma: Float[np.ndarray, "n 3"], powers: Float[np.ndarray, "n k"], first: int
) -> bool:
    """Return whether the coefficients of polynomials, from the degree `first` on, are as small as those of noise."""
    squares = np.zeros(powers.shape[1])
    for axis in range(3):
        basis = np.linalg.qr(powers / sigma[:, axis : axis + 1])[0]
        squares += (basis.T @ (x[:, axis] / sigma[:, axis])) ** 2
    return bool(squares[first] <= _largest(1) and squares[first:].sum() <= _largest(len(squares) - first))


def _largest(count: int) -> float:
    """Return the largest sum of the squares of `count` coefficients of a vehicle at rest, in three axes.

    It is a quantile of the chi-square distribution, because the squares are in units of their variances.
    """
    from scipy.special import gammaincinv  # slow to import

    return 2 * float(gammaincinv(1.5 * count, CONFIDENCE))


def _changes(velocities: Float[np.ndarray, "n 3"]) -> float:
    """Return the standard deviation, per axis, of white noise with the median size of the changes."""
    changes = np.abs(np.diff(velocities, 2, axis=0))
    return max(float(np.median(changes)) / (0.6745 * np.sqrt(6.0)), 1e-12)


def _sigma(weights: Float[np.ndarray, "n *axes"], unit: float) -> Float[np.ndarray, "n 3"]:
    own = unit / np.sqrt(weights)
    return np.broadcast_to(own if own.ndim == 2 else own[:, None], (len(own), 3))
