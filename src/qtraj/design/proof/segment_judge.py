"""Judge segments of a route: by the first pass where it proves a limit, otherwise by the compiled branch and bound."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.design.proof import first_pass
from qtraj.design.proof.certificate import PROVED
from qtraj.design.proof.inequalities import PathDerivatives, Vectors, centred, path_derivatives
from qtraj.design.proof.judge import LIMIT_COUNT, LIMITS, Findings, Scale, indices, judge
from qtraj.foundation import cores
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.vehicle import RoadParameters

MAX_ORDER = 8
"""The highest order of a zero of the velocity for which forces are computed; in practice the order is lower."""

N_ROUNDINGS = 3
"""Number of rounding operations in each coefficient of Q, the integral of the direction q (see `route_segments`)."""

BLOCK_SIZE = 64
"""Number of segments that are processed together; their data fits into the processor's cache."""


class SegmentFindings(NamedTuple):
    """Status codes, times [s] since the start of the segment, and values, for each segment and limit."""

    codes: Int[np.ndarray, "segments limits"]
    times: Float[np.ndarray, "segments limits"]
    values: Float[np.ndarray, "segments limits"]


class Job(NamedTuple):
    """Segments to judge: their indices `rows` in the route, their coefficients, and whether each limit is `needed`.

    The derivative of `directions` replaces the velocity. The higher derivatives are also computed from `directions`,
    unless `keep_acceleration` is true. In this case they are computed from the coefficients `c`, and the velocity is
    u^k times the derivative of `directions`, where u is the time from the stop, and k is the element of `orders`.
    """

    rows: np.ndarray
    c: np.ndarray
    directions: np.ndarray
    keep_acceleration: bool
    orders: int | np.ndarray
    needed: Bool[np.ndarray, "rows limits"]


def judged(
    jobs: list[Job], h: np.ndarray, entries: list[PathQuantity], bounds: np.ndarray, road: RoadParameters | None
) -> list[SegmentFindings]:
    """Return each job's findings on the needed limits: by the first pass where it proves them, otherwise by `judge`."""
    c, directions = (np.concatenate([getattr(job, name) for job in jobs]) for name in ("c", "directions"))
    counts = [len(job.rows) for job in jobs]
    keep = np.repeat([job.keep_acceleration for job in jobs], counts)
    orders = np.concatenate([np.broadcast_to(job.orders, len(job.rows)) for job in jobs]) * keep
    h = np.concatenate([h[job.rows] for job in jobs])
    needed = np.concatenate([job.needed for job in jobs])
    result = SegmentFindings(*(np.zeros(needed.shape, dtype) for dtype in (int, float, float)))
    still_open = _first_pass(result, c, directions, h, keep, entries, bounds, needed)
    rows, columns = np.flatnonzero(still_open.any(axis=1)), np.flatnonzero(still_open.any(axis=0))
    if rows.size:
        segments = tuple(np.ascontiguousarray(x[rows]) for x in (c, directions, h, keep, orders))
        found = _by_blocks(segments, [entries[k] for k in columns], bounds[columns], road)
        for array, new in zip(result, found, strict=True):
            cells = np.ix_(rows, columns)
            array[cells] = np.where(still_open[cells], new, array[cells])
    ends = np.cumsum(counts)
    return [SegmentFindings(*(x[end - count : end] for x in result)) for end, count in zip(ends, counts, strict=True)]


def _first_pass(
    result: SegmentFindings,
    c: np.ndarray,
    directions: np.ndarray,
    h: np.ndarray,
    keep: np.ndarray,
    entries: list[PathQuantity],
    bounds: np.ndarray,
    needed: Bool[np.ndarray, "rows limits"],
) -> Bool[np.ndarray, "rows limits"]:
    """Store in `result` the findings on the limits that the first pass proves.

    Returns a mask of the limits that are not decided yet.
    """
    simple = np.array([k for k, entry in enumerate(entries) if first_pass.is_simple(entry)], int)
    still_open = needed.copy()
    if not simple.size:
        return still_open
    derivatives = first_pass.derivatives(c, directions, h, keep)
    proved = first_pass.proved(derivatives, [entries[k] for k in simple], bounds[simple], N_ROUNDINGS)
    for k, proved_rows in zip(simple, (proved & needed[:, simple]).T, strict=True):
        rows = np.flatnonzero(proved_rows)
        result.codes[rows, k] = PROVED
        result.values[rows, k], result.times[rows, k] = first_pass.largest(derivatives.rows(rows), entries[k])
        still_open[rows, k] = False
    return still_open


