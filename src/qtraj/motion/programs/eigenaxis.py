"""Compute eigenaxis rotations: from one attitude to another, about an axis, and the attitude of a slew at a time."""

import numpy as np

from qtraj.algebra import quaternion, rotation
from qtraj.algebra.vector import norm, unit
from qtraj.foundation.arrays import concrete
from qtraj.foundation.namespace import in_numpy_or_jit, of_arrays, stop_gradient, xp
from qtraj.foundation.types import Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.motion.profiles.profile import Profile

ROUND_OFF = 8
"""Two attitudes that differ by less than this angle, in machine epsilons [rad], are equal up to round-off."""
SAME_END = 1e-4
"""A rotation vector leads to an attitude if it ends at most this far [rad] from it; float32 and files round."""


@of_arrays
def shorter_rotation(start: Quat, end: Quat) -> Vec3:
    """Return the vector [rad] of the shorter rotation from `start` to `end`, body axes.

    The vector is smooth for equal attitudes, and parallel to a_v for a0 = 0 (see `EulerTurn`).
    """
    a = quaternion.product(quaternion.conjugate(quaternion.unit(start)), quaternion.unit(end))
    vector = 2 * quaternion.log(xp.where(a[..., :1] < 0, -a, a))
    # Round-off between equal attitudes must not cause a slew, so the value, but not the derivative, is set to 0.
    round_off = norm(vector)[..., None] <= ROUND_OFF * float(xp.finfo(vector.dtype).eps)
    return vector - stop_gradient(xp.where(round_off, vector, 0.0))


@of_arrays
def length(start: Quat, end: Quat) -> Scalar:
    """Return the angle [rad] of the shorter rotation from `start` to `end`."""
    return norm(shorter_rotation(start, end))


def direction(vector: Vec3) -> Vec3:
    """Return the unit vector along a rotation vector; the x axis for zero."""
    return unit(vector, np.eye(3, dtype=vector.dtype)[0])


axis_of = of_arrays(direction)
size = of_arrays(norm)


@of_arrays
def rotation_about(axis: Vec3, angle: Scalar) -> Vec3:
    """Return the rotation vector [rad] of a rotation about `axis`, of any length, by `angle` [rad]."""
    return angle * unit(axis, xp.full_like(axis, np.nan))


@of_arrays
def turned(start: Quat, vector: Vec3) -> Quat:
    """Return the unit quaternion after the rotation `vector` [rad] in body axes."""
    return quaternion.product(quaternion.unit(start), rotation.from_rotation_vector(vector))


@in_numpy_or_jit
def attitude_between(start: Quat, end: Quat, profile: Profile, t: Scalar) -> Attitude:
    """Return the attitude at the time `t` [s] since the start of the shorter slew from `start` to `end`."""
    return attitude_after(quaternion.unit(start), shorter_rotation(start, end), profile, t)


@in_numpy_or_jit
def attitude_about(start: Quat, vector: Vec3, profile: Profile, t: Scalar) -> Attitude:
    """Return the attitude at the time `t` [s] since the start of a slew by any rotation `vector` [rad]."""
    return attitude_after(quaternion.unit(start), vector, profile, t)


@in_numpy_or_jit
def attitude_after(start: Quat, vector: Vec3, profile: Profile, t: Scalar) -> Attitude:
    """Return the attitude of a slew from the unit quaternion `start` by the rotation `vector` [rad]."""
    # A proportional shape multiplies the whole rotation vector, so the attitude is smooth at a zero vector.
    along = vector if profile.proportional else direction(vector)
    angle, rate, acceleration = profile.shape(t, 2)
    return Attitude(
        quaternion=quaternion.product(start, rotation.from_rotation_vector(angle * along)),
        rate=rate * along,
        acceleration=acceleration * along,
    )


def require_end(start: Quat, vector: Vec3, end: Quat) -> None:
    """Raise a ValueError if a concrete rotation `vector` [rad] does not lead from `start` to `end`."""
    error = concrete(rotation.angle_between(turned(start, vector), end))
    if error is not None and not error <= SAME_END:
        raise ValueError(
            f"vector must be a rotation from start_q to end_q, but it ends {float(error):.3g} rad from end_q: use "
            "EulerTurn.about(axis, angle, start_q, law)"
        )
