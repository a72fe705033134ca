"""What makes no tuning problem: choices that contradict are refused, data are refused or, in a batch, given a code.

One problem that is ill-posed raises, with what was given and what to do. In a batch it is a result of its element.
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
from qtraj.design.tuning.task import bounds_of
from qtraj.foundation.arrays import concrete
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import Scalar
from qtraj.path.boundary import BoundaryState, Cylindrical
from qtraj.path.boundary_problem import axis_between
from qtraj.path.quantity import QUANTITIES, quantity

BOUNDING = tuple(name for name, entry in QUANTITIES.items() if entry.per_time > 0 and entry.bounds_speed)
"""Limits of which a fastest path needs one, not to arrive at once."""

FAR, FAR_OF_LOOPS = 100.0, 1e4
"""Without a placement, an axis that is more than so many distances of the states away was hardly meant: for a small
turn, and for one beyond half a revolution, whose ends may lie close together."""

TURN_TOLERANCE = 1e-6
"""[rad] A given turn may miss the azimuth of the end by this much."""


def require_choices(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: AbstractObjective,
    motion: AbstractMotion,
    holds_a_duration: bool,
) -> None:
    """Raise a ValueError for arguments that do not fit together.

    `holds_a_duration` tells whether a duration was given.
    """
    if not isinstance(limits, Limits):
        raise ValueError(f"limits must be a Limits, such as Limits(curvature=0.05), but {limits!r} was given")
    given = limits.given()
    if not given:
        raise ValueError("no limit was given, so there is nothing to tune for: set at least one field of Limits")
    if objective.needs_time_limit and not any(name in BOUNDING for name in given):
        raise ValueError(
            f"nothing bounds the fastest path: the given limits ({', '.join(given)}) allow any speed. "
            f"Give one of {', '.join(BOUNDING)}."
        )
    if start.acceleration is not None or end.acceleration is not None:
        raise ValueError("tuning moves the boundary velocities and cannot keep given accelerations: leave them out")
    if holds_a_duration and motion.is_uniform and not objective.holds_duration:
        raise ValueError(
            "a duration was given, but uniform motion lasts as long as its rate says, and the rate is tuned. Leave it "
            "out, or take motion='hermite' or objective='smoothest', which hold or weigh a duration."
        )


class _Data(NamedTuple):
    """What is looked at: a problem or many, the given turn and limits, in arrays of one kind, `xp`."""

    problem: Problem
    turn: Any
    limits: dict[str, Any]
    placed: bool
    xp: Any


def ill_posed(
    problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, placed: bool
) -> Int[Array | np.ndarray, "*batch"]:
    """The code of what is wrong with each problem, or `successful`; it can be traced.

    `turn` is the given one, and `placed` tells whether a placement was given.
    """
    data = _data(problem, turn, limits, corridor, placed)
    code = data.xp.full(data.problem.speed.shape, ResultCode.successful, np.int32)
    for fault in reversed(FAULTS):
        code = data.xp.where(fault.found(data), fault.code, code)
    return code


def require_sound(problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, placed: bool) -> None:
    """Raise a ValueError where the data of one problem, which must be known, make none; see `ill_posed`."""
    data = _data(problem, turn, limits, corridor, placed)
    for fault in FAULTS:
        if np.any(fault.found(data)):
            raise ValueError(fault.message(data))


def _data(problem: Problem, turn: Scalar | None, limits: Limits, corridor: Array | None, placed: bool) -> _Data:
    parts = (problem.start, problem.end, problem.duration, problem.speed, problem.scale, problem.turn)
    given = bounds_of(limits, corridor)
    if any(concrete(leaf) is None for leaf in jax.tree.leaves((parts, turn, given))):
        return _Data(problem, turn, given, placed, jnp)
    problem, turn, given = jax.tree.map(
        lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, (problem, turn, given)
    )
    return _Data(problem, turn, given, placed, np)


def _positive(x: Any, xp: Any) -> Any:
    return (x > 0) & xp.isfinite(x)


def _rates(data: _Data) -> tuple[Any, Any]:
    """V_phi/rho at both ends [rad/s], zero on the axis."""
    rates = []
    for state in (data.problem.start, data.problem.end):
        apart = state.radius > 0
        rates.append(data.xp.where(apart, state.velocity[..., 1] / data.xp.where(apart, state.radius, 1.0), 0.0))
    return rates[0], rates[1]


def _across(data: _Data) -> Any:
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


def _far(data: _Data) -> Any:
    a, b = data.problem.start, data.problem.end
    apart = data.xp.sqrt(data.xp.sum((b.planar - a.planar) ** 2, axis=-1))
    most = data.xp.where(data.xp.abs(data.problem.turn) > np.pi, FAR_OF_LOOPS, FAR)
    return (data.xp.minimum(a.radius, b.radius) > most * apart) & (not data.placed) & (apart > 0)


def _senses_oppose(data: _Data) -> Any:
    first, last = _rates(data)
    xp = data.xp
    return ~(data.problem.duration > 0) & (xp.sign(first) * xp.sign(last) <= 0)


def _turn_missed(data: _Data) -> Any:
    if data.turn is None:
        return data.xp.zeros_like(data.problem.turn, bool)
    return ~(data.xp.abs(data.problem.turn - data.turn) <= TURN_TOLERANCE)


def _say_limit(data: _Data) -> str:
    name, limit = next((name, x) for name, x in data.limits.items() if not np.all(_positive(x, np)))
    return f"the limit {name} must be positive and finite [{quantity(name).label}], but {limit.tolist()} was given"


def _say_far(data: _Data) -> str:
    states = [_in_world(state) for state in (data.problem.start, data.problem.end)]
    apart = np.linalg.norm(np.asarray(states[1].position - states[0].position)[:2])
    message = (
        f"the states are {apart:.4g} m apart, but {data.problem.start.radius:.6g} m away from the world's z axis, "
        "about which the path turns unless a placement is given (Placement() where that is meant)"
    )
    try:
        x, y, _ = np.asarray(axis_between(*states).origin)
    except ValueError:
        return f"{message}: give one (in a scenario a table [placement])"
    return (
        f"{message}: give one, such as axis_between(start, end), where the normals of the velocities meet, or in a "
        f"scenario a table [placement] with origin = [{x:.3f}, {y:.3f}, 0.0]"
    )


def _in_world(state: Cylindrical) -> BoundaryState:
    """A state about the world's z axis in world axes."""
    (cos, sin), (along, across, up) = state.planar[:2] / state.radius, state.velocity
    velocity = [along * cos - across * sin, along * sin + across * cos, up]
    return BoundaryState([*state.planar[:2], state.height], velocity)


