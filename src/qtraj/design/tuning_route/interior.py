"""Tune a route by a primal-dual interior-point method in one compiled loop.

The inequalities g(z) ≤ 0 are written as g(z) + s = 0 with slacks s. A logarithmic barrier with the parameter μ → 0
keeps the slacks positive (Nocedal and Wright, *Numerical Optimization*, chapter 19; Wächter and Biegler,
*Math. Program.* 106, 2006, sections 2 and 3). Second derivatives are exact. If the matrix is not positive definite, a
multiple of the identity is added. A line search on the merit function f − μΣ ln s + ν Σ|g + s|, with the objective f
and the penalty ν, ensures progress.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning_route.constraints import Names
from qtraj.design.tuning_route.margins import refreshed
from qtraj.design.tuning_route.newton import Iterate, Linear, Rows, Step, excess_of, linearise, newton, used
from qtraj.design.tuning_route.problem import RouteProblem, objective, segments
from qtraj.foundation.types import Scalar

TOLERANCE = 1e-7
"""The search ends if no residual of the optimality conditions is larger than this."""

LEAST_SLACK = 0.1
"""Lower bound on the initial slacks."""

SHIFT, MOST_SHIFT = 1e-6, 1e10
"""The first and the largest multiple of the identity that is added to the second derivatives."""

HALVINGS = 14

SUFFICIENT = 1e-4

CAP = 1e10
"""Multipliers stay within this factor of μ/s, the barrier parameter divided by the slack."""

RENEWED, RENEWALS = 1e-2, 60
"""Margins are updated if the barrier parameter is below `RENEWED`, at most `RENEWALS` times. The search does not
end before the margins have converged, because otherwise another search would be needed."""

FREE = 8
"""After this number of updates margins may only decrease, so that they converge."""

HARMLESS = 0.5
"""A margin may change by this fraction of the slack without an effect on the barrier parameter."""

LAG = 0.1
"""The barrier parameter does not become smaller than this fraction of the largest change of a margin."""

SETTLED, NEAR = 5e-6, 0.1
"""Margins are not updated again if the barrier parameter has its final value, and if all margins of constraints with
slacks below `NEAR` change by at most `SETTLED`."""


class Search(NamedTuple):
    """The state of the loop; it is `done` if the tolerance is reached, and `stuck` if no step makes progress."""

    at: Iterate
    mu: Scalar
    shift: Scalar
    penalty: Scalar
    error: Scalar
    steps: Int[Array, ""]
    renewals: Int[Array, ""]
    done: Bool[Array, ""]
    stuck: Bool[Array, ""]


def start(names: Names, problem: RouteProblem, z: Float[Array, "10 joints"], margins: Any, mu: Any) -> Iterate:
    """Return the first iterate; slacks are computed from the constraints, and multipliers from the slacks."""
    excess = excess_of(names, problem, segments(problem, z), margins)
    count = used(problem)
    slacks = jax.tree.map(lambda g, u: jnp.where(u > 0, jnp.maximum(-g, LEAST_SLACK), 1.0), excess, count)
    return Iterate(z, slacks, jax.tree.map(lambda s, u: u * mu / s, slacks, count), margins)


def _size(x: Any) -> Scalar:
    return jnp.max(jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(x)]))


def residual(problem: RouteProblem, at: Iterate, linear: Linear, mu: Any) -> Scalar:
    """Return the largest residual of the optimality conditions for the barrier parameter `mu`."""
    count = used(problem)
    gaps = jax.tree.map(lambda g, s, u: (g + s) * u, linear.excess, at.slacks, count)
    products = jax.tree.map(lambda s, m, u: (s * m - mu) * u, at.slacks, at.multipliers, count)
    mean = sum(jnp.sum(m) for m in at.multipliers) / jnp.maximum(sum(jnp.sum(u) for u in count), 1.0)
    scale = jnp.maximum(mean, 1.0)
    return jnp.maximum(jnp.maximum(_size(linear.residual) / scale, _size(gaps)), _size(products) / scale)


def _merit(problem: RouteProblem, z: Any, excess: Rows, slacks: Rows, mu: Any, penalty: Any) -> Scalar:
    count = used(problem)
    barrier = sum(jnp.sum(u * jnp.log(s)) for u, s in zip(count, slacks, strict=True))
    gap = sum(jnp.sum(u * jnp.abs(g + s)) for u, g, s in zip(count, excess, slacks, strict=True))
    return objective(problem, z) - mu * barrier + penalty * gap


def _inside(problem: RouteProblem, excess: Rows, margins: Any) -> Bool[Array, ""]:
    """Return whether all limits, without margins, and the tube are satisfied at the nodes."""
    return jnp.all(excess.nodes + (margins - 1) * problem.used <= 0) & jnp.all(excess.bounds <= 0)


def _shifted_step(names: Names, problem: RouteProblem, search: Search, linear: Linear) -> tuple[Step, Scalar]:
    """Increase the shift until the matrix is positive definite; return the Newton step and the shift."""

    def again(carry: tuple[Step, Scalar, Scalar]) -> Any:
        step, shift, _ = carry
        return ~step.positive & (shift < MOST_SHIFT)

    def attempt(carry: tuple[Step, Scalar, Scalar]) -> Any:
        _, _, shift = carry
        following = jnp.where(shift > 0, shift * 8.0, jnp.maximum(SHIFT, search.shift / 3))
        return newton(names, problem, search.at, linear, search.mu, shift), shift, following

    zero = jnp.zeros_like(search.mu)
    none = Step(search.at.z, search.at.slacks, search.at.multipliers, zero, zero, zero > 0)
    step, shift, _ = jax.lax.while_loop(again, attempt, (none, zero, zero))
    return step, shift


def longest(values: Rows, changes: Rows, keep: Any) -> Scalar:
    """Return the largest step size, at most 1, that reduces no positive value by more than the fraction `keep`."""
    parts = [
        jnp.min(jnp.where(d < 0, -keep * v / jnp.where(d < 0, d, -1.0), 1.0))
        for v, d in zip(values, changes, strict=True)
    ]
    return jnp.minimum(1.0, jnp.minimum(*parts))


def _moved(tree: Any, change: Any, part: Any) -> Any:
    return jax.tree.map(lambda x, d: x + part * d, tree, change)


def _iteration(names: Names, problem: RouteProblem, search: Search, factor: Any, least: Any, inside: Any) -> Search:
    at, count = search.at, used(problem)
    linear = linearise(names, problem, at)
    error = residual(problem, at, linear, 0.0)
    done = (error <= jnp.maximum(TOLERANCE, 10 * least)) & (search.mu <= least)
    close = residual(problem, at, linear, search.mu) <= 10 * search.mu
    renew = close & (search.mu < RENEWED) & (search.renewals < RENEWALS)
    margins = jax.lax.cond(renew, lambda: refreshed(names, problem, at.z, at.margins) * factor, lambda: at.margins)
    margins = jnp.where(search.renewals >= FREE, jnp.minimum(margins, at.margins), margins)
    # New margins change the constraints by up to `jump`; with much smaller slacks the next step would be too short.
    # A constraint with a much larger slack is not affected, and must not delay the others.
    changes = jnp.abs(margins - at.margins) * problem.used
    jump = jnp.max(jnp.where(changes > HARMLESS * at.slacks.nodes, changes, 0.0))
    near = jnp.max(jnp.where(at.slacks.nodes < NEAR, changes, 0.0))
    settled = (near <= jnp.maximum(SETTLED, least)) & (search.mu <= least)
    margins = jnp.where(settled, at.margins, margins)
    renewals = jnp.where(renew, jnp.where(settled, RENEWALS, search.renewals + 1), search.renewals)
    smaller = jnp.maximum(least, jnp.minimum(0.2 * search.mu, search.mu**1.5))
    smaller = jnp.maximum(smaller, jnp.where(renew & ~settled, jnp.minimum(LAG * jump, search.mu), 0.0))
    done &= ~renew | settled
    mu = jnp.where(close, smaller, search.mu)
    nodes = linear.excess.nodes + (at.margins - margins) * problem.used
    linear = linear._replace(excess=linear.excess._replace(nodes=nodes))
    at = at._replace(margins=margins)
    search = search._replace(at=at, mu=mu)
    step, shift = _shifted_step(names, problem, search, linear)

    gap = sum(jnp.sum(u * jnp.abs(g + s)) for u, g, s in zip(count, linear.excess, at.slacks, strict=True))
    needed = (step.slope + 0.5 * step.curvature) / (0.9 * jnp.where(gap > 0, gap, 1.0))
    penalty = jnp.where(gap > 1e-14, jnp.maximum(search.penalty, needed), search.penalty)
    slope = step.slope - penalty * gap
    keep = jnp.maximum(0.99, 1.0 - mu)
    part = longest(at.slacks, step.slacks, keep)
    initial = _merit(problem, at.z, linear.excess, at.slacks, mu, penalty)

    bounded = inside & _inside(problem, linear.excess, margins)

    def trial(part: Any) -> tuple[Array, Rows, Scalar]:
        z, slacks = at.z + part * step.z, _moved(at.slacks, step.slacks, part)
        excess = excess_of(names, problem, segments(problem, z), margins)
        slacks = jax.tree.map(reset, slacks, excess, at.slacks, count)
        merit = _merit(problem, z, excess, slacks, mu, penalty)
        return z, slacks, jnp.where(bounded & ~_inside(problem, excess, margins), jnp.inf, merit)

    def reset(slack: Array, g: Array, before: Array, u: Array) -> Array:
        """Set the slack s of a clearly satisfied constraint to −g, so that |g + s| is zero in the merit function."""
        exact = -g > jnp.maximum(mu / penalty, 0.01 * before)
        return jnp.where(u > 0, jnp.where(exact, -g, slack), 1.0)

    def fails(carry: Any) -> Any:
        part, (_, _, merit), k = carry
        bound = initial + SUFFICIENT * part * slope + 1e-13 * jnp.abs(initial)
        return ~(merit <= bound) & (k <= HALVINGS)

    def shorter(carry: Any) -> Any:
        part, _, k = carry
        part = jnp.where(k > 0, 0.5 * part, part)
        return part, trial(part), k + 1

    unknown = (at.z, at.slacks, jnp.full_like(mu, jnp.inf))
    _, (z, slacks, merit), tried = jax.lax.while_loop(fails, shorter, (part, unknown, 0))
    failed = (tried > HALVINGS) | ~jnp.isfinite(merit) | ~step.positive
    dual = longest(at.multipliers, step.multipliers, keep)
    multipliers = _moved(at.multipliers, step.multipliers, dual)
    multipliers = jax.tree.map(
        lambda m, s, u: u * jnp.clip(m, mu / (CAP * s), CAP * mu / s), multipliers, slacks, count
    )
    stopped = done | failed
    kept = jax.tree.map(lambda a, b: jnp.where(stopped, a, b), search.at, Iterate(z, slacks, multipliers, margins))
    return Search(
        kept, mu, shift, penalty, error, search.steps + jnp.where(stopped, 0, 1), renewals, done, failed & ~done
    )


def solve(
    names: Names,
    problem: RouteProblem,
    at: Iterate,
    factor: Any,
    mu: Any,
    least: Any,
    most: Any,
    renewals: Any,
    inside: Any,
) -> Search:
    """Search from an iterate, decreasing the barrier parameter from `mu` to `least`, in at most `most` steps.

    `names` are the limits in the order of `problem.squares`. Margins are multiplied by `factor` < 1. The count of their
    updates starts at `renewals`. With `inside`, once an iterate satisfies the limits at the nodes, all later iterates
    satisfy them there, too.
    """
    one = jnp.ones_like(problem.durations[0])
    first = Search(
        at, mu * one, 0 * one, one, jnp.inf * one, 0 * jnp.asarray(most), jnp.asarray(renewals), one < 0, one < 0
    )

    def running(search: Search) -> Any:
        return ~search.done & ~search.stuck & (search.steps < most)

    return jax.lax.while_loop(running, lambda search: _iteration(names, problem, search, factor, least, inside), first)
