"""Judge limits on a batch of paths: prove or refute each limit, and find the largest value of its quantity.

A limit is decided for all paths at once in bounded floats; what remains open is decided in exact integers, one path at
a time. The largest values come from floats; no status of a provable limit depends on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.sparse import is_one
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.deciding import Decided, decided
from qtraj.design.proof.exact_units import times_power
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.limit_claims import (
    DIVISOR_ORDER,
    MIN_RELATIVE_DIVISOR,
    UPRIGHT_DIVISORS,
    Bound,
    Formulas,
    sizes,
)
from qtraj.design.proof.maxima import find_maxima, local_maxima
from qtraj.design.proof.sources import Source
from qtraj.design.proof.speed_maxima import compared_at, nearest_to_limit
from qtraj.foundation.namespace import xp
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import LOAD
from qtraj.path.vehicle import RoadParameters

GRID, FINE_GRID, FINEST_GRID = (np.linspace(0.0, 1.0, intervals + 1) for intervals in (96, 960, 1152))
"""The instants at which quantities are sampled.

The first grid is for most quantities. Quantities with the divisor |r' × r''| have narrow peaks, and need the second
one. The last grid is for quantities that are only sampled.
"""

SHARP = 1e-3
"""If a squared divisor is somewhere below this fraction of its largest value, narrow peaks are sought at its minima."""


def judge(
    source: Source,
    limits: Sequence[Limit],
    vehicle: RoadParameters | None = None,
    window: Window | None = None,
) -> Findings:
    """Return the findings on all `limits`; the parameters in `vehicle` are (n,), in SI units.

    With a `window`, the findings are on a part of each path.
    """
    task = _Task(source, limits, vehicle, window)
    columns = [task.finding(limit) for limit in limits]
    return Findings(*(xp.stack(x, axis=1) for x in zip(*columns, strict=True)))


class _Task:
    """The shared data of the findings on one batch of paths."""

    def __init__(self, source: Source, limits: Sequence[Limit], vehicle: RoadParameters | None, window: Window | None):
        self.source, self.vehicle, self.window = source, vehicle, window
        entries = [limit.entry for limit in limits]
        self.order = max([1, *(x.order for x in entries), *(DIVISOR_ORDER[x.divisor] for x in entries if x.divisor)])
        self.grid = FINE_GRID if any(x.divisor == "cross_norm" for x in entries) else GRID
        self._exact: dict[int, Formulas] = {}
        self._divisors: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._minima: dict[str, np.ndarray | None] = {}
        self._grids: dict[int, Invariants] = {}

    def finding(self, limit: Limit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return codes, times and values of one limit."""
        entry, source = limit.entry, self.source
        provable = self.source.provable(entry.upright)
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
        if entry.divisor is not None:
            state, zero_at = self._divisor(entry.divisor)
            codes = xp.where((state == UNDECIDED) & (codes != BROKEN), UNDECIDED, codes)
            undefined = state == UNDEFINED
            codes = xp.where(undefined, UNDEFINED, codes)
            at, values = xp.where(undefined, zero_at, at), xp.where(undefined, np.nan, values)
        return codes.astype(np.int32), self._fraction(at) * self.source.duration, values

    def _decided(self, limit: Limit, wanted: np.ndarray) -> Decided:
        """Decide whether the quantity satisfies its limit."""
        entry, factors, bounds = limit.entry, limit.factors, limit.entry.strict_tangent(limit.bounds)

        def in_floats() -> Any:
            if limit.by_speed is not None:
                constant = lambda x, n: self._in_floats(np.full(self.source.count, x), 1, n)  # noqa: E731
                return self._bounded and self._bounded.within(entry, Bound(limit.by_speed, None, constant))
            factor = None if entry.factor is None else self._in_floats(factors, 0, 0)
            bound = self._in_floats(bounds, entry.length, entry.per_time)
            if limit.line is not None:
                start, end = (self._in_floats(x, entry.length, entry.per_time) for x in limit.line.T)
                bound = start + (end - start) * self._fractions
            return None if self._bounded is None else self._bounded.within(entry, Bound(bound, factor))

        def in_integers(k: int) -> Any:
            formulas = self._exact_formulas(k)
            if limit.by_speed is not None:
                unit = self._unit(formulas.span, k)
                constant = lambda x, n: times_power(ExactPolynomial.of(x), unit, n)  # noqa: E731
                return formulas.within(entry, Bound(limit.by_speed, None, constant))
            bound = ExactPolynomial.of(bounds[k])
            if limit.line is not None:
                start, end = map(ExactPolynomial.of, limit.line[k])
                bound = start + (end - start) * ExactPolynomial([0, 1])
            bound = times_power(bound, self._unit(formulas.span, k), entry.per_time)
            factor = None if entry.factor is None else ExactPolynomial.of(factors[k])
            return formulas.within(entry, Bound(bound, factor))

        if not np.any(wanted):
            nothing = np.zeros(wanted.shape, bool)
            return Decided(nothing, nothing, np.zeros(wanted.shape))
        found = decided(wanted & np.isfinite(limit.bounds) & np.isfinite(factors), in_floats, in_integers)
        found.proved[wanted & (entry.side * limit.bounds == np.inf)] = True  # there is no limit
        return found

    def _divisor(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the state of a divisor (PROVED positive, UNDECIDED or UNDEFINED), and the instant of its minimum."""
        if name not in self._divisors:
            provable = self.source.provable(name in UPRIGHT_DIVISORS)
            found = decided(
                provable,
                lambda: None if self._bounded is None else self._bounded.divisor(name, self._fastest_in_floats()),
                lambda k: self._exact_formulas(k).divisor(name, self._fastest_in_integers(k)),
                strict=True,
            )
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
            derivatives, vehicle = self.source.bounded(self.order), None
            if self.vehicle is not None:
                vehicle = _constants(self._scaled_vehicle, lambda x: BoundedPolynomial.constant(x, k=6))
        constant = lambda x: BoundedPolynomial.constant(np.full(self.source.count, x), k=1)  # noqa: E731
        return None if derivatives is None else Formulas(derivatives, constant, vehicle, self.window)

    @property
    def _fractions(self) -> BoundedPolynomial:
        """The fraction of the window, as a polynomial for each path."""
        return BoundedPolynomial(np.repeat([[0.0], [1.0]], self.source.count, axis=1))

    def _in_floats(self, x: np.ndarray, length: int, per_time: int) -> BoundedPolynomial:
        source = self.source
        return BoundedPolynomial.constant(x * source.duration**per_time / source.length**length, k=12)

    def _exact_formulas(self, k: int) -> Formulas:
        """Return the formulas in exact integers for path k."""
        if k not in self._exact:
            derivatives, vehicle = self.source.exact(k, self.order), None
            if self.vehicle is not None:
                vehicle = _constants(RoadParameters(*(x[k] for x in self.vehicle)), ExactPolynomial.of)
                unit = self._unit(derivatives.span, k)
                vehicle = vehicle._replace(gravity=times_power(vehicle.gravity, unit, 2))
            window = None if self.window is None else [float(x[k]) for x in self.window]
            self._exact[k] = Formulas(derivatives, ExactPolynomial.of, vehicle, window)
        return self._exact[k]

    def _unit(self, span: Any, k: int) -> float:
        """Return the unit of time [s] of the derivatives of path k, whose variable runs from 0 to `span`."""
        return float(self.source.duration[k]) if is_one(span) else 1.0

    @cached_property
    def _scaled_vehicle(self) -> RoadParameters:
        """The parameters of the vehicle in the units of `source`."""
        vehicle: Any = self.vehicle
        h, length = self.source.duration, self.source.length
        return vehicle._replace(
            gravity=vehicle.gravity * h * h / length, drag=vehicle.drag * length, wheelbase=vehicle.wheelbase / length
        )

    def _largest(self, limit: Limit, hints: np.ndarray | None, provable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the instant and the largest value of a quantity, or the smallest for a lower bound, in SI units.

        For a linear limit, it is the value that exceeds the limit most.
        """
        entry, source, grid = limit.entry, self.source, self._grid(provable)
        unit = limit.factors * source.length**entry.length / source.duration**entry.per_time

        if limit.by_speed is not None:
            return nearest_to_limit(self._at, grid, source, limit, hints)

        def limit_at(u: np.ndarray) -> Any:
            return 0.0 if limit.line is None else limit.at(u if u.ndim > 1 else u[:, None]) / unit

        def function(u: np.ndarray) -> np.ndarray:
            with np.errstate(all="ignore"):
                found = entry.side * (entry.value(self._at(u)) - limit_at(u))
                return xp.broadcast_to(found, (len(u), source.count))

        known = [x for x in (None if hints is None else hints[None], self._small(entry.divisor, grid)) if x is not None]
        at, values = find_maxima(function, grid, function(grid), np.concatenate(known) if known else None)
        with np.errstate(all="ignore"):
            return at, (entry.side * values + (0.0 if limit.line is None else limit.at(at) / unit)) * unit

    def _small(self, divisor: str | None, grid: np.ndarray) -> np.ndarray | None:
        """Return the instants of the smallest values of a divisor, where a quantity may have narrow peaks, if any."""
        if divisor is None:
            return None
        if divisor not in self._minima:
            sizes = self._sizes(divisor, grid)
            sharp = np.min(sizes, axis=0) < SHARP * np.max(sizes, axis=0)
            minima = local_maxima(lambda u: -self._sizes(divisor, u), grid, -sizes) if np.any(sharp) else None
            self._minima[divisor] = minima
        return self._minima[divisor]

    def _grid(self, provable: np.ndarray) -> np.ndarray:
        return self.grid if np.all(provable) else FINEST_GRID

    def _at(self, u: np.ndarray) -> Invariants:
        """Return the invariants at instants (k, n), or on a grid (k,), for which they are computed only once."""
        if u.ndim == 1:
            return self._on_grid(len(u))
        found, vehicle = (
            self.source.at(self._fraction(u), self.order),
            None if self.vehicle is None else self._scaled_vehicle,
        )
        return Invariants(found.rows, found.up, vehicle, root=_root, pace=found.pace)

    def _fraction(self, u: np.ndarray) -> np.ndarray:
        """Return the fractions of the duration at the fractions `u` of the window."""
        return u if self.window is None else self.window.at(u)

    def _on_grid(self, count: int) -> Invariants:
        if count not in self._grids:
            u = np.linspace(0.0, 1.0, count)
            self._grids[count] = self._at(np.repeat(u[:, None], self.source.count, axis=1))
        return self._grids[count]

    @cached_property
    def _fastest(self) -> np.ndarray:
        """The largest squared speed at the instants of the grid, in the units of `source`."""
        with np.errstate(all="ignore"):
            return xp.max(self._at(self._grid(self.source.provable(False))).S, axis=0)

    def _fastest_in_floats(self) -> BoundedPolynomial:
        return BoundedPolynomial.constant(self._fastest)

    def _fastest_in_integers(self, k: int) -> ExactPolynomial:
        return times_power(ExactPolynomial.of(self._fastest[k]), self.source.length[k], 2)

    def _sizes(self, name: str, u: np.ndarray) -> np.ndarray:
        """Return the squared relative size of a divisor."""
        with np.errstate(all="ignore"):
            i = self._at(u)
            if name != LOAD:
                square, scale = sizes(name, i, self._fastest)
                return xp.where(scale > 0, square / xp.where(scale > 0, scale, 1.0), 0.0)
            p, load = i.vehicle, xp.maximum(i.contact.onto, 0.0)
            largest = 2 * (i.A + p.gravity * p.gravity) * (i.S * i.H)
            return xp.where(largest > 0, load * load / xp.where(largest > 0, largest, 1.0), 0.0)


def _root(x: Any) -> Any:
    return xp.sqrt(xp.maximum(x, 0.0))


def _constants(vehicle: RoadParameters, constant: Any) -> RoadParameters:
    """Return the parameters as constant polynomials; a parameter that is 0 or 1 for all paths is that integer."""

    def of(x: np.ndarray) -> Any:
        return int(np.ravel(x)[0]) if np.all(x == 0) or np.all(x == 1) else constant(x)

    return RoadParameters(*(of(np.asarray(x, float)) for x in vehicle))
