"""ω⁰ and ε⁰ of the natural trihedral in its own axes: the one home of these formulas, for one instant or for many.

`r` are the derivatives of the path, orders 0 to 4, each a vector (3,) or a triple, in any one orthonormal basis that
may turn with the path; c = r'×r'', `of` the invariants S, N and T, `slowness` = 1/v, `narrowness` = 1/|c| and `torsion`
χ = T/N. Where one of the last three does not exist, any finite number in its place gives finite results and
derivatives.
"""

from collections.abc import Sequence

from jaxtyping import Array, Float

from qtraj.foundation.types import Vec3
from qtraj.path.components import Triple, cross, dot
from qtraj.path.invariants import Invariants

Numbers = Float[Array, "..."]


def natural_rate(of: Invariants, slowness: Numbers, narrowness: Numbers, torsion: Numbers) -> tuple[Numbers, Numbers]:
    """The components of ω⁰ = (vχ, 0, vκ) [rad/s] that are not zero, along τ and along b: vκ = |c|/v²."""
    return of.S * slowness * torsion, of.N * narrowness * slowness**2


def natural_acceleration(
    r: Sequence[Triple] | Float[Array, "5 3"],
    c: Triple | Vec3,
    of: Invariants,
    slowness: Numbers,
    narrowness: Numbers,
    torsion: Numbers,
) -> tuple[Numbers, Numbers]:
    """The same of ε⁰ [rad/s²], the derivative of ω⁰, by c' = r'×r''' (paper S, with its errata mended)."""
    slope, growth = dot(r[1], r[2]), dot(c, cross(r[1], r[3]))
    thin, slow = narrowness**2, slowness**2
    torsion_rate = dot(c, r[4]) * thin - 2 * of.T * growth * thin**2
    speed, area = of.S * slowness, of.N * narrowness
    along = slope * slowness * torsion + speed * torsion_rate
    return along, growth * narrowness * slow - 2 * area * slope * slow**2
