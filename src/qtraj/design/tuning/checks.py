"""Checks the input of a tuning: contradictory options and the data of a single ill-posed problem raise a ValueError.

In a batch, each ill-posed problem gets a result code instead.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from qtraj.design.limits import Limits
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.task import named_limits
from qtraj.foundation.arrays import concrete
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import Scalar
from qtraj.path.boundary import BoundaryState, Cylindrical
from qtraj.path.boundary_problem import axis_between
from qtraj.path.quantity import QUANTITIES, quantity

BOUNDING = tuple(name for name, entry in QUANTITIES.items() if entry.bounds_speed)
"""Limits that bound the speed: the fastest path needs one of them."""

MAX_AXIS_DISTANCE, MAX_AXIS_DISTANCE_LOOPS = 100.0, 1e3
"""Largest distance of the default axis over the distance between the states; beyond it a placement is probably missing.

The second value is for turns beyond half a revolution with the sense of both velocities, whose ends may be close
together.
"""

TURN_TOLERANCE = 1e-6
"""[rad] Tolerance on the user's turn, which must end at the azimuth of the end state."""


def require_choices(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: AbstractObjective,
    motion: AbstractMotion,
    has_duration: bool,
) -> None:
    """Raise a ValueError for arguments that contradict each other; `has_duration`: the user passed a duration."""
    if not isinstance(limits, Limits):
        raise ValueError(f"limits must be a Limits, such as Limits(curvature=0.05), but {limits!r} was given")
    user_limits = limits.given()
    if not user_limits:
        raise ValueError("no limit was given: a tuning needs at least one limit, so set at least one field of Limits")
    if objective.needs_time_limit and not any(name in BOUNDING for name in user_limits):
        raise ValueError(
            f"the fastest path is unbounded: the given limits ({', '.join(user_limits)}) allow any speed. "
            f"Give one of {', '.join(BOUNDING)}."
        )
    if start.acceleration is not None or end.acceleration is not None:
        raise ValueError("tuning changes the boundary velocities and cannot keep boundary accelerations: omit them")
    if has_duration and motion.is_uniform and not objective.fixes_duration:
        raise ValueError(
            "a duration was given, but the tuned rate of uniform motion determines the duration. Omit it, or use "
            "motion='hermite' or objective='smoothest'."
        )


class _Data(NamedTuple):
    """The data to check, of one problem or a batch; all arrays belong to `xp`, which is NumPy or JAX's NumPy."""

    problem: Problem
    turn: Any
    limits: dict[str, Any]
    has_placement: bool
    xp: Any


def fault_codes(
    problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, has_placement: bool
) -> Int[Array | np.ndarray, "*batch"]:
    """The code of the first fault of each problem, or `successful`. It can be traced.

    `turn` is the turn that the user passed; `has_placement` is true if the user passed a placement.
    """
    data = _data(problem, turn, limits, corridor, has_placement)
    code = data.xp.full(data.problem.speed.shape, ResultCode.successful, np.int32)
    for fault in reversed(FAULTS):
        code = data.xp.where(fault.occurs(data), fault.code, code)
    return code


def require_well_posed(
    problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, has_placement: bool
) -> None:
    """Raise a ValueError if one problem, whose data must be concrete, is ill-posed; see `fault_codes`."""
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
    """V_phi/rho at both ends [rad/s], zero on the axis."""
    rates = []
    for state in (data.problem.start, data.problem.end):
        off_axis = state.radius > 0
        rates.append(data.xp.where(off_axis, state.velocity[..., 1] / data.xp.where(off_axis, state.radius, 1.0), 0.0))
    return rates[0], rates[1]


def _angular_velocities(data: _Data) -> Any:
    """V_phi at both ends."""
    a, b = data.problem.start, data.problem.end
    return data.xp.stack([a.velocity[..., 1], b.velocity[..., 1]], axis=-1)


