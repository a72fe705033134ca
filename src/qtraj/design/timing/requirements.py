"""Check the arguments of `retime`."""

from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any

import numpy as np

from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.timing.constraints import NAMES, all_names
from qtraj.design.timing.formula_limits import own_names
from qtraj.design.timing.road import ROAD
from qtraj.design.timing.sided import SIDES_OF_RATES, SLOWEST
from qtraj.design.varying import Varying, all_values
from qtraj.foundation.arrays import concrete, is_traced, real_scalar
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.own_facts import is_infinite_at_rest
from qtraj.path.quantity import bound_speed, quantity
from qtraj.path.route import Route
from qtraj.path.vehicle_data import batch_of

ACCELERATIONS = ("acceleration", "longitudinal_acceleration", "friction", "jerk")
"""Limits that bound the acceleration at a stop, also with two sides."""

MIN_KNOTS, MAX_KNOTS = 16, 2**14
"""Smallest and largest number of cells between two stops; with 2**15 cells, a search with a limit on the jerk did not
converge."""


LEAST_TOLERANCE = 1e-5
"""Smallest tolerance; the optimality errors of searches with many cells are of this size."""

ABOVE = 3e-5
"""Least relative distance of the speed at an end from a lower bound on the speed."""

REPRESENTABLE = 1e50
"""Largest limit and speed; the sixth power of a number up to this bound is finite."""


def require_one_path(path: AbstractHodograph, limits: Limits) -> None:
    """Raise an error for a batch of paths, limits or vehicles."""
    if shape := path.duration.shape:
        advice = "call it once for each route; the first one is jax.tree.map(lambda x: x[0], path)"
        if not isinstance(path, Route):
            advice = "use jax.vmap(lambda path: qtraj.retime(path, limits, knots=512))(paths)"
        raise ValueError(f"retime expects one path, but a batch of shape {shape} was given: {advice}")
    shapes = {f"the limit {name}": x.shape for name, x in limits.constant().items()}
    for what, shape in (shapes | {"the vehicle": batch_of(limits.vehicle)}).items():
        if shape:
            raise ValueError(
                f"retime expects one set of limits and one vehicle, but {what} has the batch shape {shape}: use "
                "jax.vmap(lambda limits: qtraj.retime(path, limits, knots=512))(limits)"
            )


def require_known_along(path: AbstractHodograph, limits: Limits, speeds: Any) -> None:
    """Raise an error for a traced path or traced limits if a limit is not constant; for traced `speeds` by speed."""
    by_speed = any(isinstance(x, OfSpeed) for x in limits.given().values())
    if limits.varying and is_traced(path, limits, speeds if by_speed else None):
        raise ValueError(
            f"the limit {limits.varying[0]} is not constant, which retime supports only for a path, limits and speeds "
            "with concrete values: call it outside jit, grad and vmap"
        )


def require_timing_limits(limits: Limits, free: bool) -> tuple[str, ...]:
    """Return the names of the limits on the timing; raise an error if one is not supported, or the speed is unbounded.

    `free` indicates that neither end speed is prescribed; then a limit that bounds the speed is required.
    """
    names = tuple(name for name in limits.given() if not quantity(name).of_shape)
    sides = [name for name in names if name not in NAMES and quantity(name).base in NAMES]
    if sides:
        base = quantity(sides[0]).base
        raise ValueError(
            f"retime supports only one number as a limit on {base}, but {limits!r} was given: pass a number, and check "
            "the other side with qtraj.certify on the path of the result"
        )
    if unknown := list(_without_sides(name for name in names if name not in all_names(names))):
        raise ValueError(
            f"retime supports limits only on quantities of the shape, such as the curvature, on own quantities, and on "
            f"{', '.join(_without_sides(NAMES))}. Remove the limits on "
            f"{', '.join(unknown)}, and check them with qtraj.certify on the path of the result."
        )
    require_sides(limits)
    bounding = [name for name in NAMES if quantity(name).bounds_speed]
    if not bound_speed(names) and (free or not set(names) - {SLOWEST}):
        raise ValueError(
            f"retime needs a limit that bounds the speed, but {limits!r} was given. Add one of {', '.join(bounding)}; "
            "if the path has straight parts, add a limit on the speed, or pass start_speed or end_speed. On the "
            "command line, pass for example --limit speed=13.9 (in m/s), or write a table [limits] in a scenario."
        )
    return names


