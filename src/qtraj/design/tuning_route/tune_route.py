"""Define `tune_route`, which changes a whole route so that it satisfies its limits within a tube."""

from __future__ import annotations

from typing import Any

import numpy as np

from qtraj.design.limits import Limits, require_limits
from qtraj.design.proof.certificate import require_float64
from qtraj.design.tuning_route import circuit, rounds
from qtraj.design.tuning_route.geometry import moved_states
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.design.tuning_route.sensitivity import Solution, differentiable
from qtraj.design.tuning_route.setup import Parts, parts, problem_of
from qtraj.design.tuning_route.shapes import route_in_tube
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput
from qtraj.path.quantity import QUANTITIES, quantity
from qtraj.path.route import Route
from qtraj.path.shape import Shape

OBJECTIVES = ("nearest", "smoothest", "fastest")

UNSUITABLE = tuple(name for name, entry in QUANTITIES.items() if entry.divisor == "cross_norm")
"""Limits on quantities of the natural trihedral, which does not exist on straights."""


CONTINUOUS = 1e-9
"""Largest jump at a joint that counts as rounding error, relative to the states of the joints."""


def tune_route(
    route: Route | Shape,
    limits: Limits,
    tube: ArrayInput | tuple[ArrayInput, ArrayInput] | None = None,
    objective: str | None = None,
    fixed: ArrayInput | None = None,
    *,
    closed: bool = False,
    max_steps: int = 300,
    throw: bool = False,
) -> TunedRoute:
    """Change a `route` so that it satisfies `limits` everywhere and stays within a tube around the original route.

    The positions of the joints (across the path), their velocities and accelerations, and the durations of the
    segments change together. `tube` [m] is the half-width, by default 0.5, or a pair (horizontal, vertical) of
    half-widths. Each is one number or an array with one number for each joint, interpolated linearly. Distances are
    measured at equal fractions of corresponding segments.

    `objective`, by default "nearest":

    - "nearest" [m²]: the mean over the original route of |δr|² + s²|δr'|² + s⁴|δr''|² + s²(v δh/h)². Here δ is the
      change at equal fractions of a segment, derivatives are with respect to the original time, s is the mean duration
      of the segments that change, v is the original speed, and δh is the change of the duration h of the segment;
    - "smoothest" [m²/s⁵]: ∫|r⃛|²dt; the duration of the route, or of each part between stops, does not change;
    - "fastest" [s]: the duration; at least one limit must bound the speed. Because many routes are almost as fast, the
      search adds a term with the squared jerk; this term is about 0.1 % of the duration.

    `fixed`: a bool array, true where the state of a joint does not change; (n,), or (n, 3) for position, velocity and
    acceleration separately. By default the states at both ends are fixed, so that a tuned `window` joins the rest of
    the route without a jump in position, heading or curvature. The time of a joint may change even if its state is
    fixed. Segments that touch a stop are not changed.

    `closed`: whether the route is a closed circuit, which must end where it starts. The last joint then has the same
    position, velocity and acceleration as the first joint, and by default no state is fixed. So the limits are proved
    on the whole lap, including the transition to the next lap.

    A `Shape` has no times: first its fastest timing is computed, a flying lap if it is closed, from which the search
    starts. The default objective is "fastest", and `closed` is that of the shape. The tube is by default that of its
    widths, less 1 m on both sides; or `tube` (n, 2) contains the distances [m] to the right and to the left at each
    joint, as in `shape.widths - 1.2`. The reference line then is the middle between the edges, and the tube has half
    of their distance; its vertical half-width is 0.05 m.

    The method is a primal-dual interior-point method with exact second derivatives (Wächter and Biegler 2006). The cost
    of a step is proportional to the number of segments. The method satisfies the limits at eleven instants of each
    segment, with margins for larger values between them. Then `certify` checks whole segments, and the margins are
    reduced until everything is proved, in at most eleven searches (twelve for "fastest") with `max_steps` steps in
    total. The result is a local optimum with the code `successful`. The code is `not_optimal` if everything is proved
    but the search stopped before the optimum. Two more codes refer to segments that touch a stop: `broken_at_stops` and
    `undefined_at_stops`.

    Segments that change become quintics, and position, velocity and acceleration are continuous at their joints, even
    if they jump in the original route. Segments that touch a stop keep their coefficients and the jumps between them.

    **Derivatives**: under `grad`, `jvp`, `jacfwd` and `jacrev`, outside `jit` and `vmap`, `path`, `objective`,
    `displacement` and `delay` have the derivatives of the optimum with respect to the route (the states of its
    joints and its times), the limits and the tube, by the implicit function theorem. The derivatives refer to the
    problem of the last search, with limits at its instants and constant margins. They are NaN if that search does not
    converge.

    **Raises:** ValueError for a path that is not a route, a batch, arguments inside jit or vmap, a route in float32, an
    unknown objective, a limit on the natural trihedral (which does not exist on straights) or on forces, "fastest"
    without a limit that bounds the speed, half-widths that are not positive, a wrong shape, or a `closed` route that
    does not end where it starts, has only one segment, or has different half-widths at its ends; for a shape also
    without widths and tube, with edges nearer than the margins, and without a fastest timing. RuntimeError with `throw`
    if a limit is not proved to be satisfied.
    """
    if isinstance(route, Shape):
        require_limits(limits)
        objective, closed = objective or "fastest", route.closed
        _names(limits, objective)
        route, tube = route_in_tube(route, limits, tube)
    tube, objective = 0.5 if tube is None else tube, objective or "nearest"
    _require_route(route, limits)
    names = _names(limits, objective)

    def solve(route: Route, limits: Limits, tube: Any) -> Solution:
        return _solution(route, limits, names, tube, objective, fixed, closed, max_steps)

    if is_traced(route, limits, tube):
        result = differentiable(route, limits, tube, names, objective, solve)
    else:
        result = solve(route, limits, tube).result
    return result.check() if throw else result


