"""Result codes of all solves, their texts, and the base class of results that have them.

A failure is a value: the result of a solve has a `code` for each element of its batch, and a text that says what to do.
`throw=True` raises instead. Codes below `NOTES` are full successes, codes from `FAILURES` on are failures, and codes in
between are successes with a note.
"""

import abc
import enum
from collections.abc import Mapping
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from qtraj.foundation.arrays import concrete
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.texts import Texts

T = TypeVar("T", bound="AbstractOutcome")

NOTES, FAILURES, ILL_POSED = 10, 20, 60
"""The first codes of successes with a note, of failures, and of problems that cannot be solved as posed."""


@enum.unique  # two codes with one number would share the first one's text
class ResultCode(enum.IntEnum):
    """The outcome of a solve; `.text` describes it and gives advice."""

    text: str

    def __new__(cls, value: int, text: str = "") -> "ResultCode":
        """A code with its text."""
        code = int.__new__(cls, value)
        code._value_ = value
        code.text = text
        return code

    successful = 0, "the solve succeeded."

    near_zero_error = (
        NOTES + 0,
        "finished, but the error quaternion came near zero, where the command grows as 1/|μ|²: look at peak_command. "
        "The other sign of λ may avoid this: start from choose_sign(law, program(t0), quaternion, rate) with "
        "sign='as given'.",
    )
    held_by_bounds = (
        NOTES + 1,
        "This window alone does not determine the axis. Choose a window with one clear bend, or pass other "
        "radius_bounds.",
    )
    loose_fit = (
        NOTES + 3,
        "the path follows its recording only roughly. Choose a window with one clear bend in which the vehicle keeps "
        "moving; motion='hermite' follows it more closely than 'uniform', and wider radius_bounds may help.",
    )
    limits_sampled = (
        NOTES + 2,
        "every limit is satisfied, but for some this was checked only by sampling and is not proved. For a proof, "
        "relax these limits a little, or describe the path by polynomials.",
    )
    undefined_at_stops = (
        NOTES + 4,
        "every limit is proved to be satisfied except at stops, where a limited quantity is undefined and the route "
        "was not changed.",
    )
    not_optimal = (
        NOTES + 5,
        "every limit is proved on the segments that may change, but the search stopped before the optimum. Try a "
        "larger max_steps for a better value of the objective.",
    )

    max_steps_reached = (
        FAILURES + 0,
        "stopped: the maximum number of steps was reached. Try a larger max_steps, larger rtol and atol, or a shorter "
        "time span. If the acceleration is discontinuous, pass the instants as jumps.",
    )
    step_too_small = (
        FAILURES + 1,
        "stopped: the step size became too small for floating point. The acceleration has a pole there or is not "
        "finite: check its values near the last instant reached. If the tolerance is below round-off, raise rtol.",
    )
    wrong_sign = (
        FAILURES + 2,
        "stopped: the error quaternion started with a negative scalar part (μ0 < 0) and reached zero, where the law "
        "is undefined. λ and −λ represent the same attitude: start from −λ (omit sign='as given'), or from "
        "choose_sign(law, program(t0), quaternion, rate).",
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
        "no boundary velocities were found that satisfy the limits. Try more starts, raise the violated limits, or "
        "move the ends.",
    )
    poor_fit = (
        FAILURES + 11,
        "the path does not follow its recording. Choose a window with one clear bend in which the vehicle keeps "
        "moving; motion='hermite' follows it more closely than 'uniform', and wider radius_bounds may help.",
    )
    limits_broken = FAILURES + 8, "a limit is violated. Tune the path, or raise the limit."
    limits_undecided = (
        FAILURES + 9,
        "it is undecided whether a limit is satisfied: the largest value equals it to within rounding error. Change "
        "the limit a little.",
    )
    limits_undefined = (
        FAILURES + 10,
        "a limited quantity is undefined somewhere on the path, where it stops or is straight. Limit another quantity, "
        "or change the path.",
    )
    route_not_found = (
        FAILURES + 12,
        "no route was found within the tube that satisfies the limits; a local search cannot show that there is none. "
        "Widen the tube, raise the limits without a proof, or fix fewer states; with the objective 'smoothest', which "
        "keeps the duration, take 'nearest'.",
    )
    broken_at_stops = (
        FAILURES + 13,
        "a limit is violated or undecided on a segment that touches a stop. Such segments are not changed. Raise that "
        "limit, or give the route other states there.",
    )

    route_not_converged = (
        FAILURES + 15,
        "the search for a route stopped before it converged. Try a larger max_steps; if it stops again, widen the "
        "tube, raise the limits without a proof, or fix fewer states.",
    )
    end_speed_not_reached = (
        FAILURES + 14,
        "a given speed at an end cannot be reached within the limits. Give a lower speed there, or raise the limits.",
    )
    rest_unknown = (
        FAILURES + 16,
        "a speed at an end is zero or negative, but not known before the function is traced. Pass start_speed=0 or "
        "end_speed=0 as a plain number for rest; a speed inside jit, vmap or grad must be positive.",
    )
    speed_unbounded = (
        FAILURES + 17,
        "no limit bounds the speed somewhere, for example on a straight part of the path: the duration is not "
        "meaningful. Add a limit on speed.",
    )

    velocity_vanishes = (
        ILL_POSED + 0,
        "the given velocities must be finite and not all zero, because they set the scale of the search.",
    )
    position_on_axis = (
        ILL_POSED + 1,
        "a boundary position lies on the axis (radius 0). Give a placement whose axis lies elsewhere.",
    )
    sense_unknown = (
        ILL_POSED + 2,
        "V_phi at the start is 0, so the sense of rotation is unknown. Give the start a velocity about the axis, or a "
        "placement whose axis lies elsewhere.",
    )
    azimuths_equal = (
        ILL_POSED + 3,
        "the start and the end have the same azimuth. Pass turns=1 for one whole turn.",
    )
    senses_opposite = (
        ILL_POSED + 4,
        "the given states rotate in opposite senses, so they have no common duration. Give the end a velocity with "
        "the same sense of rotation as the start, or use motion='hermite' with a duration.",
    )
    turn_against_sense = (
        ILL_POSED + 5,
        "the given turn is opposite to the sense of V_phi, so the states do not determine a duration. Pass a duration "
        "with motion='hermite', or a turn with the same sense as V_phi.",
    )
    duration_not_positive = ILL_POSED + 6, "the duration must be positive and finite [s]."
    objective_not_finite = (
        ILL_POSED + 7,
        "the objective is not finite at the given boundary states. Give other states, or another objective.",
    )
    turn_mismatch = (
        ILL_POSED + 8,
        "the given turn does not lead from the azimuth of the start to the azimuth of the end. Pass the difference of "
        "the azimuths plus whole turns.",
    )
    limit_not_positive = ILL_POSED + 9, "every limit must be positive and finite."
    axis_far_away = (
        ILL_POSED + 11,
        "no placement was given, and the default axis (world z) is very far from the states: more than a hundred times "
        "the distance between them. Give a placement, such as axis_between(start, end).",
    )
    heading_unknown = (
        ILL_POSED + 12,
        "a fixed heading needs a velocity about the axis (V_phi not zero) at that end. Remove it from fixed, or give "
        "a placement whose axis lies elsewhere.",
    )
    state_not_finite = (
        ILL_POSED + 10,
        "a boundary position, a velocity or the placement is NaN or infinite. Give finite numbers.",
    )