def _by_blocks(
    segments: tuple[np.ndarray, ...], entries: list[PathQuantity], bounds: np.ndarray, road: RoadParameters | None
) -> SegmentFindings:
    """Return the findings of the compiled branch and bound; `segments` is the first argument of `_compiled`."""
    count = len(segments[0])
    index, n_entries = indices(tuple(entry.name for entry in entries))
    by_name = {entry.name: bound for entry, bound in zip(entries, bounds, strict=True)}
    all_bounds = np.array([by_name.get(entry.name, 1.0) for entry in LIMITS])
    numbers = None if road is None else RoadParameters(*(np.asarray(x, float) for x in road))
    blocks = cores.split(np.arange(count), BLOCK_SIZE)
    calls = [(cores.take(segments, block, BLOCK_SIZE), all_bounds, numbers, index, n_entries) for block in blocks]
    found: Any = None
    for block, block_result in zip(blocks, cores.map_blocks(_compiled, calls), strict=True):
        found = cores.allocate(count, block_result) if found is None else found
        cores.put(found, block, block_result)
    columns = [k for k, entry in enumerate(LIMITS) if entry.name in by_name]
    return SegmentFindings(*(x[:, columns] for x in found))


@jax.jit
def _compiled(segments: Any, bounds: Array, road: RoadParameters | None, index: Array, count: Array) -> Findings:
    c, directions, h, keep, orders = segments
    path, direction = _derivatives(c, h), _derivatives(directions, h)
    pairs = zip(path.derivatives[1:], direction.derivatives[1:], strict=True)
    higher = [jax.tree.map(lambda a, b: jnp.where(keep, a, b), p, q) for p, q in pairs]
    length = jnp.where(keep, path.length, direction.length)
    pace = None if road is None else _pace(orders, direction.unit, direction.length / length)
    combined = PathDerivatives([direction.derivatives[0], *higher], length, direction.unit, pace)

    def evaluate(s: Array, order: int, upright: bool) -> Invariants:
        derivatives = [None, *(Vectors(*r.at(s)) for r in combined.derivatives[:order])]
        return Invariants(derivatives, pace=1 if pace is None else pace.at(s)[0])

    limits = jnp.broadcast_to(bounds[:, None], (LIMIT_COUNT, h.shape[0]))
    upright = jnp.ones(h.shape, bool)
    vehicle = None if road is None else RoadParameters(*(jnp.broadcast_to(x, h.shape) for x in road))
    result = judge(evaluate, Scale(combined.length, combined.unit), limits, upright, combined, index, count, vehicle)
    return jax.tree.map(lambda x: x[:LIMIT_COUNT].T, result)


def _pace(orders: Int[Array, " rows"], unit: Array, ratio: Array) -> CellPolynomial:
    """Return u^order times `ratio`, a ratio of two lengths, where u = unit·(s + 1) is the time from the stop [s]."""
    powers = jnp.arange(MAX_ORDER + 1, dtype=orders.dtype)[:, None]
    coefficients = jnp.where(powers == orders[None], ratio * unit ** orders.astype(unit.dtype), 0.0)
    c = centred(coefficients[:, None])[None]
    return cell_polynomial(c, 64 * float(jnp.finfo(c.dtype).eps) * jnp.sum(jnp.abs(c[0]), axis=0))


def _derivatives(c: Float[Array, "rows terms 3"], h: Float[Array, " rows"]) -> PathDerivatives:
    x, y, z = (c[:, :, k].T for k in range(3))
    # No limit depends on the initial position, and large coordinates would only increase the rounding errors.
    x, y = x.at[0].set(0.0), y.at[0].set(0.0)
    return path_derivatives(MovingPolynomials(x, y, z, jnp.zeros_like(x[:1])), h, N_ROUNDINGS)
