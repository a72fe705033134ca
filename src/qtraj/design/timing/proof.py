"""Proofs that a retimed path satisfies its limits on every cell.

In a cell the path and the squared path speed a are polynomials, and each limit is one polynomial inequality between
them (see `constraints`). A route is represented in world axes, any other path in its moving basis. An exact change of
variable restricts the path to the cell, because every cell is a dyadic part of a segment. Quantities that depend on the
direction of the path are computed from the direction q instead of r', because q does not vanish where a segment starts
or ends at a stop (see `directions`).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.algebra.chebyshev_model import ChebyshevModel, multiple
from qtraj.algebra.positivity import NEGATIVE, POSITIVE, prove_positive
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED
from qtraj.design.proof.inequalities import PathDerivatives, path_derivatives, squared_bound
from qtraj.design.timing.constraints import NAMES, UPPER
from qtraj.design.timing.grid import Grid
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES

HIGHEST = 6
"""The highest multiplicity of a stop: up to six derivatives of a septic may vanish there."""


class _Cells(eqx.Module):
    """Models on the cells, in units of half durations: three derivatives of the path, and a with its derivatives.

    With r' = w·q, `ahead` contains q and its two derivatives, and `factor` is w. Without stops q is r', and `factor` is
    None.
    """

    path: list[ChebyshevModel]
    ahead: list[ChebyshevModel]
    factor: ChebyshevModel | None
    a: ChebyshevModel
    slope: ChebyshevModel
    bend: ChebyshevModel


class Source(NamedTuple):
    """The polynomials of the segments (on the last axis), their durations [s], and their `Directions`."""

    polynomials: MovingPolynomials
    durations: Float[Array, " segments"]
    ahead: tuple[MovingPolynomials, Int[np.ndarray, "segments 2"], Float[np.ndarray, " segments"]] | None


class Proofs(eqx.Module):
    """For each limit, in the order of `NAMES`, the status PROVED, BROKEN or UNDECIDED on each cell."""

    codes: Int[Array, "limits cells"]

    def whole(self) -> Int[Array, " limits"]:
        """The status on all cells together."""
        broken, proved = jnp.any(self.codes == BROKEN, axis=1), jnp.all(self.codes == PROVED, axis=1)
        return jnp.where(broken, BROKEN, jnp.where(proved, PROVED, UNDECIDED)).astype(jnp.int32)


@eqx.filter_jit
def prove(
    path: Source,
    grid: Grid,
    timing: tuple[Float[Array, "cells 4"], Bool[Array, " 2"]],
    bounds: dict[str, Scalar],
) -> Proofs:
    """The status of each limit on each cell; PROVED requires a proof of a > 0.

    `timing`: the coefficients of a in each cell, and whether a is zero at the start and at the end. Absent limits are
    infinite.
    """
    coefficients, at_rest = timing
    segments = path_derivatives(path.polynomials, path.durations)
    segment, middle, size = (jnp.asarray(x) for x in (grid.segment, grid.middle, grid.half))
    own = _of_cells(segments.derivatives[:3], segment)
    directions = None if path.ahead is None else _directions(path.ahead, path.durations, segments.length, segment)
    a, rest = _timing(coefficients, at_rest)
    finer = [_scaled(p, (1 / size) ** k) for k, p in enumerate(a)]
    of_cells = PathDerivatives([], segments.length[segment], segments.unit[segment])
    squares = [squared_bound(bounds[name], _unit(name, of_cells)) for name in NAMES]
    squares = tuple(jnp.stack(x) for x in zip(*squares, strict=True))
    widest = jnp.full(segment.shape, 2.0, coefficients.dtype)

    def cells(centre: Array, half: Array) -> _Cells:
        at = middle[None] + centre * size[None], half * size[None]
        r = [p.on(*at) for p in own]
        q = r if directions is None else [p.on(*at) for p in directions[0]]
        factor = None if directions is None else directions[1].on(*at)[0]
        return _Cells(r, q, factor, *(p.on(centre, half)[0] for p in finer))

    def judged(k: Array) -> Array:
        """The status of the limit with index `k` on each cell; the last index refers to a > 0."""
        bound = tuple(x[jnp.minimum(k, len(NAMES) - 1)] for x in squares)
        slacks = [lambda c, at, name=name: _slack(name, bound, c) for name in NAMES]
        choices = [*slacks, lambda c, at: rest.on(*at)[0]]
        code = prove_positive(lambda *at: jax.lax.switch(k, choices, cells(*at), at), widest).code
        return jnp.where(code == NEGATIVE, BROKEN, jnp.where(code == POSITIVE, PROVED, UNDECIDED)).astype(jnp.int32)

    wanted = jnp.append(jnp.stack([jnp.isfinite(bounds[name]) for name in NAMES]), True)
    none = jnp.full(segment.shape, PROVED, jnp.int32)
    codes = jax.lax.map(lambda k: jax.lax.cond(wanted[k], judged, lambda k: none, k), jnp.arange(len(NAMES) + 1))
    return Proofs(jnp.where((codes[-1:] == PROVED) | (codes[:-1] == BROKEN), codes[:-1], UNDECIDED))


def _of_cells(polynomials: list[CellPolynomial], segment: Int[Array, " cells"]) -> list[CellPolynomial]:
    return [jax.tree.map(lambda x: x[..., segment], p) for p in polynomials]


def _directions(
    ahead: tuple[MovingPolynomials, Any, Any], durations: Array, length: Array, segment: Int[Array, " cells"]
) -> tuple[list[CellPolynomial], CellPolynomial]:
    """q with two derivatives in each cell, and w with r' = w·q in the units of r' and q."""
    polynomials, powers, roundings = ahead
    found = path_derivatives(polynomials, durations, jnp.asarray(roundings)[None])
    table = np.zeros((HIGHEST + 1, HIGHEST + 1, 2 * HIGHEST + 1))  # (1 + s)^m (1 − s)^n
    for m in range(HIGHEST + 1):
        for n in range(HIGHEST + 1):
            rising, falling = (np.polynomial.polynomial.polypow([1.0, x], k) for x, k in ((1.0, m), (-1.0, n)))
            product = np.polynomial.polynomial.polymul(rising, falling)
            table[m, n, : product.size] = product
    m, n = (jnp.asarray(powers)[:, k] for k in range(2))
    factor = jnp.asarray(table)[m, n].T * (found.length / length)[None]  # lengths are powers of two
    w = cell_polynomial(factor[None, :, None], jnp.zeros_like(length)[None])
    return _of_cells(found.derivatives[:3], segment), _of_cells([w], segment)[0]


def _scaled(p: CellPolynomial, factor: Float[Array, " cells"]) -> CellPolynomial:
    """The polynomials multiplied by powers of two, which is exact."""
    return CellPolynomial(
        p.coefficients * factor[None, None, None], p.shifts * factor[None, None, None, None], p.error * factor[None]
    )


def _timing(
    coefficients: Float[Array, "cells 4"], at_rest: Bool[Array, " 2"]
) -> tuple[list[CellPolynomial], CellPolynomial]:
    """a, a' and a'' as polynomials in s in [−1, 1] of each cell, and a divided by its factor that vanishes at rest."""
    c0, c1, c2, c3 = coefficients.T  # powers of (1 + s)/2
    start, end = at_rest
    zero = jnp.zeros_like(c0)
    first, last = jnp.arange(c0.size) == 0, jnp.arange(c0.size) == c0.size - 1
    powers = jnp.stack([c0, c1, c2, c3])
    after_start = jnp.stack([c1, c2, c3, zero])
    before_end = jnp.stack([-(c1 + c2 + c3), -(c2 + c3), -c3, zero])
    rest = jnp.where(first & start, after_start, jnp.where(last & end, before_end, powers))
    forms = powers, jnp.stack([c1, 2 * c2, 3 * c3]) / 2, jnp.stack([2 * c2, 6 * c3]) / 4
    return [_centred(form) for form in forms], _centred(rest)


