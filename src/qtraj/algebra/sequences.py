"""Interpolate a sequence of attitudes, and describe it by rotation vectors or Euler angles that are continuous."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.euler import from_euler, to_euler
from qtraj.algebra.quaternion import canonical, log
from qtraj.algebra.turns import angle_between, slerp
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import concrete
from qtraj.foundation.namespace import of_arrays, scan, stop_gradient, xp
from qtraj.foundation.types import Scalar

LOCKED = 1e-6
"""Largest error [rad] of an attitude with another third angle for which the attitude is in gimbal lock."""

Attitudes = Float[Array, "n 4"]


def slerp_along(times: Float[Array, " n"], qs: Attitudes, t: Scalar) -> Float[Array, "*instants 4"]:
    """Return the attitudes at the instants `t` (...), on the shorter rotations between the attitudes `qs` (n, 4).

    `times` (n,), n ≥ 2, increase; `t` has the same unit. Between two attitudes the rate is constant. Its jumps at the
    attitudes are avoided by `qtraj.TableProgram`. Traced instants outside the times result in NaN.

    **Raises:** ValueError for other shapes, for times that do not increase, and for an instant outside the times.
    """
    if np.ndim(qs) != 2 or np.shape(qs)[-1] != 4 or np.shape(times) != np.shape(qs)[:1] or len(np.shape(times)) < 1:
        raise ValueError(
            "slerp_along: times (n,) and attitudes (n, 4) were expected, but arrays of the shapes "
            f"{np.shape(times)} and {np.shape(qs)} were given"
        )
    known, instants = concrete(times), concrete(t)
    if known is not None:
        if len(known) < 2 or not (np.diff(known) > 0).all():
            raise ValueError(f"slerp_along: two or more increasing times were expected, but {known.tolist()} was given")
        if instants is not None and not ((instants >= known[0]) & (instants <= known[-1])).all():
            raise ValueError(
                f"slerp_along: the times are from {known[0]:.9g} to {known[-1]:.9g}, but the instants are from "
                f"{np.min(instants):.9g} to {np.max(instants):.9g}"
            )
    return _slerp_along(times, qs, t)


@of_arrays
def _slerp_along(times: Any, qs: Any, t: Any) -> Any:
    piece = xp.clip(xp.searchsorted(times, t, side="right") - 1, 0, times.shape[0] - 2)
    share = (t - times[piece]) / (times[piece + 1] - times[piece])
    inside = (t >= times[0]) & (t <= times[-1])
    return slerp(qs[piece], qs[piece + 1], xp.where(inside, share, np.nan))


@of_arrays
def rotation_vectors_along(qs: Float[Array, "*batch n 4"]) -> Float[Array, "*batch n 3"]:
    """Return rotation vectors (..., n, 3) [rad] of the attitudes `qs` (..., n, 4), each close to the one before.

    The first vector is that of the shorter rotation; the following ones may be longer than a half turn and than whole
    turns. Where the vector would pass a whole turn along another axis, no choice is continuous.
    """

    def step(before: Any, vector: Any) -> tuple[Any, Any]:
        length, last = norm(vector)[..., None], norm(before)[..., None]
        known = length > 0
        axis = xp.where(known, vector / xp.where(known, length, 1.0), before / xp.where(last > 0, last, 1.0))
        turns = stop_gradient(xp.round((xp.sum(before * axis, axis=-1, keepdims=True) - length) / (2 * np.pi)))
        vector = vector + 2 * np.pi * turns * axis
        return vector, vector

    vectors = xp.moveaxis(2 * log(canonical(qs)), -2, 0)
    return xp.moveaxis(scan(step, vectors[0], vectors)[1], 0, -2)


def euler_along(qs: Float[Array, "*batch n 4"], seq: str) -> Float[Array, "*batch n 3"]:
    """Return Euler angles (..., n, 3) [rad] of the attitudes `qs` (..., n, 4), each close to the ones before.

    `seq` is that of `to_euler`, whose angles are the first ones. An attitude has two triples of angles, to which whole
    turns may be added; in gimbal lock, the third angle is that of the attitude before.

    **Raises:** ValueError as `to_euler`.
    """
    return _euler_along(qs, seq)


@of_arrays
def _euler_along(qs: Any, seq: str) -> Any:
    angles = to_euler(qs, seq)
    first, second, third = (angles[..., k] for k in range(3))
    middle = -second if seq[0] == seq[2] else np.pi - second
    others = xp.stack([first + np.pi, middle, third + np.pi], axis=-1)

    def with_third(sense: float) -> Any:
        return xp.stack([first + sense, second, xp.ones_like(third)], axis=-1)

    # In gimbal lock, only the sum or the difference of the first and the third angle is determined.
    apart = [angle_between(from_euler(seq, with_third(sense)), qs) for sense in (-1.0, 1.0)]
    locked = (third == 0) & (xp.minimum(*apart) < LOCKED)
    sense = xp.where(apart[1] < apart[0], 1.0, -1.0)

    def step(before: Any, row: Any) -> tuple[Any, Any]:
        own, other, is_locked, sign = row
        free = xp.stack([own[..., 0] + sign * before[..., 2], own[..., 1], before[..., 2]], axis=-1)
        choices = [xp.where(is_locked[..., None], free, own), other]
        near = [x - stop_gradient(2 * np.pi * xp.round((x - before) / (2 * np.pi))) for x in choices]
        far = [xp.sum((x - before) ** 2, axis=-1, keepdims=True) for x in near]
        chosen = xp.where(far[1] < far[0], near[1], near[0])
        return chosen, chosen

    rows = tuple(xp.moveaxis(x, first.ndim - 1, 0) for x in (angles, others, locked, sense))
    return xp.moveaxis(scan(step, rows[0][0], rows)[1], 0, -2)