def _solution(
    route: Route,
    limits: Limits,
    names: tuple[str, ...],
    tube: Any,
    objective: str,
    fixed: Any,
    closed: bool,
    max_steps: int,
) -> Solution:
    """Return the result and the search behind it, for concrete arguments."""
    if closed:
        circuit.require_closed(route)
    given = parts(route, closed)
    joints = len(given.h) + 1
    widths, held = _widths(tube, joints, closed), _fixed(fixed, joints, closed)
    bounds = np.array([float(np.asarray(limits.given()[name])) for name in names])
    problem = problem_of(given, names, bounds, widths, held, objective, objective == "smoothest", closed)
    found = _unchanged(route, given, limits, widths, problem)
    moving = problem.moving > 0
    smooth = not np.any(problem.offset) and not _jumps(route, given)
    if moving.any() and not (objective == "nearest" and smooth and found.proved):
        found = rounds.solved(route, given, limits, widths, problem, max_steps)
    return Solution(_result(given, problem, found, names, moving, objective), found.problem, found.z, found.at)


def _jumps(route: Route, given: Parts) -> bool:
    """Return whether position, velocity or acceleration jump at a joint by more than rounding errors."""
    step = float(given.h.mean()) ** np.arange(3)[:, None]
    size = float(np.abs(given.states * step).max())
    return bool(np.any(np.abs(np.asarray(route.jumps())) * step > CONTINUOUS * size))


def _unchanged(route: Route, given: Parts, limits: Limits, tube: np.ndarray, problem: RouteProblem) -> rounds.Found:
    """Return the given route unchanged, and whether it satisfies its limits and stays within its tube."""
    z = np.zeros(problem.free.shape)
    judged = rounds.judge(route, given, limits, tube, problem, z)
    open_ = rounds.unproved(judged, problem.names, problem.moving > 0)
    return rounds.Found(z, judged, not open_.any(), 0, problem)


def _result(
    given: Parts,
    problem: RouteProblem,
    found: rounds.Found,
    names: tuple[str, ...],
    moving: np.ndarray,
    objective: str,
) -> TunedRoute:
    judged = found.judged
    states, h = moved_states(problem, given.states, given.h, found.z)
    return TunedRoute(
        judged.route,
        judged.certificate,
        np.sum(h) if objective == "fastest" else rounds.attained(problem, found.z),
        judged.distances,
        judged.within.all(axis=1),
        states[:, 0] - given.states[:, 0],
        np.sum(h - given.h),
        ~moving,
        _code(found, names),
        found.steps,
    )


def _code(found: rounds.Found, names: tuple[str, ...]) -> ResultCode:
    certificate = found.judged.certificate
    if not found.proved:
        if not np.isfinite(found.judged.distances).all():
            return ResultCode.not_finite
        return ResultCode.route_not_converged if found.exhausted else ResultCode.route_not_found
    if any(certificate.status[name] not in ("proved", "undefined") for name in names):
        return ResultCode.broken_at_stops
    if not found.optimal:
        return ResultCode.not_optimal
    return ResultCode.successful if certificate.holds else ResultCode.undefined_at_stops


def _require_route(route: Any, limits: Any) -> None:
    if not isinstance(route, Route):
        raise ValueError(
            f"route must be a Route, but {described(route)} was given. Use tune for a SpiralHelix, or convert it "
            "with Route.from_path."
        )
    require_limits(limits)
    if route.duration.ndim:
        raise ValueError("tune_route accepts one route, but a batch was given: call it once for each route")
    require_float64(route)


def _names(limits: Limits, objective: str) -> tuple[str, ...]:
    names = tuple(limits.given())
    require_suitable(names, objective)
    return names


def require_suitable(names: tuple[str, ...], objective: str) -> None:
    """Raise a ValueError if a route cannot be tuned for this objective within limits of these names."""
    wrong = [name for name in names if name in UNSUITABLE]
    if wrong:
        raise ValueError(
            f"tune_route does not support limits on {', '.join(wrong)}, because the natural trihedral does not exist "
            "on the straight parts of a route. Limit curvature, yaw_rate or yaw_acceleration instead."
        )
    forces = [name for name in names if quantity(name).on_road]
    if forces:
        raise ValueError(
            f"tune_route does not support limits on {', '.join(forces)}. Limit lateral_acceleration and "
            "longitudinal_acceleration instead, and check the vehicle's limits with certify."
        )
    if objective not in OBJECTIVES:
        raise ValueError(f"the objective must be one of {', '.join(OBJECTIVES)}, but {objective!r} was given")
    if objective == "fastest" and not any(quantity(name).bounds_speed for name in names):
        raise ValueError(
            "the fastest route needs a limit that bounds the speed, such as speed, acceleration, lateral_acceleration "
            "or yaw_rate. On straight parts, lateral_acceleration and yaw_rate do not bound the speed: if the route "
            "has straight parts, limit speed, too."
        )


def _widths(tube: Any, joints: int, closed: bool) -> np.ndarray:
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


def _fixed(fixed: Any, joints: int, closed: bool) -> np.ndarray:
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
