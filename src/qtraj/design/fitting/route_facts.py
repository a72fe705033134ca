"""Facts about a fitted route, as plain data and as text, for the terminal and JSON."""

from typing import Any

import numpy as np

from qtraj.design.fitting.facts import TITLE as TURN_TITLE, fact_rows, facts
from qtraj.design.fitting.fitted import Fitted
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.plain import plain
from qtraj.foundation.size_text import duration_text, length_text
from qtraj.motion.attitude_residual import mounting_text

TITLE = "Route against the recording"


def route_facts(fitted: FittedRoute) -> dict[str, Any]:
    """Return the record of a fitted route as JSON types, with three more items.

    `length` [m] is the length of the route, `segments` the number of its segments, and `time_standing` [s] the total
    duration of its stops.
    """
    standing = np.diff(np.asarray(fitted.stops), axis=1).sum() if len(fitted.stops) else 0.0
    more = {"length": float(fitted.path.length()), "segments": fitted.path.segments, "time_standing": float(standing)}
    return plain(fitted.record()) | more


def facts_of(fitted: Fitted | FittedRoute | None) -> dict[str, Any] | None:
    """Return the `facts` of a fitted spiral-helix or the `route_facts` of a fitted route; None for None."""
    if fitted is None:
        return None
    return facts(fitted) if isinstance(fitted, Fitted) else route_facts(fitted)


def fit_rows(fitted: Fitted | FittedRoute) -> tuple[str, list[tuple[str, str]], str]:
    """Return a title, the facts as pairs of a name and a text, and a warning, a note or an empty string."""
    if not isinstance(fitted, Fitted):
        return TITLE, route_fact_rows(fitted), ""
    fit = facts(fitted)
    note = "" if fit["status"] == ResultCode.successful.name else f"Note: {fit['result']}"
    return TURN_TITLE, fact_rows(fit), f"Warning: {fit['warning']}" if fit["warning"] else note


def route_fact_rows(fitted: FittedRoute) -> list[tuple[str, str]]:
    """Return the facts as pairs of a name and a text."""
    numbers, residual, duration = route_facts(fitted), fitted.residual, float(fitted.path.duration)
    rows = [
        ("length", f"{length_text(numbers['length'])} in {duration_text(duration)}"),
        ("segments", f"{numbers['segments']}, {duration_text(duration / numbers['segments'], 3)} each on average"),
        ("stops", f"{len(fitted.stops)}, {duration_text(numbers['time_standing'])} in total"),
        ("distance", f"{_length(residual.distance_rms)} RMS, {_length(residual.maximum)} maximum"),
    ]
    if np.isfinite(float(fitted.prediction_error)):
        rows.append(("prediction error", f"{_length(fitted.prediction_error)} RMS at held-out samples"))
    if residual.velocity_rms is not None:
        rows.append(("velocity", f"differs by {float(residual.velocity_rms):.3g} m/s RMS"))
    if len(fitted.outliers):
        rows.append(("outliers", f"{len(fitted.outliers)} samples, excluded from the fit"))
    if len(fitted.gaps):
        rows.append(("gaps", f"{len(fitted.gaps)}, bridged with minimum jerk"))
    if fitted.attitude is not None:
        rows.append(("recorded attitude", mounting_text(fitted.attitude)))
    if fitted.rates is not None:
        values = zip(np.atleast_1d(fitted.rates.rms), np.atleast_1d(fitted.rates.correlation), strict=True)
        texts = [f"{rms:.4f} ({correlation:.3f})" for rms, correlation in values]
        axes = "x, y, z" if len(texts) == 3 else "yaw"
        rows.append(("recorded rates", f"{', '.join(texts)} rad/s RMS difference (correlation) for {axes}"))
        if fitted.rates.note:
            rows.append(("note on rates", fitted.rates.note))
    return rows


def _length(length: Any) -> str:
    return length_text(float(length), 3)
