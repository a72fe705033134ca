"""Minimise convex objectives under constraints by a primal-dual interior-point method, for a batch of problems.

The method is Mehrotra's predictor–corrector with slack variables (Nocedal and Wright, *Numerical Optimization*, chapter
19). Iterates need not satisfy the constraints, so a search can start at an infeasible point, and limits can be
tightened between searches. No merit function and no shift of the matrix are needed, unlike in `nonconvex`. The error at
the end is a bound on the distance to the minimum, relative to the objective.

All problems of a batch have variables and constraints of the same shapes. The batch axis is the first one of variables,
and the second one of constraints. Finished problems leave the batch.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from jaxtyping import Float, Int

BOUNDARY, WITHIN = 0.99, 0.9
"""Largest fractions of the longest possible steps: for slacks and multipliers, and within the domain of the objective.
"""

BALANCE = 0.001
"""The target of the duality gap is at least this fraction of the residuals, so that both converge together."""

VIOLATED = 1e-6
"""The largest violation of a constraint, relative to its limit, at which a search usually may end."""

SLACK = 1.0
"""The smallest initial slack. With smaller slacks, the first steps would be short."""

MAX_STEPS = 100

STALLED, AGAIN = 1e-4, 8
"""A search also stops if its error is below `STALLED` and was not halved within `AGAIN` steps, because of roundings."""

PerProblem = Float[Any, " batch"]

Variables = Float[Any, "batch n"]

PerConstraint = Float[Any, "count batch *nodes"]


class Program(Protocol):
    """A batch of problems: minimise an objective f(z) > 0 under the constraints g(z) ≤ 0."""

    def objective(self, z: Variables) -> PerProblem:
        """Return the objective."""
        ...

    def values(self, z: Variables) -> PerConstraint:
        """Return the values of the constraints."""
        ...

    def linearise(self, z: Variables, multipliers: PerConstraint, ratio: PerConstraint) -> Linear:
        """Return values and derivatives; the matrix is ∇²(f + Σ multiplier·g) + Σ ratio·∇g ∇gᵀ."""
        ...

    def chosen(self, which: np.ndarray) -> Self:
        """Return some problems of the batch."""
        ...


class Linear(Protocol):
    """The values and derivatives of a batch of problems at one point; the matrix is factorised."""

    @property
    def objective(self) -> PerProblem:
        """The objective."""
        ...

    @property
    def values(self) -> PerConstraint:
        """The values of the constraints."""
        ...

    def gradient(self, weights: PerConstraint) -> Variables:
        """Return the gradient of the objective plus a weighted sum of the constraints."""
        ...

    def solved(self, right: Variables) -> Variables:
        """Return the solutions of the linear systems."""
        ...

    def move(self, dz: Variables) -> Move:
        """Return what a change of the variables does."""
        ...


class Move(Protocol):
    """The effects of a change of the variables."""

    @property
    def rise(self) -> PerConstraint:
        """The changes of the linearised constraints."""
        ...

    def values(self, part: PerProblem) -> PerConstraint:
        """Return the values of the constraints after a part of the change."""
        ...

    def longest(self) -> PerProblem:
        """Return the largest part of the change within the domain of the objective."""
        ...


class State(NamedTuple):
    """The iterates of a batch: variables, slacks, multipliers, number of steps, and relative optimality error."""

    z: Variables
    slacks: PerConstraint
    multipliers: PerConstraint
    steps: Int[Any, " batch"]
    error: PerProblem

    def chosen(self, which: np.ndarray) -> State:
        """Return some iterates of the batch."""
        return State(self.z[which], self.slacks[:, which], self.multipliers[:, which], *(x[which] for x in self[3:]))

    def store(self, which: np.ndarray, own: State) -> None:
        """Replace some iterates of the batch by the iterates `own`."""
        for x, y in zip((self.z, *self[3:]), (own.z, *own[3:]), strict=True):
            x[which] = y
        for x, y in zip(self[1:3], own[1:3], strict=True):
            x[:, which] = y


def begun(p: Program, z: Variables) -> State:
    """Return the first iterates; the duality gap of each equals its objective."""
    slacks = np.maximum(-p.values(z), SLACK)
    multipliers = _over(p.objective(z) / slacks[:, 0].size, slacks) / slacks
    return State(z, slacks, multipliers, np.zeros(len(z), np.int32), np.full(len(z), np.inf))


def continued(p: Program, s: State, least: float = 1.0) -> State:
    """Return iterates for constraints that were tightened after a search.

    Slacks and multipliers that are almost zero are increased, because they would make the next steps short: slacks to
    the fraction `least` of the largest violation. A smaller fraction needs fewer steps, but multipliers become less
    exact.
    """
    violations = p.values(s.z)
    lowest = _over(least * np.maximum(_max(violations), 0.0), violations)
    slacks = np.maximum(np.maximum(s.slacks, np.abs(violations)), lowest)
    smallest = _over(_sum(slacks * s.multipliers) / slacks[:, 0].size, slacks) / slacks
    return State(s.z, slacks, np.maximum(s.multipliers, smallest), s.steps, np.full_like(s.error, np.inf))


def solve(program: Program, start: State, enough: PerProblem, violated: float = VIOLATED) -> State:
    """Compute the optimal variables; stop if the optimality error is below `enough`, or after `MAX_STEPS` steps.

    No constraint may be violated by more than `violated` at the end.
    """
    result = State(*(x.copy() for x in start))
    s, which, last = start, np.arange(len(start.steps)), start.steps + MAX_STEPS
    best, since = start.error.copy(), start.steps.copy()
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
            s = _step(program, s, enough, violated)
    return result


def _step(p: Program, s: State, enough: PerProblem, violated: float) -> State:
    """Return the next iterates.

    The arrays of constraints may exceed the cache of the processor, so most are computed in place and in few passes.
    """
    z, inv_slacks = s.multipliers, 1 / s.slacks
    ratio = z * inv_slacks
    at = p.linearise(s.z, z, ratio)
    count = z[:, 0].size
    gap, residual, gradient = _dot(s.slacks, z), at.values + s.slacks, at.gradient(z)
    missing = _dot(np.abs(residual), z)
    least = BALANCE / count * (np.sum(np.abs(gradient * s.z), axis=1) + missing)

    # The predictor aims at a duality gap of zero.
    _, move, ds = _newton(at, ratio * residual, residual)
    fall = ds * inv_slacks
    primal, dual = (np.minimum(longest(x), 1.0) for x in (-_min(fall), 1 + _max(fall)))
    fall += 1
    fall *= z  # the decrease of the multipliers
    aim = fall * ds
    predicted = gap + primal * _dot(ds, z) - dual * (_dot(s.slacks, fall) + primal * _sum(aim))
    centring = np.clip((predicted / gap) ** 3, 1e-6, 1.0)

    # The corrector aims at equal products of slacks and multipliers, and corrects for the curvature.
    aim *= _over(primal * dual, ds)
    aim += _over(np.maximum(centring * gap, np.minimum(least * count, gap)) / count, ds)
    aim *= inv_slacks
    off = move.values(primal)
    off += s.slacks
    off -= _over(primal, ds) * move.rise
    change, move, ds = _newton(at, ratio * off + aim, off)
    fall = ds * inv_slacks
    primal = np.minimum(BOUNDARY * longest(-_min(fall)), WITHIN * move.longest())
    fall += 1
    fall *= z
    dz = np.subtract(aim, fall, out=aim)
    primal, dual = (np.minimum(x, 1.0) for x in (primal, BOUNDARY * longest(-_min(dz / z))))
    # The optimality error is the sum of the duality gap and the predicted effects of the Newton step and the residuals.
    improvement = np.sum(np.abs(gradient * change), axis=1) + missing
    error = np.where(_max(at.values) <= violated, gap + improvement, np.inf) / at.objective
    # The last step changes only the multipliers, on which the derivatives of the minimum depend.
    primal = np.where(error < enough, 0.0, primal)
    ds *= _over(primal, ds)
    ds += s.slacks
    dz *= _over(dual, dz)
    dz += z
    return State(s.z + primal[:, None] * change, ds, dz, s.steps + 1, error)


def _newton(at: Linear, right: PerConstraint, off: PerConstraint) -> tuple[Variables, Move, PerConstraint]:
    """Return the changes of the variables, their effects, and the changes of the slacks.

    The changes of the slacks reduce the residuals `off` of the constraints to zero; `right` are the weights of their
    gradients.
    """
    change = -at.solved(at.gradient(right))
    move = at.move(change)
    ds = off + move.rise
    return change, move, np.negative(ds, out=ds)


def longest(fall: PerProblem) -> PerProblem:
    """Return the largest step size, at most 1e3, up to which no x becomes negative.

    `fall` is the largest relative decrease −dx/x of one step of size 1.
    """
    return 1 / np.maximum(fall, 1e-3)


def _sum(x: PerConstraint) -> PerProblem:
    """Return the sum over constraints and nodes for each problem."""
    return _rows(x).sum(axis=2).sum(axis=0)


def _dot(x: PerConstraint, y: PerConstraint) -> PerProblem:
    """Return the sum of the products over constraints and nodes for each problem."""
    return np.vecdot(_rows(x), _rows(y)).sum(axis=0)


def _max(x: PerConstraint) -> PerProblem:
    return np.maximum.reduce(_rows(x), axis=(0, 2))


def _min(x: PerConstraint) -> PerProblem:
    return np.minimum.reduce(_rows(x), axis=(0, 2))


def _rows(x: PerConstraint) -> Float[Any, "count batch nodes"]:
    """Return the array with one axis for all nodes."""
    return x.reshape(*x.shape[:2], -1)


def _over(x: PerProblem, like: PerConstraint) -> np.ndarray:
    """Return one number for each problem as an array that broadcasts over the nodes."""
    return x.reshape(-1, *(1,) * (like.ndim - 2))
