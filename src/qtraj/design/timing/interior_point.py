"""Compute the fastest timing by a primal-dual interior-point method: minimise ∫ du/√a under constraints at all nodes.

Here u is the path parameter and a = u̇². The method is Mehrotra's predictor–corrector with slack variables (Nocedal and
Wright, Numerical Optimization, chapter 19). Iterates need not satisfy the constraints. So a search can start at an
infeasible point, and limits can be tightened between searches. The matrix of each step is a band matrix with three
subdiagonals.

The search runs in NumPy for a batch of problems with the same nodes; finished problems leave the batch. The batch axis
precedes the axes of the nodes.
"""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from qtraj.design.solve import refinement
from qtraj.design.solve.band import Factored, factor, solve as solve_band
from qtraj.design.timing.constraint_values import Gradients, changes, gradients, second_derivatives, values, weighted
from qtraj.design.timing.constraints import Constraints
from qtraj.design.timing.seam import folded, order, repeated
from qtraj.design.timing.spline import Nodes, at_nodes, gathered, gathered_band, products
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar

BOUNDARY, POSITIVE = 0.99, 0.9
"""Largest fractions of the distance to zero that a step may cover, for slacks and multipliers, and for a = u̇²."""

BALANCE = 0.001
"""The target of the duality gap is at least this fraction of the residuals, so that both converge together."""

VIOLATED = 1e-6
"""The largest violation of a constraint, relative to its limit, at which a search may end."""

SLACK = 1.0
"""The smallest initial slack. With smaller slacks, the first steps would be short."""

MAX_STEPS = 100

STALLED, AGAIN = 1e-4, 8
"""A search also stops if its error is below `STALLED` and was not halved within `AGAIN` steps, because of roundings."""

PerProblem = Float[Any, " batch"]


class Program(NamedTuple):
    """The problem: nodes, weights of the integral at the nodes [s], constraints, and upper bounds `largest` on a = u̇².

    A value near `largest` means that no limit bounds the speed (see `boundedness`). The arrays are those of one
    problem, or have a batch axis before the axes of the nodes, except for the nodes.
    """

    nodes: Nodes
    weights: Float[Any, "*batch 2 cells+1"]
    constraints: Constraints
    largest: Float[Any, "*batch 2 cells+1"]

    def at_nodes(self, coefficients: Float[Any, "*batch cells+3"]) -> Float[Any, "orders *batch 2 cells+1"]:
        """Return a = u̇² at the nodes, and the derivatives of a that the constraints contain."""
        return at_nodes(self.nodes, coefficients, self.constraints.orders)

    def chosen(self, which: np.ndarray) -> "Program":
        """Return some problems of a batch."""
        own = jax.tree.map(lambda x: x[..., which, :, :], (self.weights, self.constraints, self.largest))
        return Program(self.nodes, *own)


class State(NamedTuple):
    """The iterates of a batch: coefficients, slacks, multipliers, number of steps, and relative optimality error."""

    coefficients: Float[Any, "batch cells+3"]
    slacks: Float[Any, "count batch 2 cells+1"]
    multipliers: Float[Any, "count batch 2 cells+1"]
    steps: Int[Any, " batch"]
    error: PerProblem

    def chosen(self, which: np.ndarray) -> "State":
        """Return some iterates of the batch."""
        nodes = (x[:, which] for x in self[1:3])
        slacks, multipliers = nodes
        return State(self.coefficients[which], slacks, multipliers, self.steps[which], self.error[which])

    def store(self, which: np.ndarray, own: "State") -> None:
        """Replace some iterates of the batch by the iterates `own`."""
        for x, y in zip((self.coefficients, *self[3:]), (own.coefficients, *own[3:]), strict=True):
            x[which] = y
        for x, y in zip(self[1:3], own[1:3], strict=True):
            x[:, which] = y


def begun(p: Program, coefficients: Float[Any, "batch cells+3"]) -> State:
    """Return the first iterates; the duality gap of each equals its duration."""
    v = p.at_nodes(coefficients)
    slacks = np.maximum(-values(p.constraints, v), SLACK)
    count = slacks[:, 0].size
    multipliers = (_sum(p.weights * _positive(p, v) ** -0.5) / count)[:, None, None] / slacks
    steps = np.zeros(len(coefficients), np.int32)
    return State(coefficients, slacks, multipliers, steps, np.full(len(coefficients), np.inf))


