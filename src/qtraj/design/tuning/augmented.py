"""Augmented Lagrangian (Powell–Hestenes–Rockafellar) over the cells of a time grid, minimised by optax's L-BFGS.

Time is divided into cells, and every limit is a constraint on its largest excess in each cell (see `peaks`), each with
its own multiplier: what is held in the cells is held between the nodes.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.limits import Limits
from qtraj.design.magnitudes import squared
from qtraj.design.peaks import cell_peaks
from qtraj.design.tuning.campaign import Found
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.design.tuning.rows import find_peaks
from qtraj.design.tuning.sqp import FEASIBLE
from qtraj.design.tuning.task import Task
from qtraj.foundation.types import Flag, Scalar
from qtraj.path.spiral_helix import SpiralHelix

CELLS = 65
INNER_STEPS, MEMORY, GRADIENT_TOLERANCE = 200, 12, 1e-9

FIRST_PENALTY, PENALTY_GROWTH = 10.0, 4.0
HIGHEST_PENALTY = 1e9
SUFFICIENT_DECREASE = 0.25  # of the violation in one round; less, and the penalty grows
HOPELESS_DECREASE, HOPELESS_ROUNDS = 0.9, 6  # this little decrease for so many rounds, and the search gives up

STATIONARY = 1e-6
"""Largest component of the Lagrangian's gradient at a converged point, in the problem's own scale."""

PerCell = dict[str, Float[Array, " cells"]]
NEAR = 1 - 1e-9  # of the way to a bound

_Carry = tuple[Variables, Any, Scalar, Flag, Array]


class Boxed(eqx.Module):
    """A problem in variables y without bounds: z = m + r tanh((y − m)/r) between the bounds m ± r."""

    problem: Problem
    low: Variables
    high: Variables

    def inside(self, y: Variables) -> Variables:
        """z of y."""
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        safe = jnp.where(half > 0, half, 1.0)
        return middle + half * jnp.tanh((y - middle) / safe)

    def outside(self, z: Variables) -> Variables:
        """y of z; of a z at a bound, one near it."""
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        safe = jnp.where(half > 0, half, 1.0)
        return middle + safe * jnp.arctanh(jnp.clip((z - middle) / safe, -NEAR, NEAR))

    def path(self, y: Variables) -> SpiralHelix:
        """The path of these variables."""
        return self.problem.path(self.inside(y))

    def cost(self, y: Variables) -> Scalar:
        """The objective over its scale."""
        return self.problem.cost(self.inside(y))


class Iterate(NamedTuple):
    """Where the method stands: variables, multipliers and penalty, with the size of what is still wrong."""

    z: Variables
    multipliers: PerCell
    penalty: Scalar
    cost: Scalar
    violation: Scalar  # largest relative excess over a limit
    gradient: Scalar  # largest component of the Lagrangian's gradient
    steps: Array  # L-BFGS steps taken so far


def search(task: Task, z: Variables, most_rounds: int, tell: Callable[[str], None] | None) -> Found:
    """Where rounds from `z` end: the limits met at a stationary point, or not."""
    boxed = Boxed(task.problem, task.low, task.high)
    last, settled = _solve(boxed, task.limits, boxed.outside(z), most_rounds, tell)
    z = boxed.inside(last.z)
    # Advice starts from the peaks of the other method, whose multipliers it finds itself.
    peaks = find_peaks(task.problem.without_objective(), task.limits, z)
    settled_at = jnp.asarray(settled)
    return Found(z, jnp.zeros_like(peaks.time), peaks.time, last.violation, settled_at, last.steps)


def begin(problem: Boxed, limits: Limits, z: Variables) -> Iterate:
    """The iterate at `z`, with nothing learnt yet."""
    g, cost = survey(problem, limits, z)
    none = {name: jnp.zeros_like(v) for name, v in g.items()}
    unknown = jnp.full_like(cost, jnp.inf)
    return Iterate(z, none, jnp.full_like(cost, FIRST_PENALTY), cost, worst(g), unknown, jnp.asarray(0))


def _solve(
    problem: Boxed, limits: Limits, z: Variables, max_rounds: int, tell: Callable[[str], None] | None
) -> tuple[Iterate, bool]:
    """Rounds until the limits are met at a stationary point (True), or until there is little hope of it (False)."""
    iterate = begin(problem, limits, z)
    hopeless = 0
    for count in range(1, max_rounds + 1):
        before = float(iterate.violation)
        last, iterate = iterate, advance(problem, limits, iterate)
        violation = float(iterate.violation)
        if tell is not None:
            tell(f"round {count}, " + ("limits met" if violation == 0 else f"limits broken by {100 * violation:.2g} %"))
        if violation <= FEASIBLE and float(iterate.gradient) <= STATIONARY:
            return iterate, True
        if not math.isfinite(violation):
            return last, False
        hopeless = hopeless + 1 if violation > HOPELESS_DECREASE * before else 0
        if hopeless >= HOPELESS_ROUNDS or float(iterate.penalty) > HIGHEST_PENALTY:
            break
    return iterate, False


def advance(problem: Boxed, limits: Limits, iterate: Iterate) -> Iterate:
    """One round: minimise the augmented Lagrangian in z, then move multipliers and penalty."""
    z, gradient, steps = _descend(problem, limits, iterate)
    g, cost = survey(problem, limits, z)
    violation = worst(g)
    multipliers = {name: jnp.maximum(0.0, m + iterate.penalty * g[name]) for name, m in iterate.multipliers.items()}
    stalled = violation > SUFFICIENT_DECREASE * iterate.violation
    penalty = jnp.where(stalled, PENALTY_GROWTH, 1.0) * iterate.penalty
    return Iterate(z, multipliers, penalty, cost, violation, gradient, iterate.steps + steps)


@eqx.filter_jit
def survey(problem: Boxed, limits: Limits, z: Variables) -> tuple[PerCell, Scalar]:
    """The excesses over the limits and the cost."""
    return excesses(problem, limits, z, worst_times(problem, limits, z)), problem.cost(z)


@eqx.filter_jit
def _descend(problem: Boxed, limits: Limits, iterate: Iterate) -> tuple[Variables, Scalar, Array]:
    """Minimise cost + Σ (max(0, m + penalty·g)² − m²)/(2·penalty) over the cells."""

    def lagrangian(z: Variables, times: PerCell) -> Scalar:
        g = excesses(problem, limits, z, times)
        m, penalty = iterate.multipliers, iterate.penalty
        terms = [jnp.sum(jnp.maximum(0.0, m[name] + penalty * g[name]) ** 2 - m[name] ** 2) for name in g]
        return problem.cost(z) + sum(terms) / (2 * penalty)

    return _minimise(lagrangian, lambda z: worst_times(problem, limits, z), iterate.z)


def worst_times(problem: Boxed, limits: Limits, z: Variables) -> PerCell:
    """Where in each cell each limit is exceeded most, as fractions of the duration."""
    path = problem.path(z)
    return {name: cell_peaks(partial(squared, name=name), path, CELLS) for name in limits.given()}


def excesses(problem: Boxed, limits: Limits, z: Variables, times: PerCell) -> PerCell:
    """g = ½((value/limit)² − 1) at the given fractions: zero on the limit, smooth where the value vanishes."""
    path = problem.path(z)

    def excess(name: str, limit: Scalar) -> Float[Array, " cells"]:
        values = jax.vmap(lambda u: squared(path, u * path.duration, name))(times[name])
        return 0.5 * (values / limit**2 - 1.0)

    return {name: excess(name, limit) for name, limit in limits.given().items()}


def worst(g: PerCell) -> Scalar:
    """The largest excess, or zero where nothing is exceeded."""
    return jnp.max(jnp.stack([jnp.max(jnp.maximum(0.0, v)) for v in g.values()]))


def _minimise(
    f: Callable[[Variables, PerCell], Scalar], times_at: Callable[[Variables], PerCell], z: Variables
) -> tuple[Variables, Scalar, Array]:
    """L-BFGS with a zoom line search, until the gradient vanishes or no step helps: (z, gradient, steps).

    The times of the peaks stand still during one line search: they move the value only to second order, and sought
    once a step they cost little.
    """
    import optax  # here, so that importing qtraj does not wait for it

    solver = optax.lbfgs(memory_size=MEMORY)

    def proceed(carry: _Carry) -> _Carry:
        z, state, _, _, count = carry
        times = times_at(z)
        value, gradient = jax.value_and_grad(f)(z, times)
        updates, state = solver.update(gradient, state, z, value=value, grad=gradient, value_fn=lambda z: f(z, times))
        moved = jnp.asarray(optax.apply_updates(z, updates))
        return moved, state, jnp.max(jnp.abs(gradient)), jnp.all(moved == z), count + 1

    def unfinished(carry: _Carry) -> Flag:
        _, _, size, stuck, count = carry
        return (size > GRADIENT_TOLERANCE) & ~stuck & (count < INNER_STEPS)

    start = (z, solver.init(z), jnp.asarray(jnp.inf, z.dtype), jnp.asarray(False), jnp.asarray(0))
    with jax.numpy_dtype_promotion("standard"):  # optax mixes widths of integers, which a strict session refuses
        z, _, size, _, count = jax.lax.while_loop(unfinished, proceed, start)
    return z, size, count
