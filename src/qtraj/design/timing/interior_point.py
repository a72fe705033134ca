"""A primal-dual interior-point method for the fastest timing: minimise ∫ du/√a under constraints at all nodes.

It uses Mehrotra's predictor and corrector (Nocedal and Wright, Numerical Optimization, chapter 19). The matrix of each
step is a band matrix with three subdiagonals, so the cost of a step is proportional to the number of cells.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.timing import banded
from qtraj.design.timing.constraints import Constraints, curvature, gradients, values
from qtraj.design.timing.spline import Nodes, at_nodes, gathered, gathered_band
from qtraj.foundation.types import Flag, Scalar

BOUNDARY = 0.99
"""Largest fraction of the distance to the boundary that a step may cover."""

BALANCE = 0.1
"""The target of the duality gap is at least this fraction of the residual gradient: both must vanish together."""

MAX_STEPS = 100


class Program(NamedTuple):
    """The problem: nodes, weights of the integral at the nodes [s], and constraints."""

    nodes: Nodes
    weights: Float[Array, " nodes"]
    constraints: Constraints


class State(NamedTuple):
    """An iterate: coefficients, multipliers, the number of steps, and the relative optimality error."""

    coefficients: Float[Array, " cells+3"]
    multipliers: Float[Array, "5 nodes"]
    steps: Int[Array, ""]
    error: Scalar


def solve(program: Program, initial: Float[Array, " cells+3"], gaps: tuple[Scalar, Scalar]) -> State:
    """The optimal coefficients; the `initial` ones must satisfy every constraint strictly.

    `gaps`: the relative duality gaps at the start and at the end of the search.
    """
    v = at_nodes(program.nodes, initial)
    slacks = -values(program.constraints, v)
    barrier = gaps[0] * duration(program, v) / slacks.size
    count, error = jnp.zeros((), jnp.int32), jnp.full((), jnp.inf, initial.dtype)
    start = State(initial, barrier / slacks, count, error)

    def goes_on(s: State) -> Flag:
        return (s.error >= gaps[1]) & (s.steps < MAX_STEPS)

    return jax.lax.while_loop(goes_on, lambda s: _step(program, s, gaps[1]), start)


def duration(p: Program, v: Float[Array, "3 nodes"]) -> Scalar:
    """∫ du/√a [s]."""
    return jnp.sum(p.weights * _positive(p, v) ** -0.5)


def _positive(p: Program, v: Float[Array, "3 nodes"]) -> Float[Array, " nodes"]:
    """The values of a; 1 at nodes at rest, whose weight is zero."""
    return jnp.where(p.nodes.standing > 0, 1.0, v[0])


def _step(p: Program, s: State, enough: Scalar) -> State:
    v, z = at_nodes(p.nodes, s.coefficients), s.multipliers
    a, slope = _positive(p, v), gradients(p.constraints, v)
    slacks = -values(p.constraints, v)
    inverse, inv_slacks = 1 / a, 1 / slacks
    pace = p.weights * jnp.sqrt(inverse)
    cost_slope = -0.5 * pace * inverse
    ratio = z * inv_slacks
    weighed = ratio[:, None] * slope
    parts = curvature(p.constraints, v, z, a) + jnp.sum(weighed[:, :, None] * slope[:, None], axis=0)
    system = _system(p, parts.at[0, 0].add(0.75 * pace * inverse * inverse))

    def changes(target: Array) -> tuple[Array, Array, Array, Array]:
        """The Newton step towards slack · z = `target`: changes of coefficients, values, slacks and multipliers."""
        dc = -system(_gradient(p, cost_slope, slope, target * inv_slacks))
        dv = at_nodes(p.nodes, dc)
        ds = -jnp.sum(slope * dv[None], axis=1)
        return dc, dv, ds, target * inv_slacks - z - ratio * ds

    mean = jnp.mean(slacks * z)
    _, dv, ds, dz = changes(jnp.zeros_like(z))
    step, ahead = _step_within(p, v, dv, slacks, 0.0)
    dual = jnp.minimum(_length(z, dz), 1.0)
    gained = ahead - slacks
    predicted = jnp.mean(ahead * (z + dual * dz))
    centring = jnp.clip((predicted / mean) ** 3, 1e-6, 1.0)
    time = jnp.sum(pace)
    residual = jnp.sum(jnp.abs(_gradient(p, cost_slope, slope, z) * s.coefficients))
    target = jnp.maximum(centring * mean, jnp.minimum(BALANCE * residual / z.size, mean))
    correction = dual * dz * gained + z * (gained - step * ds)
    dc, dv, ds, dz = changes(target - correction)
    primal, _ = _step_within(p, v, dv, slacks, 1 - BOUNDARY)
    dual = jnp.minimum(BOUNDARY * _length(z, dz), 1.0)
    error = (mean * z.size + residual) / time
    done = error < enough
    return State(
        jnp.where(done, s.coefficients, s.coefficients + primal * dc),
        jnp.where(done, z, z + dual * dz),
        s.steps + 1,
        error,
    )


def _step_within(p: Program, v: Array, dv: Array, slacks: Array, keep: float) -> tuple[Scalar, Array]:
    """A step (by backtracking) after which a > 0 and every slack is at least `keep` times its value; and the slacks."""
    shrinks = jnp.where(p.nodes.standing > 0, 0.0, dv[0])
    longest = jnp.minimum(BOUNDARY * _length(_positive(p, v), shrinks), 1.0)

    def at(step: Scalar) -> tuple[Scalar, Array]:
        return step, -values(p.constraints, v + step * dv)

    def shorter(trial: tuple[Scalar, Array]) -> tuple[Scalar, Array]:
        return at(0.8 * trial[0])

    def leaves(trial: tuple[Scalar, Array]) -> Flag:
        return jnp.any(trial[1] < keep * slacks) & (trial[0] > 1e-10)

    return jax.lax.while_loop(leaves, shorter, at(longest))


def _gradient(p: Program, cost_slope: Array, slope: Array, multipliers: Array) -> Float[Array, " cells+3"]:
    """The gradient of the Lagrangian with respect to the free coefficients."""
    at = jnp.sum(multipliers[:, None] * slope, axis=0).at[0].add(cost_slope)
    return gathered(p.nodes, at) * p.nodes.free


def _system(p: Program, parts: Float[Array, "3 3 nodes"]) -> Any:
    """A function that solves the linear system for a right-hand side; the matrix is scaled to a unit diagonal."""
    matrix = gathered_band(p.nodes, parts)
    free = p.nodes.free
    scale = free * jnp.where(free > 0, matrix[0], 1.0) ** -0.5
    shifted = jnp.stack([jnp.pad(scale[: scale.size - d], (d, 0)) for d in range(4)])
    factored = banded.factor((matrix * shifted * scale[None]).at[0].set(1.0 + 1e-14))
    return lambda right: banded.solve(factored, right * scale) * scale


def _length(x: Array, dx: Array) -> Scalar:
    """The largest step, at most 1e3, that keeps x + step·dx ≥ 0."""
    return 1 / jnp.maximum(jnp.max(-dx / x), 1e-3)
