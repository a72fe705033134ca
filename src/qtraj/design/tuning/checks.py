"""Check the input of a tuning.

Contradictory options and the data of a single ill-posed problem raise a ValueError. In a batch, each ill-posed problem
gets a result code instead.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from qtraj.design.limits import Limits, require_limits
from qtraj.design.own_limits import require_reduced
from qtraj.design.timing.speed_ratio import require_zero_allowed
from qtraj.design.tuning import inside
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.targets import named_limits
from qtraj.foundation.arrays import concrete
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import Scalar
from qtraj.path.boundary import BoundaryState, Cylindrical, require_states
from qtraj.path.boundary_problem import axis_between
from qtraj.path.quantity import QUANTITIES, bound_speed, quantity

BOUNDING = tuple(name for name, entry in QUANTITIES.items() if entry.bounds_speed)
"""Limits that bound the speed; the objective "fastest" needs at least one of these limits."""

MAX_AXIS_DISTANCE, MAX_AXIS_DISTANCE_LOOPS = 100.0, 1e3
"""Largest distance of the nearer state from the default axis, divided by the distance between the states.

Above this ratio the user probably forgot the placement. The second value applies if the path turns by more than half a
revolution in the sense of both velocities, because the ends of such a path may be close together.
"""

TURN_TOLERANCE = 1e-6
"""[rad] Tolerance on the difference between the user's turn and the nearest turn that leads to the end's azimuth."""


def require_choices(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: AbstractObjective,
    motion: AbstractMotion,
    has_duration: bool,
) -> None:
    """Raise a ValueError if arguments contradict each other; `has_duration` is true if the user passed a duration."""
    require_states(start, end)
    require_limits(limits)
    user_limits = limits.given()
    require_zero_allowed(user_limits, "tune")
    require_reduced(user_limits, "tune")
    if limits.on_forces and limits.vehicle is not None and limits.vehicle.has_left:
        raise ValueError(
            "tune does not support limits on forces with a direction of the road to the left: use tune_route, such as "
            "tune_route(Route.from_path(path), limits), or pass a vehicle without Road(left=...)"
        )
    if not user_limits and limits.keep_out is None:
        raise ValueError("no limit was given: tuning needs at least one limit, so set at least one field of Limits")
    if objective.needs_time_limit and not bound_speed(user_limits):
        # A limit on the power does not bound the speed while braking.
        braking = " while the vehicle brakes" if "power" in user_limits else ""
        raise ValueError(
            f"there is no fastest path: the given limits ({', '.join(user_limits)}) do not bound the "
            f"speed{braking}. Set one of {', '.join(BOUNDING)}."
        )
    if start.acceleration is not None or end.acceleration is not None:
        raise ValueError("tuning changes the boundary velocities and cannot keep boundary accelerations: omit them")
    if has_duration and motion.is_uniform and not objective.fixes_duration:
        raise ValueError(
            "a duration was given, but with motion='uniform' the duration follows from the tuned angular rate. Omit "
            "the duration, or use motion='hermite' or objective='smoothest'."
        )


class _Data(NamedTuple):
    """The data to check, for one problem or a batch; `xp` is the module of the arrays, NumPy or jax.numpy."""

    problem: Problem
    turn: Any
    limits: dict[str, Any]
    has_placement: bool
    xp: Any


def fault_codes(
    problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, has_placement: bool
) -> Int[Array | np.ndarray, "*batch"]:
    """Return the code of the first fault of each problem, or `successful`; the arguments can be traced.

    `turn` is the user's turn or None; `has_placement` is true if the user passed a placement.
    """
    data = _data(problem, turn, limits, corridor, has_placement)
    code = data.xp.full(data.problem.speed.shape, ResultCode.successful, np.int32)
    for fault in reversed(FAULTS):
        code = data.xp.where(fault.occurs(data), fault.code, code)
    return code


def require_well_posed(
    problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, has_placement: bool
) -> None:
    """Raise a ValueError if a single problem with concrete values is ill-posed; see `fault_codes` for the arguments."""
    data = _data(problem, turn, limits, corridor, has_placement)
    for fault in FAULTS:
        if np.any(fault.occurs(data)):
            raise ValueError(fault.message(data))


def _data(problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, has_placement: bool) -> _Data:
    parts = (problem.start, problem.end, problem.duration, problem.speed, problem.scale, problem.turn, problem.road)
    user_limits = named_limits(limits, corridor)
    if any(concrete(leaf) is None for leaf in jax.tree.leaves((parts, turn, user_limits))):
        return _Data(problem, turn, user_limits, has_placement, jnp)
    problem, turn, user_limits = jax.tree.map(
        lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, (problem, turn, user_limits)
    )
    return _Data(problem, turn, user_limits, has_placement, np)


def _positive(x: Any, xp: Any) -> Any:
    return (x > 0) & xp.isfinite(x)


def _rates(data: _Data) -> tuple[Any, Any]:
    """Return V_phi/rho [rad/s] at both ends, or zero for a state on the axis."""
    rates = []
    for state in (data.problem.start, data.problem.end):
        off_axis = state.radius > 0
        rates.append(data.xp.where(off_axis, state.velocity[..., 1] / data.xp.where(off_axis, state.radius, 1.0), 0.0))
    return rates[0], rates[1]


def _angular_velocities(data: _Data) -> Any:
    """Return V_phi [m/s] at both ends."""
    a, b = data.problem.start, data.problem.end
    return data.xp.stack([a.velocity[..., 1], b.velocity[..., 1]], axis=-1)


def _bad_limit(data: _Data) -> Any:
    bad = data.xp.zeros(data.problem.speed.shape, bool)
    for name, limit in data.limits.items():
        signed = quantity(name).bounds_side
        finite = data.xp.isfinite(limit) & (limit >= 0 if quantity(name).lower and not signed else True)
        bad = bad | ~(finite if signed or quantity(name).lower else _positive(limit, data.xp))
    return bad


def _not_finite(data: _Data) -> Any:
    good = data.xp.isfinite(data.problem.speed)
    for state in (data.problem.start, data.problem.end):
        good = good & data.xp.isfinite(state.radius) & data.xp.isfinite(state.height)
    return ~good


def _axis_far_away(data: _Data) -> Any:
    a, b = data.problem.start, data.problem.end
    distance = data.xp.sqrt(data.xp.sum((b.planar - a.planar) ** 2, axis=-1))
    first, last = _rates(data)
    loops = (data.xp.abs(data.problem.turn) > np.pi) & (first * last > 0)
    max_ratio = data.xp.where(loops, MAX_AXIS_DISTANCE_LOOPS, MAX_AXIS_DISTANCE)
    return (data.xp.minimum(a.radius, b.radius) > max_ratio * distance) & (not data.has_placement) & (distance > 0)


def _senses_oppose(data: _Data) -> Any:
    first, last = _rates(data)
    xp = data.xp
    return ~(data.problem.duration > 0) & (xp.sign(first) * xp.sign(last) <= 0)


def _turn_mismatch(data: _Data) -> Any:
    if data.turn is None:
        return data.xp.zeros_like(data.problem.turn, bool)
    return ~(data.xp.abs(data.problem.turn - data.turn) <= TURN_TOLERANCE)


def _limit_message(data: _Data) -> str:
    name, limit = next((name, x) for name, x in data.limits.items() if not np.all(_positive(x, np)))
    return f"the limit {name} must be positive and finite [{quantity(name).label}], but {limit.tolist()} was given"


def _far_message(data: _Data) -> str:
    states = [_in_world(state) for state in (data.problem.start, data.problem.end)]
    distance = np.linalg.norm(np.asarray(states[1].position - states[0].position)[:2])
    message = (
        f"the states are {distance:.4g} m apart, but {data.problem.start.radius:.6g} m away from the world's z axis, "
        "about which the path turns by default"
    )
    try:
        x, y, _ = np.asarray(axis_between(*states).origin)
    except ValueError:
        return f"{message}: pass a placement (in a scenario, a table [placement]), or Placement() to keep this axis"
    return (
        f"{message}: pass a placement such as axis_between(start, end), whose axis is at the intersection of the "
        f"normals to the velocities (in a scenario, a table [placement] with origin = [{x:.3f}, {y:.3f}, 0.0]), or "
        "Placement() to keep the z axis"
    )


def _in_world(state: Cylindrical) -> BoundaryState:
    """Convert a cylindrical state about the world's z axis to a boundary state in world axes."""
    (cos, sin), (radial, angular, up) = state.planar[:2] / state.radius, state.velocity
    velocity = [radial * cos - angular * sin, radial * sin + angular * cos, up]
    return BoundaryState([*state.planar[:2], state.height], velocity)