def _say_senses(data: _Data) -> str:
    first, last = _rates(data)
    return (
        f"the given states turn in opposite senses (V_phi/rho is {first:.6g} rad/s at the start and {last:.6g} at the "
        "end), so they have no common duration: give the end a velocity in the sense of the start's, or take "
        "motion='hermite' with a duration."
    )


class _Fault(NamedTuple):
    """One way to be ill-posed: its code, where it is found, and what to say of one problem."""

    code: ResultCode
    found: Callable[[_Data], Any]
    message: Callable[[_Data], str]


FAULTS = (
    _Fault(ResultCode.limit_not_positive, _bad_limit, _say_limit),
    _Fault(ResultCode.state_not_finite, _not_finite, lambda _: ResultCode.state_not_finite.text),
    _Fault(
        ResultCode.velocity_vanishes,
        lambda d: ~_positive(d.problem.speed, d.xp),
        lambda d: f"the given velocities must be finite and not all zero: their mean is {d.problem.speed} m/s",
    ),
    _Fault(
        ResultCode.position_on_axis,
        lambda d: (d.problem.start.radius == 0) | (d.problem.end.radius == 0),
        lambda _: "a boundary position lies on the axis (radius 0): give a placement whose axis lies elsewhere",
    ),
    _Fault(ResultCode.axis_far_away, _far, _say_far),
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
        lambda d: d.xp.any((d.problem.headed > 0) & (_across(d) == 0), axis=-1),
        lambda _: ResultCode.heading_unknown.text,
    ),
    _Fault(
        ResultCode.azimuths_equal,
        lambda d: d.problem.turn == 0,
        lambda _: "the start and the end have the same azimuth: pass turns=1 for one whole turn",
    ),
    _Fault(ResultCode.senses_opposite, _senses_oppose, _say_senses),
    _Fault(
        ResultCode.turn_against_sense,
        lambda d: (d.problem.duration < 0) & (d.turn is not None),
        lambda _: (
            "the given turn is against the sense of V_phi, so the states have no duration of their own: give one, "
            "with motion='hermite', or a turn in the sense of the states"
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
        lambda d: f"the objective is {d.problem.scale} at the given boundary states: it must be finite there",
    ),
    _Fault(
        ResultCode.turn_mismatch,
        _turn_missed,
        lambda d: (
            f"a turn of {d.turn:.9g} rad does not lead from the start's azimuth to the end's: the nearest that does "
            f"is {d.problem.turn:.9g} rad"
        ),
    ),
)
"""In this order: the first that is found is told."""
