"""What would help where limits cannot be met: which to relax, or which boundary number to move, and how far.

The least excess is a smooth function of the boundary data, whose gradient is that of the rows weighed by their
multipliers (envelope theorem). A move is taken along it. Whatever is named as a help was solved by
sequential quadratic programming, from the same starts, and its limits were met on the whole path.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.limits import Limits
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.constraints import values
from qtraj.design.tuning.model import setting
from qtraj.design.tuning.multistart import best_of_each, least_violation, take, without_objective
from qtraj.design.tuning.peaks import ABSENT
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.search import Found
from qtraj.design.tuning.sqp import FEASIBLE, SequentialQuadratic
from qtraj.design.tuning.task import AIM, Present, Task
from qtraj.foundation.arrays import as_float
from qtraj.foundation.progress import Report
from qtraj.foundation.types import Scalar
from qtraj.foundation.units import with_unit
from qtraj.path.quantity import CORRIDOR, quantity

RELAXED = 1e6
"""A limit times this limits nothing."""

MARGINS = (1.0001, 1.01, 1.1)
"""A limit is raised to the least peak times the first of these with which the problem can be solved."""

MOVES, TRIED, OVERSHOT = 5, 2, 1.3
"""Steps of one number, numbers tried, and how much farther than the tangent says a step goes."""

FARTHEST = 3.0
"""A number moved by more than this many of its sizes is no help."""


class _Number(NamedTuple):
    """A boundary number, where it stands in a problem, and how its value is said."""

    text: str
    unit: str
    of: str
    field: str | None


NUMBERS = (
    _Number("the radius of the start", "m", "start", "radius"),
    _Number("the radius of the end", "m", "end", "radius"),
    _Number("the height of the start", "m", "start", "height"),
    _Number("the height of the end", "m", "end", "height"),
    _Number("the turn", "rad", "turn", None),
)


class Search(NamedTuple):
    """What all searches of one piece of advice share."""

    which: Present
    starts: int
    most_steps: int
    tell: Report | None

    def least(self, tasks: Task, found: Found) -> Found:
        """The least violation from where another search ended."""
        return least_violation(tasks, self.which, found, self.most_steps, self.tell)

    def solved(self, tasks: Task) -> Found:
        """The best of searches from all starts, by sequential quadratic programming."""
        method = SequentialQuadratic(self.most_steps)
        return best_of_each(method, tasks, self.which, self.starts, self.most_steps, self.tell)

    def can_be_met(self, tasks: Task, names: Sequence[str]) -> bool:
        """Whether searches meet the limits of one problem (a batch of one), on the whole path."""
        found = self.solved(tasks)
        if float(found.violation[0]) > FEASIBLE:
            return False
        problem, z = take(tasks.problem, 0), jnp.asarray(found.z[0])
        limits = dict(zip(names, np.asarray(tasks.limits, float)[0] / AIM, strict=False))
        corridor = limits.pop(CORRIDOR.name, None)
        reference = None if corridor is None else _path(problem, jnp.zeros_like(z))
        return certify(_path(problem, z), Limits(**limits), corridor=corridor, reference=reference).met


_path = eqx.filter_jit(lambda problem, z: problem.path(z))


def advice(tasks: Task, names: Sequence[str], found: Found, search: Search) -> str:
    """What to do about the limits of one problem (a batch of one), from where it violates them least."""
    tasks = without_objective(tasks)
    # As the search sees them: a limit that is next to nothing counts as more.
    given = dict(zip(names, np.asarray(tasks.limits, float)[0] / AIM, strict=False))
    worst = dict(zip(given, _ratios(found)[0], strict=False))
    violated = [name for name, ratio in worst.items() if ratio > 1 + FEASIBLE]
    alone = worst
    if len(given) > 1:
        alone = {name: _least_alone(tasks, [*given].index(name), search) for name in violated}
    lines = [_verdict(name, alone[name], given[name]) for name in violated]
    remedies = [*_raise(tasks, given, worst, violated, search), *_move(tasks, given, found, search)]
    untried = []
    if tasks.problem.motion.is_uniform:
        untried.append("motion 'hermite', whose angle need not turn uniformly")
    if tasks.problem.objective.holds_duration:
        untried.append("a longer duration, which this objective holds fixed")
    if remedies:
        lines.append("What would help: " + "; or ".join(remedies) + " (there the limits can be met).")
    if untried:
        lines.append("What may help: " + "; or ".join(untried) + ".")
    return " ".join(lines)


def _verdict(name: str, alone: float, limit: float) -> str:
    if alone > 1 + FEASIBLE:
        return (
            f"{name} was not met even alone: the least peak found is {with_unit(alone * limit, quantity(name).unit)}."
        )
    return f"{name} can be met alone, but not with the others."


def _raise(
    tasks: Task, given: dict[str, float], worst: dict[str, float], violated: list[str], search: Search
) -> list[str]:
    """To what the violated limits may be raised, in words; nothing where no such limits were seen to be met."""
    for margin in MARGINS:
        raised = {name: float(f"{margin * worst[name] * given[name]:.6g}") for name in violated}
        new = np.array(tasks.limits, float)
        new[0, : len(given)] = [AIM * raised.get(name, limit) for name, limit in given.items()]
        if search.can_be_met(dataclasses.replace(tasks, limits=new), [*given]):
            return ["raise " + " and ".join(f"{k} to {with_unit(x, quantity(k).unit)}" for k, x in raised.items())]
    return []


def _ratios(found: Found) -> Float[np.ndarray, "batch slots"]:
    """The largest value of each quantity over its limit."""
    return np.sqrt(np.maximum(1 + 2 * np.max(np.asarray(found.values), axis=2), 0.0))


def _least_alone(tasks: Task, slot: int, search: Search) -> float:
    """The least peak of one quantity over its limit, found with every other limit relaxed."""
    others = np.arange(tasks.limits.shape[1]) != slot
    relaxed = np.where(others, RELAXED * np.asarray(tasks.limits), tasks.limits)
    ended = search.solved(dataclasses.replace(tasks, limits=relaxed))
    return math.sqrt(1 + 2 * float(ended.violation[0]))


def _move(tasks: Task, given: dict[str, float], found: Found, search: Search) -> list[str]:
    """The move of one boundary number that helps, in words; the one that is moved least, of those that do."""
    steps = _tangents(tasks, found, search.which)
    for k in sorted(range(len(NUMBERS)), key=lambda k: abs(steps[k][1]))[:TRIED]:
        moved = _moved_until_met(tasks, given, found, k, search)
        if moved is not None:
            number = NUMBERS[k]
            before = float(_value(take(tasks.problem, 0), number))
            return [f"move {number.text} from {before:.4g} to {moved:.4g} {number.unit}"]
    return []


def _moved_until_met(tasks: Task, given: dict[str, float], found: Found, k: int, search: Search) -> float | None:
    number, problem = NUMBERS[k], take(tasks.problem, 0)
    first, size = float(_value(problem, number)), _size(problem, number)
    for _ in range(MOVES):
        step, relative = _tangents(tasks, found, search.which)[k]
        # As many digits as are told.
        value = float(f"{float(_value(take(tasks.problem, 0), number)) + OVERSHOT * step:.4g}")
        through_zero = number.field != "height" and value * first <= 0
        if not math.isfinite(relative) or abs(value - first) > FARTHEST * size or through_zero:
            return None
        tasks = eqx.tree_at(lambda t: t.problem, tasks, _with(tasks.problem, number, as_float([value])))
        there = _values_there(take(tasks, 0), search.which, take(found, 0))
        found = search.least(tasks, found._replace(violation=np.maximum(np.max(there), 0.0)[None]))
        if float(found.violation[0]) <= FEASIBLE and search.can_be_met(tasks, [*given]):
            return value
    return None


def _tangents(tasks: Task, found: Found, which: Present) -> list[tuple[float, float]]:
    """Of each number the step at which its tangent meets the limits, and the same over the number's size."""
    task, at = take(tasks, 0), take(found, 0)
    violation, slopes = float(at.violation), [float(s) for s in _slopes(task, which, at)]
    steps = [-violation / s if s != 0 else math.inf for s in slopes]
    return [(step, step / _size(task.problem, number)) for step, number in zip(steps, NUMBERS, strict=True)]


