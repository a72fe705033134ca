"""Compute the fastest timing by a primal-dual interior-point method: minimise ∫ du/√a under constraints at all nodes.

Here u is the path parameter and a = u̇². The method is Mehrotra's predictor–corrector with slack variables (Nocedal and
Wright, Numerical Optimization, chapter 19). Iterates need not satisfy the constraints. So a search can start at an
infeasible point, and limits can be tightened between searches. The matrix of each step is a band matrix with three
subdiagonals.
"""

from types import ModuleType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float, Int

from qtraj.design.timing import banded, banded_batch
from qtraj.design.timing.constraints import (
    Constraints,
    Gradients,
    changes,
    gradients,
    second_derivatives,
    values,
    weighted,
)
from qtraj.design.timing.spline import Nodes, at_nodes, gathered, gathered_band
from qtraj.foundation.types import Flag, Scalar

BOUNDARY, POSITIVE = 0.99, 0.9
"""Largest fractions of the distance to zero that a step may cover, for slacks and multipliers, and for a = u̇²."""

BALANCE = 0.001
"""The target of the duality gap is at least this fraction of the residuals, so that both converge together."""

VIOLATED = 1e-6
"""The largest violation of a constraint, relative to its limit, at which a search may end."""

SLACK = 1.0
"""The smallest initial slack. With smaller slacks, the first steps would be short."""

MAX_STEPS = 100


class Program(NamedTuple):
    """The problem: nodes, weights of the integral at the nodes [s], constraints, and upper bounds `largest` on a = u̇².

    A value near `largest` means that no limit bounds the speed (see `boundedness`).
    """

    nodes: Nodes
    weights: Float[Array, "2 cells+1"]
    constraints: Constraints
    largest: Float[Array, "2 cells+1"]

    def at_nodes(self, coefficients: Float[Array, " cells+3"]) -> Float[Array, "orders 2 cells+1"]:
        """Return a = u̇² at the nodes, and the derivatives of a that the constraints contain."""
        return at_nodes(self.nodes, coefficients, self.constraints.orders)


class State(NamedTuple):
    """An iterate: coefficients, slacks, multipliers, the number of steps, and the relative optimality error."""

    coefficients: Float[Array, " cells+3"]
    slacks: Float[Array, "count 2 cells+1"]
    multipliers: Float[Array, "count 2 cells+1"]
    steps: Int[Array, ""]
    error: Scalar


def begun(p: Program, coefficients: Float[Array, " cells+3"]) -> State:
    """Return the first iterate; its duality gap equals its duration."""
    v = p.at_nodes(coefficients)
    slacks = jnp.maximum(-values(p.constraints, v), SLACK)
    return _unfinished(coefficients, slacks, duration(p, v) / slacks.size / slacks)


def continued(p: Program, s: State) -> State:
    """Return an iterate for constraints that were tightened after a search.

    Slacks and multipliers that are almost zero are increased, because they would make the next steps short.
    """
    violations = values(p.constraints, p.at_nodes(s.coefficients))
    slacks = jnp.maximum(jnp.maximum(s.slacks, -violations), jnp.max(violations))
    return _unfinished(
        s.coefficients, slacks, jnp.maximum(s.multipliers, jnp.mean(slacks * s.multipliers) / slacks), s.steps
    )


def _unfinished(coefficients: Array, slacks: Array, multipliers: Array, steps: Array | None = None) -> State:
    count = jnp.zeros((), jnp.int32) if steps is None else steps
    return State(coefficients, slacks, multipliers, count, jnp.full((), jnp.inf, coefficients.dtype))


def solve(program: Program, start: State, enough: Scalar) -> State:
    """Compute the optimal coefficients; stop if the optimality error is below `enough`, or after `MAX_STEPS` steps."""

    def goes_on(s: State) -> Flag:
        return (s.error >= enough) & (s.steps < start.steps + MAX_STEPS)

    return jax.lax.while_loop(goes_on, lambda s: _step(program, s, enough), start)


def duration(p: Program, v: Float[Array, "orders 2 cells+1"]) -> Scalar:
    """Return the duration ∫ du/√a [s], where a = u̇²."""
    return jnp.sum(p.weights * _positive(p, v) ** -0.5)


def _positive(p: Program, v: Float[Array, "orders 2 cells+1"]) -> Float[Array, "2 cells+1"]:
    """Return a = u̇² at the nodes, or 1 at nodes at rest; nodes at rest have the weight zero."""
    return jnp.where(p.nodes.standing > 0, 1.0, v[0])


class _Change(NamedTuple):
    """The changes of the coefficients, slacks and multipliers, and of the values at the nodes."""

    coefficients: Float[Array, " cells+3"]
    slacks: Float[Array, "count 2 cells+1"]
    multipliers: Float[Array, "count 2 cells+1"]
    values: Float[Array, "orders 2 cells+1"]


@custom_vmap
def _step(p: Program, s: State, enough: Scalar) -> State:
    return _step_with(banded, p, s, enough)


@_step.def_vmap
def _step_of_batch(size: int, batched: Any, *given: Any) -> tuple[State, State]:
    """Compute a step for each problem of a batch, with the linear solver for batches."""
    axes = jax.tree.map(lambda own: 0 if own else None, batched)
    found = jax.vmap(lambda *own: _step_with(banded_batch, *own), axes, axis_size=size)(*given)
    return found, jax.tree.map(lambda _: True, found)