def require_sides(limits: Limits) -> None:
    """Raise an error for a two-sided limit on a rate that does not allow zero."""
    for name, bound in limits.given().items():
        known = concrete(all_values(bound))
        if name in SIDES_OF_RATES and known is not None and not (quantity(name).side * known > 0).all():
            raise ValueError(
                f"the two-sided limit on {quantity(name).base} must allow zero, its value on straight or level parts, "
                f"but {name} = {known.tolist()} was given"
            )


def require_moving(
    bounds: Mapping[str, Any], speeds: tuple[Scalar | None, ...], ends: tuple[Any, Any], stops: list[Any]
) -> None:
    """Raise an error if the vehicle stops, or is too slow at an end, despite a lower bound on the speed.

    `ends` are the parameters of the path at its ends, and `stops` those at its stops.
    """
    at = [(u, 0.0, "the path has a stop there") for u in stops]
    at += [(u, v, "the given speed is lower") for u, v in zip(ends, speeds, strict=True) if v is not None]
    for u, v, contrary in at:
        least, speed = _slowest_at(bounds, u), concrete(v)
        if least is None or speed is None or not ((speed < least) & (least > 0)).any():
            continue
        where = f" at {float(u):.6g} s" if isinstance(bounds[SLOWEST], Varying) else ""
        raise ValueError(
            f"the speed must be at least {least.tolist()} m/s{where}, but {contrary}: omit the lower bound, or pass a "
            "path without stops, and a start_speed and an end_speed within the limits"
        )


def require_start_and_stop(bounds: Mapping[str, Any], speeds: tuple[Scalar | None, ...], stops: list[Any]) -> None:
    """Raise an error if the vehicle rests somewhere, but limits do not allow this.

    A limit by speed may not allow it to start or to stop, and a constant limit on an own quantity that is infinite at
    rest allows neither.
    """
    start, end = (None if v is None else concrete(v) for v in speeds)
    starts, ends = bool(stops) or (start is not None and start == 0), bool(stops) or (end is not None and end == 0)
    for name, needed, what in (
        ("longitudinal_acceleration_max", starts, "start"),
        ("longitudinal_acceleration_min", ends, "come to rest"),
    ):
        bound, side = bounds.get(name), quantity(name).side
        if needed and isinstance(bound, BySpeed) and side * (value := float(bound.at(0.0))) <= 0:
            raise ValueError(
                f"the limit {name} is {value:.6g} m/s² at 0 m/s, so the vehicle cannot {what}: pass a "
                f"{'positive' if side > 0 else 'negative'} value there, or a speed above zero"
            )
    constant = [name for name in own_names(bounds) if not isinstance(bounds[name], Varying)]
    infinite = [name for name in constant if is_infinite_at_rest(quantity(name).own)]
    if infinite and (starts or ends):
        raise ValueError(
            f"the quantity {quantity(infinite[0]).base or infinite[0]} is infinite where the vehicle starts or comes "
            "to rest, so no timing satisfies a limit on it: pass start_speed and end_speed above zero, or limit it "
            "only on a part of the path without stops"
        )


def _slowest_at(bounds: Mapping[str, Any], u: Any) -> np.ndarray | None:
    """Return the lower bound on the speed at a parameter of the path, or None if it is unknown."""
    bound = bounds.get(SLOWEST)
    if isinstance(bound, Varying):
        at = np.asarray(u, float)[None]
        return bound.lines(at, at)[0, 0]
    return None if bound is None else concrete(bound)


def faster_than_bound(v: Scalar | None, bounds: Mapping[str, Any], u: Any) -> Any:
    """Return the speed at an end, slightly increased if it equals the lower bound, from which the search keeps away.

    `u` is the parameter of the path at this end.
    """
    known = None if v is None else concrete(v)
    slowest = _slowest_at(bounds, u)
    if known is None or slowest is None:
        return v
    least = slowest * (1 + ABOVE)
    return least if slowest <= known < least else v


def _without_sides(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(quantity(name).base or name for name in names))


def require_bounded_at_stops(names: tuple[str, ...], stops: bool) -> None:
    """Raise an error if a route has `stops` and limits with which the acceleration there must have a bound, but none.

    A limit on power needs a bound, and a limit on one side of the acceleration along the path one on the other side.
    """
    bounded = set(ACCELERATIONS) & set(names)
    sides = [name for name in names if quantity(name).base == "longitudinal_acceleration"]
    if stops and len(sides) == 1 and not bounded:
        raise ValueError(
            "at a stop, the acceleration along the path must be limited on both sides: pass longitudinal_acceleration "
            "as a pair of two numbers, such as (-6, 2)"
        )
    if stops and {"power", "power_max"} & set(names) and not bounded and not sides:
        raise ValueError(
            "a limit on power does not bound the acceleration at a stop of a route, and no other given limit bounds it "
            f"there. Add a limit on {', '.join(ACCELERATIONS[:-1])} or {ACCELERATIONS[-1]}."
        )


