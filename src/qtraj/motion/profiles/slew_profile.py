"""Create a motion profile from its name, from limits or a duration."""

from __future__ import annotations  # so that `help` shows short names

from typing import Any

from qtraj.foundation.types import ArrayInput
from qtraj.motion.profiles.profile import END_STATES, AbstractProfile
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Cubic, Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal

PROFILES = {"time_optimal": TimeOptimal, "s_curve": SCurve, "cubic": Cubic, "quintic": Quintic, "septic": Septic}
"""The motion profiles by name."""
POLYNOMIALS = ("cubic", "quintic", "septic")
"""Profiles that are determined by a duration alone; limits then only bound the duration."""
LIMITS = ("max_rate", "max_acceleration", "max_jerk")

REQUIRED = {"time_optimal": ("max_acceleration",), "s_curve": ("max_acceleration", "max_jerk")}
"""The limits that a profile needs even if a duration is specified."""
WITH_END_STATES = {"time_optimal": END_STATES[:2], "s_curve": END_STATES}
"""The rates and accelerations at the ends that a profile can have."""
SMOOTHER = {"time_optimal": "'s_curve'", "cubic": "'quintic', 'septic' or 's_curve'"}
"""For profiles with a discontinuous acceleration, similar profiles with a bounded jerk."""


def slew_profile(
    kind: str = "time_optimal",
    *,
    max_rate: ArrayInput | None = None,
    max_acceleration: ArrayInput | None = None,
    max_jerk: ArrayInput | None = None,
    duration: ArrayInput | None = None,
    start_rate: ArrayInput | None = None,
    end_rate: ArrayInput | None = None,
    start_acceleration: ArrayInput | None = None,
    end_acceleration: ArrayInput | None = None,
) -> AbstractProfile:
    """Create a motion profile from its name, as in `slew_profile("quintic", max_rate=0.1, max_jerk=0.02)`.

    The `kind` is "time_optimal", "s_curve", "cubic", "quintic" or "septic", for the classes `TimeOptimal`, `SCurve`,
    `Cubic`, `Quintic` and `Septic`. `max_rate` [rad/s], `max_acceleration` [rad/s²] and `max_jerk` [rad/s³] are limits;
    without a `duration` [s], a slew takes the minimum time within the limits. A time-optimal profile needs
    `max_acceleration` and can have a `start_rate` and an `end_rate` [rad/s]. An S-curve needs `max_acceleration` and
    `max_jerk` and can also have a `start_acceleration` and an `end_acceleration` [rad/s²]. The other profiles start and
    end at rest. A polynomial needs a limit or a duration. The jerk can only be
    limited if the acceleration is continuous, as for "s_curve", "quintic" and "septic". For a distance along a line,
    read m instead of rad.

    **Raises:** ValueError for an unknown kind, a missing limit, a limit, a rate or an acceleration that the profile
    cannot have, and invalid values.
    """
    if kind not in PROFILES:
        raise ValueError(f"the kind of a slew must be one of {', '.join(map(repr, PROFILES))}, but {kind!r} was given")
    arguments = {"max_rate": max_rate, "max_acceleration": max_acceleration, "max_jerk": max_jerk}
    arguments |= {"duration": duration, "start_rate": start_rate, "end_rate": end_rate}
    arguments |= {"start_acceleration": start_acceleration, "end_acceleration": end_acceleration}
    given = {name: value for name, value in arguments.items() if value is not None}
    _require_suitable(kind, given)
    return PROFILES[kind](**{"max_rate": None, **given})


def _require_suitable(kind: str, given: dict[str, Any]) -> None:
    """Raise a ValueError if the arguments `given` do not determine a profile of this kind."""
    for name in REQUIRED.get(kind, ()):
        if name not in given:
            raise ValueError(f"a slew of kind {kind!r} needs {name!r}, which is missing")
    if kind in SMOOTHER and "max_jerk" in given:
        raise ValueError(
            f"max_jerk cannot be used with a {kind} slew, whose acceleration is discontinuous: use kind = "
            f"{SMOOTHER[kind]}"
        )
    for name in END_STATES:
        if name in given and name not in WITH_END_STATES.get(kind, ()):
            kinds = " or ".join(repr(k) for k, names in WITH_END_STATES.items() if name in names)
            ends = "has no acceleration at its ends" if kind in WITH_END_STATES else "starts and ends at rest"
            raise ValueError(f"{name!r} is valid only with kind = {kinds}: a slew of kind {kind!r} {ends}")
    if kind in POLYNOMIALS and not given:
        limits = LIMITS[:2] if kind in SMOOTHER else LIMITS
        raise ValueError(f"a {kind} slew needs a duration or a limit: {', '.join(limits)}")
