"""Define the result codes of all solves, their texts, and the base class of results that have a code.

A failure does not raise an error unless `throw=True` is passed. The result of a solve has a `code` for each element of
its batch, and a text that says what to do. Codes below `NOTES` are full successes, codes from `FAILURES` on are
failures, and codes from `NOTES` to below `FAILURES` are successes with a note.
"""

import abc
import enum
from collections.abc import Mapping
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from qtraj.foundation.arrays import as_array, concrete
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.texts import Texts

T = TypeVar("T", bound="AbstractOutcome")

NOTES, FAILURES, ILL_POSED = 10, 20, 60
"""First codes of three groups: successes with a note, failures, and problems that have no solution as posed."""


@enum.unique  # without this check, a repeated number would become an alias with the text of the first code
class ResultCode(enum.IntEnum):
    """The outcome of a solve; `.text` describes the outcome and contains advice."""

    text: str

    def __new__(cls, value: int, text: str = "") -> "ResultCode":
        """Create a code with its text."""
        code = int.__new__(cls, value)
        code._value_ = value
        code.text = text
        return code

    successful = 0, "the solve succeeded."

    near_zero_error = (
        NOTES + 0,
        "finished, but the error quaternion came near zero, where the command grows without bound: look at "
        "peak_command. The other sign of λ may avoid this: pass choose_sign(law, program(t0), quaternion, rate) as the "
        "initial quaternion, and sign='as given', to the simulation.",
    )
    held_by_bounds = (
        NOTES + 1,
        "the radius is at one of its bounds, so this window alone does not determine the axis. Choose a window with "
        "one clear bend, or pass other radius_bounds.",
    )
    loose_fit = (
        NOTES + 3,
        "the path follows its recording only approximately. Choose a window with one clear bend in which the vehicle "
        "keeps moving. Pass motion='hermite', which follows the recording more closely than 'uniform', or wider "
        "radius_bounds.",
    )
    limits_sampled = (
        NOTES + 2,
        "every limit is satisfied, but some limits were only checked on a fine grid and are not proved. A proof needs "
        "a polynomial path (not a Curve) and, for quantities that depend on the vertical, a vertical axis.",
    )
    undefined_at_stops = (
        NOTES + 4,
        "every limit is proved to be satisfied except at stops, where a limited quantity is undefined and the route "
        "was not changed.",
    )
    not_optimal = (
        NOTES + 5,
        "every limit is proved to be satisfied on the segments that may change, but the search stopped before the "
        "optimum. Try a larger max_steps for a better value of the objective.",
    )
    starts_above_limits = NOTES + 6, "start_speed is above the limits: the vehicle brakes until it satisfies them."

    max_steps_reached = (
        FAILURES + 0,
        "stopped: the maximum number of steps was reached. Try a larger max_steps, larger rtol and atol, or a shorter "
        "time span. If the acceleration is discontinuous, pass the instants of its discontinuities as jumps.",
    )
    step_too_small = (
        FAILURES + 1,
        "stopped: the step size became too small for floating point. The acceleration may have a pole, or be NaN "
        "or infinite, near the last instant reached: check it there. If the tolerance is below round-off, raise rtol.",
    )
    wrong_sign = (
        FAILURES + 2,
        "stopped: the integration failed, and the error quaternion started with a negative scalar part (μ0 < 0). It "
        "probably came close to zero, where the law is undefined. λ and −λ represent the same attitude: start from −λ "
        "(omit sign='as given'), or from choose_sign(law, program(t0), quaternion, rate).",
    )
    not_finite = (
        FAILURES + 3,
        "stopped: a number is NaN or infinite. Check the initial values, the times and the values of the rate or "
        "acceleration.",
    )
    tolerance_not_reached = (
        FAILURES + 4,
        "the tolerance was not reached. Try a larger max_steps (or steps), a larger tolerance, or a method of higher "
        "order. If the rate is discontinuous, add the instants of its discontinuities to the times.",
    )
    not_converged = FAILURES + 5, "the search stopped before it converged. Try a larger max_steps."
    infeasible = (
        FAILURES + 6,
        "no boundary velocities were found that satisfy the limits. Try more starts, relax the violated limits, or "
        "change the boundary positions.",
    )
    poor_fit = (
        FAILURES + 11,
        "the path does not follow its recording. Choose a window with one clear bend in which the vehicle keeps "
        "moving. Pass motion='hermite', which follows the recording more closely than 'uniform', or wider "
        "radius_bounds.",
    )
    limits_broken = FAILURES + 8, "a limit is violated. Tune the path, or relax the limit."
    limits_undecided = (
        FAILURES + 9,
        "a limit is undecided: the largest value of the quantity equals the limit to within rounding error, or the "
        "quantity is not proved to be defined everywhere. Change the limit a little, or limit another quantity.",
    )
    limits_undefined = (
        FAILURES + 10,
        "a limited quantity is undefined somewhere on the path. This occurs at stops, on straight or vertical parts, "
        "and where the load on the road is not positive. Limit another quantity, or change the path.",
    )
    route_not_found = (
        FAILURES + 12,
        "no route that stays within the tube and satisfies the limits was found; a local search cannot prove that "
        "no such route exists. Widen the tube, relax the limits that are not proved to be satisfied, or fix fewer "
        "states.",
    )
    limits_contradict = (
        FAILURES + 18,
        "no route within the tube was found that satisfies every limit; a local search cannot prove that none exists. "
        "The result violates the limits below and satisfies all others.",
    )
    broken_at_stops = (
        FAILURES + 13,
        "a limit is violated or undecided on a segment that starts or ends at a stop. Such segments are not changed. "
        "Raise that limit, or change the states of the route at the ends of that segment.",
    )

    route_not_converged = (
        FAILURES + 15,
        "the search for a route stopped before it converged. Try a larger max_steps. If the search stops again, widen "
        "the tube, relax the limits that are not proved to be satisfied, or fix fewer states.",
    )
    end_speed_not_reached = (
        FAILURES + 14,
        "start_speed or end_speed cannot be reached within the limits. Pass another speed, or relax the limits.",
    )
    rest_unknown = (
        FAILURES + 16,
        "start_speed or end_speed is zero or negative, but its value is traced. Pass the number 0 for an end at rest; "
        "a speed inside jit, vmap or grad must be positive.",
    )
    speed_unbounded = (
        FAILURES + 17,
        "on some part of the path, for example a straight part, no limit bounds the speed, so the duration is not "
        "meaningful. Add a limit on speed. On a straight path, limits on friction and acceleration bound the speed "
        "only if start_speed or end_speed is given, and a limit on power only if start_speed is given.",
    )

    duration_too_short = (
        FAILURES + 19,
        "the prescribed duration is shorter than that of the fastest timing within the limits, which is returned. Pass "
        "a longer duration, or relax the limits.",
    )
    duration_too_long = FAILURES + 20, "no timing was found that takes as long as prescribed. Pass a shorter duration."

    velocity_vanishes = (
        ILL_POSED + 0,
        "the specified boundary velocities must be finite and not all zero, because they set the scale of the search.",
    )
    position_on_axis = (
        ILL_POSED + 1,
        "a boundary position lies on the axis (radius 0). Pass a placement whose axis contains neither position.",
    )
    sense_unknown = (
        ILL_POSED + 2,
        "V_phi at the start is 0, so the sense of rotation is unknown. Pass a start with a velocity about the axis, or "
        "a placement with another axis.",
    )
    azimuths_equal = (
        ILL_POSED + 3,
        "the start and the end have the same azimuth. Pass turns=1 for one whole turn.",
    )
    senses_opposite = (
        ILL_POSED + 4,
        "the boundary velocities have opposite senses about the axis, so no rotation at a constant rate joins the "
        "states. Pass an end whose velocity has the same sense as the start, or use motion='hermite' with a duration.",
    )
    turn_against_sense = (
        ILL_POSED + 5,
        "the turn is opposite to the sense of V_phi, so the states do not determine a duration. Pass a duration with "
        "motion='hermite', or a turn with the same sense as V_phi.",
    )
    duration_not_positive = ILL_POSED + 6, "the duration must be positive and finite [s]."
    objective_not_finite = (
        ILL_POSED + 7,
        "the objective is not finite for the specified boundary states. Pass other states, or another objective.",
    )
    turn_mismatch = (
        ILL_POSED + 8,
        "the turn does not lead from the azimuth of the start to the azimuth of the end. Pass the difference of the "
        "azimuths plus whole turns.",
    )
    limit_not_positive = ILL_POSED + 9, "every limit must be positive and finite."
    axis_far_away = (
        ILL_POSED + 11,
        "no placement was given, and the default axis (world z) is very far from the states: more than a hundred times "
        "the distance between them. Pass a placement, such as axis_between(start, end).",
    )
    heading_unknown = (
        ILL_POSED + 12,
        "a fixed heading needs a velocity about the axis (V_phi not zero) at that end. Remove the heading from "
        "fixed, or pass a placement with another axis.",
    )
    route_ill_posed = ILL_POSED + 13, "invalid route, limit or tube. Outside jit and vmap, the error says more."
    inside_obstacle = ILL_POSED + 14, "the body is inside an obstacle at the start or at the end. Change this state."
    state_not_finite = (
        ILL_POSED + 10,
        "a boundary position, a velocity or the placement is NaN or infinite. Pass finite numbers.",
    )


