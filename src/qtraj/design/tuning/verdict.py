"""The outcome of a tuning in words: what was met, what binds, and what to do."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial

from qtraj.design.proof.certificate import Finding
from qtraj.foundation.outcome import ILL_POSED, ResultCode

RADII = 257
"""Instants at which the radius is looked at."""

ALONE = "Tune this problem alone for advice on what would help."
GO_ON = "Try a larger max_steps, more starts, other starting velocities, or wider limits."


def verdict(
    code: ResultCode,
    findings: Sequence[Finding],
    steps: int,
    advice: str,
    radius: Float[np.ndarray, " n"],
    duration: float,
) -> str:
    """How one tuning ended, and what to do; `radius` and `duration` are those of its path."""
    if code >= ILL_POSED:
        return f"ill-posed: {code.text}"
    say = {ResultCode.successful: converged, ResultCode.infeasible: infeasible}.get(code, not_converged)
    if code != ResultCode.successful and not advice:
        advice = ALONE if code == ResultCode.infeasible else GO_ON
    return " ".join(part for part in (say(findings, steps), advice, remark(radius, duration)) if part)


def converged(findings: Sequence[Finding], steps: int) -> str:
    """What to say of a tuning that met every limit."""
    holds = all(found.status == "proved" for found in findings)
    known = "proved on the whole path" if holds else "met, some as far as refined sampling shows"
    lines = [f"converged in {_counted(steps)}: every limit is {known}."]
    active = [f"{found.name} binds: {found.text}." for found in findings if found.binding]
    return " ".join([*lines, *(active or ["No limit binds: the path is the best one without them."])])


def not_converged(findings: Sequence[Finding], steps: int) -> str:
    """What to say of a search that stopped early, although the limits can be met or nearly so."""
    unmet = "; ".join(f"{found.name} is {found.status}: {found.text}" for found in findings if not found.met)
    state = unmet or "every limit is met, but the objective may not be at its least"
    return f"not converged after {_counted(steps)}: {state}."


def infeasible(findings: Sequence[Finding], steps: int) -> str:
    """What to say where no boundary velocities were found that meet the limits."""
    unmet = "; ".join(f"{found.name} is {found.text}" for found in findings if not found.met)
    return (
        "infeasible: no boundary velocities were found that meet the limits. Of the paths found this one breaks them "
        f"least: {unmet}."
    )


def remark(radius: Float[np.ndarray, " n"], duration: float) -> str:
    """What else should be known of a path: whether it runs through its own axis, where the radius is negative."""
    times = np.linspace(0.0, duration, RADII)
    radii = polynomial.polyval(times, radius)
    least = int(np.argmin(radii))
    if not radii[least] <= 0:
        return ""
    return (
        f"Mind: the path runs through its own axis (the radius is {radii[least]:.4g} m at t = "
        f"{times[least]:.4g} s). An axis farther away, or other boundary velocities, avoid that."
    )


def _counted(steps: int) -> str:
    return f"{steps} step" if steps == 1 else f"{steps} steps"
