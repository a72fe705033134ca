"""Describe the outcome of a tuning, with advice."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.polynomial import polynomial

from qtraj.design.proof.certificate import Finding
from qtraj.foundation.outcome import ILL_POSED, ResultCode
from qtraj.path.clearance_quantity import names_obstacle

RADIUS_SAMPLES = 257
"""Number of equally spaced instants at which the sign of the radius is checked."""

ADVICE_BATCH = "Try more starts. For more advice, tune this problem alone."
ADVICE_NOT_CONVERGED = "Try a larger max_steps, more starts, other boundary velocities, or wider limits."


def verdict(
    code: ResultCode,
    findings: Sequence[Finding],
    steps: int,
    starts: int | None,
    advice: str,
    radius: Float[np.ndarray, " n"],
    duration: float,
) -> str:
    """Describe the result of one tuning, with advice; `radius` contains the coefficients of ρ.

    `starts` is the number of starts that were tried, or None if it is unknown.
    """
    if code >= ILL_POSED:
        return f"ill-posed: {code.text}"
    describe = {ResultCode.successful: converged, ResultCode.infeasible: infeasible}.get(code, not_converged)
    if code != ResultCode.successful and not advice:
        advice = ADVICE_BATCH if code == ResultCode.infeasible else ADVICE_NOT_CONVERGED
    return " ".join(
        part for part in (describe(findings, steps, starts), advice, axis_warning(radius, duration)) if part
    )


def converged(findings: Sequence[Finding], steps: int, starts: int | None) -> str:
    """Return the message for a converged tuning."""
    all_proved = all(finding.status == "proved" for finding in findings)
    proved, sampled = (
        "proved to be satisfied on the whole path",
        "satisfied, but some limits were only checked on a fine grid and are not proved",
    )
    lines = [f"converged in {counted(steps, 'step')}: every limit is {proved if all_proved else sampled}."]
    active = [_active(finding) for finding in findings if finding.active]
    return " ".join([*lines, *(active or ["No limit is active: the path is also an optimum without limits."])])


def not_converged(findings: Sequence[Finding], steps: int, starts: int | None) -> str:
    """Return the message for a search that stopped before convergence."""
    unmet = "; ".join(finding.statement for finding in findings if not finding.met)
    problems = unmet or "every limit is satisfied, but the objective may not be at its minimum"
    return f"not converged after {counted(steps, 'step')}{_searched(starts)}: {problems}."


def infeasible(findings: Sequence[Finding], steps: int, starts: int | None) -> str:
    """Return the message for a tuning that found no path that satisfies the limits."""
    unmet = "; ".join(_violated(finding) for finding in findings if not finding.met)
    return (
        f"infeasible: no boundary velocities were found that satisfy the limits{_searched(starts)}. Of all paths "
        f"found, this path has the smallest violation: {unmet}."
    )


def _active(finding: Finding) -> str:
    if names_obstacle(finding.name):
        return f"The body touches {finding.name} at t = {finding.time:.4g} s."
    return f"{finding.name} is active: {finding.text}."


def _violated(finding: Finding) -> str:
    if names_obstacle(finding.name) and finding.value < 0:
        return f"the body enters {finding.name} by {-finding.value:.4g} m at t = {finding.time:.4g} s"
    return f"{finding.name} is {finding.text}"


def axis_warning(radius: Float[np.ndarray, " n"], duration: float) -> str:
    """Return a warning if the path crosses its own axis, so that its radius becomes negative, else an empty string."""
    times = np.linspace(0.0, duration, RADIUS_SAMPLES)
    radii = polynomial.polyval(times, radius)
    min_index = int(np.argmin(radii))
    if not radii[min_index] <= 0:
        return ""
    return (
        f"Note: the path crosses its own axis (the radius is {radii[min_index]:.4g} m at t = "
        f"{times[min_index]:.4g} s). Move the axis farther away, or change the boundary velocities."
    )


def _searched(starts: int | None) -> str:
    return "" if starts is None else f" ({counted(starts, 'start')} tried)"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is one."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
