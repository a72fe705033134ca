"""What would help where limits cannot be met: which to relax, or which boundary number to move, and how far.

The least excess is a smooth function of the boundary data, whose gradient is that of the rows weighed by their
multipliers (envelope theorem). A move is taken along it, and named only once the limits are seen to be met there.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.magnitudes import quantity
from qtraj.design.tuning.campaign import Found, Tell, least_excess, take, without_objective
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.rows import excess
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Task
from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import Scalar

RELAXED = 1e6
"""A limit times this limits nothing."""

MARGIN = 1.0001
"""A limit raised to the least peak is raised so much more, that it can be met."""

MOVES, TRIED, OVERSHOT = 10, 2, 1.3
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


def advice(tasks: Task, found: Found, most_steps: int, tell: Tell | None) -> str:
    """What to do about the limits of one problem (a batch of one), from where it exceeds them least."""
    tasks = without_objective(tasks)
    task = take(tasks, 0)
    given = {name: float(limit) for name, limit in task.limits.given().items()}
    worst = _ratios(task, take(found, 0))
    broken = [name for name, ratio in worst.items() if ratio > 1 + FEASIBLE]
    alone = {name: _least_alone(tasks, found, name, most_steps, tell) for name in broken} if len(given) > 1 else worst
    lines = [_verdict(name, alone[name], given[name]) for name in broken]
    raised = [f"{name} to {quantity(name, MARGIN * worst[name] * given[name])}" for name in broken]
    remedies = ["raise " + " and ".join(raised)]
    remedies += _move(tasks, found, most_steps, tell)
    problem = tasks.problem
    if problem.motion == "uniform":
        remedies.append("take motion 'hermite', whose angle need not turn uniformly")
    if problem.holds_duration:
        remedies.append("give a longer duration, which this objective holds fixed")
    return " ".join([*lines, "What would help: " + "; or ".join(remedies) + "."])


def _verdict(name: str, alone: float, limit: float) -> str:
    if alone > 1 + FEASIBLE:
        return f"{name} cannot be met between these positions: even alone the least peak found is " + (
            f"{quantity(name, alone * limit)}."
        )
    return f"{name} can be met alone, but not with the others."


def _ratios(task: Task, found: Found) -> dict[str, float]:
    """The largest value of each quantity over its limit, of one problem."""
    return {name: math.sqrt(max(1 + 2 * float(value), 0.0)) for name, value in _excesses(task, found).items()}


@eqx.filter_jit
def _excesses(task: Task, found: Found) -> dict[str, Scalar]:
    """The largest excess over each limit."""
    return {name: jnp.max(rows) for name, rows in _rows(task.problem, task, found).items()}


def _rows(problem: Problem, task: Task, found: Found) -> dict[str, Float[Array, " k"]]:
    """The excess over each limit of `task` at the times that were found, on the path that `problem` has there."""
    return {
        name: jax.vmap(lambda u, n=name, x=limit: excess(problem, found.z, u, n, x))(found.times[k])
        for k, (name, limit) in enumerate(task.limits.given().items())
    }


def _least_alone(tasks: Task, found: Found, name: str, most_steps: int, tell: Tell | None) -> float:
    """The least peak of one quantity over its limit, found with every other limit relaxed."""
    # Relaxed and not left out: the problem keeps its structure, so nothing is compiled again.
    others = [n for n in tasks.limits.given() if n != name]
    alone = eqx.tree_at(
        lambda t: [getattr(t.limits, n) for n in others],
        tasks,
        [RELAXED * np.asarray(getattr(tasks.limits, n)) for n in others],
    )
    ended = least_excess(alone, found, most_steps, tell)
    return math.sqrt(1 + 2 * float(ended.excess[0]))


def _move(tasks: Task, found: Found, most_steps: int, tell: Tell | None) -> list[str]:
    """The move of one boundary number that helps, in words; the one that is moved least, of those that do."""
    steps = _tangents(tasks, found)
    for k in sorted(range(len(NUMBERS)), key=lambda k: abs(steps[k][1]))[:TRIED]:
        moved = _moved_until_met(tasks, found, k, most_steps, tell)
        if moved is not None:
            number = NUMBERS[k]
            before = float(_value(take(tasks.problem, 0), number))
            return [f"move {number.text} from {before:.4g} to {moved:.4g} {number.unit} (there the limits can be met)"]
    return []


def _moved_until_met(tasks: Task, found: Found, k: int, most_steps: int, tell: Tell | None) -> float | None:
    number, problem = NUMBERS[k], take(tasks.problem, 0)
    first, size = float(_value(problem, number)), _size(problem, number)
    for _ in range(MOVES):
        step, relative = _tangents(tasks, found)[k]
        value = float(_value(take(tasks.problem, 0), number)) + OVERSHOT * step
        through_zero = number.field != "height" and value * first <= 0
        if not math.isfinite(relative) or abs(value - first) > FARTHEST * size or through_zero:
            return None
        tasks = eqx.tree_at(lambda t: t.problem, tasks, _with(tasks.problem, number, as_float([value])))
        found = least_excess(tasks, found._replace(excess=_excess_there(tasks, found)), most_steps, tell)
        if float(found.excess[0]) <= FEASIBLE:
            return value
    return None


def _tangents(tasks: Task, found: Found) -> list[tuple[float, float]]:
    """Of each number the step at which its tangent meets the limits, and the same over the number's size."""
    task, at = take(tasks, 0), take(found, 0)
    excess_now, slopes = float(at.excess), [float(s) for s in _slopes(task, at)]
    steps = [-excess_now / s if s != 0 else math.inf for s in slopes]
    return [(step, step / _size(task.problem, number)) for step, number in zip(steps, NUMBERS, strict=True)]


@eqx.filter_jit
def _slopes(task: Task, at: Found) -> tuple[Scalar, ...]:
    """The derivatives of the least excess in each number."""

    def weighed(numbers: tuple[Scalar, ...]) -> Scalar:
        problem = task.problem
        for number, value in zip(NUMBERS, numbers, strict=True):
            problem = _with(problem, number, value)
        rows = jnp.stack([*_rows(problem, task, at).values()])
        return jnp.sum(at.multipliers * rows) / jnp.maximum(at.multipliers.sum(), jnp.finfo(at.z.dtype).tiny)

    return jax.grad(weighed)(tuple(_value(task.problem, number) for number in NUMBERS))


def _excess_there(tasks: Task, found: Found) -> Float[np.ndarray, "1"]:
    ratios = _ratios(take(tasks, 0), take(found, 0))
    return np.asarray([max(0.5 * (max(ratios.values()) ** 2 - 1), 0.0)])


def _value(problem: Problem, number: _Number) -> Float[Array, "*lanes"]:
    part = getattr(problem, number.of)
    return part if number.field is None else getattr(part, number.field)


def _with(problem: Problem, number: _Number, value: Float[Array, "*lanes"]) -> Problem:
    def where(p: Any) -> Any:
        return getattr(p, number.of) if number.field is None else getattr(getattr(p, number.of), number.field)

    return eqx.tree_at(where, problem, value)


def _size(problem: Problem, number: _Number) -> float:
    """What a number is measured by: the mean radius, or the turn itself."""
    if number.of == "turn":
        return abs(float(problem.turn))
    return (float(problem.start.radius) + float(problem.end.radius)) / 2
