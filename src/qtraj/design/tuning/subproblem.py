"""Compute the steps of a batch of searches by convex quadratic programs (QPs) in the step d and the violation t."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.tuning import qp
from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.model import LOOSE, Model
from qtraj.design.tuning.peaks import Peaks
from qtraj.design.tuning.searches import Searches

FAR = 1e3  # a constraint at this distance, in trust radii, is out of reach of a step

ACTIVE = 1e-7  # a constraint with a multiplier above this value is active
AT_BOUND = 1e-7  # a variable within this distance of a bound is at the bound
PENALISED = 0.9  # above this ratio of the multiplier sum to the penalty, the limits cannot be satisfied yet
MAX_STIFFNESS = 1e-4  # upper limit of ε in the term ½εt² that makes the QP strictly convex in the violation t
MIN_PIVOT = 1e-7  # smallest pivot of an accepted Hessian, relative to its largest entry
SQUARES = (1.0, 30.0, 1e3)
"""Weights of the squared active constraints that are added to an indefinite Hessian, in the order of trial.

The squares change the model away from the constraints, so a step with them may not reduce the merit function. After a
rejected step, they are not added.
"""

FLOOR = 1e-5
"""The smallest eigenvalue of a Hessian that remains indefinite with all squares, relative to its largest entry; there
negative eigenvalues change sign, because a step is then long along small negative eigenvalues only."""

COARSE, FINE = 1e-7, 1e-13
"""Tolerances of a QP for the first steps and for the last steps of a search."""

SAME = 0.1
"""Peaks of two paths correspond to each other if their times differ by less than this fraction of the duration."""


class Step(NamedTuple):
    """A step `d` with its multipliers, allowed violation and predicted decrease of the merit function.

    `residual` is the largest component of the gradient of the Lagrangian, divided by the penalty.
    """

    d: Float[np.ndarray, "n batch"]
    multipliers: Float[np.ndarray, "k batch"]
    allowed_violation: Float[np.ndarray, " batch"]
    predicted_decrease: Float[np.ndarray, " batch"]
    residual: Float[np.ndarray, " batch"]


def compute_step(
    searches: Searches,
    z: Float[np.ndarray, "n batch"],
    model: Model,
    multipliers: Float[np.ndarray, "k batch"],
    penalty: Float[np.ndarray, " batch"],
    radius: Float[np.ndarray, " batch"],
    size: Float[np.ndarray, " batch"],
    squared: Bool[np.ndarray, " batch"],
    values: Float[np.ndarray, "k batch"] | None = None,
) -> Step:
    """Compute the steps of a batch of searches.

    `size` is the size of the last step, from which the accuracy of the QP follows, because steps become smaller
    quadratically. `squared` is true if squares of active constraints may be added. `values` are the constant terms of
    the linearised constraints, by default the constraint values at `z`.
    """
    n = len(z)
    free = searches.high > searches.low
    values = model.value if values is None else values
    slopes = model.slopes * free
    slope = searches.weight * model.slope * free
    lagrangian = searches.weight * model.curvature + np.einsum("kb,kijb->ijb", multipliers, model.curvatures)
    lagrangian = np.where(free[:, None] & free, lagrangian, 0.0)
    convex, centred, offset, square_weight = _convex(
        lagrangian, free, slopes, values, np.where(squared, multipliers, 0.0), penalty
    )
    scale = np.maximum(penalty, 1.0)
    low, high = (
        np.where(free, x / radius, y)
        for x, y in ((np.maximum(searches.low - z, -radius), -1.0), (np.minimum(searches.high - z, radius), 1.0))
    )
    hessian = convex * (radius / scale)
    gradient = slope + square_weight * np.einsum("kb,kib->ib", offset, centred)
    minimising = searches.weight == 0
    program = qp.QP(
        hessian=hessian,
        gradient=gradient / scale,
        normals=slopes,
        values=np.maximum(values / radius, -FAR),
        low=low,
        high=high,
        penalty=penalty / scale,
        stiffness=np.minimum(np.trace(hessian) / n, MAX_STIFFNESS),
        lowest=np.where(minimising, np.maximum(-1 / radius, -FAR), 0.0),
        tolerance=COARSE * np.minimum(size, 1.0) ** 2 + FINE,
    )
    d, t, own = qp.minimise(program)
    d = np.where(free, np.clip(d, low, high) * radius, 0.0)
    linear = values + np.einsum("kib,ib->kb", slopes, d)
    own = own * scale + square_weight * (offset + np.einsum("kib,ib->kb", centred, d))
    own = np.where(values > ABSENT, np.maximum(own, 0.0), 0.0)
    own = own * np.minimum(1.0, penalty / np.maximum(own.sum(axis=0), penalty))
    floor = np.where(minimising, -1.0, 0.0)
    before, after = (np.maximum(x.max(axis=0, initial=-1.0), floor) for x in (model.value, linear))
    change = (slope * d).sum(axis=0) + 0.5 * np.einsum("ib,ijb,jb->b", d, lagrangian, d)
    inside = free & (z > searches.low + AT_BOUND) & (z < searches.high - AT_BOUND)
    balance = slope + np.einsum("kb,kib->ib", own, slopes)
    residual = np.abs(np.where(inside, balance, 0.0)).max(axis=0) / scale
    return Step(d, own, t * radius, penalty * (before - after) - change, residual)


def _convex(
    lagrangian: np.ndarray,
    free: np.ndarray,
    slopes: np.ndarray,
    values: np.ndarray,
    multipliers: np.ndarray,
    penalty: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return positive definite Hessians, and the slopes, the values and the weight of the squares in them.

    The squares of active constraints do not change the solution while the constraints remain active. If the limits
    cannot be satisfied, all active constraint values equal the violation, so their mean is subtracted.
    """
    active = multipliers > ACTIVE
    count = np.maximum(active.sum(axis=0), 1)
    penalised = multipliers.sum(axis=0) > PENALISED * penalty
    centred = np.where(active[:, None], slopes, 0.0)
    offset = np.where(active, values, 0.0)
    means = np.where(penalised, centred.sum(axis=0) / count, 0.0), np.where(penalised, offset.sum(axis=0) / count, 0.0)
    centred = np.where(active[:, None], centred - means[0], 0.0)
    offset = np.where(active, offset - means[1], 0.0)
    size = np.maximum(np.abs(lagrangian).max(axis=(0, 1)), 1.0)
    n = range(len(lagrangian))
    result = np.array(lagrangian)
    result[n, n] += np.where(free, 0.0, size)
    weight = np.zeros_like(size)
    rest = np.flatnonzero(~_is_definite(result, size))
    if rest.size == 0:
        return result, centred, offset, weight
    base, squares = result[..., rest], np.einsum("kib,kjb->ijb", centred[..., rest], centred[..., rest])
    for part in SQUARES:
        trial = base + part * size[rest] * squares
        result[..., rest], weight[rest] = trial, part * size[rest]
        still = ~_is_definite(trial, size[rest])
        rest, base, squares = rest[still], base[..., still], squares[..., still]
        if rest.size == 0:
            return result, centred, offset, weight
    result[..., rest] = _flipped(base + size[rest] * squares, size[rest])
    weight[rest] = size[rest]
    return result, centred, offset, weight


