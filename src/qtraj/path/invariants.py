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

from qtraj.foundation.types import Scalar, ScalarLike, Vec3

Components = tuple[ScalarLike, ScalarLike, ScalarLike]
"""The components of a vector, one number each: they compile to faster loops than arrays of three. The Python number 0.0
stands for what vanishes everywhere."""


def rotating_components(
    radius: Sequence[ScalarLike], angle: Sequence[ScalarLike], height: Sequence[ScalarLike]
) -> list[Components]:
    """Derivatives of ρ(i cos φ + j sin φ) + k h in the rotating basis (e_ρ, e_φ, k), orders 0 … n−1.

    The arguments are Taylor coefficients (k-th derivative / k!) of ρ [m], φ [rad] and h [m] at one instant. In the
    plane r = ρ e^{iφ}: with g(s) = e^{i(φ(t+s)−φ(t))}, g' = iφ'g gives the series of g, and that of ρg follows by
    Cauchy's product. Orders 1 and 2 are (ρ̇, ρφ̇, ḣ) and (ρ̈ − ρφ̇², 2ρ̇φ̇ + ρφ̈, ḧ) (paper S, ṙ and r̈).
    """
    count = len(radius)
    cos: list[ScalarLike] = [1.0]
    sin: list[ScalarLike] = [0.0]
    for k in range(count - 1):
        slopes = [_times(float(j + 1), angle[j + 1]) for j in range(k + 1)]
        cos.append(_times(-1.0 / (k + 1), _cauchy(slopes, sin, k)))
        sin.append(_times(1.0 / (k + 1), _cauchy(slopes, cos, k)))
    rows = []
    for k in range(count):
        row = (_cauchy(radius, cos, k), _cauchy(radius, sin, k), height[k])
        rows.append(tuple(_times(float(math.factorial(k)), x) for x in row))
    return rows


def _cauchy(p: Sequence[ScalarLike], q: Sequence[ScalarLike], k: int) -> ScalarLike:
    """The k-th coefficient of the product of two series."""
    products = [_times(p[j], q[k - j]) for j in range(k + 1)]
    return sum((x for x in products if not _is(x, 0.0)), 0.0)


def _times(a: ScalarLike, b: ScalarLike) -> ScalarLike:
    """a·b, without arithmetic where either is the Python number 0.0 or 1.0."""
    if _is(a, 0.0) or _is(b, 0.0):
        return 0.0
    if _is(a, 1.0):
        return b
    return a if _is(b, 1.0) else a * b


def _is(x: ScalarLike, value: float) -> bool:
    return isinstance(x, float) and x == value


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


def dot(a: Components, b: Components) -> ScalarLike:
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
