"""Define `retime`, which computes the fastest timing along a given path."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits, require_limits
from qtraj.design.proof.certificate import require_float64
from qtraj.design.timing.braking import Braked, braked
from qtraj.design.timing.by_speed import one_interval
from qtraj.design.timing.constraints import all_names, uses_vehicle
from qtraj.design.timing.creeping import evenly
from qtraj.design.timing.differentiated import with_derivatives
from qtraj.design.timing.ends import Begun, begun, known_speeds
from qtraj.design.timing.formula_limits import of_third_order
from qtraj.design.timing.judged import judged
from qtraj.design.timing.laps import require_lap, require_no_stops
from qtraj.design.timing.lower_bound import excess_over_bound
from qtraj.design.timing.outcome import Retimed
from qtraj.design.timing.own_requirements import require_formulas
from qtraj.design.timing.part_search import Posed
from qtraj.design.timing.part_timing import TimedPart, moving_time, timed
from qtraj.design.timing.parts import STOP_DISTANCE, Part, known_segments, known_zero, of_path, stops_of
from qtraj.design.timing.prescribed import gentlest, ratios
from qtraj.design.timing.requirements import (
    faster_than_bound,
    require_bounded_at_stops,
    require_duration,
    require_knots,
    require_known_along,
    require_moving,
    require_one_path,
    require_regular,
    require_representable,
    require_start_and_stop,
    require_stop,
    require_timing_limits,
    require_tolerance,
    speed_at,
)
from qtraj.design.timing.result_code import REACHED, accuracy_code
from qtraj.design.timing.retimed_cells import of_parts
from qtraj.design.timing.road_cells import road_of
from qtraj.design.timing.shape_limits import require_checkable, with_shape_limits
from qtraj.design.timing.sources import source
from qtraj.design.timing.standstill import with_stops
from qtraj.design.timing.timing import RetimedPath, speeds_at_ends
from qtraj.design.varying import Varying, on_path, table
from qtraj.foundation.arrays import constants, is_traced
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.namespace import in_float64
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.seconds import seconds
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.route import Route
from qtraj.path.shape import Shape


@of_one_device
def retime(
    path: AbstractHodograph | Shape,
    limits: Limits,
    start_speed: ArrayInput | None = None,
    end_speed: ArrayInput | None = None,
    knots: int | None = None,
    *,
    tolerance: float = 1e-3,
    duration: float | None = None,
    stop_speed: float = 0.0,
    stop_distance: float = STOP_DISTANCE,
    periodic: bool | None = None,
    throw: bool = False,
) -> Retimed:
    """Compute the fastest timing along `path` that satisfies `limits`; the shape of the path does not change.

    `limits` may contain `speed`, `acceleration`, `lateral_acceleration`, `longitudinal_acceleration`, `vertical_speed`,
    `vertical_acceleration`, `jerk`, `yaw_rate`, `yaw_acceleration`, `curvature_rate`, `angular_rate` and, with a
    vehicle, `friction`, `power` and `normal_load`. `speed`, `vertical_speed`, `yaw_rate`, `curvature_rate`, the power,
    the load, and the longitudinal, vertical and yaw acceleration may have two sides, as in
    `longitudinal_acceleration=(-6, 2)`. Own quantities (`Quantity`) may contain derivatives up to the jerk, but not the
    position. Where an own quantity divides by the speed, its value at an instant at rest is its limit there, which must
    be finite. Limits on quantities of the shape, such as the curvature, and obstacles that do not move are the same for
    every timing: they are checked once, and are part of the certificate.

    Limits may change along the way (`Along`): in a cell in which a limit changes, its strictest value holds, and such
    cells are small.

    `start_speed` and `end_speed` [m/s] are the speeds at both ends: zero for rest, or None to let the search choose the
    speed. A speed is met to about 1e-9 of its value if it is lower by 0.1 % than the highest one within the limits, and
    closer to that to 0.2 %; inside jit, vmap and grad, it is only an upper bound, and zero must be a Python number, not
    an array. At an end at rest where the
    velocity of `path` itself is not zero, the acceleration jumps, so a limit on the jerk applies only between the ends.

    A vehicle may start faster than the limits allow, because of a limit at the start or of a bend ahead. If the
    longitudinal acceleration is limited, it then brakes as strongly as this limit allows until it meets the fastest
    timing from a lower speed; with a limit on the jerk, braking ends gradually, and its first acceleration is free. The
    code of the result is `starts_above_limits`, a success with a note: every limit is satisfied from `braking_time` [s]
    and `braking_distance` [m] on. The certificate is for the whole path, so the limits that are violated before are
    "broken", and `certificate.holds` is false. In all other cases, and inside jit, the code is `end_speed_not_reached`,
    and the text says what to do.

    Let u be the path parameter. The function u̇²(u) is a cubic spline, whose cells are small where the path bends,
    where |r'(u)| is small and where the active limit changes. Cells are halved until the distance of the duration from
    the minimum over all timings is at most `tolerance`, relative to the duration. The field `gap` of the result is a
    bound on this distance, or an estimate (see `Retimed`). To within the tolerance, the result does not depend on the
    speed |r'(u)| of the parameter. With a limit on the jerk, a very slow parameter may prevent this: see `gap` and the
    code. With `knots`, a power of two, `knots` cells of almost equal length are used instead; for a traced path or
    traced limits, as in jit and grad, 512 is the default.

    The acceleration of the result may jump only at a joint of a route where the acceleration of the route jumps.

    A route is divided at its stops. Each drive between two stops is timed from rest to rest, and the stops keep their
    durations. With `stop_speed` > 0, an interval is also treated as a stop if the speed is at most `stop_speed` [m/s]
    and the vehicle stays within `stop_distance` [m]. There the path of the result differs from `path` by at most that
    distance. Where a recorded vehicle creeps next to a stop or halts for a moment (see `fit_route`), the path parameter
    of the result is not the recorded time: the same curves are passed with a nearly constant rate of progress, in the
    same time.

    With `duration` [s], the timing takes so long and accelerates as gently as possible: the limits on accelerations are
    multiplied by the number `share` of the result, at most 1, the limit on the jerk by share^1.5, and the fastest
    timing for these limits has the duration. If a positive speed at an end is given, the duration is met to within
    `tolerance`.

    A `Shape` has no stops, and its path parameter is a length instead of a time. `periodic`, by default true for a
    closed shape unless a speed is given, computes a flying lap: the end of the path is its start, where speed,
    acceleration and the second derivative of u̇²(u) are continuous. So the limits are proved on a lap that is repeated.

    An interior-point method minimises the duration. The cost of a step is proportional to the number of cells. Without
    limits on jerk, power and own quantities the problem is convex. Limits are imposed at the knots and at one point
    inside each cell, and are tightened in cells where they are violated between these points. If the path is
    polynomial, the limits are then proved to be satisfied on every cell. At a stop, friction and power count as zero.
    `duration`, `path` and `speeds` are differentiable with respect to the path and the limits, in forward and reverse
    mode; the largest values of the certificate are constants. `jax.vmap` and `jax.lax.map` create batches. A route must
    have known values, as under `grad` and `jvp` outside `jit` and `vmap`; it has derivatives with respect to the states
    of its joints, but not with respect to their times, or to velocities and accelerations of zero at stops. In all
    derivatives the cells and the tightening are constant. The limits of a route may be traced.

    The limits must bound the speed, otherwise the result has the code `speed_unbounded`. On a straight path, limits on
    friction and accelerations bound the speed only if a speed is given at one end, and a limit on power only if
    `start_speed` is given.

    **Raises:** ValueError for limits that are not supported, obstacles that move, free speeds without a limit that can
    bound them, limits and speeds whose powers overflow, a negative speed, `knots` that is not a power of two from 16 to
    16384, a wrong `tolerance` or `duration`, a `duration`, own quantities, sides of the power, limits on the shape or
    obstacles with traced arguments, a traced path in float32, a path that has a timing already, a batch, a path other
    than a route whose velocity is zero at an instant, a route inside `jit` or `vmap` or with differentiated times, a
    route that is always at rest, has a velocity of zero within a segment, or whose velocity jumps (with a limit on the
    jerk, also a route whose acceleration jumps), and a route with stops and a limit on power but none on acceleration,
    friction or jerk; with `periodic`, for a path that does not end as it starts or has stops, and for a speed at an
    end. RuntimeError with `throw` if the retiming fails.
    """
    of_shape = isinstance(path, Shape)
    if isinstance(path, Shape):
        free = start_speed is None and end_speed is None
        path, stop_speed, periodic = path.route, 0.0, path.closed and free if periodic is None else periodic
    require_path(path)
    if isinstance(path, RetimedPath):
        raise ValueError(
            "this path has a timing already: pass its original path, path.path, which has the same shape, to time it "
            "with other limits"
        )
    require_limits(limits)
    require_one_path(path, limits)
    require_known_along(path, limits, (start_speed, end_speed))
    path, limits = in_float64((path, limits.on(path)))
    require_float64(path)
    lap = bool(periodic)
    if lap:
        require_lap(path, start_speed, end_speed)
    require_checkable(limits, path, (start_speed, end_speed))
    require_formulas(limits, path, (start_speed, end_speed))
    names = require_timing_limits(limits, start_speed is None and end_speed is None and not isinstance(path, Route))
    knots = None if knots is None else require_knots(knots)
    require_tolerance(tolerance)
    given = limits.given()
    require_stop(stop_speed, stop_distance)
    if isinstance(path, Route) and stop_speed > 0:
        path = with_stops(path, known_segments(path), stop_speed, stop_distance)
    path = evenly(path) if isinstance(path, Route) else path
    with np.errstate(over="ignore"):  # reported below
        parts, standing = of_path(path, (*names, *(["jerk"] if of_third_order(names) else [])), of_shape)
    require_no_stops(lap, len(parts), any(standing))
    require_bounded_at_stops(names, any(any(part.stops) for part in parts))
    speeds = tuple(speed_at(v, side) for v, side in ((start_speed, "start"), (end_speed, "end")))
    bounds = {name: given[name] for name in all_names(names) if name in given}
    bounds, ends = on_path(bounds, path), (parts[0].start, parts[-1].end)
    require_moving(bounds, speeds, ends, stops_of(parts))
    require_start_and_stop(bounds, speeds, stops_of(parts))
    speeds = tuple(faster_than_bound(v, bounds, u) for v, u in zip(speeds, ends, strict=True))
    vehicle = limits.vehicle if uses_vehicle(names) else None
    road = None if vehicle is None else road_of(limits, path, is_traced(path, limits, speeds))
    if not is_traced(path, bounds, road, speeds):
        bounds = {name: x if isinstance(x, Varying | OfSpeed) else np.asarray(x) for name, x in bounds.items()}
        speeds = jax.tree.map(np.asarray, speeds)
        road = road if isinstance(road, RoadOnPath) else jax.tree.map(np.asarray, road)
    posed = Posed(path, source(constants(path)), bounds, road, names, lap, knots, tolerance)
    require_duration(duration := seconds(duration), is_traced(path, bounds, road, speeds))
    *found, gap, share, time, distance = _retimed(posed, parts, standing, speeds, duration)
    more = {"gap": gap, "share": share, "wanted": known_speeds(speeds)}
    more |= {"braking_time": time, "braking_distance": distance}
    more["bounds"] = table(bounds, names, found[0].timing.knots, lambda: speeds_at_ends(found[0]))
    retimed = Retimed(*found, vehicle=vehicle, of_shape=of_shape, combined=limits.combined_acceleration, **more)
    retimed = with_shape_limits(retimed, limits)
    return retimed.check() if throw else retimed


def _retimed(
    p: Posed,
    parts: list[Part],
    standing: tuple[bool, bool],
    speeds: tuple[Scalar | None, ...],
    duration: float | None,
) -> tuple[Any, ...]:
    """Return the fields of `Retimed` without the vehicle."""
    wanted: Any = tuple(np.asarray(np.inf) if v is None else v for v in speeds)
    begins = begun(p.path, wanted, np.array(standing))
    require_representable(p.bounds, begins.highest)
    if not isinstance(p.path, Route):
        require_regular(begins.slowest)
    rest = (known_zero(speeds[0]) and not standing[0], known_zero(speeds[1]) and not standing[1])

    traced = is_traced(p.path, p.bounds, p.vehicle, speeds)

    def of_parts_with(p: Posed, bounded: bool = False) -> list[tuple[TimedPart, Any]]:
        found = []
        for k, part in enumerate(parts):
            first, last = k == 0, k == len(parts) - 1
            ends = begins.free if not (first or last) else begins.largest[(first, last)]
            at_rest = (rest[0] and first, rest[1] and last)
            own, grid = timed(p, part, ends, at_rest)
            if bounded and part.moves:
                time = moving_time([(own, grid)], at_rest)
                own = own._replace(excess=np.asarray(excess_over_bound(p, part, ends, at_rest, time)))
            found.append((own, grid))
        return found

    share, given = np.nan, p
    if duration is not None:
        waits = sum(float(part.end - part.start) for part in parts if not part.moves)
        keeps_ends = any(v is not None and float(v) > 0 for v in speeds)
        given, share = gentlest(p, duration - waits, keeps_ends, lambda p: moving_time(of_parts_with(p), rest))
    found = of_parts_with(given, bounded=p.knots is not None and duration is None and not traced)
    brakes = None if duration is not None else _braked(p, parts[0], found[0], begins)
    found[0] = found[0] if brakes is None else brakes[:2]
    judge = with_derivatives(judged) if traced else judged
    own, grids = (list(x) for x in zip(*found, strict=True))
    cells = of_parts(grids, [part.stops for part in parts])
    *result, code, steps, gap = judge(
        p.path, own, p.bounds, (begins.pace, begins.wanted), p.vehicle, cells, p.names, rest
    )
    if duration is not None:
        result[3], gap = result[3] * ratios(p.names, p.bounds, share)[:, None], np.asarray(np.nan)
    elif not one_interval(p.bounds):
        gap = np.asarray(np.nan)
    if not traced and code == ResultCode.successful:
        code = accuracy_code(float(result[1]), duration, np.nan if p.knots is not None else float(gap), p.tolerance)
    if brakes is not None and brakes.holds and code == ResultCode.limits_broken:
        code = np.asarray(int(ResultCode.starts_above_limits))
    return *result, code, steps, gap, share, *((0.0, 0.0) if brakes is None else brakes[2:4])


def _braked(p: Posed, part: Part, found: tuple[TimedPart, Any], begins: Begun) -> Braked | None:
    """Return the timing of the first part if it has to start above its limits, otherwise None."""
    if is_traced(found[0].powers, begins.wanted, begins.pace) or not np.isfinite(begins.wanted[0]):
        return None
    reached = np.sqrt(np.maximum(found[0].powers[0, 0], 0.0)) * begins.pace[0]
    missed = begins.pace[0] > 0 and reached < begins.wanted[0] * (1 - REACHED)
    return braked(p, part, found, begins.wanted[0]) if missed else None
