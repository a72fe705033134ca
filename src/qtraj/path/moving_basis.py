"""Represent paths by polynomial components in a basis that rotates about its third axis.

r(t) = R_z(φ(t))·(x(t), y(t), z(t)) in the axes of a placement, where x, y, z and φ are polynomials in t, and R_z(φ) is
the rotation by φ about the third axis. A spiral-helix has the components (ρ, 0, h), radius and height, and its azimuth
as the angle φ; a polynomial path in world axes has φ = 0. In this basis the components of every derivative are
polynomials, so proofs, tuning and batched evaluation need no trigonometric functions.
"""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.algebra import polynomial
from qtraj.algebra.sparse import add, is_zero, mul
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import ScalarLike
from qtraj.path.components import Triple
from qtraj.path.placement import Placement

Series = Sequence[Any]
"""Taylor coefficients (k-th derivative / k!) of orders 0 … n−1; identically zero coefficients are the integer 0."""


class MovingPolynomials(eqx.Module):
    """Ascending coefficients in t [s] of x, y, z [m] and of the angle φ [rad]; `y` is None if y is always 0."""

    x: Float[Array, "*batch _"]
    y: Float[Array, "*batch _"] | None
    z: Float[Array, "*batch _"]
    angle: Float[Array, "*batch _"]
    placement: Placement | None = None

    def series(self, t: ScalarLike, order: int) -> tuple[Series, Series, Series, Series]:
        """Return the Taylor coefficients of x, y, z and φ at instants `t`, orders 0 … `order`; 0 stands for zeros."""
        x, z, angle = (_series(c, t, order) for c in (self.x, self.z, self.angle))
        y = [0] * (order + 1) if self.y is None else _series(self.y, t, order)
        return x, y, z, angle

    def components(self, t: ScalarLike, order: int) -> list[Triple]:
        """Return the derivatives of r at one instant in the moving basis, orders 0 … `order`, each a triple."""
        return in_moving_basis(*self.series(t, order))


def in_moving_basis(x: Series, y: Series, z: Series, angle: Series) -> list[Triple]:
    """Return the derivatives of R_z(φ)·(x, y, z) in the moving basis, orders 0 … n−1, each a triple.

    Each argument has n Taylor coefficients; `angle` is φ, and R_z(φ) is the rotation by φ about the third axis. In the
    plane of x and y, r = (x + iy) e^{iφ}. Let g(s) = e^{i(φ(t+s)−φ(t))}. Then g' = iφ'g determines the Taylor series of
    g. The Cauchy product of x + iy and g is the Taylor series of r in the moving basis at t. For x = ρ, y = 0 and z = h
    (a spiral-helix), the derivatives of orders 1 and 2 are (ρ̇, ρφ̇, ḣ) and (ρ̈ − ρφ̇², 2ρ̇φ̇ + ρφ̈, ḧ) (paper S).
    """
    count = len(x)
    cos: list[Any] = [1]
    sin: list[Any] = [0]
    for k in range(count - 1):
        slopes = [mul(j + 1, angle[j + 1]) for j in range(k + 1)]
        part = 1 / (k + 1) if k else 1
        cos.append(mul(-part, _cauchy(slopes, sin, k)))
        sin.append(mul(part, _cauchy(slopes, cos, k)))
    rows = []
    for k in range(count):
        scale = math.factorial(k)
        across = mul(-1, _cauchy(y, sin, k))
        row = (add([_cauchy(x, cos, k), across]), add([_cauchy(x, sin, k), _cauchy(y, cos, k)]), z[k])
        rows.append((mul(scale, row[0]), mul(scale, row[1]), mul(scale, row[2])))
    return rows


def _series(coefficients: Float[Array, " _"], t: ScalarLike, order: int) -> Series:
    terms = polynomial.split_taylor(coefficients, t, order)
    return terms if xp.ndim(t) == 0 else [x if is_zero(x) else xp.broadcast_to(x, xp.shape(t)) for x in terms]


def _cauchy(p: Series, q: Series, k: int) -> Any:
    """Return the k-th coefficient of the product of two series."""
    return add([mul(p[j], q[k - j]) for j in range(k + 1)])