def continued(p: Program, s: State) -> State:
    """Return iterates for constraints that were tightened after a search.

    Slacks and multipliers that are almost zero are increased, because they would make the next steps short.
    """
    violations = values(p.constraints, p.at_nodes(s.coefficients))
    slacks = np.maximum(np.maximum(s.slacks, -violations), _max(violations)[:, None, None])
    least = (_sum(slacks * s.multipliers) / slacks[:, 0].size)[:, None, None] / slacks
    return State(s.coefficients, slacks, np.maximum(s.multipliers, least), s.steps, np.full_like(s.error, np.inf))


def solve(program: Program, start: State, enough: Float[Any, " batch"]) -> State:
    """Compute the optimal coefficients; stop if the optimality error is below `enough`, or after `MAX_STEPS` steps."""
    result = State(*(x.copy() for x in start))
    s, which, last = start, np.arange(len(start.steps)), start.steps + MAX_STEPS
    best, since = start.error.copy(), start.steps.copy()
    table = products(program.nodes.basis[: program.constraints.orders])
    while which.size:
        halved = s.error < 0.5 * best
        best, since = np.where(halved, s.error, best), np.where(halved, s.steps, since)
        stalled = (best < STALLED) & (s.steps >= since + AGAIN) & (s.error < 2 * best)
        goes_on = (s.error >= enough) & (s.steps < last) & ~stalled  # false if the error is NaN
        if not goes_on.all():
            result.store(which[~goes_on], s.chosen(~goes_on))
            s, program, which = s.chosen(goes_on), program.chosen(goes_on), which[goes_on]
            enough, last, best, since = (x[goes_on] for x in (enough, last, best, since))
        if which.size:
            s = _step(program, table, s, enough)
    return result


def duration(p: Program, v: Float[Any, "orders 2 cells+1"]) -> Scalar:
    """Return the duration ∫ du/√a [s], where a = u̇²."""
    return namespace(v, p.weights).sum(p.weights * _positive(p, v) ** -0.5)


def _positive(p: Program, v: Float[Any, "orders *batch 2 cells+1"]) -> Float[Any, "*batch 2 cells+1"]:
    """Return a = u̇² at the nodes, or 1 at nodes at rest; nodes at rest have the weight zero."""
    xp = namespace(v)
    return xp.where(xp.broadcast_to(p.nodes.standing > 0, v[0].shape), 1.0, v[0])


def _step(p: Program, table: np.ndarray, s: State, enough: PerProblem) -> State:
    """Return the next iterates."""
    v, z = p.at_nodes(s.coefficients), s.multipliers
    a, slope, violations = _positive(p, v), gradients(p.constraints, v), values(p.constraints, v)
    inverse, inv_slacks, inv_multipliers = 1 / a, 1 / s.slacks, 1 / z
    pace = p.weights * np.sqrt(inverse)
    cost_slope = -0.5 * pace * inverse
    ratio = z * inv_slacks
    curvature = second_derivatives(p.constraints, slope, v, z, ratio, a)
    curvature[0, 0] += 0.75 * pace * inverse * inverse
    band = factored(p.nodes.free, table, curvature, bool(p.nodes.seam))
    count = z[:, 0].size
    mean, time = _sum(s.slacks * z) / count, _sum(pace)
    residual = violations + s.slacks
    gradient = _gradient(p, cost_slope, slope, z)
    missing = _sum(np.abs(residual) * z)
    least = BALANCE / count * (np.sum(np.abs(gradient * s.coefficients), axis=1) + missing)
    newton = functools.partial(_newton, p, band, curvature)
    target, off = 0.0, residual
    for last in (False, True):  # the predictor and the corrector
        dc = -newton(_gradient(p, cost_slope, slope, target * inv_slacks + ratio * off))
        dv = p.at_nodes(dc)
        rise = changes(slope, dv)
        ds = -off - rise
        dz = target * inv_slacks - z - ratio * ds
        if not last:
            primal, dual = (
                _of_problems(np.minimum(_length(*x), 1.0)) for x in ((inv_slacks, ds), (inv_multipliers, dz))
            )
            predicted = _sum((s.slacks + primal * ds) * (z + dual * dz)) / count
            centring = np.clip((predicted / mean) ** 3, 1e-6, 1.0)
            target = _of_problems(np.maximum(centring * mean, np.minimum(least, mean))) - primal * dual * ds * dz
            bent = values(p.constraints, v + primal * dv) - violations - primal * rise  # corrects for the curvature
            off = residual + bent
    shrinks = np.where(p.nodes.standing > 0, 0.0, dv[0])
    primal = np.minimum(BOUNDARY * _length(inv_slacks, ds), POSITIVE * _length(inverse, shrinks))
    primal, dual = (np.minimum(x, 1.0) for x in (primal, BOUNDARY * _length(inv_multipliers, dz)))
    # The optimality error is the sum of the duality gap and the predicted effects of the Newton step and the residuals.
    improvement = np.sum(np.abs(gradient * dc), axis=1) + missing
    error = np.where(_max(violations) <= VIOLATED, mean * count + improvement, np.inf) / time
    # The last step changes only the multipliers, on which the derivatives of the minimum depend.
    primal = np.where(error < enough, 0.0, primal)
    return State(
        s.coefficients + primal[:, None] * dc,
        s.slacks + _of_problems(primal) * ds,
        z + _of_problems(dual) * dz,
        s.steps + 1,
        error,
    )


