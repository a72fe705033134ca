"""The outcome of a tuning in words: what was met, what binds, and what to do."""

import numpy as np
from numpy.polynomial import Polynomial

from qtraj.design.proof.certificate import Certificate
from qtraj.path.spiral_helix import SpiralHelix

RADII = 257
"""Instants at which the radius is looked at."""


def converged(certificate: Certificate, steps: int) -> str:
    """What to say of a tuning that met every limit."""
    known = "proved on the whole path" if certificate.holds else "met, some as far as refined sampling shows"
    lines = [f"converged in {_counted(steps)}: every limit is {known}."]
    lines += [f"{name} binds: {certificate.describe(name)}." for name in certificate.binding]
    if not certificate.binding:
        lines.append("No limit binds: the path is the best one without them.")
    return " ".join(lines)


def not_converged(certificate: Certificate, steps: int) -> str:
    """What to say of a search that stopped early, although the limits can be met or nearly so."""
    unmet = certificate.unmet
    found = "; ".join(f"{name} is {certificate.status[name]}: {certificate.describe(name)}" for name in unmet)
    state = found or "every limit is met, but the objective may not be at its least"
    return (
        f"not converged after {_counted(steps)}: {state}. Try a larger max_steps, more starts, other starting "
        "velocities, or wider limits."
    )


def infeasible(certificate: Certificate, steps: int) -> str:
    """What to say where no boundary velocities were found that meet the limits."""
    found = "; ".join(f"{name} is {certificate.describe(name)}" for name in certificate.unmet)
    return f"infeasible: no boundary velocities were found that meet the limits. The path breaks them least: {found}."


def remark(path: SpiralHelix) -> str:
    """What else should be known of a path: whether it runs through its own axis, where the radius is negative."""
    times = np.linspace(0.0, float(path.duration), RADII)
    radii = Polynomial(np.asarray(path.radius))(times)
    least = int(np.argmin(radii))
    if radii[least] > 0:
        return ""
    return (
        f"Mind: the path runs through its own axis (the radius is {radii[least]:.4g} m at t = "
        f"{times[least]:.4g} s). An axis farther away, or other boundary velocities, avoid that."
    )


def _counted(steps: int) -> str:
    return f"{steps} step" if steps == 1 else f"{steps} steps"
