"""ω⁰ and ε⁰ of the natural trihedral in its own axes: the one home of these formulas, for one instant or for many."""

from typing import Any

from qtraj.path.components import cross, dot


def natural_rate(r: Any, c: Any, slowness: Any, narrowness: Any, torsion: Any) -> tuple[Any, Any]:
    """The components of ω⁰ = (vχ, 0, vκ) [rad/s] that are not zero, along τ and along b.

    `r` are the derivatives of the path, orders 0 to 4, each a vector (3,) or a triple, in any one orthonormal basis
    that may turn with the path; c = r'×r'', `slowness` = 1/v and `narrowness` = 1/|c|. Where one of them does not
    exist, any finite number in its place gives finite results and derivatives.
    """
    return dot(r[1], r[1]) * slowness * torsion, dot(c, c) * narrowness * slowness**2


def natural_acceleration(r: Any, c: Any, slowness: Any, narrowness: Any, torsion: Any) -> tuple[Any, Any]:
    """The same of ε⁰ [rad/s²], the derivative of ω⁰, by c' = r'×r''' (paper S, with its errata mended)."""
    slope, growth = dot(r[1], r[2]), dot(c, cross(r[1], r[3]))
    thin, slow = narrowness**2, slowness**2
    torsion_rate = dot(c, r[4]) * thin - 2 * dot(c, r[3]) * growth * thin**2
    speed, area = dot(r[1], r[1]) * slowness, dot(c, c) * narrowness
    along = slope * slowness * torsion + speed * torsion_rate
    return along, growth * narrowness * slow - 2 * area * slope * slow**2