MESSAGES = tuple(code.text for code in ResultCode)
_MESSAGE_INDEX = np.zeros(max(ResultCode) + 1, np.int32)
_MESSAGE_INDEX[[int(code) for code in ResultCode]] = np.arange(len(ResultCode))


class AbstractOutcome(AbstractResult):
    """Result of a solve, with a `code` for each element of the batch (see `ResultCode`) and the text of each code."""

    code: eqx.AbstractVar[Int[Array, "*batch"]]

    @abc.abstractmethod
    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result of the batch element with index `at`, with advice; `at` is () for a single problem."""

    @property
    def successful(self) -> Bool[Array, "*batch"]:
        """Whether the solve succeeded, for each element of the batch; also available inside a trace."""
        code = concrete(self.code)
        if code is None or not isinstance(self.code, jax.Array):
            return self.code < FAILURES
        return as_array(code < FAILURES, bool)  # JAX would compile the comparison

    @property
    def result(self) -> Any:
        """The text of the result, with advice; for a batch, a sequence of strings, composed on access.

        **Raises:** ValueError inside a trace, where only `code` and `successful` are available.
        """
        shape = concrete_codes(self).shape
        return Texts(self.explain, shape) if shape else self.explain(())

    def check(self: T) -> T:
        """Return this result if every element of the batch succeeded, otherwise raise an error, like `throw=True`.

        **Raises:** RuntimeError with the text of the first element that failed. Inside a trace, the error is raised
        when the compiled function runs, and its message is the text of the code.
        """
        codes = concrete(self.code)
        if codes is None:
            return eqx.branched_error_if(self, ~self.successful, jnp.asarray(_MESSAGE_INDEX)[self.code], MESSAGES)
        failed = np.argwhere(codes >= FAILURES)
        if not len(failed):
            return self
        at = tuple(int(k) for k in failed[0])
        which = f"element {', '.join(map(str, at))} of the batch: " if at else ""
        raise RuntimeError(which + self.explain(at))


def concrete_codes(outcome: AbstractOutcome) -> np.ndarray:
    """Return the codes of a result as a NumPy array.

    **Raises:** ValueError inside a trace.
    """
    codes = concrete(outcome.code)
    if codes is None:
        raise ValueError(
            "the text of a result is not available inside jit, vmap or grad: use the attribute 'successful' or 'code'"
        )
    return codes


def names_of(codes: np.ndarray, names: Mapping[ResultCode, str], other: str) -> np.ndarray:
    """Return the name of each code in an array, or `other` for codes without a name."""
    table = np.full(max(ResultCode) + 1, other, dtype=object)
    table[[int(code) for code in names]] = list(names.values())
    return np.asarray(table.astype(str)[codes])


def renumbered(codes: Any, numbers: Mapping[int, ResultCode]) -> Any:
    """Convert `codes` of an older document, one number or nested lists of numbers, to the present codes."""
    if isinstance(codes, list):
        return [renumbered(code, numbers) for code in codes]
    return int(numbers.get(codes, codes))
