"""The invariants of a path: what its derivatives say without reference to any axes.

The one home of these formulas. With the derivatives r', r'', r''' in *any* orthonormal basis,

    S = r'·r',   N = |r' × r''|²,   T = (r' × r'')·r''',

and speed² = S, curvature² = N/S³, torsion = T/N. For a spiral-helix the basis is the rotating one (e_ρ, e_φ, k), in
which every derivative is a polynomial in t: no trigonometry.
"""

import math
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar, Vec3


Components = tuple[Scalar, Scalar, Scalar]
"""The components of a vector, one number each: they compile to faster loops than arrays of three."""


def rotating_components(
    radius: Sequence[Scalar], angle: Sequence[Scalar], height: Sequence[Scalar]
) -> list[Components]:
    """Derivatives of ρ(i cos φ + j sin φ) + k h in the rotating basis (e_ρ, e_φ, k), orders 0 … n−1.

    The arguments are Taylor coefficients (k-th derivative / k!) of ρ [m], φ [rad] and h [m] at one instant. In the
    plane r = ρ e^{iφ}: with g(s) = e^{i(φ(t+s)−φ(t))}, g' = iφ'g gives the series of g, and that of ρg follows by
    Cauchy's product. Orders 1 and 2 are (ρ̇, ρφ̇, ḣ) and (ρ̈ − ρφ̇², 2ρ̇φ̇ + ρφ̈, ḧ) (paper S, ṙ and r̈).
    """
    count = len(radius)
    cos, sin = [jnp.ones_like(radius[0])], [jnp.zeros_like(radius[0])]
    for k in range(count - 1):
        slopes = [(j + 1) * angle[j + 1] for j in range(k + 1)]
        cos.append(-_cauchy(slopes, sin, k) / (k + 1))
        sin.append(_cauchy(slopes, cos, k) / (k + 1))
    rows = []
    for k in range(count):
        along, across = _cauchy(radius, cos, k), _cauchy(radius, sin, k)
        rows.append((math.factorial(k) * along, math.factorial(k) * across, math.factorial(k) * height[k]))
    return rows


def _cauchy(p: Sequence[Scalar], q: Sequence[Scalar], k: int) -> Scalar:
    """The k-th coefficient of the product of two series."""
    total = p[0] * q[k]
    for j in range(1, k + 1):
        total = total + p[j] * q[k - j]
    return total


class Invariants(eqx.Module):
    """S [m² s⁻²], N [m⁴ s⁻⁶] and T [m³ s⁻⁶] of a path at one instant."""

    S: Scalar
    N: Scalar
    T: Scalar


def invariants(r1: Vec3, r2: Vec3, r3: Vec3) -> Invariants:
    """S, N and T from the first three time derivatives in any one orthonormal basis."""
    a, b, c = _split(r1), _split(r2), _split(r3)
    area = cross(a, b)
    return Invariants(S=dot(a, a), N=dot(area, area), T=dot(area, c))


def dot(a: Components, b: Components) -> Scalar:
    """The scalar product, by components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Components, b: Components) -> Components:
    """The vector product, by components."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _split(v: Vec3) -> Components:
    return v[0], v[1], v[2]


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
    speeds = of.S + duration**2 * (r2 @ r2) + duration**4 * (r3 @ r3)
    areas = of.S * (r2 @ r2 + of.S / duration**2)
    return Existence(motion=_ratio(of.S, speeds), bend=_ratio(of.N, areas))


def _ratio(part: Scalar, whole: Scalar) -> Scalar:
    positive = whole > 0
    return jnp.where(positive, part / jnp.where(positive, whole, 1.0), 0.0)
