"""The invariants of a path: what its derivatives say without reference to any axes.

The one home of these formulas. With the derivatives r', r'', r''' in *any* orthonormal basis,

    S = r'·r',   N = |r' × r''|²,   T = (r' × r'')·r''',

and speed² = S, curvature² = N/S³, torsion = T/N. For a spiral-helix the basis is the rotating one (e_ρ, e_φ, k), in
which every derivative is a polynomial in t: no trigonometry.
"""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar, Vec3
from qtraj.path.components import Triple, cross, dot, times, total

Jets = tuple[Sequence[Any], Sequence[Any], Sequence[Any]]
"""Taylor coefficients (k-th derivative / k!) of ρ [m], φ [rad] and h [m]; the integer 0 for one that vanishes."""


def rotating_components(radius: Sequence[Any], angle: Sequence[Any], height: Sequence[Any]) -> list[Triple]:
    """Derivatives of ρ(i cos φ + j sin φ) + k h in the rotating basis (e_ρ, e_φ, k), orders 0 … n−1, a triple each.

    The arguments are Taylor coefficients (k-th derivative / k!) of ρ [m], φ [rad] and h [m] at one instant, or at many:
    then each is an array. In the plane r = ρ e^{iφ}: with g(s) = e^{i(φ(t+s)−φ(t))}, g' = iφ'g gives the series of g,
    and that of ρg follows by Cauchy's product. Orders 1 and 2 are (ρ̇, ρφ̇, ḣ) and (ρ̈ − ρφ̇², 2ρ̇φ̇ + ρφ̈, ḧ) (paper S).
    """
    count = len(radius)
    cos: list[Any] = [1]
    sin: list[Any] = [0]
    for k in range(count - 1):
        slopes = [times(j + 1, angle[j + 1]) for j in range(k + 1)]
        part = 1 / (k + 1) if k else 1
        cos.append(times(-part, _cauchy(slopes, sin, k)))
        sin.append(times(part, _cauchy(slopes, cos, k)))
    rows = []
    for k in range(count):
        scale = math.factorial(k)
        row = (_cauchy(radius, cos, k), _cauchy(radius, sin, k), height[k])
        rows.append((times(scale, row[0]), times(scale, row[1]), times(scale, row[2])))
    return rows


def _cauchy(p: Sequence[Any], q: Sequence[Any], k: int) -> Any:
    """The k-th coefficient of the product of two series."""
    return total([times(p[j], q[k - j]) for j in range(k + 1)])


class Invariants(eqx.Module):
    """S [m² s⁻²], N [m⁴ s⁻⁶] and T [m³ s⁻⁶] of a path, at one instant or at many."""

    S: Float[Array, "..."]
    N: Float[Array, "..."]
    T: Float[Array, "..."]


def invariants(r1: Any, r2: Any, r3: Any) -> Invariants:
    """S, N and T from the first three time derivatives in any one orthonormal basis: vectors (3,), or triples."""
    c = cross(r1, r2)
    return Invariants(S=dot(r1, r1), N=dot(c, c), T=dot(c, r3))


class Existence(eqx.Module):
    """Relative measures in [0, 1] of motion and bend at one instant; zero where v = 0 or c = 0.

    `motion` is S against the speeds that the path's own changes make over its duration, and `bend` is N against the
    largest N that these speeds and accelerations allow: squares of relative sizes, without units.
    """

    motion: Scalar
    bend: Scalar


def existence(r1: Vec3, r2: Vec3, r3: Vec3, duration: Scalar) -> Existence:
    """How clearly speed and curvature differ from zero, from the first three derivatives and the duration [s]."""
    of = invariants(r1, r2, r3)
    speeds, areas = largest(of, r2, r3, duration)
    return Existence(motion=_ratio(of.S, speeds), bend=_ratio(of.N, areas))


def largest(of: Invariants, r2: Any, r3: Any, duration: Array) -> tuple[Array, Array]:
    """What S and N are measured against in `Existence`."""
    square = dot(r2, r2)
    speeds = of.S + duration**2 * square + duration**4 * dot(r3, r3)
    return speeds, of.S * (square + of.S / duration**2)


def _ratio(part: Scalar, whole: Scalar) -> Scalar:
    positive = whole > 0
    return jnp.where(positive, part / jnp.where(positive, whole, 1.0), 0.0)
