"""Check the states at both ends of a motion."""

from typing import Any

from qtraj.foundation.arrays import concrete, require_finite
from qtraj.foundation.types import Scalar
from qtraj.motion.profiles.profile import END_STATES

TOLERANCE = 1e-12
"""Relative tolerance for a final rate that the final acceleration approaches just within the limit."""


def require_states(motion_profile: Any) -> None:
    """Raise a ValueError for a state that is not finite, or a final state that limits on rate or acceleration forbid.

    A final acceleration a needs the rate v − a|a|/(2J) before the end, for the limit J on the jerk: a rate that
    decreases at the end was higher before, and one that increases was lower.
    """
    for name in END_STATES:
        value = getattr(motion_profile, name)
        if value is not None:
            require_finite(value, name)
    a, a_max = _number(motion_profile.end_acceleration, 0.0), _number(motion_profile.max_acceleration, None)
    v, v_max = _number(motion_profile.end_rate, 0.0), _number(motion_profile.max_rate, None)
    _require_within("end_acceleration", a, "max_acceleration", a_max)
    _require_within("end_rate", v, "max_rate", v_max)
    j = _number(motion_profile.max_jerk, None)
    if a is None or v is None or v_max is None or j is None:
        return
    before = v - a * abs(a) / (2 * j)
    if abs(before) > v_max * (1 + TOLERANCE):
        raise ValueError(
            f"with end_acceleration = {a!r}, end_rate = {v!r} and max_jerk = {j!r}, the rate is at {before:.9g} before "
            f"the end, beyond max_rate = {v_max!r}. Reduce |end_acceleration| or |end_rate|, or raise max_jerk or "
            "max_rate."
        )


def _number(value: Scalar | None, otherwise: float | None) -> float | None:
    """Return a concrete value as a number, `otherwise` for None, and None for a traced value."""
    if value is None:
        return otherwise
    known = concrete(value)
    return None if known is None else float(known)


def _require_within(name: str, value: float | None, limit_name: str, limit: float | None) -> None:
    if value is not None and limit is not None and abs(value) > limit:
        raise ValueError(
            f"|{name}| must not exceed {limit_name}, but {name} = {value!r} and {limit_name} = {limit!r} were given"
        )
