"""Compute a Newton step of the interior-point method: linearise the optimality conditions at the current iterate."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from qtraj.design.tuning_route import assembly, basis, chain, circuit
from qtraj.design.tuning_route.assembly import Local
from qtraj.design.tuning_route.basis import lifted
from qtraj.design.tuning_route.constraints import Expansion, Names, distances, expand, orders, values
from qtraj.design.tuning_route.problem import RouteProblem, Segments, by_blocks, moved, powers, segments
from qtraj.foundation.types import Scalar


class Rows(NamedTuple):
    """One number for each constraint: for the constraints at the nodes, and for the two bounds on each duration."""

    nodes: Float[Array, "constraints nodes n"]
    bounds: Float[Array, "2 n"]


class Iterate(NamedTuple):
    """The variables, slacks and multipliers, and the tightened bounds `margins` (at most 1) on quantity/limit."""

    z: Float[Array, "10 joints"]
    slacks: Rows
    multipliers: Rows
    margins: Float[Array, "constraints nodes n"]


class Step(NamedTuple):
    """A Newton step.

    `z` are the changes of the variables. `slope` is the derivative of the barrier function along the step, and
    `curvature` is zᵀHz, where H is the matrix of the linear system. `positive` is true if H is positive definite.
    """

    z: Float[Array, "10 joints"]
    slacks: Rows
    multipliers: Rows
    slope: Scalar
    curvature: Scalar
    positive: Bool[Array, ""]


class Linear(NamedTuple):
    """The values and derivatives at an iterate from which its Newton steps are computed.

    `slopes` and `away` are fields of `Expansion`, `excess` are the constraint values, `gradient` is the gradient of the
    objective, and `residual` the gradient of the Lagrangian. `hessian` is the matrix of the linear system.
    """

    segments: Segments
    slopes: Float[Array, "q limits nodes n"]
    away: Float[Array, "3 nodes n"]
    excess: Rows
    gradient: Float[Array, "10 joints"]
    residual: Float[Array, "10 joints"]
    hessian: chain.Chain


def used(problem: RouteProblem) -> Rows:
    """Return 1 for the constraints that are used, and 0 for the others."""
    return Rows(problem.used, jnp.stack([problem.moving] * 2))


def excess_of(names: Names, problem: RouteProblem, s: Segments, margins: Any) -> Rows:
    """Return the values g of the constraints g ≤ 0, and 0 for unused constraints."""
    nodes = (values(names, problem, s) - margins) * problem.used
    return Rows(nodes, _bounds(problem, s))


def _bounds(problem: RouteProblem, s: Segments) -> Array:
    return jnp.stack([1 - s.h / problem.shortest, s.h / problem.longest - 1]) * problem.moving[None]


class _Local(NamedTuple):
    """The results of `linearise` that depend on one segment only."""

    values: Float[Array, "constraints nodes n"]
    slopes: Float[Array, "q limits nodes n"]
    away: Float[Array, "3 nodes n"]
    gradient: Float[Array, "20 n"]
    residual: Float[Array, "20 n"]
    hessian: Float[Array, "20 20 n"]


def linearise(names: Names, problem: RouteProblem, at: Iterate) -> Linear:
    """Return the values and derivatives at an iterate. The multipliers of unused constraints must be zero."""
    s = segments(problem, at.z)
    stiffness = jax.tree.map(lambda a, b: a / b, at.multipliers, at.slacks)

    def local(problem: RouteProblem, s: Segments, weights: Rows, stiffness: Rows) -> _Local:
        expansion = expand(names, problem, s, weights.nodes)
        own, weighted = assembly.objective_first(problem, s), _first(problem, expansion, weights)
        first = jax.tree.map(jnp.add, own, weighted)
        second = assembly.constraints_second(problem, expansion, weights.nodes, stiffness.nodes)
        low, high = stiffness.bounds
        second = second._replace(h=second.h + low / problem.shortest**2 + high / problem.longest**2)
        second = jax.tree.map(jnp.add, second, assembly.objective_second(problem, s))
        return _Local(
            expansion.values,
            expansion.slopes,
            expansion.away,
            assembly.segment_gradient(problem, s, own),
            assembly.segment_gradient(problem, s, first),
            assembly.segment_hessian(problem, s, first, second),
        )

    found = by_blocks(local, problem, s, at.multipliers, stiffness)
    excess = Rows((found.values - at.margins) * problem.used, _bounds(problem, s))
    return Linear(
        s,
        found.slopes,
        found.away,
        excess,
        assembly.gradient(problem, found.gradient),
        assembly.gradient(problem, found.residual),
        assembly.hessian(problem, found.hessian),
    )


def _first(problem: RouteProblem, at: Expansion | Linear, weights: Rows) -> Local:
    found = assembly.constraints_first(problem, at.slopes, at.away, weights.nodes)
    low, high = weights.bounds
    return found._replace(h=found.h - low / problem.shortest + high / problem.longest)


def constraint_gradient(problem: RouteProblem, linear: Linear, weights: Rows) -> Float[Array, "10 joints"]:
    """Return the gradient of the weighted sum of the constraints."""
    s = linear.segments
    return assembly.gradient(problem, assembly.segment_gradient(problem, s, _first(problem, linear, weights)))


def _pushed(problem: RouteProblem, linear: Linear, dz: Array, order: int) -> Rows:
    s, at = linear.segments, linear
    states, dh = moved(problem, dz)
    power = jnp.asarray(basis.POWERS, dz.dtype)[:, None, None]
    ends = powers(s.h) * states + power * s.ends * lifted(dh / s.h, 3)
    change = Segments(dh, states, ends, ends)
    table = basis.at_nodes(basis.NODES, order)[1:].reshape(-1, 6)
    rows = (table @ ends.reshape(6, -1)).reshape(order, len(basis.NODES), 3, -1)
    rows = jnp.moveaxis(rows, 2, 1).reshape(3 * order, len(basis.NODES), -1)
    q = jnp.concatenate([rows, jnp.broadcast_to(lifted(dh, 3), rows[:1].shape)])
    limits = jnp.sum(at.slopes * q[:, None], axis=0)
    away = 2 * at.away * distances(change, basis.NODES, jnp.zeros_like(at.away))
    near = jnp.stack([away[0] + away[1], away[2]]) / problem.tube
    nodes = jnp.concatenate([limits, near]) * problem.used
    bounds = jnp.stack([-dh / problem.shortest, dh / problem.longest]) * problem.moving[None]
    return Rows(nodes, bounds)


def newton(names: Names, problem: RouteProblem, at: Iterate, linear: Linear, mu: Scalar, shift: Scalar) -> Step:
    """Compute the Newton step for the barrier parameter `mu`; `shift` is added to the diagonal of the matrix."""
    count = used(problem)
    gaps = jax.tree.map(lambda g, s, u: (g + s) * u, linear.excess, at.slacks, count)
    target = jax.tree.map(lambda m, s, g, u: u * (mu + m * g) / s, at.multipliers, at.slacks, gaps, count)
    right = -(linear.gradient + constraint_gradient(problem, linear, target))
    whole = chain.shifted(linear.hessian, shift * problem.free.T)
    dz, positive = chain.solve(whole, right.T)
    curvature = jnp.sum(dz * chain.product(whole, dz))
    dz = circuit.repeated(problem, dz.T)
    along = _pushed(problem, linear, dz, orders(names))
    slacks = jax.tree.map(lambda g, a: -g - a, gaps, along)
    change = jax.tree.map(lambda m, s, ds, u: u * ((mu - m * ds) / s - m), at.multipliers, at.slacks, slacks, count)
    barrier = sum(jnp.sum(u * ds / s) for u, ds, s in zip(count, slacks, at.slacks, strict=True))
    slope = jnp.sum(linear.gradient * dz) - mu * barrier
    good = positive & jnp.isfinite(slope) & jnp.isfinite(curvature)
    return Step(dz, slacks, change, slope, curvature, good)
