"""Facts about a fit, as plain data and as text, for the terminal, JSON, datasets and reports."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.design.fitting.fitted import Fitted
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.record import Quantity
from qtraj.foundation.size_text import duration_text, length_text
from qtraj.motion.attitude_residual import mounting_angles
from qtraj.path.placement import Placement
from qtraj.path.residual import MEANINGS

TITLE = "Fitted spiral-helix against the recording"

_RESIDUAL = ("horizontal_rms", "vertical_rms", "maximum", "velocity_rms", "direction_rms", "radius_min", "radius_max")

_ATTITUDE = ("attitude_rms", "attitude_maximum", "mounting_yaw", "mounting_pitch", "mounting_roll")

FACTS = {
    "samples": MEANINGS["samples"],
    **{name: MEANINGS[name] for name in _RESIDUAL},
    "relative_rms": ("1", "RMS horizontal distance divided by the radius of the turn"),
    "relative_speed": ("1", "largest speed difference divided by the RMS recorded speed"),
    "recorded_turn": MEANINGS["turn"],
    "turn": ("rad", "angle of the fitted path about its axis"),
    "duration": ("s", "duration of the fitted path"),
    "attitude_rms": ("rad", "RMS angle between the recorded attitude and the upright frame rotated by the mounting"),
    "attitude_maximum": (
        "rad",
        "largest angle between the recorded attitude and the upright frame rotated by the mounting",
    ),
    "mounting_yaw": ("rad", "yaw of the recorder in the upright frame (Z-Y-X)"),
    "mounting_pitch": ("rad", "pitch of the recorder in the upright frame (Z-Y-X), positive nose down"),
    "mounting_roll": ("rad", "roll of the recorder in the upright frame (Z-Y-X)"),
}
"""Unit and meaning of each number, by name."""


def facts(fitted: Fitted) -> dict[str, Any]:
    """Return the numbers of a fit, its axis and its result as JSON types; unknown numbers are None.

    The item `warning` is the result text of a fit that is loose, poor or not converged, and otherwise None.
    """
    residual, path = fitted.residual, fitted.path
    numbers = {name: getattr(residual, name) for name in _RESIDUAL} | {
        "relative_rms": fitted.relative_rms,
        "relative_speed": fitted.relative_speed,
        "recorded_turn": residual.turn,
        "turn": path.turn,
        "duration": path.duration,
        **dict.fromkeys(_ATTITUDE),
    }
    if fitted.attitude is not None:
        angles = mounting_angles(fitted.attitude)
        numbers |= dict(zip(_ATTITUDE, (fitted.attitude.rms, fitted.attitude.maximum, *angles), strict=True))
    code = ResultCode(int(fitted.code))
    return {
        "samples": int(residual.samples),
        **{name: _finite_or_none(value) for name, value in numbers.items()},
        "axis": np.asarray((path.placement or Placement()).origin)[:2].tolist(),
        "status": code.name,
        "successful": bool(fitted.successful),
        "result": fitted.result,
        "warning": fitted.result if code == ResultCode.loose_fit or not fitted.successful else None,
    }


def fit_variables(fitted: Fitted) -> tuple[dict[str, Quantity], dict[str, str]]:
    """Return the facts as variables and attributes of a dataset, with the prefix `fit_`.

    All variables are scalars except the axis, which has the dimension `world`.
    """
    fit = facts(fitted)
    variables = {
        f"fit_{name}": Quantity(np.asarray(fit[name]), unit, f"fit: {meaning}")
        for name, (unit, meaning) in FACTS.items()
        if fit[name] is not None
    }
    axis = np.asarray((fitted.path.placement or Placement()).origin)
    variables["fit_axis"] = Quantity(axis, "m", "fit: a point on the vertical axis", ("world",))
    texts = {f"fit_{name}": fit[name] for name in ("status", "result", "warning") if fit[name]}
    return variables, texts


def fact_rows(fit: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the facts as pairs of a name and a text."""
    degrees = math.degrees
    x, y = fit["axis"]
    rows = [
        (
            "horizontal distance",
            f"{length_text(fit['horizontal_rms'], 3)} RMS, {_percent(fit['relative_rms'])} of the radius",
        ),
        ("vertical distance", f"{length_text(fit['vertical_rms'], 3)} RMS"),
        ("largest distance", length_text(fit["maximum"], 3)),
        ("speed", f"differs from the recorded speed by at most {_percent(fit['relative_speed'])}"),
        ("samples", f"{fit['samples']:.0f} in {duration_text(fit['duration'])}"),
        ("direction of travel", f"turns by {degrees(fit['recorded_turn']):.2f}°"),
        ("angle about the axis", f"{degrees(fit['turn']):.2f}°"),
        ("distance from the axis", f"{length_text(fit['radius_min'])} to {length_text(fit['radius_max'])}"),
        ("axis", f"vertical through ({x:.2f}, {y:.2f}) m"),
    ]
    if fit["direction_rms"] is not None:
        rows.insert(2, ("direction", f"{degrees(fit['direction_rms']):.2f}° RMS"))
    else:
        rows.append(("velocities", "not recorded; taken from the fitted path"))
    if fit["attitude_rms"] is not None:
        rms, maximum, yaw, pitch, roll = (degrees(fit[name]) for name in _ATTITUDE)
        rows.append(("recorded attitude", f"differs from the upright frame by {rms:.2f}° RMS, {maximum:.2f}° maximum"))
        nose = "down" if pitch > 0 else "up"
        rows.append(("mounting", f"yaw {yaw:.2f}°, pitch {pitch:.2f}° (nose {nose}), roll {roll:.2f}° (Z-Y-X)"))
    return rows


def _finite_or_none(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _percent(fraction: float | None) -> str:
    """Format a fraction as a percentage, or as a dash if an older document does not contain it."""
    return "-" if fraction is None or math.isnan(fraction) else f"{fraction:.1%}"
