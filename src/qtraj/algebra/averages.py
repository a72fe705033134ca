"""Average attitudes, and the attitude that fits observed directions best (Wahba's problem).

Both maximise qᵀ N q over unit quaternions q with a symmetric matrix N: the solution is the eigenvector of the largest
eigenvalue. N = Σ w q_i q_iᵀ for an average (Markley, Cheng, Crassidis and Oshman, "Averaging quaternions", JGCD 30,
2007), and N = Σ w L(v)ᵀR(u) for directions u in body axes and v in inertial axes, with the matrices L(v) x = v∘x and
R(u) x = x∘u (Davenport's q-method). The derivative of the eigenvector needs only the gap between the largest eigenvalue
and the others, so it is finite even if the others are equal.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.cosines import from_rotation
from qtraj.algebra.matrices import a as left_matrix, tat as right_matrix
from qtraj.algebra.quaternion import canonical, rotate, unit as unit_quaternion
from qtraj.algebra.vector import cross, dot, unit
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import matmul, namespace, of_arrays, stop_gradient, xp
from qtraj.foundation.types import Mat3, Quat, Scalar

AMBIGUOUS = 64
"""A solution is ambiguous if the two largest eigenvalues differ by less than round-off, in machine epsilons."""

PARALLEL = 1e-12
"""Two unit vectors are parallel if their cross product is at most this long."""

Vectors = Float[Array, "*batch n 3"]


class Alignment(NamedTuple):
    """The attitude that maps directions in body axes to directions in inertial axes.

    `quaternion` (..., 4): the unit quaternion λ, with a first non-zero component that is positive. `residual` (...)
    [rad]: the root of the weighted mean of the squared differences between the unit vectors. `covariance` (..., 3, 3)
    [rad²]: the covariance of the error of the attitude, a rotation vector in body axes.
    """

    quaternion: Quat
    residual: Scalar
    covariance: Mat3


def mean(qs: Any, weights: Any = None) -> Quat:
    """Return the average (..., 4) of attitudes `qs` (..., n, 4) along the axis before the last.

    The norms and signs of the quaternions have no effect. `weights` (..., n) are not negative, and equal for None. The
    average minimises the weighted sum of squared chordal distances; it is a unit quaternion with a first non-zero
    component that is positive. The first derivative is exact. Attitudes without a unique average, such as two that are
    a half turn apart, result in NaN.

    **Raises:** ValueError for `qs` without two axes, or weights of another number.
    """
    if np.ndim(qs) < 2 or np.shape(qs)[-1] != 4:
        raise ValueError(f"mean: qs must have shape (..., n, 4), but shape {np.shape(qs)} was given")
    _require_weights("mean", weights, np.shape(qs)[-2])
    return _mean(qs, weights)


def align(body: Any, inertial: Any, weights: Any = None) -> Alignment:
    """Return the attitude that maps the directions `body` (..., n, 3) to the directions `inertial` (..., n, 3), n ≥ 2.

    Only the directions of the vectors count. Without `weights`, two directions are solved by TRIAD: the first direction
    fits exactly, and the second determines the rotation about it. Otherwise the attitude minimises the weighted sum of
    squared differences (Wahba's problem, by Davenport's q-method). `weights` (..., n) [1/rad²] are the inverse
    variances of the directions; with None they are equal, and the covariance is estimated from the differences with
    2n − 3 degrees of freedom. The first derivative is exact.

    **Raises:** ValueError for other shapes, and for concrete directions that are parallel or zero, which do not
    determine the attitude; inside a trace, the result is then NaN.
    """
    shapes = np.shape(body), np.shape(inertial)
    if any(len(s) < 2 or s[-1] != 3 or s[-2] < 2 for s in shapes) or shapes[0][-2] != shapes[1][-2]:
        raise ValueError(
            "align: body and inertial must both have shape (..., n, 3) with the same n ≥ 2, but shapes "
            f"{shapes[0]} and {shapes[1]} were given"
        )
    _require_weights("align", weights, shapes[0][-2])
    triad = weights is None and shapes[0][-2] == 2
    found = Alignment(*(_triad(body, inertial) if triad else _wahba(body, inertial, weights)))
    if not is_traced(found) and not np.isfinite(np.asarray(found.quaternion)).all():
        raise ValueError(
            "align: the directions do not determine the attitude, because they are parallel, zero or not finite"
        )
    return found


@of_arrays
def _mean(qs: Float[Array, "*batch n 4"], weights: Float[Array, "*batch n"] | None) -> Quat:
    q, w = _weighted(unit_quaternion(qs), weights)
    return _largest(xp.sum(w[..., None, None] * q[..., :, None] * q[..., None, :], axis=-3), xp.sum(w, axis=-1))


@of_arrays
def _wahba(body: Vectors, inertial: Vectors, weights: Float[Array, "*batch n"] | None) -> tuple[Quat, Scalar, Mat3]:
    u, v = _directions(body, inertial)
    u, w = _weighted(u, weights)
    v = xp.broadcast_to(v, u.shape)
    left, right = (xp.concatenate([xp.zeros_like(x[..., :1]), x], axis=-1) for x in (v, u))
    products = matmul(xp.swapaxes(left_matrix(left), -1, -2), right_matrix(right))
    q = _largest(xp.sum(w[..., None, None] * products, axis=-3), xp.sum(w, axis=-1))
    return _assessed(q, u, v, w, weights is None)


@of_arrays
def _triad(body: Vectors, inertial: Vectors) -> tuple[Quat, Scalar, Mat3]:
    u, v = _directions(body, inertial)
    frames = []
    for x in (u, v):
        first, second = x[..., 0, :], x[..., 1, :]
        normal = cross(first, second)
        normal = xp.where(dot(normal, normal)[..., None] > PARALLEL**2, normal, np.nan)
        normal = unit(normal, xp.full_like(normal, np.nan))
        frames.append(xp.stack([first, normal, cross(first, normal)], axis=-1))
    # λ maps body to inertial: R = F_v F_uᵀ, and the direction cosines are its transpose.
    q = from_rotation(matmul(frames[0], xp.swapaxes(frames[1], -1, -2)))
    return _assessed(q, u, v, xp.ones_like(u[..., 0]), True)


def _directions(body: Vectors, inertial: Vectors) -> tuple[Vectors, Vectors]:
    u, v = (unit(x, xp.full_like(x, np.nan)) for x in xp.broadcast_arrays(body, inertial))
    return u, v


def _weighted(x: Any, weights: Any) -> tuple[Any, Any]:
    """Return arrays (..., n, k) and their weights (..., n) with the same leading axes; all weights are 1 for None."""
    if weights is None:
        return x, xp.ones_like(x[..., 0])
    shape = np.broadcast_shapes(x.shape[:-1], np.shape(weights))
    return xp.broadcast_to(x, (*shape, x.shape[-1])), xp.broadcast_to(xp.asarray(weights, x.dtype), shape)


def _assessed(q: Quat, u: Vectors, v: Vectors, w: Float[Array, "*batch n"], estimated: bool) -> tuple[Any, Any, Any]:
    """Return the attitude, the residual and the covariance; its size is `estimated` from the residual if asked."""
    difference = v - rotate(q[..., None, :], u)
    loss, count = xp.sum(w * dot(difference, difference), axis=-1), u.shape[-2]
    outer = u[..., :, None] * u[..., None, :]
    information = xp.sum(w[..., None, None] * (xp.broadcast_to(np.eye(3, dtype=u.dtype), outer.shape) - outer), axis=-3)
    covariance = namespace(information).linalg.inv(information)
    if estimated:
        covariance = covariance * (loss / (2 * count - 3))[..., None, None]
    square = loss / xp.sum(w, axis=-1)
    root = xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), xp.where(square == 0, 0.0, np.nan))
    return q, root, covariance


def _largest(matrix: Float[Array, "*batch 4 4"], total: Scalar) -> Quat:
    """Return the unit eigenvector of the largest eigenvalue, or NaN if this eigenvalue is not single.

    The value has no derivative; a correction, which is zero, has the exact first derivative of the eigenvector.
    """
    constant = stop_gradient(matrix)
    bad = ~xp.all(xp.isfinite(constant), axis=(-2, -1))
    identity = xp.broadcast_to(np.eye(4, dtype=constant.dtype), constant.shape)
    values, vectors = namespace(constant).linalg.eigh(xp.where(bad[..., None, None], identity, constant))
    gaps = values[..., 3:] - values[..., :3]
    single = (gaps[..., -1] > AMBIGUOUS * float(xp.finfo(values.dtype).eps) * abs(stop_gradient(total))) & ~bad
    q, others = vectors[..., :, 3], vectors[..., :, :3]
    residual = matmul(matrix, q[..., None])[..., 0]
    share = matmul(xp.swapaxes(others, -1, -2), residual[..., None])[..., 0]
    share = share - stop_gradient(share)
    correction = matmul(others, (share / xp.where(single[..., None], gaps, 1.0))[..., None])[..., 0]
    return xp.where(single[..., None], canonical(q + correction), np.nan)


def _require_weights(name: str, weights: Any, count: int) -> None:
    if weights is None:
        return
    if np.ndim(weights) < 1 or np.shape(weights)[-1] != count:
        raise ValueError(f"{name}: weights must have shape (..., {count}), but shape {np.shape(weights)} was given")
    if not is_traced(weights):
        values = np.asarray(weights)
        if not (values >= 0).all() or not (values.sum(axis=-1) > 0).all():
            raise ValueError(f"{name}: weights must not be negative, and not all zero, but {weights!r} was given")
