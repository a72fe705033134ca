"""Advice on infeasible problems: limits to raise or a boundary value to change, and by how much.

The minimum violation is a smooth function of the boundary data as long as the active constraints do not change. The
gradient of this function is the sum of the gradients of the constraints, weighted by their multipliers (envelope
theorem). With this gradient, Newton's method finds the required change of one boundary value. Every remedy after
"What would help" was checked: sequential quadratic programming from the same starts, with the remedy, satisfies the
limits.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from qtraj.design.limits import limits_of
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.multistart import minimise_violation, solve, with_active
from qtraj.design.tuning.peaks import largest_values
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.searches import Curves, Searches
from qtraj.design.tuning.sqp import FEASIBLE, SequentialQuadratic
from qtraj.design.tuning.targets import factors, given, target, user_value_at, value_at
from qtraj.design.tuning.task import as_jax, one
from qtraj.design.tuning.verdict import counted
from qtraj.foundation.progress import Report
from qtraj.foundation.units import with_unit
from qtraj.path.clearance_quantity import names_obstacle
from qtraj.path.quantity import CORRIDOR, quantity
from qtraj.path.vehicle import Vehicle

RELAXATION = 1e6
"""Factor by which a limit is multiplied to make it ineffective."""

MARGINS = (1.0001, 1.01, 1.1)
"""Factors on the largest value of a quantity on the path with the smallest violation.

The new limit is the first product for which a search satisfies all limits.
"""

MORE_STARTS = 4
"""Factor on the number of starts in the advice to use more starts."""

MAX_MOVES, MAX_NUMBERS, OVERSHOOT = 5, 2, 1.3
"""Maximum number of steps for one boundary value, number of boundary values to try, and factor on each Newton step."""

DIFFERENCE = 1e-6
"""Change of a boundary value for a difference quotient, relative to its scale."""

MAX_RELATIVE_MOVE = 3.0
"""Largest useful change of a boundary value, relative to its scale."""


class _Number(NamedTuple):
    """A boundary value: its name and unit, and the attribute (and field) of a problem that contains it."""

    text: str
    unit: str
    of: str
    field: str | None


NUMBERS = (
    _Number("the radius at the start", "m", "start", "radius"),
    _Number("the radius at the end", "m", "end", "radius"),
    _Number("the height at the start", "m", "start", "height"),
    _Number("the height at the end", "m", "end", "height"),
    _Number("the turn", "rad", "turn", None),
)


class SearchOptions(NamedTuple):
    """The options of all searches for the advice on one problem."""

    starts: int
    max_steps: int
    report: Report | None
    vehicle: Vehicle | None = None

    def solve(self, searches: Searches) -> SearchResult:
        """Solve one problem from all starts by sequential quadratic programming, and return the best result."""
        return solve(SequentialQuadratic(self.max_steps), searches, self.starts, self.max_steps, self.report)

    def user_limits(self, searches: Searches) -> dict[str, float]:
        """Return the limits of one problem in the user's units, by name."""
        own = given(searches.limits)
        divisors = factors(own, self.vehicle)
        return {name: float(quantity(name).of_tangent(x[0])) * divisors[name] for name, x in own.items()}

    def with_limits(self, searches: Searches, limits: dict[str, float]) -> Searches:
        """Return one problem with other limits in the user's units."""
        divisors = factors(limits, self.vehicle)
        reduced = {name: quantity(name).tangent(np.asarray([x / divisors[name]])) for name, x in limits.items()}
        obstacles = {name: x for name, x in searches.limits.items() if names_obstacle(name)}
        return _replaced(searches, {name: target(name, reduced) for name in reduced} | obstacles)

    def can_be_met(self, searches: Searches) -> bool:
        """Check whether a multistart search finds a path that satisfies the limits of one problem."""
        result = self.solve(searches)
        if not float(result.violation[0]) <= FEASIBLE:
            return False
        limits, problem = self.user_limits(searches), searches.problem
        corridor = limits.pop(CORRIDOR.name, None)
        path, initial = (as_jax(one(problem.path(z))) for z in (result.z.T, problem.zero))
        reference = None if corridor is None else initial
        own = problem.clearances
        obstacles = {} if own is None else {"keep_out": own.keep_out, "body": own.body}
        return certify(path, limits_of(limits, self.vehicle, **obstacles), corridor=corridor, reference=reference).met


