"""The local model of a batch of searches: cost and peaks with first and second derivatives in the variables.

The constraint is the value g(z, u) at the time u of a peak, where ∂g/∂u = 0. The derivative of this value with respect
to z is ∂g/∂z (envelope theorem), and its Hessian is g_zz − g_zu g_uz/g_uu. The time of a peak at an end of the path is
constant.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.algebra.jets import variables
from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.objectives import custom
from qtraj.design.tuning.peaks import Peaks
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.searches import CurveJets, Searches
from qtraj.design.tuning.zone_model import expand_in_zone
from qtraj.design.tuning.zones import AnyZone, SpeedZone

LOOSE = -0.7
"""Below this value, a constraint is expressed by ½((value/limit)² − 1).

The logarithm would overestimate the change of a quantity near zero. The constraint of an obstacle is no logarithm.
"""

TOGETHER = 64
"""Up to this number of points, all have Hessians at first, which costs less than a second call without them."""

CLOSE = 0.02
"""A constraint at a fixed time has a Hessian if its value is at most this much below the largest constraint value."""


class Model(NamedTuple):
    """The local model: the gradient and the Hessian of the cost, and the constraints of the k highest peaks.

    `limit` and `time` describe the peaks; `value` is `ABSENT` for missing peaks. `fixed` marks constraints at fixed
    times, of which only those with high values have Hessians (see `CLOSE`).
    """

    slope: Float[np.ndarray, "n batch"]
    curvature: Float[np.ndarray, "n n batch"]
    value: Float[np.ndarray, "k batch"]
    slopes: Float[np.ndarray, "k n batch"]
    curvatures: Float[np.ndarray, "k n n batch"]
    limit: Int[np.ndarray, "k batch"]
    time: Float[np.ndarray, "k batch"]
    fixed: Bool[np.ndarray, "k batch"]

    def take(self, index: np.ndarray) -> "Model":
        """Return the models of some searches."""
        return Model(*(x[..., index] for x in self))


def build(searches: Searches, z: Float[np.ndarray, "n batch"], peaks: Peaks) -> Model:
    """Build the local models of a batch of searches, each at its own `z`."""
    n, count = z.shape
    slope, curvature = cost_derivatives(searches, z)
    rows = int(peaks.rank.max(initial=-1)) + 1
    value, slopes = np.full((rows, count), ABSENT), np.zeros((rows, n, count))
    curvatures, time = np.zeros((rows, n, n, count)), np.zeros((rows, count))
    limit, fixed = np.full((rows, count), -1), np.zeros((rows, count), bool)
    limit[peaks.rank, peaks.owner], time[peaks.rank, peaks.owner] = peaks.limit, peaks.time
    fixed[peaks.rank, peaks.owner] = peaks.fixed
    curves = CurveJets(searches, z)
    top = np.full(count, ABSENT)
    np.maximum.at(top, peaks.owner, peaks.value)
    bends = ~peaks.fixed | (peaks.value > top[peaks.owner] - CLOSE)
    for k in range(len(searches.limits)):
        all_own = np.flatnonzero(peaks.limit == k)
        bent = bends[all_own]
        for own in [all_own] if all_own.size <= TOGETHER else [all_own[bent], all_own[~bent]]:
            if own.size:
                owner, rank = peaks.owner[own], peaks.rank[own]
                g, gradient, hessian = _rows(searches, curves, k, Peaks(*(x[own] for x in peaks)), bends[own])
                value[rank, owner], slopes[rank, :, owner] = g, gradient.T
                curvatures[rank, :, :, owner] = np.moveaxis(hessian, 2, 0)
    for k, zone in enumerate(searches.zones, len(searches.limits)):
        own = np.flatnonzero(peaks.limit == k)
        if own.size:
            owner, rank = peaks.owner[own], peaks.rank[own]
            g, gradient, hessian = _loosened(peaks.value[own], *_in_zone(curves, zone, Peaks(*(x[own] for x in peaks))))
            value[rank, owner], slopes[rank, :, owner] = g, gradient.T
            curvatures[rank, :, :, owner] = np.moveaxis(hessian, 2, 0)
    return Model(slope, curvature, value, slopes, curvatures, limit, time, fixed)


def cost_derivatives(searches: Searches, z: Float[np.ndarray, "n batch"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients and the Hessians of the costs."""
    problem = searches.problem
    if not problem.objective.is_formula:
        return custom.derivatives(problem, z)
    cost = searches.formulas.cost(variables(z))
    n, count = z.shape
    return np.broadcast_to(cost.gradient, (n, count)), np.broadcast_to(cost.hessian, (n, n, count))


def costs(searches: Searches, z: Float[np.ndarray, "n batch"]) -> Float[np.ndarray, " batch"]:
    """Return the costs."""
    if not searches.problem.objective.is_formula:
        return (custom.values(searches.problem, z) - searches.problem.offset) / searches.problem.scale + 1
    return np.broadcast_to(searches.formulas.cost(z), searches.count)


