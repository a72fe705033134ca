"""Prove that a retimed path satisfies its limits on every cell.

Each limit is a polynomial inequality on a cell (see `cell_claims`). It is decided in floats with error bounds, for many
cells at once, and where these are not precise enough in exact integers (see `proof.deciding`).
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.algebra import bernstein
from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.ellipse import OfSpeed
from qtraj.design.on_host import on_host
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED
from qtraj.design.proof.deciding import Decided, decided
from qtraj.design.proof.units import constants, times_power
from qtraj.design.timing.cell_claims import THIRD, CellClaims
from qtraj.design.timing.cell_motions import CellMotions
from qtraj.design.timing.constraints import all_names
from qtraj.design.timing.formula_limits import of_third_order
from qtraj.design.timing.grid import Grid
from qtraj.design.timing.road import POWER_SIDES, ROAD
from qtraj.design.timing.roots import Enclosure, enclosure
from qtraj.design.timing.sided import SIDES_OF_RATES, SLOWEST
from qtraj.design.timing.sources import Source
from qtraj.path.path_quantity import LOAD
from qtraj.path.quantity import quantity
from qtraj.path.road_parameters import RoadParameters

BLOCK_SIZE = 2048
"""Number of cells that are judged together; their data fits into the processor's cache."""

MAX_WORK = 400_000
"""Number of additions of integers after which a limit is undecided on a cell; they take about a tenth of a second."""

MORE_WORK = 4_000_000
"""The same for limits that depend on the speed, whose polynomials have high degrees next to stops."""

PATIENCE = 8
"""Number of cells with an undecided limit after which the limit is not proved anyway, and other cells get less work."""

PerCell = Float[Any, "n *terms"]
"""A limit in each cell, or its Bernstein coefficients there; two of them are the values at both ends of a line."""


class Proofs(NamedTuple):
    """For each limit, in the order of `all_names`, the status PROVED, BROKEN or UNDECIDED on each cell."""

    codes: Int[Any, "limits cells"]

    def whole(self) -> Int[Any, " limits"]:
        """Return the status on all cells together."""
        codes = np.asarray(self.codes)
        broken, proved = np.any(codes == BROKEN, axis=1), np.all(codes == PROVED, axis=1)
        return np.where(broken, BROKEN, np.where(proved, PROVED, UNDECIDED)).astype(np.int32)


def prove(
    path: Source,
    grid: Grid,
    timing: tuple[Float[Any, "cells 4"], Bool[Any, "2 *cells"]],
    bounds: Mapping[str, Any],
    vehicle: RoadParameters | None = None,
    place: Float[np.ndarray, "2 cells"] | None = None,
    end: RoadParameters | None = None,
    max_work: int = MAX_WORK,
) -> Proofs:
    """Return the status of each limit on each cell; PROVED requires a proof of a > 0, where a = u̇².

    `timing` contains the coefficients of a in each cell, and whether a is zero at the start and at the end. A limit may
    have Bernstein coefficients in each cell. A limit that is not in `bounds` gets the status of a > 0. An infinite
    limit is PROVED if a > 0 is proved, otherwise UNDECIDED. Without a `vehicle`, limits on friction and power are
    treated as if they were not in `bounds`.

    The parameters of the `vehicle` may be those at the starts of the cells, and linear up to those at their `end`.

    A claim in integers may take at most `max_work` additions.

    The cells may be dyadic parts of the cells of a timing: `place` contains their starts and ends as fractions of the
    cells to which the coefficients belong, and the second item of `timing` has a column for each part.
    """
    rows = all_names(bounds)
    known = [name for name in rows if vehicle is not None or name not in ROAD]
    by_speed = {name: x for name, x in bounds.items() if isinstance(x, OfSpeed)}
    names = tuple(name for name in known if name in bounds and name not in by_speed)
    rest = np.asarray(timing[1])

    def judge(*given: Any) -> Int[Any, "batch limits cells"]:
        *position, durations, powers, limits, road = given
        numbers: dict[str, Any] = dict(zip(names, limits, strict=True))
        return _judged(
            path.directions, grid, (rest, place), position, durations, powers, (numbers, by_speed), road, max_work
        )

    given = *path[:5], timing[0], [bounds[name] for name in names], (vehicle, end)
    shape = jax.ShapeDtypeStruct((len(rows), grid.cells), jnp.int32)
    return Proofs(on_host(judge, shape, *given))


