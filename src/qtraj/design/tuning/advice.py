"""Advice on infeasible problems: limits to raise or a boundary value to change, and by how much.

The minimum violation is a smooth function of the boundary data as long as the active constraints do not change. The
gradient of this function is the sum of the gradients of the constraints, weighted by their multipliers (envelope
theorem). With this gradient, Newton's method finds the required change of one boundary value. Every remedy after
"What would help" was checked: sequential quadratic programming from the same starts, with the remedy, satisfies the
limits.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.limits import Limits, divisors
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.constraints import of_one_path, values
from qtraj.design.tuning.model import make_setting
from qtraj.design.tuning.multistart import minimise_violation, solve, take, without_objective
from qtraj.design.tuning.peaks import ABSENT
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.sqp import FEASIBLE, SequentialQuadratic
from qtraj.design.tuning.task import TARGET_RATIO, LimitSlots, Task, over_slots
from qtraj.foundation.arrays import as_float
from qtraj.foundation.indexing import element, with_element
from qtraj.foundation.progress import Report
from qtraj.foundation.types import Scalar
from qtraj.foundation.units import with_unit
from qtraj.path.quantity import CORRIDOR, quantity
from qtraj.path.vehicle import NO_VEHICLE, Vehicle

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

    slots: LimitSlots
    starts: int
    max_steps: int
    report: Report | None
    vehicle: Vehicle | None = None

    def minimise_violation(self, tasks: Task, result: SearchResult) -> SearchResult:
        """Minimise the violation, starting from the result of another search."""
        return minimise_violation(tasks, self.slots, result, self.max_steps, self.report)

    def solve(self, tasks: Task) -> SearchResult:
        """Solve the tasks from all starts by sequential quadratic programming, and return the best result."""
        method = SequentialQuadratic(self.max_steps)
        return solve(method, tasks, self.slots, self.starts, self.max_steps, self.report)

    def divisors(self, names: Iterable[str]) -> dict[str, float]:
        """Return, by name, the numbers by which the search divides the limits."""
        road = NO_VEHICLE if self.vehicle is None else self.vehicle.parameters()
        own = divisors([name for name in names if name != CORRIDOR.name], road)
        return {name: float(own.get(name, 1.0)) for name in names}

    def user_limits(self, tasks: Task, names: Sequence[str]) -> dict[str, float]:
        """Return the limits of one problem (a batch of one) in the user's units, by name."""
        reduced = np.asarray(tasks.limits, float)[0] / TARGET_RATIO
        return {name: float(limit) * x for (name, x), limit in zip(self.divisors(names).items(), reduced, strict=False)}

    def can_be_met(self, tasks: Task, names: Sequence[str]) -> bool:
        """Check whether a multistart search finds a path that satisfies the limits of one problem (a batch of one)."""
        result = self.solve(tasks)
        if float(result.violation[0]) > FEASIBLE:
            return False
        problem, z = take(tasks.problem, 0), jnp.asarray(result.z[0])
        limits = self.user_limits(tasks, names)
        corridor = limits.pop(CORRIDOR.name, None)
        reference = None if corridor is None else _path(problem, jnp.zeros_like(z))
        return certify(
            _path(problem, z), Limits(**limits, vehicle=self.vehicle), corridor=corridor, reference=reference
        ).met


_path = eqx.filter_jit(lambda problem, z: problem.path(z))


