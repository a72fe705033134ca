"""Convert attitudes between λ and direction cosines, Gibbs vector, MRP, rotation vector and Euler angles.

`qtraj.algebra.quaternion` states the conventions. Except for `continuous`, each function converts one attitude. Each
`to_…` returns the same result for λ and cλ, c ≠ 0; each `from_…` returns a unit quaternion. Values and derivatives are
finite at every attitude, with two exceptions: the Gibbs vector of a half turn is infinite by definition, and the ratios
of `gibbs_ratios` are not finite if one of their denominators is zero.
"""

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import hamilton
from qtraj.algebra.averages import Alignment, align, mean
from qtraj.algebra.cosines import from_dcm, nearest_dcm, squares_from_dcm, to_dcm
from qtraj.algebra.euler import from_euler, to_euler
from qtraj.algebra.gibbs import from_gibbs, from_mrp, gibbs_from_dcm, gibbs_ratios, to_gibbs, to_mrp
from qtraj.algebra.quaternion import canonical, exp, log
from qtraj.algebra.rotation_rates import body_to_euler_rates, euler_rates_to_body, left_jacobian, right_jacobian
from qtraj.algebra.sequences import euler_along, rotation_vectors_along, slerp_along
from qtraj.algebra.turns import (
    angle_between,
    between_vectors,
    from_axis_angle,
    from_scipy,
    power,
    random,
    slerp,
    to_axis_angle,
    to_scipy,
)
from qtraj.foundation.namespace import of_arrays, xp
from qtraj.foundation.types import Quat, Vec3

__all__ = [
    "Alignment",
    "align",
    "angle_between",
    "between_vectors",
    "body_to_euler_rates",
    "continuous",
    "euler_along",
    "euler_rates_to_body",
    "from_axis_angle",
    "from_dcm",
    "from_euler",
    "from_gibbs",
    "from_mrp",
    "from_rotation_vector",
    "from_scipy",
    "gibbs_from_dcm",
    "gibbs_ratios",
    "left_jacobian",
    "mean",
    "nearest_dcm",
    "power",
    "random",
    "right_jacobian",
    "rotation_vectors_along",
    "slerp",
    "slerp_along",
    "squares_from_dcm",
    "to_axis_angle",
    "to_dcm",
    "to_euler",
    "to_gibbs",
    "to_mrp",
    "to_rotation_vector",
    "to_scipy",
]


def __dir__() -> list[str]:
    return __all__


@of_arrays
def to_rotation_vector(q: Quat) -> Vec3:
    """Return Φe [rad] of the shorter rotation, with the axis e and the angle Φ, 0 ≤ Φ ≤ π.

    For Φ = π, the first non-zero component of e is positive.
    """
    return 2 * log(canonical(q))


@of_arrays
def from_rotation_vector(v: Vec3) -> Quat:
    """Return the unit quaternion cos Φ/2 + e sin Φ/2 of the rotation vector `v` = Φe [rad], axis e and angle Φ."""
    return exp(0.5 * v)


@of_arrays
def _continuous(qs: Quat) -> Quat:
    directions = qs / xp.max(abs(qs), axis=-1, keepdims=True)  # the products of small quaternions would underflow
    alignment = xp.sum(directions[..., 1:, :] * directions[..., :-1, :], axis=-1)
    return qs * hamilton.continuous_signs(alignment)[..., None]


def continuous(qs: Float[Array, "*batch n 4"]) -> Float[Array, "*batch n 4"]:
    """Return quaternions `qs` (..., n, 4) with signs that make them continuous along the axis before the last.

    The first quaternion is unchanged. The scalar product of two consecutive quaternions of the result is not negative.
    The signs are treated as constants in differentiation.

    **Raises:** ValueError for another shape.
    """
    if np.ndim(qs) < 2 or np.shape(qs)[-1] != 4:
        raise ValueError(f"continuous: qs must have shape (..., n, 4), but shape {np.shape(qs)} was given")
    return _continuous(qs)
