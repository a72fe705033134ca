"""Convert attitudes to and from Gibbs vectors and modified Rodrigues parameters (MRP).

For a rotation by Φ about e, the Gibbs vector is G = e tan Φ/2, and the MRP are e tan Φ/4.
"""

from jaxtyping import Array, Float

from qtraj.algebra.cosines import pivot_row
from qtraj.algebra.quaternion import canonical, unit as unit_quaternion
from qtraj.algebra.vector import balanced, norm
from qtraj.foundation.namespace import of_arrays, stop_gradient, xp
from qtraj.foundation.types import Mat3, Quat, Vec3


@of_arrays
def to_gibbs(q: Quat) -> Vec3:
    """Return the Gibbs vector (λ1, λ2, λ3)/λ0 of λ = `q`; `q` and `c*q` give the same result for any c ≠ 0.

    A half turn (λ0 = 0) has no finite Gibbs vector. The components of the result are then 0 where the axis has a zero
    component, and inf or −inf elsewhere. Two opposite axes describe the same half turn; the function chooses the axis
    whose first non-zero component is positive. The derivative is 0, never NaN.
    """
    q = canonical(balanced(q))
    s, u = q[..., :1], q[..., 1:]
    regular = s * s >= float(xp.finfo(q.dtype).tiny)  # for a smaller s the derivative overflows
    limit = stop_gradient(xp.where(u == 0, 0.0, u / abs(s)))  # the absolute value, because s may be −0
    return xp.where(regular, u / xp.where(regular, s, 1.0), limit)


@of_arrays
def from_gibbs(g: Vec3) -> Quat:
    """Return the unit quaternion (1, G)/√(1+|G|²) of the Gibbs vector G = `g`.

    If one component is infinite, the result is a half turn about the coordinate axis of this component. If several
    components are infinite, the axis is unknown, and the result is NaN.
    """
    infinite = xp.isinf(g)
    half_turn = xp.sum(infinite, axis=-1, keepdims=True) == 1
    finite = xp.where(half_turn, xp.where(infinite, xp.sign(g), 0.0), g)
    scalar = xp.where(half_turn, 0.0, xp.ones_like(g[..., :1]))
    return unit_quaternion(xp.concatenate([scalar, finite], axis=-1))


@of_arrays
def gibbs_from_dcm(C: Mat3) -> Vec3:
    """Return the Gibbs vector of the matrix `C` of direction cosines α.

    Let λ be the unit quaternion of α. If λ0² is the largest squared component of the unit quaternion, the result is
    (α23−α32, α31−α13, α12−α21)/(1 + tr α). Otherwise the components are the ratios λ_jλ_k/(λ0λ_k) for the k with the
    largest λ_k², because these ratios lose the fewest digits near a half turn. For a half turn see `to_gibbs`.
    """
    return to_gibbs(pivot_row(C))


@of_arrays
def gibbs_ratios(C: Mat3) -> Float[Array, "3 2"]:
    """Return the six ratios printed in paper S; row k contains the two ratios for component k of the Gibbs vector.

    Let λ be the unit quaternion of the direction cosines `C`. The two ratios for component G_k divide by 4λ0λ_m, m ≠ k.
    If this product is zero, the value and the gradient are infinite or NaN. `gibbs_from_dcm` does not have this
    limitation.
    """
    d1, d2, d3 = C[..., 1, 2] - C[..., 2, 1], C[..., 2, 0] - C[..., 0, 2], C[..., 0, 1] - C[..., 1, 0]
    s1, s2, s3 = C[..., 1, 2] + C[..., 2, 1], C[..., 2, 0] + C[..., 0, 2], C[..., 0, 1] + C[..., 1, 0]
    ratios = [[s3 / d2, s2 / d3], [s3 / d1, s1 / d3], [s2 / d1, s1 / d2]]
    return xp.stack([xp.stack(row, axis=-1) for row in ratios], axis=-2)


@of_arrays
def to_mrp(q: Quat) -> Vec3:
    """Return the MRP e tan Φ/4 of the shorter rotation, with the axis e and the angle Φ ≤ π; so |MRP| ≤ 1.

    `q` and `c*q` give the same result for any c ≠ 0.
    """
    q = canonical(balanced(q))
    return q[..., 1:] / (q[..., 0] + norm(q))[..., None]


@of_arrays
def from_mrp(p: Vec3) -> Quat:
    """Return the unit quaternion (1 − |p|², 2p)/(1 + |p|²); the shadow set −p/|p|² yields its negative."""
    size = stop_gradient(norm(p))[..., None]
    scale = 1 / xp.where(size > 1, size, 1.0)  # |p|² could overflow
    p = scale * p
    square, one = xp.sum(p * p, axis=-1, keepdims=True), scale * scale
    return xp.concatenate([one - square, 2 * scale * p], axis=-1) / (one + square)
