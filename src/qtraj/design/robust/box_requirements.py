"""Checks of the arguments of proofs and tunings for boxes."""

from __future__ import annotations

from typing import Any

import numpy as np

from qtraj.design.limits import Limits, require_limits
from qtraj.design.obstacles.keep_out import refuse_obstacles
from qtraj.design.robust.box import PATH_STATES, ROUTE_STATES, STATES, VEHICLE, Box
from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import require_concrete
from qtraj.path.driving import segments_of
from qtraj.path.quantity import quantity
from qtraj.path.route import Route
from qtraj.path.spiral_helix import SpiralHelix

LEAST_MASS = 1e-10
"""Smallest ratio of the lowest mass to the highest one."""


def require_box(path: Any, limits: Limits, box: Box) -> None:
    """Raise a ValueError for arguments of `certify_box` that are not supported."""
    require_type(path, SpiralHelix | Route, "path", "a SpiralHelix or a Route")
    require_type(box, Box, "box", "a Box, such as Box(start_speed=0.5)")
    require_limits(limits)
    require_concrete("certify_box", path, limits)
    if np.ndim(path.duration):
        raise ValueError(f"certify_box is for one path, but a batch of shape {np.shape(path.duration)} was given")
    require_box_limits(limits, box, "certify_box")
    require_states(box, isinstance(path, Route))
    if isinstance(path, Route):
        require_no_stops(path, "certify_box")
        return
    level = source_is_vertical(path)
    for name in limits.given():
        if not level and quantity(name).upright:
            raise ValueError(
                f"{name} depends on the vertical, so it needs a path with a vertical axis: omit this limit"
            )


def require_states(box: Box, of_route: bool) -> None:
    """Raise a ValueError for deviations of states that paths of another kind have."""
    known = ROUTE_STATES if of_route else PATH_STATES
    for name in box.names:
        if name in STATES and name not in known:
            what, other = ("a route has no axis", "spiral-helices") if of_route else ("a spiral-helix turns", "routes")
            raise ValueError(f"{name} is only for {other}, because {what}: pass any of {', '.join(known)}")


def require_no_stops(route: Route, what: str) -> None:
    """Raise a ValueError for a route with stops."""
    if route.progress is not None or segments_of(route).composed.any():
        raise ValueError(f"{what} needs a route without stops: pass a window between two stops")


def require_box_limits(limits: Limits, box: Box, what: str) -> None:
    """Raise a ValueError for limits that cannot be proved for a box."""
    refuse_obstacles(limits, what, "omit keep_out")
    limits.require_constant(what, "pass one value for the whole path")
    if not limits.given():
        raise ValueError(f"{what} needs at least one limit, such as Limits(speed=8.0)")
    names = {each for name in limits.given() for each in (name, quantity(name).base or name)}
    if unknown := sorted(box.limits.keys() - names):
        raise ValueError(f"box.limits contains {unknown[0]!r}, but there is no such limit in limits")
    for name in limits.given():
        if quantity(name).own is not None:
            raise ValueError(f"{name} is a quantity of your own, which {what} does not support: omit this limit")
    vehicle = limits.vehicle
    if vehicle is not None and (vehicle.road is not None or np.ndim(vehicle.mass)):
        raise ValueError(f"{what} needs one vehicle, on a road that does not change: pass bank and friction as numbers")
    moved = [name for name in box.names if name in VEHICLE]
    if not moved:
        return
    if vehicle is None:
        raise ValueError(
            f"the {moved[0]} deviates, but limits have no vehicle: pass Limits(..., vehicle=Vehicle(mass=...))"
        )
    if "drag_area" in moved and float(np.asarray(vehicle.drag_area)) + box.intervals["drag_area"][0] < 0:
        raise ValueError(
            f"the drag area {float(np.asarray(vehicle.drag_area)):g} m² must stay 0 or more: make its interval smaller"
        )
    if "mass" in moved:
        low, high = (float(np.asarray(vehicle.mass)) + x for x in box.intervals["mass"])
        if not low > LEAST_MASS * high:
            raise ValueError(
                f"the mass {float(np.asarray(vehicle.mass)):g} kg must stay positive, and its lowest value at least "
                f"{LEAST_MASS:g} of the highest one: make its interval smaller"
            )


def source_is_vertical(path: SpiralHelix) -> bool:
    """Return whether the axis of the path is vertical."""
    if path.placement is None:
        return True
    _, x, y, z = np.asarray(path.placement.orientation, float)
    w = float(np.asarray(path.placement.orientation)[0])
    return (x == 0 and y == 0) or (w == 0 and z == 0)
