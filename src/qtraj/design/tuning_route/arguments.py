"""Read and check the arguments of `tune_route`."""

from __future__ import annotations

from typing import Any

import numpy as np

from qtraj.design.along import Variable
from qtraj.design.bound import numbers
from qtraj.design.ellipse import OfSpeed
from qtraj.design.limit_checks import refuse_changing
from qtraj.design.limits import Limits, require_limits
from qtraj.design.own_limits import require_reduced
from qtraj.design.proof.certificate import require_float64
from qtraj.design.timing.speed_ratio import require_zero_allowed
from qtraj.design.tuning_route import along
from qtraj.design.tuning_route.scales import is_shifted
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import concrete, is_traced
from qtraj.path.quantity import bound_speed, quantity
from qtraj.path.route import Route

OBJECTIVES = ("nearest", "smoothest", "fastest")


def require_route(route: Any, limits: Any) -> None:
    """Raise a ValueError if `route` is not one route in float64, or `limits` are not limits."""
    if not isinstance(route, Route):
        raise ValueError(
            f"route must be a Route, but {described(route)} was given. Use tune for a SpiralHelix, or convert it "
            "with Route.from_path."
        )
    require_limits(limits)
    if route.duration.ndim:
        raise ValueError(
            "tune_route accepts one route, but a batch was given: call it once for each route, or map it with jax.vmap"
        )
    require_float64(route)


def limited(limits: Limits, objective: str) -> tuple[str, ...]:
    """Return the names of the limits; raise a ValueError if they do not suit the objective."""
    bounds = limits.given()
    require_suitable(tuple(bounds), objective)
    require_zero_allowed(bounds, "tune_route")
    for name, bound in bounds.items():
        if isinstance(bound, OfSpeed):
            continue
        known, shifted = concrete(numbers(bound)), is_shifted(name) and not along.changes(limits)
        if (
            not shifted
            and quantity(name).bounds_side
            and known is not None
            and not (quantity(name).side * known > 0).all()
        ):
            raise ValueError(
                f"tune_route needs two-sided limits that allow zero, with a lower bound below and an upper bound above "
                f"it, but {name} = {known.tolist()} was given"
            )
    return tuple(bounds)


def require_suitable(names: tuple[str, ...], objective: str) -> None:
    """Raise a ValueError if a route cannot be tuned for this objective within limits of these names."""
    require_reduced(names, "tune_route", in_world=True, order=3)
    # The natural trihedral does not exist on straights.
    wrong = dict.fromkeys(x.base or x.name for x in map(quantity, names) if x.divisor == "cross_norm")
    if wrong:
        raise ValueError(
            f"tune_route does not support limits on {', '.join(wrong)}, because the natural trihedral does not exist "
            "on the straight parts of a route. Limit curvature, yaw_rate or yaw_acceleration instead."
        )
    if objective not in OBJECTIVES:
        raise ValueError(f"the objective must be one of {', '.join(OBJECTIVES)}, but {objective!r} was given")
    if objective == "fastest" and not bound_speed(names):
        raise ValueError(
            "the fastest route needs a limit that bounds the speed, such as speed, acceleration, lateral_acceleration "
            "or yaw_rate. On straight parts, lateral_acceleration and yaw_rate do not bound the speed: if the route "
            "has straight parts, limit speed, too."
        )


def require_differentiable(limits: Limits, nearest_to: Any) -> None:
    """Raise a ValueError for limits or a path that `tune_route` supports only for concrete arguments."""
    if nearest_to is not None:
        raise ValueError("tune_route does not support nearest_to inside jit, vmap, grad or jvp: call it outside")
    own = {name: x for name, x in limits.given().items() if isinstance(x, Variable)}
    by_speed = {name: x for name, x in own.items() if isinstance(x, OfSpeed)}
    along_way = {name: x for name, x in own.items() if name not in by_speed}
    refuse_changing(along_way, "tune_route inside jit, vmap, grad or jvp", "call it outside")
    if is_traced(by_speed):
        raise ValueError(
            "tune_route needs limits by speed with concrete values: create them outside jit, vmap, grad and jvp. Its "
            "results have no derivatives with respect to them"
        )
    if limits.along_road:
        raise ValueError(
            "tune_route does not support a road that changes along the way inside jit, vmap, grad or jvp: call it "
            "outside"
        )
    if is_traced(limits.keep_out, limits.body):
        raise ValueError(
            "tune_route needs obstacles and a body with concrete values: create them outside jit, vmap, grad and jvp. "
            "Its results have no derivatives with respect to them"
        )
    if is_traced(limits.vehicle):
        raise ValueError(
            "tune_route needs a vehicle with concrete values: it has no derivatives with respect to the vehicle"
        )


def half_widths(tube: Any, joints: int, closed: bool) -> np.ndarray:
    """Return the half-widths (joints, 2) [m]."""
    pair = tube if isinstance(tube, tuple) else (tube, tube)
    if len(pair) != 2:
        raise ValueError(
            f"the tube must be one half-width or a pair (horizontal, vertical), but {len(pair)} half-widths were given"
        )
    columns = []
    for value in pair:
        width = np.asarray(value, float)
        if width.shape not in ((), (joints,)):
            raise ValueError(
                f"a half-width of the tube must be a number or an array of shape ({joints},), one value for each "
                f"joint, but an array of shape {width.shape} was given"
            )
        columns.append(np.broadcast_to(width, (joints,)))
    widths = np.stack(columns, axis=1)
    if not (np.isfinite(widths).all() and (widths > 0).all()):
        raise ValueError("the half-widths of the tube must be positive and finite [m]")
    if closed and np.any(widths[0] != widths[-1]):
        raise ValueError(
            "the first and the last joint of a closed route are the same, but the half-widths "
            f"{widths[0].tolist()} and {widths[-1].tolist()} m were given for them: pass equal values"
        )
    return widths


def fixed_states(fixed: Any, joints: int, closed: bool) -> np.ndarray:
    """Return whether each state of each joint is fixed (joints, 3)."""
    if fixed is None:
        held = np.zeros((joints, 3), bool)
        held[[0, -1]] = not closed
        return held
    given = np.asarray(fixed)
    if given.dtype != bool or given.shape not in ((joints,), (joints, 3)):
        raise ValueError(
            f"fixed must be a bool array of shape ({joints},), one value for each joint, or ({joints}, 3), one each "
            f"for its position, velocity and acceleration, but an array of {given.dtype} of shape {given.shape} was "
            "given"
        )
    return np.broadcast_to(given.reshape(joints, -1), (joints, 3)).copy()
