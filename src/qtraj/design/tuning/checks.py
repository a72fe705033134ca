"""What makes no tuning problem is refused here, before anything is computed, with what was given and what to do.

Of a batch the first problem that is wrong is named by its place.
"""

from collections.abc import Callable

import jax
import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.magnitudes import UNITS
from qtraj.design.tuning.problem import BOUNDING, MOTIONS, OBJECTIVES, Objective, Problem
from qtraj.foundation.arrays import concrete, require_positive
from qtraj.foundation.types import Scalar
from qtraj.path.boundary import BoundaryState

TURN_TOLERANCE = 1e-6
"""[rad] A given turn may miss the azimuth of the end by this much."""


def require_choices(
    start: BoundaryState, end: BoundaryState, limits: Limits, objective: Objective, motion: str, holds_a_duration: bool
) -> None:
    """Raise a ValueError for arguments that do not fit together.

    `holds_a_duration` tells whether a duration was given.
    """
    if not isinstance(limits, Limits):
        raise ValueError(f"limits must be a Limits, such as Limits(curvature=0.05), but {limits!r} was given")
    given = limits.given()
    if motion not in MOTIONS:
        raise ValueError(f"motion must be {' or '.join(map(repr, MOTIONS))}, but {motion!r} was given")
    if isinstance(objective, str) and objective not in OBJECTIVES:
        raise ValueError(
            f"objective must be one of {', '.join(map(repr, OBJECTIVES))} or a callable of a path, "
            f"but {objective!r} was given"
        )
    if not given:
        raise ValueError("no limit was given, so there is nothing to tune for: set at least one field of Limits")
    if objective == "fastest" and not any(name in BOUNDING for name in given):
        raise ValueError(
            f"nothing bounds the fastest path: the given limits ({', '.join(given)}) allow any speed. "
            f"Give one of {', '.join(BOUNDING)}."
        )
    if start.acceleration is not None or end.acceleration is not None:
        raise ValueError("tuning moves the boundary velocities and cannot keep given accelerations: leave them out")
    if holds_a_duration and motion == "uniform" and objective != "smoothest":
        raise ValueError(
            "a duration was given, but uniform motion lasts as long as its rate says, and the rate is tuned. Leave it "
            "out, or take motion='hermite' or objective='smoothest', which hold or weigh a duration."
        )


def require_sound(problem: Problem, turn: Scalar | None, limits: Limits) -> None:
    """Raise a ValueError for data that make no problem, where they are known; `turn` is the given one.

    One problem, or many with the lanes in front.
    """
    if any(
        concrete(leaf) is None for leaf in jax.tree.leaves((problem.start, problem.end, problem.duration, turn, limits))
    ):
        return
    for name, limit in limits.given().items():
        require_positive(limit, f"the limit {name}", UNITS[name] or "-")
    for fault in (_speeds, _radii, _sense, _azimuths, _durations, _objectives):
        fault(problem, turn is not None)
    if turn is not None:
        _turns(problem, np.asarray(turn))


def _refuse(bad: np.ndarray | np.bool_, message: Callable[[tuple[int, ...]], str]) -> None:
    """Raise for the first place where `bad` is true."""
    if not np.any(bad):
        return
    place = tuple(int(i) for i in np.argwhere(bad)[0])
    raise ValueError((f"problem {place[0]} of the batch: " if place else "") + message(place))


def _speeds(problem: Problem, _: bool) -> None:
    speed = np.asarray(problem.speed)
    _refuse(
        ~((speed > 0) & np.isfinite(speed)),
        lambda k: f"the given velocities must be finite and not all zero: their mean is {speed[k]} m/s",
    )


def _radii(problem: Problem, _: bool) -> None:
    bad = (np.asarray(problem.start.radius) == 0) | (np.asarray(problem.end.radius) == 0)
    _refuse(
        bad,
        lambda _: "a boundary position lies on the axis (radius 0): give a placement whose axis lies elsewhere",
    )


def _sense(problem: Problem, known: bool) -> None:
    if known:
        return
    _refuse(
        np.asarray(problem.start.velocity)[..., 1] == 0,
        lambda _: (
            "V_phi at the start is 0, so the sense of rotation is unknown. Give the start a velocity about the "
            "axis, or a placement whose axis lies elsewhere."
        ),
    )


def _azimuths(problem: Problem, _: bool) -> None:
    _refuse(
        np.asarray(problem.turn) == 0,
        lambda _: "the start and the end have the same azimuth: pass turns=1 for one whole turn",
    )


def _durations(problem: Problem, known: bool) -> None:
    duration = np.asarray(problem.duration)
    a, b = (np.asarray(state.velocity)[..., 1] / np.asarray(state.radius) for state in (problem.start, problem.end))
    opposite = ~(duration > 0) & (np.sign(a) * np.sign(b) <= 0)
    _refuse(
        opposite,
        lambda k: (
            f"the given states turn in opposite senses (V_phi/rho is {a[k]:.6g} rad/s at the start and "
            f"{b[k]:.6g} at the end), so they have no common duration: give the end a velocity in the sense of the "
            "start's, or take motion='hermite' with a duration."
        ),
    )
    _refuse(
        known & (duration < 0),
        lambda _: (
            "the given turn is against the sense of V_phi, so the states have no duration of their own: give one, "
            "with motion='hermite', or a turn in the sense of the states"
        ),
    )
    _refuse(
        ~((duration > 0) & np.isfinite(duration)),
        lambda k: f"the duration must be positive and finite [s], but {duration[k]} was given",
    )


def _objectives(problem: Problem, _: bool) -> None:
    scale = np.asarray(problem.scale)
    _refuse(
        ~np.isfinite(scale),
        lambda k: f"the objective is {scale[k]} at the given boundary states: it must be finite there",
    )


def _turns(problem: Problem, given: np.ndarray) -> None:
    exact = np.asarray(problem.turn)
    given = np.broadcast_to(given, exact.shape)
    _refuse(
        np.abs(exact - given) > TURN_TOLERANCE,
        lambda k: (
            f"a turn of {given[k]:.9g} rad does not lead from the start's azimuth to the end's: "
            f"the nearest that does is {exact[k]:.9g} rad"
        ),
    )