def _is_definite(matrix: np.ndarray, size: np.ndarray) -> np.ndarray:
    return qp.cholesky(matrix)[1] > MIN_PIVOT * size


def _flipped(matrix: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return matrices with the absolute values of the eigenvalues."""
    finite = np.isfinite(matrix).all(axis=(0, 1))
    values, vectors = np.linalg.eigh(np.moveaxis(np.where(finite, matrix, 0.0), 2, 0))
    values = np.maximum(np.abs(values), FLOOR * np.nan_to_num(size, nan=1.0, posinf=1.0)[:, None])
    return np.moveaxis((vectors * values[:, None]) @ np.swapaxes(vectors, 1, 2), 0, 2)


def corresponding(searches: Searches, model: Model, peaks: Peaks) -> Float[np.ndarray, "k batch"]:
    """Return the values of the peaks of other paths that correspond to the constraints of a model."""
    rows, count = model.value.shape
    distance, result = np.full((rows, count), SAME), np.array(model.value)
    for j in range(int(peaks.rank.max(initial=-1)) + 1):
        own = np.flatnonzero(peaks.rank == j)
        owner, value = peaks.owner[own], peaks.value[own]
        apart = np.abs(model.time[:, owner] - peaks.time[own])
        same = (model.limit[:, owner] == peaks.limit[own]) & (model.fixed[:, owner] == peaks.fixed[own])
        nearer = same & (apart < distance[:, owner])
        loose = (model.value[:, owner] < LOOSE) & ~searches.is_clearance[peaks.limit[own]]
        form = np.where(loose, 0.5 * (np.exp(2 * np.minimum(value, 10.0)) - 1), value)
        distance[:, owner] = np.where(nearer, apart, distance[:, owner])
        result[:, owner] = np.where(nearer, form, result[:, owner])
    return result


def transferred(multipliers: np.ndarray, old: Model, new: Model) -> Float[np.ndarray, "k batch"]:
    """Assign the multipliers of the constraints of a model to the nearest peaks of the same limit in another model."""
    result = np.zeros(new.value.shape)
    columns = np.arange(new.value.shape[1])
    for row in range(len(multipliers)):
        apart = np.abs(new.time - old.time[row]) + 2.0 * (new.limit != old.limit[row])
        if not len(apart):
            break
        nearest = apart.argmin(axis=0)
        found = (apart[nearest, columns] < 1.5) & (multipliers[row] > 0)
        np.add.at(result, (nearest[found], columns[found]), multipliers[row, found])
    return result
