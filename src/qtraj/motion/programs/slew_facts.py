"""Facts about a slew as text, with angles in degrees, for the terminal."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.foundation.number_text import degrees, number
from qtraj.foundation.units import symbol
from qtraj.motion.profiles.profile import AbstractProfile
from qtraj.motion.programs.slew_verdict import TORQUE_UNIT, UNITS, SlewVerdict

MOTION_TITLE = "Program: t [s], angle Φ [°], rate [°/s], accel. [°/s²], quaternion λ"
MOTION_HEADERS = {
    "time": ["t"],
    "angle": ["Φ"],
    "angle_rate": ["rate"],
    "angle_acceleration": ["accel."],
    "quaternion": ["λ0", "λ1", "λ2", "λ3"],
}
"""The headers of the printed columns of a `SlewHistory`."""


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


def end_texts(verdict: SlewVerdict) -> list[str]:
    """Describe the sign of the final quaternion, if it is not as requested, and the minimum duration, if known."""
    texts = []
    if verdict.sign < 0:
        texts.append(
            f"The program ends at λ = {vector_text(verdict.end)}, the specified quaternion with the opposite sign, "
            "which is the same attitude. Start the next program from the quaternion with this sign."
        )
    if np.isfinite(verdict.least_duration):
        texts.append(f"The fastest slew within the limits takes {float(verdict.least_duration):.4f} s.")
    return texts


def end_rates_text(law: AbstractProfile) -> str:
    """Describe the discontinuity of a slew with rates or accelerations at its ends; return an empty text for none."""
    for name, unit in (("rate", "°/s"), ("acceleration", "°/s²")):
        values = {verb: getattr(law, f"{end}_{name}", None) for verb, end in (("starts", "start"), ("ends", "end"))}
        moving = [f"{verb} at {degrees(float(value))}{unit}" for verb, value in values.items() if value]
        if moving:
            return (
                f"The slew {' and '.join(moving)}, but the program is at rest before and after the slew, so the "
                f"commanded {name} is discontinuous."
            )
    return ""


def vector_text(values: Any) -> str:
    """Return the components of a vector as text, or a dash if a component is NaN."""
    vector = np.array(values, dtype=float)
    return "-" if np.isnan(vector).any() else "(" + ", ".join(f"{round(v, 6) + 0.0:.6f}" for v in vector) + ")"