@eqx.filter_jit
def _slopes(task: Task, which: Present, at: Found) -> tuple[Scalar, ...]:
    """The derivatives of the least violation in each number."""

    def weighed(numbers: tuple[Scalar, ...]) -> Scalar:
        problem = task.problem
        for number, value in zip(NUMBERS, numbers, strict=True):
            problem = _with(problem, number, value)
        rows = _values(dataclasses.replace(task, problem=problem), which, at)
        return jnp.sum(at.multipliers * rows) / jnp.maximum(at.multipliers.sum(), jnp.finfo(at.z.dtype).tiny)

    return jax.jacfwd(weighed)(tuple(_value(task.problem, number) for number in NUMBERS))


def _values(task: Task, which: Present, at: Found) -> Float[Array, "slots k"]:
    """The values of the constraints of a task at the times that were found, on the path that its problem has there."""
    here = setting(task.problem, at.z)

    def of_slot(slot: Int[Array, ""], found: Array) -> Array:
        index = jnp.asarray(which.index)[slot]
        own = values(here, index, task.limits[slot], at.times[slot])
        return found.at[slot].set(jnp.where(at.values[slot] > ABSENT, own, ABSENT))

    return jax.lax.fori_loop(0, jnp.asarray(which.count), of_slot, jnp.full_like(at.times, ABSENT))


_values_there = eqx.filter_jit(_values)


def _value(problem: Problem, number: _Number) -> Float[Array, "*batch"]:
    part = getattr(problem, number.of)
    return part if number.field is None else getattr(part, number.field)


def _with(problem: Problem, number: _Number, value: Float[Array, "*batch"]) -> Problem:
    def where(p: Any) -> Any:
        return getattr(p, number.of) if number.field is None else getattr(getattr(p, number.of), number.field)

    return eqx.tree_at(where, problem, value)


def _size(problem: Problem, number: _Number) -> float:
    """What a number is measured by: the mean radius, or the turn itself."""
    if number.of == "turn":
        return abs(float(problem.turn))
    return (float(problem.start.radius) + float(problem.end.radius)) / 2
