"""Create a motion profile from its name, from limits or a duration."""

from __future__ import annotations  # so that `help` shows short names

from typing import Any

from qtraj.foundation.types import ArrayInput
from qtraj.motion.profiles.profile import AbstractProfile
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Cubic, Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal

PROFILES = {"time_optimal": TimeOptimal, "s_curve": SCurve, "cubic": Cubic, "quintic": Quintic, "septic": Septic}
"""The motion profiles by name."""
POLYNOMIALS = ("cubic", "quintic", "septic")
"""Profiles that are determined by a duration alone; limits then only bound the duration."""
LIMITS, END_RATES = ("max_rate", "max_acceleration", "max_jerk"), ("start_rate", "end_rate")

REQUIRED = {"time_optimal": ("max_acceleration",), "s_curve": ("max_acceleration", "max_jerk")}
"""The limits that a profile needs even if a duration is specified."""
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
) -> AbstractProfile:
    """Create a motion profile from its name, as in `slew_profile("quintic", max_rate=0.1, max_jerk=0.02)`.

    The `kind` is "time_optimal", "s_curve", "cubic", "quintic" or "septic", for the classes `TimeOptimal`, `SCurve`,
    `Cubic`, `Quintic` and `Septic`. `max_rate` [rad/s], `max_acceleration` [rad/s²] and `max_jerk` [rad/s³] are limits;
    without a `duration` [s], a slew takes the minimum time within the limits. A time-optimal profile needs
    `max_acceleration` and can have a `start_rate` and an `end_rate` [rad/s]; the other profiles start and end at rest.
    An S-curve needs `max_acceleration` and `max_jerk`. A polynomial needs a limit or a duration. The jerk can only be
    limited if the acceleration is continuous, as for "s_curve", "quintic" and "septic". For a distance along a line,
    read m instead of rad.

    **Raises:** ValueError for an unknown kind, a missing limit, a limit or an end rate that the profile cannot have,
    and invalid values.
    """
    if kind not in PROFILES:
        raise ValueError(f"the kind of a slew must be one of {', '.join(map(repr, PROFILES))}, but {kind!r} was given")
    arguments = {"max_rate": max_rate, "max_acceleration": max_acceleration, "max_jerk": max_jerk}
    arguments |= {"duration": duration, "start_rate": start_rate, "end_rate": end_rate}
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
    for name in END_RATES:
        if kind != "time_optimal" and name in given:
            raise ValueError(
                f"{name!r} is valid only with kind = 'time_optimal': a slew of kind {kind!r} starts and ends at rest"
            )
    if kind in POLYNOMIALS and not given:
        limits = LIMITS[:2] if kind in SMOOTHER else LIMITS
        raise ValueError(f"a {kind} slew needs a duration or a limit: {', '.join(limits)}")
