"""A primal-dual interior-point method for the fastest timing: minimise ∫ du/√a under constraints at all nodes.

Mehrotra's predictor and corrector (Nocedal and Wright, Numerical Optimization, chapter 19). The matrix of each step has
a band of three diagonals beside the main one, so a step costs in proportion to the number of cells.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.timing import banded
from qtraj.design.timing.constraints import (
    Constraints,
    at_nodes,
    curvature,
    gathered,
    gathered_band,
    gradients,
    values,
)
from qtraj.foundation.types import Flag, Scalar

BOUNDARY = 0.99
"""Part of the way to the boundary that a step may take."""

BALANCE = 0.1
"""The duality gap aimed at is no smaller than this part of the Lagrangian's gradient: both must vanish together."""

LOOSE = 0.1
"""Part of a limit by which a constraint may differ from its slack on the way; the next step mends most of it."""

MAX_STEPS = 80


class Program(NamedTuple):
    """The problem: basis at the nodes, weights of the integral [s], constraints, and which coefficients are free."""

    basis: Float[Array, "cells nodes 3 4"]
    weights: Float[Array, "cells nodes"]
    constraints: Constraints
    free: Float[Array, "cells+3"]


class State(NamedTuple):
    """An iterate: coefficients, slacks of the constraints and multipliers; steps, and the distance from the optimum."""

    coefficients: Float[Array, "cells+3"]
    slacks: Float[Array, "7 cells nodes"]
    multipliers: Float[Array, "7 cells nodes"]
    steps: Int[Array, ""]
    error: Scalar


def solve(program: Program, initial: Float[Array, "cells+3"], gaps: tuple[Scalar, Scalar]) -> State:
    """The optimal coefficients, from `initial` ones that satisfy every constraint with something to spare.

    `gaps`: relative duality gaps at which the search begins and at which it ends.
    """
    v = at_nodes(program.basis, initial)
    slacks = -values(program.constraints, v)
    barrier = gaps[0] * duration(program.weights, v) / slacks.size
    count, error = jnp.zeros((), jnp.int32), jnp.full((), jnp.inf, initial.dtype)
    start = State(initial, slacks, barrier / slacks, count, error)

    def goes_on(s: State) -> Flag:
        return (s.error >= gaps[1]) & (s.steps < MAX_STEPS)

    return jax.lax.while_loop(goes_on, lambda s: _step(program, s, gaps[1]), start)


def duration(weights: Float[Array, "cells nodes"], v: Float[Array, "cells nodes 3"]) -> Scalar:
    """∫ du/√a [s]."""
    return jnp.sum(weights * v[..., 0] ** -0.5)


def _step(p: Program, s: State, enough: Scalar) -> State:
    v = at_nodes(p.basis, s.coefficients)
    a, slope = v[..., 0], gradients(p.constraints, v)
    violation = values(p.constraints, v) + s.slacks
    cost_slope = -0.5 * p.weights * a**-1.5
    ratio = s.multipliers / s.slacks
    parts = curvature(p.constraints, v, s.multipliers) + jnp.sum(
        ratio[..., None, None] * slope[..., :, None] * slope[..., None, :], axis=0
    )
    system = _system(p, parts.at[..., 0, 0].add(0.75 * p.weights * a**-2.5))

    def changes(target: Array) -> tuple[Array, Array, Array]:
        """Changes of coefficients, slacks and multipliers towards slack · multiplier = `target`."""
        dc = -system(_gradient(p, cost_slope, slope, target / s.slacks + ratio * violation))
        ds = -violation - jnp.sum(slope * at_nodes(p.basis, dc), axis=-1)
        return dc, ds, target / s.slacks - s.multipliers - ratio * ds

    mean = jnp.mean(s.slacks * s.multipliers)
    _, ds, dz = changes(jnp.zeros_like(s.slacks))
    ahead = _length(s.slacks, ds), _length(s.multipliers, dz)
    predicted = jnp.mean((s.slacks + ahead[0] * ds) * (s.multipliers + ahead[1] * dz))
    centring = jnp.clip((predicted / mean) ** 3, 1e-6, 1.0)
    time = duration(p.weights, v)
    residual = jnp.sum(jnp.abs(_gradient(p, cost_slope, slope, s.multipliers) * s.coefficients))
    target = jnp.maximum(centring * mean, BALANCE * residual / s.slacks.size)
    dc, ds, dz = changes(target - ds * dz * ahead[0] * ahead[1])
    dv = at_nodes(p.basis, dc)
    longest = BOUNDARY * jnp.minimum(_length(s.slacks, ds), _length(a, dv[..., 0]))
    broken = jnp.max(jnp.abs(violation))
    primal = _allowed(p, v, dv, (s.slacks, ds), jnp.minimum(longest, 1.0), jnp.maximum(2 * broken, LOOSE))
    dual = jnp.minimum(BOUNDARY * _length(s.multipliers, dz), 1.0)
    error = (mean * s.slacks.size + residual) / time + broken
    done = error < enough
    changed = (s.coefficients + primal * dc, s.slacks + primal * ds, s.multipliers + dual * dz)
    kept = (jnp.where(done, old, new) for old, new in zip(s[:3], changed, strict=True))
    return State(*kept, s.steps + 1, error)


def _gradient(p: Program, cost_slope: Array, slope: Array, multipliers: Array) -> Float[Array, "cells+3"]:
    """The Lagrangian's, in the free coefficients."""
    at = jnp.sum(multipliers[..., None] * slope, axis=0).at[..., 0].add(cost_slope)
    return gathered(p.basis, at) * p.free


def _system(p: Program, parts: Float[Array, "cells nodes 3 3"]) -> Any:
    """The solution of the linear system with this matrix, scaled to a diagonal of ones, for any right side."""
    matrix = gathered_band(p.basis, parts)
    scale = p.free * jnp.where(p.free > 0, matrix[0], 1.0) ** -0.5
    shifted = jnp.stack([jnp.pad(scale[: scale.size - d], (d, 0)) for d in range(4)])
    factored = banded.factor((matrix * shifted * scale).at[0].set(1.0 + 1e-14))
    return lambda right: banded.solve(factored, right * scale) * scale


def _allowed(
    p: Program, v: Array, dv: Array, slacks: tuple[Array, Array], longest: Scalar, violation: Scalar
) -> Scalar:
    """The longest of some steps after which no constraint differs from its slack by more than `violation`."""

    def fits(step: Scalar) -> Flag:
        return jnp.max(jnp.abs(values(p.constraints, v + step * dv) + slacks[0] + step * slacks[1])) <= violation

    return jax.lax.while_loop(lambda step: ~fits(step) & (step > 1e-8), lambda step: 0.7 * step, longest)


def _length(x: Array, dx: Array) -> Scalar:
    """The largest step, at most 1e3, that keeps x + step·dx ≥ 0."""
    return 1 / jnp.maximum(jnp.max(-dx / x), 1e-3)