def advice(tasks: Task, names: Sequence[str], result: SearchResult, options: SearchOptions) -> str:
    """Return advice on the limits of one problem (a batch of one), from the result with minimum violation."""
    tasks = without_objective(tasks)
    # The search replaces limits that are almost zero by larger limits. Use the limits of the search here as well.
    limits = options.user_limits(tasks, names)
    worst = dict(zip(limits, _peak_ratios(result)[0], strict=False))
    violated = [name for name, ratio in worst.items() if ratio > 1 + FEASIBLE]
    min_ratios = worst
    if len(limits) > 1:
        min_ratios = {name: _min_ratio_alone(tasks, [*limits].index(name), options) for name in violated}
    sentences = [_describe(name, min_ratios[name], limits[name], options.starts) for name in violated]
    remedies = [*_raise_limits(tasks, limits, worst, violated, options), *_move_number(tasks, limits, result, options)]
    possible_remedies = []
    if tasks.problem.motion.is_uniform:
        possible_remedies.append("motion 'hermite', whose angular rate need not be constant")
    if tasks.problem.objective.fixes_duration:
        possible_remedies.append("a longer duration, which this objective does not change")
    if remedies:
        sentences.append("What would help: " + "; or ".join(remedies) + " (one such change is enough, as was checked).")
    if possible_remedies:
        sentences.append("What may help: " + "; or ".join(possible_remedies) + ".")
    sentences.append(f"More starts may find a path: pass starts={MORE_STARTS * options.starts}.")
    return " ".join(sentences)


def _describe(name: str, min_ratio: float, limit: float, starts: int) -> str:
    """Describe the result of a search with one limit alone; `min_ratio` is the smallest peak divided by the limit."""
    if min_ratio > 1 + FEASIBLE:
        smallest = with_unit(min_ratio * limit, quantity(name).unit)
        searched = "1 start" if starts == 1 else f"{starts} starts"
        return (
            f"The limit on {name} was not satisfied, even as the only limit (searched from {searched}); "
            f"the smallest maximum found is {smallest}."
        )
    return f"The limit on {name} can be satisfied alone; no path was found that satisfies all limits."


def _raise_limits(
    tasks: Task, limits: dict[str, float], worst: dict[str, float], violated: list[str], options: SearchOptions
) -> list[str]:
    """Describe the values to which the violated limits must be raised; return an empty list if no values were found."""
    for margin in MARGINS:
        raised = {name: float(f"{margin * worst[name] * limits[name]:.6g}") for name in violated}
        new = np.array(tasks.limits, float)
        new[0, : len(limits)] = [
            TARGET_RATIO * raised.get(name, limits[name]) / x for name, x in options.divisors(limits).items()
        ]
        if options.can_be_met(dataclasses.replace(tasks, limits=new), [*limits]):
            return ["raise " + " and ".join(f"{k} to {with_unit(x, quantity(k).unit)}" for k, x in raised.items())]
    return []


def _peak_ratios(result: SearchResult) -> Float[np.ndarray, "batch slots"]:
    """Return the largest value of each quantity divided by its limit."""
    return np.sqrt(np.maximum(1 + 2 * np.max(np.asarray(result.values), axis=2), 0.0))


def _min_ratio_alone(tasks: Task, slot: int, options: SearchOptions) -> float:
    """Return the smallest peak of one quantity divided by its limit, with all other limits relaxed."""
    others = np.arange(tasks.limits.shape[1]) != slot
    relaxed = np.where(others, RELAXATION * np.asarray(tasks.limits), tasks.limits)
    relaxed_result = options.solve(dataclasses.replace(tasks, limits=relaxed))
    return math.sqrt(1 + 2 * float(relaxed_result.violation[0]))


def _move_number(tasks: Task, limits: dict[str, float], result: SearchResult, options: SearchOptions) -> list[str]:
    """Describe a change of one boundary value that makes the problem solvable; an empty list if none was found."""
    steps = _newton_steps(tasks, result, options.slots)
    for k in sorted(range(len(NUMBERS)), key=lambda k: abs(steps[k][1]))[:MAX_NUMBERS]:
        moved = _move_until_met(tasks, limits, result, k, options)
        if moved is not None:
            number = NUMBERS[k]
            before = float(_value(take(tasks.problem, 0), number))
            return [f"change {number.text} from {before:.4g} to {moved:.4g} {number.unit}"]
    return []