def _bad_limit(data: _Data) -> Any:
    bad = data.xp.zeros(data.problem.speed.shape, bool)
    for limit in data.limits.values():
        bad = bad | ~_positive(limit, data.xp)
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
        "about which the path turns by default (pass Placement() to confirm that axis)"
    )
    try:
        x, y, _ = np.asarray(axis_between(*states).origin)
    except ValueError:
        return f"{message}: give a placement (in a scenario, a table [placement])"
    return (
        f"{message}: give a placement such as axis_between(start, end), where the normals of the velocities meet, or "
        f"in a scenario a table [placement] with origin = [{x:.3f}, {y:.3f}, 0.0]"
    )


def _in_world(state: Cylindrical) -> BoundaryState:
    """The boundary state, in world axes, of a cylindrical state about the world's z axis."""
    (cos, sin), (radial, angular, up) = state.planar[:2] / state.radius, state.velocity
    velocity = [radial * cos - angular * sin, radial * sin + angular * cos, up]
    return BoundaryState([*state.planar[:2], state.height], velocity)


def _senses_message(data: _Data) -> str:
    first, last = _rates(data)
    return (
        f"the states turn in opposite senses (V_phi/rho is {first:.6g} rad/s at the start and {last:.6g} at the end), "
        "so they do not define a duration: give the end a velocity with the same sense of rotation as the start, or "
        "use motion='hermite' with a duration."
    )


class _Fault(NamedTuple):
    """A kind of ill-posed problem: its code, its test, and the message for one problem."""

    code: ResultCode
    occurs: Callable[[_Data], Any]
    message: Callable[[_Data], str]


FAULTS = (
    _Fault(ResultCode.limit_not_positive, _bad_limit, _limit_message),
    _Fault(ResultCode.state_not_finite, _not_finite, lambda _: ResultCode.state_not_finite.text),
    _Fault(
        ResultCode.velocity_vanishes,
        lambda d: ~_positive(d.problem.speed, d.xp),
        lambda d: f"the velocities must be finite and not all zero: their mean is {d.problem.speed} m/s",
    ),
    _Fault(
        ResultCode.position_on_axis,
        lambda d: (d.problem.start.radius == 0) | (d.problem.end.radius == 0),
        lambda _: "a boundary position lies on the axis (radius 0): give a placement whose axis lies elsewhere",
    ),
    _Fault(ResultCode.axis_far_away, _axis_far_away, _far_message),
    _Fault(
        ResultCode.sense_unknown,
        lambda d: (d.problem.start.velocity[..., 1] == 0) & (d.turn is None),
        lambda _: (
            "V_phi at the start is 0, so the sense of rotation is unknown. Give the start a velocity about the axis, "
            "or a placement whose axis lies elsewhere."
        ),
    ),
    _Fault(
        ResultCode.heading_unknown,
        lambda d: d.xp.any((d.problem.heading_fixed > 0) & (_angular_velocities(d) == 0), axis=-1),
        lambda _: ResultCode.heading_unknown.text,
    ),
    _Fault(
        ResultCode.azimuths_equal,
        lambda d: d.problem.turn == 0,
        lambda _: "the start and the end have the same azimuth: pass turns=1 for one whole turn",
    ),
    _Fault(ResultCode.senses_opposite, _senses_oppose, _senses_message),
    _Fault(
        ResultCode.turn_against_sense,
        lambda d: (d.problem.duration < 0) & (d.turn is not None),
        lambda _: (
            "the turn and V_phi have opposite senses, so the states do not define a duration: give a duration with "
            "motion='hermite', or a turn with the same sense as V_phi"
        ),
    ),
    _Fault(
        ResultCode.duration_not_positive,
        lambda d: ~_positive(d.problem.duration, d.xp),
        lambda d: f"the duration must be positive and finite [s], but {d.problem.duration} was given",
    ),
    _Fault(
        ResultCode.objective_not_finite,
        lambda d: ~d.xp.isfinite(d.problem.scale),
        lambda d: f"the objective is {d.problem.scale} at the initial boundary states: it must be finite there",
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
"""All faults, in order: the first one that occurs is reported."""
