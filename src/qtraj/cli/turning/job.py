"""From the tables of a turn to its program and the profiles of its turns."""

import itertools
from dataclasses import dataclass

import numpy as np

from qtraj.io.attitude_part import radians
from qtraj.io.scenario_part import given
from qtraj.io.turn_model import END_RATES, LIMITS, NEEDED, TurnLawPart, TurnPart
from qtraj.motion.profiles.profile import AbstractProfile, Profile
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Cubic, Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.slew_torque import within_torque

SMOOTH = {"cubic": Cubic, "quintic": Quintic, "septic": Septic}
SAME = 1e-9
"""Of a duration: switches closer than this are one."""


@dataclass(frozen=True)
class Leg:
    """One turn of a program, from `start` [s] on."""

    start: float
    turn: EulerTurn
    profile: Profile

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.start + float(self.profile.duration)

    @property
    def switches(self) -> list[float]:
        """The distinct instants within the turn at which the law passes from one piece to the next [s]."""
        duration = float(self.profile.duration)
        found: list[float] = []
        for t in np.asarray(self.turn.switches).tolist():
            if SAME * duration < t < (1 - SAME) * duration and (not found or t - found[-1] > SAME * duration):
                found.append(t)
        return [self.start + t for t in found]


def turn_program(part: TurnPart, angles: str) -> EulerTurn | SlewSequence:
    """The program of the tables of a turn: one turn, or a chain by way of [[via]].

    **Raises:** ValueError for a duration in which no such turn is possible.
    """
    attitudes = np.stack([attitude.attitude(angles) for attitude in part.attitudes().values()])
    try:
        return _with_torque(_program(attitudes, turn_law(part.law, angles)), part)
    except ValueError as error:
        raise ValueError(f"[law]: {error}") from error


def least_duration(part: TurnPart, angles: str, program: EulerTurn | SlewSequence) -> float | None:
    """The time [s] of the shortest turn found within the limits; None where no law limits it.

    Within rate, acceleration and jerk it is the least there is. To keep a torque limit laws are slowed down (see
    `within_torque`), of a chain all legs alike, and another turn may be shorter.
    """
    law = fastest_law(part.law, angles)
    if law is None:
        return None
    chain = isinstance(program, SlewSequence)
    fastest = _program(np.asarray(program.attitudes if chain else [program.start_q, program.end_q]), law)
    body = part.body
    if body is not None and body.max_torque is not None and not given(part.law, *END_RATES):
        fastest = within_torque(fastest, body.inertia, body.max_torque)
    return float(fastest.duration)


def _program(attitudes: np.ndarray, law: AbstractProfile) -> EulerTurn | SlewSequence:
    return SlewSequence(attitudes, law) if len(attitudes) > 2 else EulerTurn(attitudes[0], attitudes[1], law)


def _with_torque(program: EulerTurn | SlewSequence, part: TurnPart) -> EulerTurn | SlewSequence:
    """The program slowed to its torque limit; with a duration or end rates of its own it is judged afterwards."""
    body = part.body
    if body is None or body.max_torque is None or given(part.law, "duration", *END_RATES):
        return program
    return within_torque(program, body.inertia, body.max_torque)


def turn_law(part: TurnLawPart, angles: str) -> AbstractProfile:
    """The law of a table [law]; a polynomial of fixed duration without its limits, which are judged afterwards."""
    if part.duration is not None and part.kind not in NEEDED:
        return SMOOTH[part.kind](duration=part.duration)
    return _limited(part, angles, part.duration)


def fastest_law(part: TurnLawPart, angles: str) -> AbstractProfile | None:
    """The law that takes the least time within the limits; None where none is given."""
    return _limited(part, angles, None) if given(part, *LIMITS) else None


def turn_limits(part: TurnLawPart, angles: str) -> dict[str, float]:
    """The limits that are given, by name, in radians."""
    return {name: radians(angles) * getattr(part, name) for name in given(part, *LIMITS)}


def legs(program: EulerTurn | SlewSequence) -> list[Leg]:
    """The turns of a program, one after the other."""
    if isinstance(program, EulerTurn):
        return [Leg(0.0, program, program.profile)]
    attitudes = np.asarray(program.attitudes)
    turns = [EulerTurn(a, b, program.law) for a, b in itertools.pairwise(attitudes)]
    starts = [float(t) for t in np.asarray(program.times)[:-1]]
    return [Leg(start, turn, turn.profile) for start, turn in zip(starts, turns, strict=True)]


def _limited(part: TurnLawPart, angles: str, duration: float | None) -> AbstractProfile:
    limits = turn_limits(part, angles)
    if part.kind == "time_optimal":
        ends = {name: radians(angles) * getattr(part, name) for name in given(part, *END_RATES)}
        return TimeOptimal(limits.get("max_rate"), limits["max_acceleration"], duration=duration, **ends)
    if part.kind == "s_curve":
        return SCurve(limits.get("max_rate"), limits["max_acceleration"], limits["max_jerk"], duration)
    return SMOOTH[part.kind](duration=duration, **limits)
