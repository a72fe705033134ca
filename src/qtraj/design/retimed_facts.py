"""Describe a retimed path as text, for the terminal."""

import numpy as np

from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.limit_rows import limit_rows
from qtraj.design.speed_profile import SpeedProfile
from qtraj.design.timing.outcome import Retimed
from qtraj.foundation.number_text import intervals
from qtraj.foundation.size_text import duration_text, length_text


def retimed_fact_rows(timed: Retimed, profile: SpeedProfile, lap: bool = False) -> list[tuple[str, str]]:
    """Return duration, length, speeds at the ends and stops as pairs of a name and a text; `lap`: a flying lap."""
    length, (before, after) = float(profile.distance[-1]), np.asarray(profile.durations).tolist()
    start, end = np.asarray(timed.speeds).tolist()
    instead = f" instead of {duration_text(before, 6)}" if np.isfinite(before) else ""
    name = "lap time" if lap else "duration"
    mean = f", at {length / after:.4g} m/s on average" if np.isfinite(after) else ""
    rows = [
        (name, f"{duration_text(after, 6)}{instead}"),
        ("length", f"{length_text(length)}{mean}"),
        ("speed", f"{_speed(start)} at the start, {_speed(end)} at the end"),
    ]
    stops = [(a, b) for a, b in np.asarray(profile.stops).tolist() if b > a]
    return [*rows, ("stops", f"{len(stops)}, at t [s] = {intervals(stops)}")] if stops else rows


def _speed(value: float) -> str:
    return f"{value:.3f} m/s" if np.isfinite(value) else "unknown"


def retimed_limit_rows(certificate: Certificate, profile: SpeedProfile) -> list[tuple[str, ...]]:
    """Return the `limit_rows` of a retimed path, with the fraction of the distance on which each limit is reached."""
    shares = {name: f"{100 * profile.share(name):.1f} %" for name in profile.names}
    return limit_rows(certificate.findings(), shares)
