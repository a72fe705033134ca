"""Choose the fastest motion between two states within limits on rate, acceleration and jerk."""

import functools
from typing import NamedTuple

import numpy as np

from qtraj.motion.profiles.jerk_limited.structures import Batch, Ends, Motions, enumerate_motions, half_distance

TOLERANCES = (1e-13, 1e-11, 1e-9, 1e-7, 1e-5)
"""Relative tolerances for times, rates and distances; each is tried if no motion exists within the previous one.

The last ones are for states at a limit in single precision.
"""


class Found(NamedTuple):
    """The fastest motion, as `Motions`, after multiplication of the ends by `sense`, ±1; whether it exists."""

    motion: Motions
    sense: Batch
    exists: Batch


def fastest(ends: Ends, max_rate: Batch) -> Found:
    """Return the fastest of all motions between `ends`, for jerk and acceleration limits of 1."""
    both = Ends(*(np.stack([x, -x]) for x in ends))
    motions, durations, errors = _candidates(both, max_rate)
    kinds = len(durations)
    motions = Motions(*(x.reshape(2 * kinds, *x.shape[2:]) for x in motions))
    durations, errors = (x.reshape(2 * kinds, *x.shape[2:]) for x in (durations, errors))
    best, exists = np.zeros(durations.shape[1:], int), np.zeros(durations.shape[1:], bool)
    for tolerance in TOLERANCES:
        allowed = np.where(errors <= tolerance, durations, np.inf)
        choice = np.argmin(allowed, axis=0)
        best = np.where(exists, best, choice)
        exists |= np.isfinite(np.min(allowed, axis=0))
    chosen = Motions(*(np.take_along_axis(x, best[None], axis=0)[0] for x in motions))
    return Found(chosen, np.where(best % 2 == 0, 1.0, -1.0), exists)


def _candidates(ends: Ends, max_rate: Batch) -> tuple[Motions, Batch, Batch]:
    """Return the motions of the forward form, their durations, and the relative errors by which they do not exist."""
    motions = enumerate_motions(ends, max_rate)
    w = motions.rate(ends)
    first = half_distance(ends.c0, ends.b0, motions.p, motions.h)
    second = half_distance(ends.c1, ends.b1, motions.q, motions.k)
    coasted = w * motions.coast
    distance = first[0] + second[0] + coasted - ends.distance
    size = first[1] + second[1] + np.abs(coasted) + np.abs(ends.distance)
    other = ends.c1 + motions.q**2 + motions.q * motions.k
    rate_size = np.maximum(np.abs(ends.v0), np.abs(ends.v1)) + ends.b0**2 + ends.b1**2 + motions.p**2
    time = functools.reduce(np.maximum, map(np.abs, (ends.b0, ends.b1, *motions)))
    turns = (motions.p > 0) & (motions.q > 0)
    errors = [
        _ratio(-motions.shortest_segment(ends), time),
        np.maximum(motions.p, motions.q) - 1,
        _ratio(np.where(turns & np.isfinite(max_rate), w - max_rate, 0.0), np.abs(max_rate)),
        _ratio(np.abs(distance), size),
        _ratio(np.abs(w - other), rate_size),
    ]
    error = functools.reduce(np.maximum, errors)
    return motions, motions.duration(ends), np.where(np.isnan(error), np.inf, error)


def _ratio(x: Batch, size: Batch) -> Batch:
    return np.where(x == 0, 0.0, x / np.where(size == 0, 1.0, size))
