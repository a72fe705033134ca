"""Searches with an optimiser of optax: many cheap steps, compiled by JAX for a whole batch.

The optimiser minimises an augmented Lagrangian (Powell, Hestenes, Rockafellar),

    cost + Σ (max(0, m + μg)² − m²)/(2μ),    g = ln(value/limit),

where the sum is over all limits at fixed nodes. After every `ROUND` steps, the multipliers m become max(0, m + μg). The
peaks between the nodes are not searched for, so the final points are not solutions: "sqp" continues from the best final
point of each problem.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.problem import broadcasting
from qtraj.design.tuning.search import AbstractSearch, Callback, Ends, Penalty
from qtraj.design.tuning.searches import Searches
from qtraj.design.tuning.sqp import SequentialQuadratic
from qtraj.design.tuning.task import Task, constraint_values
from qtraj.foundation import cores
from qtraj.foundation.types import Scalar

NODES = (1 - np.cos(np.linspace(0.0, np.pi, 33))) / 2
"""Fractions of the duration at which the limits are evaluated; they are denser at the ends, where peaks are common."""

ROUND = 25
"""Number of steps after which the multipliers are updated."""

PENALTY = 10.0
"""The penalty parameter μ; costs are of the order of 1."""

NEARLY = 1e-2
"""Limits that are exceeded by less than this fraction count as satisfied, because "sqp" continues the search."""

MAX_FRACTION = 1 - 1e-4
"""A start on a bound is moved to this fraction of the half-width from the centre; on the bound, ∂z/∂y would be zero."""

PerNode = Float[Array, "limits nodes"]


class FirstOrder(AbstractSearch):
    """The search with an optimiser of optax, which takes `steps` steps before `sqp` continues."""

    optimiser: Any = eqx.field(static=True)
    steps: int
    sqp: SequentialQuadratic

    @property
    def refined_by(self) -> SequentialQuadratic:
        """The method that continues from the final points."""
        return self.sqp

    @property
    def total_steps(self) -> int:
        """The maximum number of steps of one search."""
        return self.steps

    def search(
        self,
        searches: Searches,
        z: Float[np.ndarray, "n batch"],
        callback: Callback | None = None,
        penalty: Penalty = Penalty.USUAL,
    ) -> Ends:
        """Return the final points of a batch of searches, each from its own `z`."""
        task = Task(searches.problem, searches.limits, searches.low.T, searches.high.T)
        count = searches.count
        size = cores.block_size(count)
        parts = cores.split(np.arange(count), size)
        steps = np.asarray(self.steps, np.int32)
        calls = [(self.optimiser, steps, cores.take(task, part, size), cores.take(z.T, part, size)) for part in parts]
        found, done = [], 0
        for part, block in zip(parts, cores.map_blocks(_run, calls), strict=True):
            found.append(jax.tree.map(lambda x, part=part: x[: part.size], block))
            done += part.size
            if callback is not None:
                callback(done)
        end, cost, largest = jax.tree.map(lambda *x: np.concatenate(x), *found)
        largest = np.where(largest <= NEARLY, np.minimum(largest, 0.0), largest)
        taken = np.full(count, self.steps)
        return Ends(np.array(end.T), cost, largest, np.ones(count, bool), taken, np.ones(count))


class _State(NamedTuple):
    """The state of one search."""

    y: Float[Array, " n"]
    memory: Any  # of the optimiser
    multipliers: PerNode


@eqx.filter_jit
def _run(optimiser: Any, steps: Int[Any, ""], tasks: Task, z: Float[Any, "batch n"]) -> tuple[Array, Array, Array]:
    """Return the final variables of a batch of searches, their Lagrangians, and their largest constraint values."""
    with broadcasting():  # optax mixes dtypes, too
        tasks, z = jax.tree.map(jnp.asarray, (tasks, z))
        return jax.vmap(lambda task, z: _searched(optimiser, steps, task, z))(tasks, z)


def _searched(optimiser: Any, steps: Array, task: Task, z: Array) -> tuple[Array, Scalar, Scalar]:
    """Return the final variables of one search, its Lagrangian, and its largest constraint value."""
    nodes = jnp.broadcast_to(jnp.asarray(NODES), (len(task.limits), NODES.size))
    differentiate = jax.value_and_grad(lambda y, m: _lagrangian(task, nodes, y, m), has_aux=True)

    def step(k: Array, s: _State) -> _State:
        (value, g), gradient = differentiate(s.y, s.multipliers)
        updates, memory = optimiser.update(
            gradient,
            s.memory,
            s.y,
            value=value,
            grad=gradient,
            value_fn=lambda y: _lagrangian(task, nodes, y, s.multipliers)[0],
        )
        updates, memory = jax.tree.map(
            lambda new, old: jnp.asarray(new).astype(old.dtype), (updates, memory), (s.y, s.memory)
        )
        multipliers = jnp.where((k + 1) % ROUND == 0, jnp.maximum(s.multipliers + PENALTY * g, 0.0), s.multipliers)
        after = _State(s.y + updates, memory, multipliers)
        finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(after.y))
        return jax.tree.map(lambda new, old: jnp.where(finite, new, old), after, s)

    y = _from_box(task, jnp.clip(z, task.low, task.high))
    first = _State(y, optimiser.init(y), jnp.zeros(nodes.shape, y.dtype))
    end = jax.lax.fori_loop(0, steps, step, first)
    cost, g = _lagrangian(task, nodes, end.y, end.multipliers)
    return _to_box(task, end.y), cost, jnp.max(g, initial=-jnp.inf)


def _lagrangian(task: Task, nodes: PerNode, y: Array, m: PerNode) -> tuple[Scalar, PerNode]:
    """Return the augmented Lagrangian for the multipliers `m`, and the constraint values at the nodes."""
    z = _to_box(task, y)
    g = constraint_values(task, z, nodes)
    multiplier = jnp.maximum(m + PENALTY * g, 0.0)
    return task.problem.cost(z) + jnp.sum(multiplier**2 - m**2) / (2 * PENALTY), g


def _to_box(task: Task, y: Array) -> Array:
    """Return z = c + r sin((y − c)/r), with the centre c and the half-width r of the bounds, which any y satisfies."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    return middle + half * jnp.sin((y - middle) / jnp.where(half > 0, half, 1.0))


def _from_box(task: Task, z: Array) -> Array:
    """Return y for the variables z; variables on a bound are moved slightly inside."""
    middle, half = (task.low + task.high) / 2, (task.high - task.low) / 2
    safe = jnp.where(half > 0, half, 1.0)
    return middle + safe * jnp.arcsin(jnp.clip((z - middle) / safe, -MAX_FRACTION, MAX_FRACTION))
