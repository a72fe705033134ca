"""Propagate the covariance of a fitted path to quantities along it, to first order (the delta method).

Let g and H be the gradient and the Hessian of a quantity with respect to the derivatives of the path, and C their
covariance. To first order the variance is gᵀCg. The terms of second order shift the mean by tr(HC)/2 and add
tr(HCHC)/2 to the variance of a normally distributed error. The root of the sum of the squared shift and the added
variance, divided by the standard deviation of first order, is the nonlinearity.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.uncertainty.motion_covariance import motion_covariance
from qtraj.design.uncertainty.quantity_expansion import expand
from qtraj.foundation.methods import method
from qtraj.path.frame_components import triple
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import ROAD_FRAME, PathQuantity
from qtraj.path.regularity import has_natural_frame, has_road_frame, has_tangent, has_upright_frame

BLOCK = 4096
"""Number of instants at once, which bounds the memory for Hessians."""

EXISTS = {"speed": has_tangent, "cross_norm": has_natural_frame, "level": has_upright_frame, ROAD_FRAME: has_road_frame}
"""Where quantities with these divisors exist; others exist where the vehicle moves."""


class Propagated(NamedTuple):
    """The value, the standard deviation and the nonlinearity of a quantity at n instants; NaN where undefined."""

    value: Float[np.ndarray, " n"]
    sigma: Float[np.ndarray, " n"]
    nonlinearity: Float[np.ndarray, " n"]


def propagate(
    fitted: Any, t: Float[np.ndarray, " n"], entries: Mapping[str, PathQuantity], road: Any
) -> dict[str, Propagated]:
    """Return each quantity in `entries` at the times `t` [s], for a `Fitted` or a `FittedRoute` in NumPy."""
    if not entries:
        return {}
    parts = [_propagate(fitted, t[k : k + BLOCK], entries, road) for k in range(0, len(t), BLOCK)]
    join = lambda name: Propagated(*map(np.concatenate, zip(*(x[name] for x in parts), strict=True)))  # noqa: E731
    return {name: join(name) for name in entries}


def _propagate(fitted: Any, t: np.ndarray, entries: Mapping[str, PathQuantity], road: Any) -> dict[str, Propagated]:
    lowest = 0 if any(x.position for x in entries.values()) else 1
    highest = max(x.order for x in entries.values())
    rows: list[Any] = [*method(fitted.path, "sampled")(t, max(highest, 3))]
    orders = range(lowest, highest + 1)
    covariance = np.moveaxis(motion_covariance(fitted, t, orders), 0, -1)
    r = np.concatenate([rows[k].T for k in orders])
    vectors, span = [triple(x) for x in rows], method(fitted.path, "span")(t)
    found = {}
    for name, entry in entries.items():
        value, gradient, hessian = expand(entry, r, lowest, road)
        exists = _exists(entry, Invariants(vectors, vehicle=road), span) & np.isfinite(value)
        found[name] = Propagated(
            np.where(exists, value, np.nan),
            *(np.where(exists, x, np.nan) for x in _moments(gradient, hessian, covariance)),
        )
    return found


def _exists(entry: PathQuantity, i: Invariants, span: Any) -> Any:
    """Return where the vehicle moves, and the quantity exists."""
    return has_tangent(i, span) & EXISTS.get(entry.divisor or "", has_tangent)(i, span)


def _moments(gradient: np.ndarray, hessian: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviation and the nonlinearity."""
    with np.errstate(all="ignore"):
        sigma = np.sqrt(np.einsum("in,ijn,jn->n", gradient, covariance, gradient, optimize=True))
        product = np.einsum("ijn,jkn->ikn", hessian, covariance)
        shift = 0.5 * np.einsum("iin->n", product)
        added = 0.5 * np.einsum("ijn,jin->n", product, product)
        second = np.sqrt(shift**2 + np.maximum(added, 0.0))
        return sigma, np.where(second == 0, 0.0 * sigma, second / sigma)