def _judged(
    directions: Any,
    grid: Grid,
    ends: tuple[Bool[Any, "2 *cells"], Float[np.ndarray, "2 cells"] | None],
    position: list[np.ndarray | None],
    durations: Float[Any, "batch segments"],
    powers: Float[Any, "batch cells 4"],
    bounds: tuple[dict[str, PerCell], dict[str, OfSpeed]],
    road: tuple[RoadParameters | None, RoadParameters | None],
    max_work: int,
) -> Int[Any, "batch limits cells"]:
    """Return the statuses for a batch of paths; all cells of the batch are judged as cells of one path.

    `ends` are the flags of ends at rest and the places of the cells (see `prove`).
    """
    batch, cells = powers.shape[:2]
    rest, place = ends

    def of_cells(x: np.ndarray) -> np.ndarray:
        """Return the coefficients (terms, batch·cells) from those of the segments (batch, terms, segments)."""
        return np.moveaxis(x[..., grid.segment], 0, -2).reshape(*x.shape[1:-1], batch * cells)

    at_rest = np.zeros((2, batch, cells), bool)
    if rest.ndim == 1:
        at_rest[0, :, 0], at_rest[1, :, -1] = rest
    else:
        at_rest[:] = rest[:, None]
    first, half, segment = (np.tile(x, batch) for x in (0.5 * (1 + grid.middle - grid.half), grid.half, grid.segment))
    columns = tuple(None if x is None else of_cells(x) for x in position)
    timing, at_rest = powers.reshape(-1, 4).T, at_rest.reshape(2, -1)
    place = None if place is None else np.tile(place, batch)
    motions = CellMotions(columns, of_cells(durations), first, half, timing, at_rest, segment, directions, place)
    limits, by_speed = bounds
    each = {name: np.repeat(x, cells) if x.ndim == 1 else x.reshape(-1, x.shape[-1]) for name, x in limits.items()}
    ways = [x and x.each(lambda y: np.repeat(y, cells) if y.ndim == 1 else y.reshape(-1)) for x in road]
    names = all_names(limits)
    codes = np.zeros((len(names), batch * cells), np.int32)
    for group in (motions.standing, ~motions.standing):
        every = np.flatnonzero(group)
        for start in range(0, every.size, BLOCK_SIZE):
            block = every[start : start + BLOCK_SIZE]
            own = [x and x.each(lambda y, block=block: y[block]) for x in ways]
            task = _Task(motions.chosen(block), {name: x[block] for name, x in each.items()}, own, max_work)
            codes[:, block] = _codes(task, by_speed)
    return np.moveaxis(codes.reshape(len(names), batch, cells), 1, 0)


def _codes(task: "_Task", by_speed: dict[str, OfSpeed]) -> Int[Any, "limits n"]:
    finite = np.isfinite(task.motions.timing).all(axis=0)
    forward = task.decided(finite, lambda claims, _: claims.forward(), strict=True).proved
    names = all_names(task.limits)
    rows, positive = [np.where(forward, PROVED, UNDECIDED)] * len(names), {None: forward, LOAD: forward}

    def defined(name: str) -> Bool[Any, " n"]:
        """Return where the quantity is proved to be defined and the motion to go on."""
        if (divisor := quantity(name).divisor) not in positive:
            own = task.decided(finite, lambda claims, _: claims.divisor(divisor), strict=True)
            positive[divisor] = forward & own.proved
        return positive[divisor]

    for name, limit in task.limits.items():
        entry = quantity(name)
        strictest = limit if limit.ndim == 1 else entry.side * np.min(entry.side * limit, axis=1)
        absent = np.isinf(strictest) | ((name == SLOWEST) & (strictest <= 0))
        found = _within(task, name, strictest, finite & np.isfinite(strictest) & ~absent)
        proved = (defined(name) & task.satisfied_guards(name, finite) & found.proved) | (forward & absent)
        rows[names.index(name)] = np.where(found.refuted, BROKEN, np.where(proved, PROVED, UNDECIDED))
    for name, limit in by_speed.items():
        found = task.by_speed(finite & bool(np.isfinite(np.asarray(limit.values)).all()), name, limit)
        proved = defined(name) & found.proved
        rows[names.index(name)] = np.where(found.refuted, BROKEN, np.where(proved, PROVED, UNDECIDED))
    return np.stack(rows)


def _within(task: "_Task", name: str, limit: Float[Any, " n"], wanted: Bool[Any, " n"]) -> Decided:
    """Decide whether a quantity satisfies its limit."""
    allows_zero = np.ones(limit.shape, bool)
    if name in (*SIDES_OF_RATES, *POWER_SIDES):
        allows_zero = quantity(name).side * limit > 0
    found = [
        task.decided(wanted & own, lambda claims, bound, allows=allows: claims.within(name, bound(name), allows))
        for own, allows in ((allows_zero, True), (~allows_zero, False))
        if own.any()
    ]
    return Decided(*(np.where(allows_zero, x[0], x[-1]) for x in zip(*found, strict=True)))