def objective_values(problem: Problem, z: Any) -> Any:
    """Return the values of the objective of a batch of problems, with variables (n, batch), in NumPy or JAX."""
    return problem.objective.value(problem, z) if problem.objective.is_formula else custom.values(problem, z)


def _rows(
    searches: Searches, curves: CurveJets, k: int, peaks: Peaks, bends: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the constraints of peaks of limit `k` with gradients and, where `bends` is true, Hessians in z."""
    name = tuple(searches.limits)[k]
    if bends.any():
        g, slopes, hessian = _expanded(curves, name, peaks.owner, peaks.time, peaks.value, peaks.fixed)
        gradient = slopes
        if not searches.is_clearance[k]:
            g, gradient, hessian = _loosened(g, slopes, hessian, bends)
        # A constraint without Hessian has the gradient that it has below, so that it does not depend on the batch size.
        return g, np.where(bends, gradient, _finite(slopes)), np.where(bends, hessian, 0.0)
    gradient = _finite(curves.expand(name, peaks.owner, peaks.time, second=False).gradient)
    return peaks.value, gradient, np.zeros((curves.n, curves.n, peaks.value.size))


def _in_zone(curves: CurveJets, zone: AnyZone, peaks: Peaks) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients and the Hessians in z of the constraints in a zone, at peaks and at fixed points."""
    owner, time = peaks.owner, peaks.time
    if isinstance(zone, SpeedZone):
        return _expanded(curves, zone.name, owner, time, peaks.value, peaks.fixed, zone.values[0])[1:]
    return expand_in_zone(curves, zone, owner, time, ~(peaks.fixed | peaks.edge))[1:]


def _finite(gradient: np.ndarray) -> np.ndarray:
    """Return the gradients, with zeros instead of those that are not finite."""
    return np.where(np.isfinite(gradient).all(axis=0), gradient, 0.0)


def _expanded(
    curves: CurveJets,
    name: str,
    owner: np.ndarray,
    time: np.ndarray,
    value: np.ndarray,
    fixed: np.ndarray,
    limit: Any = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the constraint values of one limit at peaks and at fixed times, and their gradients and Hessians in z."""
    n = curves.n
    g = curves.expand(name, owner, time, limit=limit)
    rate, second, mixed = g.gradient[n], g.hessian[n, n], g.hessian[:n, n]
    inner = ~fixed & (time > 0) & (time < 1) & (second < 0)
    drift = np.where(inner, -mixed / np.where(inner, second, 1.0), 0.0)
    # Correct the slope for the distance between the time of the exact peak and the time that the search found.
    gradient = g.gradient[:n] + np.where(inner, drift * rate, 0.0)
    hessian = g.hessian[:n, :n] + drift[:, None] * mixed
    return value, gradient, hessian


def _loosened(
    value: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, chosen: Any = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return constraint values with gradients and Hessians, expressed by squares where they are chosen and `LOOSE`."""
    loose = (value < LOOSE) & chosen
    square = np.where(loose, np.exp(2 * value), 1.0)
    hessian = square * hessian + (2 * loose * square) * (gradient[:, None] * gradient)
    gradient = square * gradient
    good = np.isfinite(gradient).all(axis=0) & np.isfinite(hessian).all(axis=(0, 1)) & (value < -ABSENT / 2)
    value = np.where(loose, 0.5 * (square - 1), value)
    return value, np.where(good, gradient, 0.0), np.where(good, hessian, 0.0)


def replaced(
    old: Model, multipliers: np.ndarray, index: np.ndarray, new: Model, carried: np.ndarray
) -> tuple[Model, np.ndarray]:
    """Replace the models and multipliers of some searches."""
    if index.size == multipliers.shape[1]:
        return new, carried
    kept = np.ones(multipliers.shape[1], bool)
    kept[index] = False
    kept_index = np.flatnonzero(kept)
    model, both = side_by_side(old.take(kept_index), multipliers[:, kept_index], new, carried)
    order = np.argsort(np.concatenate([kept_index, index]))
    return model.take(order), both[:, order]


def side_by_side(a: Model, of_a: np.ndarray, b: Model, of_b: np.ndarray) -> tuple[Model, np.ndarray]:
    """Join the models and the multipliers of two batches of searches, with rows for the larger number of peaks."""
    rows = max(len(a.value), len(b.value))
    blanks = (None, None, ABSENT, 0.0, 0.0, -1, 0.0, False, 0.0)
    parts = []
    for x, y, blank in zip((*a, of_a), (*b, of_b), blanks, strict=True):
        if blank is not None:
            x, y = (
                np.concatenate([part, np.full((rows - len(part), *part.shape[1:]), blank, part.dtype)])
                for part in (x, y)
            )
        parts.append(np.concatenate([x, y], axis=-1))
    return Model(*parts[:-1]), parts[-1]
