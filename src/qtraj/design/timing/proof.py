"""Prove that a retimed path satisfies its limits on every cell.

Each limit is a polynomial inequality on a cell (see `slacks`). A cell in which an inequality is neither proved nor
violated is halved, until it is small.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED
from qtraj.design.proof.inequalities import power_of_two
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.grid import Grid
from qtraj.design.timing.road import ROAD
from qtraj.design.timing.slacks import enclosures
from qtraj.design.timing.sources import Source
from qtraj.foundation.types import Scalar
from qtraj.path.quantity import QUANTITIES
from qtraj.path.vehicle import RoadParameters

WIDEST, NARROWEST, ROUNDS = 1 / 8, 2.0**-9, 256
"""Subcells: largest half-width relative to the segment, smallest relative to the cell; maximum number of rounds."""


class Proofs(eqx.Module):
    """For each limit, in the order of `NAMES`, the status PROVED, BROKEN or UNDECIDED on each cell."""

    codes: Int[Array, "limits cells"]

    def whole(self) -> Int[Array, " limits"]:
        """Return the status on all cells together."""
        broken, proved = jnp.any(self.codes == BROKEN, axis=1), jnp.all(self.codes == PROVED, axis=1)
        return jnp.where(broken, BROKEN, jnp.where(proved, PROVED, UNDECIDED)).astype(jnp.int32)


class _Queue(NamedTuple):
    """A ring buffer of subcells: the interval `centre` ± `half` in the coordinate [−1, 1] of `cell`.

    The entries from `head` to `tail` − 1, modulo the capacity, are still to be examined. `rows` is a mask of the
    inequalities to prove in a subcell: the limits, and a > 0, where a = u̇². The other fields are the results so far.
    """

    cell: Int[Array, " capacity"]
    centre: Float[Array, " capacity"]
    half: Float[Array, " capacity"]
    rows: Bool[Array, "rows capacity"]
    head: Int[Array, ""]
    tail: Int[Array, ""]
    broken: Bool[Array, "rows cells"]
    undecided: Bool[Array, "rows cells"]
    rounds: Int[Array, ""]


@eqx.filter_jit
def prove(
    path: Source,
    grid: Grid,
    timing: tuple[Float[Array, "cells 4"], Bool[Any, " 2"]],
    bounds: dict[str, Scalar],
    vehicle: RoadParameters | None = None,
) -> Proofs:
    """Return the status of each limit on each cell; PROVED requires a proof of a > 0, where a = u̇².

    `timing` contains the coefficients of a in each cell, and whether a is zero at the start and at the end. A limit
    that is not in `bounds` gets the status of a > 0. An infinite limit is PROVED if a > 0 is proved, otherwise
    UNDECIDED. No code is compiled for limits that are not in `bounds`. Without a `vehicle`, limits on friction and
    power are treated as limits that are not in `bounds`.
    """
    known = NAMES if vehicle is not None else NAMES[: -len(ROAD)]
    names = tuple(name for name in known if name in bounds)
    size, given = jnp.asarray(grid.half), jnp.stack([bounds[name] for name in names])
    wanted = jnp.append(jnp.isfinite(given), True)[:, None]
    finite = dict(zip(names, jnp.where(wanted[:-1, 0], given, 1.0), strict=True))
    enclose = enclosures(path, grid, *_in_unit_of_time(timing, finite, vehicle))
    width, capacity = max(grid.cells // 4, 16), 8 * grid.cells

    def examine(q: _Queue) -> _Queue:
        """Examine the first subcells of the queue, and append the halves of those that remain undecided."""
        ahead = q.head + jnp.arange(width, dtype=jnp.int32)
        at = ahead % capacity
        cell, centre, half = (x[at] for x in q[:3])
        low, high = enclose(cell, centre, half)
        small = half * size[cell] <= WIDEST
        considered = q.rows[:, at] & (ahead < q.tail)[None]
        broken = q.broken.at[:, cell].max(considered & (high < 0) & small[None])
        unproved = considered & ~((low > 0) & small[None]) & ~(broken | q.undecided)[:, cell]
        divided, head = jnp.any(unproved, axis=0), jnp.minimum(q.head + width, q.tail)
        place = q.tail + 2 * (jnp.cumsum(divided, dtype=jnp.int32) - 1)
        last = divided & ((half <= NARROWEST) | (place + 2 - head > capacity))
        undecided = q.undecided.at[:, cell].max(unproved & last[None])
        divided &= ~last
        place = q.tail + 2 * (jnp.cumsum(divided, dtype=jnp.int32) - 1)
        both = jnp.concatenate([jnp.where(divided, k, capacity) for k in (place % capacity, (place + 1) % capacity)])
        centres, halves = jnp.concatenate([centre - 0.5 * half, centre + 0.5 * half]), jnp.tile(0.5 * half, 2)
        return _Queue(
            q.cell.at[both].set(jnp.tile(cell, 2), mode="drop"),
            q.centre.at[both].set(centres, mode="drop"),
            q.half.at[both].set(halves, mode="drop"),
            q.rows.at[:, both].set(jnp.tile(unproved, (1, 2)), mode="drop"),
            head,
            q.tail + 2 * jnp.sum(divided, dtype=jnp.int32),
            broken,
            undecided,
            q.rounds + 1,
        )

    start = _whole_cells(wanted, grid.cells, capacity, size.dtype)
    found = jax.lax.while_loop(lambda q: (q.head < q.tail) & (q.rounds < ROUNDS), examine, start)
    place = jnp.arange(capacity, dtype=jnp.int32)
    left = found.rows & ((place - found.head) % capacity < found.tail - found.head)[None]
    undecided = found.undecided.at[:, found.cell].max(left)
    codes = jnp.where(found.broken, BROKEN, jnp.where(undecided, UNDECIDED, PROVED)).astype(jnp.int32)
    own = jnp.where((codes[-1:] == PROVED) | (codes[:-1] == BROKEN), codes[:-1], UNDECIDED)
    return Proofs(jnp.stack([own[names.index(name)] if name in names else codes[-1] for name in NAMES]))


def _in_unit_of_time(
    timing: tuple[Array, Any], bounds: dict[str, Scalar], vehicle: RoadParameters | None
) -> tuple[tuple[Array, Any], dict[str, Scalar], RoadParameters | None]:
    """Return timing, limits and vehicle in a unit of time in which a = u̇² is about 1.

    The unit is a power of two, so the change is exact. Otherwise a tiny a would be less than the smallest majorant.
    """
    powers, rest = timing
    per_unit = power_of_two(jnp.sqrt(jnp.max(jnp.abs(powers))))
    square = per_unit * per_unit
    limits = {name: bound / per_unit ** QUANTITIES[name].per_time for name, bound in bounds.items()}
    if vehicle is not None:
        vehicle = vehicle._replace(gravity=vehicle.gravity / square)
    return (powers / square, rest), limits, vehicle


def _whole_cells(wanted: Bool[Array, "rows 1"], cells: int, capacity: int, dtype: Any) -> _Queue:
    """Return the queue of all cells."""
    none, zero = jnp.zeros((wanted.shape[0], cells), bool), jnp.zeros((), jnp.int32)
    cell, rows = jnp.arange(capacity, dtype=jnp.int32) % cells, jnp.broadcast_to(wanted, (wanted.shape[0], capacity))
    ends = zero, jnp.asarray(cells, jnp.int32)
    return _Queue(cell, jnp.zeros(capacity, dtype), jnp.ones(capacity, dtype), rows, *ends, none, none, zero)
