"""Start the search for a route from random routes within the tube, too, after first steps of an optax optimiser.

The optimiser minimises an augmented Lagrangian (Powell, Hestenes, Rockafellar) with the constraints of the problem at
the nodes, as in `qtraj.design.tuning.first_order`, from all starts in one compiled function. The interior-point method
then continues from the best final points.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.tuning.methods import optimiser_of
from qtraj.design.tuning.problem import broadcasting
from qtraj.design.tuning_route.circuit import repeated
from qtraj.design.tuning_route.constraints import bounds, derivatives, values
from qtraj.design.tuning_route.problem import RouteProblem, Segments, joined, objective, segments

SEED = 20171993
WAVES = 4
"""A random shift is a sum of this number of half sine waves along the route."""

SIZES = (0.3, 0.9)
"""Range of the largest random shift, as a fraction of the smallest half-width of the tube."""

PACE = 0.1
"""Standard deviation of the random change of the duration, as a fraction of it."""

STEPS, ROUND = 500, 25
"""Number of steps, and number of steps after which the multipliers are updated."""

PENALTY = 10.0
"""The penalty parameter μ; objectives are divided by their size."""

LEAST = 1e-2
"""Smaller squares of values relative to limits count as this number, because their logarithm has no lower bound."""

NEARLY = 1e-2
"""Limits that are exceeded by less than this fraction count as satisfied, because the search continues."""

REFINED = 4
"""Number of final points from which the search continues."""

Starts = Float[np.ndarray, "starts joints 10"]


class Many(NamedTuple):
    """The number of starts of a search, and the optimiser for first steps, or None."""

    starts: int = 1
    optimiser: Any = None

    def begins(self, problem: RouteProblem) -> list[np.ndarray]:
        """Return the variables of starts in addition to the usual ones."""
        if self.starts == 1:
            return []
        shifted = random_starts(problem, self.starts - 1)
        if self.optimiser is None:
            return list(shifted)
        return list(first_steps(problem, shifted, self.optimiser))


def many(starts: Any, method: Any, limits: Limits) -> Many:
    """Return the starts for the arguments of `tune_route`; raise a ValueError for wrong ones."""
    if isinstance(starts, bool) or not isinstance(starts, int | np.integer) or starts < 1:
        raise ValueError(f"starts must be an integer, 1 or more, but {starts!r} was given")
    if isinstance(method, str) and method == "interior_point":
        return Many(int(starts))
    optimiser = optimiser_of(method, "interior_point")
    if starts == 1:
        raise ValueError(
            "an optax optimiser takes the first steps from many starts, but starts=1 was given: pass starts=64, for "
            "example, or omit method"
        )
    if any(obstacle.moves for obstacle in limits.keep_out or ()):
        raise ValueError("the first steps of an optax optimiser do not support obstacles that move: omit method")
    return Many(int(starts), optimiser)


def random_starts(problem: RouteProblem, count: int) -> Starts:
    """Return reproducible random lateral shifts within the tube, with their slopes, and random changes of the times."""
    rng, joints = np.random.default_rng(SEED), len(problem.free)
    x, orders = np.append(0.0, np.cumsum(problem.durations)), np.pi * np.arange(1, WAVES + 1)
    total = x[-1]
    x = x / total
    weights = rng.normal(size=(count, WAVES)) / np.arange(1, WAVES + 1)
    shift, slope = weights @ np.sin(np.outer(orders, x)), (orders * weights) @ np.cos(np.outer(orders, x)) / total
    width = np.sqrt(problem.tube[0].min())
    size = rng.uniform(*SIZES, (count, 1)) * width / np.abs(shift).max(axis=1, keepdims=True)
    z = np.zeros((count, joints, problem.free.shape[1]))
    z[:, :, 1], z[:, :, 4] = size * shift / problem.scale[1], size * slope / problem.scale[4]
    z[:, :, 9] = rng.normal(0, PACE, (count, 1)) * total * x / problem.scale[9]
    return np.where(problem.free, z, 0.0)


def first_steps(problem: RouteProblem, begins: Starts, optimiser: Any, steps: int = STEPS) -> Starts:
    """Return the best final points of the optimiser, which takes `steps` steps from every start."""
    width = float(np.sqrt(np.median(problem.tube[0])))
    scale = float(np.median([objective(problem, segments(problem, repeated(problem, z))) for z in begins]))
    with jax.enable_x64(True), broadcasting():  # optax mixes dtypes, too
        run = jax.jit(jax.vmap(lambda y: _searched(problem, optimiser, steps, width, scale, y)))
        end, cost, largest = (np.asarray(x) for x in run(begins / width))
    largest = np.nan_to_num(largest, nan=np.inf)
    order = np.lexsort((np.where(np.isfinite(cost), cost, np.inf), np.maximum(largest - NEARLY, 0.0)))
    return end[order[:REFINED]] * width


def _searched(problem: RouteProblem, optimiser: Any, steps: int, width: float, scale: float, y: Any) -> Any:
    """Return the final variables [half-widths of the tube] of one search, the objective, and the largest value."""

    def lagrangian(y: Any, m: Any) -> Any:
        cost, g = _evaluated(problem, y * width)
        above = jnp.maximum(m + PENALTY * g, 0.0)
        return cost / scale + jnp.sum(above**2 - m**2) / (2 * PENALTY), g

    differentiate = jax.value_and_grad(lagrangian, has_aux=True)

    def step(state: Any, k: Any) -> Any:
        y, memory, m = state
        (value, g), gradient = differentiate(y, m)
        gradient = jnp.where(problem.free, gradient, 0.0)
        updates, new = optimiser.update(
            gradient, memory, y, value=value, grad=gradient, value_fn=lambda y: lagrangian(y, m)[0]
        )
        multipliers = jnp.where((k + 1) % ROUND == 0, jnp.maximum(m + PENALTY * g, 0.0), m)
        after = (y + jnp.where(problem.free, updates, 0.0), new, multipliers)
        finite = jnp.isfinite(value) & jnp.all(jnp.isfinite(after[0]))
        return jax.tree.map(lambda new, old: jnp.where(finite, new, old).astype(old.dtype), after, state), None

    first = y, optimiser.init(y), jnp.zeros_like(_evaluated(problem, y)[1])
    (y, _, _), _ = jax.lax.scan(step, first, jnp.arange(steps))
    cost, g = _evaluated(problem, y * width)
    return y, cost, jnp.max(g)


def _evaluated(problem: RouteProblem, z: Any) -> Any:
    """Return the objective and, for each used constraint, a number that is at most 0 if the constraint is satisfied."""
    s = segments(problem, repeated(problem, z))
    of_limits = len(problem.names) - len(problem.clear)
    plain = problem._replace(names=problem.names[:of_limits], squares=problem.squares[:of_limits], clear=())
    found = values(_of_limits(plain, of_limits), s)
    ratio = 0.5 * jnp.log(jnp.maximum(found, LEAST))
    used = [problem.used[:of_limits], problem.used[-2:]]
    parts = [ratio[:of_limits][used[0]], ratio[of_limits:][used[1]]]
    if problem.clear:
        clear = joined(problem, [_entered(problem.part(k), s.part(k)) for k in problem.groups()])
        parts.append(clear[problem.used[of_limits:-2]])
    return objective(problem, s), jnp.concatenate([*parts, bounds(problem, s)[:, problem.moving > 0].ravel()])


def _entered(problem: RouteProblem, s: Segments) -> Any:
    """Return the constraint values of obstacles at the nodes of segments of one group (obstacles, nodes, n)."""
    r = derivatives(problem, s.ends)
    return jnp.stack([clear.value(tuple(r[:3]), tuple(r[3:6])) - 1.0 for clear in problem.clear])


def _of_limits(problem: RouteProblem, count: int) -> RouteProblem:
    """Return the problem with the data of its first limits only."""
    cut = {
        name: None if (x := getattr(problem, name)) is None else x[:count] for name in ("local", "shifts", "by_speed")
    }
    return problem._replace(**cut)
