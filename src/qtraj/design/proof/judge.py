"""Judge limits on a batch of paths: prove or refute each limit, and find the largest value of its quantity.

A limit is decided for all paths at once in bounded floats; what remains open is decided in exact integers, one path at
a time. The largest values come from floats; no status of a provable limit depends on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.deciding import Decided, decided
from qtraj.design.proof.limit_claims import DIVISOR_ORDER, UPRIGHT_DIVISORS, Bound, Formulas
from qtraj.design.proof.maxima import find_maxima
from qtraj.design.proof.sources import Source
from qtraj.foundation.namespace import xp
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import LOAD, PathQuantity
from qtraj.path.regularity import DEFINED_TOLERANCE, regularity
from qtraj.path.vehicle import RoadParameters

MIN_RELATIVE_DIVISOR = 1e-9
"""A divisor that is not proved positive counts as zero if its relative size is below this value."""

NEGLIGIBLE_DIVISOR = DEFINED_TOLERANCE * float(np.finfo(float).eps)
"""A divisor counts as zero if its relative size is below this value, as for the trihedron, even if it is positive."""

GRIDS = {True: np.linspace(0.0, 1.0, 193), False: np.linspace(0.0, 1.0, 1153)}
"""The instants at which quantities are sampled, with and without a proof.

