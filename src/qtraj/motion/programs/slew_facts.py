"""Facts about a slew as text, with angles in degrees, for the terminal."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.foundation.number_text import degrees, number
from qtraj.foundation.units import symbol
from qtraj.motion.programs.slew_verdict import TORQUE_UNIT, UNITS, SlewVerdict


def slew_fact_rows(verdict: SlewVerdict, k: int) -> list[tuple[str, str]]:
    """Return the facts about slew number `k` of the program as pairs of a name and a text."""
    start, duration = float(verdict.starts[k]), float(verdict.durations[k])
    rows = [
        ("angle", f"{math.degrees(float(verdict.angles[k])):.4f}°"),
        ("axis, body", vector_text(verdict.body_axes[k])),
        ("axis, inertial", vector_text(verdict.inertial_axes[k])),
        ("duration", f"{duration:.4f} s"),
    ]
    if start:
        rows.append(("from", f"{start:.4f} s on"))
    if switches := [t for t in np.asarray(verdict.switches).tolist() if start < t < start + duration]:
        rows.append(("switches at", ", ".join(f"{t:.4f}" for t in switches) + " s"))
    return rows


def slew_limit_rows(verdict: SlewVerdict) -> list[tuple[str, ...]]:
    """Return name, peak, limit, margin, time of the peak [s], unit and status of each limited quantity as texts."""
    columns = (np.asarray(x).tolist() for x in (verdict.peaks, verdict.limits, verdict.times))
    rows = []
    for name, peak, limit, time in zip(verdict.names, *columns, strict=True):
        active, unit = name in verdict.active, UNITS.get(name, TORQUE_UNIT)
        write: Callable[[float], str] = degrees if unit.startswith("rad") else number
        numbers = (write(peak), write(limit), write(0.0 if active else limit - peak), number(time))
        status = "active" if active else verdict.status[name]
        rows.append((name.removeprefix("max_"), *numbers, symbol(unit).replace("rad", "°"), status))
    return rows


def end_rates_text(start_rate: float, end_rate: float) -> str:
    """Describe the discontinuity of a program whose slew has the rates `start_rate` and `end_rate` [rad/s] at its ends.

    The text is empty if both rates are zero.
    """
    rates = {"starts": start_rate, "ends": end_rate}
    moving = [f"{verb} at {degrees(rate)}°/s" for verb, rate in rates.items() if rate]
    if not moving:
        return ""
    return (
        f"The slew {' and '.join(moving)}, but the program is at rest before and after the slew, so the commanded rate "
        "is discontinuous."
    )


def vector_text(values: Any) -> str:
    """Return the components of a vector as text, or a dash if a component is NaN."""
    vector = np.array(values, dtype=float)
    return "-" if np.isnan(vector).any() else "(" + ", ".join(f"{round(v, 6) + 0.0:.6f}" for v in vector) + ")"
