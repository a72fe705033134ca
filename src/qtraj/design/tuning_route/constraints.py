"""Express the limits and the tube as constraints at the nodes of each segment, with their derivatives.

The constraint for a limit is (value/limit)² ≤ margin. The margin (at most 1) accounts for larger values between the
nodes. For one side of a signed value, it is value/limit ≤ margin, and for a lower bound on a quantity that is never
negative (limit/value)² ≤ margin. Limits on the height and a least load are shifted (see `scales`). The tube bounds
both distances from the original path, horizontally and vertically, at equal fractions of a segment.

The limits are formulas of r', r'' and r''', the derivatives of the path with respect to u = t/h. The square of a
quantity is proportional to h⁻²ᵖ, where p is the power of 1/s in its unit, which gives its derivatives with respect to
the duration h. In the unit of time h, gravity is g h². Formulas with it and limits by speed also depend on h.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.algebra.jets import coordinates, sqrt
from qtraj.design.timing.speed_ratio import SpeedEllipse, WithSpeed, value_of
from qtraj.design.tuning_route import basis, cleared
from qtraj.design.tuning_route.problem import RouteProblem, Segments, joined
from qtraj.design.tuning_route.scales import LEAST_LOAD
from qtraj.foundation.namespace import matmul, xp
from qtraj.path.clearance_quantity import names_obstacle
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import quantity
from qtraj.path.road_parameters import RoadParameters


def order_of(names: tuple[str, ...]) -> int:
    """Return the highest order of the derivatives of the path in the limits, at least 1."""
    return max([1, *(quantity(name).order for name in names)])


def time_powers(names: tuple[str, ...]) -> Float[np.ndarray, " limits"]:
    """Return an exponent q for each limit; the constraint is proportional to h^−q, with the duration h."""
    return np.array([_power(name) * quantity(name).per_time for name in names])


def _power(name: str) -> float:
    """Return the exponent of value/limit in a constraint."""
    return 1.0 if quantity(name).signed is not None else -2.0 if quantity(name).lower else 2.0


def relative(
    names: tuple[str, ...],
    values: Float[np.ndarray, "limits n"],
    bounds: Float[np.ndarray, "limits n"],
    shifts: Float[np.ndarray, " limits"] | None = None,
) -> Any:
    """Return the square roots of the constraints for values of the quantities; `shifts` are those of the problem.

    A value on the other side of zero than the limit counts as zero. For an obstacle, the result is about 1 plus the
    depth [m] to which the body enters.
    """
    found = np.empty(values.shape)
    for k, name in enumerate(names):
        if names_obstacle(name):
            found[k] = 1.0 + np.maximum(-values[k], 0.0)
            continue
        entry = quantity(name)
        side, shift = entry.side if entry.bounds_side else 1, 0.0 if shifts is None else shifts[k]
        limit = entry.side * bounds[k] + shift if shift else np.abs(bounds[k])
        ratio = (side * np.asarray(entry.tangent(values[k])) + shift) / np.asarray(entry.tangent(limit))
        found[k] = np.maximum(ratio, 0.0) ** (0.5 * _power(name))
    return found


def units(problem: RouteProblem, h: Float[Any, " n"], nodes: int) -> Float[Any, "limits _ n"]:
    """Return the factors that convert the constraints of quantities of r(u) to those of the motion."""
    powers = np.array([_power(name) for name in problem.names])
    squares = problem.squares[:, None, None]
    if problem.local is not None:
        squares = problem.local if nodes == problem.local.shape[1] else problem.local[:, :: basis.FINER]
    times = h[None] ** -time_powers(problem.names)[:, None]
    return times[:, None] * squares ** (-0.5 * powers)[:, None, None]


def ratios(problem: RouteProblem, names: tuple[str, ...], r: Any, h: Any = None) -> list[Any]:
    """Return the square in the constraint of each limit for the derivatives r', r'', … in the array or list `r`.

    The components of each derivative follow each other. They are arrays or jets. `h` is the duration, which only some
    limits need (see `RouteProblem.on_duration`).
    """
    vehicle, road, shifts = None, road_at(problem, value_of(r[0]).shape[0]), problem.shifts
    if road is not None:
        vehicle = (own := RoadParameters(*road))._replace(gravity=h * h * own.gravity)
    rows = [(r[k], r[k + 1], r[k + 2]) for k in range(0, len(r), 3)]
    i = Invariants([*[None] * problem.first, *rows], None, vehicle, root=sqrt)
    by_speed = problem.by_speed or [None] * len(names)
    return [
        _ratio(quantity(name), i, 0.0 if shifts is None else shifts[k], by_speed[k], h) for k, name in enumerate(names)
    ]


def contain_position(names: tuple[str, ...]) -> bool:
    """Return whether the constraint of one of these limits contains the position."""
    return any(names_obstacle(name) or quantity(name).position for name in names)


def _ratio(entry: PathQuantity, i: Invariants, shift: Any, by_speed: WithSpeed | None, h: Any) -> Any:
    if by_speed is not None:
        return _ratio_by_speed(entry, i, by_speed, h)
    above, below = entry.numerator(i), 1.0 if entry.denominator is None else entry.denominator(i)
    if entry.signed is not None:  # the ratio is a signed value, not a square
        return entry.side * above / below + (shift * (h * h) if entry.name == LEAST_LOAD else shift)
    return below / above if entry.lower else above / below


def _ratio_by_speed(entry: PathQuantity, i: Invariants, limit: WithSpeed, h: Any) -> Any:
    per_time = 1.0 / (h * h)
    if isinstance(limit, SpeedEllipse):
        return limit.square(i, i.S * per_time) * (per_time * per_time)
    found, most = _ratio(entry, i, 0.0, None, h), limit.at(i.S * per_time)
    return found / most if entry.signed is not None else found / (most * most)


def road_at(problem: RouteProblem, nodes: int) -> Any:
    """Return the parameters of the vehicle and its road at the nodes, or None if no limit depends on them."""
    if problem.road is None or nodes == problem.road.shape[1]:
        return problem.road
    return problem.road[:, :: basis.FINER]


def derivatives(problem: RouteProblem, ends: Float[Any, "6 3 n"], fine: bool = False) -> Float[Any, "q nodes n"]:
    """Return the derivatives with respect to u at the nodes, component by component; the first may be r."""
    order = order_of(problem.names)
    rows = basis.rows(order + 1 - problem.first, problem.first, fine, problem.dense)
    found = matmul(rows.reshape(-1, 6), ends.reshape(6, -1)).reshape(len(rows), rows.shape[1], 3, -1)
    found = xp.moveaxis(found, 2, 1).reshape(3 * len(rows), rows.shape[1], -1)
    if not problem.first:
        found = xp.concatenate([found[:3] + problem.origins[:, None], found[3:]])
    return found


def in_time(r: Float[Any, "q nodes n"], rates: Float[Any, "3 nodes n"], first: int = 1) -> Float[Any, "q nodes n"]:
    """Convert derivatives of curves with respect to u to those with respect to the time, in units of the duration.

    `rates` are the derivatives of the progress (see `curves.rates`).
    """
    matrix = _chain_rule(rates, len(r) // 3, first)
    rows = r.reshape(-1, 3, *r.shape[1:])
    return xp.concatenate([sum(m[None] * row for m, row in zip(own, rows, strict=False)) for own in matrix])


def _chain_rule(rates: Any, count: int, lowest: int) -> list[list[Any]]:
    """Return the factors of the derivatives with respect to u in those with respect to the time, row by row."""
    first, second, third = rates
    rows = [[first], [second, first**2], [third, 3 * first * second, first**3]]
    if not lowest:
        rows = [[1.0 + 0.0 * first], *([0.0 * first, *row] for row in rows)]
    return rows[:count]


def displacements(change: Float[Any, "6 3 n"], fine: bool = False, dense: bool = False) -> Float[Any, "3 nodes n"]:
    """Return the displacements at the nodes for changes of the scaled end states."""
    rows = basis.table(0, fine, dense)[0]
    return xp.moveaxis(matmul(rows, change.reshape(6, -1)).reshape(len(rows), 3, -1), 1, 0)


def near(away: Float[Any, "3 nodes n"], tube: Float[Any, "2 nodes n"]) -> Float[Any, "2 nodes n"]:
    """Return the squares of the horizontal and the vertical distance, relative to the half-widths of the tube."""
    return xp.stack([away[0] ** 2 + away[1] ** 2, away[2] ** 2]) / tube


def values(problem: RouteProblem, s: Segments, fine: bool = False, parts: Any = None) -> Float[Any, "_ nodes n"]:
    """Return the squares of all limited quantities and of both distances, relative to their bounds.

    `parts` are the indices and the problems of the groups of segments; by default they are computed.
    """
    parts = [(k, problem.part(k)) for k in problem.groups()] if parts is None else parts
    return joined(problem, [_values(part, s.part(k), fine) for k, part in parts], [k for k, _ in parts])


def _values(problem: RouteProblem, s: Segments, fine: bool) -> Float[Any, "constraints nodes n"]:
    offset, tube = (problem.fine_offset, problem.fine_tube) if fine else (problem.offset, problem.tube)
    inside = near(displacements(s.change, fine, problem.dense) + offset, tube)
    if not problem.names:
        return inside
    r = derivatives(problem, s.ends, fine)
    if problem.dense:
        r = in_time(r, problem.fine_rates if fine else problem.rates, problem.first)
    names = problem.names[: len(problem.names) - len(problem.clear)]
    found = [*ratios(problem, names, r, s.h[None]), *cleared.values(problem, s, r, fine)]
    return xp.concatenate([xp.stack(found) * units(problem, s.h, r.shape[1]), inside])


def bounds(problem: RouteProblem, s: Segments) -> Float[Any, "2 n"]:
    """Return the values of the two constraints on each duration, which must not be positive."""
    return xp.stack([1 - s.h / problem.shortest, s.h / problem.longest - 1])


class Expansion(NamedTuple):
    """The constraints at the nodes with their gradients.

    `slopes` (limits, q, nodes, n) are the derivatives of the limits with respect to the derivatives of the path with
    respect to u, and `rates` (limits, nodes, n) those with respect to the duration. `away` (3, nodes, n) is the
    displacement from the original path. The last two constraints are those of the tube. `clocks` (clear, nodes, n)
    are the derivatives of the clearances with respect to the times at the starts; None if no obstacle moves.
    """

    values: Float[np.ndarray, "constraints nodes n"]
    slopes: Float[np.ndarray, "limits q nodes n"]
    rates: Float[np.ndarray, "limits nodes n"]
    away: Float[np.ndarray, "3 nodes n"]
    clocks: Any = None

    def part(self, k: Any) -> "Expansion":
        """Return the constraints of some segments."""
        found: Any = (None if x is None else x[..., k] for x in self)
        return Expansion(*found)


class Curvature(NamedTuple):
    """Second derivatives of a sum over the limits at the nodes.

    `path` (q, q, nodes, n) are those with respect to the derivatives of the path with respect to u, `mixed` (q, nodes,
    n) those with respect to these and the duration, and `h` (nodes, n) those with respect to the duration. `clock` are
    those that contain the times at the starts; None if no obstacle moves.
    """

    path: Float[np.ndarray, "q q nodes n"]
    mixed: Float[np.ndarray, "q nodes n"]
    h: Float[np.ndarray, "nodes n"]
    clock: cleared.Clock | None = None


def expand(
    problem: RouteProblem,
    s: Segments,
    weights: Float[np.ndarray, "constraints nodes n"],
    stiffness: Float[np.ndarray, "constraints nodes n"],
) -> tuple[Expansion, Curvature]:
    """Return the constraints and their derivatives.

    All segments must be of one group (see `RouteProblem.groups`). The second result is the sum of the second
    derivatives of the limits, multiplied by `weights`, and of the products of their gradients, multiplied by
    `stiffness`.
    """
    away = displacements(s.change, dense=problem.dense) + problem.offset
    r = derivatives(problem, s.ends)
    unit = units(problem, s.h, r.shape[1])
    if problem.dense:
        r = in_time(r, problem.rates, problem.first)
    q, at_nodes = len(r), r.shape[1:]
    value, rate = np.empty((2, len(unit), *at_nodes))
    slope, second = np.empty((len(unit), *r.shape)), np.zeros((q, *r.shape))
    mixed, twice = np.zeros(r.shape), np.zeros(at_nodes)
    power, own = time_powers(problem.names), problem.on_duration
    numbers = coordinates(np.concatenate([r, np.broadcast_to(s.h, (1, *at_nodes))]) if own else r)
    names = problem.names[: len(problem.names) - len(problem.clear)]
    found = ratios(problem, names, numbers[:q], numbers[q] if own else None)
    for k, g in enumerate(found):
        w, stiff, growth = unit[k] * weights[k], stiffness[k], -power[k] / s.h
        value[k], slope[k], rate[k] = unit[k] * g.value, unit[k] * g.gradient[:q], growth * unit[k] * g.value
        twice += growth * (growth - 1 / s.h) * weights[k] * value[k]
        bent = np.zeros((q + own, q + own, 1, 1)) if isinstance(g.hessian, int) else g.hessian
        if own:
            more = unit[k] * g.gradient[q]
            rate[k] += more
            mixed += w * bent[:q, q]
            twice += w * bent[q, q] + 2 * growth * weights[k] * more
        mixed += (growth * weights[k] + stiff * rate[k]) * slope[k]
        twice += stiff * rate[k] ** 2
        second += w * bent[:q, :q]
        second += (stiff * slope[k])[:, None] * slope[k]
    clocks, clock = None, None
    if problem.clear:
        of = np.s_[len(names) : len(unit)]
        own = cleared.expand(problem, s, r, weights[of], stiffness[of])
        value[of], rate[of], slope[of] = own.values, own.rates, 0.0
        slope[of, : cleared.STATE] = own.slopes
        second[: cleared.STATE, : cleared.STATE] += own.path
        mixed[: cleared.STATE] += own.mixed
        twice, clocks, clock = twice + own.twice, own.clocks, own.clock
    if problem.dense:
        mixed = _in_parameter(mixed[None], None, problem.rates, problem.first)[0][0]
        slope, second = _in_parameter(slope, second, problem.rates, problem.first)
    values = np.concatenate([value, near(away, problem.tube)])
    return Expansion(values, slope, rate, away, clocks), Curvature(second, mixed, twice, clock)


def _in_parameter(slope: np.ndarray, curvature: Any, rates: np.ndarray, lowest: int) -> tuple[np.ndarray, Any]:
    """Convert derivatives with respect to those of the path in time to derivatives with respect to those in u.

    `curvature` may be None.
    """
    order = slope.shape[1] // 3
    matrix = np.zeros((order, order, *rates.shape[1:]))
    for k, own in enumerate(_chain_rule(rates, order, lowest)):
        matrix[k, : len(own)] = own
    first = slope.reshape(len(slope), order, 3, *slope.shape[2:])
    first = np.einsum("jkan,pjcan->pkcan", matrix, first)
    if curvature is None:
        return first.reshape(slope.shape), None
    second = curvature.reshape(order, 3, order, 3, *curvature.shape[2:])
    second = np.einsum("jkan,lman,jcldan->kcmdan", matrix, matrix, second, optimize=True)
    return first.reshape(slope.shape), second.reshape(curvature.shape)