MESSAGES = tuple(code.text for code in ResultCode)
_MESSAGE_INDEX = np.zeros(max(ResultCode) + 1, np.int32)
_MESSAGE_INDEX[[int(code) for code in ResultCode]] = np.arange(len(ResultCode))


class AbstractOutcome(AbstractResult):
    """The result of a solve: `code`, a `ResultCode` for each element of the batch, and its text on demand."""

    code: eqx.AbstractVar[Int[Array, "*batch"]]

    @abc.abstractmethod
    def explain(self, at: tuple[int, ...]) -> str:
        """The text for one element of the batch: what happened and what to do. A single problem has `at = ()`."""

    @property
    def successful(self) -> Bool[Array, "*batch"]:
        """Whether the solve succeeded; available inside a trace too."""
        return self.code < FAILURES

    @property
    def result(self) -> Any:
        """What happened and what to do: a string, or for a batch a sequence of strings, composed on access.

        **Raises:** ValueError inside a trace, where only `code` and `successful` are available.
        """
        shape = concrete_codes(self).shape
        return Texts(self.explain, shape) if shape else self.explain(())

    def check(self: T) -> T:
        """Return this result if every element of the batch succeeded; otherwise raise an error, like `throw=True`.

        **Raises:** RuntimeError with the text of the first element that failed. Inside a trace the error is raised when
        the compiled function runs, with the text of the code.
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
    """The codes of a result as a NumPy array.

    **Raises:** ValueError inside a trace.
    """
    codes = concrete(outcome.code)
    if codes is None:
        raise ValueError("the text of a result is not available inside jit, vmap or grad: use successful or code")
    return codes


def names_of(codes: np.ndarray, names: Mapping[ResultCode, str], other: str) -> np.ndarray:
    """The names of an array of codes; `other` for codes without a name."""
    table = np.full(max(ResultCode) + 1, other, dtype=object)
    table[[int(code) for code in names]] = list(names.values())
    return np.asarray(table.astype(str)[codes])


def renumbered(codes: Any, numbers: Mapping[int, ResultCode]) -> Any:
    """The codes of an older document, a number or nested lists, converted to the present numbers."""
    if isinstance(codes, list):
        return [renumbered(code, numbers) for code in codes]
    return int(numbers.get(codes, codes))
