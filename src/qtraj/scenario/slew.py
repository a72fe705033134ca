"""Define the scenario keys of a slew, for `qtraj slew` and [program.slew] of `qtraj simulate`, and build the slew."""

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from qtraj.foundation.naming import naming
from qtraj.motion.profiles.profile import END_STATES, AbstractProfile, has_end_states, is_fixed
from qtraj.motion.profiles.slew_profile import LIMITS, POLYNOMIALS, PROFILES, slew_profile
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.slew_torque import within_torque
from qtraj.motion.programs.slew_verdict import judge_slew
from qtraj.scenario import keys
from qtraj.scenario.keys import ANGLES, KnownAttitudePart, NamedPart, Part, key, one_of, radians
from qtraj.scenario.reader import ScenarioFile


class SlewLawPart(Part):
    """The motion profile of each slew.

    A time_optimal slew needs max_acceleration. An s_curve slew needs max_acceleration and max_jerk. The polynomials
    (cubic, quintic, septic) need a limit or a duration. Without a duration, the slew has the minimum duration within
    the limits.
    """

    kind: Annotated[str, one_of(PROFILES)] = key("the motion profile", "time_optimal")
    max_rate: keys.Positive | None = key("limit on the rate", None, unit="angle/s")
    max_acceleration: keys.Positive | None = key("limit on the acceleration", None, unit="angle/s²")
    max_jerk: keys.Positive | None = key(
        "limit on the jerk, for profiles with continuous acceleration: s_curve, quintic, septic",
        None,
        unit="angle/s³",
    )
    duration: keys.Seconds | None = key(
        "duration of each slew; with a polynomial profile the limits are then only checked", None
    )
    start_rate: keys.Number | None = key(
        "initial rate about the slew axis; only for time_optimal and s_curve; default: 0", None, unit="angle/s"
    )
    end_rate: keys.Number | None = key(
        "final rate about the slew axis; only for time_optimal and s_curve; default: 0", None, unit="angle/s"
    )

    start_acceleration: keys.Number | None = key(
        "initial acceleration about the slew axis; only for s_curve; default: 0", None, unit="angle/s²"
    )
    end_acceleration: keys.Number | None = key(
        "final acceleration about the slew axis; only for s_curve; default: 0", None, unit="angle/s²"
    )

    def _faults(self) -> Iterator[str]:
        slew_profile(**self.model_dump(exclude_none=True))  # raises in the units of the file
        yield from ()

    def limits(self, angles: str) -> dict[str, float]:
        """Return the limits that are set, by name, with angles in radians; `angles` is "deg" or "rad"."""
        return {name: radians(angles) * getattr(self, name) for name in self.given(*LIMITS)}

    def law(self, angles: str) -> AbstractProfile:
        """Return the motion profile; the limits of a polynomial with a duration are checked later."""
        judged = self.duration is not None and self.kind in POLYNOMIALS
        states = {name: radians(angles) * getattr(self, name) for name in self.given(*END_STATES)}
        return slew_profile(self.kind, duration=self.duration, **({} if judged else self.limits(angles)), **states)


class BodyPart(Part):
    """The inertia and the torque limit of the body."""

    inertia: keys.Inertia = key("moment of inertia of a spherical body, principal moments, or the tensor, in body axes")
    max_torque: keys.Positive | keys.PositiveVector | None = key(
        "limit on the torque, for the norm or for each component in body axes; a slew that starts and ends at rest "
        "is slowed down to satisfy the limit, or accelerated less if it has a 'duration'",
        None,
        values="one or three positive finite numbers [N m]",
    )


