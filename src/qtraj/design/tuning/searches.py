"""The data of a batch of searches, as NumPy arrays with the batch axis last, and the evaluation of their paths."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra.jets import Jet, coordinates, sqrt
from qtraj.algebra.polynomial import taylor_terms
from qtraj.design.timing.speed_ratio import WithSpeed
from qtraj.design.tuning import constraints
from qtraj.design.tuning.constraints import Place, Units
from qtraj.design.tuning.problem import Formulas, Problem, plain
from qtraj.design.tuning.zones import AnyZone
from qtraj.path.clearance_quantity import names_obstacle
from qtraj.path.frenet import Invariants

Batch = Float[np.ndarray, " batch"]
Points = Float[np.ndarray, "*batch points"]


@dataclass(frozen=True)
class Searches:
    """A batch of searches: problems, limits by name, and bounds on the variables.

    Limits that change along the way are divided into `zones`; a constraint has the index of its limit, or, after
    all limits, of its zone. With `weight` 0, a search minimises only the largest constraint value. `level` is true if
    the vertical is the third axis of all placements.
    """

    problem: Problem
    limits: dict[str, Batch]
    low: Float[np.ndarray, "n batch"]
    high: Float[np.ndarray, "n batch"]
    weight: Batch
    level: bool
    zones: tuple[AnyZone, ...] = ()

    @cached_property
    def formulas(self) -> Formulas:
        """The formulas of the problems."""
        return plain(self.problem)

    @property
    def count(self) -> int:
        """The number of searches."""
        return self.weight.size

    @cached_property
    def is_clearance(self) -> np.ndarray:
        """Whether each constraint, also those of zones, is about an obstacle."""
        return np.array([names_obstacle(name) for name in self.limits] + [False] * len(self.zones))

    def by_walls(self, name: str) -> bool:
        """Whether a constraint about an obstacle is about walls."""
        return self.formulas.clearances.by_name[name].obstacle.occupied_length  # type: ignore[union-attr]

    @property
    def order(self) -> int:
        """The highest order of derivatives in the limits."""
        return constraints.order_of(tuple(self.limits)) if self.limits else 0

    def take(self, index: Any) -> "Searches":
        """Return some of the searches."""
        problem = jax.tree.map(lambda x: x[index], self.problem)
        limits = {name: x[index] for name, x in self.limits.items()}
        bounds = self.low[:, index], self.high[:, index]
        zones = tuple(zone.take(index) for zone in self.zones)
        return Searches(problem, limits, *bounds, self.weight[index], self.level, zones)

    def units(self, z: Any) -> Units:
        """Return the data that turn invariants into constraint values, for the variables `z`."""
        return constraints.units(self.formulas, z, self.limits, self.level)


def taken(units: Units, index: Int[np.ndarray, " points"]) -> Units:
    """Return the data of the searches with the given indices."""
    road, up = units.road, units.up
    return Units(
        units.length[index],
        units.log_duration[index],
        None if up is None else (up[0][index], up[1][index], up[2][index]),
        None if road is None else road.each(lambda x: x[index]),
        tuple([c[index] for c in cubic] for cubic in units.reference),  # type: ignore[arg-type]
        {name: limit[index] for name, limit in units.limits.items()},
        units.clearances,
        None if units.axes is None else tuple(x[index] for x in units.axes),
        None if units.base is None else units.base[index],
    )


class Curves:
    """The paths of a batch of searches for given variables, as polynomials in u, the time divided by the duration."""

    def __init__(self, searches: Searches, z: Float[np.ndarray, "n batch"]):
        self.cubics = searches.formulas.cubics(z)
        self.units = searches.units(z)

    def at(self, owner: Int[np.ndarray, " points"]) -> "Curves":
        """Return the curves of the searches with the given indices, one for each point."""
        curves = object.__new__(Curves)
        curves.cubics = tuple([c[owner] for c in cubic] for cubic in self.cubics)  # type: ignore[assignment]
        curves.units = taken(self.units, owner)
        return curves

    def within(self, limits: dict[str, Points | WithSpeed]) -> "Curves":
        """Return the curves with other limits."""
        curves = object.__new__(Curves)
        curves.cubics, curves.units = self.cubics, self.units._replace(limits={**self.units.limits, **limits})
        return curves

    def speeds(self, u: Points) -> Points:
        """Return the speeds in metres per duration at the instants `u`."""
        i = constraints.invariants(constraints.place(self.cubics, u, 1), self.units._replace(road=None))
        return np.sqrt(i.S) * self.units.length

    def samples(self, u: Points, order: int) -> "Samples":
        """Return what formulas of up to an order of derivatives need at the instants `u`."""
        at = constraints.place(self.cubics, u, order)
        return Samples(self.units, u, at, constraints.invariants(at, self.units))

    def values(self, names: Sequence[str], u: Points, order: int) -> list[Points]:
        """Return the constraint values of some limits at the instants `u`."""
        samples = self.samples(u, order)
        return [samples.value(name) for name in names]

    def along_u(self, name: str, u: Points, order: int) -> tuple[Points, Points, Points]:
        """Return a constraint value and its first and second derivatives with respect to u."""
        series = constraints.place(self.cubics, u, order + 2)
        at = Place(*(_in_u(s, order) for s in series))
        zeros = np.zeros((1, 1, *u.shape))
        i = constraints.invariants(at, self.units)
        g = constraints.value(name, at, i, self.units, Jet(u, np.ones((1, *u.shape)), zeros))
        if not isinstance(g, Jet):
            return g, zeros[0, 0], zeros[0, 0]
        return g.value, g.gradient[0], g.hessian[0, 0]


class Samples(NamedTuple):
    """The Taylor coefficients and the invariants of a batch of paths at the instants `u`."""

    units: Units
    u: Points
    at: Place
    invariants: Invariants

    def value(self, name: str) -> Points:
        """Return the constraint values of a limit."""
        return constraints.value(name, self.at, self.invariants, self.units, self.u)

    def divisor(self, name: str) -> Points:
        """Return the squared speed S or, if the name is "cross_norm", the squared norm N of r'×r''."""
        return self.invariants.N if name == "cross_norm" else self.invariants.S