def advice(searches: Searches, result: SearchResult, options: SearchOptions) -> str:
    """Return advice on the limits of one problem (a batch of one), from the result with minimum violation."""
    problem = searches.problem
    if not problem.objective.is_formula:
        searches = dataclasses.replace(searches, problem=problem.without_objective())
    # The search replaces limits that are almost zero by larger limits. Use the limits of the search here as well.
    limits = options.user_limits(searches)
    values = dict(zip(searches.limits, largest_values(searches, result.z.T)[:, 0].tolist(), strict=True))
    worst = {name: math.exp(values[name]) for name in limits}
    violated = [name for name, ratio in worst.items() if ratio > 1 + FEASIBLE]
    own = {} if problem.clearances is None else problem.clearances.obstacles
    entered = [name for name, rows in own.items() if max(values[row] for row in rows) > FEASIBLE]
    min_ratios, tried = worst, dict.fromkeys(violated, int(result.starts[0]))
    if len(searches.limits) > 1:
        alone = {name: _search_alone(searches, name, options) for name in violated}
        min_ratios = {name: min(math.exp(float(x.violation[0])), worst[name]) for name, x in alone.items()}
        tried = {name: int(x.starts[0]) for name, x in alone.items()}
    sentences = [_describe(name, min_ratios[name], limits, tried[name]) for name in violated]
    sentences += [_describe_obstacle(searches, name, options) for name in entered]
    remedies = _raise_limits(searches, limits, worst, violated, options) if violated else []
    remedies += [*_omit_obstacles(searches, entered, options), *_move_number(searches, result, options)]
    possible_remedies = []
    if problem.motion.is_uniform:
        possible_remedies.append("motion 'hermite', whose angular rate need not be constant")
    if problem.objective.fixes_duration:
        possible_remedies.append("a longer duration, which this objective does not change")
    if remedies:
        sentences.append("What would help: " + "; or ".join(remedies) + " (one such change is enough, as was checked).")
    if possible_remedies:
        sentences.append("What may help: " + "; or ".join(possible_remedies) + ".")
    sentences.append(f"More starts may find a path: pass starts={MORE_STARTS * options.starts}.")
    return " ".join(sentences)


def _describe(name: str, min_ratio: float, limits: dict[str, float], starts: int) -> str:
    """Describe the result of a search with one limit alone; `min_ratio` is the smallest peak divided by the limit."""
    if min_ratio > 1 + FEASIBLE:
        closest = with_unit(float(user_value_at(min_ratio, name, limits)), quantity(name).unit)
        extreme = "largest minimum" if quantity(name).lower else "smallest maximum"
        return (
            f"The limit on {name} was not satisfied, even as the only limit ({counted(starts, 'start')} tried); the "
            f"{extreme} found is {closest}."
        )
    return f"The limit on {name} can be satisfied alone; no path was found that satisfies all limits."


def _describe_obstacle(searches: Searches, name: str, options: SearchOptions) -> str:
    """Describe the result of a search with one obstacle and no other limit."""
    relaxed = {key: value_at(RELAXATION, key, searches.limits) for key in given(searches.limits)}
    if float(options.solve(_among(_replaced(searches, relaxed), [name])).violation[0]) <= FEASIBLE:
        return f"{name} alone can be avoided; no path was found that also satisfies all limits."
    return f"{name} was not avoided, even without other limits and obstacles."


def _omit_obstacles(searches: Searches, entered: list[str], options: SearchOptions) -> list[str]:
    """Describe the obstacles that must be omitted; return an empty list if this is not enough, or none is entered."""
    own = searches.problem.clearances
    if own is None or not entered:
        return []
    kept = [name for name in own.obstacles if name not in entered]
    others = _among(searches, kept)
    return [f"omit {' and '.join(entered)}"] if others.limits and options.can_be_met(others) else []


def _among(searches: Searches, kept: list[str]) -> Searches:
    """Return one problem with the obstacles of these names."""
    own = searches.problem.clearances
    few = None if own is None else own.only(kept)
    limits = {name: x for name, x in searches.limits.items() if not names_obstacle(name)}
    names = () if few is None else few.by_name
    problem = dataclasses.replace(searches.problem, clearances=few)
    return _replaced(dataclasses.replace(searches, problem=problem), limits | dict.fromkeys(names, np.zeros(1)))


def _replaced(searches: Searches, limits: dict[str, np.ndarray]) -> Searches:
    """Return one problem with other limits, in the order of their names."""
    return dataclasses.replace(searches, limits={name: limits[name] for name in sorted(limits)})


