"""Present the fastest timing to the interior-point method: minimise ∫ du/√a under constraints at all nodes.

Here u is the path parameter and a = u̇². The variables are the coefficients of the spline a(u). The matrix of each step
is a band matrix with three subdiagonals.

Everything runs in NumPy for a batch of problems with the same nodes. The batch axis precedes the axes of the nodes.
"""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.solve import refinement
from qtraj.design.solve.band import Factored, factor, solve as solve_band
from qtraj.design.solve.convex import PerProblem, longest
from qtraj.design.timing.constraint_values import (
    changes,
    gradients,
    products,
    second_derivatives,
    values,
    weighted,
)
from qtraj.design.timing.constraints import Constraints
from qtraj.design.timing.forms import symmetric
from qtraj.design.timing.seam import folded, order, repeated
from qtraj.design.timing.spline import Nodes, at_nodes, gathered, gathered_band
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar

Coefficients = Float[Any, "batch cells+3"]

PerNode = Float[Any, "count batch 2 cells+1"]


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

    def objective(self, z: Coefficients) -> PerProblem:
        """Return the durations [s]."""
        return _durations(self.weights * _positive(self, self.at_nodes(z)) ** -0.5)

    def values(self, z: Coefficients) -> PerNode:
        """Return the values of the constraints, which must not be positive."""
        return values(self.constraints, self.at_nodes(z))

    def linearise(self, z: Coefficients, multipliers: PerNode, ratio: PerNode) -> "_Linear":
        """Return values and derivatives, and the factorised matrix of a step (see `solve.convex`)."""
        return _Linear(self, z, multipliers, ratio)

    def chosen(self, which: np.ndarray) -> "Program":
        """Return some problems of a batch."""
        own = jax.tree.map(lambda x: x[..., which, :, :], (self.weights, self.constraints, self.largest))
        return Program(self.nodes, *own)


def duration(p: Program, v: Float[Any, "orders 2 cells+1"]) -> Scalar:
    """Return the duration ∫ du/√a [s] of one problem, where a = u̇²."""
    return namespace(v, p.weights).sum(p.weights * _positive(p, v) ** -0.5)


class _Linear:
    """The values and derivatives of a batch of problems at one point."""

    def __init__(self, p: Program, z: Coefficients, multipliers: PerNode, ratio: PerNode):
        self.program, self.v = p, p.at_nodes(z)
        self.a = _positive(p, self.v)
        self.inverse = 1 / self.a
        pace = p.weights * np.sqrt(self.inverse)
        self.objective = _durations(pace)
        known = products(p.constraints, self.v)
        self.values, self.slope = (f(p.constraints, self.v, known) for f in (values, gradients))
        self.of_objective = -0.5 * pace * self.inverse
        self.curvature = second_derivatives(p.constraints, self.slope, self.v, multipliers, ratio, self.a, known)
        self.curvature[0] += 0.75 * pace * self.inverse * self.inverse
        self.band = factored(p.nodes, self.curvature)

    def gradient(self, weights: PerNode) -> Coefficients:
        """Return the gradient of the Lagrangian with respect to the free coefficients."""
        at = weighted(self.slope, weights)
        at[0] += self.of_objective
        return gathered(self.program.nodes, at) * self.program.nodes.free

    def solved(self, right: Coefficients) -> Coefficients:
        """Solve the linear system of a step; if they contain the jerk, rounding errors of the band are corrected."""
        p, factors = self.program, functools.partial(solved, self.band)
        if p.constraints.orders == 2 or p.nodes.seam:  # the coefficients of a lap repeat
            return factors(right)

        matrix = symmetric(self.curvature)

        def product(x: np.ndarray) -> np.ndarray:
            at = np.einsum("ij...,j...->i...", matrix, p.at_nodes(x))
            return gathered(p.nodes, at) * p.nodes.free

        return refinement.solve(product, factors, right)

    def move(self, dz: Coefficients) -> "_Move":
        """Return what a change of the coefficients does."""
        return _Move(self, dz)


class _Move:
    """The effects of a change of the coefficients."""

    def __init__(self, at: _Linear, dz: Coefficients):
        self.at, self.dv = at, at.program.at_nodes(dz)
        self.rise = changes(at.slope, self.dv)

    def values(self, part: PerProblem) -> PerNode:
        """Return the values of the constraints after a part of the change."""
        return values(self.at.program.constraints, self.at.v + part[:, None, None] * self.dv)

    def longest(self) -> PerProblem:
        """Return the largest part of the change with a ≥ 0 at all nodes."""
        fall = -np.where(self.at.program.nodes.standing > 0, 0.0, self.dv[0]) * self.at.inverse
        return longest(fall.max(axis=(1, 2)))


def _positive(p: Program, v: Float[Any, "orders *batch 2 cells+1"]) -> Float[Any, "*batch 2 cells+1"]:
    """Return a = u̇² at the nodes, or 1 at nodes at rest; nodes at rest have the weight zero."""
    return namespace(v).where(p.nodes.standing > 0, 1.0, v[0])


def _durations(pace: Float[Any, "batch 2 cells+1"]) -> PerProblem:
    return np.einsum("bmn->b", pace)


class _Scaled(NamedTuple):
    """A factored matrix that was scaled to a unit diagonal, and the scale of its rows and columns.

    For a lap, the rows are in the order of `seam.order`, and the coefficients that repeat others have none.
    """

    factored: Factored
    scale: Float[Any, "batch rows"]
    lap: bool = False


def factored(n: Nodes, curvature: Float[Any, "entries batch 2 cells+1"]) -> _Scaled:
    """Factorise the band matrices of the second derivatives `curvature` at the nodes; those of a lap are cyclic.

    `curvature` are the entries of the lower triangles of the matrices at the nodes.
    """
    own, *below = gathered_band(n, curvature)
    if n.seam:
        rows = folded((own, *below))
        scale = 1 / np.sqrt(rows[..., -1])
        rows[..., -1] = 1.0 + 1e-14
        for k in range(1, rows.shape[2]):
            rows[:, k:, -1 - k] *= scale[:, k:] * scale[:, :-k]
        return _Scaled(factor(rows), scale, True)
    scale = n.free / np.sqrt(np.where(n.free > 0, own, 1.0))
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