class CurveJets:
    """The paths of a batch of searches with their derivatives with respect to the variables."""

    def __init__(self, searches: Searches, z: Float[np.ndarray, "n batch"]):
        self.n = z.shape[0]
        self.cubics = searches.formulas.cubics(coordinates(z))
        self.units = searches.units(z)
        self.fixed_duration = searches.problem.objective.fixes_duration

    def expand(
        self, name: str, owner: Int[np.ndarray, " points"], u: Points, second: bool = True, limit: Any = None
    ) -> Jet:
        """Return a constraint value at points as jets in the variables and in u, the last variable.

        Without `second`, the jets are of first order and in the variables only. `limit` replaces the limit.
        """
        order, count = max(1, constraints.order_of((name,))), u.size
        m = self.n + second
        units = taken(self.units, owner)
        units = units if limit is None else units._replace(limits={**units.limits, name: limit})
        zeros = np.zeros((m, m, count)) if second else None
        expansion = _in_both if second else _in_variables
        at = Place(*(expansion([_gathered(c, owner) for c in cubic], u, order, self.n) for cubic in self.cubics))
        if not self.fixed_duration:
            units = units._replace(log_duration=Jet(units.log_duration, _unit(self.n - 1, m, count), zeros))
        instant = Jet(u, _unit(self.n, m, count), zeros) if second else u
        g = constraints.value(name, at, constraints.invariants(at, units), units, instant)
        return g if isinstance(g, Jet) else Jet(g, np.zeros((m, count)), zeros)

    def speeds(self, owner: Int[np.ndarray, " points"], u: Points) -> Jet:
        """Return the speeds in metres per duration as jets in the variables and in u, the last variable."""
        at = Place(*(_in_both([_gathered(c, owner) for c in cubic], u, 1, self.n) for cubic in self.cubics))
        units = taken(self.units, owner)._replace(road=None)
        return sqrt(constraints.invariants(at, units).S) * units.length