def _gradient(
    p: Program, cost_slope: np.ndarray, slope: Gradients, multipliers: np.ndarray
) -> Float[Any, "batch cells+3"]:
    """Return the gradient of the Lagrangian with respect to the free coefficients."""
    at = weighted(slope, multipliers)
    at[0] += cost_slope
    return gathered(p.nodes, at) * p.nodes.free


def _newton(p: Program, band: "_Scaled", curvature: np.ndarray, right: np.ndarray) -> Float[Any, "batch cells+3"]:
    """Solve the linear system of a step; with a limit on the jerk, rounding errors of `band` are corrected."""
    if p.constraints.jerk is None or p.nodes.seam:  # the coefficients of a lap repeat
        return solved(band, right)

    def product(x: np.ndarray) -> np.ndarray:
        return gathered(p.nodes, np.einsum("ij...,j...->i...", curvature, p.at_nodes(x))) * p.nodes.free

    return refinement.solve(product, functools.partial(solved, band), right)


class _Scaled(NamedTuple):
    """A factored matrix that was scaled to a unit diagonal, and the scale of its rows and columns.

    For a lap, the rows are in the order of `seam.order`, and the coefficients that repeat others have none.
    """

    factored: Factored
    scale: Float[Any, "batch rows"]
    lap: bool = False


def factored(
    free: Float[Any, " cells+3"],
    table: np.ndarray,
    curvature: Float[Any, "orders orders batch 2 cells+1"],
    lap: bool = False,
) -> _Scaled:
    """Factorise the band matrices of the second derivatives `curvature` at the nodes; those of a `lap` are cyclic."""
    own, *below = gathered_band(table, curvature)
    if lap:
        rows = folded((own, *below))
        scale = 1 / np.sqrt(rows[..., -1])
        rows[..., -1] = 1.0 + 1e-14
        for k in range(1, rows.shape[2]):
            rows[:, k:, -1 - k] *= scale[:, k:] * scale[:, :-k]
        return _Scaled(factor(rows), scale, True)
    scale = free / np.sqrt(np.where(free > 0, own, 1.0))
    band = np.empty((*own.shape, 1 + len(below)))
    band[..., -1] = 1.0 + 1e-14
    for k, x in enumerate(below, 1):
        band[..., :k, -1 - k] = 0.0
        band[..., k:, -1 - k] = x[..., k:] * scale[..., k:] * scale[..., :-k]
    return _Scaled(factor(band), scale)


def solved(s: _Scaled, right: Float[Any, "batch cells+3"]) -> Float[Any, "batch cells+3"]:
    """Solve the linear systems with factorised matrices."""
    if s.lap:
        rows, found = order(s.scale.shape[1]), np.zeros_like(right)
        found[:, rows] = solve_band(s.factored, right[:, rows] * s.scale) * s.scale
        return repeated(found, 1.0)
    return solve_band(s.factored, right * s.scale) * s.scale


def _sum(x: np.ndarray) -> PerProblem:
    """Return the sum over constraints and nodes for each problem."""
    return np.einsum("bmn->b", x if x.ndim == 3 else np.add.reduce(x, axis=0))


def _max(x: np.ndarray) -> PerProblem:
    return np.max(x if x.ndim == 3 else np.max(x, axis=0), axis=(1, 2))


def _of_problems(x: PerProblem) -> Float[Any, "batch 1 1"]:
    """Return an array that broadcasts over the nodes."""
    return x[:, None, None]


def _length(inverse: np.ndarray, dx: np.ndarray) -> PerProblem:
    """Return the largest step size, at most 1e3, with x + step·dx ≥ 0, where `inverse` is 1/x > 0."""
    return 1 / np.maximum(_max(-dx * inverse), 1e-3)