def _step_with(linear: ModuleType, p: Program, s: State, enough: Scalar) -> State:
    """Return the next iterate; `linear` is the module that solves the linear system."""
    v, z = p.at_nodes(s.coefficients), s.multipliers
    a, slope, violations = _positive(p, v), gradients(p.constraints, v), values(p.constraints, v)
    inverse, inv_slacks, inv_multipliers = 1 / a, 1 / s.slacks, 1 / z
    pace = p.weights * jnp.sqrt(inverse)
    cost_slope = -0.5 * pace * inverse
    ratio = z * inv_slacks
    band = factored(linear, p, _curvature(p, v, z, ratio, a))
    mean, time = jnp.mean(s.slacks * z), jnp.sum(pace)
    residual = violations + s.slacks
    gradient = _gradient(p, cost_slope, slope, z)
    least = BALANCE / z.size * (jnp.sum(jnp.abs(gradient * s.coefficients)) + jnp.sum(jnp.abs(residual) * z))

    def newton(state: tuple[Array, Array, _Change], _: Any) -> tuple[tuple[Array, Array, _Change], None]:
        """Return the Newton step for slack · multiplier = target, and the next target; the first is the predictor."""
        target, off, _ = state
        dc = -solved(linear, band, _gradient(p, cost_slope, slope, target * inv_slacks + ratio * off))
        dv = p.at_nodes(dc)
        rise = changes(slope, dv)
        ds = -off - rise
        dz = target * inv_slacks - z - ratio * ds
        primal, dual = (jnp.minimum(_length(*x), 1.0) for x in ((inv_slacks, ds), (inv_multipliers, dz)))
        predicted = jnp.mean((s.slacks + primal * ds) * (z + dual * dz))
        centring = jnp.clip((predicted / mean) ** 3, 1e-6, 1.0)
        target = jnp.maximum(centring * mean, jnp.minimum(least, mean)) - primal * dual * ds * dz
        bent = values(p.constraints, v + primal * dv) - violations - primal * rise  # correct for the curvature, too
        return (target, residual + bent, _Change(dc, ds, dz, dv)), None

    nothing = _Change(jnp.zeros_like(s.coefficients), jnp.zeros_like(z), jnp.zeros_like(z), jnp.zeros_like(v))
    (_, _, change), _ = jax.lax.scan(newton, (jnp.zeros_like(z), residual, nothing), None, 2)
    shrinks = jnp.where(p.nodes.standing > 0, 0.0, change.values[0])
    primal = jnp.minimum(BOUNDARY * _length(inv_slacks, change.slacks), POSITIVE * _length(inverse, shrinks))
    primal, dual = (jnp.minimum(x, 1.0) for x in (primal, BOUNDARY * _length(inv_multipliers, change.multipliers)))
    # The optimality error is the sum of the duality gap and the predicted effects of the Newton step and the residuals.
    improvement = jnp.sum(jnp.abs(gradient * change.coefficients)) + jnp.sum(jnp.abs(residual) * z)
    error = jnp.where(jnp.max(violations) <= VIOLATED, mean * z.size + improvement, jnp.inf) / time
    # The last step changes only the multipliers, on which the derivatives of the minimum depend.
    moves = jnp.where(error < enough, 0.0, 1.0)
    return State(
        s.coefficients + moves * primal * change.coefficients,
        s.slacks + moves * primal * change.slacks,
        z + dual * change.multipliers,
        s.steps + 1,
        error,
    )


def _curvature(p: Program, v: Array, z: Array, ratio: Array, a: Array) -> list[list[Array]]:
    """Return the Hessian of the Lagrangian at the nodes, plus the terms of the eliminated slacks and multipliers.

    The loop over knots and inner nodes keeps the compiler from computing these values again for every entry of the
    matrix.
    """

    def of_kind(k: Array) -> list[list[Array]]:
        c, v_k, z_k, ratio_k, a_k, weights = (
            jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, k, -2, keepdims=False), x)
            for x in (p.constraints, v, z, ratio, a, jnp.asarray(p.weights))
        )
        found = second_derivatives(c, v_k, z_k, ratio_k, a_k)
        found[0][0] = found[0][0] + 0.75 * weights / (a_k * a_k * jnp.sqrt(a_k))
        return found

    return jax.lax.map(of_kind, jnp.arange(2, dtype=jnp.int32))


def _gradient(p: Program, cost_slope: Array, slope: Gradients, multipliers: Array) -> Float[Array, " cells+3"]:
    """Return the gradient of the Lagrangian with respect to the free coefficients."""
    at = weighted(slope, multipliers)
    return gathered(p.nodes, (at[0] + cost_slope, *at[1:])) * p.nodes.free


class _Scaled(NamedTuple):
    """A factored matrix that was scaled to a unit diagonal, and the scale of its rows and columns."""

    factored: Any
    scale: Float[Array, " cells+3"]


def factored(linear: ModuleType, p: Program, curvature: list[list[Array]]) -> _Scaled:
    """Factorise the band matrix with the lower triangle `curvature` of second derivatives at the nodes."""
    own, *below = gathered_band(p.nodes, curvature)
    free = jnp.asarray(p.nodes.free)
    scale = free * jax.lax.rsqrt(jnp.where(free > 0, own, 1.0))
    rows = [x * scale * jnp.pad(scale, (k, 0))[: scale.size] for k, x in enumerate(below, 1)]
    band = jnp.stack([*rows[::-1], jnp.full_like(own, 1.0 + 1e-14)])
    return _Scaled(linear.factor(band), scale)


def solved(linear: ModuleType, s: _Scaled, right: Float[Array, " cells+3"]) -> Float[Array, " cells+3"]:
    """Solve the linear system with a factorised matrix."""
    return linear.solve(s.factored, right * s.scale) * s.scale


def _length(inverse: Array, dx: Array) -> Scalar:
    """Return the largest step size, at most 1e3, with x + step·dx ≥ 0, where `inverse` is 1/x > 0."""
    return 1 / jnp.maximum(jnp.max(-dx * inverse), 1e-3)