The first grid includes the ends of all intervals into which `bounded.decide` divides a path.
"""

FEW = 12
"""Number of intervals of the grid on which the size of a divisor that is proved positive is sampled."""


class Limit(NamedTuple):
    """A limit on one quantity: its value and the factor of the quantity (see `PathQuantity.factor`) for each path."""

    entry: PathQuantity
    bounds: Float[np.ndarray, " n"]
    factors: Float[np.ndarray, " n"]


class Findings(NamedTuple):
    """Status codes, times [s] and values for each path and limit."""

    codes: Int[np.ndarray, "n limits"]
    times: Float[np.ndarray, "n limits"]
    values: Float[np.ndarray, "n limits"]


def judge(
    source: Source,
    limits: Sequence[Limit],
    vehicle: RoadParameters | None = None,
) -> Findings:
    """Return the findings on all `limits`; the parameters in `vehicle` are (n,), in SI units."""
    task = _Task(source, limits, vehicle)
    columns = [task.finding(limit) for limit in limits]
    return Findings(*(xp.stack(x, axis=1) for x in zip(*columns, strict=True)))


class _Task:
    """The shared data of the findings on one batch of paths."""

    def __init__(self, source: Source, limits: Sequence[Limit], vehicle: RoadParameters | None):
        self.source, self.vehicle = source, vehicle
        entries = [limit.entry for limit in limits]
        self.order = max([1, *(x.order for x in entries), *(DIVISOR_ORDER[x.divisor] for x in entries if x.divisor)])
        self._exact: dict[int, Formulas] = {}
        self._divisors: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._grids: dict[int, Invariants] = {}

    def finding(self, limit: Limit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return codes, times and values of one limit."""
        entry = limit.entry
        provable = self.source.provable(entry.upright)
        proved, refuted, hints = self._decided(limit, provable)
        at, values = self._largest(limit, hints if np.any(refuted) else None, provable)
        with np.errstate(invalid="ignore"):
            sampled = xp.where(values <= limit.bounds, SAMPLED, xp.where(values > limit.bounds, BROKEN, UNDECIDED))
        codes = xp.where(provable, np.where(proved, PROVED, np.where(refuted, BROKEN, UNDECIDED)), sampled)
        values = xp.where(proved, xp.minimum(values, limit.bounds), values)
        if entry.divisor is not None:
            state, zero_at = self._divisor(entry.divisor)
            codes = xp.where((state == UNDECIDED) & (codes != BROKEN), UNDECIDED, codes)
            undefined = state == UNDEFINED
            codes = xp.where(undefined, UNDEFINED, codes)
            at, values = xp.where(undefined, zero_at, at), xp.where(undefined, np.nan, values)
        return codes.astype(np.int32), at * self.source.duration, values

    def _decided(self, limit: Limit, wanted: np.ndarray) -> Decided:
        """Decide whether the quantity does not exceed its limit."""
        entry, factors = limit.entry, limit.factors

        def in_floats() -> Any:
            factor = None if entry.factor is None else self._in_floats(factors, 0, 0)
            bound = Bound(self._in_floats(limit.bounds, entry.length, entry.per_time), factor)
            return None if self._bounded is None else self._bounded.within(entry, bound)

        def in_integers(k: int) -> Any:
            bound = _times_power(ExactPolynomial.of(limit.bounds[k]), self.source.duration[k], entry.per_time)
            factor = None if entry.factor is None else ExactPolynomial.of(factors[k])
            return self._exact_formulas(k).within(entry, Bound(bound, factor))

        if not np.any(wanted):
            return Decided(*2 * [np.zeros(wanted.shape, bool)], np.zeros(wanted.shape))
        return decided(wanted & np.isfinite(limit.bounds) & np.isfinite(factors), in_floats, in_integers)

    def _divisor(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the state of a divisor (PROVED positive, UNDECIDED or UNDEFINED), and the instant of its minimum."""
        if name not in self._divisors:
            provable = self.source.provable(name in UPRIGHT_DIVISORS)
            positive = decided(
                provable,
                lambda: None if self._bounded is None else self._bounded.divisor(name),
                lambda k: self._exact_formulas(k).divisor(name),
                strict=True,
            ).proved
            grid, function = self._grid(provable), lambda u: -self._sizes(name, u)
            if np.all(positive):  # only a path along which the divisor is negligible is of interest
                samples = function(grid[:: (len(grid) - 1) // FEW])
                at, negative_size = grid[:: (len(grid) - 1) // FEW][samples.argmax(axis=0)], samples.max(axis=0)
            else:
                at, negative_size = find_maxima(function, grid, function(grid))
            size = xp.sqrt(xp.maximum(-negative_size, 0.0))
            least = np.where(positive, NEGLIGIBLE_DIVISOR, MIN_RELATIVE_DIVISOR)
            rest = np.where(provable & ~positive, UNDECIDED, PROVED)
            self._divisors[name] = xp.where(size < least, UNDEFINED, rest), at
        return self._divisors[name]

    @cached_property
    def _bounded(self) -> Formulas | None:
        """The formulas in bounded floats, for all paths."""
        with np.errstate(all="ignore"):
            derivatives, vehicle = self.source.bounded(self.order), None
            if self.vehicle is not None:
                vehicle = _constants(self._scaled_vehicle, lambda x: BoundedPolynomial.constant(x, k=6))
        return None if derivatives is None else Formulas(derivatives, vehicle)

    def _in_floats(self, x: np.ndarray, length: int, per_time: int) -> BoundedPolynomial:
        source = self.source
        return BoundedPolynomial.constant(x * source.duration**per_time / source.length**length, k=12)

    def _exact_formulas(self, k: int) -> Formulas:
        """Return the formulas in exact integers for path k."""
        if k not in self._exact:
            vehicle = None
            if self.vehicle is not None:
                vehicle = _constants(RoadParameters(*(x[k] for x in self.vehicle)), ExactPolynomial.of)
                vehicle = vehicle._replace(gravity=_times_power(vehicle.gravity, self.source.duration[k], 2))
            self._exact[k] = Formulas(self.source.exact(k, self.order), vehicle)
        return self._exact[k]

    @cached_property
    def _scaled_vehicle(self) -> RoadParameters:
        """The parameters of the vehicle in the units of `source`."""
        vehicle: Any = self.vehicle
        h, length = self.source.duration, self.source.length
        return vehicle._replace(gravity=vehicle.gravity * h * h / length, drag=vehicle.drag * length)

    def _largest(self, limit: Limit, hints: np.ndarray, provable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the instant and the largest value of a quantity, in SI units."""
        entry, source, grid = limit.entry, self.source, self._grid(provable)

        def function(u: np.ndarray) -> np.ndarray:
            with np.errstate(all="ignore"):
                return xp.broadcast_to(entry.value(self._at(u)), (len(u), source.count))

        at, values = find_maxima(function, grid, function(grid), hints)
        with np.errstate(all="ignore"):
            return at, limit.factors * values * source.length**entry.length / source.duration**entry.per_time

    def _grid(self, provable: np.ndarray) -> np.ndarray:
        return GRIDS[bool(np.all(provable))]

    def _at(self, u: np.ndarray) -> Invariants:
        """Return the invariants at instants (k, n), or on a grid (k,), for which they are computed only once."""
        if u.ndim == 1:
            return self._on_grid(len(u))
        found, vehicle = self.source.at(u, self.order), None if self.vehicle is None else self._scaled_vehicle
        return Invariants(found.rows, found.up, vehicle, root=_root, pace=found.pace)

    def _on_grid(self, count: int) -> Invariants:
        if count not in self._grids:
            u = np.linspace(0.0, 1.0, count)
            self._grids[count] = self._at(np.repeat(u[:, None], self.source.count, axis=1))
        return self._grids[count]

    def _sizes(self, name: str, u: np.ndarray) -> np.ndarray:
        """Return the squared relative size of a divisor."""
        with np.errstate(all="ignore"):
            i = self._at(u)
            if name != LOAD:
                return getattr(regularity(i, np.ones(())), name)
            p, load = i.vehicle, xp.maximum(i.contact.onto, 0.0)
            largest = 2 * (i.A + p.gravity * p.gravity) * (i.S * i.H)
            return xp.where(largest > 0, load * load / xp.where(largest > 0, largest, 1.0), 0.0)


def _times_power(x: Any, base: float, exponent: int) -> Any:
    """Return x·base^exponent, exactly."""
    factor = ExactPolynomial.of(base)
    for _ in range(exponent):
        x = x * factor
    return x


def _root(x: Any) -> Any:
    return xp.sqrt(xp.maximum(x, 0.0))


def _constants(vehicle: RoadParameters, constant: Any) -> RoadParameters:
    """Return the parameters as constant polynomials; a parameter that is 0 or 1 for all paths is that integer."""

    def of(x: np.ndarray) -> Any:
        return int(np.ravel(x)[0]) if np.all(x == 0) or np.all(x == 1) else constant(x)

    return RoadParameters(*(of(np.asarray(x, float)) for x in vehicle))