def _raise_limits(
    searches: Searches, limits: dict[str, float], worst: dict[str, float], violated: list[str], options: SearchOptions
) -> list[str]:
    """Describe the values to which the violated limits must be raised; return an empty list if no values were found."""
    for margin in MARGINS:
        raised = {name: float(f"{user_value_at(margin * worst[name], name, limits):.6g}") for name in violated}
        if options.can_be_met(options.with_limits(searches, limits | raised)):
            return [" and ".join(f"{_change(k)} to {with_unit(x, quantity(k).unit)}" for k, x in raised.items())]
    return []


def _change(name: str) -> str:
    return f"{'lower' if quantity(name).lower else 'raise'} {name}"


def _search_alone(searches: Searches, name: str, options: SearchOptions) -> SearchResult:
    """Return the result of a search with one limit, with all other limits relaxed."""
    searches = _among(searches, [])
    limits = searches.limits
    relaxed = {key: x if key == name else value_at(RELAXATION, key, limits) for key, x in limits.items()}
    return options.solve(_replaced(searches, relaxed))


def _move_number(searches: Searches, result: SearchResult, options: SearchOptions) -> list[str]:
    """Describe a change of one boundary value that makes the problem solvable; an empty list if none was found."""
    steps = _newton_steps(searches, result)
    for k in sorted(range(len(NUMBERS)), key=lambda k: abs(steps[k][1]))[:MAX_NUMBERS]:
        moved = _move_until_met(searches, result, k, options)
        if moved is not None:
            number = NUMBERS[k]
            before = float(_value(searches.problem, number)[0])
            return [f"change {number.text} from {before:.4g} to {moved:.4g} {number.unit}"]
    return []


def _move_until_met(searches: Searches, result: SearchResult, k: int, options: SearchOptions) -> float | None:
    """Change one boundary value until the limits can be satisfied; return the new value, or None if this fails."""
    number = NUMBERS[k]
    first, size = float(_value(searches.problem, number)[0]), _size(searches.problem, number)
    for _ in range(MAX_MOVES):
        step, relative = _newton_steps(searches, result)[k]
        # Round as in the message, so that the value in the message is the value that is checked.
        value = float(f"{float(_value(searches.problem, number)[0]) + OVERSHOOT * step:.4g}")
        crosses_zero = number.field != "height" and value * first <= 0
        if not math.isfinite(relative) or abs(value - first) > MAX_RELATIVE_MOVE * size or crosses_zero:
            return None
        searches = _with_value(searches, number, value)
        result = with_active(
            searches, minimise_violation(searches, result.z.T, options.max_steps, options.report), result.starts
        )
        if float(result.violation[0]) <= FEASIBLE and options.can_be_met(searches):
            return value
    return None


def _newton_steps(searches: Searches, result: SearchResult) -> list[tuple[float, float]]:
    """Return, for each boundary value, the Newton step to zero violation, and the step divided by the value's scale."""
    steps = []
    for number in NUMBERS:
        value, size = float(_value(searches.problem, number)[0]), _size(searches.problem, number)
        change = DIFFERENCE * size
        values = [_violation(_with_value(searches, number, value + x), result) for x in (-change, change)]
        slope = (values[1] - values[0]) / (2 * change)
        step = -float(result.violation[0]) / slope if slope != 0 else math.inf
        steps.append((step, step / size))
    return steps


def _violation(searches: Searches, result: SearchResult) -> float:
    """Return the mean of the constraint values at the active peaks of a result, weighted by the multipliers."""
    names, weights = tuple(searches.limits), result.multiplier[0]
    if not weights.sum() > 0:
        return 0.0
    u = result.time.T
    with np.errstate(all="ignore"):
        rows = Curves(searches, result.z.T).values(names, u, searches.order)
    g = np.asarray([np.broadcast_to(row, u.shape)[:, 0] for row in rows])
    own = g[result.limit[0], np.arange(weights.size)]
    return float(np.sum(np.where(weights > 0, weights * own, 0.0)) / weights.sum())


def _value(problem: Any, number: _Number) -> np.ndarray:
    part = getattr(problem, number.of)
    return part if number.field is None else getattr(part, number.field)


def _with_value(searches: Searches, number: _Number, value: float) -> Searches:
    """Return one problem with another boundary value."""
    new = np.full_like(_value(searches.problem, number), value)
    problem = eqx.tree_at(lambda p: _value(p, number), searches.problem, new)
    return dataclasses.replace(searches, problem=problem)


def _size(problem: Any, number: _Number) -> float:
    """Return the scale of a boundary value: the magnitude of the turn, or the mean radius for radii and heights."""
    if number.of == "turn":
        return abs(float(problem.turn[0]))
    return float(problem.start.radius[0] + problem.end.radius[0]) / 2
