"""Bound the slack of each limit on subcells of a retimed path.

In a cell the path and a = u̇² are polynomials, and each limit is a polynomial inequality in them and their
derivatives (see `constraints`). A route is represented in world axes, any other path in its moving basis. Every cell is
a dyadic part of a segment, so the change of variable to the cell is exact. Quantities that depend on the direction of
the path are computed from the factor q of r' (see `directions`), because q does not vanish where a segment starts or
ends at a stop.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.algebra.cells import enclose_minimum, semi_axes
from qtraj.algebra.chebyshev_model import NODES, ChebyshevModel, interpolated
from qtraj.design.proof.inequalities import PathDerivatives, path_derivatives, squared_bound
from qtraj.design.proof.road import in_units
from qtraj.design.timing.constraints import UPPER
from qtraj.design.timing.grid import Grid
from qtraj.design.timing.majorant import ELLIPSES, Majorant, from_model, to_model
from qtraj.design.timing.road import ROAD
from qtraj.design.timing.road_proof import road_bounds
from qtraj.design.timing.sources import Source
from qtraj.design.timing.timing_polynomials import of_timing, on_wide_ellipses, scaled
from qtraj.foundation.types import Scalar
from qtraj.path.components import cross, dot
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES
from qtraj.path.vehicle import RoadParameters

ORDERS = 3
"""The highest order of a derivative of the path in a limit."""
HIGHEST = 6
"""The highest multiplicity of a stop: up to six derivatives of a septic polynomial may vanish there."""


def enclosures(
    path: Source,
    grid: Grid,
    timing: tuple[Array, Array],
    given: dict[str, Array],
    vehicle: RoadParameters | None,
) -> Any:
    """Return a function that computes lower and upper bounds on the minima of all slacks and of a = u̇² in subcells.

    The bounds have the shape (limits + 1, subcells). At an end at rest, a is divided by its factor that vanishes there.
    """
    segments = path_derivatives(path.polynomials, path.durations, orders=ORDERS)
    segment, middle, size = (jnp.asarray(x) for x in (grid.segment, grid.middle, grid.half))
    shape = segments.derivatives
    ahead, factor = (None, None) if path.ahead is None else _directions(path.ahead, path.durations, segments.length)
    shape = _stacked(shape if ahead is None else [*shape, *ahead])
    a, rest = of_timing(*timing)
    of_a = _stacked([*(scaled(p, (1 / size) ** k) for k, p in enumerate(a)), rest])
    names = [name for name in given if name not in ROAD]
    units = {name: _unit(name, segments) for name in given}
    on_road = {name: given[name] for name in ROAD if name in given}
    if vehicle is not None:
        parameters = in_units(vehicle, segments.length, segments.unit)
        vehicle = RoadParameters(*(jnp.broadcast_to(x, segments.length.shape) for x in parameters))
    limits = {name: _squared(given[name], units[name]) for name in names}
    alone = path.durations.size == 1

    def of_segment(x: Array, own: Array) -> Array:
        return x if alone else x[..., own]

    def enclose(cell: Array, centre: Array, half: Array) -> tuple[Array, Array]:
        own, within = segment[cell], (centre[None], half[None])
        at = middle[cell] + centre * size[cell], half * size[cell]
        at = at[0][None], at[1][None]

        def chosen(tree: Any) -> Any:
            return jax.tree.map(lambda x: of_segment(x, own), tree)

        r, motion = _models(chosen(shape), at), _models(jax.tree.map(lambda x: x[..., cell], of_a), within)
        motion = [on_wide_ellipses(x) for x in motion]
        q, w = (r[:3], None) if factor is None else (r[3:], chosen(factor).on(*at))
        a, slope, bend, rest = (from_model(x)[0] for x in motion)
        path, ahead = ([from_model(x) for x in vectors] for vectors in (r[:3], q))
        cells = _Cells(path, ahead, None if w is None else from_model(w)[0], a, slope, bend)
        rows = [_slack(name, _limit(chosen(limits[name]) + 0.0 * half[None]), cells) for name in names]
        found = enclose_minimum(*interpolated(to_model([*rows, rest]), semi_axes(within[1])))
        if not on_road or vehicle is None:
            return found.low, found.high
        doubled, pace = 2 * (r[1] * motion[0]) + r[0] * motion[1], motion[0][0]
        pace = pace if w is None else w[0] * w[0] * pace
        given_units, vehicles = jax.tree.map(lambda x: of_segment(x, own) + 0.0 * half, (units, vehicle))
        more = road_bounds(on_road, given_units, vehicles, q[0], doubled, pace, within[1])
        low, high = (jnp.concatenate([x[:-1], y, x[-1:]]) for x, y in zip((found.low, found.high), more, strict=True))
        return low, high

    return enclose


def _squared(limit: Scalar, unit: Float[Array, " segments"]) -> Float[Array, "2 segments"]:
    """Return the square of a limit in the units of each segment, and its majorant."""
    square, rounding = squared_bound(limit, unit)
    return jnp.concatenate([square, jnp.where(jnp.isfinite(rounding), square, jnp.inf)])


def _limit(both: Float[Array, "2 subcells"]) -> Majorant:
    value, bound = both
    return Majorant(jnp.concatenate([jnp.broadcast_to(x, (n, x.size)) for x, n in ((value, NODES), (bound, ELLIPSES))]))


def _models(p: CellPolynomial, at: tuple[Array, Array]) -> list[ChebyshevModel]:
    """Return one model on the subcells `at` for each of the polynomials that are stacked on the first axis of `p`."""
    models = jax.vmap(lambda own: own.on(*at))(p)
    return [jax.tree.map(lambda x, k=k: x[k], models) for k in range(p.error.shape[0])]


def _stacked(polynomials: list[CellPolynomial]) -> CellPolynomial:
    """Return the polynomials on a new first axis, with coefficients up to the same degree."""
    count = max(p.coefficients.shape[1] for p in polynomials)

    def padded(p: CellPolynomial) -> CellPolynomial:
        more = count - p.coefficients.shape[1]
        rows = [(0, 0), (0, more), (0, 0), (0, 0)]
        return CellPolynomial(jnp.pad(p.coefficients, rows), jnp.pad(p.shifts, [(0, more), *rows]), p.error)

    return jax.tree.map(lambda *x: jnp.stack(x), *map(padded, polynomials))


def _directions(
    ahead: tuple[MovingPolynomials, Any, Any], durations: Array, length: Array
) -> tuple[list[CellPolynomial], CellPolynomial]:
    """Return the vector q (see `directions`) with two derivatives in each segment, and the factor w with r' = w·q.

    The unit of w is the ratio of the units of r' and q.
    """
    polynomials, powers, roundings = ahead
    found = path_derivatives(polynomials, durations, jnp.asarray(roundings)[None], ORDERS)
    table = np.zeros((HIGHEST + 1, HIGHEST + 1, 2 * HIGHEST + 1))  # (1 + s)^m (1 − s)^n
    for m in range(HIGHEST + 1):
        for n in range(HIGHEST + 1):
            rising, falling = (np.polynomial.polynomial.polypow([1.0, x], k) for x, k in ((1.0, m), (-1.0, n)))
            product = np.polynomial.polynomial.polymul(rising, falling)
            table[m, n, : product.size] = product
    m, n = (jnp.asarray(powers)[:, k] for k in range(2))
    factor = jnp.asarray(table)[m, n].T * (found.length / length)[None]  # lengths are powers of two
    w = cell_polynomial(factor[None, :, None], jnp.zeros_like(length)[None])
    return found.derivatives, w


def _unit(name: str, whole: PathDerivatives) -> Array:
    """Return the factor that makes the limit dimensionless."""
    return whole.unit ** QUANTITIES[name].per_time / whole.length ** QUANTITIES[name].length


class _Cells(NamedTuple):
    """Models on subcells; `path` contains the first three derivatives of the path. The unit of time is half a duration.

    `a` is u̇², and `slope` and `bend` are its first two derivatives with respect to the path parameter u. With
    r' = w·q, `ahead` contains q and its first two derivatives, and `factor` is w. Without stops q is r', and `factor`
    is None.
    """

    path: list[Any]
    ahead: list[Any]
    factor: Majorant | None
    a: Majorant
    slope: Majorant
    bend: Majorant


def _slack(name: str, bound: Majorant, c: _Cells) -> Majorant:
    """Return the slack of a limit: limit² · denominator − numerator, where `bound` is limit²."""
    real, i, a = Invariants([None, *c.path]), Invariants([None, *c.ahead]), c.a
    if name == "lateral_acceleration":
        across = cross(i.r[1], real.r[2])
        return bound * i.S - dot(across, across) * (a * a)
    if name in UPPER:
        entry, own = QUANTITIES[name], real if name == "speed" else i
        denominator = a.one() if entry.denominator is None else entry.denominator(own)
        return bound * denominator - entry.numerator(own) * a
    if name == "longitudinal_acceleration":
        slope = i.S * c.slope
        along = 2.0 * (dot(i.r[1], real.r[2]) * a) + (slope if c.factor is None else c.factor * slope)
        return bound * (4.0 * i.S) - along * along
    if name == "acceleration":
        double = tuple(2.0 * (p * a) + q * c.slope for p, q in zip(real.r[2], real.r[1], strict=True))
        return 4.0 * bound - dot(double, double)
    if name == "jerk":
        rows = zip(real.r[3], real.r[2], real.r[1], strict=True)
        double = tuple(2.0 * (p * a) + 3.0 * (q * c.slope) + x * c.bend for p, q, x in rows)
        return 4.0 * bound - a * dot(double, double)
    SH = i.S * i.H
    growth = i.P1 * SH - i.P * (i.B * i.H + i.S * i.G)
    turning = 2.0 * (growth * a) + (i.P * SH) * c.slope
    return 4.0 * (bound * (SH * (SH * SH))) - turning * turning