def _centred(powers: Float[Array, "k cells"]) -> CellPolynomial:
    """From powers of (1 + s)/2 to powers of s, with a bound on the rounding."""
    n = powers.shape[0] - 1
    matrix = np.zeros((n + 1, n + 1))
    for k in range(n + 1):
        matrix[: k + 1, k] = np.polynomial.polynomial.polypow([0.5, 0.5], k)
    form = jnp.sum(jnp.asarray(matrix)[:, :, None] * powers[None], axis=1)
    size = jnp.sum(jnp.abs(powers), axis=0)
    error = 32 * float(np.finfo(powers.dtype).eps) * size
    return cell_polynomial(form[None, :, None], error[None])


def _unit(name: str, whole: PathDerivatives) -> Array:
    """The factor that makes the limit dimensionless."""
    entry = QUANTITIES[name]
    return whole.unit**entry.per_time / whole.length**entry.length


def _slack(name: str, bound: Any, c: _Cells) -> ChebyshevModel:
    """limit² · denominator − numerator."""
    real, i, a = Invariants([None, *c.path]), Invariants([None, *c.ahead]), c.a
    if name == "lateral_acceleration":
        across = i.r[1].cross(real.r[2])
        return multiple(i.S, *bound) - (across @ across) * (a * a)
    if name in UPPER:
        entry, own = QUANTITIES[name], real if name == "speed" else i
        denominator = a.one() if entry.denominator is None else entry.denominator(own)
        return multiple(denominator, *bound) - entry.numerator(own) * a
    if name == "longitudinal_acceleration":
        slope = i.S * c.slope
        along = 2 * ((i.r[1] @ real.r[2]) * a) + (slope if c.factor is None else c.factor * slope)
        return multiple(4 * i.S, *bound) - along * along
    if name == "acceleration":
        double = 2 * (real.r[2] * a[None]) + real.r[1] * c.slope[None]
        return multiple(4 * a.one(), *bound) - double @ double
    if name == "jerk":
        double = 2 * (real.r[3] * a[None]) + 3 * (real.r[2] * c.slope[None]) + real.r[1] * c.bend[None]
        return multiple(4 * a.one(), *bound) - a * (double @ double)
    SH = i.S * i.H
    growth = i.P1 * SH - i.P * (i.B * i.H + i.S * i.G)
    turning = 2 * (growth * a) + (i.P * SH) * c.slope
    return multiple(4 * (SH * (SH * SH)), *bound) - turning * turning