def _unit(k: int, size: int, count: int) -> np.ndarray:
    vector = np.zeros((size, count))
    vector[k] = 1.0
    return vector


def _gathered(c: Any, owner: np.ndarray) -> Any:
    """Return a number or jet of each of the searches; derivatives that are the same for all of them remain so."""
    if not isinstance(c, Jet):
        return c[owner]
    gradient = c.gradient if c.gradient.shape[-1] == 1 else c.gradient[:, owner]
    return Jet(c.value[owner], gradient, c.hessian if isinstance(c.hessian, int) else c.hessian[:, :, owner])


def _in_variables(cubic: Sequence[Any], u: Points, order: int, n: int) -> list[Any]:
    """Return the Taylor coefficients of a cubic as jets of first order in the n variables of its coefficients."""
    values = taylor_terms([c.value if isinstance(c, Jet) else c for c in cubic], u, order)
    gradients = taylor_terms([c.gradient if isinstance(c, Jet) else 0.0 for c in cubic], u, order)
    return [
        v if isinstance(d, int | float) else Jet(v, np.broadcast_to(d, (n, u.size)))
        for v, d in zip(values, gradients, strict=True)
    ]


def _in_u(series: Sequence[Any], order: int) -> list[Any]:
    """Return Taylor coefficients as jets in u, from coefficients of two more orders."""
    result = []
    for k in range(order + 1):
        value, first, second = series[k], (k + 1) * series[k + 1], (k + 1) * (k + 2) * series[k + 2]
        if isinstance(first, int):
            result.append(value)
            continue
        bend = np.zeros((1, 1, *value.shape)) if isinstance(second, int) else _full(second, value)[None, None]
        result.append(Jet(value, _full(first, value)[None], bend))
    return result


def _full(x: Any, like: np.ndarray) -> np.ndarray:
    return x if x.shape == like.shape else np.broadcast_to(x, like.shape)


def _in_both(cubic: Sequence[Any], u: Points, order: int, n: int) -> list[Any]:
    """Return the Taylor coefficients of a cubic whose coefficients are jets in n variables, as jets in these and u."""
    values = taylor_terms([c.value if isinstance(c, Jet) else c for c in cubic], u, order + 2)
    gradients = taylor_terms([c.gradient if isinstance(c, Jet) else 0.0 for c in cubic], u, order + 1)
    hessians = taylor_terms([c.hessian if isinstance(c, Jet) else 0.0 for c in cubic], u, order)
    result = []
    for k in range(order + 1):
        value, first, second = values[k], (k + 1) * values[k + 1], (k + 1) * (k + 2) * values[k + 2]
        if isinstance(value, int):
            result.append(0)
            continue
        value = np.broadcast_to(value, u.shape)
        gradient, hessian = np.zeros((n + 1, u.size)), np.zeros((n + 1, n + 1, u.size))
        gradient[:n], gradient[n] = gradients[k], first
        hessian[:n, :n], hessian[n, n] = hessians[k], second
        hessian[:n, n] = hessian[n, :n] = (k + 1) * gradients[k + 1]
        result.append(value if isinstance(first, int) and np.isscalar(gradients[k]) else Jet(value, gradient, hessian))
    return result


def searches_of(
    problem: Problem, limits: dict[str, Any], low: Any, high: Any, zones: tuple[AnyZone, ...] = ()
) -> Searches:
    """Return the searches of a batch of problems with leading batch axes, from concrete arrays."""
    problem, limits, low, high = jax.tree.map(
        lambda x: np.asarray(x, float) if np.asarray(x).dtype.kind == "f" else np.asarray(x),
        (problem, limits, low, high),
    )
    level = bool(np.all(problem.vertical == np.array([0.0, 0.0, 1.0])))
    return Searches(problem, limits, low.T, high.T, np.ones(len(low)), level, zones)