def _senses_message(data: _Data) -> str:
    first, last = _rates(data)
    return (
        f"the boundary velocities have opposite senses about the axis (V_phi/rho is {first:.6g} rad/s at the start and "
        f"{last:.6g} rad/s at the end), so no rotation at a constant rate joins the states. Pass boundary velocities "
        "with the same sense, or use motion='hermite' with a duration."
    )


class _Fault(NamedTuple):
    """A fault of an ill-posed problem: its code, its test, and the message for a single problem."""

    code: ResultCode
    occurs: Callable[[_Data], Any]
    message: Callable[[_Data], str]


FAULTS = (
    _Fault(ResultCode.limit_not_positive, _bad_limit, _limit_message),
    _Fault(ResultCode.state_not_finite, _not_finite, lambda _: ResultCode.state_not_finite.text),
    _Fault(
        ResultCode.velocity_vanishes,
        lambda d: ~_positive(d.problem.speed, d.xp),
        lambda d: (
            f"the boundary velocities must be finite and not all zero, but their RMS magnitude is {d.problem.speed} m/s"
        ),
    ),
    _Fault(
        ResultCode.position_on_axis,
        lambda d: (d.problem.start.radius == 0) | (d.problem.end.radius == 0),
        lambda _: ResultCode.position_on_axis.text,
    ),
    _Fault(ResultCode.axis_far_away, _axis_far_away, _far_message),
    _Fault(
        ResultCode.sense_unknown,
        lambda d: (d.problem.start.velocity[..., 1] == 0) & (d.turn is None),
        lambda _: ResultCode.sense_unknown.text,
    ),
    _Fault(
        ResultCode.heading_unknown,
        lambda d: d.xp.any((d.problem.heading_fixed > 0) & (_angular_velocities(d) == 0), axis=-1),
        lambda _: ResultCode.heading_unknown.text,
    ),
    _Fault(
        ResultCode.azimuths_equal,
        lambda d: d.problem.turn == 0,
        lambda _: ResultCode.azimuths_equal.text,
    ),
    _Fault(
        ResultCode.inside_obstacle,
        lambda d: inside.occurs(d.problem, d.xp),
        lambda d: inside.message(d.problem),
    ),
    _Fault(ResultCode.senses_opposite, _senses_oppose, _senses_message),
    _Fault(
        ResultCode.turn_against_sense,
        lambda d: (d.problem.duration < 0) & (d.turn is not None),
        lambda _: ResultCode.turn_against_sense.text,
    ),
    _Fault(
        ResultCode.duration_not_positive,
        lambda d: ~_positive(d.problem.duration, d.xp),
        lambda d: f"the duration must be positive and finite [s], but {d.problem.duration} was given",
    ),
    _Fault(
        ResultCode.objective_not_finite,
        lambda d: ~d.xp.isfinite(d.problem.scale),
        lambda d: f"the objective must be finite for the specified boundary states, but it is {d.problem.scale}",
    ),
    _Fault(
        ResultCode.turn_mismatch,
        _turn_mismatch,
        lambda d: (
            f"a turn of {d.turn:.9g} rad does not lead from the azimuth of the start to the azimuth of the end: the "
            f"nearest valid turn is {d.problem.turn:.9g} rad"
        ),
    ),
)
"""All faults; the first fault that occurs is reported."""
