"""Gibbs vectors G = e tan Φ/2 and modified Rodrigues parameters e tan Φ/4."""

import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.algebra.cosines import pivot_row
from qtraj.algebra.quaternion import canonical, unit as unit_quaternion
from qtraj.algebra.vector import balanced, norm
from qtraj.foundation.types import Mat3, Quat, Vec3


def to_gibbs(q: Quat) -> Vec3:
    """Gibbs vector G_k = λ_k/λ0; `q` and `c*q` agree for any c ≠ 0.

    A half turn (λ0 = 0) has no finite Gibbs vector. Its components are ±inf where the axis has one (the first of them
    +inf) and 0 elsewhere, and the derivative is 0, never NaN.
    """
    q = canonical(balanced(q))
    s, u = q[0], q[1:]
    regular = s * s >= jnp.finfo(q.dtype).tiny  # else the derivative cannot be represented
    limit = stop_gradient(jnp.where(u == 0, 0.0, u / jnp.abs(s)))  # s may be −0
    return jnp.where(regular, u / jnp.where(regular, s, 1.0), limit)


def from_gibbs(g: Vec3) -> Quat:
    """The unit quaternion (1, G)/√(1+|G|²).

    One infinite component gives the half turn about that axis; with several the axis is unknown and the result is NaN.
    """
    infinite = jnp.isinf(g)
    half_turn = jnp.sum(infinite) == 1
    finite = jnp.where(half_turn, jnp.where(infinite, jnp.sign(g), 0.0), g)
    scalar = jnp.where(half_turn, 0.0, jnp.ones_like(g, shape=1))
    return unit_quaternion(jnp.concatenate([scalar, finite]))


def gibbs_from_dcm(C: Mat3) -> Vec3:
    """Gibbs vector of the direction cosines α.

    Where α0² is the largest square this is the regular form (α23−α32, α31−α13, α12−α21)/(1 + tr α). Elsewhere it uses
    paper S's ratios with the largest α_k², which lose the fewest digits near Φ = π. At Φ = π see `to_gibbs`.
    """
    return to_gibbs(pivot_row(C))


def gibbs_ratios(C: Mat3) -> Float[Array, "3 2"]:
    """Paper S's six printed ratios, two for each component.

    Both forms of G_k divide by 4α0α_m, m ≠ k, and are inf or NaN, value and gradient, where it is zero. Use
    `gibbs_from_dcm` instead.
    """
    d1, d2, d3 = C[1, 2] - C[2, 1], C[2, 0] - C[0, 2], C[0, 1] - C[1, 0]
    s1, s2, s3 = C[1, 2] + C[2, 1], C[2, 0] + C[0, 2], C[0, 1] + C[1, 0]
    ratios = [[s3 / d2, s2 / d3], [s3 / d1, s1 / d3], [s2 / d1, s1 / d2]]
    return jnp.stack([jnp.stack(row) for row in ratios])


def to_mrp(q: Quat) -> Vec3:
    """MRP e tan Φ/4 of the shorter rotation, so |MRP| ≤ 1; `q` and `c*q` agree for any c ≠ 0."""
    q = canonical(balanced(q))
    return q[1:] / (q[0] + norm(q))


def from_mrp(p: Vec3) -> Quat:
    """The unit quaternion (1 − |p|², 2p)/(1 + |p|²); p and its shadow set −p/|p|² give opposite signs."""
    square = jnp.sum(p * p)
    return jnp.concatenate([(1 - square)[None], 2 * p]) / (1 + square)
