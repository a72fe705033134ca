"""The covariance of the derivatives of a fitted path at instants, from the covariance of what was fitted."""

import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.fitting.route_covariance import segment_covariances, smoothing_errors
from qtraj.design.fitting.route_system import BASIS, WIDTH
from qtraj.design.fitting.turn_covariance import sensitivities
from qtraj.foundation.methods import method
from qtraj.path import pieces, progress


def motion_covariance(fitted: Any, t: Float[np.ndarray, " n"], orders: range) -> Float[np.ndarray, "n k k"]:
    """Return the covariance of the derivatives of a fitted path at the times `t` [s], in world axes and SI units.

    `fitted` is a `Fitted` or a `FittedRoute`, in NumPy.

    The k numbers are the components x, y and z of the derivative of the first order, those of the next order, and so
    on. NaN where `is_known` is false.
    """
    if isinstance(fitted, FittedRoute):
        return np.where(is_known(fitted, t)[:, None, None], _of_route(fitted, t, orders), np.nan)
    slopes = sensitivities(fitted.path, t, orders[-1])[:, orders[0] :] @ np.asarray(fitted.factor, float)
    slopes = slopes.reshape(len(t), 3 * len(orders), -1)
    return slopes @ np.swapaxes(slopes, 1, 2)


def is_known(fitted: Any, t: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Return whether the covariance is known at the times `t` [s].

    It is not at stops, where the route is at rest because the fit decided so, and next to them, where the progress
    along the curve has no covariance.
    """
    known = np.ones(len(t), bool)
    if not isinstance(fitted, FittedRoute):
        return known
    for start, end in np.asarray(fitted.path.stops, float):
        known &= (t < start) | (t > end)
    if fitted.path.progress is not None:
        instants: Any = t
        own = fitted.path.progress[pieces.index(fitted.path.starts, instants)]
        known &= (own[:, 1:] == progress.IDENTITY[1:]).all(axis=1)
    return known


def _of_route(fitted: Any, t: Float[np.ndarray, " n"], orders: range) -> Float[np.ndarray, "n k k"]:
    """Return the covariance of the estimate, and add the square of the expected error by smoothing.

    In gaps, where the smoothing alone determines the route, the result is the covariance with the smoothing as a prior.
    """
    knots, matrix, penalty = (np.asarray(x, float) for x in (fitted.knots, fitted.information, fitted.penalty))
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
    in_gap = np.zeros(len(t), bool)
    for start, end in np.asarray(fitted.gaps, float):
        in_gap |= (start < t) & (t < end)
    estimate, prior = (x[..., i, :, :] for x in segment_covariances(matrix, penalty))
    rows = _basis((t - knots[i]) / np.diff(knots)[i], np.diff(knots)[i], orders)
    axes = rows @ np.where(in_gap[:, None, None], prior, estimate) @ np.swapaxes(rows, -1, -2)
    axes = np.broadcast_to(axes, (3, *axes.shape[-3:]))
    count, result = len(orders), np.zeros((len(t), len(orders), 3, len(orders), 3))
    for axis in range(3):
        result[:, :, axis, :, axis] = axes[axis]
    result = float(np.asarray(fitted.position_sigma)) ** 2 * result.reshape(len(t), 3 * count, 3 * count)
    errors = fitted.smoothing_errors
    if errors is None:  # in older documents
        states = np.stack([np.asarray(x, float) for x in method(fitted.path, "sampled")(knots, 2)], axis=1)
        states[:, 0] -= states[:1, 0]
        errors = smoothing_errors(matrix, penalty, states)
    shift = (rows @ np.concatenate([errors[i], errors[i + 1]], axis=1)).reshape(len(t), -1)
    shift[in_gap] = 0.0
    return result + shift[:, :, None] * shift[:, None]


def _basis(u: Float[np.ndarray, " n"], h: Float[np.ndarray, " n"], orders: range) -> Float[np.ndarray, "n orders 6"]:
    """Return the derivatives of the Hermite basis functions of segments with durations `h` [s] at fractions `u`."""
    rows = []
    for order in orders:
        factors = [math.perm(k, order) for k in range(order, WIDTH)]
        powers = u[:, None] ** np.arange(WIDTH - order)
        rows.append((powers * factors) @ BASIS[:, order:].T * h[:, None] ** (np.arange(WIDTH) % 3 - order))
    return np.stack(rows, axis=1)
