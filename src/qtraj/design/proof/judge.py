"""Judge limits on a batch of paths: prove or refute each limit, and find the largest value of its quantity.

A limit is decided for all paths at once in bounded floats; what remains open is decided in exact integers, one path at
a time. The largest values come from floats; no status of a provable limit depends on them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from qtraj.algebra import bernstein
from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.subdivision import MAX_WORK
from qtraj.design.proof import units
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.deciding import LITTLE_WORK, Decided, decided
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.guards import GuardFormulas, state_of
from qtraj.design.proof.limit_claims import (
    DIVISOR_ORDER,
    MIN_RELATIVE_DIVISOR,
    UPRIGHT_DIVISORS,
    Bound,
    Formulas,
    relative_sizes,
)
from qtraj.design.proof.maxima import find_maxima, sharp_minima
from qtraj.design.proof.sources import Derivatives, Source
from qtraj.design.proof.speed_maxima import compared_at, nearest_to_limit
from qtraj.foundation.namespace import xp
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.road_parameters import RoadParameters

GRID, FINE_GRID, FINEST_GRID = (np.linspace(0.0, 1.0, intervals + 1) for intervals in (96, 960, 1152))
"""The instants at which quantities are sampled. The first grid is for most quantities. Quantities with the divisor
|r' × r''| have narrow peaks, and need the second one. The last grid is for quantities that are only sampled."""


def judge(
    source: Source,
    limits: Sequence[Limit],
    vehicle: RoadParameters | None = None,
    window: Window | None = None,
    end: RoadParameters | None = None,
) -> Findings:
    """Return the findings on all `limits`; the parameters in `vehicle` are (n,), in SI units.

    With a `window`, the findings are on a part of each path, and the parameters are linear in it up to those at its
    `end`, if these are given; claims then take little work, because they are easier in smaller parts.
    """
    task = _Task(source, limits, vehicle, window, end)
    columns = [task.finding(limit) for limit in limits]
    return Findings(*(xp.stack(x, axis=1) for x in zip(*columns, strict=True)))


