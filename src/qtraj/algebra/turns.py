"""Compute rotations between attitudes and directions: the shortest one, interpolation, angles, powers, random ones."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import canonical, conjugate, exp, log, product, unit as unit_quaternion
from qtraj.algebra.vector import cross, norm, unit
from qtraj.foundation.arrays import concrete
from qtraj.foundation.namespace import of_arrays, stop_gradient, xp
from qtraj.foundation.types import Quat, Scalar, Vec3


@of_arrays
def between_vectors(a: Vec3, b: Vec3) -> Quat:
    """Return the unit quaternion of the shortest rotation from the direction of `a` to the direction of `b`.

    The lengths of `a` and `b` (..., 3) do not matter: `quaternion.rotate(q, a)` is parallel to b. For opposite
    directions the rotation is a half turn about the axis e×a, where e is the coordinate axis along which |a| has its
    smallest component, or the first of them; the derivative with respect to the directions is then finite, but not
    unique. The result is NaN for a zero vector.
    """
    a, b = (unit(x, xp.full_like(x, np.nan)) for x in xp.broadcast_arrays(a, b))
    smallest = stop_gradient(xp.argmin(abs(a), axis=-1))
    e = xp.stack([xp.where(smallest == k, 1.0, xp.zeros_like(a[..., k])) for k in range(3)], axis=-1)
    axis = stop_gradient(unit(cross(e, a), e))
    half = unit(a + b, cross(axis, a))  # the direction in the middle
    # cos(Φ/2) = |a + b|/2 has no cancellation for nearly opposite directions, unlike a·half.
    return unit_quaternion(xp.concatenate([0.5 * norm(a + b)[..., None], cross(a, half)], axis=-1))


@of_arrays
def angle_between(p: Quat, q: Quat) -> Scalar:
    """Return the angle [rad] of the shorter rotation from the attitude `p` to `q` (..., 4), from 0 to π.

    The derivative is zero for equal attitudes.
    """
    p, q = xp.broadcast_arrays(p, q)
    relative = product(conjugate(unit_quaternion(p)), unit_quaternion(q))
    return 2 * xp.arctan2(norm(relative[..., 1:]), abs(relative[..., 0]))


@of_arrays
def slerp(q0: Quat, q1: Quat, s: Scalar) -> Quat:
    """Return the attitude on the shorter rotation from `q0` to `q1` (..., 4) after the share `s` (...) of its angle.

    The result is q0/|q0| for s = 0, and ±q1/|q1| for s = 1; other values of s extrapolate. For a half turn both senses
    of rotation are equally short, and `quaternion.canonical` chooses one.
    """
    start, end = xp.broadcast_arrays(unit_quaternion(q0), unit_quaternion(q1))
    vector = _times(s, log(canonical(product(conjugate(start), end))))
    return product(xp.broadcast_to(start, (*vector.shape[:-1], 4)), exp(vector))


@of_arrays
def power(q: Quat, exponent: Scalar) -> Quat:
    """Return the rotation by `exponent` (...) times the angle of the shorter rotation of `q` (..., 4)."""
    return exp(_times(exponent, log(canonical(q))))


@of_arrays
def from_axis_angle(axis: Vec3, angle: Scalar) -> Quat:
    """Return the unit quaternion of a rotation about `axis` (..., 3), of any length, by `angle` (...) [rad].

    A zero axis results in NaN.
    """
    sine = _times(xp.sin(0.5 * angle), unit(axis, xp.full_like(axis, np.nan)))
    cosine = xp.broadcast_to(xp.cos(0.5 * angle), sine.shape[:-1])
    return xp.concatenate([xp.where(xp.isnan(sine[..., :1]), np.nan, cosine[..., None]), sine], axis=-1)


@of_arrays
def to_axis_angle(q: Quat) -> tuple[Vec3, Scalar]:
    """Return the unit axis (..., 3) and the angle [rad], from 0 to π, of the shorter rotation of `q` (..., 4).

    Without a rotation, the axis is the x axis and the derivative of the angle is zero.
    """
    vector = canonical(q)[..., 1:]
    e = xp.broadcast_to(np.eye(3, dtype=vector.dtype)[0], vector.shape)
    return unit(vector, e), 2 * xp.arctan2(norm(vector), abs(q[..., 0]))


def _times(s: Scalar, v: Vec3) -> Vec3:
    """Return the products of numbers (...) and vectors (..., 3)."""
    shape = np.broadcast_shapes(np.shape(s), v.shape[:-1])
    return xp.broadcast_to(s, shape)[..., None] * xp.broadcast_to(v, (*shape, 3))


def random(key: Any, shape: tuple[int, ...] = ()) -> Float[Array, "*shape 4"]:
    """Return unit quaternions (*shape, 4) of attitudes that are distributed uniformly over all attitudes (Haar).

    `key` is a key of JAX, `jax.random.key(0)`, or a `numpy.random.Generator`, for JAX or NumPy arrays.

    **Raises:** ValueError for another key.
    """
    size = (*shape, 4)
    if isinstance(key, np.random.Generator):
        components: Any = key.normal(size=size)
    elif isinstance(key, jax.Array):
        components = jax.random.normal(key, size)
    else:
        raise ValueError(
            "key must be a key of JAX, such as jax.random.key(0), or a numpy.random.Generator, but "
            f"{type(key).__name__} was given"
        )
    return unit_quaternion(components)


def to_scipy(q: Any) -> Any:
    """Convert concrete quaternions (..., 4), scalar first and of any norm, to a SciPy `Rotation`, body to inertial.

    The signs are kept, and `as_matrix()` is the transpose of `to_dcm(q)`.

    **Raises:** ValueError for traced quaternions, another last axis and a zero quaternion.
    """
    from scipy.spatial.transform import Rotation  # imported here, because SciPy is slow to import

    values = concrete(q)
    if values is None or values.shape[-1:] != (4,):
        given = "traced quaternions were" if values is None else f"shape {values.shape} was"
        raise ValueError(f"to_scipy needs concrete quaternions of shape (..., 4), but {given} given")
    return Rotation.from_quat(np.asarray(values, float), scalar_first=True)


def from_scipy(rotation: Any) -> Any:
    """Convert a SciPy `Rotation` to unit quaternions (..., 4), scalar first, with the signs that it stores.

    **Raises:** ValueError for an object that is not a `Rotation`.
    """
    if not hasattr(rotation, "as_quat"):
        raise ValueError(f"a SciPy Rotation was expected, but {type(rotation).__name__} was given")
    return np.asarray(rotation.as_quat(canonical=False, scalar_first=True))