def _move_until_met(
    tasks: Task, limits: dict[str, float], result: SearchResult, k: int, options: SearchOptions
) -> float | None:
    """Change one boundary value until the limits can be satisfied; return the new value, or None if this fails."""
    number, problem = NUMBERS[k], take(tasks.problem, 0)
    first, size = float(_value(problem, number)), _size(problem, number)
    for _ in range(MAX_MOVES):
        step, relative = _newton_steps(tasks, result, options.slots)[k]
        # Round as in the message, so that the value in the message is the value that is checked.
        value = float(f"{float(_value(take(tasks.problem, 0), number)) + OVERSHOOT * step:.4g}")
        crosses_zero = number.field != "height" and value * first <= 0
        if not math.isfinite(relative) or abs(value - first) > MAX_RELATIVE_MOVE * size or crosses_zero:
            return None
        tasks = eqx.tree_at(lambda t: t.problem, tasks, _with_value(tasks.problem, number, as_float([value])))
        values_at = _constraint_values_jit(take(tasks, 0), options.slots, take(result, 0))
        result = options.minimise_violation(tasks, result._replace(violation=np.maximum(np.max(values_at), 0.0)[None]))
        if float(result.violation[0]) <= FEASIBLE and options.can_be_met(tasks, [*limits]):
            return value
    return None


def _newton_steps(tasks: Task, result: SearchResult, slots: LimitSlots) -> list[tuple[float, float]]:
    """Return, for each boundary value, the Newton step to zero violation, and the step divided by the value's scale."""
    task, at = take(tasks, 0), take(result, 0)
    violation, slopes = float(at.violation), [float(s) for s in _violation_gradient(task, slots, at)]
    steps = [-violation / s if s != 0 else math.inf for s in slopes]
    return [(step, step / _size(task.problem, number)) for step, number in zip(steps, NUMBERS, strict=True)]


@eqx.filter_jit
def _violation_gradient(task: Task, slots: LimitSlots, at: SearchResult) -> tuple[Scalar, ...]:
    """Return the derivatives of the minimum violation with respect to the boundary values."""

    def violation_of(numbers: tuple[Scalar, ...]) -> Scalar:
        problem = task.problem
        for number, value in zip(NUMBERS, numbers, strict=True):
            problem = _with_value(problem, number, value)
        constraint_values = _constraint_values(dataclasses.replace(task, problem=problem), slots, at)
        return jnp.sum(at.multipliers * constraint_values) / jnp.maximum(
            at.multipliers.sum(), jnp.finfo(at.z.dtype).tiny
        )

    return jax.jacfwd(violation_of)(tuple(_value(task.problem, number) for number in NUMBERS))


def _constraint_values(task: Task, slots: LimitSlots, at: SearchResult) -> Float[Array, "slots k"]:
    """Return the constraint values of a task at the times and variables of a search result."""
    here = make_setting(task.problem, at.z)

    def of_slot(slot: Int[Array, ""], carry: Array) -> Array:
        index = element(slots.index, slot)
        slot_values = of_one_path(values)(here, index, *element((task.limits, at.times), slot))
        found = jnp.where(element(at.values, slot) > ABSENT, slot_values, ABSENT)
        return with_element(carry, slot, found)

    return over_slots(slots, of_slot, jnp.full_like(at.times, ABSENT))


_constraint_values_jit = eqx.filter_jit(_constraint_values)


def _value(problem: Problem, number: _Number) -> Float[Array, "*batch"]:
    part = getattr(problem, number.of)
    return part if number.field is None else getattr(part, number.field)


def _with_value(problem: Problem, number: _Number, value: Float[Array, "*batch"]) -> Problem:
    def where(p: Any) -> Any:
        return getattr(p, number.of) if number.field is None else getattr(getattr(p, number.of), number.field)

    return eqx.tree_at(where, problem, value)


def _size(problem: Problem, number: _Number) -> float:
    """Return the scale of a boundary value: the magnitude of the turn, or the mean radius for radii and heights."""
    if number.of == "turn":
        return abs(float(problem.turn))
    return (float(problem.start.radius) + float(problem.end.radius)) / 2