class _Task:
    """The shared data of the findings on one batch of paths."""

    def __init__(self, source: Source, limits: Sequence[Limit], vehicle: Any, window: Window | None, end: Any):
        entries = [limit.entry for limit in limits]
        positioned = any(x.position for x in entries)
        self.source = source.positioned() if positioned else source
        self.vehicle, self.window, self.end = vehicle, window, end
        self.work = MAX_WORK if end is None else LITTLE_WORK
        self.order = max([1, *(x.order for x in entries), *(DIVISOR_ORDER[x.divisor] for x in entries if x.divisor)])
        self.grid = FINE_GRID if any(x.divisor == "cross_norm" for x in entries) else GRID
        self._exact: dict[int, Formulas] = {}
        self._divisors: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._minima: dict[str, np.ndarray | None] = {}
        self._grids: dict[tuple[int, bool], Invariants] = {}

    def finding(self, limit: Limit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return codes, times and values of one limit."""
        entry, source, provable = limit.entry, self.source, self._provable(limit.entry)
        proved, refuted, hints = self._decided(limit, provable)
        at, values = self._largest(limit, hints if np.any(refuted) else None, provable)
        with np.errstate(invalid="ignore"):
            bounds = limit.at(at) if limit.by_speed is None else compared_at(self._at(at[None]), source, limit)[1][0]
            excess = entry.side * (values - bounds)
            if entry.tangent_of:  # the tangent of the limit is rounded to the strict side
                refuted = refuted & ~(excess <= 0)
            sampled = xp.where(excess <= 0, SAMPLED, xp.where(excess > 0, BROKEN, UNDECIDED))
        codes = xp.where(provable, np.where(proved, PROVED, np.where(refuted, BROKEN, UNDECIDED)), sampled)
        values = xp.where(proved & (excess > 0), bounds, values)
        for state, zero_at in self._states(entry, provable):
            codes = xp.where((state == UNDECIDED) & (codes != BROKEN), UNDECIDED, codes)
            undefined = state == UNDEFINED
            codes = xp.where(undefined, UNDEFINED, codes)
            at, values = xp.where(undefined, zero_at, at), xp.where(undefined, np.nan, values)
        return codes.astype(np.int32), self._fraction(at) * self.source.duration, values

    def _provable(self, entry: PathQuantity) -> np.ndarray:
        """Return for which paths limits on a quantity can be proved."""
        known = self.source.proves(entry) and (entry.own is None or entry.own.formula is not None)
        known = known and (self.source.in_world or not entry.about_axis(self.vehicle))
        return self.source.provable(entry.upright) & known

    def _states(self, entry: PathQuantity, provable: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Return the states of the divisors of a quantity, see `_divisor`."""
        if entry.divisor is not None:
            yield self._divisor(entry.divisor)
        if entry.own is None:
            return
        si, at = entry.own.in_si, partial(self._at, si=entry.own.in_si)
        bounded = lambda: self._si_bounded if si else self._bounded  # noqa: E731
        for guard in entry.own.guards:
            formulas = GuardFormulas(at, self._grid(provable), bounded, self._exact_formulas)
            yield state_of(guard, formulas, self.source, si, provable)

    def _decided(self, limit: Limit, wanted: np.ndarray) -> Decided:
        """Decide whether the quantity satisfies its limit."""
        entry, factors, bounds = limit.entry, limit.factors, limit.entry.strict_tangent(limit.bounds)
        curve = None if limit.curve is None else entry.strict_curve(limit.curve)
        si = _in_si(entry)
        length, per_time = (0, 0) if si else (entry.length, entry.per_time)

        def in_floats() -> Any:
            formulas = self._si_bounded if si else self._bounded
            if limit.by_speed is not None:
                constant = lambda x, n: self._in_floats(np.full(self.source.count, x), 1, n)  # noqa: E731
                return formulas and formulas.within(entry, Bound(limit.by_speed, None, constant))
            factor = None if entry.factor is None else self._in_floats(factors, 0, 0)
            bound = self._in_floats(bounds, length, per_time)
            if curve is not None:
                bound = bernstein.in_floats((curve.T * self._per_unit(length, per_time)).T, k=12)
            return None if formulas is None else formulas.within(entry, Bound(bound, factor))

        def in_integers(k: int) -> Any:
            formulas = self._exact_formulas(k)
            unit = units.unit_of_time(self.source, formulas.span, k)
            if limit.by_speed is not None:
                constant = lambda x, n: units.times_power(ExactPolynomial.of(x), unit, n)  # noqa: E731
                return formulas.within(entry, Bound(limit.by_speed, None, constant))
            bound = ExactPolynomial.of(bounds[k])
            if curve is not None:
                bound = bernstein.in_integers(curve[k])
            bound = units.times_power(bound, unit, per_time)
            factor = None if entry.factor is None else ExactPolynomial.of(factors[k])
            return formulas.within(entry, Bound(bound, factor))

        if not np.any(wanted):
            nothing = np.zeros(wanted.shape, bool)
            return Decided(nothing, nothing, np.zeros(wanted.shape))
        found = decided(
            wanted & np.isfinite(limit.bounds) & np.isfinite(factors), in_floats, in_integers, max_work=self.work
        )
        found.proved[wanted & (entry.side * limit.bounds == np.inf)] = True  # there is no limit
        return found

    def _divisor(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the state of a divisor (PROVED positive, UNDECIDED or UNDEFINED), and the instant of its minimum."""
        if name not in self._divisors:
            provable = self.source.provable(name in UPRIGHT_DIVISORS)
            fastest = lambda: BoundedPolynomial.constant(self._fastest)  # noqa: E731
            floats = lambda: self._bounded and self._bounded.divisor(name, fastest())  # noqa: E731
            integers = lambda k: self._exact_formulas(k).divisor(name, self._fastest_in_integers(k))  # noqa: E731
            found = decided(provable, floats, integers, True, self.work)
            self._divisors[name] = np.full(provable.shape, PROVED), np.zeros(provable.shape)
            if not np.all(found.proved):
                self._divisors[name] = self._zero(name, provable, found)
        return self._divisors[name]

    def _zero(self, name: str, provable: np.ndarray, found: Decided) -> tuple[np.ndarray, np.ndarray]:
        """Return the result of `_divisor` for divisors of which some are not proved positive."""
        grid, function = self._grid(provable), lambda u: -self._sizes(name, u)
        at, negative_size = find_maxima(
            function, grid, function(grid), found.at[None] if np.any(found.refuted) else None
        )
        zero = found.refuted | (xp.sqrt(xp.maximum(-negative_size, 0.0)) < MIN_RELATIVE_DIVISOR)
        rest = np.where(provable, UNDECIDED, PROVED)
        return xp.where(found.proved, PROVED, xp.where(zero, UNDEFINED, rest)), at

    @cached_property
    def _bounded(self) -> Formulas | None:
        """The formulas in bounded floats, for all paths."""
        with np.errstate(all="ignore"):
            return self._formulas_of(self.source.bounded(self.order), self._scaled_vehicle)

    @cached_property
    def _si_bounded(self) -> Formulas | None:
        """The same in SI units."""
        with np.errstate(all="ignore"):
            found = self.source.bounded(self.order)
            return self._formulas_of(None if found is None else units.bounded_in_si(found, self.source), self.vehicle)

    def _formulas_of(self, derivatives: Derivatives | None, vehicle: RoadParameters | None) -> Formulas | None:
        polynomial = lambda x: BoundedPolynomial.constant(x, k=6)  # noqa: E731
        known = None if vehicle is None else units.constants(vehicle, polynomial, self.end, self._fractions)
        constant = lambda x: BoundedPolynomial.constant(np.full(self.source.count, units.as_number(x)), k=1)  # noqa: E731
        return None if derivatives is None else Formulas(derivatives, constant, known, self.window)

    @property
    def _fractions(self) -> BoundedPolynomial:
        """The fraction of the window, as a polynomial for each path."""
        return BoundedPolynomial(np.repeat([[0.0], [1.0]], self.source.count, axis=1))

    def _in_floats(self, x: np.ndarray, length: int, per_time: int) -> BoundedPolynomial:
        return BoundedPolynomial.constant(x * self._per_unit(length, per_time), k=12)

    def _per_unit(self, length: int, per_time: int) -> np.ndarray:
        return self.source.duration**per_time / self.source.length**length

    def _exact_formulas(self, k: int) -> Formulas:
        """Return the formulas in exact integers for path k."""
        if k not in self._exact:
            derivatives, vehicle = self.source.exact(k, self.order), None
            if self.vehicle is not None:
                start, end = self.vehicle.each(lambda x: x[k]), self.end and self.end.each(lambda x: x[k])
                vehicle = units.constants(start, ExactPolynomial.of, end, ExactPolynomial([0, 1]))
                unit = units.unit_of_time(self.source, derivatives.span, k)
                vehicle = vehicle._replace(gravity=units.times_power(vehicle.gravity, unit, 2))
            window = None if self.window is None else [float(x[k]) for x in self.window]
            self._exact[k] = Formulas(derivatives, ExactPolynomial.of, vehicle, window)
        return self._exact[k]

    @cached_property
    def _scaled_vehicle(self) -> RoadParameters | None:
        """The parameters of the vehicle in the units of `source`."""
        return None if self.vehicle is None else units.scaled_vehicle(self.vehicle, self.source)

    def _largest(self, limit: Limit, hints: np.ndarray | None, provable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the instant and the largest value of a quantity, or the smallest for a lower bound, in SI units.

        For a limit that changes, it is the value that exceeds the limit most.
        """
        entry, source, grid = limit.entry, self.source, self._grid(provable)
        if limit.by_speed is not None:
            return nearest_to_limit(self._at, grid, source, limit, hints)
        si = _in_si(entry)
        unit = limit.factors * (1.0 if si else source.length**entry.length / source.duration**entry.per_time)

        def limit_at(u: np.ndarray) -> Any:
            return 0.0 if limit.curve is None else limit.at(u if u.ndim > 1 else u[:, None]) / unit

        def function(u: np.ndarray) -> np.ndarray:
            with np.errstate(all="ignore"):
                found = entry.side * (entry.value(self._at(u, si)) - limit_at(u))
                return xp.broadcast_to(found, (len(u), source.count))

        known = [x for x in (None if hints is None else hints[None], self._small(entry.divisor, grid)) if x is not None]
        at, values = find_maxima(function, grid, function(grid), np.concatenate(known) if known else None)
        with np.errstate(all="ignore"):
            return at, (entry.side * values + (0.0 if limit.curve is None else limit.at(at) / unit)) * unit

    def _small(self, divisor: str | None, grid: np.ndarray) -> np.ndarray | None:
        """Return the instants of the smallest values of a divisor, where a quantity may have narrow peaks, if any."""
        if divisor is None:
            return None
        if divisor not in self._minima:
            self._minima[divisor] = sharp_minima(lambda u: self._sizes(divisor, u), grid)
        return self._minima[divisor]

    def _grid(self, provable: np.ndarray) -> np.ndarray:
        return self.grid if np.all(provable) else FINEST_GRID

    def _at(self, u: np.ndarray, si: bool = False) -> Invariants:
        """Return the invariants at instants (k, n), or on a grid (k,), for which they are computed only once."""
        if u.ndim == 1:
            return self._on_grid(len(u), si)
        found, vehicle = self.source.at(self._fraction(u), self.order), self._scaled_vehicle
        if si:
            found, vehicle = units.values_in_si(found, self.source), self.vehicle
        return Invariants(found.rows, found.up, units.vehicle_at(vehicle, self.end, u), root=_root, pace=found.pace)

    def _fraction(self, u: np.ndarray) -> np.ndarray:
        return u if self.window is None else self.window.at(u)

    def _on_grid(self, count: int, si: bool) -> Invariants:
        if (count, si) not in self._grids:
            u = np.linspace(0.0, 1.0, count)
            self._grids[count, si] = self._at(np.repeat(u[:, None], self.source.count, axis=1), si)
        return self._grids[count, si]

    @cached_property
    def _fastest(self) -> np.ndarray:
        """The largest squared speed at the instants of the grid, in the units of `source`."""
        with np.errstate(all="ignore"):
            return xp.max(self._at(self._grid(self.source.provable(False))).S, axis=0)

    def _fastest_in_integers(self, k: int) -> ExactPolynomial:
        return units.times_power(ExactPolynomial.of(self._fastest[k]), self.source.length[k], 2)

    def _sizes(self, name: str, u: np.ndarray) -> np.ndarray:
        """Return the squared relative size of a divisor."""
        with np.errstate(all="ignore"):
            return relative_sizes(name, self._at(u), self._fastest)


def _root(x: Any) -> Any:
    return xp.sqrt(xp.maximum(x, 0.0))


def _in_si(entry: PathQuantity) -> bool:
    return entry.own is not None and entry.own.in_si