class SlewPart(Part):
    """Slews from [start] through every [[via]] to [end]; each slew is the shorter rotation about a fixed axis.

    With an axis instead of [end], one slew about this axis by an angle, a number of whole turns, or both.
    """

    start: KnownAttitudePart = key("the first attitude", values="a table [start] with an attitude")
    via: list[KnownAttitudePart] = key(
        "intermediate attitudes, at which the body comes to rest", [], values="tables [[via]] with one attitude each"
    )
    end: KnownAttitudePart | None = key(
        "the last attitude; required without 'axis'", None, values="a table [end] with an attitude"
    )
    axis: keys.Vector | None = key(
        "axis of a slew without [end], in body axes", None, values=f"{keys.THREE}, not all zero, of any length"
    )
    angle: keys.Number | None = key("angle of a slew about 'axis', of any size and either sign", None, unit="angle")
    turns: keys.Turns | None = key(
        "whole turns about 'axis', which are added to 'angle'; a negative number turns the other way", None
    )
    law: SlewLawPart = key("the motion profile")
    body: BodyPart | None = key("the body; required for torques and for a limit on the torque", None)

    def _faults(self) -> Iterator[str]:
        if (self.axis is None) != (self.angle is None and self.turns is None):
            yield "axis and angle must be specified together: a slew turns by angle, turns or both about axis"
        if self.end is None and self.axis is None:
            yield "the key 'end' is missing: specify [end], or axis with angle or turns"
        if self.axis is not None and (self.end is not None or self.via):
            yield "axis and angle describe the whole slew: omit them, or omit [end] and [[via]]"
        if self.axis is not None and not any(self.axis):
            yield "axis must not be zero, because it is then not an axis"

    def attitudes(self) -> dict[str, KnownAttitudePart]:
        """Return all specified attitudes in order of time, by the names of their tables."""
        parts = {"start": self.start} | {f"via[{k}]": part for k, part in enumerate(self.via)} | {"end": self.end}
        return {name: part for name, part in parts.items() if part is not None}

    def program(self, angles: str, start: np.ndarray | None = None) -> EulerTurn | SlewSequence:
        """Return one slew, or a sequence through [[via]], slowed down to satisfy the torque limit.

        Without an attitude [start], it starts with `start` (4,).

        A slew with rates or accelerations at its ends is not slowed down, and may violate its limits. A slew with a
        duration keeps it; its acceleration is reduced, unless the torque limit cannot be satisfied in this time.

        **Raises:** ValueError if no such slew is possible within the duration.
        """
        own = self.attitudes()
        first = [] if "start" in own or start is None else [start]
        attitudes = np.stack([*first, *(attitude.attitude(angles) for attitude in own.values())])
        with naming("[law]: "):
            law = self.law.law(angles)
            program = self._slews(attitudes, law, angles)
            if self.body is None or self.body.max_torque is None or has_end_states(law):
                return program
            try:
                return within_torque(program, self.body.inertia, self.body.max_torque)
            except ValueError:
                if law.duration is None:
                    raise
                return program

    def _slews(self, attitudes: np.ndarray, law: AbstractProfile, angles: str) -> EulerTurn | SlewSequence:
        if self.axis is not None:
            angle = radians(angles) * (self.angle or 0.0) + 2 * math.pi * (self.turns or 0)
            return EulerTurn.about(self.axis, angle, attitudes[0], law)
        return SlewSequence(attitudes, law) if self.via else EulerTurn(attitudes[0], attitudes[1], law)

    def program_within_limits(self, angles: str, start: np.ndarray | None = None) -> EulerTurn | SlewSequence:
        """Return the program, as `program` does, or raise a ValueError if it violates its limits."""
        program, body = self.program(angles, start), self.body
        if is_fixed(program.law):
            verdict = judge_slew(program, self.law.limits(angles), body and body.inertia, body and body.max_torque)
            if not verdict.met:
                raise ValueError(verdict.result)
        return program


class NextSlewPart(SlewPart):
    """A slew in a sequence of programs; without [start], it starts with the attitude at the end of the program before.

    The law needs a start_rate if that program ends in motion.
    """

    start: KnownAttitudePart | None = key(  # pyright: ignore[reportIncompatibleVariableOverride]
        "the first attitude; default: the end of the program before", None, values="a table [start] with an attitude"
    )


class SlewScenario(NamedPart, SlewPart):
    """Slews from [start] through every [[via]] to [end]; each slew is the shorter rotation about a fixed axis.

    With an axis instead of [end], one slew about this axis by an angle, a number of whole turns, or both.
    """

    angles: keys.Angles = key("the unit of angles", values=ANGLES)


def slew_program(loaded: ScenarioFile[SlewScenario]) -> EulerTurn | SlewSequence:
    """Return the program of a scenario.

    **Raises:** ValueError, which names the scenario, if the slew is impossible within the duration and the limits.
    """
    with naming(f"{loaded.file}: "):
        return loaded.scenario.program(loaded.scenario.angles)