class _Task:
    """The claims about a block of cells, in bounded floats and, for single cells, in exact integers."""

    def __init__(self, motions: CellMotions, limits: dict[str, PerCell], road: list[RoadParameters | None], work: int):
        self.motions, self.limits, (self._road, self._end), self._max_work = motions, limits, road, work
        third = set(THIRD) & {quantity(name).base or name for name in limits} or of_third_order(limits)
        self._order = 3 if third else 2
        self._unit = motions.duration * motions.half  # the unit of time of the claims; the product is exact
        self._floats: CellClaims | None = None
        self._roots: list[Enclosure] = []
        self._speed_roots: list[Enclosure] = []
        self._integers: dict[int, CellClaims] = {}

    def decided(self, wanted: Bool[Any, " n"], claim: Callable[..., Any], strict: bool = False) -> Decided:
        """Decide a claim, which is a function of the claims about the motions, and of a function of a limit's name."""
        return decided(
            wanted,
            lambda: claim(self._in_floats(), self._float_limit),
            lambda k: claim(self._in_integers(k), lambda name: self._exact_limit(name, k)),
            strict,
            self._max_work,
            PATIENCE,
        )

    def satisfied_guards(self, name: str, wanted: Bool[Any, " n"]) -> Bool[Any, " n"]:
        """Return where the divisors of an own quantity are proved to be nonzero, and the radicands nonnegative."""
        entry, found = quantity(name), wanted
        for guard in entry.own.guards if entry.own else ():
            signs = (1,) if not guard.divisor or guard.factor.positive else (1, -1)
            each = [
                self.decided(found, lambda claims, _, x=guard, s=s: claims.own.guard(entry, x, s), guard.divisor).proved
                for s in signs
            ]
            found = found & np.any(each, axis=0)
        return found

    def by_speed(self, wanted: Bool[Any, " n"], name: str, limit: OfSpeed) -> Decided:
        """Decide whether a quantity satisfies a limit that depends on the speed."""

        def in_floats(x: float, per_time: int) -> BoundedPolynomial:
            return BoundedPolynomial.constant(x * self._unit**per_time, k=2 * per_time + 1)

        def floats() -> AnyClaim:
            claims = self._in_floats()
            if claims.speed_roots is None:
                squares = claims.speed_squares()
                self._speed_roots = [enclosure(p.c) for p in squares]
                claims.speed_roots = [root.bounded(p) for root, p in zip(self._speed_roots, squares, strict=True)]
            return claims.within_speed(name, limit, in_floats)

        def exact(k: int, by_roots: bool) -> AnyClaim:
            claims, constant = self._in_integers(k), lambda x, n: times_power(ExactPolynomial.of(x), self._unit[k], n)
            claims.speed_roots = None
            if by_roots and self._speed_roots and all(root.good[k] for root in self._speed_roots):
                squares = zip(self._speed_roots, claims.speed_squares(), strict=True)
                claims.speed_roots = [root.exact(p, k) for root, p in squares]
            return claims.within_speed(name, limit, constant)

        found = decided(wanted, floats, lambda k: exact(k, True), False, MORE_WORK, PATIENCE)
        enclosed = np.all([root.good for root in self._speed_roots], axis=0) if self._speed_roots else False
        rest = wanted & enclosed & ~(found.proved | found.refuted)  # nearer to a limit than the enclosures are wide
        more = decided(rest, lambda: None, lambda k: exact(k, False), False, MORE_WORK, PATIENCE)
        return Decided(found.proved | more.proved, found.refuted | more.refuted, found.at)

    def _in_floats(self) -> CellClaims:
        if self._floats is None:
            vehicle = None
            if self._road is not None:
                road = self._road._replace(gravity=self._road.gravity * self._unit**2)
                fraction = BoundedPolynomial(np.repeat([[0.0], [1.0]], len(road.mass), axis=1))
                vehicle = constants(road, lambda x: BoundedPolynomial.constant(x, k=3), self._end, fraction)
            self._floats = CellClaims(self.motions.bounded(self._order), vehicle, self._float_constant)
            if self._road is not None:
                squares = self._floats.squares()
                self._roots = [enclosure(p.c) for p in squares]
                self._floats.roots = [root.bounded(p) for root, p in zip(self._roots, squares, strict=True)]
        return self._floats

    def _in_integers(self, k: int) -> CellClaims:
        if k not in self._integers:
            vehicle = None
            if self._road is not None:
                start, end = self._road.each(lambda x: x[k]), self._end and self._end.each(lambda x: x[k])
                vehicle = constants(start, ExactPolynomial.of, end, ExactPolynomial([0, 1]))
                vehicle = vehicle._replace(gravity=times_power(vehicle.gravity, self._unit[k], 2))
            own = self._integers[k] = CellClaims(self.motions.exact(k, self._order), vehicle, ExactPolynomial.of)
            if self._roots and all(root.good[k] for root in self._roots):
                own.roots = [root.exact(p, k) for root, p in zip(self._roots, own.squares(), strict=True)]
        return self._integers[k]

    def _float_constant(self, x: Any) -> BoundedPolynomial:
        return BoundedPolynomial.constant(np.full(self._unit.shape, float(x)))

    def _float_limit(self, name: str) -> BoundedPolynomial:
        per_time, limit = quantity(name).per_time, self.limits[name]
        if limit.ndim == 1:
            return BoundedPolynomial.constant(limit * self._unit**per_time, k=2 * per_time + 1)
        return bernstein.in_floats((limit.T * self._unit**per_time).T, k=2 * per_time + 1)

    def _exact_limit(self, name: str, k: int) -> ExactPolynomial:
        limit = bernstein.in_integers(np.atleast_1d(self.limits[name][k]))
        return times_power(limit, self._unit[k], quantity(name).per_time)