def require_knots(knots: Any) -> int:
    """Return `knots`, or raise an error if it is not a power of two from `MIN_KNOTS` to `MAX_KNOTS`."""
    whole = isinstance(knots, int | np.integer) and not isinstance(knots, bool)
    if not whole or not MIN_KNOTS <= knots <= MAX_KNOTS or int(knots) & (int(knots) - 1):
        raise ValueError(
            f"knots must be a power of two from {MIN_KNOTS} to {MAX_KNOTS}, such as 512, but {knots!r} was given"
        )
    return int(knots)


def require_tolerance(tolerance: float) -> None:
    """Raise an error if the tolerance is not between `LEAST_TOLERANCE` and 1."""
    if not isinstance(tolerance, Real) or not LEAST_TOLERANCE <= tolerance < 1:
        raise ValueError(
            f"tolerance, the relative distance of the duration from the minimum, must be from {LEAST_TOLERANCE:g} to "
            f"below 1, but {tolerance!r} was given"
        )


def require_duration(duration: Any, traced: bool) -> None:
    """Raise an error if a prescribed duration is not positive and finite, or if other arguments are traced."""
    if duration is None:
        return
    known = concrete(duration)
    if traced or known is None:
        raise ValueError("duration needs a path, limits and speeds with concrete values: omit it inside jit and grad")
    if known.ndim or not (np.isfinite(known) and known > 0):
        raise ValueError(f"duration must be a positive finite number [s], but {duration!r} was given")


def require_representable(bounds: dict[str, Any], highest: Any) -> None:
    """Raise an error if a limit, or the largest |r'|, is so small or so large that its powers are not finite."""
    limits = {f"the limit on {name}": x for name, x in bounds.items() if name not in ROAD and not _infinite(x)}
    for what, value in (*limits.items(), ("the largest speed |r'| of the path", highest)):
        known = concrete(all_values(value))
        if known is None or np.isnan(known).any():  # the search reports NaN
            continue
        size = np.abs(np.asarray(known, float))
        if ((size > 0) & ((size < 1 / REPRESENTABLE) | (size > REPRESENTABLE))).any():
            raise ValueError(
                f"{what} is {float(known.flat[0]):g}, but retime computes with its powers and needs values from "
                f"{1 / REPRESENTABLE:g} to {REPRESENTABLE:g}: use other units"
            )


def _infinite(limit: Any) -> bool:
    """Return whether a limit is known to be absent."""
    known = None if isinstance(limit, Varying) else concrete(limit)
    return known is not None and bool(np.all(known == np.inf))


def require_stop(speed: float, distance: float) -> None:
    """Raise an error if the speed [m/s] or the distance [m] that defines a stop is negative."""
    for name, value, unit in (("stop_speed", speed, "m/s"), ("stop_distance", distance, "m")):
        if not isinstance(value, Real) or not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name} must be at least 0 and finite [{unit}], but {value!r} was given")


def require_regular(slowest: Scalar) -> None:
    """Raise an error if `slowest`, the ratio of the lowest to the highest speed |r'(u)|, is zero to within rounding."""
    known = concrete(slowest)
    if known is not None and not (np.asarray(known) > 1e-9).all():
        raise ValueError(
            "the velocity of the path is zero at some instant, but retime supports such stops only at the joints of a "
            "route: pass a qtraj.Route, or parametrise the path differently, for example by arc length"
        )


def speed_at(v: ArrayInput | None, side: str) -> Scalar | None:
    """Return the speed [m/s] at one end as a scalar, or None if it is free; raise an error if it is negative."""
    if v is None:
        return None
    speed: Any = real_scalar(v, f"the speed at the {side}")
    if isinstance(v, int | float):  # inside jit, `speed` is traced, but a number remains known
        speed = np.asarray(v, speed.dtype)
    known = concrete(speed)
    if known is not None and not (np.isfinite(known) and known >= 0):
        raise ValueError(f"the speed at the {side} must be at least 0 and finite [m/s], but {v!r} was given")
    return speed
