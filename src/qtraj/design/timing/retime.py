"""Define `retime`, which computes the fastest timing along a given path."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float, Int

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import PROVED, SAMPLED, Certificate, require_float64
from qtraj.design.timing import findings
from qtraj.design.timing.constraints import NAMES, listed
from qtraj.design.timing.outcome import Retimed
from qtraj.design.timing.parts import (
    STOP_DISTANCE,
    Part,
    known_zero,
    of_path,
    standing as standing_route,
)
from qtraj.design.timing.proof import prove
from qtraj.design.timing.requirements import (
    require_bounded_at_stops,
    require_knots,
    require_limits,
    require_regular,
    require_stop,
    speed_at,
)
from qtraj.design.timing.retimed_cells import Cells, of_parts
from qtraj.design.timing.retimed_maxima import Limited, largest_in
from qtraj.design.timing.road import ROAD
from qtraj.design.timing.search import MARGIN, Found, Problem, fastest, last_gap, tables
from qtraj.design.timing.sources import Source, source
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.vehicle import RoadParameters

KNOTS = 512

REACHED = 1e-5
"""An end speed counts as reached if it is lower than required by at most this fraction."""


def retime(
    path: AbstractHodograph,
    limits: Limits,
    start_speed: ArrayInput | None = None,
    end_speed: ArrayInput | None = None,
    knots: int | None = None,
    *,
    stop_speed: float | None = None,
    stop_distance: float = STOP_DISTANCE,
    throw: bool = False,
) -> Retimed:
    """Compute the fastest timing along `path` that satisfies `limits`; the shape of the path does not change.

    `limits` may contain only limits that depend on the timing: `speed`, `acceleration`, `lateral_acceleration`,
    `longitudinal_acceleration`, `jerk`, `yaw_rate`, `yaw_acceleration`, `angular_rate` and, with a vehicle, `friction`
    and `power`. `start_speed` and `end_speed` [m/s] are the speeds at both ends: zero for rest, or None to let the
    search choose the speed. Inside jit, vmap and grad, a speed of zero must be a Python number, not an array. At an end
    at rest where the velocity of `path` itself is not zero, the acceleration jumps, so a limit on the jerk applies only
    between the ends.

    Let u be the path parameter. The function u̇²(u) is a cubic spline with continuous second derivative and `knots`
    cells; `knots` is a power of two, by default 512. With more cells the duration is closer to the minimum over all
    timings.

    A route is divided at its stops. Each drive between two stops is timed with at least `knots` cells, from rest to
    rest, and the stops keep their durations. An interval is also treated as a stop if the speed is at most `stop_speed`
    [m/s] and the vehicle stays within `stop_distance` [m]. There the path of the result differs from `path` by at most
    that distance. The default of `stop_speed` is 0.2 m/s, but at most 2 % of the highest speed; with zero the path is
    unchanged.

    An interior-point method minimises the duration. The cost of a step is proportional to the number of cells. Without
    limits on jerk and power the problem is convex. Limits are imposed at the knots and at one point inside each cell,
    and are tightened in cells where they are violated between these points. If the path is polynomial, the limits are
    then proved to be satisfied on every cell. At a stop, friction and power count as zero. `duration`, `path` and
    `speeds` are differentiable with respect to the path and the limits, in forward and reverse mode; the largest
    values of the certificate are constants. `jax.vmap` and `jax.lax.map` create batches. A route must have concrete
    values, but its limits may be traced.

    The limits must bound the speed, otherwise the result has the code `speed_unbounded`. On a straight path, limits on
    friction and accelerations bound the speed only if a speed is given at one end, and a limit on power only if
    `start_speed` is given.

    **Raises:** ValueError for limits that do not depend on the timing, free speeds without a limit that can bound them,
    a negative speed, `knots` that is not a power of two from 16 to 16384, float32, a path other than a route whose
    velocity is zero at an instant, a route that is traced, is always at rest, reverses within a segment, or whose
    velocity jumps (with a limit on the jerk, also a route whose acceleration jumps), and a route with stops and a limit
    on power but none on acceleration, friction or jerk. RuntimeError with `throw` if the retiming fails.
    """
    require_float64(path)
    names = require_limits(limits, start_speed is None and end_speed is None and not isinstance(path, Route))
    knots = KNOTS if knots is None else knots
    require_knots(knots)
    given = limits.given()
    if isinstance(path, Route):
        path = standing_route(path, *require_stop(stop_speed, stop_distance))
    parts, standing = of_path(path, knots, "jerk" in given)
    require_bounded_at_stops(names, any(any(part.stops) for part in parts))
    speeds = tuple(speed_at(v, side) for v, side in ((start_speed, "start"), (end_speed, "end")))
    bounds = {name: jnp.asarray(given[name], path.duration.dtype) for name in NAMES if name in given}
    vehicle = limits.vehicle if set(names) & set(ROAD) else None
    road = None
    if vehicle is not None:
        road = RoadParameters(*(jnp.asarray(x, path.duration.dtype) for x in limits.road(path.duration.dtype)))
    found = _retimed(path, parts, standing, bounds, road, speeds, names)
    retimed = Retimed(*found, vehicle)
    return retimed.check() if throw else retimed


class _Timed(NamedTuple):
    """The timing of a part: coefficients of u̇², usage and status of limits in each cell, knots, and search result.

    The usage of a limit is the ratio of the quantity to the limit. The search result is None for a stop.
    """

    powers: Float[Any, "cells 4"]
    usage: Float[Any, "limits cells"]
    codes: Int[Any, "limits cells"]
    knots: Float[Array, " cells+1"]
    found: Found | None


def _retimed(
    path: AbstractHodograph,
    parts: list[Part],
    standing: tuple[bool, bool],
    bounds: dict[str, Scalar],
    vehicle: RoadParameters | None,
    speeds: tuple[Scalar | None, ...],
    names: tuple[str, ...],
) -> tuple[RetimedPath, Scalar, Certificate, Array, Array, Array, Array]:
    """Return the fields of `Retimed` without the vehicle."""
    wanted: Any = tuple(np.asarray(np.inf, path.duration.dtype) if v is None else v for v in speeds)
    begins = _begun(path, wanted, np.array(standing))
    if not isinstance(path, Route):
        require_regular(begins.slowest)
    rest = (known_zero(speeds[0]) and not standing[0], known_zero(speeds[1]) and not standing[1])
    timed, polynomials = [], stop_gradient(source(path))
    for k, part in enumerate(parts):
        first, last = k == 0, k == len(parts) - 1
        ends = begins.free if not (first or last) else begins.largest[(first, last)]
        at_rest = rest[0] and first, rest[1] and last
        timed.append(_timed(path, polynomials, part, bounds, vehicle, ends, at_rest, names))
    enough = np.array([last_gap(part.grid.cells) for part in parts if part.grid is not None])
    ends = begins.pace, begins.wanted
    return _judged(path, timed, bounds, ends, enough, vehicle, of_parts(parts), names, rest)


class _Begun(NamedTuple):
    """Speeds and bounds on a = u̇² at the ends of a path with the parameter u.

    `pace` are the speeds |r'(u)| at both ends, and `wanted` the prescribed speeds. `largest` contains the bounds on a
    at both ends of a part, by (is first part, is last part); `free` are the infinite bounds for all other parts.
    `slowest` is the lowest speed |r'(u)| divided by the highest.
    """

    pace: Float[Array, " 2"]
    wanted: Float[Array, " 2"]
    largest: dict[tuple[bool, bool], Float[Array, " 2"]]
    free: Float[Array, " 2"]
    slowest: Scalar


@eqx.filter_jit
def _begun(path: AbstractHodograph, wanted: tuple[Any, Any], standing: Any) -> _Begun:
    times = path.duration * jnp.linspace(0.0, 1.0, 257, dtype=path.duration.dtype)
    speeds = jax.vmap(lambda t: jnp.linalg.norm(path.velocity(t)))(times)
    pace = jnp.where(standing, 0.0, speeds[jnp.array([0, -1])])
    goal = jnp.stack([jnp.asarray(v, pace.dtype) for v in wanted])
    bounded = (pace > 0) & (goal > 0) & jnp.isfinite(goal)
    ratio = jnp.where(bounded, goal, 1.0) / jnp.where(pace > 0, pace, 1.0)  # the divisor 1 keeps derivatives finite
    largest, free = jnp.where(bounded, ratio**2, jnp.inf), jnp.full_like(pace, jnp.inf)
    sides = [(True, False), (False, True), (True, True)]
    of_parts = {side: jnp.where(np.array(side), largest, free) for side in sides}
    return _Begun(pace, goal, of_parts, free, jnp.min(speeds) / jnp.max(speeds))


def _timed(
    path: AbstractHodograph,
    polynomials: Source | None,
    part: Part,
    bounds: dict[str, Scalar],
    vehicle: RoadParameters | None,
    ends: Array,
    rest: tuple[bool, bool],
    names: tuple[str, ...],
) -> _Timed:
    dtype = path.duration.dtype
    start, end = (jnp.asarray(x, dtype) for x in part[:2])
    grid = part.grid
    if grid is None:
        unit, nothing = np.array([[1.0, 0, 0, 0]], dtype), np.zeros((len(listed(names, vehicle is not None)), 1), dtype)
        return _Timed(unit, nothing, np.full((len(NAMES), 1), PROVED, np.int32), jnp.stack([start, end]), None)
    stops = np.array(part.stops)
    problem = Problem(path, start, end, bounds, ends, vehicle, stops)
    found = fastest(problem, tables(grid, rest, "jerk" in bounds))
    codes = np.full((len(NAMES), grid.cells), SAMPLED, np.int32)
    if polynomials is not None:
        given = stop_gradient({name: bounds[name] for name in names})
        codes = prove(
            polynomials, grid, (stop_gradient(found.powers), np.array(rest)), given, stop_gradient(vehicle)
        ).codes
    return _Timed(found.powers, found.usage, codes, _knots(start, end, grid.knots), found)


@jax.jit
def _knots(start: Scalar, end: Scalar, knots: Float[Array, " cells+1"]) -> Float[Array, " cells+1"]:
    return start + knots * ((end - start) / (knots.size - 1))


@eqx.filter_jit
def _judged(
    path: AbstractHodograph,
    timed: list[_Timed],
    bounds: dict[str, Scalar],
    speeds: tuple[Array, Array],
    enough: Float[Any, " searches"],
    vehicle: RoadParameters | None,
    cells: Cells,
    names: tuple[str, ...],
    rest: tuple[bool, bool],
) -> tuple[RetimedPath, Scalar, Certificate, Array, Array, Array, Array]:
    """Combine the timings of all parts, and return the fields of `Retimed`."""
    knots = jnp.concatenate([timed[0].knots[:1], *(x.knots[1:] for x in timed)])
    timing = Timing(jnp.concatenate([x.powers for x in timed]), knots, rest)
    own = np.array([NAMES.index(name) for name in names])
    rows = listed(names, any(name in ROAD for name in names))
    usage = jnp.concatenate([x.usage for x in timed], axis=1)
    usage = usage[np.array([rows.index(name) for name in names])] * (1 - MARGIN)
    codes = jnp.concatenate([x.codes for x in timed], axis=1)[own]
    codes = findings.with_straight(path, knots, codes, names)
    limits, cell = jnp.stack([bounds[name] for name in names]), findings.worst_cell(codes, usage)
    retimed = stop_gradient(RetimedPath(path, timing))
    times, largest = largest_in(Limited(retimed, cells, *stop_gradient((bounds, vehicle))), cell, names)
    certificate = findings.certificate(codes, times, stop_gradient(largest * limits), limits, path.polynomials(), names)
    searches = [x.found for x in timed if x.found is not None]
    powers, (pace, wanted) = timing.coefficients, speeds
    squares = jnp.where(np.array(rest), 0.0, jnp.stack([powers[0, 0], jnp.sum(powers[-1])]))
    ends = jnp.where(squares > 0, jnp.sqrt(jnp.where(squares > 0, squares, 1.0)), 0.0) * pace
    missed = jnp.any(jnp.isfinite(wanted) & (ends < wanted * (1 - REACHED)))
    # Rest at an end changes the structure of the problem, so it must be known: report a traced speed of zero.
    ignored = jnp.any((wanted <= 0) & (ends > 0))
    unbounded = jnp.any(jnp.stack([found.unbounded for found in searches]))
    found = jnp.all(jnp.stack([found.error for found in searches]) < enough)
    code = jnp.where(missed, int(ResultCode.end_speed_not_reached), certificate.code)
    code = jnp.where(found, code, int(ResultCode.not_converged))
    code = jnp.where(jnp.isfinite(powers).all() & jnp.isfinite(timing.duration), code, int(ResultCode.not_finite))
    code = jnp.where(unbounded, int(ResultCode.speed_unbounded), code)
    code = jnp.where(ignored, int(ResultCode.rest_unknown), code)
    code = jnp.where(jnp.isnan(wanted).any(), int(ResultCode.not_finite), code)
    time = stop_gradient(timing.duration) + sum(found.sensitivity for found in searches)
    steps = sum((found.steps for found in searches), jnp.zeros((), jnp.int32))
    return RetimedPath(path, timing), time, certificate, usage, ends, code, steps
