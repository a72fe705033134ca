"""Say which speed at an end is out of reach, how much is within reach, and what to do."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from qtraj.design.timing.result_code import REACHED

BRAKING = ("longitudinal_acceleration", "longitudinal_acceleration_min")
"""The limits that bound the deceleration."""


def missed_speeds(wanted: np.ndarray, speeds: np.ndarray, names: Collection[str]) -> str:
    """Return a text about the speeds [m/s] at both ends, of which at least one is lower than prescribed.

    `wanted` are the prescribed speeds, NaN where free, and `names` those of the limits.
    """
    start, end = speeds < wanted * (1 - REACHED)
    texts = []
    if start:
        advice = f"or raise the limits. {_on_braking(names)}"
        texts.append(f"{_missed('start_speed', 'starts', wanted[0], speeds[0])}, {advice}")
    if end:
        advice = "raise the limits, or choose a higher start_speed or a longer path."
        texts.append(f"{_missed('end_speed', 'ends', wanted[1], speeds[1])}, {advice}")
    return " ".join(texts)


def _missed(argument: str, verb: str, goal: float, reached: float) -> str:
    return (
        f"{argument} cannot be reached within the limits: the fastest timing {verb} with {reached:.4g} m/s instead of "
        f"{goal:.4g} m/s. Pass {argument}={_below(reached)}"
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
