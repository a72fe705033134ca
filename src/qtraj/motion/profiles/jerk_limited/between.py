"""Compute the motion between two states within limits on rate, acceleration and jerk, with derivatives.

The search for the structure of the motion uses units in which the limits on jerk and acceleration are 1. Derivatives
follow from the equations of this structure by the implicit function theorem.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.namespace import is_host, xp
from qtraj.foundation.types import Flag, Scalar
from qtraj.motion.profiles.jerk_limited.brake import Brake, brake
from qtraj.motion.profiles.jerk_limited.search import Structure, find_structure
from qtraj.motion.profiles.jerk_limited.structures import Ends, half_distance


class Task(NamedTuple):
    """The distance, the initial and the final rate and acceleration, and the limits of a motion."""

    distance: Scalar
    v0: Scalar
    a0: Scalar
    v1: Scalar
    a1: Scalar
    max_rate: Scalar | None
    max_acceleration: Scalar
    max_jerk: Scalar


class Segments(NamedTuple):
    """The times and jerks of the segments, three of braking and seven of the motion.

    `minimum` is the duration of the fastest motion. If none has the duration of the user, `exists` is false, and the
    segments are those of the fastest motion. The times are NaN if the limits forbid the final state.
    """

    widths: Float[Array, "10"]
    jerks: Float[Array, "10"]
    minimum: Scalar
    exists: Flag


class Scaled(NamedTuple):
    """A task in units of the times and rates in which the limits on jerk and acceleration are 1, after the braking."""

    time: Scalar
    braking: Brake
    ends: Ends
    max_rate: Scalar


def scaled(task: Task) -> Scaled:
    """Return a task in units in which the limits on jerk and acceleration are 1, after the braking."""
    a = task.max_acceleration
    time = a / task.max_jerk
    speed = a * time
    max_rate = xp.full_like(time, np.inf) if task.max_rate is None else task.max_rate / speed
    braking = brake(task.v0 / speed, task.a0 / a, None if task.max_rate is None else max_rate)
    distance = task.distance / speed / time - braking.distance
    ends = Ends(distance, braking.rate, braking.acceleration, task.v1 / speed, -task.a1 / a)
    return Scaled(time, braking, ends, max_rate)


def segments(task: Task, duration: Scalar | None) -> Segments:
    """Return the segments of the fastest motion, or of one with the `duration`."""
    time, braking, ends, max_rate = scaled(task)
    before = xp.sum(braking.widths)
    left = xp.full_like(time, np.nan) if duration is None else duration / time - before
    found = find_structure(ends, max_rate, left)
    unknowns = found.unknowns if is_host(found.unknowns) else _unknowns(found, ends, max_rate, left)
    widths = time * xp.concatenate([braking.widths, _widths(unknowns, found, ends)])
    return Segments(
        xp.where(xp.isnan(found.minimum), np.nan, widths),
        task.max_jerk * xp.concatenate([braking.jerks, _jerks(found)]),
        time * (before + found.minimum),
        found.exists,
    )


def _widths(unknowns: Float[Array, "5"], found: Structure, ends: Ends) -> Float[Array, "7"]:
    p, h, q, k, coast = unknowns
    direct = (p < 0) | (q < 0)
    falls = (xp.where(direct, p + q, p), xp.where(direct, 0.0, q))
    widths = xp.stack([p - found.first * ends.b0, h, falls[0], coast, falls[1], k, q - found.last * ends.b1])
    return xp.where(widths >= 0, widths, 0.0)


def _jerks(found: Structure) -> Float[Array, "7"]:
    zero = xp.zeros_like(found.first)
    return xp.stack([found.first, zero, -found.first, zero, -found.last, zero, found.last])


@jax.custom_jvp
def _unknowns(found: Structure, ends: Ends, max_rate: Scalar, duration: Scalar) -> Float[Array, "5"]:
    """Return the unknowns of a structure, with derivatives with respect to the other arguments."""
    return found.unknowns


@_unknowns.defjvp
def _unknowns_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    """Return dx = −(∂R/∂x)⁻¹ dR for the equations R(x, θ) = 0 of the structure.

    The derivatives are zero where they do not exist, such as for a motion of zero duration.
    """
    found, *values = primals
    x = _unknowns(found, *values)  # depends on the values, so that higher derivatives are correct, too
    matrix = jax.jacfwd(lambda x: _equations(x, found, *values))(x)
    change = jax.jvp(lambda *values: _equations(x, found, *values), tuple(values), tangents[1:])[1]
    regular = jnp.isfinite(matrix).all() & (jnp.linalg.det(matrix) != 0)
    matrix = jnp.where(regular, matrix, jnp.eye(len(x), dtype=x.dtype))
    return x, -jnp.linalg.solve(matrix, jnp.where(regular, change, 0.0))


def _equations(
    x: Float[Array, "5"], found: Structure, ends: Ends, max_rate: Scalar, duration: Scalar
) -> Float[Array, "5"]:
    """Return what vanishes for a motion: differences of rate and distance, then one for each unknown that is fixed."""
    p, h, q, k, coast = x
    c0, b0 = found.first * ends.v0 - ends.b0**2 / 2, found.first * ends.b0
    c1, b1 = found.last * ends.v1 - ends.b1**2 / 2, found.last * ends.b1
    w0, w1 = found.first * (c0 + p**2 + p * h), found.last * (c1 + q**2 + q * k)
    ramps = found.first * half_distance(c0, b0, p, h)[0] + found.last * half_distance(c1, b1, q, k)[0]
    coasting = (found.unknowns[4] > 0) & ~found.timed
    limit = found.first * jnp.where(coasting, max_rate, 0.0)
    w = jnp.where(coasting, limit, w0)
    # A motion that starts or ends at the largest rate has no ramp there.
    flat_start = coasting & (found.unknowns[0] == 0) & (b0 == 0)
    flat_end = coasting & (found.unknowns[2] == 0) & (b1 == 0)
    untimed = jnp.where(flat_end, q, jnp.where(coasting, w1 - limit, coast))
    time = (2 * p - b0 + h) + coast + (2 * q - b1 + k)
    return jnp.stack(
        [
            jnp.where(flat_start, p, jnp.where(coasting, w0 - limit, w0 - w1)),
            ramps + w * coast - ends.distance,
            jnp.where(found.unknowns[1] > 0, p - 1, h),
            jnp.where(found.unknowns[3] > 0, q - 1, k),
            jnp.where(found.timed, time - jnp.where(found.timed, duration, 0.0), untimed),
        ]
    )
