"""Find the structure of a motion on the host, as one operation of JAX."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import stop_gradient
from qtraj.foundation.types import Flag, Scalar
from qtraj.motion.profiles.jerk_limited.fastest import fastest
from qtraj.motion.profiles.jerk_limited.in_time import coast_in_time
from qtraj.motion.profiles.jerk_limited.structures import Batch, Ends

ROUND_OFF = 8192
"""Relative round-off, in machine epsilons of the arguments, of a duration and of states at their limits."""


class Structure(NamedTuple):
    """The structure of a motion: p, h, q, k and the coast of `Motions`, and the senses ±1 of both halves.

    `timed` is true if the coast has the rate that the duration of the user needs. `exists` is false if there is no
    motion. `minimum` is the duration of the fastest motion, NaN if the final state cannot be reached.
    """

    unknowns: Float[Array, "5"]
    first: Scalar
    last: Scalar
    timed: Flag
    exists: Flag
    minimum: Scalar


def find_structure(ends: Ends, max_rate: Scalar, duration: Scalar) -> Structure:
    """Return the structure of the fastest motion, or of one with the `duration`, without derivatives.

    Jerk and acceleration limit are 1; `max_rate` may be infinite, and `duration` is NaN for the fastest motion.
    """
    arguments = stop_gradient((*ends, max_rate, duration))
    if is_traced(arguments):
        shape = jax.ShapeDtypeStruct((10,), arguments[0].dtype)
        table: Any = jax.pure_callback(_search, shape, *arguments, vmap_method="broadcast_all")
    else:
        table = _search(*map(np.asarray, arguments))
    return Structure(table[:5], table[5], table[6], table[7] > 0, table[8] > 0, table[9])


def _search(*arguments: Batch) -> Batch:
    """Return the values of a `Structure` on a new last axis, for arrays of any shape."""
    *states, max_rate, durations = (np.asarray(x, float) for x in arguments)
    ends, dtype = Ends(*states), np.asarray(arguments[0]).dtype
    round_off = ROUND_OFF * float(np.finfo(dtype).eps)
    with np.errstate(all="ignore"):
        found = fastest(ends, max_rate)
        exists = found.exists & _is_reachable(ends, max_rate * (1 + round_off), 1 + round_off)
        minimum = np.where(exists, found.motion.duration(Ends(*(found.sense * x for x in ends))), np.nan)
        size = minimum + np.abs(ends.b0) + np.abs(ends.b1)
        timed = np.isfinite(durations) & exists
        coasts = timed & (np.minimum(found.motion.p, found.motion.q) >= 0)
        rows = np.stack([*found.motion, found.sense, found.sense, coasts, exists, minimum], axis=-1)
        other = timed & (np.abs(durations - minimum) > round_off * size)
        if other.any():
            rows[other] = _timed(Ends(*(x[other] for x in ends)), max_rate[other], durations[other], rows[other])
    return rows.astype(dtype)


def _is_reachable(ends: Ends, max_rate: Batch, max_acceleration: float) -> Batch:
    """Return whether the limits allow the final state, and the rate that the final acceleration needs before it."""
    before = ends.v1 + ends.b1 * np.abs(ends.b1) / 2
    largest = np.maximum(np.abs(ends.v1), np.abs(before))
    return (np.abs(ends.b1) <= max_acceleration) & (largest <= max_rate)


def minimum_duration(ends: Ends, max_rate: Scalar) -> float:
    """Return the duration of the fastest motion between concrete ends."""
    return float(_search(*ends, max_rate, np.asarray(np.nan))[9])


def _timed(ends: Ends, max_rate: Batch, duration: Batch, fastest: Batch) -> Batch:
    """Return the rows of motions of the duration, or those of the `fastest` with `exists` = 0."""
    coast = coast_in_time(ends, max_rate, duration)
    first, last, exists = coast.first, coast.last, np.isfinite(coast.rate)
    ramps = [first.peak, first.hold, last.peak, last.hold, coast.time, first.sense, last.sense]
    own = np.stack([*ramps, exists, exists, fastest[:, 9]], axis=-1)
    none = np.concatenate([fastest[:, :7], 0 * fastest[:, 7:9], fastest[:, 9:]], axis=-1)
    return np.where(exists[:, None], own, none)
