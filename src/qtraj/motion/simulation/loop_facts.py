"""Facts about a simulated closed loop as text, with angles in degrees, for the terminal."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.foundation.number_text import degrees, number
from qtraj.motion.control.hysteresis import HystereticLaw, without_hysteresis
from qtraj.motion.control.laws import AbstractLaw
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.loop_verdict import LoopVerdict


def gains_of(law: AbstractLaw) -> dict[str, Any]:
    """Return the gains k, k1 and k2 of a feedback law, and the half-width of its hysteresis, as JSON types by name."""
    bare = without_hysteresis(law)
    gains = {name: getattr(bare, name, None) for name in ("k", "k1", "k2")}
    found = {name: np.asarray(gain).tolist() for name, gain in gains.items() if gain is not None}
    return found | ({"half_width": float(law.half_width)} if isinstance(law, HystereticLaw) else {})


def limit_of(actuator: Actuator | None) -> dict[str, Any]:
    """Return the limit of an actuator and its saturation as JSON types by name; both are None without a limit."""
    if actuator is None or actuator.limit is None:
        return {"command_limit": None, "saturation": None}
    return {"command_limit": np.asarray(actuator.limit).tolist(), "saturation": actuator.saturation}


def gains_text(gains: Mapping[str, Any]) -> str:
    """Describe the gains of a feedback law, such as "k1 = 2, k2 = 1"; matrices are not printed."""
    return ", ".join(f"{name} = {_gain(gain)}" for name, gain in gains.items())


def command_unit(verdict: LoopVerdict) -> str:
    """Return the symbol of the unit of the command, with angles in degrees."""
    return "°/s" if verdict.commands == "rate" else "°/s²"


def stability_text(verdict: LoopVerdict) -> str | None:
    """Describe how the error grows if the closed loop is not asymptotically stable; otherwise return None."""
    if verdict.stable:
        return None
    if verdict.growth > 0:
        return f"The closed loop is unstable: with these gains the error grows as exp({float(verdict.growth):.4g} t)."
    return "The closed loop is not asymptotically stable: with these gains the error does not decay."


def deviation_text(verdict: LoopVerdict) -> str | None:
    """Describe a deviation from the closed form that exceeds the `bound` of the verdict; otherwise return None."""
    if verdict.agrees is not False:
        return None
    return (
        f"The deviation from the closed form exceeds {float(verdict.bound):.3g}, the largest value that the tolerances "
        "explain."
    )


def motion_headers(verdict: LoopVerdict, open_loop: bool = False) -> tuple[str, dict[str, list[str]]]:
    """Return the title of a printed table of the motion, and the headers of its columns by the name of the variable.

    If `open_loop` is true, the table contains the angle of the body without feedback.
    """
    headers = {
        "time": ["t"],
        "angle": ["error"],
        "closed_form_angle": ["closed form"],
        "open_loop_angle": ["open loop"],
        "rate": ["ω1", "ω2", "ω3"],
        "command": ["command"],
        "norm": ["|λ|"],
    }
    omitted = {"closed_form_angle": not verdict.applies, "open_loop_angle": not open_loop}
    unit = command_unit(verdict)
    title = f"t [s], error angle [°], body rate ω [°/s], magnitude of the command [{unit}], |λ|"
    return title, {name: texts for name, texts in headers.items() if not omitted.get(name)}


def loop_fact_rows(
    verdict: LoopVerdict, actuator: Actuator | None = None, open_loop_angle: float | None = None
) -> list[tuple[str, str]]:
    """Return the facts about the motion as pairs of a name and a text; a dash replaces values that are not defined.

    `actuator` is the actuator of the simulation; its limit is compared with the command. `open_loop_angle` [rad] is
    the final angle without feedback, or None if it was not simulated.
    """
    actuator = Actuator() if actuator is None else actuator
    final, settled, drift = (float(x) for x in (verdict.final_angle, verdict.settled_angle, verdict.norm_drift))
    lowest, highest, least = (float(x) for x in (verdict.least_norm, verdict.largest_norm, verdict.least_error))
    settling = float(verdict.settling_time)
    drifted = f", within {number(drift, 3)} of its exact value" if math.isfinite(drift) else ""
    exactly = " in continuous time, from the closed form" if verdict.least_error_exact else ""
    rows = [
        ("final error", f"{degrees(final)}°" if math.isfinite(final) else "-"),
        (f"within {degrees(settled)}°", f"from {settling:.4f} s on" if math.isfinite(settling) else "not settled"),
        ("closed form", _closed_form(verdict)),
        ("largest command", _peak(verdict, each_axis=actuator.limit is not None and actuator.saturation == "axis")),
        ("limit of command", _limit(actuator, command_unit(verdict))),
        ("|λ|", f"{number(lowest)} to {number(highest)}{drifted}"),
        ("smallest |μ|", f"{number(least)}{exactly}" if math.isfinite(least) else "-"),
        ("evaluated at", f"{int(verdict.instants)} instants, more than in the table"),
    ]
    if open_loop_angle is not None:
        finite = math.isfinite(open_loop_angle)
        rows.append(("without feedback", f"{degrees(open_loop_angle)}° from the program at the end" if finite else "-"))
    return rows


def _closed_form(verdict: LoopVerdict) -> str:
    deviation = float(verdict.deviation)
    if not math.isfinite(deviation):
        return str(np.asarray(verdict.record().variables["closed_form"].values))
    relative = f"{number(deviation, 3)}, relative to the largest |μ|"
    return f"agrees within {relative}" if verdict.agrees else f"differs from it by {relative}"


def _peak(verdict: LoopVerdict, each_axis: bool) -> str:
    """Describe the largest magnitude of the command and, if `each_axis` is true, its largest components."""
    peak, unit = float(verdict.peak_command), command_unit(verdict)
    if not math.isfinite(peak):
        return "-"
    norm = f"{degrees(peak)} {unit} at {float(verdict.peak_time):.6g} s"
    return f"{_degrees(verdict.peak_components)} {unit} along x, y, z; magnitude {norm}" if each_axis else norm


def _limit(actuator: Actuator, unit: str) -> str:
    if actuator.limit is None:
        return "none"
    if actuator.saturation == "norm":
        return f"{_degrees(actuator.limit)} {unit}, on the magnitude"
    return f"{_degrees(actuator.limit)} {unit} along {'x, y, z' if np.ndim(actuator.limit) else 'each axis'}"


def _degrees(angles: Any) -> str:
    return ", ".join(map(degrees, np.ravel(angles).tolist()))


def _gain(value: Any) -> str:
    if np.ndim(value) == 0:
        return f"{value:.6g}"
    return "matrix" if np.ndim(value) == 2 else "(" + ", ".join(f"{x:.4g}" for x in value) + ")"
