"""The peaks of a turn against its limits."""

from collections.abc import Sequence
from typing import Any

from qtraj.cli.turning.job import Leg
from qtraj.motion.programs.slew_torque import TorquePeak

ORDERS = {"max_rate": 1, "max_acceleration": 2, "max_jerk": 3}
UNITS = {"max_rate": "rad/s", "max_acceleration": "rad/s²", "max_jerk": "rad/s³"}
TOLERANCE = 1e-9
"""Relative: a limit is broken by more than this, and binds where the peak is nearer to it."""


def judged(turns: Sequence[Leg], limits: dict[str, float], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The peak of each magnitude over all turns, when it first occurs, and what it is against its limit."""
    found = {}
    for name in names:
        found[name] = _entry(UNITS[name], *_peak(turns, ORDERS[name]), limits.get(name))
    return found


def judged_torque(peak: TorquePeak, limit: float | list[float] | None) -> dict[str, dict[str, Any]]:
    """The largest torque, of its length or, where each axis has its limit, of the components."""
    if not isinstance(limit, list):
        return {"max_torque": _entry("N m", peak.norm, peak.norm_time, limit)}
    each = zip("xyz", peak.axes, peak.axes_times, limit, strict=True)
    return {f"max_torque_{axis}": _entry("N m", value, time, bound) for axis, value, time, bound in each}


def _entry(unit: str, value: float, time: float, bound: float | None) -> dict[str, Any]:
    return {
        "unit": unit,
        "value": value,
        "time": time,
        "limit": bound,
        "margin": None if bound is None else bound - value,
        "status": None if bound is None else "broken" if value > bound * (1 + TOLERANCE) else "met",
        "binding": bound is not None and abs(value - bound) <= TOLERANCE * bound,
    }


def _peak(turns: Sequence[Leg], order: int) -> tuple[float, float]:
    """The largest magnitude of a derivative of the angle, and the first instant of it [s]."""
    best, when = 0.0, turns[0].start
    for leg in turns:
        time, value = leg.profile.peak(order)
        if value > best * (1 + TOLERANCE):
            best, when = value, leg.start + time
    return best, when
