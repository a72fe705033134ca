"""Limits with vehicles whose mass and drag area deviate."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.path.vehicle import Vehicle


def deviating(vehicle: Vehicle, deviations: Float[np.ndarray, "n 2"]) -> Vehicle:
    """Return a batch of vehicles with deviations of the mass [kg] and of the drag area [m²], which is at least zero."""
    mass = np.asarray(vehicle.mass, float) + deviations[:, 0]
    area = np.maximum(np.asarray(vehicle.drag_area, float) + deviations[:, 1], 0.0)
    batch = repeated(vehicle, len(deviations))
    return eqx.tree_at(lambda x: (x.mass, x.drag_area), batch, (mass, area))


def with_vehicles(limits: Limits, deviations: Float[np.ndarray, "n 2"]) -> Limits:
    """Return a batch of limits with the vehicles of `deviating`."""
    vehicle: Any = limits.vehicle
    return eqx.tree_at(lambda x: x.vehicle, repeated(limits, len(deviations)), deviating(vehicle, deviations))


def repeated(tree: Any, count: int) -> Any:
    """Return a tree of arrays as a batch of equal ones."""
    return jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), (count, *np.shape(x))), tree)
