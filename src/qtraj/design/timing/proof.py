"""Limits on a retimed path, proved on the whole of each cell.

In a cell the path and the squared path speed a are polynomials, and each limit is one polynomial inequality between
them (see `constraints`). The path is taken in its moving basis and restricted to the cell by an exact change of
variable: the number of cells is a power of two.
"""

from typing import Any

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
from qtraj.design.timing.timing import Timing
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES


class _Cell(eqx.Module):
    """Models of a cell: invariants of the path's derivatives, and a with its derivatives, in half durations."""

    path: Invariants
    a: ChebyshevModel
    slope: ChebyshevModel
    bend: ChebyshevModel


def proved(
    path: MovingPolynomials, duration: Scalar, timing: Timing, bounds: dict[str, Scalar]
) -> dict[str, Int[Array, ""]]:
    """For each limit the status PROVED, BROKEN or UNDECIDED; proved only where a > 0 is proved too.

    Absent limits are infinite.
    """
    return _proved(path, duration, timing.coefficients, jnp.asarray(timing.rest), bounds)


@eqx.filter_jit
def _proved(
    path: Any, duration: Array, coefficients: Array, at_rest: Bool[Array, " 2"], bounds: dict[str, Scalar]
) -> dict[str, Array]:
    cells = coefficients.shape[0]
    whole = path_derivatives(jax.tree.map(lambda x: x[..., None], path), duration[None])
    a, rest = _timing(coefficients, at_rest)
    middle = (2 * jnp.arange(cells, dtype=coefficients.dtype) + 1) / cells - 1

    def cell(centre: Array, half: Array) -> _Cell:
        at, size = middle + centre / cells, half / cells
        r = [None, *(_spread(p, cells).on(at, size) for p in whole.derivatives[:3])]
        a0, a1, a2 = (p.on(centre, half)[0] for p in a)
        return _Cell(Invariants(r), a0, cells * a1, cells * cells * a2)

    squares = [squared_bound(bounds[name][None], _unit(name, whole)) for name in NAMES]
    squares = tuple(jnp.stack(x) for x in zip(*squares, strict=True))
    widest = jnp.full(cells, 2.0, coefficients.dtype)

    def judged(k: Array) -> Array:
        """The status of one limit; the last is that a is positive."""
        bound = tuple(x[jnp.minimum(k, len(NAMES) - 1)] for x in squares)
        slacks = [lambda *at, name=name: _slack(name, bound, cell(*at)) for name in NAMES]
        choices = [*slacks, lambda *at: rest.on(*at)[0]]
        return _status(prove_positive(lambda *at: jax.lax.switch(k, choices, *at), widest).code)

    wanted = jnp.append(jnp.stack([jnp.isfinite(bounds[name]) for name in NAMES]), True)
    decide = lambda k: jax.lax.cond(wanted[k], judged, lambda k: jnp.asarray(PROVED, jnp.int32), k)  # noqa: E731
    codes = jax.lax.map(decide, jnp.arange(len(NAMES) + 1))
    codes = jnp.where(codes[-1] == PROVED, codes, jnp.maximum(codes, codes[-1]))
    return {name: codes[k] for k, name in enumerate(NAMES)}


def _status(codes: Int[Array, " cells"]) -> Int[Array, ""]:
    all_positive, any_negative = jnp.all(codes == POSITIVE), jnp.any(codes == NEGATIVE)
    return jnp.where(any_negative, BROKEN, jnp.where(all_positive, PROVED, UNDECIDED)).astype(jnp.int32)


def _spread(p: CellPolynomial, cells: int) -> CellPolynomial:
    """The same polynomial for every cell."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-1], cells)), p)


def _timing(
    coefficients: Float[Array, "cells 4"], at_rest: Bool[Array, " 2"]
) -> tuple[list[CellPolynomial], CellPolynomial]:
    """a, a' and a'' in s in [−1, 1] of each cell; and a without the factors that vanish at an end at rest."""
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
    """What turns the limit [m, s] into a number."""
    entry = QUANTITIES[name]
    return whole.unit**entry.per_time / whole.length**entry.length


def _slack(name: str, bound: Any, c: _Cell) -> ChebyshevModel:
    """limit² · denominator − numerator."""
    i, a = c.path, c.a
    twice = lambda p, q, r, s: 2 * (p * q) + r * s  # noqa: E731
    if name in UPPER:
        entry = QUANTITIES[name]
        numerator = entry.numerator(i) * a
        numerator = numerator * a if entry.per_time == 2 else numerator
        denominator = a.one() if entry.denominator is None else entry.denominator(i)
        return multiple(denominator, *bound) - numerator
    if name == "longitudinal_acceleration":
        along = twice(i.B, a, i.S, c.slope)
        return multiple(4 * i.S, *bound) - along * along
    if name == "acceleration":
        double = 2 * (i.r[2] * a) + i.r[1] * c.slope
        return multiple(4 * a.one(), *bound) - double @ double
    if name == "jerk":
        double = 2 * (i.r[3] * a) + 3 * (i.r[2] * c.slope) + i.r[1] * c.bend
        return multiple(4 * a.one(), *bound) - a * (double @ double)
    SH = i.S * i.H
    growth = i.P1 * SH - i.P * (i.B * i.H + i.S * i.G)
    turning = 2 * (growth * a) + (i.P * SH) * c.slope
    return multiple(4 * (SH * (SH * SH)), *bound) - turning * turning
