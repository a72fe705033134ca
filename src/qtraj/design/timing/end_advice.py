"""Say which speed at an end is out of reach, how much is within reach, and what to do."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from qtraj.design.timing.result_code import REACHED

BRAKING = ("longitudinal_acceleration", "longitudinal_acceleration_min")
"""The limits that bound the deceleration."""


def missed_speeds(wanted: np.ndarray, speeds: np.ndarray, names: Collection[str], duration: float | None) -> str:
    """Return a text about the speeds [m/s] at both ends, of which at least one is lower than prescribed.

    `wanted` are the prescribed speeds, NaN where free, and `names` those of the limits. With a prescribed `duration`
    [s], the limits on accelerations are lower than the given ones.
    """
    start, end = speeds < wanted * (1 - REACHED)
    if duration is not None:
        ends = ("start_speed", "starts"), ("end_speed", "ends")
        rows = zip(ends, wanted, speeds, (start, end), strict=True)
        return " ".join(_too_gentle(*words, goal, reached, duration) for words, goal, reached, missed in rows if missed)
    texts = []
    if start:
        advice = f"or raise the limits. {_on_braking(names)}"
        texts.append(f"{_missed('start_speed', 'starts', wanted[0], speeds[0])}, {advice}")
    if end:
        choose = "a longer path" if start or np.isnan(wanted[0]) else "a higher start_speed or a longer path"
        advice = f"raise the limits, or choose {choose}."
        texts.append(f"{_missed('end_speed', 'ends', wanted[1], speeds[1])}, {advice}")
    return " ".join(texts)


def _missed(argument: str, verb: str, goal: float, reached: float) -> str:
    return (
        f"{argument} cannot be reached within the limits: the fastest timing {verb} with {reached:.4g} m/s instead of "
        f"{goal:.4g} m/s. Pass {argument}={_below(reached)}"
    )


def _too_gentle(argument: str, verb: str, goal: float, reached: float, duration: float) -> str:
    return (
        f"{argument} cannot be reached with the duration of {duration:.6g} s: the timing that accelerates most gently "
        f"{verb} with {reached:.4g} m/s instead of {goal:.4g} m/s. "
        f"Pass {argument}={_below(reached)}, or a shorter duration."
    )


def _below(speed: float) -> str:
    """Return a speed of four digits that is not higher."""
    unit = 10.0 ** (np.floor(np.log10(speed)) - 3) if speed > 0 else 1.0
    return f"{np.floor(speed / unit * (1 - 1e-9)) * unit:.4g}"


def _on_braking(names: Collection[str]) -> str:
    """Return advice on a start speed that is higher than the limits allow."""
    if not set(BRAKING) & set(names):
        return (
            "Or add a limit on longitudinal_acceleration: then the vehicle brakes from start_speed until it is within "
            "the limits. Without this limit, braking is unbounded."
        )
    return (
        "A start_speed above the limits is possible only if the vehicle can brake until it is within the limits before "
        "its first stop or the end of the path, and if no duration is prescribed or argument traced."
    )
