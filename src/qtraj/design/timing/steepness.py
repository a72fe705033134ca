"""Find out whether a road is too steep or too banked for a limit on friction, however slowly the vehicle drives."""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.timing import road
from qtraj.design.timing.constraints import parts
from qtraj.design.timing.grid import path_derivatives
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.road_on_path import road_on
from qtraj.path.vehicle import Vehicle


def friction_at_rest(
    path: AbstractHodograph, vehicle: Vehicle, u: Float[np.ndarray, " m"]
) -> tuple[float, Float[np.ndarray, " 3"]]:
    """Return the largest fraction of the available friction that gravity alone needs, and the position there [m].

    It is infinite if a slow vehicle would fall off the road somewhere; the position is then where its load is lowest.
    `u` are the parameters of the path at which it is evaluated.
    """
    one: Any = np.ones(())
    known = road_on(vehicle, path).at(u) if vehicle.on_changing_road else vehicle.parameters()
    parameters = known.each(np.asarray)
    with np.errstate(all="ignore"):  # at a stop, friction counts as zero
        found = parts(np.asarray(path_derivatives(path, u)), one, {"friction": one}, parameters).road
        usage = np.nan_to_num(road.used(found, np.zeros((2, u.size)))[0]) if found is not None else np.zeros(u.size)
    load = np.ones(u.size) if found is None else found.onto[0]
    off = load.min() < 0
    worst = int(np.argmin(load) if off else np.argmax(usage))
    return np.inf if off else float(usage[worst]), np.asarray(path.position(u[worst]))
